"""Public functions of the core document every parameter and what they return; their examples are correct.

A function is public if another module imports it. `tests/library/test_exported_names.py` tests those of
`ddgcli.library`.
"""

from __future__ import annotations

import ast
import builtins
import doctest
import functools
import importlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "ddgcli.algorithms",
    "ddgcli.cli.batch",
    "ddgcli.errors",
    "ddgcli.geometry",
    "ddgcli.io",
    "ddgcli.linalg",
    "ddgcli.mechanics",
    "ddgcli.memory",
    "ddgcli.mesh",
    "ddgcli.models",
    "ddgcli.operators",
    "ddgcli.plots",
    "ddgcli.progress",
    "ddgcli.scenes",
    "ddgcli.simulation",
    "ddgcli.tradeoff",
)


def imported_names(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """(module, name) of everything that a module imports from another, also as `module.name`."""
    alias, attributes = {}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                yield node.module, name.name
                alias[name.asname or name.name] = f"{node.module}.{name.name}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            attributes.append((node.value.id, node.attr))
    yield from {(alias[name], attribute) for name, attribute in attributes if name in alias}


def public_functions(trees: dict[str, ast.Module]) -> Iterator[tuple[str, ast.FunctionDef]]:
    """(module, function) of every function at the top of a module that another module imports."""
    users: dict[tuple[str, str], set[str]] = {}
    for module, tree in trees.items():
        for name in imported_names(tree):
            users.setdefault(name, set()).add(module)
    for module, tree in trees.items():
        for node in tree.body:
            is_public = isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
            if is_public and users.get((module, node.name), set()) - {module}:
                yield module, node


def sections(docstring: str) -> dict[str, str]:
    """Content of each numpydoc section by its title; the summary under ""."""
    pieces = re.split(r"^([A-Z][A-Za-z ]+)\n-{3,}\n", docstring, flags=re.MULTILINE)
    return {"": pieces[0], **dict(zip(pieces[1::2], pieces[2::2]))}


def documented(section: str) -> set[str]:
    """Names on the unindented lines of a section: `a, b : type` documents a and b."""
    lines = [line for line in section.splitlines() if line and not line.startswith(" ")]
    return {name.strip(" *") for line in lines for name in line.split(" :")[0].split(",")}


def parameters(function: ast.FunctionDef) -> set[str]:
    a = function.args
    return {x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x is not None}


def missing(function: ast.FunctionDef) -> list[str]:
    """What the docstring of a public function lacks, or documents although the function has it not."""
    own = sections(ast.get_docstring(function) or "")
    names, described = parameters(function), documented(own.get("Parameters", ""))
    lacking = [f"parameter {name}" for name in sorted(names - described)]
    lacking += [f"unknown {name}" for name in sorted(described - names)]
    if not re.match(r"[A-Z0-9].*\.$", own[""].split("\n\n")[0].strip(), flags=re.DOTALL):
        lacking.append("summary that ends with a full stop")
    result = ast.unparse(function.returns) if function.returns else "None"
    if result not in ("None", "NoReturn") and not {"Returns", "Yields"} & set(own):
        lacking.append("Returns")
    return lacking


def documented_types(docstring: str) -> set[str]:
    """Words like `TriangleMesh` where the docstring names types of parameters, attributes and results."""
    titles, types = ("Parameters", "Attributes", "Returns", "Yields"), set()
    for title, section in sections(docstring).items():
        for line in section.splitlines() if title in titles else ():
            *name, kind = line.split(" : ", 1)
            if line.startswith(" ") or not name and title in ("Parameters", "Attributes"):
                continue
            literal = r"""[{].*?[}]|'[^']*'|"[^"]*"|`[^`]*`"""
            types |= set(re.findall(r"(?<![\w.])[A-Z]\w*[a-z]\w*", re.sub(literal, "", kind)))
    return types


def type_names(trees: Iterable[ast.Module]) -> set[str]:
    """Classes, imported names and aliases of the package; names of Python."""
    names = set(dir(builtins))
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def unknown_types(trees: dict[str, ast.Module]) -> list[tuple[str, str, str]]:
    """(module, function or class, type) of documented types that do not exist."""
    known = type_names(trees.values())
    return [
        (module, node.name, name)
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        for name in sorted(documented_types(ast.get_docstring(node) or "") - known)
    ]


@functools.cache
def modules() -> dict[str, ast.Module]:
    files = (ROOT / "ddgcli").rglob("*.py")
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): ast.parse(
            path.read_text(encoding="utf-8")
        )
        for path in sorted(files)
    }


@pytest.fixture(scope="module")
def functions() -> list[tuple[str, ast.FunctionDef]]:
    return [
        (module, function)
        for module, function in public_functions(modules())
        if any(module == package or module.startswith(f"{package}.") for package in PACKAGES)
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_public_functions_document_parameters_and_results(package, functions):
    own = [(m, f) for m, f in functions if m == package or m.startswith(f"{package}.")]
    assert own
    assert {f"{m}.{f.name}": lacking for m, f in own if (lacking := missing(f))} == {}


def test_examples_of_public_functions_are_correct(functions):
    attempted = 0
    for module, function in functions:
        text = ast.get_docstring(function) or ""
        if ">>>" in text:
            names = dict(vars(importlib.import_module(module)))
            test = doctest.DocTestParser().get_doctest(text, names, f"{module}.{function.name}", None, 0)
            result = doctest.DocTestRunner(verbose=False).run(test)
            assert result.failed == 0, f"{module}.{function.name}"
            attempted += result.attempted
    assert attempted > 10


def test_documented_types_exist():
    assert list(unknown_types(modules())) == []


def test_an_unknown_type_is_detected():
    source = '''
class Surface: ...
def area(mesh, mode) -> float:
    """Area.

    Parameters
    ----------
    mesh : list of Surface or Mesh
        Of One Type.
    mode : {'Fast', 'Slow'}

    Returns
    -------
    Measured
    """
'''
    unknown = unknown_types({"p": ast.parse(source)})
    assert unknown == [("p", "area", "Measured"), ("p", "area", "Mesh")]


def test_an_incomplete_docstring_is_detected():
    source = '''
def area(mesh, scale, *, mode="x") -> float:
    """Area

    Parameters
    ----------
    mesh, scaled : float
    """
'''
    (function,) = ast.parse(source).body
    assert missing(function) == [
        "parameter mode",
        "parameter scale",
        "unknown scaled",
        "summary that ends with a full stop",
        "Returns",
    ]


def test_public_is_what_another_module_imports():
    trees = {
        "p.a": ast.parse("def f(): ...\ndef g(): ...\ndef h(): ...\ndef _i(): ..."),
        "p.b": ast.parse("from p.a import f, _i\nfrom p import a\na.g()"),
    }
    assert [f.name for _, f in public_functions(trees)] == ["f", "g"]
