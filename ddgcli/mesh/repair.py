"""Repairs of meshes; each returns the new mesh and the changed elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.cures import cure
from ddgcli.mesh.triangle_mesh import TriangleMesh


def merged_points(points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unique positions in order of first appearance, and the unique position of each point."""
    points = np.asarray(points, dtype=np.float64) + 0.0  # -0 becomes 0
    if len(points) == 0:
        return points, np.zeros(0, dtype=np.int64)
    order = np.lexsort(points.T)
    ordered = points[order]
    fresh = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.cumsum(fresh) - 1
    first = order[fresh]  # lexsort is stable: the first of its group
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return points[np.sort(first)], rank[group]


def oriented(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """The mesh with consistently oriented faces, and the mask of the reversed ones (the fewer of each piece).

    Raises
    ------
    MeshError
        The surface is not orientable.
    """
    turn = mesh.topology.face_turn
    if turn is None:
        raise MeshError(
            f"the surface is not orientable (it contains a Moebius band); {cure('one side', mesh.topology)}"
        )
    return reverse_faces(mesh, turn), turn


def reverse_faces(mesh: TriangleMesh, turn: NDArray) -> TriangleMesh:
    """The mesh with the faces of an (m,) mask reversed."""
    faces = np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)
    return TriangleMesh.from_arrays(mesh.points, faces)


def one_vertex_a_fan(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.int64]]:
    """The mesh with a separate vertex for every fan of faces, and the input vertex of each vertex.

    The first fan of a vertex keeps its number; the others get new numbers after all vertices.
    """
    n = mesh.n_vertices
    if len(mesh.topology.nonmanifold_vertices) == 0:
        return mesh, np.arange(n)
    fan = mesh.topology.corner_fans.ravel()
    vertex = np.empty(fan.max() + 1, dtype=np.int64)
    vertex[fan] = mesh.faces.ravel()
    order = np.argsort(vertex, kind="stable")
    further = order[1:][vertex[order[1:]] == vertex[order[:-1]]]
    number = vertex.copy()
    number[further] = n + np.arange(len(further))
    original = np.concatenate([np.arange(n), vertex[further]])
    return TriangleMesh.from_arrays(mesh.points[original], number[fan].reshape(-1, 3)), original
