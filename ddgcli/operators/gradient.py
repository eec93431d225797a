"""Gradient of piecewise linear functions and its adjoint, on faces in space."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import unit_vectors


def gradient(mesh: TriangleMesh) -> csr_array:
    """(3m, n) gradient: rows 3f..3f+2 are the vector on face f, in value per length; zero without area.

    grad f = sum over corners k of f_k (normal x side opposite k) / (2 area).
    """
    longest = mesh.side_length.max(axis=1)  # faces scaled to unit size: areas of tiny ones would underflow
    unit = np.where(longest > 0, longest, 1.0)[:, None]
    side = mesh.side_vector / unit[..., None]
    area = face_area(mesh.side_length / unit)
    normal = unit_vectors(np.cross(side[:, 0], -side[:, 2]))
    scale = np.divide(0.5, area, out=np.zeros_like(area), where=area > 0)
    values = (np.cross(normal[:, None, :], side[:, NEXT]) * scale[:, None, None] / unit[..., None]).transpose(
        0, 2, 1
    )
    m = mesh.n_faces
    columns = np.repeat(mesh.faces[:, None, :], 3, axis=1)
    pointers = np.arange(0, 9 * m + 1, 3)
    matrix = csr_array((values.ravel(), columns.ravel(), pointers), shape=(3 * m, mesh.n_vertices))
    matrix.sum_duplicates()
    return matrix


def divergence(mesh: TriangleMesh) -> csr_array:
    """(n, 3m) integrated divergence of face vectors, -gradient' area: stiffness = -divergence @ gradient."""
    area = np.repeat(face_area(mesh.side_length), 3)
    return csr_array(-(gradient(mesh).T @ diags_array(area)))
