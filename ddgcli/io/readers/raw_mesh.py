"""Content of a mesh file before it becomes a mesh: points, polygons, tetrahedra, segments, arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, MeshFileError, counted, excerpt
from ddgcli.io.appearance import CORNER_UV, UV, corner_uv, uv_of_corners
from ddgcli.io.readers.triangulate import triangulated
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology, check_faces
from ddgcli.mesh.triangle_mesh import TriangleMesh, check_points

CLOSURE_TOLERANCE = 1e-12  # of the extent: sin(2 pi) is not 0 in a file of 17 digits
InputMesh = TriangleMesh | TetMesh | CurveSet


@dataclass(eq=False)
class RawMesh:
    """Content of a mesh file.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    corners : (c,) ndarray of int64
        Vertices of the polygons, one polygon after the other.
    sizes : (p,) ndarray of int64
        Number of corners of each polygon.
    tetrahedra : (k, 4), lines : (l, 2) ndarray of int64
    vertex, face, cell, line, edge, whole : dict of str to ndarray
        Arrays on points, polygons, tetrahedra, segments, edges of the surface, and the whole.
    corner_uv : (c, 2) ndarray, or None
        Texture coordinates of the corners of the polygons; NaN where a corner has none.
    input_vertex : (c,) ndarray of int64, or None
        Vertex of the mesh for each vertex of the file, where the format needed a merge.
    notes : list of str
        What was done to the input, for the summary's warnings.
    """

    points: NDArray
    corners: NDArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sizes: NDArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    tetrahedra: NDArray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))
    lines: NDArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    cell: dict[str, NDArray] = field(default_factory=dict)
    line: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    whole: dict[str, NDArray] = field(default_factory=dict)
    corner_uv: NDArray | None = None
    input_vertex: NDArray | None = None
    notes: list[str] = field(default_factory=list)

    def add_faces(self, faces: NDArray) -> None:
        """Add (p, k) polygons of k corners each."""
        self.corners = np.concatenate([self.corners, np.asarray(faces, dtype=np.int64).ravel()])
        self.sizes = np.concatenate([self.sizes, np.full(len(faces), np.shape(faces)[1], dtype=np.int64)])


def assembled(raw: RawMesh) -> tuple[InputMesh, dict[str, NDArray], NDArray | None]:
    """Mesh of a file's content, its cell arrays, and the polygon of each triangle if any was split.

    Tetrahedra take precedence over polygons, and polygons over segments; omitted cells are noted.

    Parameters
    ----------
    raw : RawMesh
        Its arrays and notes are changed in place.

    Returns
    -------
    mesh : TriangleMesh, TetMesh or CurveSet
    arrays : dict of str to (m, ...) ndarray
        On the triangles, tetrahedra or segments.
    polygon : (m,) ndarray of int64, or None
        None if all polygons are triangles, and without polygons.

    Raises
    ------
    MeshError, MeshFileError
        Non-finite points, indices out of range, nothing in the file.
    """
    if raw.points.ndim != 2 or raw.points.shape[1] != 3:
        raise MeshFileError(f"points of shape {raw.points.shape}, not (n, 3); the file is damaged")
    _keep_numbers(raw)
    if len(raw.tetrahedra):
        if len(raw.sizes):
            raw.notes.append(f"{len(raw.sizes)} surface cells beside the tetrahedra omitted")
        return TetMesh.from_arrays(raw.points, raw.tetrahedra), raw.cell, None
    if len(raw.lines) and not len(raw.sizes):
        check_lines(raw.lines, len(raw.points))
        points = TriangleMesh.from_arrays(raw.points, np.zeros((0, 3), dtype=np.int64)).points
        return _with_closed_paths(CurveSet(points, raw.lines.astype(np.int64)), raw), raw.line, None
    if len(raw.lines):
        raw.notes.append(f"{len(raw.lines)} line segments beside the faces omitted")
    return _surface(raw)


def _with_closed_paths(curves: CurveSet, raw: RawMesh) -> CurveSet:
    """The curves of a file; one whose last point repeats its first, to round-off, is closed."""
    points, n = curves.points, curves.n_vertices
    half = 0.5 * points  # whose extent is a number
    index, gap = np.arange(n), 0.0
    try:
        paths = curves.paths
    except MeshError:  # which commands that follow the curves raise
        paths = ()
    for path, is_closed in paths:
        if is_closed or len(path) < 3:
            continue
        apart = float(np.abs(half[path[0]] - half[path[-1]]).max())
        if apart <= CLOSURE_TOLERANCE * float(np.ptp(half[path], axis=0).max()):
            index[path[-1]], gap = path[0], max(gap, 2.0 * apart)
    if gap > 0:
        raw.notes.append(
            f"the last point of a curve repeats its first to round-off ({gap:.1e} off): it is closed"
        )
    stays = index == np.arange(n)
    if not stays.all():
        index = (np.cumsum(stays) - 1)[index]
        raw.vertex = {name: value[stays] for name, value in raw.vertex.items()}
        raw.input_vertex = index if raw.input_vertex is None else index[raw.input_vertex]
    return CurveSet(points[stays], index[curves.lines], dict(raw.vertex))


def _surface(raw: RawMesh) -> tuple[TriangleMesh, dict[str, NDArray], NDArray | None]:
    if (raw.sizes == 3).all():
        faces = raw.corners.reshape(-1, 3)
        points = check_points(np.asarray(raw.points))
        mesh = TriangleMesh(points, Topology(check_faces(faces, len(points), copy=False), len(points)))
        if CORNER_UV in raw.face and (stored := corner_uv(raw.face)) is not None:
            raw.face[CORNER_UV] = stored
        corner = np.arange(faces.size) if raw.corner_uv is not None else np.zeros(0, dtype=np.int64)
        return mesh, {**raw.face, **_textured(raw, faces, corner)}, None
    _check_corners(raw)
    points = np.asarray(raw.points, dtype=np.float64)
    if raw.corner_uv is None:
        faces, polygon = triangulated(points, raw.corners, raw.sizes)
        textures: dict[str, NDArray] = {}
    else:  # the same triangles, as numbers of corners
        corner, polygon = triangulated(points[raw.corners], np.arange(len(raw.corners)), raw.sizes)
        faces = raw.corners[corner]
        textures = _textured(raw, faces, corner.ravel())
    large, small = np.flatnonzero(raw.sizes > 3), np.flatnonzero(raw.sizes < 3)
    if len(large):
        raw.notes.append(
            f"{counted(len(large), 'polygon', 'polygons')} of more than three corners triangulated "
            f"(first: face {large[0]})"
        )
    if len(small):
        count = counted(len(small), "face", "faces")
        raw.notes.append(f"{count} of fewer than three corners omitted (first: face {small[0]})")
    mesh = TriangleMesh.from_arrays(raw.points, faces)
    return mesh, {**{name: value[polygon] for name, value in raw.face.items()}, **textures}, polygon


def _check_corners(raw: RawMesh) -> None:
    """Raise MeshFileError for the first corner of a polygon that names no point."""
    outside = np.flatnonzero((raw.corners < 0) | (raw.corners >= len(raw.points)))
    if len(outside):
        face = int(np.searchsorted(np.cumsum(raw.sizes), outside[0], side="right"))
        raise MeshFileError(
            f"face {face} names vertex {raw.corners[outside[0]]}, outside 0..{len(raw.points) - 1}; "
            "correct the face list"
        )


def _textured(raw: RawMesh, faces: NDArray, corner: NDArray) -> dict[str, NDArray]:
    """`corner_uv` of the triangles; where every vertex has one value the vertex array `uv` instead."""
    if raw.corner_uv is None or not len(faces):
        return {}
    uv, seams = uv_of_corners(faces, raw.corner_uv[corner].reshape(-1, 3, 2), len(raw.points))
    if uv is not None:
        raw.vertex[UV] = uv
    return {} if seams is None else {CORNER_UV: seams}


def _keep_numbers(raw: RawMesh) -> None:
    """Arrays of real numbers, in the machine's byte order; others are omitted and noted."""
    _check_edges(raw)
    counts = {
        "vertex": len(raw.points), "face": len(raw.sizes), "cell": len(raw.tetrahedra),
        "line": len(raw.lines), "edge": len(raw.edge.get("edges", ())), "whole": None,
    }  # fmt: skip
    for place, count in counts.items():
        numeric = {}
        for name, value in getattr(raw, place).items():
            value = np.asarray(value)
            if value.dtype.kind not in "fiub":
                raw.notes.append(f"array '{excerpt(name, 40)}' holds {_content(value)}: it is omitted")
            elif count is not None and (value.ndim == 0 or len(value) != count):
                raise MeshFileError(
                    f"array '{excerpt(name, 40)}' has {value.size} entries where {count} are needed; "
                    "the file is damaged"
                )
            elif value.ndim:
                numeric[name] = _native(value)
        setattr(raw, place, numeric)


def _check_edges(raw: RawMesh) -> None:
    """Arrays on edges need `edges`, the two vertices of each; without it they are omitted and noted."""
    if not raw.edge:
        return
    edges, n_points = np.asarray(raw.edge.get("edges")), len(raw.points)
    whole = edges.dtype.kind in "iu" and edges.ndim == 2 and edges.shape[1] == 2
    if not whole or ((edges < 0) | (edges >= n_points)).any():
        raw.notes.append(
            f"'edges' is not an (e, 2) array of vertex indices below {n_points}: arrays on edges are omitted"
        )
        raw.edge = {}


def _content(value: NDArray) -> str:
    names = {"c": "complex numbers", "M": "dates", "m": "times", "S": "text", "U": "text", "T": "text"}
    return names.get(value.dtype.kind, "records") + ", not real numbers"


def _native(value: NDArray) -> NDArray:
    """The array in the machine's byte order; long doubles as doubles, half precision as single."""
    kind = value.dtype.newbyteorder("=")
    if kind.kind == "f":
        kind = np.dtype({2: np.float32, 4: np.float32}.get(kind.itemsize, np.float64))
    with np.errstate(over="ignore"):
        return np.asarray(value).astype(kind, copy=False)


def check_lines(lines: NDArray, n_points: int) -> None:
    """Raise MeshFileError for segments with a missing point."""
    bad = np.flatnonzero(((lines < 0) | (lines >= n_points)).any(axis=1))
    if len(bad):
        raise MeshFileError(
            f"segment {bad[0]} names a point outside 0..{n_points - 1}; correct the line list"
        )
