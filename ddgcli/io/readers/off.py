"""Geomview OFF, text and binary, without colours and normals.

Our own reader: meshio's loops without end on a file cut in its header and takes triangles only; trimesh
reads no binary OFF.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import TextLines, integers, leading, ragged, rows_of, whole_numbers
from ddgcli.mesh.ragged import ranges

HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF$")


def read_off(data: bytes) -> RawMesh:
    """Read an OFF file."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    first = data.lstrip()[:256].splitlines()[:1]
    if first and first[0].split()[:2] == [b"OFF", b"BINARY"]:
        return _binary(data)
    lines = TextLines.of(data)
    if b"#" in data:
        lines = lines.without(rb"#[^\n]*")
    lines = lines.select(np.flatnonzero(lines.n_words))
    number = lines.number.tolist()
    head = lines.text[: lines.begin[min(2, len(number))]].splitlines()
    words = head[0].split() if head else []
    header = HEADER.match(words[0]) if words else None
    if header is None:
        raise MeshFileError("not an OFF file: the first line must be OFF; check the file")
    if header[4] or header[5]:
        raise MeshFileError("OFF in other than three dimensions; export it as plain OFF")
    n_vertices, n_faces, at = _counts(words, head, number)
    if at + n_vertices + n_faces > len(number):
        raise MeshFileError(
            f"line {number[at - 1] + 1}: the header announces {n_vertices} vertices and {n_faces} faces, "
            f"but only {len(number) - at} lines follow; the file is truncated or the header is wrong"
        )
    split = at + n_vertices
    vertex_lines, face_lines = (
        lines.select(np.arange(at, split)),
        lines.select(np.arange(split, split + n_faces)),
    )
    points = _points(vertex_lines)
    corners, sizes = _faces(face_lines, len(points))
    raw = RawMesh(points, corners, sizes)
    if (vertex_lines.n_words > 3).any():
        raw.notes.append("numbers after the coordinates (colours, normals, texture coordinates) are omitted")
    if (face_lines.n_words > sizes + 1).any():
        raw.notes.append("numbers after the corners of faces (colours) are omitted")
    return raw


def _counts(words: list[bytes], head: list[bytes], number: list[int]) -> tuple[int, int, int]:
    """Vertices, faces, and the first line after the counts; `head` holds the first two lines."""
    at = 1
    counts = words[1:]
    if not counts:
        counts, at = (head[1].split() if len(head) > 1 else []), 2
    try:
        n_vertices, n_faces = int(counts[0]), int(counts[1])
    except (ValueError, IndexError):
        where = number[min(at, len(head)) - 1] + 1
        raise MeshFileError(
            f"line {where}: no counts of vertices and faces; the file is truncated or damaged"
        ) from None
    if n_vertices < 0 or n_faces < 0:
        raise MeshFileError(f"line {number[at - 1] + 1}: negative count; correct the header")
    return n_vertices, n_faces, at


def _points(lines: TextLines) -> NDArray[np.float64]:
    values, count = rows_of(lines, "vertex")
    short = np.flatnonzero(count < 3)
    if len(short):
        raise MeshFileError(
            f"line {lines.number[short[0]] + 1}: a vertex needs three numbers; correct the line"
        )
    return leading(values, count, 3)


def _faces(lines: TextLines, n_points: int) -> tuple[NDArray, NDArray]:
    count, whole = lines.n_words, integers(lines.text)
    if whole is not None and len(whole) == count.sum():
        values: NDArray = whole
    else:
        values, count = rows_of(lines, "face")
    first = np.cumsum(count) - count
    sizes = whole_numbers(values[first], "corner count")
    short = np.flatnonzero((sizes < 0) | (count < sizes + 1))
    if len(short):
        raise MeshFileError(
            f"line {lines.number[short[0]] + 1}: a face of {sizes[short[0]]} corners has "
            f"{count[short[0]] - 1} numbers; the file is truncated or damaged"
        )
    index = _members(values, first, count, sizes)
    bad = np.flatnonzero(~((index >= 0) & (index < n_points)))
    if len(bad):
        face = int(np.repeat(np.arange(len(sizes)), sizes)[bad[0]])
        raise MeshFileError(
            f"line {lines.number[face] + 1}: face {face} names vertex {index[bad[0]]:.17g}, outside "
            f"0..{n_points - 1}; correct the index"
        )
    return whole_numbers(index, "vertex index"), sizes


def _members(values: NDArray, first: NDArray, count: NDArray, sizes: NDArray) -> NDArray:
    """Vertices of the faces, one face after the other, from rows of a size, the vertices and colours."""
    if len(count) and (count == count[0]).all() and (sizes == sizes[0]).all():
        return values.reshape(len(count), -1)[:, 1 : 1 + sizes[0]].ravel()
    return values[ranges(first + 1, sizes)[0]]


def _binary(data: bytes) -> RawMesh:
    """OFF BINARY; the format prescribes big-endian, common writers use their own order, so both are tried."""
    start = data.find(b"\n") + 1
    for order in "<>":
        if len(data) < start + 12:
            break
        n_vertices, n_faces, _ = (int(x) for x in np.frombuffer(data, order + "i4", 3, start))
        available = len(data) - start - 12
        if min(n_vertices, n_faces) >= 0 and 12 * n_vertices + 4 * n_faces <= available:
            points = np.frombuffer(data, order + "f4", 3 * n_vertices, start + 12).reshape(-1, 3)
            tail = start + 12 + 12 * n_vertices
            flat = np.frombuffer(data, order + "i4", (len(data) - tail) // 4, tail)
            corners, sizes = _binary_faces(flat, n_faces)
            return RawMesh(points.astype(np.float64), corners, sizes)
    raise MeshFileError(
        "binary OFF whose header announces more than the file holds; it is truncated or damaged"
    )


def _binary_faces(flat: NDArray, n_faces: int) -> tuple[NDArray, NDArray]:
    try:  # pmp and others write no colour count after each face, Geomview does
        corners, sizes, n_numbers = ragged(flat, n_faces, "face")
        if n_numbers == len(flat):
            return corners.astype(np.int64), sizes
    except MeshFileError:
        n_numbers = -1
    with_colours = [(flat, 1)] if n_numbers != len(flat) else []
    for values, extra in with_colours:
        try:
            corners_c, sizes_c, used_c = ragged(values, n_faces, "face", extra)
            if used_c == len(values):
                return corners_c.astype(np.int64), sizes_c
        except MeshFileError:
            continue
    corners, sizes, _ = ragged(flat, n_faces, "face")
    return corners.astype(np.int64), sizes
