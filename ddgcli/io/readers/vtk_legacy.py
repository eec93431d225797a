"""Legacy VTK (.vtk): PolyData and UnstructuredGrid, versions 1 to 5, ASCII and binary.

Our own reader: meshio's takes no PolyData, which is what VTK and ParaView write of a surface, and stops at
the METADATA of newer files.
"""

from __future__ import annotations

import re
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.cells import LINE, POLYGON, STRIP, VERTEX, add_vtk_cells
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import numbers, typed

TYPES = {
    "float": "f4", "double": "f8", "char": "i1", "signed_char": "i1", "unsigned_char": "u1", "short": "i2",
    "unsigned_short": "u2", "int": "i4", "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8",
    "vtktypeint64": "i8", "vtktypeuint64": "u8", "vtkidtype": "i4",
}  # fmt: skip
# in the order in which PolyData number their cells
POLYDATA = {"VERTICES": VERTEX, "LINES": LINE, "POLYGONS": POLYGON, "TRIANGLE_STRIPS": STRIP}
WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}
_WORD = re.compile(rb"\s*(\S*)")
DATASETS = ("POLYDATA", "UNSTRUCTURED_GRID")


def read_vtk_legacy(data: bytes) -> RawMesh | None:
    """Read a .vtk file; None where it holds a grid of another kind."""
    head = data[:1024].split(b"\n", 3)
    if not data.startswith(b"# vtk DataFile") or len(head) < 4:
        raise MeshFileError("not a legacy VTK file: it does not begin with '# vtk DataFile'; check the file")
    kind = head[2].strip().upper()
    if kind not in (b"ASCII", b"BINARY"):
        raise MeshFileError(f"line 3 must be ASCII or BINARY, not {excerpt(head[2], 20)!r}; check the file")
    words = _Words(data, sum(len(line) + 1 for line in head[:3]), kind == b"BINARY")
    try:
        if words.next().upper() != "DATASET":
            raise MeshFileError("line 4 must name the DATASET; check the file")
        if words.next().upper() not in DATASETS:
            return None
        return _read(words)
    except (ValueError, KeyError, IndexError, OverflowError) as error:
        if isinstance(error, MeshFileError):
            raise
        raise MeshFileError(
            f"an array of the VTK file cannot be read ({excerpt(error)}); it is truncated or damaged"
        ) from None


class _Words:
    """The file as words, with blocks of numbers between them.

    Parameters
    ----------
    data : bytes
    at : int
        Where reading continues.
    binary : bool
    """

    def __init__(self, data: bytes, at: int, binary: bool) -> None:
        self.data, self.at, self.binary = data, at, binary

    def next(self) -> str:
        """The next word; "" at the end."""
        match = _WORD.match(self.data, self.at)
        self.at = match.end()  # type: ignore[union-attr]
        return match[1].decode("utf-8", "replace")  # type: ignore[index]

    def count(self) -> int:
        """The next word, a number that is not negative and that the file can hold."""
        number = int(self.next())
        if not 0 <= number <= 8 * len(self.data):  # bits are the smallest values
            raise ValueError(f"a count of {number}")
        return number

    def values(self, count: int, kind: str) -> NDArray:
        """The next `count` numbers of a VTK type."""
        if kind.lower() not in TYPES:
            raise MeshFileError(f"data type {excerpt(kind, 40)!r} is not one of VTK's; correct it")
        if count < 0:
            raise ValueError(f"a count of {count}")
        dtype = np.dtype(TYPES[kind.lower()])
        if not self.binary:
            return typed(numbers(self._text(count)), dtype, "the value")
        self.at = self.data.index(b"\n", self.at) + 1 if count else self.at
        size = count * dtype.itemsize
        if len(self.data) - self.at < size:
            raise ValueError(f"{len(self.data) - self.at} bytes, {size} announced")
        block = np.frombuffer(self.data, dtype.newbyteorder(">"), count, self.at)
        self.at += size
        return block.astype(dtype)

    def _text(self, count: int) -> bytes:
        """The next `count` words, from a window that grows: short arrays cost no copies of the file."""
        window_size = 32 * count + 64
        while True:
            window = self.data[self.at : self.at + window_size]
            tokens = window.split(None, count)
            at_end = self.at + len(window) == len(self.data)
            if len(tokens) > count or (at_end and len(tokens) == count):
                break
            if at_end:
                raise ValueError(f"{len(tokens)} numbers, {count} announced")
            window_size *= 4
        self.at += len(window) - (len(tokens[count]) if len(tokens) > count else 0)
        return b" ".join(tokens[:count])

    def at_line_end(self) -> bool:
        """Whether no word follows on the line."""
        end = self.data.find(b"\n", self.at)
        return not self.data[self.at : len(self.data) if end < 0 else end].strip()

    def skip_paragraph(self) -> None:
        """Go to the next blank line."""
        end = self.data.find(b"\n\n", self.at)
        self.at = len(self.data) if end < 0 else end


def _read(words: _Words) -> RawMesh:
    raw = RawMesh(np.zeros((0, 3)))
    lists: dict[str, tuple[NDArray, NDArray]] = {}
    types = np.zeros(0, dtype=np.int64)
    arrays: dict[str, dict[str, NDArray]] = {"POINT_DATA": {}, "CELL_DATA": {}, "": {}}
    place, length = "", 0
    while word := words.next().upper():
        if word == "POINTS":
            n_points = words.count()
            raw.points = (
                words.values(3 * n_points, words.next()).astype(np.float64, copy=False).reshape(-1, 3)
            )
        elif word in POLYDATA or word == "CELLS":
            lists[word] = _cells(words)
        elif word == "CELL_TYPES":
            types = words.values(words.count(), "int").astype(np.int64)
        elif word in ("POINT_DATA", "CELL_DATA"):
            place, length = word, words.count()
        elif word == "METADATA":
            words.skip_paragraph()
        elif not _attribute(words, word, length, arrays[place]):
            raw.notes.append(f"what follows the unknown section {word[:20]!r} of the file is left out")
            break
    n_cells = len(types) if "CELLS" in lists else sum(len(sizes) for _, sizes in lists.values())
    for kind, expected in (("POINT_DATA", len(raw.points)), ("CELL_DATA", n_cells)):
        wrong = next((name for name, value in arrays[kind].items() if len(value) != expected), None)
        if wrong is not None:
            raise ValueError(f"{wrong} has {len(arrays[kind][wrong])} entries, not {expected}")
    raw.vertex = arrays["POINT_DATA"]
    if "CELLS" in lists:
        connectivity, sizes = lists["CELLS"]
    else:
        ordered = [(code, *lists[name]) for name, code in POLYDATA.items() if name in lists]
        none = np.zeros(0, dtype=np.int64)
        types = np.concatenate([none, *(np.full(len(sizes), code) for code, _, sizes in ordered)])
        connectivity = np.concatenate([none, *(nodes for _, nodes, _ in ordered)])
        sizes = np.concatenate([none, *(sizes for _, _, sizes in ordered)])
    add_vtk_cells(raw, types, connectivity, sizes, arrays["CELL_DATA"])
    return raw


def _cells(words: _Words) -> tuple[NDArray, NDArray]:
    """Nodes of cells one after the other, and how many each has."""
    first, second = words.count(), words.count()
    before = words.at
    if words.next().upper() == "OFFSETS":  # version 5: first = cells + 1, second = nodes
        offsets = words.values(first, words.next()).astype(np.int64)
        if words.next().upper() != "CONNECTIVITY":
            raise ValueError("OFFSETS without CONNECTIVITY")
        return words.values(second, words.next()).astype(np.int64), np.diff(offsets)
    words.at = before
    mixed = words.values(second, "int")  # first = cells; their sizes precede them
    if len(mixed) == 4 * first and (mixed[::4] == 3).all():
        return mixed.reshape(-1, 4)[:, 1:].astype(np.int64).ravel(), np.full(first, 3)
    starts, at = [], 0
    for _ in range(first):
        if at >= second or mixed[at] < 0:
            raise ValueError(f"a cell of negative size, or beyond the {second} numbers announced")
        starts.append(at)
        at += 1 + int(mixed[at])
    if at != second:
        raise ValueError(f"cells of {at} numbers, {second} announced")
    mixed = mixed.astype(np.int64)
    return np.delete(mixed, starts), mixed[starts]


def _attribute(words: _Words, word: str, length: int, into: dict[str, NDArray]) -> bool:
    """Read one section of arrays; False where it is unknown."""
    if word == "FIELD":
        words.next()
        for _ in range(words.count()):
            name, width, rows, kind = words.next(), words.count(), words.count(), words.next()
            if kind.lower() not in TYPES:  # such as text
                return False
            _store(into, name, words.values(width * rows, kind), width)
            _pass_metadata(words)
        return True
    if word not in ("SCALARS", "COLOR_SCALARS", "TEXTURE_COORDINATES", "LOOKUP_TABLE", *WIDTHS):
        return False
    name = words.next()
    if word == "LOOKUP_TABLE":
        words.values(4 * words.count(), "unsigned_char" if words.binary else "float")
        return True
    if word == "COLOR_SCALARS":
        width, kind = words.count(), "unsigned_char" if words.binary else "float"
    elif word == "TEXTURE_COORDINATES":
        width, kind = words.count(), words.next()
    else:
        width, kind = WIDTHS.get(word, 1), words.next()
    if word == "SCALARS":
        width = _scalar_width(words)
    _store(into, name, words.values(width * length, kind), width)
    return True


def _scalar_width(words: _Words) -> int:
    """Components of SCALARS (may be words_left), before the line LOOKUP_TABLE (may be there)."""
    end = words.data.find(b"\n", words.at)
    words_left = words.data[words.at : end].split()
    if words_left:
        words.next()
    before = words.at
    if words.next().upper() == "LOOKUP_TABLE":
        words.next()
    else:
        words.at = before
    width = int(words_left[0]) if words_left else 1
    if width < 1:
        raise ValueError(f"{width} components")
    return width


def _pass_metadata(words: _Words) -> None:
    before = words.at
    # alone on its line: an array may have this name
    if words.next().upper() == "METADATA" and words.at_line_end():
        words.skip_paragraph()
    else:
        words.at = before


def _store(into: dict[str, NDArray], name: str, values: NDArray, width: int) -> None:
    into[unquote(name)] = values.reshape(-1, width) if width > 1 else values
