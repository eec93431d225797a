"""Normals, dihedral angles and enclosed volume, from positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh, vector_length


def face_area_vector(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3) normal times area, in length units squared."""
    side = mesh.side_vector
    return 0.5 * np.cross(side[:, 0], -side[:, 2])


def face_normal(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3) unit normals; zero where a face has no area."""
    area_vector = face_area_vector(mesh)
    length = vector_length(area_vector)[:, None]
    return np.divide(area_vector, length, out=np.zeros_like(area_vector), where=length > 0)


def enclosed_volume(mesh: TriangleMesh) -> float:
    """Signed volume of a closed surface, positive for outward orientation; measured from the centroid."""
    corners = mesh.points[mesh.faces] - mesh.points.mean(axis=0)
    return float(np.einsum("ij,ij->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6.0)


def dihedral_angle(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(e,) signed angle between the normals of an edge's two faces, in radians; positive where convex.

    Zero on boundary and non-manifold edges. The reference direction is the edge as the first of its two
    sides runs along it.
    """
    topology = mesh.topology
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin >= 0) & (np.arange(len(twin)) < twin))
    normal = face_normal(mesh)
    n0, n1 = normal[side // 3], normal[twin[side] // 3]
    direction = mesh.side_vector.reshape(-1, 3)[side]
    length = vector_length(direction)[:, None]
    unit = np.divide(direction, length, out=np.zeros_like(direction), where=length > 0)
    sine = np.einsum("ij,ij->i", np.cross(n0, n1), unit)
    cosine = np.einsum("ij,ij->i", n0, n1)
    angle = np.zeros(topology.n_edges)
    angle[topology.side_edge.ravel()[side]] = np.arctan2(sine, cosine)
    return angle
