"""Point lists (.csv, .txt) as curves, WKT triangles (.wkt), NumPy archives (.npz) of our own layout."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.numpy_file import npz_arrays
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import rows, whole_numbers
from ddgcli.mesh.repair import merged_points

PLACES = {"points", "faces", "tetrahedra", "lines", "metadata", "edges"}


def read_csv(data: bytes) -> RawMesh:
    """Read 2 or 3 columns of numbers as a polyline.

    Separators are commas, semicolons or blanks; one line of column names and `#` comments are skipped.
    """
    lines, number = [], []
    for count, line in enumerate(data.removeprefix(b"\xef\xbb\xbf").splitlines()):
        line = re.sub(rb"[,;\t]", b" ", line.partition(b"#")[0]).strip()
        if line:
            lines.append(line)
            number.append(count)
    if (
        lines
        and re.search(rb"[A-Za-z_]{2}|^[xyzXYZ] ", lines[0])
        and not re.search(rb"(?i)nan|inf", lines[0])
    ):
        if lines[0].split()[:4] == [b"vertex", b"x", b"y", b"z"]:
            raise MeshFileError("a table of vertices, which holds no faces; name the mesh file")
        del lines[0], number[0]
    if not lines:
        raise MeshFileError("no rows; a curve needs 2 or 3 columns of numbers")
    values, counts = rows(lines, number, "row")
    width = int(counts[0])
    odd = np.flatnonzero(counts != width)
    if width not in (2, 3):
        raise MeshFileError(
            f"line {number[0] + 1}: {width} columns; a curve needs 2 or 3, with decimal points (0.5, not 0,5)"
        )
    if len(odd):
        raise MeshFileError(
            f"line {number[odd[0]] + 1}: {counts[odd[0]]} columns where the first row has {width}; a curve "
            "needs 2 or 3 in every row"
        )
    if len(counts) < 2:
        raise MeshFileError("one row; a curve needs two points or more")
    table = values.reshape(-1, width)
    points = np.column_stack([table, np.zeros((len(table), 3 - width))])
    index = np.arange(len(points))
    return RawMesh(points, lines=np.stack([index[:-1], index[1:]], axis=1))


def read_wkt(data: bytes) -> RawMesh:
    """Read `TIN (((x y z, x y z, x y z, x y z)), ...)`; equal positions are merged: WKT shares none.

    Our own reader: the pattern that meshio matches does not end on a file that is cut.
    """
    text = b" ".join(data.split())
    head = re.match(rb"TIN ?\(", text, re.IGNORECASE)
    if head is None or text.count(b"(") != text.count(b")") or not text.endswith(b")"):
        raise MeshFileError(
            "not a TIN in WKT, or its brackets do not close; the file is truncated or of another kind"
        )
    rings = re.findall(rb"\(\(([^()]*)\)\)", text[head.end() - 1 :][1:-1])
    if any(ring.count(b",") != 3 for ring in rings):
        raise MeshFileError("a triangle of the TIN has other than four points; correct it")
    words = [point for ring in rings for point in ring.split(b",")]
    values, counts = rows(words, [0] * len(words), "point")
    if (counts != 3).any():
        raise MeshFileError("a point of the TIN has other than three numbers; correct it")
    points, index = merged_points(values.reshape(-1, 4, 3)[:, :3].reshape(-1, 3))
    raw = RawMesh(points, input_vertex=index)
    raw.notes.append(f"WKT cannot share vertices: {len(index)} corners merged to {len(points)} where equal")
    raw.add_faces(index.reshape(-1, 3))
    return raw


def read_npz(data: bytes) -> RawMesh:
    """Read a .npz with `points` and `faces`, `tetrahedra` or `lines`; others are arrays, by length."""
    arrays, others = npz_arrays(data)
    if "points" not in arrays:
        raise MeshFileError(
            "the archive has no array 'points'; a mesh needs points and faces, tetrahedra or lines"
        )
    raw = raw_of_arrays(arrays)
    if others:
        raw.notes.append(
            f"{len(others)} members of the archive are not arrays and are omitted: {excerpt(others[0], 40)}"
        )
    return raw


def raw_of_arrays(arrays: dict[str, NDArray]) -> RawMesh:
    """Raw mesh of named arrays; other arrays are assigned by length: vertices first, then cells."""
    points = np.asarray(arrays["points"])
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype.kind not in "fiu":
        raise MeshFileError(f"'points' is {points.shape} {points.dtype}; it must be (n, 3) numbers")
    raw = RawMesh(points.astype(np.float64))
    cells = {
        name: _cells(arrays, name, width) for name, width in (("faces", 3), ("tetrahedra", 4), ("lines", 2))
    }
    if cells["tetrahedra"] is not None:
        raw.tetrahedra = cells["tetrahedra"]
    elif cells["faces"] is not None:
        raw.add_faces(cells["faces"])
    elif cells["lines"] is not None:
        raw.lines = cells["lines"]
    n_edges = len(np.atleast_1d(arrays["edges"])) if "edges" in arrays else -1
    lengths = ((len(points), raw.vertex), (len(raw.tetrahedra), raw.cell), (len(raw.sizes), raw.face),
               (len(raw.lines), raw.line), (n_edges, raw.edge))  # fmt: skip
    for name, value in arrays.items():
        if name in PLACES or value.ndim == 0:
            continue
        place = next((p for length, p in lengths if length == len(value)), raw.whole)
        place[name] = value
    if "edges" in arrays:
        raw.edge["edges"] = arrays["edges"]
    return raw


def _cells(arrays: dict[str, NDArray], name: str, width: int) -> NDArray | None:
    if name not in arrays:
        return None
    value = np.asarray(arrays[name])
    if value.ndim != 2 or value.shape[1] != width or value.dtype.kind not in "iu":
        raise MeshFileError(f"'{name}' is {value.shape} {value.dtype}; it must be (m, {width}) whole numbers")
    return whole_numbers(value, f"entry of '{name}'")
