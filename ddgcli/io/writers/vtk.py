"""Bytes of .vtu, .vtp, .vtk and .xdmf files. Equal content gives equal bytes.

Arrays are base64 without compression: the fastest form that VTK, meshio and ElementTree all read.
"""

from __future__ import annotations

import base64
import io
import string
from dataclasses import replace
from urllib.parse import quote
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from ddgcli.io.writers.cell_data import CellData, short_integers, surface_only, two_dimensional
from ddgcli.io.writers.text import paths_of

VTK_TYPE = {"faces": 5, "tetrahedra": 10, "lines": 3}
NAMES = {
    "f4": "Float32", "f8": "Float64", "i1": "Int8", "i2": "Int16", "i4": "Int32", "i8": "Int64",
    "u1": "UInt8", "u2": "UInt16", "u4": "UInt32", "u8": "UInt64",
}  # fmt: skip
LEGACY_NAMES = {
    "f4": "float", "f8": "double", "i1": "char", "i2": "short", "i4": "int",
    "u1": "unsigned_char", "u2": "unsigned_short", "u4": "unsigned_int",
}  # fmt: skip
# other bytes of names are %XX in legacy files, as VTK's own writer and readers have it
PLAIN_IN_NAMES = string.punctuation.replace("%", "").replace('"', "")
XDMF_KINDS = {"f": "Float", "i": "Int", "u": "UInt"}


def vtu_bytes(content: CellData) -> bytes:
    """VTK XML UnstructuredGrid."""
    cells = [
        "<Cells>",
        *_cells(content.cells),
        _array("types", np.full(len(content.cells), VTK_TYPE[content.kind], "u1")),
        "</Cells>",
    ]
    return _xml(content, "UnstructuredGrid", f'NumberOfCells="{len(content.cells)}"', cells)


def vtp_bytes(content: CellData) -> bytes:
    """VTK XML PolyData; curves are one polyline a path, with `path_id` on the cells too.

    Arrays on segments that vary along a path keep one cell a segment.
    """
    if content.kind == "tetrahedra":
        content = surface_only(content, ".vtp")
    if content.kind == "lines":
        return _polyline_bytes(content)
    counts = _counts(polys=len(content.cells))
    return _xml(content, "PolyData", counts, ["<Polys>", *_cells(content.cells), "</Polys>"])


def _polyline_bytes(content: CellData) -> bytes:
    paths = paths_of(content.cells)
    first = np.cumsum([0, *(len(path) - 1 for path in paths)])[:-1]  # segment
    inside = np.setdiff1d(np.arange(1, len(content.cells)), first)
    if any((value[inside] != value[inside - 1]).any() for value in content.cell.values()):
        counts = _counts(lines=len(content.cells))
        return _xml(content, "PolyData", counts, ["<Lines>", *_cells(content.cells), "</Lines>"])
    heads = np.array([path[0] for path in paths], dtype=np.int64)
    number = content.vertex["path_id"][heads] if "path_id" in content.vertex else np.arange(len(paths))
    cell = {"path_id": number, **{name: value[first] for name, value in content.cell.items()}}
    corners = np.concatenate(paths) if paths else np.zeros(0, dtype=np.int64)
    ends = np.cumsum([len(path) for path in paths], dtype=np.int64)
    lines = ["<Lines>", _array("connectivity", corners), _array("offsets", ends), "</Lines>"]
    return _xml(replace(content, cell=cell), "PolyData", _counts(lines=len(paths)), lines)


def _counts(lines: int = 0, polys: int = 0) -> str:
    return f'NumberOfVerts="0" NumberOfLines="{lines}" NumberOfStrips="0" NumberOfPolys="{polys}"'


def _xml(content: CellData, kind: str, counts: str, cells: list[str]) -> bytes:
    lines = [
        '<?xml version="1.0"?>',
        f"<?ddgcli {_instruction(content)}?>",
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f"<{kind}>",
        f'<Piece NumberOfPoints="{len(content.points)}" {counts}>',
        "<Points>", _array("Points", content.points), "</Points>",
        *cells,
        "<PointData>", *(_array(n, v) for n, v in content.vertex.items()), "</PointData>",
        "<CellData>", *(_array(n, v) for n, v in content.cell.items()), "</CellData>",
        "</Piece>", f"</{kind}>", "</VTKFile>", "",
    ]  # fmt: skip
    return "\n".join(lines).encode()


def _instruction(content: CellData) -> str:
    """Provenance as an XML processing instruction: readers pass it over, also those without text arrays."""
    return content.provenance.replace("?>", "?\\u003e")


def _cells(cells: NDArray) -> list[str]:
    m, k = cells.shape
    return [_array("connectivity", cells.ravel()), _array("offsets", np.arange(1, m + 1, dtype=np.int64) * k)]


def _array(name: str, value: NDArray) -> str:
    value = two_dimensional(value)
    code = value.dtype.str[1:]
    data = value.astype(value.dtype.newbyteorder("<"), copy=False).tobytes()
    text = base64.b64encode(np.uint64(len(data)).astype("<u8").tobytes() + data).decode()
    width = f' NumberOfComponents="{value.shape[1]}"' if value.ndim == 2 else ""
    head = f'<DataArray type="{NAMES[code]}" Name={quoteattr(name)}{width} format="binary">'
    return f"{head}\n{text}\n</DataArray>"


def vtk_bytes(content: CellData) -> bytes:
    """Legacy VTK 3.0, binary, UNSTRUCTURED_GRID; the title line (of 255 letters) holds the provenance."""
    out = io.BytesIO()
    title = f"ddgcli {content.provenance}".replace("\n", " ")[:255]
    out.write(f"# vtk DataFile Version 3.0\n{title}\nBINARY\nDATASET UNSTRUCTURED_GRID\n".encode())
    _legacy(out, f"POINTS {len(content.points)} double", content.points)
    m, k = content.cells.shape
    table = np.concatenate([np.full((m, 1), k), content.cells], axis=1).astype(np.int32)
    _legacy(out, f"CELLS {m} {table.size}", table)
    _legacy(out, f"CELL_TYPES {m}", np.full(m, VTK_TYPE[content.kind], dtype=np.int32))
    for tag, length, arrays in (
        ("POINT_DATA", len(content.points), content.vertex),
        ("CELL_DATA", m, content.cell),
    ):
        if arrays:
            out.write(f"{tag} {length}\nFIELD FieldData {len(arrays)}\n".encode())
        for name, value in arrays.items():
            value = short_integers(two_dimensional(value), name, ".vtk")
            width = value.shape[1] if value.ndim == 2 else 1
            head = f"{quote(name, PLAIN_IN_NAMES)} {width} {length} {LEGACY_NAMES[value.dtype.str[1:]]}"
            _legacy(out, head, value)
    return out.getvalue()


def _legacy(out: io.BytesIO, head: str, value: NDArray) -> None:
    out.write(head.encode() + b"\n" + value.astype(value.dtype.newbyteorder(">")).tobytes() + b"\n")


def xdmf_bytes(content: CellData) -> bytes:
    """XDMF 3 with its numbers inside, so that one file is the whole output."""
    m, k = content.cells.shape
    topology = {"faces": "Triangle", "tetrahedra": "Tetrahedron", "lines": "Polyline"}[content.kind]
    nodes = ' NodesPerElement="2"' if content.kind == "lines" else ""
    elements = [
        '<?xml version="1.0"?>',
        f"<?ddgcli {_instruction(content)}?>",
        '<Xdmf Version="3.0"><Domain><Grid Name="mesh" GridType="Uniform">',
        f'<Geometry GeometryType="XYZ">{_item(content.points)}</Geometry>',
        f'<Topology TopologyType="{topology}" NumberOfElements="{m}"{nodes}>'
        f"{_item(content.cells)}</Topology>",
    ]
    for center, arrays in (("Node", content.vertex), ("Cell", content.cell)):
        for name, value in arrays.items():
            value = two_dimensional(value)
            kind = {1: "Scalar", 3: "Vector", 9: "Tensor"}.get(
                value.shape[1] if value.ndim == 2 else 1, "Matrix"
            )
            head = f'<Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="{center}">'
            elements.append(f"{head}{_item(value)}</Attribute>")
    return "\n".join([*elements, "</Grid></Domain></Xdmf>", ""]).encode()


def _item(value: NDArray) -> str:
    if value.dtype.itemsize < 4:  # XDMF readers disagree about short integers
        value = value.astype(np.int32)
    if value.dtype == np.uint64 and value.max(initial=0) < 2**63:  # VTK has no UInt of 8 bytes
        value = value.astype(np.int64)
    kind, precision = XDMF_KINDS[value.dtype.kind], value.dtype.itemsize
    dims = " ".join(map(str, value.shape))
    row = (" ".join(["%r"] * (value.shape[1] if value.ndim == 2 else 1)) + "\n") * len(value)
    text = escape(row % tuple(value.ravel().tolist()))
    head = f'<DataItem DataType="{kind}" Dimensions="{dims}" Format="XML" Precision="{precision}">'
    return f"{head}\n{text}</DataItem>"
