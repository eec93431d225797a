"""Private names of the package are used, and private functions read their parameters."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name != "_"


class Source:
    """Names of a module.

    `imported` are those that it imports, also as `module.name`; `attributes` those of any object; `passed`
    those that it reads other than to call them: values of tables, callbacks.
    """

    def __init__(self, name: str, text: str) -> None:
        tree = ast.parse(text)
        nodes = list(ast.walk(tree))
        self.name, self.classes = name, [n for n in nodes if isinstance(n, ast.ClassDef)]
        self.functions = [n for n in nodes if isinstance(n, ast.FunctionDef)]
        variables = [n for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)]
        attributes = [n for n in nodes if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Load)]
        called = {id(n.func) for n in nodes if isinstance(n, ast.Call)}
        self.read = {n.id for n in variables}
        aliases = [a for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names]
        modules = {a.asname or a.name for a in aliases}
        self.imported = {a.name for a in aliases}
        self.imported |= {
            n.attr for n in attributes if isinstance(n.value, ast.Name) and n.value.id in modules
        }
        self.attributes = {n.attr for n in attributes}
        self.passed = {n.id for n in variables if id(n) not in called}
        self.passed |= {n.attr for n in attributes if id(n) not in called}
        self.constants = {t.id for n in tree.body for t in _targets(n) if isinstance(t, ast.Name)}
        # other packages call what has a decorator
        self.definitions = {n.name for n in (*self.functions, *self.classes) if not n.decorator_list}

    def private_functions(self) -> Iterator[ast.FunctionDef]:
        """Private functions and methods, and methods of private classes without a base."""
        yield from (f for f in self.functions if is_private(f.name))
        for owner in self.classes:
            if is_private(owner.name) and not owner.bases:
                yield from (f for f in _methods(owner) if not is_private(f.name))


def _targets(statement: ast.stmt) -> list[ast.expr]:
    if isinstance(statement, ast.Assign):
        return statement.targets
    return [statement.target] if isinstance(statement, ast.AnnAssign) else []


def _methods(owner: ast.ClassDef) -> list[ast.FunctionDef]:
    return [f for f in owner.body if isinstance(f, ast.FunctionDef)]


def unused_private_names(sources: Iterable[Source]) -> list[str]:
    """`module: name` of private functions, classes and constants that no module reads."""
    imported = set().union(*(source.imported for source in sources))
    attributes = set().union(*(source.attributes for source in sources))
    return [
        f"{source.name}: {name}"
        for source in sources
        for name in sorted((source.constants | source.definitions - attributes) - imported - source.read)
        if is_private(name)
    ]


def unread_parameters(function: ast.FunctionDef) -> list[str]:
    """Parameters that the body never reads, but for those named `_`."""
    a = function.args
    own = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x is not None]
    nodes = [node for statement in function.body for node in ast.walk(statement)]
    read = {node.id for node in nodes if isinstance(node, ast.Name)}
    return [name for name in own if name not in {*read, "self", "cls", "_"}]


def dead_parameters(sources: Iterable[Source]) -> list[str]:
    """`module: function(parameter)` of parameters that private functions never read.

    Exceptions: functions that are passed as values, that have a decorator, and methods that several classes
    define. They share a signature with others, which may read the parameter.
    """
    passed = set().union(*(source.passed for source in sources))
    methods = Counter(f.name for s in sources for owner in s.classes for f in _methods(owner))
    return [
        f"{source.name}: {function.name}({parameter})"
        for source in sources
        for function in source.private_functions()
        if function.name not in passed and methods[function.name] < 2 and not function.decorator_list
        for parameter in unread_parameters(function)
    ]


@pytest.fixture(scope="module")
def package() -> list[Source]:
    files = sorted((ROOT / "ddgcli").rglob("*.py"))
    return [Source(str(f.relative_to(ROOT)), f.read_text(encoding="utf-8")) for f in files]


def test_every_private_name_is_used(package):
    assert unused_private_names(package) == []


def test_private_functions_read_their_parameters(package):
    assert dead_parameters(package) == []


def test_unused_names_and_parameters_are_detected():
    source = Source(
        "m",
        """
_LIMIT = 3
_log: object = None
def _helper(mesh, length, *, _): return mesh
def _entry(mesh, options): return mesh
def unused(a): return _helper(a, 1, _=2)
class _Path:
    def at(self, start): return self._log
class Second:
    def _rate(self, time): return self
class Third:
    def _rate(self, time): return time
TABLE = {"entry": _entry}
Second()._rate(_Path)
""",
    )
    assert unused_private_names([source]) == ["m: _LIMIT", "m: _log"]
    assert dead_parameters([source]) == ["m: _helper(length)", "m: at(start)"]
