"""Division of boundary edges at boundary vertices that lie on them (T-junctions)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.repair.steps import RepairedMesh
from ddgcli.geometry.t_junctions import t_junctions
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh


def split_edges(repaired: RepairedMesh, distance: float = 0.0) -> RepairedMesh:
    """Divide boundary edges at boundary vertices that lie on them, and their faces with them.

    A face is divided into triangles that meet at the corner opposite the edge. The divided edge then has the
    vertices of the edges beside it: a slit along it is closed.

    Parameters
    ----------
    repaired : RepairedMesh
    distance : float
        Of a vertex from the edge, as for `t_junctions`.

    Returns
    -------
    RepairedMesh
        `changes` counts the vertices at which edges were divided.
    """
    mesh = repaired.mesh
    side, vertex = t_junctions(mesh, distance)
    faces, parent = _divided(mesh.faces, side, vertex)
    divided = TriangleMesh.from_arrays(mesh.points, faces)
    return RepairedMesh(divided, repaired.input_vertex, repaired.input_face[parent], len(vertex))


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
    """Flat index of the side after this one in its face."""
    return 3 * (side // 3) + NEXT[side % 3]
