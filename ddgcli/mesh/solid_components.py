"""Connected components of a mesh of tetrahedra, as meshes of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.tet_mesh import TetMesh


@dataclass(frozen=True, eq=False)
class SolidComponent:
    """A component as a mesh, and the indices of its simplices in the whole mesh.

    Attributes
    ----------
    mesh : TetMesh
        Its simplices have the order and the orientation of the whole mesh.
    vertices, edges, triangles, tetrahedra : ndarray of int64
    """

    mesh: TetMesh
    vertices: NDArray[np.int64]
    edges: NDArray[np.int64]
    triangles: NDArray[np.int64]
    tetrahedra: NDArray[np.int64]


def solid_components(mesh: TetMesh) -> list[SolidComponent]:
    """Components of a mesh of tetrahedra, by their lowest vertices; vertices of no tetrahedron are left out.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    list of SolidComponent

    Examples
    --------
    >>> points = np.concatenate([np.eye(4, 3), np.eye(4, 3) + 5])
    >>> mesh = TetMesh.from_arrays(points, [[4, 5, 6, 7], [0, 1, 2, 3]])
    >>> [component.edges.tolist() for component in solid_components(mesh)]
    [[0, 1, 2, 3, 4, 5], [6, 7, 8, 9, 10, 11]]
    """
    tets = mesh.tetrahedra
    of_vertex = mesh.vertex_component
    labels = [of_vertex, *(of_vertex[simplex[:, 0]] for simplex in (mesh.edges, mesh.triangles, tets))]
    place = np.empty(mesh.n_vertices, dtype=np.int64)
    result = []
    for numbers in zip(*map(_members, labels)):
        vertices, cells = numbers[0], numbers[3]
        place[vertices] = np.arange(len(vertices))
        result.append(SolidComponent(TetMesh(mesh.points[vertices], place[tets[cells]]), *numbers))
    return result


def _members(label: NDArray) -> list[NDArray[np.int64]]:
    """Ascending indices of the items of each label; those of -1 are left out."""
    start = list_starts(np.bincount(label + 1))
    order = np.argsort(label, kind="stable")
    return [order[first:end] for first, end in zip(start[1:], start[2:])]
