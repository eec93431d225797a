"""Gradient of piecewise linear functions and its adjoint, on faces in space."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, unit_vectors


def gradient(mesh: TriangleMesh) -> csr_array:
    """Gradient of piecewise linear functions.

    grad f = sum over corners k of f_k (normal x side opposite k) / (2 area).

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (3m, n) csr_array of float64
        Rows 3f..3f+2 are the vector on face f, in value per length; zero on faces without area.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(2, 2)
    >>> slope = (ddg.gradient(square) @ (3 * square.points[:, 0])).reshape(-1, 3)
    >>> slope[0].round(12).tolist()
    [3.0, 0.0, 0.0]
    """
    longest = mesh.side_length.max(axis=1)  # faces scaled to unit size: areas of tiny ones would underflow
    unit = np.where(longest > 0, longest, 1.0)[:, None]
    side = mesh.side_vector / unit[..., None]
    area = face_area(mesh.side_length / unit)
    normal = unit_vectors(row_cross(side[:, 0], -side[:, 2]))
    scale = np.divide(0.5, area, out=np.zeros_like(area), where=area > 0)
    turned = row_cross(normal[:, None, :], side[:, NEXT])
    values = (turned * scale[:, None, None] / unit[..., None]).transpose(0, 2, 1)
    m = mesh.n_faces
    columns = np.repeat(matrix_indices(mesh.faces, 9 * m, mesh.n_vertices)[:, None, :], 3, axis=1)
    pointers = matrix_indices(np.arange(0, 9 * m + 1, 3), 9 * m, mesh.n_vertices)
    matrix = csr_array((values.ravel(), columns.ravel(), pointers), shape=(3 * m, mesh.n_vertices))
    matrix.sum_duplicates()
    return matrix


def divergence(mesh: TriangleMesh) -> csr_array:
    """Integrated divergence of vectors on faces, -gradient' area: stiffness = -divergence @ gradient.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3m) csr_array of float64
        From (m, 3) vectors, flattened, to integrals over the vertices' cells.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.icosphere(1)
    >>> bool(abs(ddg.divergence(mesh) @ ddg.gradient(mesh) + ddg.stiffness(mesh)).max() < 1e-12)
    True
    """
    area = np.repeat(face_area(mesh.side_length), 3)
    return csr_array(-(gradient(mesh).T @ diags_array(area)))
