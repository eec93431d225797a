"""Division of boundary edges at boundary vertices that lie on them (T-junctions)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ddgcli.algorithms.repair.steps import RepairedMesh
from ddgcli.mesh.ragged import repeat_with_place
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

ROUNDINGS = 4.0  # of single precision, in which STL and most PLY files hold coordinates


def split_edges(repaired: RepairedMesh, distance: float = 0.0) -> RepairedMesh:
    """Divide boundary edges at boundary vertices that lie on them, and their faces with them.

    A face is divided into triangles that meet at the corner opposite the edge. The divided edge then has the
    vertices of the edges beside it: a slit along it is closed.

    Parameters
    ----------
    repaired : RepairedMesh
    distance : float
        Of a vertex from the edge (length units); 0: `ROUNDINGS` of single precision of the coordinates.
        Vertices as close to an end of the edge do not divide it.

    Returns
    -------
    RepairedMesh
        `changes` counts the vertices at which edges were divided.
    """
    mesh = repaired.mesh
    limit = distance or ROUNDINGS * float(np.finfo(np.float32).eps * np.abs(mesh.points).max(initial=0.0))
    side, vertex = _vertices_on_sides(mesh, limit)
    faces, parent = _divided(mesh.faces, side, vertex)
    divided = TriangleMesh.from_arrays(mesh.points, faces)
    return RepairedMesh(divided, repaired.input_vertex, repaired.input_face[parent], len(vertex))


def _vertices_on_sides(mesh: TriangleMesh, limit: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sides on the boundary and the vertices on them, in their order along each side."""
    topology = mesh.topology
    side = np.flatnonzero(topology.edge_face_count[topology.side_edge.ravel()] == 1)
    candidates = np.flatnonzero(topology.boundary_vertex)
    if not len(side):
        return side, candidates[:0]
    tail, head = topology.side_tail[side], topology.side_head[side]
    row, vertex = _near_pairs(mesh.points[tail], mesh.points[head], mesh.points[candidates], limit)
    vertex = candidates[vertex]
    start, along = mesh.points[tail[row]], mesh.points[head[row]] - mesh.points[tail[row]]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, np.finfo(float).tiny)[:, None]
    place = row_dot(mesh.points[vertex] - start, unit)
    gap = np.linalg.norm(mesh.points[vertex] - start - place[:, None] * unit, axis=1)
    on_edge = (gap <= limit) & (place > limit) & (place < length - limit)
    on_edge &= (mesh.faces[side[row] // 3] != vertex[:, None]).all(axis=1)
    row, vertex, place = row[on_edge], vertex[on_edge], place[on_edge]
    order = np.lexsort((place, row))
    row, vertex, place = row[order], vertex[order], place[order]
    apart = np.ones(len(row), dtype=bool)  # of several vertices at one place the first one
    apart[1:] = (row[1:] != row[:-1]) | (np.diff(place) > limit)
    return side[row[apart]], vertex[apart]


def _near_pairs(
    tail: NDArray, head: NDArray, points: NDArray, limit: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Segments and points near them: all pairs within the limit, and others.

    Points are searched around samples of the segments, as far apart as a segment is long on average: twice
    as many samples as segments at most.
    """
    length = np.linalg.norm(head - tail, axis=1)
    spacing = max(float(length.mean()), limit, np.finfo(float).tiny)
    count = np.maximum(np.ceil(length / spacing), 1.0).astype(np.int64)
    row, rank = repeat_with_place(np.arange(len(count)), count)
    share = ((rank + 0.5) / count[row])[:, None]
    samples = (1.0 - share) * tail[row] + share * head[row]
    radius = (0.5 * length[row] / count[row] + limit) * (1.0 + 1e-9)
    near = cKDTree(points).query_ball_point(samples, radius, return_sorted=False)
    row = np.repeat(row, [len(points_near) for points_near in near])
    point = np.concatenate([np.empty(0, dtype=np.int64), *map(np.asarray, near)]).astype(np.int64)
    pairs = np.unique(row * np.int64(len(points)) + point)
    return pairs // len(points), pairs % len(points)


def _divided(faces: NDArray, side: NDArray, vertex: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces divided at the vertices on their sides, and the input face of each.

    The sides of equal number are divided in one round: each belongs to one triangle of its face.
    """
    parent = np.arange(len(faces))
    begin = np.arange(3 * len(faces))  # flat corner of the divided faces at which a side of the input begins
    for number in range(3):
        here = side % 3 == number
        divided, count = np.unique(side[here], return_counts=True)
        corner = begin[divided]
        last = len(faces) + np.cumsum(count) - 1
        following = _next_side(divided)
        moves = begin[following] == _next_side(corner)  # with the last of the new triangles
        begin[following[moves]] = 3 * last[moves] + 1
        faces, parent = _divide_sides(faces, parent, corner, count, vertex[here])
    return faces, parent


def _divide_sides(
    faces: NDArray, parent: NDArray, corner: NDArray, count: NDArray, vertex: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide the sides that begin at flat corners, of one face each, at `count` vertices in their order."""
    face, tail = np.divmod(corner, 3)
    head, apex = faces[face, NEXT[tail]], faces[face, PREVIOUS[tail]]
    last = np.cumsum(count) - 1
    following = np.roll(vertex, -1)
    following[last] = head
    new = np.stack([vertex, following, np.repeat(apex, count)], axis=1)
    faces = faces.copy()
    faces[face, NEXT[tail]] = vertex[last - count + 1]
    return np.concatenate([faces, new]), np.concatenate([parent, parent[np.repeat(face, count)]])


def _next_side(side: NDArray) -> NDArray[np.int64]:
    """Flat number of the side after this one in its face."""
    return 3 * (side // 3) + NEXT[side % 3]
