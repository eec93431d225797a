"""Scene files: TOML as a plain dict, with the line of every key."""

from __future__ import annotations

import hashlib
import re
import sys
import tomllib
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any

from ddgcli.errors import SceneError

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class SceneDocument:
    """Content of a scene file.

    Parameters
    ----------
    data : dict
    lines : dict of key path to int
        Line (from 1) of each table and key; array-of-table entries are numbered.
    source : str
    path : str
        Path of the call; "" for a scene from options.
    folder : str
        Where relative mesh paths start.
    """

    data: dict[str, Any]
    lines: dict[Key, int] = field(default_factory=dict)
    source: str = ""
    path: str = ""
    folder: str = "."

    def line(self, key: Key) -> int | None:
        """Line of the key, of the nearest key that encloses it, or of the first that it encloses."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.lines:
                return self.lines[key[:length]]
        return min((n for k, n in self.lines.items() if k[: len(key)] == key), default=None)

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.source.encode()).hexdigest()


def read_scene(path: str) -> SceneDocument:
    """Read a scene file.

    Parameters
    ----------
    path : str
        `-` is standard input.

    Returns
    -------
    SceneDocument
        Relative paths start at the folder of the file.

    Raises
    ------
    SceneError
        No such file, not UTF-8, or not TOML, with its line.
    """
    source = Path(path)
    if path != "-" and not source.is_file():
        raise SceneError(f"{path}: no such file; check the path")
    try:
        if path == "-" and sys.stdin is None:
            raise SceneError("-: standard input is closed; name a file")
        data = sys.stdin.buffer.read() if path == "-" else source.read_bytes()
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: byte {error.start} is not UTF-8; save the scene as UTF-8 text") from error
    return parse_scene(text, path, str(source.parent))


def parse_scene(text: str, path: str = "", folder: str = ".") -> SceneDocument:
    """Parse the text of a scene.

    Parameters
    ----------
    text : str
        TOML.
    path : str
        Path of the call, for errors; "" for a scene from options.
    folder : str
        Where relative mesh paths start.

    Returns
    -------
    SceneDocument

    Raises
    ------
    SceneError
        Not TOML, with its line.
    """
    text = text.replace("\r\n", "\n")
    prefix = f"{path}: " if path else ""
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        match = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        what = re.sub(r"\s*\(at .*\)", "", str(error)) or "nested too deeply"
        if what == "Invalid value":
            what += " (numbers have a digit on each side of the point, texts have quotes)"
        where = f"line {match[1]}: " if match else f"line {text.count(chr(10)) + 1}: "
        raise SceneError(f"{prefix}{where}not TOML: {what}; correct that line") from error
    return SceneDocument(data, key_lines(text), text, path, folder)


_HEADER = re.compile(r"^\s*(\[\[?)\s*(.+?)\s*(\]\]?)\s*(?:#.*)?$")
_INLINE_KEY = re.compile(r"([A-Za-z0-9_-]+)\s*=(?!=)")
# tokens that determine the end of a statement: strings, comments, brackets, ends of rows
_TOKEN = re.compile(
    r""""{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*|[\[\]{}\n]""",
    re.DOTALL,
)


def key_lines(text: str) -> dict[Key, int]:
    """Line of every table header and key of a valid TOML text (tomllib reports lines of errors only)."""
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    rows = text.split("\n")
    start = [0, *accumulate(len(row) + 1 for row in rows)]
    k = 0
    while k < len(rows):
        header = _HEADER.match(rows[k])
        if header and "=" not in header[2]:
            table = _enter(_split(header[2]), header[1] == "[[", counts)
            lines.setdefault(table, k + 1)
        elif rows[k].strip() and not rows[k].lstrip().startswith("#"):
            end = _statement_end(text, start[k])
            k = _statement(rows, k, bisect_right(start, end) - 1, table, lines)
        k += 1
    return lines


def _split(dotted: str) -> list[str]:
    return [p.strip().strip("\"'") for p in dotted.split(".")]


def _enter(key_names: list[str], is_array: bool, counts: dict[Key, int]) -> Key:
    """Key path of a header; inside arrays of tables the last entry is meant."""
    path: Key = ()
    for depth, key_name in enumerate(key_names):
        path = (*path, key_name)
        if is_array and depth == len(key_names) - 1:
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path = (*path, counts[path])
    return path


def _statement_end(text: str, start: int) -> int:
    """Place of the end of the row on which the statement from `start` on ends."""
    depth = 0
    for token in _TOKEN.finditer(text, start):
        if token[0] in ("[", "{"):
            depth += 1
        elif token[0] in ("]", "}"):
            depth -= 1
        elif token[0] == "\n" and depth <= 0:
            return token.start()
    return len(text)


def _statement(rows: list[str], first: int, last: int, table: Key, lines: dict[Key, int]) -> int:
    """Note the keys of the statement on the rows `first` to `last`; the row on which it ends."""
    try:
        value = tomllib.loads("\n".join(rows[first : last + 1]))
    except (ValueError, RecursionError):
        return first
    row_of: dict[str, int] = {}
    for row in range(first, last + 1):
        for name in _INLINE_KEY.findall(rows[row]):
            row_of.setdefault(name, row)
    key: Key = table
    node: Any = value
    for key_name in _split(rows[first].split("=", 1)[0]):
        key = (*key, key_name)
        lines.setdefault(key, first + 1)
        node = node.get(key_name, {}) if isinstance(node, dict) else {}
    _inner(node, key, row_of, first, lines)
    return last


def _inner(node: Any, key: Key, row_of: dict[str, int], first: int, lines: dict[Key, int]) -> None:
    """Lines of the keys of inline tables: the first row of the statement with `name =`."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for name, child in items:
        if isinstance(node, dict):
            lines.setdefault((*key, name), row_of.get(str(name), first) + 1)
        if isinstance(child, (dict, list)):
            _inner(child, (*key, name), row_of, first, lines)
