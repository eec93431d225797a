"""The same matrices as libigl, and the same spectra as the independent solvers of scipy."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.linalg import eigsh

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.io.mesh_file import read_mesh
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
def test_matrices_equal_those_of_libigl(name):
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
def test_eigenvalues_equal_those_of_scipy(mass):
    mesh = MESHES["irregular sphere"]
    L, M = lap.stiffness(mesh), mass(mesh)
    eigenpairs = smallest_eigenpairs(L, M, 30)
    expected = eigsh(L.tocsc(), 30, M.tocsc(), sigma=-1e-3, return_eigenvectors=False)
    assert np.abs(eigenpairs.values - np.sort(expected)).max() < 1e-9 * eigenpairs.values[-1]
    assert eigenpairs.complete


@pytest.mark.parametrize("name", ["irregular sphere", "torus", "stretched"])
def test_the_intrinsic_delaunay_laplacian_equals_that_of_libigl(name):
    igl = pytest.importorskip("igl")
    mesh = MESHES[name]
    L = laplace_operator(mesh, "intrinsic-delaunay").stiffness
    theirs = igl.intrinsic_delaunay_cotmatrix(np.array(mesh.points), np.array(mesh.faces))
    theirs = theirs[0] if isinstance(theirs, tuple) else theirs
    # lengths of flipped edges carry the rounding of both on slivers
    assert abs(L + theirs).max() < 1e-7 * abs(L).max()


def closed_and_open(shared_meshes):
    yield read_mesh(str(shared_meshes / "spot.obj")).mesh
    yield read_mesh(str(shared_meshes / "hemisphere.off")).mesh
    yield read_mesh(str(shared_meshes / "goathead.obj")).mesh


def test_spectra_of_the_tufted_laplacian_equal_those_of_robust_laplacian(shared_meshes):
    robust_laplacian = pytest.importorskip("robust_laplacian")
    for mesh in closed_and_open(shared_meshes):
        L, M = robust_laplacian.mesh_laplacian(
            np.array(mesh.points), np.array(mesh.faces), mollify_factor=0.0
        )
        theirs = smallest_eigenpairs(csr_array(L), csr_array(M), 20).values
        tufted = laplace_operator(mesh, "tufted")
        ours = smallest_eigenpairs(tufted.stiffness, tufted.mass, 20).values
        assert np.abs(ours - theirs).max() < 1e-8 * theirs.max()


def test_default_mollification_of_robust_laplacian_is_where_we_differ():
    """Their default lengthens every edge of a mesh with slivers; ours leaves all of them as they are."""
    robust_laplacian = pytest.importorskip("robust_laplacian")
    mesh = MESHES["stretched"]
    ours = laplace_operator(mesh, "tufted").stiffness
    V, F = np.array(mesh.points), np.array(mesh.faces)
    exact, mollified = (robust_laplacian.mesh_laplacian(V, F, mollify_factor=f)[0] for f in (0.0, 1e-2))
    assert abs(ours - exact).max() < 1e-7 * abs(exact).max()
    assert abs(ours - mollified).max() > 1e-3 * abs(exact).max()
