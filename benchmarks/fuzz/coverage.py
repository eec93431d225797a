"""Lines of the package that inputs reach: each statement of a function marks its line when it begins.

The package's modules are compiled with one assignment before every statement, `__lines_reached__[LINE] = 1`:
a byte of an array that child processes share. Other packages run as they are; a function of `sys.settrace`
would be called for each call in them, too.
"""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import marshal
import mmap
import os
import sys
from collections.abc import Iterator, Sequence
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

PACKAGE = "ddgcli"
ROOT = Path(__file__).parents[2]
COMPILED = ROOT / "build" / "fuzz" / "compiled"
ARRAY = "__lines_reached__"
LONGEST_TOKEN = 30  # characters


class LineCoverage:
    """Lines of the package's function bodies, and which of them a process or its children have reached.

    Attributes
    ----------
    first : dict of str to int
        Number of the line before a file's first, counted over all files.
    """

    def __init__(self, root: Path = ROOT, package: str = PACKAGE) -> None:
        self.first: dict[str, int] = {}
        count = 0
        for path in sorted((root / package).rglob("*.py")):
            self.first[str(path)] = count
            count += path.read_bytes().count(b"\n") + 2
        self.marks = mmap.mmap(-1, max(count, 1))
        self.package = package

    def start(self) -> None:
        """Mark lines of modules that are imported from now on."""
        early = [name for name in sys.modules if name.startswith(f"{self.package}.")]
        if early:
            raise RuntimeError(f"imported before their lines can be marked: {', '.join(early)}")
        sys.meta_path.insert(0, _Finder(self))

    def array_of(self, path: str) -> memoryview:
        """Marks of a file's lines: the array of its module."""
        first = self.first[path]
        after = min((f for f in self.first.values() if f > first), default=len(self.marks))
        return memoryview(self.marks)[first:after]

    def clear(self) -> None:
        """Clear the marks of all lines."""
        self.marks[:] = bytes(len(self.marks))

    @property
    def snapshot(self) -> bytes:
        """The marks of all lines."""
        return self.marks[:]

    @property
    def count(self) -> int:
        """Number of lines reached."""
        return self.snapshot.count(1)

    def files(self) -> list[str]:
        """Files with a line that was reached."""
        return [path for path in self.first if 1 in self.array_of(path)]


class _Finder(MetaPathFinder):
    """Finds the modules of the package as usual, and has them marked."""

    def __init__(self, coverage: LineCoverage) -> None:
        self.coverage = coverage

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname.split(".")[0] != self.coverage.package:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        if spec is None or spec.origin not in self.coverage.first:
            return spec
        spec.loader = _Loader(fullname, spec.origin, self.coverage)
        return spec


class _Loader(importlib.machinery.SourceFileLoader):
    """Compiles a module with marks; what it has compiled is cached for later processes."""

    def __init__(self, fullname: str, path: str, coverage: LineCoverage) -> None:
        super().__init__(fullname, path)
        self.coverage = coverage

    def exec_module(self, module: ModuleType) -> None:
        setattr(module, ARRAY, self.coverage.array_of(self.path))
        super().exec_module(module)

    def get_code(self, fullname: str) -> CodeType | None:
        own = Path(__file__).stat().st_mtime_ns
        cached = COMPILED / f"{fullname}.{os.stat(self.path).st_mtime_ns}.{own}.{sys.hexversion}"
        if cached.is_file():
            return marshal.loads(cached.read_bytes())
        code = compile(marked(ast.parse(self.get_data(self.path))), self.path, "exec", dont_inherit=True)
        COMPILED.mkdir(parents=True, exist_ok=True)
        temporary = cached.with_name(f".{os.getpid()}")
        temporary.write_bytes(marshal.dumps(code))
        temporary.replace(cached)
        return code


def marked(tree: ast.Module) -> ast.Module:
    """The module with a mark before every statement of its functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = 1 if ast.get_docstring(node, clean=False) is not None else 0
            node.body[first:] = _with_marks(node.body[first:])
    return tree


def _with_marks(body: list[ast.stmt]) -> list[ast.stmt]:
    result: list[ast.stmt] = []
    for statement in body:
        result += [_mark(statement), statement]
        if not isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            for block in _blocks(statement):
                block[:] = _with_marks(block)
    return result


def _blocks(statement: ast.stmt) -> Iterator[list[ast.stmt]]:
    """Blocks of statements that a statement holds."""
    holders: list[Any] = [statement, *getattr(statement, "handlers", []), *getattr(statement, "cases", [])]
    for holder in holders:
        yield from (block for key in ("body", "orelse", "finalbody") if (block := getattr(holder, key, None)))


def _mark(statement: ast.stmt) -> ast.stmt:
    mark = ast.parse(f"{ARRAY}[{statement.lineno}] = 1").body[0]
    for node in ast.walk(mark):
        ast.copy_location(node, statement)
    return mark


def tokens_of(files: Sequence[str]) -> list[bytes]:
    """Words that the modules compare with what they read: their short texts and the names of their fields."""
    words: set[str] = set()
    for path in files:
        for node in ast.walk(ast.parse(Path(path).read_bytes())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str | bytes):
                value = node.value
                words.add(value if isinstance(value, str) else value.decode("latin-1"))
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                words.add(node.target.id)
    return sorted(
        word.encode("utf-8") for word in words if 0 < len(word) <= LONGEST_TOKEN and len(word.split()) == 1
    )
