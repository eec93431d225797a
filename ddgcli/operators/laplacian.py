"""Stiffness and mass matrices of the Laplacian, from side lengths alone.

Sign: the stiffness L is positive semidefinite, so that L x = lambda M x has lambda >= 0.
Every function takes a TriangleMesh or an IntrinsicMesh: it reads only `topology` and `side_length`.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ddgcli.geometry.intrinsic import corner_cotan, face_area
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

SurfaceMesh = TriangleMesh | IntrinsicMesh


def stiffness(mesh: SurfaceMesh) -> csr_array:
    """(n, n) cotangent stiffness: off-diagonal entries -(cot + cot)/2, rows summing to zero."""
    weight = 0.5 * corner_cotan(mesh.side_length)[:, [2, 0, 1]].ravel()  # side j is opposite corner j+2
    i, j = mesh.topology.side_tail, mesh.topology.side_head
    n = mesh.n_vertices
    rows = np.concatenate([i, j, i, j])
    cols = np.concatenate([j, i, i, j])
    values = np.concatenate([-weight, -weight, weight, weight])
    return coo_array((values, (rows, cols)), shape=(n, n)).tocsr()


def lumped_vertex_area(mesh: SurfaceMesh) -> np.ndarray:
    """(n,) a third of the area of each incident face."""
    area = np.repeat(face_area(mesh.side_length) / 3.0, 3)
    return np.bincount(mesh.faces.ravel(), weights=area, minlength=mesh.n_vertices)


def lumped_mass(mesh: SurfaceMesh) -> csr_array:
    """(n, n) diagonal mass matrix of `lumped_vertex_area`."""
    return diags_array(lumped_vertex_area(mesh)).tocsr()
