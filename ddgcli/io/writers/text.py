"""Bytes of .ply, .obj, .off and .stl files. Equal content gives equal bytes."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from ddgcli.io.appearance import COLOR, CORNER_UV, NAMES, UV, color, corner_uv, vertex_uv
from ddgcli.io.writers.cell_data import (
    CellData,
    columns_of,
    free_name,
    short_integers,
    surface_only,
    two_dimensional,
    warn_of_lost_arrays,
)
from ddgcli.mesh.vectors import cross, dot, ratio

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
    """Binary little-endian PLY; a vector array `a` becomes the properties `a_x`, `a_y`, `a_z`.

    `color` becomes `red`, `green`, `blue`, `uv` becomes `s`, `t`, and `corner_uv` the list `texcoord` of
    faces, as other programs have them.
    """
    if data.kind == "tetrahedra":
        data = surface_only(data, ".ply")
    vertices = [("x", data.points[:, 0]), ("y", data.points[:, 1]), ("z", data.points[:, 2])]
    vertices += _columns(data.vertex, {"x", "y", "z"})
    header = ["ply", "format binary_little_endian 1.0", f"comment ddgcli {data.provenance}"]
    header += [f"element vertex {len(data.points)}", *_properties(vertices)]
    index = "<i4"
    if data.kind == "faces":
        texture = corner_uv(data.cell)
        plain = {name: value for name, value in data.cell.items() if texture is None or name != CORNER_UV}
        columns = _columns(plain, {"vertex_indices", "vertex_index", "texcoord"})
        header += [
            f"element face {len(data.cells)}",
            "property list uchar int vertex_indices",
            *([] if texture is None else ["property list uchar float texcoord"]),
            *_properties(columns),
        ]
        fields: list = [("list count", "u1"), ("list members", index, (3,))]  # no property has a space
        if texture is not None:
            fields += [("texture count", "u1"), ("texture members", "<f4", (6,))]
        table = np.zeros(len(data.cells), dtype=fields + [(n, v.dtype.newbyteorder("<")) for n, v in columns])
        table["list count"], table["list members"] = 3, data.cells
        if texture is not None:
            table["texture count"], table["texture members"] = 6, texture.reshape(-1, 6)
    else:
        columns = [("vertex1", data.cells[:, 0].astype("<i4")), ("vertex2", data.cells[:, 1].astype("<i4"))]
        columns += _columns(data.cell, {"vertex1", "vertex2"})
        header += [f"element edge {len(data.cells)}", *_properties(columns)]
        table = np.zeros(len(data.cells), dtype=[(n, v.dtype.newbyteorder("<")) for n, v in columns])
    for name, value in columns:
        table[name] = value
    return "\n".join([*header, "end_header\n"]).encode() + _table(vertices).tobytes() + table.tobytes()


def _table(columns: list[tuple[str, NDArray]]) -> NDArray:
    table = np.zeros(len(columns[0][1]), dtype=[(n, v.dtype.newbyteorder("<")) for n, v in columns])
    for name, value in columns:
        table[name] = value
    return table


def _properties(columns: list[tuple[str, NDArray]]) -> list[str]:
    return [f"property {PLY_TYPES[value.dtype.str[1:]]} {name}" for name, value in columns]


def _columns(arrays: dict[str, NDArray], used_names: set[str]) -> list[tuple[str, NDArray]]:
    """Scalar properties of arrays, in types that PLY has; a name of `used_names` gets a number."""
    columns = []
    for name, value in arrays.items():
        flat = short_integers(two_dimensional(value), name, ".ply")
        standard = _standard_names(arrays, name)
        if standard and not used_names & set(standard):
            used_names |= set(standard)
            columns += [(end, flat[:, k]) for k, end in enumerate(standard)]
            continue
        columns += [
            (free_name(label, used_names, ".ply", "_".join(label.split())), column)
            for label, column in columns_of(name, flat)
        ]
    return columns


def _standard_names(arrays: dict[str, NDArray], name: str) -> tuple[str, ...]:
    """Properties by which other programs recognise colours and texture coordinates; none for other arrays."""
    if name == COLOR and (colors := color(arrays)) is not None:
        return ("red", "green", "blue", "alpha")[: colors.shape[1]]
    return ("s", "t") if name == UV and vertex_uv(arrays) is not None else ()


def obj_bytes(data: CellData) -> bytes:
    """Wavefront OBJ; faces as `f`, curves as `l`, coordinates in the shortest form that reads back equal.

    Colours follow the positions, as numbers from 0 to 1; texture coordinates are `vt` lines.
    """
    if data.kind == "tetrahedra":
        data = surface_only(data, ".obj")
    warn_of_lost_arrays(data, ".obj", writable_names=NAMES)
    colors = color(data.vertex)
    lines = [f"# ddgcli {data.provenance}\n"]
    if colors is None:
        lines.append(_rows("v %r %r %r\n", data.points))
    else:
        lines.append(_rows("v %r %r %r %.6g %.6g %.6g\n", np.hstack([data.points, colors[:, :3] / 255.0])))
    if data.kind == "faces":
        lines += _textured_faces(data)
    else:
        lines += [f"l {' '.join(map(str, path + 1))}\n" for path in paths_of(data.cells)]
    return "".join(lines).encode()


def _textured_faces(data: CellData) -> list[str]:
    """`vt` and `f` lines; corners without texture coordinates (NaN) have a vertex only."""
    uv, seams = vertex_uv(data.vertex), corner_uv(data.cell)
    if uv is None and seams is None:
        return [_rows("f %d %d %d\n", data.cells + 1)]
    corner = (uv[data.cells] if uv is not None else seams).reshape(-1, 2)  # type: ignore[union-attr]
    if uv is not None and not np.isnan(uv).any():
        table, number = uv, data.cells.ravel()
    else:
        table, number = np.unique(corner, axis=0, return_inverse=True)
    pairs = np.column_stack([data.cells.ravel() + 1, np.ravel(number) + 1]).reshape(-1, 6)
    bare = np.isnan(corner).any(axis=1).reshape(-1, 3).any(axis=1)
    faces = np.full(len(pairs), "", dtype=object)
    faces[~bare] = _rows("f %d/%d %d/%d %d/%d\n", pairs[~bare]).splitlines(keepends=True)
    faces[bare] = _rows("f %d %d %d\n", data.cells[bare] + 1).splitlines(keepends=True)
    return [_rows("vt %r %r\n", np.nan_to_num(table)), *faces]


def paths_of(segments: NDArray) -> list[NDArray]:
    """Polylines of segments that follow one another in the list.

    Parameters
    ----------
    segments : (l, 2) ndarray of int64

    Returns
    -------
    list of (k,) ndarray of int64
        Vertices of each polyline; a closed one ends with its first vertex.
    """
    if len(segments) == 0:
        return []
    breaks = np.flatnonzero(segments[1:, 0] != segments[:-1, 1]) + 1
    return [np.append(run[:, 0], run[-1, 1]) for run in np.split(segments, breaks)]


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
    points = np.ascontiguousarray(data.points.T)
    corners = [np.take(points, corner, axis=1) for corner in np.ascontiguousarray(data.cells.T)]
    normal = cross(corners[1] - corners[0], corners[2] - corners[0])
    normal = ratio(normal, np.sqrt(dot(normal, normal)))
    table = np.zeros(len(data.cells), dtype=[("coordinates", "<f4", 12), ("attribute", "<u2")])
    with np.errstate(over="ignore"):
        # column by column: rows of three cost several times as much
        for column, values in zip(table["coordinates"].T, itertools.chain(normal, *corners), strict=True):
            column[:] = values
    sha = str(data.metadata.get("input_sha256", ""))[:16]
    head = f"ddgcli {data.metadata.get('version', '')} input sha256 {sha}".encode()
    return head[:80].ljust(80, b"\0") + np.uint32(len(table)).astype("<u4").tobytes() + table.tobytes()
