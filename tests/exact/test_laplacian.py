"""Identities of the Laplacian and its masses, on good, bad and degenerate meshes."""

import re

import numpy as np
import pytest
import scipy.linalg
from scipy.sparse import csr_array

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator, negative_weights, symmetry_residual
from ddgcli.algorithms.laplacian.spectrum import heat_kernel_signature, signature_pairs, spectrum
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.eigen import Eigenpairs
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators import laplacian as lap
from ddgcli.operators.mollify import mollify_mesh
from tests.delaunay_cases import non_delaunay_sphere

MESHES = {
    "sphere": shapes.icosphere(2),
    "irregular": shapes.random_sphere(300),
    "torus": shapes.torus(),
    "grid": shapes.grid(7, 5, pattern="alternating"),
    "cylinder": shapes.cylinder(),
}
MASSES = [lap.lumped_mass, lap.voronoi_mass, lap.galerkin_mass]


@pytest.mark.parametrize("name", MESHES)
def test_symmetric_semidefinite_with_constants_as_null_space(name):
    L = lap.stiffness(MESHES[name])
    assert abs(L - L.T).max() == 0
    assert np.abs(L @ np.ones(L.shape[0])).max() < 1e-13
    values = np.linalg.eigvalsh(L.toarray())
    assert abs(values[0]) < 1e-13 and values[1] > 1e-3


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("mass", MASSES)
def test_masses_sum_to_the_area(name, mass):
    mesh = MESHES[name]
    M = mass(mesh)
    area = face_area(mesh.side_length).sum()
    assert abs(M.sum() / area - 1) < 1e-14
    assert abs(M - M.T).max() == 0
    assert np.linalg.eigvalsh(M.toarray())[0] > 0


def test_dirichlet_energy_of_linear_functions_is_exact():
    mesh = shapes.grid(6, 9, 2.0, 3.0)
    f = mesh.points @ np.array([2.0, -1.0, 0.0])
    assert abs(f @ (lap.stiffness(mesh) @ f) - 6.0 * 5.0) < 1e-12
    interior = ~mesh.topology.boundary_vertex
    assert np.abs((lap.stiffness(mesh) @ f)[interior]).max() < 1e-13
    assert abs(f @ (lap.galerkin_mass(mesh) @ f) - _integral_of_square()) < 1e-12


def _integral_of_square():
    """Of (2x - y)^2 over [0, 2] x [0, 3], by hand: 4 * 8/3 * 3 - 4 * 2 * 9/2 + 9 * 2."""
    return 4 * 8 / 3 * 3 - 4 * 2 * 4.5 + 9 * 2


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("scale", [1e-150, 1e-8, 1e8, 1e150])
def test_scale_changes_nothing_but_the_mass(name, scale):
    mesh = MESHES[name]
    other = mesh.moved(mesh.points * scale)
    L = lap.stiffness(mesh)
    assert abs(lap.stiffness(other) - L).max() < 1e-13 * abs(L).max()
    for mass in MASSES if 1e-100 < scale < 1e100 else []:
        assert abs(mass(other) / scale**2 - mass(mesh)).max() < 1e-14 * abs(mass(mesh)).max()


def test_lengths_alone_and_relabelling_give_the_same_matrix():
    mesh = MESHES["irregular"]
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    assert abs(lap.stiffness(intrinsic) - lap.stiffness(mesh)).max() == 0
    p = np.random.default_rng(0).permutation(mesh.n_vertices)
    inverse = np.argsort(p)
    moved = TriangleMesh.from_arrays(mesh.points[p], inverse[mesh.faces][:, [1, 2, 0]])
    assert abs(lap.stiffness(moved) - lap.stiffness(mesh)[p][:, p]).max() < 1e-12
    assert np.allclose(lap.voronoi_vertex_area(moved), lap.voronoi_vertex_area(mesh)[p], rtol=1e-13)


def test_uniform_counts_neighbours():
    mesh = shapes.grid(3, 3)
    L = lap.uniform_stiffness(mesh)
    edges = mesh.topology.edges
    assert np.array_equal(L.diagonal(), np.bincount(edges.ravel(), minlength=mesh.n_vertices))
    assert (L[edges[:, 0], edges[:, 1]] == -1).all()
    assert np.abs(L @ np.ones(mesh.n_vertices)).max() == 0


def test_degenerate_faces_are_mollified_with_a_warning(caplog):
    mesh = non_delaunay_sphere()
    _, mollification = mollify_mesh(mesh)
    assert len(mollification.faces) == 3
    assert 3 < mollification.edges < 30
    assert mollification.largest_change < 1e-7
    L = lap.stiffness(mesh)
    assert np.isfinite(L.data).all()
    assert "mollified" in caplog.text
    values = np.linalg.eigvalsh(L.toarray())
    assert abs(values[0]) < 1e-6 and values[1] > 1e-3
    for mass in MASSES:
        assert np.isfinite(mass(mesh).data).all()


def test_nothing_is_mollified_where_nothing_is_degenerate():
    for mesh in MESHES.values():
        assert mollify_mesh(mesh)[0] is mesh


def test_mesh_without_area_is_refused():
    line = TriangleMesh.from_arrays(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match="the only face has no area"):
        lap.stiffness(line)


@pytest.mark.parametrize("row, column", [(0, 1), (0, 3)])
def test_symmetry_residual_is_the_largest_difference_to_the_transposed_matrix(row, column):
    matrix = np.array([[2.0, -1, 0, 0], [-1, 2, -1, 0], [0, -1, 2, -1], [0, 0, -1, 1]])
    assert symmetry_residual(csr_array(matrix)) == 0
    matrix[row, column] += 0.5
    assert symmetry_residual(csr_array(matrix)) == 0.25
    assert negative_weights(csr_array(matrix)) == (0 if column == 1 else 1)


def test_the_heat_kernel_of_many_components_holds_at_least_their_constants(caplog):
    """More components than pairs: the signature was 0 on those beyond."""
    one, count = shapes.icosphere(0), 400
    scale = np.linspace(1.0, 1.5, count)
    points = (scale[:, None, None] * one.points + np.arange(count)[:, None, None] * [4.0, 0, 0]).reshape(
        -1, 3
    )
    faces = (one.faces + one.n_vertices * np.arange(count)[:, None, None]).reshape(-1, 3)
    operator = laplace_operator(TriangleMesh.from_arrays(points, faces))
    pairs = spectrum(operator, signature_pairs(operator, [10.0]))
    assert (pairs.values == 0).all() and len(pairs.values) < count
    signature = heat_kernel_signature(operator, pairs, np.array([10.0]))
    area = scale**2 * face_area(one.side_length).sum()
    np.testing.assert_allclose(
        signature.values[:, 0].reshape(count, -1), 1 / area[:, None] + 0 * points[:12, 0]
    )
    assert signature.truncation[0] > 0.9 and "do not resolve the heat kernel" in caplog.text


SIGNATURES = {
    "sphere": (shapes.icosphere(2), 60),
    "random": (shapes.random_sphere(300), 60),
    "torus": (shapes.torus(24, 18), 90),
    "stretched": (shapes.grid(15, 15).moved(shapes.grid(15, 15).points ** [3, 2, 1]), 60),
    "box": (shapes.box_tetrahedra(5, 5, 5), 80),
}


@pytest.mark.parametrize("weight", [0.3, 0.03, 1e-4])
@pytest.mark.parametrize("name", SIGNATURES)
def test_the_truncation_of_a_heat_kernel_is_0_4_to_2_times_its_error(name, weight):
    """The weight of the last function was down to 0.12 times the error against the dense sum."""
    mesh, k = SIGNATURES[name]
    operator = laplace_operator(mesh)
    values, vectors = scipy.linalg.eigh(operator.stiffness.toarray(), operator.mass.toarray())
    times = -np.log([weight]) / values[k - 1]
    signature = heat_kernel_signature(operator, spectrum(operator, k), times)
    whole = vectors**2 @ np.exp(-np.outer(np.maximum(values, 0.0), times))
    error = (1.0 - signature.values / whole).max()
    assert 0.4 < signature.truncation[0] / error < 2.0


def test_all_eigenpairs_of_the_used_vertices_leave_no_truncation():
    mesh = shapes.icosphere(1)
    mesh = TriangleMesh.from_arrays(np.concatenate([mesh.points, [[9.0, 9.0, 9.0]]]), mesh.faces)
    operator = laplace_operator(mesh)
    signature = heat_kernel_signature(operator, spectrum(operator, mesh.n_vertices - 1), np.array([1e-3]))
    assert signature.truncation[0] == 0.0


@pytest.mark.parametrize("level", [1, 2])
def test_times_that_the_mesh_does_not_resolve_have_a_warning_with_one_that_it_does(level, caplog):
    """All pairs leave no truncation, and values end at 1 / mass: wrong by factors of up to 200 in silence."""
    mesh, degree = shapes.icosphere(level), np.arange(400)
    squared_edge = np.mean(mesh.side_length**2)
    operator = laplace_operator(mesh)
    values, vectors = scipy.linalg.eigh(operator.stiffness.toarray(), operator.mass.toarray())
    pairs = Eigenpairs(np.where(values > 1e-9, values, 0.0), vectors, np.zeros_like(values), True, "dense")

    def error(time):
        caplog.clear()
        truth = ((2 * degree + 1) * np.exp(-degree * (degree + 1) * time)).sum() / (4 * np.pi)
        return np.abs(heat_kernel_signature(operator, pairs, np.array([time])).values / truth - 1).max()

    for multiple in (1e-3, 0.3, 1.0):
        assert error(multiple * squared_edge) > 0.15
        (message,) = caplog.messages
        assert "does not resolve the heat kernel" in message and "more eigenpairs change nothing" in message
    shortest = float(re.findall(r"at least (\S+),", message)[0])
    assert 4 < shortest / squared_edge < 10
    assert error(shortest) < 0.1 and not caplog.messages


def test_more_eigenpairs_are_the_advice_only_where_they_help(caplog):
    mesh = shapes.icosphere(3)
    operator = laplace_operator(mesh)
    heat_kernel_signature(
        operator, spectrum(operator, 20), np.array([1e-4, 10 * np.mean(mesh.side_length**2)])
    )
    short, truncated = caplog.messages
    assert "at time 0.0001" in short and "more eigenpairs change nothing" in short
    assert "or more eigenpairs" in truncated and "0.0001" not in truncated
