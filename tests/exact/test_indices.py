"""Indices of sparse matrices have 4 bytes where they fit, and products of vertex indices do not overflow."""

import numpy as np
import pytest

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.linalg.indices import LARGEST_INT32, matrix_indices
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import connection_laplacian
from ddgcli.operators.dec import d0, d1
from ddgcli.operators.gradient import gradient
from ddgcli.operators.laplacian import galerkin_mass, stiffness, uniform_stiffness

SMALL = shapes.random_sphere(60)
MATRICES = {
    "stiffness": stiffness,
    "galerkin": galerkin_mass,
    "uniform": uniform_stiffness,
    "connection": connection_laplacian,
    "gradient": gradient,
    "d0": lambda mesh: d0(mesh.topology),
    "d1": lambda mesh: d1(mesh.topology),
}
STEP, N = 1000, 60_008  # vertex k of the small mesh is vertex 1000 k + 7; 60,000 squared is above 2^31


def spread() -> TriangleMesh:
    points = np.zeros((N, 3))
    points[np.arange(SMALL.n_vertices) * STEP + 7] = SMALL.points
    return TriangleMesh.from_arrays(points, SMALL.faces * STEP + 7)


def test_indices_have_4_bytes_as_far_as_they_count():
    index = np.arange(3)
    assert matrix_indices(index, 3, LARGEST_INT32).dtype == np.int32
    assert matrix_indices(index.astype(np.int32), 3, LARGEST_INT32 + 1).dtype == np.int64


@pytest.mark.parametrize("name", MATRICES)
def test_matrices_of_a_mesh_with_large_vertex_numbers_hold_the_values_of_its_small_copy(name):
    small, large = MATRICES[name](SMALL), MATRICES[name](spread())
    assert small.indices.dtype == small.indptr.dtype == large.indices.dtype == np.int32
    vertex = np.arange(SMALL.n_vertices) * STEP + 7
    for axis in (0, 1):
        if large.shape[axis] == N:
            assert large.nnz == large[vertex].nnz if axis == 0 else large[:, vertex].nnz
            large = large[vertex] if axis == 0 else large[:, vertex]
    assert large.shape == small.shape and abs(large - small).max() <= 1e-14 * abs(small).max()


def test_intrinsic_delaunay_of_large_vertex_numbers_is_that_of_the_small_copy():
    small, large = (laplace_operator(m, "intrinsic-delaunay") for m in (SMALL, spread()))
    vertex = np.arange(SMALL.n_vertices) * STEP + 7
    cut = large.stiffness[vertex][:, vertex]
    assert (
        large.preparation["flips"] == small.preparation["flips"]
        and cut.nnz == large.stiffness.nnz == small.stiffness.nnz
    )
    assert abs(cut - small.stiffness).max() <= 1e-14 * abs(small.stiffness).max()


def test_hessians_have_4_byte_indices():
    assembly = Assembly(np.ones((SMALL.n_vertices, 3), dtype=bool), [SMALL.faces])
    block = np.tile(np.eye(9), (SMALL.n_faces, 1, 1))
    matrix = assembly.matrix([block], np.zeros(SMALL.n_vertices))
    assert matrix.indices.dtype == matrix.indptr.dtype == np.int32
    valence = np.bincount(SMALL.faces.ravel())
    assert np.array_equal(matrix.diagonal(), np.repeat(valence, 3))
