"""Exported operators: adjointness, kernels, and agreement with products of derivatives and stars."""

import tracemalloc
from tempfile import TemporaryFile

import numpy as np
import pytest

from ddgcli.cli.commands.dec import write_archive
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators import dec_matrices as module
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import dec_matrices
from ddgcli.operators.laplacian import stiffness
from ddgcli.operators.stars import diagonal_star, hodge_star

STARS = ("circumcentric", "barycentric", "galerkin")


def solid():
    """Irregular tetrahedra."""
    from scipy.spatial import Delaunay

    points = np.random.default_rng(5).random((70, 3))
    tetrahedra = Delaunay(points).simplices
    edge = points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]
    return TetMesh.from_arrays(points, tetrahedra[np.abs(np.linalg.det(edge)) > 1e-4])


def irregular_torus():
    """A torus without co-circular pairs of triangles."""
    torus = shapes.torus(15, 9)
    return torus.moved(torus.points + 0.02 * np.random.default_rng(1).standard_normal(torus.points.shape))


MESHES = {"torus": irregular_torus(), "sphere": shapes.random_sphere(200), "solid": solid()}


def test_every_matrix_has_the_indices_of_4_bytes_that_its_memory_is_estimated_by():
    for star in STARS:
        matrices = dec_matrices(complex_of(MESHES["sphere"]), star).matrices
        assert {m.indices.dtype.itemsize + m.data.dtype.itemsize for m in matrices.values()} == {12}


def test_matrices_above_the_limit_of_memory_of_the_process_are_refused(monkeypatch):
    mesh = shapes.random_sphere(200)
    monkeypatch.setattr("ddgcli.memory.available_memory", lambda: 2.0**18)
    with pytest.raises(ParameterError, match="above 0.000244 GiB; remesh around vertex"):
        dec_matrices(complex_of(mesh))


def test_the_estimate_of_a_vertex_of_high_valence_is_the_peak_of_the_whole_command(monkeypatch):
    random = np.random.default_rng(0)
    angle = (np.arange(1500) + random.random(1500)) * 2 * np.pi / 1500  # no entry cancels
    rim = np.stack([np.cos(angle), np.sin(angle), 0.1 * random.random(1500)], axis=1)
    faces = [[0, 1 + k, 1 + (k + 1) % 1500] for k in range(1500)]
    mesh = TriangleMesh.from_arrays(np.append([[0.0, 0.0, 0.3]], rim, axis=0), np.array(faces))
    estimates = []
    monkeypatch.setattr(module, "check_memory", lambda estimate, *text: estimates.append(estimate))
    tracemalloc.start()
    operators = dec_matrices(complex_of(mesh))
    operators.symmetry_residual()
    with TemporaryFile() as file:
        write_archive(file, operators, mesh.points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # the peak holds some small arrays too, and with scipy 1.15 a copy more of the 1500^2 entries of 12 bytes
    assert 0.97 * (peak - 1500**2 * 12) < max(estimates) < 1.3 * peak


@pytest.mark.parametrize("star", STARS)
@pytest.mark.parametrize("name", MESHES)
def test_codifferentials_are_adjoint_to_derivatives(name, star):
    operators = dec_matrices(complex_of(MESHES[name]), star)
    assert operators.derivative_residual() == 0
    random = np.random.default_rng(0)
    for degree in range(1, operators.complex_.dimension + 1):
        a, b = (random.standard_normal(operators.complex_.counts[k]) for k in (degree, degree - 1))
        codifferential = operators.matrices[f"codifferential{degree}"] @ a
        left = b @ (diagonal_star(operators.complex_, degree - 1, star) * codifferential)
        right = (operators.matrices[f"d{degree - 1}"] @ b) @ operators.matrices[f"star{degree}"] @ a
        assert left == pytest.approx(right, rel=1e-9)


@pytest.mark.parametrize("name", MESHES)
def test_laplacians_are_sums_of_derivatives_between_diagonal_stars(name):
    complex_ = complex_of(MESHES[name])
    operators = dec_matrices(complex_, "circumcentric")
    d = complex_.derivatives
    star = [hodge_star(complex_, k, "circumcentric").diagonal() for k in range(len(d) + 1)]
    for degree, count in enumerate(complex_.counts):
        form = np.random.default_rng(degree).standard_normal(count)
        expected = np.zeros(count)
        if degree < len(d):
            expected += d[degree].T @ (star[degree + 1] * (d[degree] @ form))
        if degree > 0:
            divergence = d[degree - 1].T @ (star[degree] * form) / star[degree - 1]
            expected += star[degree] * (d[degree - 1] @ divergence)
        assert np.allclose(
            operators.matrices[f"laplacian{degree}"] @ form,
            expected,
            rtol=1e-9,
            atol=1e-7 * abs(expected).max(),
        )
    assert operators.symmetry_residual() < 1e-12 and operators.constant_residual() < 1e-12


def test_laplacian0_is_the_cotangent_matrix_and_laplacian1_has_two_harmonic_forms_on_a_torus():
    torus = irregular_torus()
    operators = dec_matrices(complex_of(torus), "barycentric")
    values = np.linalg.eigvalsh(operators.matrices["laplacian1"].toarray())
    assert (np.abs(values) < 1e-9 * values[-1]).sum() == 2
    circumcentric = dec_matrices(complex_of(torus), "circumcentric")
    assert abs(circumcentric.matrices["laplacian0"] - stiffness(torus)).max() < 1e-12


def test_a_planted_sign_shows_in_the_derivative_residual():
    complex_ = complex_of(shapes.torus(9, 7))
    wrong = complex_.derivatives[1].copy()
    wrong.data[0] *= -1
    object.__setattr__(complex_, "derivatives", (complex_.derivatives[0], wrong))
    assert dec_matrices(complex_, "barycentric").derivative_residual() == 2


def test_a_star_that_vanishes_is_refused_with_another_star_as_remedy():
    grid = complex_of(shapes.grid(4, 4))
    with pytest.raises(MeshError, match="use `star=galerkin`"):
        dec_matrices(grid, "circumcentric")
    assert dec_matrices(grid, "barycentric").negative_entries == 0


@pytest.mark.parametrize("star", STARS)
def test_components_of_far_different_sizes_have_the_operators_of_each(star):
    one = irregular_torus()
    n, small = one.n_vertices, 2.0**-26  # a power of two scales without rounding
    both = TriangleMesh.from_arrays(
        np.concatenate([one.points, small * one.points]), np.concatenate([one.faces, one.faces + n])
    )
    alone, matrices = (dec_matrices(complex_of(mesh), star).matrices for mesh in (one, both))
    for name, power in (("laplacian0", 0), ("codifferential1", -2), ("laplacian2", -4)):
        truth, shape = alone[name], alone[name].shape
        assert abs(matrices[name][: shape[0]][:, : shape[1]] - truth).max() <= 1e-12 * abs(truth).max()
        rest = matrices[name][shape[0] :][:, shape[1] :] / small**power
        assert abs(rest - truth).max() <= 1e-12 * abs(truth).max()
