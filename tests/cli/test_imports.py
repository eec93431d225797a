"""Deferred imports: each module is the one that ordinary imports give, whichever is imported first."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest

from tests.test_layers import files

# each statement runs in its own fork of one process that has just deferred imports, as a command does
EACH_FIRST = """
import importlib, json, os, sys, types
from ddgcli.cli.imports import defer_imports

def copies():
    # classes of deferred packages of which another module holds a second copy
    modules = {k: m for k, m in sys.modules.items() if k.startswith(("numpy.", "scipy.spatial"))}
    for module in modules.values():
        for value in list(vars(module).values()):
            if isinstance(value, type) and value.__module__ in modules:
                own = vars(modules[value.__module__]).get(value.__qualname__, value)
                if own is not value:
                    yield f"second copy of {value}"

def fault(statement):
    try:
        exec(statement, {})
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    return next(copies(), "")

defer_imports()
faults = {}
for statement in json.loads(sys.argv[1]):
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        os.write(writing, fault(statement).encode()[:1000])
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        if line := pipe.read().decode():
            faults[statement] = line
    os.waitpid(child, 0)
print(json.dumps(faults))
"""


def faults_of_first_imports(statements: list[str]) -> dict[str, str]:
    arguments = [sys.executable, "-c", EACH_FIRST, json.dumps(statements)]
    return json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout)


SCIPY = (
    *("interpolate", "signal", "cluster.hierarchy", "stats", "ndimage", "optimize"),
    *("spatial.distance", "spatial.transform", "spatial._geometric_slerp", "sparse.csgraph", "sparse.linalg"),
)
NUMPY = (
    *("ma", "ma.core", "ma.mrecords", "polynomial.polynomial", "polynomial.hermite", "random.mtrand"),
    *("random._pcg64", "testing._private.utils", "typing.mypy_plugin", "f2py.auxfuncs"),
)
ATTRIBUTES = (
    "import scipy.spatial; scipy.spatial.ConvexHull([[0, 0], [1, 0], [0, 1]])",
    "import scipy; scipy.spatial.distance.euclidean([0], [1])",
    "from scipy.spatial import *; Delaunay([[0, 0], [1, 0], [0, 1]])",
    "import numpy as np; assert np.ma.array([1], mask=[True]).mask; assert np.ma.is_masked(np.ma.masked)",
    "import numpy as np; held = np.ma; np.ma.core; assert held.is_masked(np.ma.masked)",
    "import numpy as np; np.random.default_rng(0); np.polynomial.Polynomial([1])",
    "import numpy as np; np.testing.assert_equal(1, 1); np.f2py.main; np.typing.NDArray",
)
AFTER_THE_TREE = (
    "from scipy.spatial import cKDTree; import scipy.interpolate",
    "from scipy.spatial import cKDTree; import scipy.spatial._ckdtree as m; assert m.cKDTree is cKDTree",
    "from scipy.spatial import cKDTree, KDTree, distance; assert issubclass(KDTree, cKDTree)",
    "import scipy.spatial as s; t = s.cKDTree; s.distance; import scipy; assert t is scipy.spatial.cKDTree",
    "import pickle; from scipy.spatial import cKDTree; t = cKDTree([[0.0]]); pickle.loads(pickle.dumps(t))",
)


@pytest.mark.parametrize(
    "statements",
    [
        [f"import scipy.{name}" for name in SCIPY],
        [f"import numpy.{name}" for name in NUMPY],
        ATTRIBUTES,
        AFTER_THE_TREE,
    ],
    ids=["scipy", "numpy", "attributes", "after the k-d tree"],
)
def test_any_module_can_be_the_first_import_of_a_command(statements):
    assert faults_of_first_imports(list(statements)) == {}


IN_THREADS = """
import sys, threading
sys.setswitchinterval(1e-6)
errors, ready = [], threading.Barrier({n})
def run(statement):
    ready.wait()
    try:
        exec(statement, {{}})
    except BaseException as error:
        errors.append(error)
threads = [threading.Thread(target=run, args=[s]) for s in {statements!r}]
[t.start() for t in threads]
[t.join() for t in threads]
if errors:
    raise errors[0]
"""


def test_threads_import_deferred_modules_at_the_same_time():
    statements = [
        "from scipy.spatial import cKDTree; cKDTree([[0.0]]).query([1.0])",
        "import scipy.spatial; scipy.spatial.ConvexHull([[0, 0], [1, 0], [0, 1]])",
        "import numpy as np; np.random.default_rng(0)",
        "import numpy as np; np.ma.array([1])",
        "import numpy as np; np.polynomial.Polynomial([1])",
    ] * 3
    assert faults_of_first_imports([IN_THREADS.format(n=len(statements), statements=statements)] * 3) == {}


def imported_in_functions(source: str) -> Iterator[str]:
    """Modules outside the project and the standard library that a source imports inside functions."""
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef):
            for node in ast.walk(function):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
                yield from (name for name in names if name.split(".")[0] not in NO_LIBRARIES)


NO_LIBRARIES = {"ddgcli", "distributed", *sys.stdlib_module_names}


def test_each_library_that_a_function_imports_can_be_the_first_import_of_a_command():
    names = {name for path in files() for name in imported_in_functions(path.read_text(encoding="utf-8"))}
    assert {"scipy.interpolate", "matplotlib.figure", "h5py", "pyamg", "meshio"} <= names
    installed = [name for name in sorted(names) if find_spec(name.split(".")[0])]  # extras may be absent
    assert faults_of_first_imports([f"import {name}" for name in installed]) == {}


def test_a_curve_flow_that_spreads_points_along_splines_runs_as_a_command(tmp_path):
    """The command in its own process imports `scipy.interpolate`, after `scipy.spatial` was deferred."""
    angle = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 150))
    rows = [f"v {np.cos(a)} {np.sin(a)} 0" for a in angle] + [f"l {' '.join(map(str, range(1, 151)))} 1"]
    (tmp_path / "uneven.obj").write_text("\n".join(rows))
    command = ["curve-flow", "uneven.obj", "--steps", "3", "-o", "flow.npz"]
    run = subprocess.run(
        [sys.executable, "-m", "ddgcli", *command], cwd=tmp_path, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
