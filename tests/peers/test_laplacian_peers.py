"""The same matrices as libigl, and the same spectra as the independent solvers of scipy."""

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.mesh import shapes
from ddgcli.operators import laplacian as lap

MESHES = {
    "irregular sphere": shapes.random_sphere(2000),
    "torus": shapes.torus(),
    "grid": shapes.grid(20, 13),
    "stretched": shapes.random_sphere(1000).moved(shapes.random_sphere(1000).points * [10.0, 1.0, 0.1]),
}


@pytest.mark.parametrize("name", MESHES)
def test_libigl_matrices(name):
    igl = pytest.importorskip("igl")
    mesh = MESHES[name]
    V, F = np.array(mesh.points), np.array(mesh.faces)
    L = lap.stiffness(mesh)
    assert abs(L + igl.cotmatrix(V, F)).max() < 1e-12 * abs(L).max()
    kinds = {
        lap.lumped_mass: igl.MASSMATRIX_TYPE_BARYCENTRIC,
        lap.voronoi_mass: igl.MASSMATRIX_TYPE_VORONOI,
        lap.galerkin_mass: igl.MASSMATRIX_TYPE_FULL,
    }
    for ours, kind in kinds.items():
        M = igl.massmatrix(V, F, kind)
        assert abs(ours(mesh) - M).max() < 1e-12 * abs(M).max()


@pytest.mark.parametrize("mass", [lap.lumped_mass, lap.galerkin_mass])
def test_scipy_eigenvalues(mass):
    mesh = MESHES["irregular sphere"]
    L, M = lap.stiffness(mesh), mass(mesh)
    found = smallest_eigenpairs(L, M, 30)
    expected = eigsh(L.tocsc(), 30, M.tocsc(), sigma=-1e-3, return_eigenvectors=False)
    assert np.abs(found.values - np.sort(expected)).max() < 1e-9 * found.values[-1]
    assert found.complete
