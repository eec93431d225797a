"""The exported names: loaded when used, documented in full, their examples correct."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ddgcli as ddg

PACKAGE = Path(ddg.__file__).parent
EXPORTED = sorted(set(ddg.__all__) - {"__version__", "errors"})


def sections(docstring: str) -> dict[str, str]:
    """Content of each numpydoc section by its title; the summary under ""."""
    pieces = re.split(r"^([A-Z][A-Za-z ]+)\n-{3,}\n", inspect.cleandoc(docstring), flags=re.MULTILINE)
    return {"": pieces[0], **dict(zip(pieces[1::2], pieces[2::2]))}


def documented(section: str) -> set[str]:
    """Names on the unindented lines of a section: `a, b : type` documents a and b."""
    lines = [line for line in section.splitlines() if line and not line.startswith(" ")]
    return {name.strip(" *") for line in lines for name in line.split(" :")[0].split(",")}


def missing_sections(name: str, thing: object) -> list[str]:
    """What the docstring of an exported name lacks."""
    own = sections(thing.__doc__ or "")
    signature = inspect.signature(thing)  # type: ignore[arg-type]
    parameters = set(signature.parameters)
    lacking = [f"parameter {p}" for p in sorted(parameters - documented(own.get("Parameters", "")))]
    lacking += [f"unknown {p}" for p in sorted(documented(own.get("Parameters", "")) - parameters)]
    if not re.match(r"[A-Z0-9].*\.$", own[""].split("\n\n")[0].strip(), flags=re.DOTALL):
        lacking.append("summary that ends with a full stop")
    if not inspect.isclass(thing) and signature.return_annotation not in (None, "None"):
        lacking += [] if "Returns" in own else ["Returns"]
    if f"ddg.{name}" not in own.get("Examples", ""):
        lacking.append("example that uses it")
    if inspect.isclass(thing):
        for member, value in vars(thing).items():
            target = getattr(value, "__func__", getattr(value, "fget", None) or getattr(value, "func", value))
            if not member.startswith("_") and callable(target) and not target.__doc__:
                lacking.append(f"docstring of {member}")
    return lacking


def test_import_loads_neither_numpy_nor_click():
    code = "import sys, ddgcli; print([m for m in ('numpy', 'scipy', 'click', 'typing') if m in sys.modules])"
    isolated = [
        sys.executable,
        "-S",
        "-c",
        f"import sys; sys.path.insert(0, {str(PACKAGE.parent)!r}); {code}",
    ]
    shown = subprocess.run(isolated, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"


def test_use_of_a_name_loads_its_module_alone():
    code = (
        "import sys, ddgcli; ddgcli.icosphere; print('ddgcli.models' in sys.modules, 'h5py' in sys.modules)"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["False", "False"]


def test_several_threads_may_use_names_first():
    """numpy fails, or recurses without end, if threads begin its import at the same time."""
    code = """
import threading, ddgcli
start, errors = threading.Barrier(8), []
def use(names):
    start.wait()
    try:
        for name in names:
            getattr(ddgcli, name)
    except BaseException as error:
        errors.append(error)
names = ("curvature", "read_mesh", "eigenpairs", "simulate", "icosphere", "torus", "errors", "trace")
threads = [threading.Thread(target=use, args=(names[k:] + names[:k],)) for k in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(errors)
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (shown.stdout, shown.stderr) == ("[]\n", "")


def test_no_module_of_the_package_uses_exported_names_while_it_is_imported():
    """A thread that imports it would wait for the lock of these names, and another one for the module."""
    lazy = set(ddg.__all__) - {"__version__"}
    source = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    lines = re.findall(r"^ *from ddgcli import (.+)$", source, re.MULTILINE)
    assert lines and not lazy & {name.split(" ")[0] for line in lines[1:] for name in line.split(", ")}
    assert not re.search(r"^ *import ddgcli\b", source, re.MULTILINE)


def test_dir_lists_what_is_exported_and_unknown_names_are_refused():
    assert dir(ddg) == sorted(ddg.__all__)
    with pytest.raises(AttributeError, match="no attribute 'curvatur'"):
        ddg.curvatur  # noqa: B018
    assert ddg.errors.MeshError.exit_code == 2


def test_table_of_names_is_that_of_the_modules():
    table = {m: set(names) for m, names in ddg._NAMES.items()}
    listed = {m: set(importlib.import_module(f"ddgcli.library.{m}").__all__) for m in table}
    assert table == listed
    assert sum(len(names) for names in table.values()) == len(EXPORTED)


def test_no_exported_name_is_hidden_by_a_package():
    assert {p.stem for p in PACKAGE.iterdir()} & set(EXPORTED) == set()


def test_type_checkers_see_every_name():
    source = (PACKAGE / "__init__.py").read_text()
    starred = re.findall(r"from ddgcli\.library\.(\w+) import \*", source)
    assert sorted(starred) == sorted(ddg._NAMES)
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.parametrize("name", EXPORTED)
def test_docstring_is_complete(name):
    assert missing_sections(name, getattr(ddg, name)) == []


def test_an_incomplete_docstring_is_seen():
    def area(mesh, scale, mode="x") -> float:
        """Area.

        Parameters
        ----------
        mesh, scaled : float
        """
        return 0.0

    assert missing_sections("area", area) == [
        "parameter mode",
        "parameter scale",
        "unknown scaled",
        "Returns",
        "example that uses it",
    ]


@pytest.mark.parametrize("name", EXPORTED)
def test_examples_are_correct(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = getattr(ddg, name)
    own = doctest.DocTestParser().get_doctest(inspect.cleandoc(thing.__doc__), {}, name, None, 0)
    result = doctest.DocTestRunner(verbose=False).run(own)
    assert result.attempted and not result.failed


PACKAGES = sorted(p.parent for p in PACKAGE.rglob("__init__.py") if p.parent != PACKAGE)


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


def imported_from_outside(package: str, sources: dict[str, str]) -> set[str]:
    """Modules and packages directly below `package` that a source outside of it imports."""
    name = re.compile(rf"^\s*(?:from|import) {re.escape(package)}(?:\.| import )(\w+)", re.MULTILINE)
    outside = (text for module, text in sources.items() if not module.startswith(package + "."))
    return {module for text in outside for module in name.findall(text)}


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_every_package_describes_itself_and_lists_its_public_modules(folder):
    package = importlib.import_module(dotted(folder))
    assert len((package.__doc__ or "").split()) >= 10, "describe in a paragraph what the package contains"
    modules = {p.stem for p in folder.glob("*.py")} | {p.parent.name for p in folder.glob("*/__init__.py")}
    assert set(package.__all__) <= modules, "__all__ lists a module that is not there"
    sources = {dotted(path): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    missing = imported_from_outside(dotted(folder), sources) - set(package.__all__)
    assert missing == set(), f"other packages import it: add it to __all__ of {dotted(folder)}"


def test_a_public_module_that_is_not_listed_is_seen():
    sources = {"a.b.c": "from x.y import z", "a.d": "from a.b.c import f\nfrom a.b import e"}
    assert imported_from_outside("a.b", sources) == {"c", "e"}
