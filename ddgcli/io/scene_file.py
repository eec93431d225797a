"""Scene files: TOML to a plain dict, with the line on which every key stands."""

from __future__ import annotations

import hashlib
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ddgcli.errors import SceneError, excerpt

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class SceneDocument:
    """A scene as written.

    Parameters
    ----------
    data : dict
    lines : dict of key path to int
        Line (from 1) of each table and key; array-of-table entries are numbered.
    source : str
    path : str
        As the user named it; "" for a scene made from options.
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
    """Read a scene file; SceneError with file and line where it is not TOML."""
    source = Path(path)
    try:
        if not source.is_file():
            raise SceneError(f"{path}: no such file; check the path")
        text = source.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise SceneError(f"{path}: cannot be opened ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: byte {error.start} is not UTF-8; save the scene as UTF-8 text") from error
    return parse_scene(text, path, str(source.parent))


def parse_scene(text: str, path: str = "", folder: str = ".") -> SceneDocument:
    """The document of a scene's text."""
    text = text.replace("\r\n", "\n")
    prefix = f"{path}: " if path else ""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # of numbers of too many digits, too
        found = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        what = re.sub(r"\s*\(at .*\)", "", str(error)) or "nested too deeply"
        where = f"line {found[1]}: " if found else f"line {text.count(chr(10)) + 1}: "
        raise SceneError(f"{prefix}{where}not TOML: {excerpt(what)}; mend that line") from error
    return SceneDocument(data, key_lines(text), text, path, folder)


_HEADER = re.compile(r"^\s*(\[\[?)\s*(.+?)\s*(\]\]?)\s*(?:#.*)?$")
_INLINE_KEY = re.compile(r"([A-Za-z0-9_-]+)\s*=(?!=)")


def key_lines(text: str) -> dict[Key, int]:
    """Line of every table header and key of a valid TOML text (tomllib tells lines only of errors)."""
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    rows = text.split("\n")
    k = 0
    while k < len(rows):
        header = _HEADER.match(rows[k])
        if header and "=" not in header[2]:
            table = _enter(_split(header[2]), header[1] == "[[", counts)
            lines.setdefault(table, k + 1)
        elif rows[k].strip() and not rows[k].lstrip().startswith("#"):
            k = _statement(rows, k, table, lines)
        k += 1
    return lines


def _split(dotted: str) -> list[str]:
    return [p.strip().strip("\"'") for p in dotted.split(".")]


def _enter(parts: list[str], is_array: bool, counts: dict[Key, int]) -> Key:
    """Key path of a header; inside arrays of tables the last entry is meant."""
    path: Key = ()
    for depth, part in enumerate(parts):
        path = (*path, part)
        if is_array and depth == len(parts) - 1:
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path = (*path, counts[path])
    return path


def _statement(rows: list[str], first: int, table: Key, lines: dict[Key, int]) -> int:
    """Note the keys of the statement that begins on row `first`; the row on which it ends."""
    last = _last_row(rows, first)
    try:
        value = tomllib.loads("\n".join(rows[first : last + 1]))
    except (ValueError, RecursionError):
        return first
    key: Key = table
    node: Any = value
    for part in _split(rows[first].split("=", 1)[0]):
        key = (*key, part)
        lines.setdefault(key, first + 1)
        node = node.get(part, {}) if isinstance(node, dict) else {}
    _inner(node, key, rows, first, last, lines)
    return last


_PIECE = re.compile(r'"""|\'\'\'|"(?:[^"\\]|\\.)*"|\'[^\']*\'|[#\[\]{}]')


def _last_row(rows: list[str], first: int) -> int:
    """The row on which all brackets and texts of the statement are closed; each row is seen once."""
    depth, quotes = 0, ""
    for number in range(first, len(rows)):
        row, at = rows[number], 0
        while True:
            if quotes:
                end = row.find(quotes, at)
                while quotes == '"""' and end > 0 and row[end - 1] == "\\":
                    end = row.find(quotes, end + 1)
                if end < 0:
                    break
                at, quotes = end + 3, ""
            piece = _PIECE.search(row, at)
            if piece is None or piece[0] == "#":
                break
            at = piece.end()
            quotes = piece[0] if piece[0] in ('"""', "'''") else ""
            depth += (piece[0] in "[{") - (piece[0] in "]}")
        if depth <= 0 and not quotes:
            return number
    return first


def _inner(node: Any, key: Key, rows: list[str], first: int, last: int, lines: dict[Key, int]) -> None:
    """Lines of the keys of inline tables, by looking for `name =` in the rows of the statement."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for name, child in items:
        if isinstance(node, dict):
            found = [r for r in range(first, last + 1) if name in _INLINE_KEY.findall(rows[r])]
            lines.setdefault((*key, name), (found[0] if found else first) + 1)
        if isinstance(child, (dict, list)):
            _inner(child, (*key, name), rows, first, last, lines)
