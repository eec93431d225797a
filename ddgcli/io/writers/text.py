"""Bytes of .ply, .obj, .off and .stl files. Equal content gives equal bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.io.writers.cell_data import (
    CellData,
    free_name,
    short_integers,
    surface_only,
    two_dimensional,
    warn_of_lost_arrays,
)

PLY_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


def ply_bytes(data: CellData) -> bytes:
    """Binary little-endian PLY; a vector array `a` becomes the properties `a_x`, `a_y`, `a_z`."""
    if data.kind == "tetrahedra":
        data = surface_only(data, ".ply")
    vertices = [("x", data.points[:, 0]), ("y", data.points[:, 1]), ("z", data.points[:, 2])]
    vertices += _columns(data.vertex, {"x", "y", "z"})
    header = ["ply", "format binary_little_endian 1.0", f"comment ddgcli {data.provenance}"]
    header += [f"element vertex {len(data.points)}", *_properties(vertices)]
    index = "<i4"
    if data.kind == "faces":
        columns = _columns(data.cell, {"vertex_indices", "vertex_index"})
        header += [
            f"element face {len(data.cells)}",
            "property list uchar int vertex_indices",
            *_properties(columns),
        ]
        fields: list = [("list count", "u1"), ("list members", index, (3,))]  # no property has a space
        table = np.zeros(len(data.cells), dtype=fields + [(n, v.dtype.newbyteorder("<")) for n, v in columns])
        table["list count"], table["list members"] = 3, data.cells
    else:
        columns = [("vertex1", data.cells[:, 0].astype("<i4")), ("vertex2", data.cells[:, 1].astype("<i4"))]
        columns += _columns(data.cell, {"vertex1", "vertex2"})
        header += [f"element edge {len(data.cells)}", *_properties(columns)]
        table = np.zeros(len(data.cells), dtype=[(n, v.dtype.newbyteorder("<")) for n, v in columns])
    for name, value in columns:
        table[name] = value
    return "\n".join([*header, "end_header\n"]).encode("ascii") + _table(vertices).tobytes() + table.tobytes()


def _table(columns: list[tuple[str, NDArray]]) -> NDArray:
    table = np.zeros(len(columns[0][1]), dtype=[(n, v.dtype.newbyteorder("<")) for n, v in columns])
    for name, value in columns:
        table[name] = value
    return table


def _properties(columns: list[tuple[str, NDArray]]) -> list[str]:
    return [f"property {PLY_TYPES[value.dtype.str[1:]]} {name}" for name, value in columns]


def _columns(arrays: dict[str, NDArray], used: set[str]) -> list[tuple[str, NDArray]]:
    """Scalar properties of arrays, in types that PLY has; names that are `used` get a number."""
    columns = []
    for name, value in arrays.items():
        flat = short_integers(two_dimensional(value))
        name = "_".join(name.split())
        if flat.ndim == 1:
            columns.append((free_name(name, used, ".ply"), flat))
            continue
        ends = "xyz" if flat.shape[1] == 3 else [str(k) for k in range(flat.shape[1])]
        columns += [(free_name(f"{name}_{end}", used, ".ply"), flat[:, k]) for k, end in enumerate(ends)]
    return columns


def obj_bytes(data: CellData) -> bytes:
    """Wavefront OBJ; faces as `f`, curves as `l`, coordinates in the shortest form that reads back equal."""
    if data.kind == "tetrahedra":
        data = surface_only(data, ".obj")
    warn_of_lost_arrays(data, ".obj")
    lines = [f"# ddgcli {data.provenance}\n", _rows("v %r %r %r\n", data.points)]
    if data.kind == "faces":
        lines.append(_rows("f %d %d %d\n", data.cells + 1))
    else:
        lines += [f"l {' '.join(map(str, path + 1))}\n" for path in _paths(data.cells)]
    return "".join(lines).encode()


def _paths(segments: NDArray) -> list[NDArray]:
    """Segments that follow one another joined to polylines."""
    if len(segments) == 0:
        return []
    breaks = np.flatnonzero(segments[1:, 0] != segments[:-1, 1]) + 1
    return [np.append(part[:, 0], part[-1, 1]) for part in np.split(segments, breaks)]


def _rows(form: str, table: NDArray) -> str:
    return (form * len(table)) % tuple(table.ravel().tolist())


def off_bytes(data: CellData) -> bytes:
    """Geomview OFF, text."""
    data = surface_only(data, ".off")
    warn_of_lost_arrays(data, ".off")
    head = f"OFF\n# ddgcli {data.provenance}\n{len(data.points)} {len(data.cells)} 0\n"
    return (head + _rows("%r %r %r\n", data.points) + _rows("3 %d %d %d\n", data.cells)).encode()


def stl_bytes(data: CellData) -> bytes:
    """Binary STL: float32 corners, no shared vertices; the header names program and version."""
    data = surface_only(data, ".stl")
    warn_of_lost_arrays(data, ".stl")
    corner = data.points[data.cells]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    table = np.zeros(
        len(corner), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")]
    )
    with np.errstate(over="ignore"):
        table["corner"] = corner
        table["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    sha = str(data.metadata.get("input_sha256", ""))[:16]
    head = f"ddgcli {data.metadata.get('version', '')} input sha256 {sha}".encode()
    return head[:80].ljust(80, b"\0") + np.uint32(len(corner)).astype("<u4").tobytes() + table.tobytes()
