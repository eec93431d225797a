"""Quality of a mesh: shape of its cells, and defects with the indices of the first ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import enclosed_volume, face_area_vector
from ddgcli.geometry.intersections import intersecting_faces
from ddgcli.geometry.t_junctions import t_junctions
from ddgcli.mesh.coincident_faces import crack_faces, flat_gaps
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.ragged import repeated_rows
from ddgcli.mesh.repair import merged_points
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import bounding_box, cone_volume, row_cross, row_dot, vector_length

MANY_BOUNDARY_EDGES = 20_000  # of which more than half of the edges: faces without neighbours
MAX_LISTED = 5  # elements listed for each defect
ANGLE_BINS = np.arange(0.0, 181.0, 10.0)


def surface_defects(mesh: TriangleMesh) -> dict[str, Any]:
    """Counts of defects of a surface, and `..._first`, the indices of the first ones.

    `duplicate_faces` counts faces with the three vertices of an earlier face, in any order;
    `coincident_vertices` counts used vertices at exactly the position of an earlier one; `t_junctions` counts
    boundary vertices inside boundary edges, once coincident vertices are joined.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    dict
    """
    topology = mesh.topology
    faces = mesh.faces
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    defects: dict[str, Any] = {"orientable": topology.is_orientable, "orientation": orientation(mesh)}
    unreferenced = np.flatnonzero(~topology.referenced_vertex)
    at_equal_positions = coincident(mesh.points, topology.referenced_vertex)
    for name, elements in (
        ("degenerate_faces", mesh.flat_faces),
        ("repeated_index_faces", np.flatnonzero(repeated)),
        ("duplicate_faces", repeated_rows(np.sort(faces, axis=1))),
        ("unreferenced_vertices", unreferenced),
        ("coincident_vertices", at_equal_positions),
        ("t_junctions", _t_junction_vertices(mesh, is_joined=len(at_equal_positions) == 0)),
        ("nonmanifold_vertices", topology.nonmanifold_vertices),
        ("misoriented_edges", topology.edges[topology.misoriented_edges]),
        ("nonmanifold_edges", topology.edges[topology.nonmanifold_edges]),
    ):
        if elements is not None:
            defects[name] = len(elements)
            if len(elements):
                defects[f"{name}_first"] = elements[:MAX_LISTED].tolist()
    return defects


def self_intersections(mesh: TriangleMesh) -> tuple[dict[str, Any], NDArray[np.bool_]]:
    """Pairs of faces that cross.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    defects : dict
        `self_intersections`, the number of pairs, and `self_intersections_first`, the first ones.
    faces : (m,) ndarray of bool
        The faces that cross another.
    """
    pairs = intersecting_faces(mesh.points, mesh.faces)
    defects: dict[str, Any] = {"self_intersections": len(pairs)}
    if len(pairs):
        defects["self_intersections_first"] = pairs[:MAX_LISTED].tolist()
    marked = np.zeros(mesh.n_faces, dtype=bool)
    marked[pairs] = True
    return defects, marked


def surface_area(mesh: TriangleMesh) -> float:
    """Sum of the face areas from positions; infinite where it leaves float64."""
    unit = 2.0 ** np.frexp(mesh.side_length.max(initial=0.0))[1]  # a division by it is exact
    area = vector_length(face_area_vector(mesh.moved_unchecked(mesh.points / unit)))
    with np.errstate(over="ignore"):
        return float(area.sum() * unit * unit)


def coincident(points: NDArray, referenced: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Used points at exactly the position of an earlier used one."""
    number = np.flatnonzero(referenced)
    _, index = merged_points(points[number])
    first = np.zeros(len(number), dtype=bool)
    first[np.unique(index, return_index=True)[1]] = True
    return number[~first].astype(np.int64)


def _t_junction_vertices(mesh: TriangleMesh, *, is_joined: bool) -> NDArray[np.int64] | None:
    """Vertices of T-junctions, None for separate faces; `is_joined` where no vertices share a position."""
    if not is_joined:
        points, place = merged_points(mesh.points)
        first = np.unique(place, return_index=True)[1]
        vertices = _t_junction_vertices(TriangleMesh.from_arrays(points, place[mesh.faces]), is_joined=True)
        return None if vertices is None else first[vertices]
    n_boundary = len(mesh.topology.boundary_edges)
    if n_boundary > max(MANY_BOUNDARY_EDGES, mesh.topology.n_edges // 2):
        return None
    return np.unique(t_junctions(mesh)[1])


def orientation(mesh: TriangleMesh) -> str:
    """'outward', 'inward' or 'mixed' for closed bodies, 'consistent' with boundary, else the defect."""
    topology = mesh.topology
    if topology.n_faces == 0:
        return "none"
    if not topology.is_orientable:
        return "not orientable"
    if not topology.is_oriented:
        return "inconsistent"
    if not topology.is_closed:
        return "consistent"
    volume = component_volume(mesh)
    return "outward" if (volume >= 0).all() else "inward" if (volume <= 0).all() else "mixed"


def component_volume(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Signed volume of each component, measured from its own centre, relative to the whole's size cubed."""
    label = mesh.topology.face_component
    corners = mesh.points[mesh.faces] - mesh.points[mesh.faces].mean(axis=(0, 1))
    corners = corners / (np.abs(corners).max(initial=0.0) or 1.0)
    n = mesh.topology.n_components
    count = np.bincount(label, minlength=n)
    centre = sum_by_index(label, corners.mean(axis=1), n) / np.maximum(count, 1)[:, None]
    corners = corners - centre[label][:, None, :]
    return sum_by_index(label, cone_volume(*corners.transpose(1, 2, 0)), n)


def triangle_quality(mesh: TriangleMesh, angle: NDArray) -> dict[str, Any]:
    """Angles, aspect and needle ratio of the faces that have area.

    `aspect_ratio` is longest side / (2 sqrt(3) inradius), 1 for an equilateral triangle; `needle_ratio`
    longest / shortest side. The histogram counts corners in bins of ten degrees.

    Parameters
    ----------
    mesh : TriangleMesh
    angle : (m, 3) ndarray of float64
        Of the corners, in degrees.

    Returns
    -------
    dict
        None where no face has area.
    """
    good = np.ones(mesh.n_faces, dtype=bool)
    good[mesh.flat_faces] = False
    if not good.any():
        return {"min_angle_degrees": None, "max_angle_degrees": None}
    angle, length = angle[good], mesh.side_length[good]
    unit = length / length.max(axis=1, keepdims=True)
    smallest, largest = angle.min(axis=1), angle.max(axis=1)
    # area of a triangle from its longest side's two angles would cancel; sine of the largest angle does not
    adjacent = unit.prod(axis=1) / unit.max(axis=1)
    area = 0.5 * adjacent * np.sin(np.radians(largest))
    aspect = unit.sum(axis=1) / (4 * np.sqrt(3) * area)
    return {
        "min_angle_degrees": smallest.min(),
        "max_angle_degrees": largest.max(),
        "mean_min_angle_degrees": smallest.mean(),
        "faces_below_5_degrees": int((smallest < 5).sum()),
        "faces_above_120_degrees": int((largest > 120).sum()),
        "angle_histogram": np.histogram(angle, bins=ANGLE_BINS)[0],
        "aspect_ratio_median": np.median(aspect),
        "aspect_ratio_max": aspect.max(),
        "needle_ratio_max": (1 / unit.min(axis=1)).max(),
    }


def face_min_angle(mesh: TriangleMesh, angle: NDArray) -> NDArray[np.float64]:
    """Smallest angle of each face.

    Parameters
    ----------
    mesh : TriangleMesh
    angle : (m, 3) ndarray of float64
        Of the corners, in degrees.

    Returns
    -------
    (m,) ndarray of float64
        In degrees; 0 where the face has no area.
    """
    smallest = angle.min(axis=1, initial=180.0)
    smallest[mesh.flat_faces] = 0.0
    return smallest


def size(points: NDArray, length: NDArray) -> dict[str, Any]:
    """Bounding box and edge lengths, which reveal a wrong unit of length.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    length : (e,) ndarray of float64
        Of the edges.

    Returns
    -------
    dict
        In the unit of the input.
    """
    if len(points) == 0:
        return {"bounding_box": None, "diagonal": None}
    low, high = bounding_box(points)
    sizes = {"bounding_box": [low, high], "diagonal": float(vector_length((high - low)[None])[0])}
    if length.size:
        sizes |= {"mean_edge": length.mean(), "min_edge": length.min(), "max_edge": length.max()}
    return sizes


def surface_size(mesh: TriangleMesh) -> dict[str, Any]:
    """Size of a surface, its area, and its volume where it is closed and consistently oriented.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    dict
        In the unit of the input.
    """
    topology = mesh.topology
    ends = mesh.points[topology.edges]
    sizes = size(mesh.points[topology.referenced_vertex], vector_length(ends[:, 1] - ends[:, 0]))
    sizes["area"] = surface_area(mesh)
    if topology.is_closed and topology.is_oriented:
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # the summary writes null beyond the range of float64
            sizes["volume"] = enclosed_volume(mesh)
    return sizes


def surface_marks(mesh: TriangleMesh) -> dict[str, NDArray]:
    """Vertex arrays `component`, `boundary` and `non_manifold`.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    dict of str to (n,) ndarray
    """
    topology = mesh.topology
    non_manifold = np.zeros(mesh.n_vertices, dtype=np.uint8)
    non_manifold[topology.nonmanifold_vertices] = 1
    non_manifold[topology.edges[topology.nonmanifold_edges]] = 1
    return {
        "component": topology.vertex_component,
        "boundary": topology.boundary_vertex.astype(np.uint8),
        "non_manifold": non_manifold,
    }


def dihedral_degrees(mesh: TetMesh) -> NDArray[np.float64]:
    """(k, 6) dihedral angles of tetrahedra in degrees; NaN where a face has no area."""
    p = mesh.points[mesh.tetrahedra]
    scale = np.abs(p - p[:, :1]).max(axis=(1, 2), keepdims=True)
    p = np.divide(p - p[:, :1], scale, out=np.zeros_like(p), where=scale > 0)
    normal = []
    for a, b, c in TET_FACES:
        n = row_cross(p[:, b] - p[:, a], p[:, c] - p[:, a])
        length = np.linalg.norm(n, axis=1, keepdims=True)
        normal.append(np.divide(n, length, out=np.full_like(n, np.nan), where=length > 0))
    pairs = [(i, j) for i in range(4) for j in range(i)]
    cosine = np.stack([-row_dot(normal[i], normal[j]) for i, j in pairs], axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def tetrahedra_quality(mesh: TetMesh) -> dict[str, Any]:
    """Dihedral angles, inverted and flat cells, faces of more than two cells or of cells that overlap, gaps.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    dict
    """
    volume = mesh.signed_volume
    flat = np.zeros(len(volume), dtype=bool)
    flat[mesh.flat_tetrahedra] = True
    angle = dihedral_degrees(mesh)
    count = np.bincount(mesh.cell_triangle.ravel())
    referenced = np.zeros(mesh.n_vertices, dtype=bool)
    referenced[mesh.tetrahedra] = True
    defects: dict[str, Any] = {
        "min_dihedral_degrees": np.nanmin(angle) if np.isfinite(angle).any() else None,
        "max_dihedral_degrees": np.nanmax(angle) if np.isfinite(angle).any() else None,
        "volume": float(np.abs(volume).sum()),
        "faces_with_three_or_more_cells": int((count > 2).sum()),
        "folded_faces": len(mesh.folded_triangles),
        "flat_gaps": len(flat_gaps(mesh)),
        "crack_faces": len(crack_faces(mesh)),
    }
    for name, elements in (
        ("inverted_tetrahedra", np.flatnonzero((volume < 0) & ~flat)),
        ("flat_tetrahedra", mesh.flat_tetrahedra),
        ("duplicate_tetrahedra", mesh.duplicate_tetrahedra),
        ("unreferenced_vertices", np.flatnonzero(~referenced)),
        ("coincident_vertices", coincident(mesh.points, referenced)),
    ):
        defects[name] = len(elements)
        if len(elements):
            defects[f"{name}_first"] = elements[:MAX_LISTED].tolist()
    return defects


def tetrahedra_marks(mesh: TetMesh) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """Vertex arrays as for a surface, components of the body, and the smallest dihedral angle of each cell.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    vertex : dict of str to (n,) ndarray
    cell : dict of str to (m,) ndarray
        `min_angle_degrees`.
    """
    vertex = surface_marks(mesh.boundary)
    on_boundary = mesh.boundary.topology.referenced_vertex
    vertex |= {"component": mesh.vertex_component, "boundary": on_boundary.astype(np.uint8)}
    return vertex, {"min_angle_degrees": np.nan_to_num(dihedral_degrees(mesh).min(axis=1, initial=180.0))}


def curve_quality(curves: CurveSet) -> dict[str, Any]:
    """Lengths, unused and coincident points of curves.

    Parameters
    ----------
    curves : CurveSet

    Returns
    -------
    dict
    """
    segment = curves.points[curves.lines]
    length = vector_length(segment[:, 1] - segment[:, 0])
    referenced = np.zeros(curves.n_vertices, dtype=bool)
    referenced[curves.lines] = True
    return {
        "length": length.sum(),
        "planar": curves.planar,
        "curve_vertices": [len(path) for path, _ in curves.paths],
        "degenerate_segments": int((length == 0).sum()),
        "unreferenced_vertices": int((~referenced).sum()),
        "coincident_vertices": len(coincident(curves.points, referenced)),
    }


def curve_marks(curves: CurveSet) -> dict[str, NDArray]:
    """Point arrays `component` and `boundary` (ends of open curves).

    Parameters
    ----------
    curves : CurveSet

    Returns
    -------
    dict of str to (n,) ndarray
    """
    component = np.full(curves.n_vertices, -1, dtype=np.int64)
    boundary = np.zeros(curves.n_vertices, dtype=np.uint8)
    for number, (path, closed) in enumerate(curves.paths):
        component[path] = number
        if not closed:
            boundary[path[[0, -1]]] = 1
    return {"component": component, "boundary": boundary}
