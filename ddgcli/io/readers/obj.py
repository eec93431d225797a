"""Wavefront OBJ: vertices with colours, polygons with texture coordinates, and `l` polylines.

Materials and normals are passed over.

Our own reader, because both third-party ones change the mesh: trimesh splits vertices at texture seams or
reorders them, meshio refuses mixed polygons and relative indices.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.appearance import COLOR, colors_of_fractions
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import rows, whole_numbers


class _Element:
    """Lines of one kind, their numbers, and how many vertices and texture vertices came before each."""

    def __init__(self) -> None:
        self.lines: list[bytes] = []
        self.number: list[int] = []
        self.before: list[int] = []
        self.textures_before: list[int] = []


def read_obj(data: bytes) -> RawMesh:
    """Read an OBJ file."""
    data = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\x00 \n")
    if b"\0" in data[:4096]:
        raise MeshFileError("not an OBJ file: binary data; check the extension")
    data = data.replace(b"\t", b" ")
    if b"\\" in data:
        data = re.sub(rb"\\\r?\n", b" ", data)
    vertices, faces, paths, textures = _Element(), _Element(), _Element(), _Element()
    known = {b"v ": vertices, b"f ": faces, b"l ": paths, b"vt": textures}
    n_vertices = n_textures = 0
    for number, line in enumerate(data.splitlines()):
        element = known.get(line[:2])
        if element is None:
            line = line.lstrip()
            element = known.get(line[:2] if len(line) > 1 else line + b" ")
            if element is None:
                continue
        element.lines.append(line[2:])
        element.number.append(number)
        element.before.append(n_vertices)
        element.textures_before.append(n_textures)
        n_vertices += element is vertices
        n_textures += element is textures
    points, colors = _points(vertices)
    if not len(points) and not faces.lines and _has_content(data):
        raise MeshFileError("not an OBJ file: no vertices; check the extension")
    corners, sizes = _indices(faces, len(points), "face")
    along, path_sizes = _indices(paths, len(points), "polyline")
    raw = RawMesh(points, corners, sizes, lines=_segments(along, path_sizes))
    if colors is not None:
        raw.vertex[COLOR] = colors_of_fractions(colors)
    if textures.lines and len(sizes):
        try:
            raw.corner_uv = _corner_uv(faces, textures, sizes)
        except MeshFileError as error:
            raw.notes.append(f"texture coordinates omitted: {error}")
    return raw


def _has_content(data: bytes) -> bool:
    """Whether a line is neither empty nor a comment."""
    return any(not line.startswith(b"#") for line in map(bytes.lstrip, data.splitlines()) if line)


def _without_comments(element: _Element) -> list[bytes]:
    if any(b"#" in line for line in element.lines):
        return [line.partition(b"#")[0] for line in element.lines]
    return element.lines


def _points(vertices: _Element) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """(n, 3) positions, and the colours that follow them if every vertex has one."""
    lines = _without_comments(vertices)
    values, count = rows(lines, vertices.number, "vertex")
    short = np.flatnonzero(count < 3)
    if len(short):
        raise MeshFileError(f"line {vertices.number[short[0]] + 1}: a vertex needs three numbers")
    if len(count) == 0:
        return np.zeros((0, 3)), None
    first = np.cumsum(count) - count
    colors = values.reshape(-1, 6)[:, 3:] if (count == 6).all() else None
    return values[first[:, None] + np.arange(3)], colors


def _corner_uv(faces: _Element, textures: _Element, sizes: NDArray) -> NDArray | None:
    """(c, 2) texture coordinates of the corners, NaN where a corner names none; None if no corner does."""
    text = b"\n".join(_without_comments(faces))
    if b"/" not in text:
        return None
    text = re.sub(rb"(?<![^ \n])([^ /\n\r]+)(?=[ \n\r]|$|//)", rb"\1/0", text)  # corners without a number
    text = re.sub(rb"(?<![^ \n])[^ /\n\r]+/(-?\d*)[^ \n\r]*", rb"\1", text)
    values, counts = rows(text.split(b"\n"), faces.number, "face")
    table, width = rows(_without_comments(textures), textures.number, "texture vertex")
    if not np.array_equal(counts, sizes) or width.min() < 2:
        raise MeshFileError("a corner or a texture vertex lacks a number")
    index, n = whole_numbers(values, "texture vertex"), len(width)
    before = np.repeat(np.array(faces.textures_before, dtype=np.int64), sizes)
    number = np.where(index > 0, index - 1, np.where(index < 0, before + index, n))
    if ((number < 0) | (number > n)).any() or (index > n).any():
        raise MeshFileError(f"a corner names a texture vertex outside 1..{n}")
    first = np.cumsum(width) - width
    uv = np.vstack([table[first[:, None] + np.arange(2)], [[np.nan, np.nan]]])
    return uv[number]


def _indices(element: _Element, n_points: int, what: str) -> tuple[NDArray, NDArray]:
    """0-based vertices and size of each polygon or polyline."""
    text = re.sub(rb"/[^ \n]*", b"", b"\n".join(_without_comments(element)))
    lines = text.split(b"\n") if element.lines else []
    values, sizes = rows(lines, element.number, what)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(
            ~((np.abs(values) <= max(n_points, 1)) & (values != 0) & (values == np.rint(values)))
        )
    if len(bad):
        raise MeshFileError(
            f"line {element.number[owner[bad[0]]] + 1}: vertex {values[bad[0]]:.17g} of a {what} is outside "
            f"1..{n_points}; correct the index"
        )
    index = whole_numbers(values, "vertex number")
    before = np.array(element.before, dtype=np.int64)[owner]
    zero_based = np.where(index > 0, index - 1, before + index)
    low = np.flatnonzero(zero_based < 0)
    if len(low):
        raise MeshFileError(
            f"line {element.number[owner[low[0]]] + 1}: relative vertex {index[low[0]]} of a {what} reaches "
            "before the first vertex; correct the index"
        )
    return zero_based, sizes


def _segments(along: NDArray, sizes: NDArray) -> NDArray:
    """(l, 2) segments of polylines laid one after the other."""
    last = np.zeros(len(along), dtype=bool)
    last[np.cumsum(sizes)[sizes > 0] - 1] = True
    keep = np.flatnonzero(~last)
    return np.stack([along[keep], along[np.minimum(keep + 1, max(len(along) - 1, 0))]], axis=1).astype(
        np.int64
    )
