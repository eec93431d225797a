"""Imports point one way: packages import only packages below them, and modules form no cycle."""

import ast
import functools
import graphlib
from collections.abc import Mapping
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "ddgcli"

BASE = {"errors", "choices", "memory", "progress", "representation", "waiting", "workers"}
CORE = BASE | {"mesh", "geometry", "operators", "linalg"}
SIMULATORS = CORE | {"algorithms", "simulation", "mechanics", "scenes"}
# package or module of ddgcli -> the others that it may import, inside functions too
MAY_IMPORT = {
    "__init__": {"errors", "library"},
    "__main__": {"cli"},
    "errors": set(),
    "choices": set(),
    "memory": {"errors"},
    "progress": set(),
    "representation": set(),
    "waiting": set(),
    "workers": {"errors", "waiting"},
    "mesh": BASE,
    "io": BASE | {"mesh"},
    "geometry": BASE | {"mesh"},
    "linalg": BASE,
    "operators": CORE,
    "algorithms": CORE,
    "simulation": BASE | {"mesh", "linalg"},
    "mechanics": BASE | {"mesh", "geometry", "linalg", "simulation"},
    "scenes": BASE | {"mesh", "simulation"},
    "models": SIMULATORS,
    "tradeoff": SIMULATORS | {"models"},
    "plots": BASE | {"mesh", "geometry"},
    "library": SIMULATORS | {"io", "models", "plots", "tradeoff"},
    "cli": SIMULATORS | {"__init__", "io", "models", "tradeoff", "plots"},
}
# packages of `algorithms`, and which of the others each may import
TOPICS = {
    "tracing": set(),
    "hodge": set(),
    "inspection": set(),
    "repair": set(),
    "delaunay": {"tracing"},
    "curvature": {"delaunay"},
    "conformal": {"delaunay"},
    "laplacian": {"delaunay", "conformal", "hodge"},
    "geodesics": {"tracing", "delaunay"},
    "tangent_fields": {"tracing", "delaunay", "geodesics"},
}
MODELS = {"shell", "fluid", "willmore", "curve"}
# third-party modules that one package alone imports
ONE_PACKAGE = {"click": "cli", "meshio": "io", "trimesh": "io", "h5py": "io", "matplotlib": "plots"}
PEERS = {"igl", "potpourri3d", "pygeodesic", "robust_laplacian", "pymeshlab", "gpytoolbox"}


@functools.cache  # three tests read each file
def imported_names(source: str) -> list[str]:
    """Dotted names that a source imports, at its top or inside functions."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def forbidden_imports(package: str, source: str) -> list[str]:
    """Names that a file of `package` may not import."""
    forbidden = []
    for name in imported_names(source):
        top, *rest = name.split(".")
        if top == "ddgcli" and rest and rest[0] in MAY_IMPORT:
            if rest[0] != package and rest[0] not in MAY_IMPORT[package]:
                forbidden.append(name)
        elif top in PEERS or ONE_PACKAGE.get(top, package) != package:
            forbidden.append(name)
    return forbidden


def forbidden_siblings(parent: str, package: str, allowed: set[str], source: str) -> list[str]:
    """Names of other packages of `ddgcli.parent` that a file of `package` may not import."""
    names = [name.split(".") for name in imported_names(source) if name.startswith(f"ddgcli.{parent}.")]
    return [".".join(n) for n in names if n[2] != package and n[2] not in allowed]


def module_name(path: Path) -> str:
    path_names = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(path_names[:-1] if path_names[-1] == "__init__" else path_names)


def import_cycle(sources: Mapping[str, str]) -> list[str]:
    """Modules of one import cycle, first and last the same; empty where there is none.

    `sources` maps dotted module names to their text.
    """
    imports: dict[str, set[str]] = {}
    for module, source in sources.items():
        targets = {n if n in sources else n.rpartition(".")[0] for n in imported_names(source)}
        imports[module] = {t for t in targets if t in sources and t != module}
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_imports_only_packages_below_its_own(path):
    package = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    assert forbidden_imports(package, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "package, source",
    [
        ("geometry", "import ddgcli.cli.main"),
        ("geometry", "from ddgcli import io"),
        ("mesh", "def f():\n    from ddgcli.io.mesh_file import read_mesh"),
        ("algorithms", "import click"),
        ("algorithms", "import igl"),
        ("cli", "import h5py"),
        ("library", "from ddgcli.cli.run import Run"),
        ("algorithms", "from ddgcli.library.meshes import as_mesh"),
    ],
)
def test_a_forbidden_import_is_detected(package, source):
    assert forbidden_imports(package, source)


@pytest.mark.parametrize("model", sorted(MODELS))
def test_models_do_not_import_each_other(model):
    sources = {f.name: f.read_text() for f in (PACKAGE / "models" / model).rglob("*.py")}
    allowed = {f.stem for f in (PACKAGE / "models").glob("*.py")}
    forbidden = {name: forbidden_siblings("models", model, allowed, text) for name, text in sources.items()}
    assert forbidden and not any(forbidden.values()), forbidden


@pytest.mark.parametrize("topic", sorted(TOPICS))
def test_topics_of_algorithms_import_only_topics_below(topic):
    sources = {f.name: f.read_text() for f in (PACKAGE / "algorithms" / topic).rglob("*.py")}
    forbidden = {n: forbidden_siblings("algorithms", topic, TOPICS[topic], s) for n, s in sources.items()}
    assert forbidden and not any(forbidden.values()), forbidden


def test_an_import_of_a_higher_topic_is_detected():
    source = "from ddgcli.algorithms.geodesics.paths import a"
    assert forbidden_siblings("algorithms", "delaunay", TOPICS["delaunay"], source)
    assert forbidden_siblings("models", "fluid", set(), "import ddgcli.models.shell.hinge")


def test_every_package_has_a_row_in_the_tables():
    assert {p.name.removesuffix(".py") for p in PACKAGE.iterdir() if p.name[0] != "."} - {
        "__pycache__",
        "py.typed",
    } <= set(MAY_IMPORT)
    for parent, table in (("algorithms", TOPICS), ("models", MODELS)):
        assert {p.parent.name for p in (PACKAGE / parent).glob("*/__init__.py")} == set(table)


def test_no_modules_import_each_other_in_a_cycle():
    assert import_cycle({module_name(f): f.read_text(encoding="utf-8") for f in files()}) == []


def test_an_import_cycle_is_detected_inside_functions_too():
    sources = {
        "ddgcli.a": "from ddgcli.b import f",
        "ddgcli.b": "from ddgcli import c",
        "ddgcli.c": "def g():\n    from ddgcli.a import h",
    }
    assert len(import_cycle(sources)) == 4
    assert import_cycle(sources | {"ddgcli.c": ""}) == []
