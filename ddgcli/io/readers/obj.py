"""Wavefront OBJ: vertices with colours, polygons with texture coordinates, and `l` polylines.

Materials, normals, groups and objects are passed over.

Our own reader, because both third-party ones change the mesh: trimesh splits vertices at texture seams or
reorders them, meshio refuses mixed polygons and relative indices.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.appearance import COLOR, colors_of_fractions
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import TextLines, integers, leading, rows_of, whole_numbers, word_starts


@dataclass(frozen=True, eq=False)
class _Element:
    """Lines of one kind without keyword and comments, and which lines of the file they are."""

    lines: TextLines
    place: NDArray[np.int64]

    def count_before(self, other: _Element) -> NDArray[np.int64]:
        """(k,) number of elements in lines before each line of another kind."""
        return np.searchsorted(self.place, other.place)


def read_obj(data: bytes) -> RawMesh:
    """Read an OBJ file."""
    data = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\x00 \n")
    if b"\0" in data[:4096]:
        raise MeshFileError("not an OBJ file: binary data; check the extension")
    data = data.replace(b"\t", b" ")
    if b"\\" in data:
        data = re.sub(rb"#[^\r\n]*", b"", data)  # whose last backslash continues no line
        data = re.sub(rb"\\\r?\n", b" ", data)
    vertices, faces, paths, textures = _elements(TextLines.of(data))
    points, colors = _points(vertices)
    if not len(points) and _has_content(data):
        raise MeshFileError("not an OBJ file: no vertices; check the extension")
    corners, sizes = _indices(faces, vertices, "face")
    along, path_sizes = _indices(paths, vertices, "polyline")
    raw = RawMesh(points, corners, sizes, lines=_segments(along, path_sizes))
    if colors is not None:
        raw.vertex[COLOR] = colors_of_fractions(colors)
    if len(textures.place) and len(sizes):
        try:
            raw.corner_uv = _corner_uv(faces, textures, sizes)
        except MeshFileError as error:
            raw.notes.append(f"texture coordinates omitted: {error}")
    return raw


def _elements(lines: TextLines) -> list[_Element]:
    """Lines of vertices, faces, polylines and texture vertices."""
    if lines.text.startswith(b" ") or b"\n " in lines.text:
        lines = lines.without(rb"(?m)^ +")
    text = lines.characters
    first, second = text[lines.begin[:-1]], text[np.minimum(lines.begin[:-1] + 1, len(text) - 1)]
    ends = (second == ord(" ")) | (second == ord("\n"))
    elements = []
    for keyword, follows in (("v", ends), ("f", ends), ("l", ends), ("v", second == ord("t"))):
        place = np.flatnonzero((first == ord(keyword)) & follows)
        element_lines = lines.select(place)
        if b"#" in element_lines.text:
            element_lines = element_lines.without(rb"#[^\n]*")
        bare = np.frombuffer(bytearray(element_lines.text), dtype=np.uint8)
        bare[element_lines.begin[:-1]] = ord(" ")
        if keyword == "v" and len(place) and follows is not ends:
            bare[element_lines.begin[:-1] + 1] = ord(" ")
        elements.append(_Element(replace(element_lines, text=bare.tobytes()), place))
    return elements


def _has_content(data: bytes) -> bool:
    """Whether a line is neither empty nor a comment."""
    return any(not line.startswith(b"#") for line in map(bytes.lstrip, data.splitlines()) if line)


def _points(vertices: _Element) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """(n, 3) positions, and the colours that follow them if every vertex has one."""
    values, count = rows_of(vertices.lines, "vertex")
    short = np.flatnonzero(count < 3)
    if len(short):
        raise MeshFileError(
            f"line {vertices.lines.number[short[0]] + 1}: a vertex needs three numbers; correct the line"
        )
    colors = values.reshape(-1, 6)[:, 3:] if len(count) and (count == 6).all() else None
    return leading(values, count, 3), colors


def _fields(text: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Index of the field, from 0, that holds each byte of words like 1/2/3; a slash begins a field."""
    slashes = np.cumsum(text == ord("/"), dtype=np.int32)
    return slashes - np.maximum.accumulate(np.where(text <= ord(" "), slashes, np.int32(0)))


def _corner_uv(faces: _Element, textures: _Element, sizes: NDArray) -> NDArray | None:
    """(c, 2) texture coordinates of the corners, NaN where a corner names none; None if no corner does."""
    if b"/" not in faces.lines.text:
        return None
    text = faces.lines.characters
    is_second = (_fields(text) == 1) & (text != ord("/"))
    named = np.searchsorted(word_starts(text > 32), word_starts(is_second), side="right") - 1
    only_second = np.where(is_second | (text == ord("\n")), text, ord(" ")).tobytes()
    values, _ = rows_of(replace(faces.lines, text=only_second), "face")
    table, width = rows_of(textures.lines, "texture vertex")
    if not np.array_equal(faces.lines.n_words, sizes) or width.min() < 2:
        raise MeshFileError("a corner or a texture vertex lacks a number; correct it")
    index, n = np.zeros(sizes.sum(), dtype=np.int64), len(width)
    index[named] = whole_numbers(values, "texture vertex")
    before = np.repeat(textures.count_before(faces), sizes)
    number = np.where(index > 0, index - 1, np.where(index < 0, before + index, n))
    if ((number < 0) | (number > n)).any() or (index > n).any():
        raise MeshFileError(f"a corner names a texture vertex outside 1..{n}; correct the index")
    return np.vstack([leading(table, width, 2), [[np.nan, np.nan]]])[number]


def _indices(element: _Element, vertices: _Element, what: str) -> tuple[NDArray, NDArray]:
    """0-based vertices and size of each polygon or polyline."""
    lines, n_points = element.lines, len(vertices.place)
    if b"/" in lines.text:
        text = lines.characters
        lines = replace(lines, text=np.where(_fields(text) == 0, text, ord(" ")).tobytes())
    sizes, index = lines.n_words, integers(lines.text)
    if index is None or len(index) != sizes.sum() or ((index == 0) | (np.abs(index) > n_points)).any():
        index = _checked_indices(lines, n_points, what)
    if not (index < 0).any():
        return index - 1, sizes
    before = np.repeat(vertices.count_before(element), sizes)
    zero_based = np.where(index > 0, index - 1, before + index)
    low = np.flatnonzero(zero_based < 0)
    if len(low):
        owner = np.repeat(lines.number, sizes)
        raise MeshFileError(
            f"line {owner[low[0]] + 1}: relative vertex {index[low[0]]} of a {what} reaches "
            "before the first vertex; correct the index"
        )
    return zero_based, sizes


def _checked_indices(lines: TextLines, n_points: int, what: str) -> NDArray[np.int64]:
    """Indices that may be written as fractions; MeshFileError naming the line of the first bad one."""
    values, sizes = rows_of(lines, what)
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(
            ~((np.abs(values) <= max(n_points, 1)) & (values != 0) & (values == np.rint(values)))
        )
    if len(bad):
        owner = np.repeat(lines.number, sizes)
        raise MeshFileError(
            f"line {owner[bad[0]] + 1}: vertex {values[bad[0]]:.17g} of a {what} is outside "
            f"1..{n_points}; correct the index"
        )
    return whole_numbers(values, "vertex index")


def _segments(along: NDArray, sizes: NDArray) -> NDArray:
    """(l, 2) segments of polylines laid one after the other."""
    last = np.zeros(len(along), dtype=bool)
    last[np.cumsum(sizes)[sizes > 0] - 1] = True
    keep = np.flatnonzero(~last)
    return np.stack([along[keep], along[np.minimum(keep + 1, max(len(along) - 1, 0))]], axis=1).astype(
        np.int64
    )
