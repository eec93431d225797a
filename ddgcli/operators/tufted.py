"""The tufted cover: a closed, oriented double cover of any triangle mesh, manifold or not.

N. Sharp, K. Crane, "A Laplacian for Nonmanifold Triangle Meshes", 2020.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, tangential, unit_vectors

# the back of a face has corners 0, 2, 1, so side j of the front is its side 2 - j
BACK_CORNERS = [0, 2, 1]


def tufted_cover(mesh: TriangleMesh | IntrinsicMesh) -> IntrinsicMesh:
    """Tufted cover: fronts and backs of all faces, glued in pairs around every edge in dihedral order.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Manifold or not.

    Returns
    -------
    IntrinsicMesh
        2m faces, closed and oriented.

    Raises
    ------
    MeshError
        When a face names a vertex twice, or three faces meet in an edge of a mesh without positions, which
        determine their order.
    """
    refuse_repeated_vertices(mesh)
    m = mesh.n_faces
    faces = np.concatenate([mesh.faces, mesh.faces[:, BACK_CORNERS]])
    length = np.concatenate([mesh.side_length, mesh.side_length[:, ::-1]])
    this, following = _consecutive_sides(mesh)
    forward = mesh.topology.side_sign.ravel() > 0
    upper = np.where(forward[this], this, _on_back(this, m))
    lower = np.where(forward[following], _on_back(following, m), following)
    gluing = np.empty(6 * m, dtype=np.int64)
    gluing[upper], gluing[lower] = lower, upper
    return IntrinsicMesh(Topology(faces, mesh.n_vertices, gluing.reshape(-1, 3)), length, mesh.points)


def _on_back(side: NDArray, m: int) -> NDArray[np.int64]:
    """Flat index of the same side on the back of its face."""
    face, j = np.divmod(side, 3)
    return 3 * (m + face) + 2 - j


def _consecutive_sides(mesh: TriangleMesh | IntrinsicMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Every side and the next one around its edge, counter-clockwise seen from the edge's head."""
    topology = mesh.topology
    side_edge = topology.side_edge.ravel()
    angle = np.zeros(len(side_edge))
    crowded = np.flatnonzero(topology.edge_face_count[side_edge] > 2)
    if len(crowded):
        if not isinstance(mesh, TriangleMesh):
            raise MeshError("an edge with three faces needs vertex positions to order them around it")
        angle[crowded] = _dihedral_position(mesh, crowded)
    this = np.lexsort((angle, side_edge))
    edge = side_edge[this]
    following = np.roll(this, -1)
    first = np.concatenate([[True], edge[1:] != edge[:-1]])
    last = np.roll(first, -1)
    following[last] = this[first]
    return this, following


def _dihedral_position(mesh: TriangleMesh, side: NDArray) -> NDArray[np.float64]:
    """(k,) angle of each side's face around its edge, from an arbitrary zero that the edge's sides share."""
    topology = mesh.topology
    edge = topology.side_edge.ravel()[side]
    tail, head = mesh.points[topology.edges[edge, 0]], mesh.points[topology.edges[edge, 1]]
    apex = mesh.points[mesh.faces.ravel()[(side // 3) * 3 + (side + 2) % 3]]
    axis = unit_vectors(head - tail)
    arm = apex - tail
    arm = unit_vectors(tangential(arm, axis))
    _, first, group = np.unique(edge, return_index=True, return_inverse=True)
    zero = arm[first][group]
    return np.arctan2(row_dot(row_cross(zero, arm), axis), row_dot(zero, arm))
