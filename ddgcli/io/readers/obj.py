"""Wavefront OBJ: vertices, polygons and `l` polylines; materials, textures and normals are passed over.

Our own reader, because both third-party ones change the mesh: trimesh splits vertices at texture seams or
reorders them, meshio refuses mixed polygons and relative indices.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import rows, whole_numbers


class _Element:
    """Lines of one kind, their numbers, and how many vertices came before each (for relative indices)."""

    def __init__(self) -> None:
        self.lines: list[bytes] = []
        self.number: list[int] = []
        self.before: list[int] = []


def read_obj(data: bytes) -> RawMesh:
    """Read an OBJ file."""
    data = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\x00 \n")
    if b"\0" in data[:4096]:
        raise MeshFileError("not an OBJ file: binary data; check the extension")
    data = data.replace(b"\t", b" ")
    if b"\\" in data:
        data = re.sub(rb"\\\r?\n", b" ", data)
    vertices, faces, paths = _Element(), _Element(), _Element()
    known = {b"v ": vertices, b"f ": faces, b"l ": paths}
    n_vertices = 0
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
        n_vertices += element is vertices
    points = _points(vertices)
    if not len(points) and not faces.lines and re.search(rb"^\s*[^\s#]", data, re.M):
        raise MeshFileError("not an OBJ file: no vertices; check the extension")
    corners, sizes = _indices(faces, len(points), "face")
    along, path_sizes = _indices(paths, len(points), "polyline")
    return RawMesh(points, corners, sizes, lines=_segments(along, path_sizes))


def _without_comments(element: _Element) -> list[bytes]:
    if any(b"#" in line for line in element.lines):
        return [line.partition(b"#")[0] for line in element.lines]
    return element.lines


def _points(vertices: _Element) -> NDArray[np.float64]:
    lines = _without_comments(vertices)
    values, count = rows(lines, vertices.number, "vertex")
    short = np.flatnonzero(count < 3)
    if len(short):
        raise MeshFileError(f"line {vertices.number[short[0]] + 1}: a vertex needs three numbers")
    if len(count) == 0:
        return np.zeros((0, 3))
    first = np.cumsum(count) - count
    return values[first[:, None] + np.arange(3)]


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
