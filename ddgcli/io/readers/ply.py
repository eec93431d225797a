"""Stanford PLY, ASCII and binary of both byte orders, with every scalar array on vertices and faces.

Our own reader: meshio's loops without end on a file cut in its header, trimesh drops or renames arrays and is
slower; both accept counts that the file cannot hold.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.appearance import COLOR, UV
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import numbers, ragged, typed, whole_numbers

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip

END_OF_HEADER = re.compile(rb"[\r\n][ \t]*end_header *(?:\r\n|\n|\r|\Z)")  # a comment may have the word
COUNT_TYPES = {name: code for name, code in TYPES.items() if code[0] != "f"}  # of the length of a list

# lists that are read of each element; of "tristrips" all
READ_LISTS = {"vertex": (), "face": ("vertex_indices", "vertex_index", "texcoord"), "edge": ()}


@dataclass
class _Property:
    name: str
    type: str
    count_type: str | None = None  # of a list


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_list(self) -> bool:
        return any(p.count_type for p in self.properties)


Columns = dict[str, NDArray | tuple[NDArray, NDArray]]  # a list property gives (members, sizes)


def read_ply(data: bytes) -> RawMesh:
    """Read a PLY file."""
    order, elements, body = _header(data)
    columns: dict[str, Columns] = {}
    source = _Ascii(data[body:]) if order == "" else _Binary(data, body, order)
    for element in elements:
        if element.count and element.properties:
            columns[element.name] = source.take(element)
    return _raw(columns)


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order ('' for ASCII), elements, and where the body begins."""
    if data[:3] != b"ply" or data[3:4] not in (b"\n", b"\r", b" "):
        raise MeshFileError("not a PLY file: it does not begin with 'ply'; check the file")
    end = END_OF_HEADER.search(data)
    if end is None:
        raise MeshFileError("the PLY header has no end_header; the file is truncated or damaged")
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(_text(data[: end.start()]).splitlines(), start=1):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
                if elements[-1].count < 0:
                    raise ValueError
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], TYPES[words[3]], COUNT_TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], TYPES[words[1]]))
        except (KeyError, IndexError, ValueError):
            raise MeshFileError(
                f"line {number}: {excerpt(line, 60)!r} is not a line of a PLY header; correct it"
            ) from None
    if order is None:
        raise MeshFileError("the PLY header has no format line; the file is damaged")
    _require_distinct("element", [e.name for e in elements], "the PLY header")
    for element in elements:
        place = f"the PLY element '{excerpt(element.name, 40)}'"
        _require_distinct("property", [p.name for p in element.properties], place)
    return order, elements, end.end()


def _text(header: bytes) -> str:
    """Lines of a header: ASCII by the format; names of arrays in UTF-8 are ours, other bytes anyone's."""
    try:
        return header.decode("utf-8")
    except UnicodeDecodeError:
        return header.decode("latin-1")


def _require_distinct(what: str, names: list[str], place: str) -> None:
    for k, name in enumerate(names):
        if name in names[:k]:
            raise MeshFileError(f"{place} has {what} '{excerpt(name, 40)}' twice; rename or remove one")


def _short(element: _Element) -> MeshFileError:
    return MeshFileError(
        f"the header announces {element.count:.6g} elements '{excerpt(element.name, 40)}', more than the "
        "file holds; it is truncated or the header is wrong"
    )


class _Ascii:
    """Elements from the text of the body, one after the other."""

    def __init__(self, text: bytes) -> None:
        self.text, self.at = text, 0
        try:
            self.values = numbers(text)
        except ValueError:
            bad = next((w for w in text.split() if not _is_number(w)), b"")
            raise MeshFileError(f"{excerpt(bad, 20)!r} in the PLY body is not a number; correct it") from None

    def take(self, element: _Element) -> Columns:
        rest, width = self.values[self.at :], len(element.properties)
        if element.count * width > len(rest):
            raise _short(element)
        if not element.has_list:
            table = rest[: element.count * width].reshape(element.count, width)
            self.at += table.size
            return {p.name: _typed(table[:, k], p) for k, p in enumerate(element.properties)}
        if width == 1:
            members, sizes, n_numbers = ragged(rest, element.count, element.name)
            self.at += n_numbers
            return {element.properties[0].name: (members, sizes)}
        return self._mixed(element)

    def _mixed(self, element: _Element) -> Columns:
        """Lists beside scalars: value by value, for files that are rare and small."""
        columns_by_name: dict[str, list] = {p.name: [] for p in element.properties}
        sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_type}
        values = self.values.tolist()
        for _ in range(element.count):
            for p in element.properties:
                if self.at >= len(values):
                    raise _short(element)
                if p.count_type:
                    count = values[self.at]
                    if not (0 <= count < len(values) - self.at and count == int(count)):
                        raise MeshFileError(
                            f"{count:.17g} is not a count of a list of '{excerpt(element.name, 40)}' that "
                            "the file holds; it is truncated or damaged"
                        )
                    size = int(count)
                    columns_by_name[p.name] += values[self.at + 1 : self.at + 1 + size]
                    sizes[p.name].append(size)
                    self.at += 1 + size
                else:
                    columns_by_name[p.name].append(values[self.at])
                    self.at += 1
        exact = {
            p.name: _typed(np.array(columns_by_name[p.name], dtype=np.float64), p) for p in element.properties
        }
        return _columns(exact, sizes)


class _Binary:
    """Elements from the bytes of the body, one after the other."""

    def __init__(self, data: bytes, at: int, order: str) -> None:
        self.data, self.at, self.order = data, at, order

    def take(self, element: _Element) -> Columns:
        if not element.has_list:
            return self._uniform(element, {})
        if element.count * sum(np.dtype(p.count_type or p.type).itemsize for p in element.properties) > (
            len(self.data) - self.at
        ):
            raise _short(element)
        sizes = self._first_sizes(element)
        if sizes is not None:
            start = self.at
            columns = self._uniform(element, sizes)
            if all((columns[f"\0{name}"] == size).all() for name, size in sizes.items()):  # type: ignore[union-attr]
                return {
                    p.name: self._list(columns[p.name], sizes[p.name], element.count)
                    if p.count_type
                    else columns[p.name]
                    for p in element.properties
                }
            self.at = start
        return self._mixed(element)

    @staticmethod
    def _list(members, size: int, count: int) -> tuple[NDArray, NDArray]:
        return members, np.full(count, size, dtype=np.int64)

    def _uniform(self, element: _Element, sizes: dict[str, int]) -> Columns:
        """All rows alike: one view of the bytes. A list `x` also gives its counts, as `\\0x`."""
        fields: list = []
        for p in element.properties:
            if p.count_type:
                fields.append((f"\0{p.name}", self.order + p.count_type))
                fields.append((p.name, self.order + p.type, (sizes[p.name],)))
            else:
                fields.append((p.name, self.order + p.type))
        try:
            dtype = np.dtype(fields)
        except ValueError:
            raise MeshFileError(
                f"the PLY header names a property of '{element.name}' twice; correct it"
            ) from None
        if element.count * dtype.itemsize > len(self.data) - self.at:
            raise _short(element)
        table = np.frombuffer(self.data, dtype, element.count, self.at)
        self.at += element.count * dtype.itemsize
        return {name: table[name] for name in dtype.names or ()}

    def _first_sizes(self, element: _Element) -> dict[str, int] | None:
        """List sizes of the first row, when a table of rows like it fits the file."""
        sizes, at = {}, self.at
        for p in element.properties:
            if p.count_type:
                dtype = np.dtype(self.order + p.count_type)
                if at + dtype.itemsize > len(self.data):
                    return None
                size = int(np.frombuffer(self.data, dtype, 1, at)[0])
                if size < 0 or size > len(self.data):
                    return None
                sizes[p.name] = size
                at += dtype.itemsize + size * np.dtype(p.type).itemsize
            else:
                at += np.dtype(p.type).itemsize
        return sizes if element.count * (at - self.at) <= len(self.data) - self.at else None

    def _mixed(self, element: _Element) -> Columns:
        """Rows of different lengths, one after the other."""
        import struct

        codes = {
            "i1": "b",
            "u1": "B",
            "i2": "h",
            "u2": "H",
            "i4": "i",
            "u4": "I",
            "f4": "f",
            "f8": "d",
            "i8": "q",
            "u8": "Q",
        }
        columns_by_name: dict[str, list] = {p.name: [] for p in element.properties}
        sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_type}
        steps = [
            (
                p,
                struct.Struct(self.order + codes[p.count_type or p.type]),
                np.dtype(p.type).itemsize,
                codes[p.type],
            )
            for p in element.properties
        ]
        data, at = self.data, self.at
        try:
            for _ in range(element.count):
                for p, scalar, width, code in steps:
                    value = scalar.unpack_from(data, at)[0]
                    at += scalar.size
                    if p.count_type:
                        if value < 0 or value * width > len(data) - at:
                            raise _short(element)
                        columns_by_name[p.name] += struct.unpack_from(
                            f"{self.order}{int(value)}{code}", data, at
                        )
                        sizes[p.name].append(int(value))
                        at += int(value) * width
                    else:
                        columns_by_name[p.name].append(value)
        except struct.error:
            raise _short(element) from None
        self.at = at
        return _columns(
            {p.name: np.array(columns_by_name[p.name], dtype=p.type) for p in element.properties}, sizes
        )


def _columns(values: dict[str, NDArray], sizes: dict[str, list[int]]) -> Columns:
    """Lists get their sizes beside them."""
    return {
        name: (column, np.array(sizes[name], dtype=np.int64)) if name in sizes else column
        for name, column in values.items()
    }


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _typed(column: NDArray, declared: _Property) -> NDArray:
    """Floats of the text in the declared type; floats stay as exact as the text."""
    return (
        column if declared.type[0] == "f" else typed(column, declared.type, f"'{excerpt(declared.name, 40)}'")
    )


def _raw(columns: dict[str, Columns]) -> RawMesh:
    vertex = dict(columns.get("vertex", {}))
    if vertex and any(isinstance(vertex.get(c, ()), tuple) for c in "xyz"):
        raise MeshFileError("the PLY vertices have no numbers x, y and z; check the file")
    if vertex:
        points = np.empty((len(vertex["x"]), 3))
        for k, name in enumerate("xyz"):
            points[:, k] = vertex.pop(name)
    else:
        points = np.zeros((0, 3))
    raw = RawMesh(points, vertex=_with_appearance(_scalars(vertex)), notes=_omissions(columns))
    face = dict(columns.get("face", {}))
    corners = next((face.pop(k) for k in ("vertex_indices", "vertex_index") if k in face), None)
    if corners is not None and not isinstance(corners, tuple):
        raise MeshFileError("'vertex_indices' of the PLY faces is not a list; correct the header")
    if corners is not None:
        raw.corners, raw.sizes = whole_numbers(np.asarray(corners[0]), "vertex index").ravel(), corners[1]
        raw.face = _with_appearance(_scalars(face))
        texture = face.get("texcoord")
        if isinstance(texture, tuple) and np.array_equal(texture[1], 2 * raw.sizes):
            raw.corner_uv = np.asarray(texture[0], dtype=np.float64).reshape(-1, 2)
        elif isinstance(texture, tuple) and texture[1].any():
            raw.notes.append("the list 'texcoord' has no two numbers for each corner: it is omitted")
    for members, _ in (v for v in columns.get("tristrips", {}).values() if isinstance(v, tuple)):
        raw.add_faces(_strips(whole_numbers(np.asarray(members), "vertex index").ravel()))
    edge = columns.get("edge", {})
    if {"vertex1", "vertex2"} <= edge.keys():
        ends = [edge[k] for k in ("vertex1", "vertex2")]
        if any(isinstance(end, tuple) for end in ends):
            raise MeshFileError("'vertex1' and 'vertex2' of the PLY edges are lists; correct the header")
        raw.lines = np.stack([whole_numbers(np.asarray(end), "vertex index") for end in ends], axis=1)
        raw.line = _scalars({k: v for k, v in edge.items() if k not in ("vertex1", "vertex2")})
    return raw


def _omissions(columns: dict[str, Columns]) -> list[str]:
    """Notes about elements and lists that no array can hold."""
    notes = []
    elements = [name for name in columns if name not in (*READ_LISTS, "tristrips")]
    lists = [
        f"{name} of {element}"
        for element, read in READ_LISTS.items()
        for name, values in columns.get(element, {}).items()
        if isinstance(values, tuple) and name not in read
    ]
    for what, names in (("elements", elements), ("lists", lists)):
        if names:
            notes.append(f"{what} of the PLY file omitted: {excerpt(', '.join(names), 80)}")
    return notes


def _scalars(columns: Columns) -> dict[str, NDArray]:
    """Scalar properties as arrays; `a_x`, `a_y`, `a_z` (or `a_0`, `a_1`, ...) become one array `a`."""
    arrays = {k: np.ascontiguousarray(v).astype(v.dtype.newbyteorder("=")) for k, v in columns.items()
              if not isinstance(v, tuple) and not k.startswith("\0")}  # fmt: skip
    for name in list(arrays):
        stem, _, last = name.rpartition("_")
        if not stem or last not in ("x", "0") or stem in arrays:
            continue
        components = [f"{stem}_{c}" for c in "xyz"] if last == "x" else _counted(stem, arrays)
        if len(components) > 1 and all(p in arrays for p in components):
            arrays[stem] = np.stack([arrays.pop(p) for p in components], axis=1)
    return arrays


def _with_appearance(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    """`red green blue (alpha)` of bytes as one array `color`; `s t` or `texture_u texture_v` as `uv`."""
    channels = [name for name in ("red", "green", "blue", "alpha") if name in arrays]
    if channels[:3] == ["red", "green", "blue"] and all(arrays[c].dtype == np.uint8 for c in channels):
        arrays[COLOR] = np.stack([arrays.pop(c) for c in channels], axis=1)
    for u, v in (("s", "t"), ("texture_u", "texture_v")):
        if u in arrays and v in arrays and UV not in arrays:
            arrays[UV] = np.stack([arrays.pop(u), arrays.pop(v)], axis=1)
    return arrays


def _counted(stem: str, arrays: dict[str, NDArray]) -> list[str]:
    names: list[str] = []
    while f"{stem}_{len(names)}" in arrays:
        names.append(f"{stem}_{len(names)}")
    return names


def _strips(strip: NDArray) -> NDArray:
    """(m, 3) triangles of strips that -1 ends; every second triangle is reversed."""
    if len(strip) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    number = np.arange(len(strip))
    last_end = np.maximum.accumulate(np.where(strip == -1, number, -1))[:-2]
    a, b, c = strip[:-2], strip[1:-1], strip[2:]
    odd = (number[:-2] - last_end - 1) % 2 == 1
    triangles = np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)
    return triangles[(a >= 0) & (b >= 0) & (c >= 0) & (a != b) & (b != c) & (c != a)]
