"""VTK XML: .vtu and .vtp; ascii, base64 and appended (base64 or raw) arrays, plain or zlib.

Our own reader: no third-party one here reads .vtp, and meshio refuses text arrays in field data and drops
damaged point data with a mere message.
"""

from __future__ import annotations

import base64
import binascii
import re
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.cells import LINE, POLYGON, STRIP, VERTEX, add_vtk_cells
from ddgcli.io.readers.inflate import Budget
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import numbers, typed, whole_numbers

TYPES = {
    "Float32": "f4", "Float64": "f8", "Int8": "i1", "Int16": "i2", "Int32": "i4", "Int64": "i8",
    "UInt8": "u1", "UInt16": "u2", "UInt32": "u4", "UInt64": "u8",
}  # fmt: skip
HEADER_TYPES = ("UInt32", "UInt64")
Buffer = TypeVar("Buffer", bytes, memoryview)
# in the order in which VTK numbers cells, which is not that of the file
POLYDATA = (("Verts", VERTEX), ("Lines", LINE), ("Polys", POLYGON), ("Strips", STRIP))


def read_vtk_xml(data: bytes) -> RawMesh:
    """Read a .vtu or .vtp file of one or more pieces."""
    xml, appended = _split_raw_appended(data)
    if b"<!ENTITY" in xml:
        raise MeshFileError("XML with entities is not a VTK file; check the file")
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise MeshFileError(
            f"not well-formed XML ({excerpt(error)}); the file is truncated or damaged"
        ) from None
    if root.tag != "VTKFile" or root.get("type") not in ("UnstructuredGrid", "PolyData"):
        raise MeshFileError(
            f"VTK XML of type {excerpt(root.get('type'), 40)}; only UnstructuredGrid and PolyData hold "
            "surfaces"
        )
    try:
        arrays = _Arrays(root, appended, Budget(len(data)))
        return _joined(
            [_piece(piece, arrays, root.get("type") == "PolyData") for piece in root.iter("Piece")]
        )
    except (ValueError, OverflowError, binascii.Error) as error:
        if isinstance(error, MeshFileError):
            raise
        raise MeshFileError(
            f"an array of the VTK file cannot be read ({excerpt(error)}); it is truncated or damaged"
        ) from None


def _split_raw_appended(data: bytes) -> tuple[bytes, bytes | None]:
    """The XML without its raw appended bytes, and those."""
    mark = re.search(
        rb"<AppendedData[^>]{0,400}?encoding\s{0,9}=\s{0,9}[\"']raw[\"'][^>]{0,400}>\s{0,99}_", data
    )
    if mark is None:
        return data, None
    end = data.rfind(b"</AppendedData>")
    if end < mark.end():
        raise MeshFileError("the appended data do not end; the file is truncated")
    return data[: mark.end()] + data[end:], data[mark.end() : end]


class _Arrays:
    """Decodes DataArray elements of one file."""

    def __init__(self, root: ElementTree.Element, appended: bytes | None, budget: Budget) -> None:
        self.budget = budget
        self.order: Any = ">" if root.get("byte_order") == "BigEndian" else "<"
        kind = root.get("header_type", "UInt32")
        if kind not in HEADER_TYPES:
            raise MeshFileError(
                f"header_type {excerpt(kind, 40)!r} is not one of {', '.join(HEADER_TYPES)}; correct it"
            )
        self.header = np.dtype(self.order + TYPES[kind])
        self.compressor = root.get("compressor")
        if self.compressor not in (None, "", "vtkZLibDataCompressor"):
            raise MeshFileError(
                f"VTK arrays packed by {excerpt(self.compressor, 40)}; export with zlib or none"
            )
        self.appended, self.encoded = memoryview(appended or b""), None
        element = root.find("AppendedData")
        if appended is None and element is not None:
            self.encoded = memoryview((element.text or "").strip().removeprefix("_").encode())

    def __call__(self, element: ElementTree.Element) -> NDArray:
        name, form = element.get("type", ""), element.get("format", "ascii")
        if name not in TYPES:
            raise MeshFileError(f"data type {excerpt(name, 40)!r} is not one of VTK's; correct it")
        kind = np.dtype(TYPES[name])
        if form == "ascii":
            values = typed(numbers((element.text or "").encode()), kind, "the value")
        else:
            values = np.frombuffer(self._bytes(element, form), kind.newbyteorder(self.order)).astype(kind)
        width = _count(element, "NumberOfComponents") or 1
        return values.reshape(-1, width) if width > 1 else values

    def _bytes(self, element: ElementTree.Element, form: str) -> bytes | memoryview:
        if form == "binary":
            return self._base64("".join((element.text or "").split()).encode())
        start = _count(element, "offset")
        if start is None:
            raise MeshFileError("an appended array states no offset; the file is damaged")
        if self.encoded is not None:
            return self._base64(self.encoded[start:])
        return self._raw(self.appended[start:])

    def _raw(self, data: memoryview) -> bytes | memoryview:
        size = self.header.itemsize
        if not self.compressor:
            length = int(np.frombuffer(data, self.header, 1)[0])
            self.budget.take(min(length, len(data)))
            return _whole(data[size : size + length], length)
        blocks, at = self._block_sizes(data)
        return self._unpacked(data[at:], blocks)

    def _unpacked(self, data: bytes | memoryview, blocks: list[int]) -> bytes:
        """Content of compressed blocks that lie one after the other."""
        decoded_blocks, at = [], 0
        for length in blocks:
            if length:
                decoded_blocks.append(
                    self.budget.inflated(_whole(memoryview(data)[at : at + length], length))
                )
            at += length
        return b"".join(decoded_blocks)

    def _block_sizes(self, data: bytes | memoryview) -> tuple[list[int], int]:
        """Compressed sizes of the blocks, and where the first begins."""
        n_blocks = int(np.frombuffer(data, self.header, 1)[0])
        if (3 + n_blocks) * self.header.itemsize > len(data):
            raise MeshFileError("a compressed array is truncated; the file is damaged")
        table = np.frombuffer(data, self.header, 3 + n_blocks)
        return [int(n) for n in table[3:]], (3 + n_blocks) * self.header.itemsize

    def _base64(self, text: bytes | memoryview) -> bytes:
        """Header and body are coded together when plain, apart when compressed."""
        size = self.header.itemsize
        if not self.compressor:
            length = int(np.frombuffer(_decoded(text, size), self.header, 1)[0])
            self.budget.take(min(length, len(text)))
            return _whole(_decoded(text, size + length)[size:], length)
        n_blocks = int(np.frombuffer(_decoded(text, size), self.header, 1)[0])
        head = (3 + n_blocks) * size
        blocks, _ = self._block_sizes(_decoded(text, head))
        body = _decoded(text[-(-head // 3) * 4 :], sum(blocks))
        return self._unpacked(body, blocks)


def _count(element: ElementTree.Element, name: str) -> int | None:
    """An attribute that is a whole number, not negative; None where it is missing."""
    text = element.get(name)
    if not text:
        return None
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise MeshFileError(f"{name}={excerpt(text, 20)!r} is not a count; correct it")
    return number


def _decoded(text: bytes | memoryview, length: int) -> bytes:
    """The first `length` bytes that base64 text codes."""
    chars = -(-length // 3) * 4
    if chars > len(text):
        raise MeshFileError("a base64 array is shorter than its header announces; the file is truncated")
    return base64.b64decode(text[:chars])[:length]


def _whole(data: Buffer, length: int) -> Buffer:
    if len(data) != length:
        raise MeshFileError("an array is shorter than its header announces; the file is truncated")
    return data


def _piece(piece: ElementTree.Element, arrays: _Arrays, polydata: bool) -> RawMesh:
    n_points, n_cells = _count(piece, "NumberOfPoints"), _count(piece, "NumberOfCells")
    element = piece.find("Points/DataArray")
    if n_points is None or (n_points and element is None):
        raise MeshFileError("a piece of the VTK file has no points, or no count of them; it is damaged")
    points = arrays(element).reshape(-1, 3) if n_points and element is not None else np.zeros((0, 3))
    if len(points) != n_points:
        raise MeshFileError(f"the file announces {n_points} points and holds {len(points)}; it is damaged")
    raw = RawMesh(
        np.asarray(points, dtype=np.float64), vertex=_named(piece.find("PointData"), arrays, n_points)
    )
    if polydata:
        types, connectivity, sizes = _polydata_cells(piece, arrays)
    else:
        cells = _lists(piece, "Cells", arrays, ("types", "connectivity", "offsets"))
        types, connectivity = cells["types"], cells["connectivity"]
        sizes = np.diff(cells["offsets"], prepend=0)
        if n_cells is not None and len(types) != n_cells:
            raise MeshFileError(f"the file announces {n_cells} cells and holds {len(types)}; it is damaged")
    add_vtk_cells(raw, types, connectivity, sizes, _named(piece.find("CellData"), arrays, len(types)))
    return raw


def _polydata_cells(piece: ElementTree.Element, arrays: _Arrays) -> tuple[NDArray, NDArray, NDArray]:
    types, connectivity, sizes = [], [], []
    for tag, kind in POLYDATA:
        if piece.find(f"{tag}/DataArray") is None:
            continue
        lists = _lists(piece, tag, arrays, ("connectivity", "offsets"))
        if len(lists["offsets"]):
            types.append(np.full(len(lists["offsets"]), kind))
            sizes.append(np.diff(lists["offsets"], prepend=0))
            connectivity.append(lists["connectivity"])
    if not types:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate(types), np.concatenate(connectivity), np.concatenate(sizes)


def _lists(
    piece: ElementTree.Element, tag: str, arrays: _Arrays, names: tuple[str, ...]
) -> dict[str, NDArray]:
    """The arrays of whole numbers that make up cells, by name."""
    elements = {a.get("Name"): a for a in piece.findall(f"{tag}/DataArray")}
    missing = [name for name in names if name not in elements]
    if missing:
        raise MeshFileError(f"the {tag} of the VTK file have no array '{missing[0]}'; it is damaged")
    return {name: whole_numbers(arrays(elements[name]).ravel(), f"entry of '{name}'") for name in names}


def _named(element: ElementTree.Element | None, arrays: _Arrays, length: int) -> dict[str, NDArray]:
    elements: dict[str, NDArray] = {}
    for child in element if element is not None else ():
        if child.tag == "DataArray" and child.get("type") in TYPES:
            value = arrays(child)
            if len(value) != length:
                raise MeshFileError(
                    f"array {excerpt(child.get('Name'), 40)} has {len(value)} entries, not {length}; "
                    "it is damaged"
                )
            elements[child.get("Name") or f"array_{len(elements)}"] = value
    return elements


def _joined(pieces: list[RawMesh]) -> RawMesh:
    if not pieces:
        raise MeshFileError("the VTK file holds no piece; it is empty or cut")
    if len(pieces) == 1:
        return pieces[0]
    raw, shift = RawMesh(np.concatenate([p.points for p in pieces])), 0
    for piece in pieces:
        raw.corners = np.concatenate([raw.corners, piece.corners + shift])
        raw.sizes = np.concatenate([raw.sizes, piece.sizes])
        raw.tetrahedra = np.concatenate([raw.tetrahedra, piece.tetrahedra + shift])
        raw.lines = np.concatenate([raw.lines, piece.lines + shift])
        shift += len(piece.points)
    for place in ("vertex", "face", "cell", "line"):
        common = set.intersection(*(set(getattr(p, place)) for p in pieces))
        setattr(
            raw, place, {n: np.concatenate([getattr(p, place)[n] for p in pieces]) for n in sorted(common)}
        )
    raw.notes.append(f"{len(pieces)} pieces put into one mesh; vertices are not merged between them")
    return raw
