"""Boundary of the offset body of Steiner's formula: translated faces, cylinders over edges, spheres "
"over vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume, face_normal
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.repair import merged_points
from ddgcli.mesh.require import require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, tangential, unit_vectors
from ddgcli.representation import short_repr

MAX_FOLD = np.pi - 1e-6  # radians; beyond it the two normals of an edge leave the arc between them open
MAX_OFFSET_FACES = 20_000_000
MAX_DISTANCE = 1e100  # the cube of larger ones leaves the floating-point range

WELD_DISTANCE = 1e-10  # of the size: points that near are one


@dataclass(frozen=True, eq=False)
class OffsetBody:
    """Offset surface, with the part of the polyhedron that each face belongs to.

    Parameters
    ----------
    mesh : TriangleMesh
    part_of_face : (m,) ndarray of int64
        0 over a face, 1 over an edge, 2 over a vertex.
    volume : float
        Signed volume inside the mesh.
    """

    mesh: TriangleMesh
    part_of_face: NDArray[np.int64]
    volume: float

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class OffsetArcs:
    """Directions of an offset body: a side of each edge, normals of faces and vertices, steps of arcs.

    `arc` has the steps of each edge's arc, `rings` those from the normal of each vertex to its faces'.
    `n_faces` and `n_points` are the numbers of faces and points before points are merged.
    """

    side: NDArray[np.int64]
    normal: NDArray[np.float64]
    centre: NDArray[np.float64]
    arc: NDArray[np.int64]
    rings: NDArray[np.int64]
    n_faces: int
    n_points: int


def check_offset(mesh: TriangleMesh, distance: float, angle: float) -> OffsetArcs:
    """Directions of the arcs of an offset body; raises the errors of `offset_body`.

    Parameters
    ----------
    mesh : TriangleMesh
    distance : float
        Distance of the offset, positive.
    angle : float
        Largest step of the arcs, in degrees.

    Returns
    -------
    OffsetArcs

    Raises
    ------
    ParameterError
        For a distance or an angle out of range, or an angle that gives too many faces.
    MeshError
        When the surface is not closed, oriented and manifold, or has normals without arcs between them.
    """
    if not (np.isfinite(distance) and distance > 0):
        raise ParameterError(f"must be a positive length, not {distance}", parameter="distance")
    if not distance < MAX_DISTANCE:
        raise ParameterError(
            f"{distance:g} has a volume beyond the floating-point range; give less than {MAX_DISTANCE:g}",
            parameter="distance",
        )
    if not 0 < angle <= 90:
        raise ParameterError(f"must be an angle from 0 to 90 degrees, not {angle}", parameter="angle")
    topology = mesh.topology
    if topology.one_sided_face.any():
        raise MeshError("the surface is one-sided and bounds no body")
    require(mesh, "an offset body", manifold=True, oriented=True, closed=True)
    normal = face_normal(mesh)
    if not normal.any(axis=1).all():
        flat = int(np.argmin(normal.any(axis=1)))
        raise MeshError(f"face {flat} has no area and no normal; use `repair=drop_degenerate`")
    side = topology.interior_sides
    twin = topology.side_twin.ravel()[side]
    n1, n2 = normal[side // 3], normal[twin // 3]
    fold = np.arctan2(np.linalg.norm(row_cross(n1, n2), axis=1), row_dot(n1, n2))
    if (fold > MAX_FOLD).any():
        bad = int(np.argmax(fold))
        a, b = topology.side_tail[side[bad]], topology.side_head[side[bad]]
        raise MeshError(
            f"the surface folds back at edge {a}-{b}: its normals have no arc; move a vertex, "
            "unless it is a sheet, which bounds no body"
        )
    centre = unit_vectors(sum_by_index(mesh.faces.ravel(), np.repeat(normal, 3, axis=0), mesh.n_vertices))
    if not centre[mesh.topology.referenced_vertex].any(axis=1).all():
        bad = int(np.flatnonzero(mesh.topology.referenced_vertex & ~centre.any(axis=1))[0])
        raise MeshError(f"the normals around vertex {bad} cancel; move it")
    normal_angle = np.arccos(
        np.clip(row_dot(np.repeat(normal, 3, axis=0), centre[mesh.faces.ravel()]), -1, 1)
    )
    widest = np.zeros(mesh.n_vertices)
    np.maximum.at(widest, mesh.faces.ravel(), normal_angle)
    arc, rings = _steps(fold, angle), _steps(widest, angle)
    of_ends = rings[topology.side_tail[side]] + rings[topology.side_head[side]]
    count = mesh.n_faces + 2 * int((arc * (1 + of_ends)).sum())
    if count > MAX_OFFSET_FACES:
        raise ParameterError(
            f"the offset mesh would have {count:,} faces; give a larger angle", parameter="angle"
        )
    n_points = 3 * mesh.n_faces + int(((arc + 1) * (4 + of_ends)).sum())
    return OffsetArcs(side, normal, centre, arc, rings, count, n_points)


def _steps(angle: NDArray, resolution: float) -> NDArray[np.int64]:
    """Fewest steps of at most `resolution` degrees that make up each angle in radians; at least one."""
    return np.maximum(1, np.ceil(angle / np.radians(resolution) - 1e-9).astype(np.int64))


def offset_body(mesh: TriangleMesh, distance: float, angle: float = 6.0) -> OffsetBody:
    """Mesh of the points at a distance outside a closed surface along its normals.

    The faces move along their normals; edges become parts of cylinders and vertices parts of spheres,
    inscribed with steps of `angle`. Of a convex body this is the boundary of its parallel body; elsewhere
    parts with reversed orientation overlap others, and the signed volume is still that of the Steiner
    polynomial, up to the inscription.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed, manifold, faces outward, all of positive area.
    distance : float
        Positive, in length units.
    angle : float
        Largest angle of a step of an arc, in degrees.

    Returns
    -------
    OffsetBody

    Raises
    ------
    MeshError
        When the surface is not closed and oriented, has faces without area, or folds back by pi at an edge.
    ParameterError
        On a distance or an angle that is not positive, or when the mesh would have too many faces.
    """
    arcs = check_offset(mesh, distance, angle)
    points, faces, part_of_face = _assemble(mesh, arcs, distance)
    points, faces, part_of_face = _welded(points, faces, part_of_face)
    offset = TriangleMesh.from_arrays(points, faces)
    return OffsetBody(offset, part_of_face, enclosed_volume(offset))


def _assemble(mesh: TriangleMesh, arcs: OffsetArcs, distance: float) -> tuple[NDArray, NDArray, NDArray]:
    """Points, faces and their parts: triangles, strips of cylinders, sectors of spheres."""
    corners = mesh.points[mesh.faces.ravel()] + distance * np.repeat(arcs.normal, 3, axis=0)
    patches = [(corners, np.arange(3 * mesh.n_faces).reshape(-1, 3), 0)]
    tail, head = mesh.topology.side_tail[arcs.side], mesh.topology.side_head[arcs.side]
    for arc in np.unique(arcs.arc):  # edges of as many steps at once
        edges = np.flatnonzero(arcs.arc == arc)
        directions = _edge_arcs(mesh, arcs, edges, arc)
        patches.append(_strips(mesh.points[tail[edges]], mesh.points[head[edges]], distance * directions))
        for vertex, is_tail in ((tail[edges], True), (head[edges], False)):
            rings = arcs.rings[vertex]
            for n in np.unique(rings):
                of_n = np.flatnonzero(rings == n)
                grid = distance * _sector(arcs.centre[vertex[of_n]], directions[of_n], n)
                grid += mesh.points[vertex[of_n]][:, None, None]
                patches.append(_sectors(grid, is_tail))
    points, faces, labels = zip(*patches, strict=True)
    start = np.cumsum([0, *map(len, points[:-1])])
    part_of_face = np.repeat(labels, [len(f) for f in faces])
    numbered = [first + corner for first, corner in zip(start, faces, strict=True)]
    return np.concatenate(points), np.concatenate(numbered), part_of_face


def _edge_arcs(mesh: TriangleMesh, arcs: OffsetArcs, edges: NDArray, arc: int) -> NDArray[np.float64]:
    """(e, arc + 1, 3) normals along the arcs of edges, from the face of the side to that of its twin."""
    side = arcs.side[edges]
    twin = mesh.topology.side_twin.ravel()[side]
    return _arcs(arcs.normal[side // 3], arcs.normal[twin // 3], np.arange(arc + 1) / arc)


def _strips(tail: NDArray, head: NDArray, offset: NDArray) -> tuple[NDArray, NDArray, int]:
    """Points, faces and part of the cylinders over edges."""
    ends = np.stack([tail[:, None] + offset, head[:, None] + offset])  # (2, e, arc + 1, 3)
    row = np.arange(ends[..., 0].size).reshape(ends.shape[:-1])
    # seen from outside the side runs with its face on the left: its neighbour lies on the right
    faces = _quads(row[0, :, :-1], row[0, :, 1:], row[1, :, 1:], row[1, :, :-1])
    return ends.reshape(-1, 3), faces, 1


def _sectors(grid: NDArray, is_tail: bool) -> tuple[NDArray, NDArray, int]:
    """Points, faces and part of the sectors of spheres with points (e, rings + 1, arc + 1, 3)."""
    index = np.arange(grid[..., 0].size).reshape(grid.shape[:-1])
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    faces = _quads(a, d, c, b) if is_tail else _quads(a, b, c, d)
    return grid.reshape(-1, 3), faces, 2


def _arcs(start: NDArray, end: NDArray, t: NDArray) -> NDArray[np.float64]:
    """(k, len(t), 3) points at shares t of the great arcs between unit vectors."""
    angle = np.arctan2(np.linalg.norm(row_cross(start, end), axis=-1), row_dot(start, end))[..., None]
    other = unit_vectors(tangential(end, start))
    turn = angle * t
    return np.cos(turn)[..., None] * start[..., None, :] + np.sin(turn)[..., None] * other[..., None, :]


def _sector(centre: NDArray, directions: NDArray, rings: int) -> NDArray[np.float64]:
    """(e, rings + 1, arc + 1, 3) unit vectors from a centre to an arc."""
    centres = np.broadcast_to(centre[:, None], directions.shape)
    return _arcs(centres, directions, np.arange(rings + 1) / rings).swapaxes(1, 2)


def _quads(a: NDArray, b: NDArray, c: NDArray, d: NDArray) -> NDArray[np.int64]:
    """Triangles of quads a, b, c, d."""
    one = np.stack([a, b, c], axis=-1).reshape(-1, 3)
    return np.concatenate([one, np.stack([a, c, d], axis=-1).reshape(-1, 3)])


def _welded(points: NDArray, faces: NDArray, part_of_face: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Merge points at one place; drop the faces that lose their area by it."""
    from scipy.spatial import cKDTree

    size = float(np.abs(points - points.mean(axis=0)).max())
    # thousands of points lie at one place where a surface is flat: one of each cell of a grid is enough
    cells, place = merged_points(np.round(points / (WELD_DISTANCE * size)))
    representative = np.full(len(cells), len(points))
    np.minimum.at(representative, place, np.arange(len(points)))
    pairs = cKDTree(points[representative]).query_pairs(2 * WELD_DISTANCE * size, output_type="ndarray")
    label = connected_labels(pairs[:, 0], pairs[:, 1], len(representative))[1][place]
    first = np.unique(label, return_index=True)[1]
    faces = label[faces]
    has_area = (faces != faces[:, NEXT]).all(axis=1)
    return points[first], faces[has_area], part_of_face[has_area]
