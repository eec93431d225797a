"""Hodge decomposition against known fields, potentials and harmonic forms; Whitney calculus."""

import numpy as np
import pytest

from ddgcli.algorithms.hodge.decomposition import (
    decompose_cell_vectors,
    decompose_form,
    decompose_vertex_vectors,
    tangent_part,
)
from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.algorithms.hodge.hodge_analysis import hodge_analysis
from ddgcli.algorithms.hodge.homology import betti_numbers
from ddgcli.errors import ParameterError
from ddgcli.geometry.extrinsic import face_normal
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.stars import hodge_star
from ddgcli.operators.whitney import flat, interior_product, lie_derivative, sharp, wedge, whitney_load
from tests.exact.test_dec import MESHES
from tests.exact.test_homology import hollow_tets, ring_tets


def rotated(mesh: TriangleMesh, seed: int = 3) -> TriangleMesh:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return mesh.moved(mesh.points @ (q * np.sign(np.linalg.det(q))).T + [1, 2, 3])


def annulus(n: int, inner: float = 1.0, outer: float = 2.0) -> TriangleMesh:
    """Flat annulus, n cells across."""
    u, v, faces = shapes.wrapped_grid(9 * n + n % 2, n, wrap_u=True, pattern="alternating")
    r, a = inner + (outer - inner) * v, -2 * np.pi * u
    return TriangleMesh.from_arrays(np.stack([r * np.cos(a), r * np.sin(a), 0 * a], axis=1), faces)


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("name", MESHES)
def test_parts_are_orthogonal_and_sum_to_the_field(name, boundary):
    mesh = MESHES[name]
    c = complex_of(mesh)
    rng = np.random.default_rng(0)
    split = decompose_form(mesh, rng.normal(size=c.counts[1]), boundary)
    vectors = rng.normal(size=(len(c.corners), 3))
    for result in (split, decompose_cell_vectors(mesh, vectors, boundary)):
        assert result.orthogonality < 1e-12
        assert result.reconstruction_residual < 1e-10
        assert result.harmonic_residual < 1e-10
        squares = sum(result.norms[component] ** 2 for component in ("exact", "coexact", "harmonic"))
        assert squares == pytest.approx(result.norms["field"] ** 2, rel=1e-10)


@pytest.mark.parametrize("place", ["cell", "vertex"])
@pytest.mark.parametrize("noise", [0.0, 1e-13, 1e-8])
def test_a_normal_field_has_no_parts_and_its_rounding_is_no_residual(place, noise):
    """The tangent part of a normal field is rounding, and its parts were not its sum to a digit: exit 1."""
    tangent = noise * np.random.default_rng(0).normal(size=(320, 3))
    sphere, square = rotated(shapes.icosphere(2)), rotated(shapes.grid(8, 8))
    for mesh in (sphere, square) if place == "cell" else (square,):
        normal = (
            face_normal(mesh) if place == "cell" else np.tile(face_normal(mesh)[:1], (mesh.n_vertices, 1))
        )
        result = hodge_analysis(mesh, (normal + tangent[: len(normal)], place), "tangential", False)
        assert result.converged and result.accuracy["orthogonality"] < 1e-12
        assert place == "vertex" or result.accuracy["reconstruction_residual"] < 1e-12
        assert result.results["norms"]["field"] < 100 * max(noise, 1e-15)


def test_known_parts_of_a_form_are_recovered():
    mesh = MESHES["torus"]
    c = complex_of(mesh)
    rng = np.random.default_rng(5)
    exact = c.derivatives[0] @ rng.normal(size=c.counts[0])
    coexact = np.linalg.solve(hodge_star(c, 1).toarray(), c.derivatives[1].T @ rng.normal(size=c.counts[2]))
    harmonic = np.array([2.0, -1.0]) @ harmonic_basis(mesh).forms
    split = decompose_form(mesh, exact + coexact + harmonic)
    for component, expected in ((split.exact, exact), (split.coexact, coexact), (split.harmonic, harmonic)):
        assert np.abs(component - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("name", ["torus", "annulus", "ring", "shell"])
def test_harmonic_basis_is_orthonormal_and_of_the_right_size(name, boundary):
    mesh = (MESHES | {"ring": ring_tets(), "shell": hollow_tets()})[name]
    betti = betti_numbers(mesh)
    basis = harmonic_basis(mesh, boundary)
    count = (betti.absolute if boundary == "tangential" else betti.relative)[1]
    star1 = hodge_star(complex_of(mesh), 1)
    assert len(basis.forms) == count
    assert np.abs(basis.forms @ star1 @ basis.forms.T - np.eye(count)).max(initial=0) < 1e-10
    assert basis.residual < 1e-9


def test_harmonic_fields_of_the_torus_converge():
    """d phi is harmonic on a torus of revolution: what is not found harmonic falls with h."""
    error = []
    for n in (16, 32, 64):
        mesh = shapes.torus(2 * n, n, major=2.0, minor=1.0)
        x, y, _ = mesh.points[mesh.faces].mean(axis=1).T
        field = np.stack([-y, x, 0 * x], axis=1) / (x**2 + y**2)[:, None]
        field, _ = tangent_part(mesh, field)
        split = decompose_cell_vectors(mesh, field)
        error.append(np.hypot(split.norms["exact"], split.norms["coexact"]) / split.norms["field"])
    rate = np.log2(np.array(error[:-1]) / error[1:])
    assert rate[-1] > 0.9 and error[-1] < 0.03


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
def test_harmonic_fields_of_an_annulus(boundary):
    """The circulating field e_theta / r is tangential, the radial e_r / r normal."""
    error = []
    for n in (6, 12, 24):
        mesh = annulus(n)
        x, y, _ = mesh.points[mesh.faces].mean(axis=1).T
        r2 = (x**2 + y**2)[:, None]
        circulating, radial = np.stack([-y, x, 0 * x], 1) / r2, np.stack([x, y, 0 * x], 1) / r2
        own, other = (circulating, radial) if boundary == "tangential" else (radial, circulating)
        split = decompose_cell_vectors(mesh, own, boundary)
        error.append(1 - split.norms["harmonic"] / split.norms["field"])
        assert decompose_cell_vectors(mesh, other, boundary).norms["harmonic"] < 1e-3 * split.norms["field"]
    assert np.log2(error[-2] / error[-1]) > 1.8
    assert error[-1] < 2e-3


def test_the_decomposition_follows_scale_and_rigid_motion():
    mesh, rng = MESHES["torus"], np.random.default_rng(2)
    form = rng.normal(size=mesh.topology.n_edges)
    base = decompose_form(mesh, form)
    for moved in (rotated(mesh), mesh.moved(1e-8 * mesh.points), mesh.moved(1e8 * mesh.points)):
        other = decompose_form(moved, form)
        for component in ("exact", "coexact", "harmonic"):
            assert np.abs(getattr(other, component) - getattr(base, component)).max() < 1e-9


def test_vertex_fields_lose_only_the_averages():
    """The remainder of the two averages falls with h on a smooth field."""
    residuals = []
    for level in (3, 4):
        mesh = shapes.icosphere(level)
        split = decompose_vertex_vectors(mesh, np.cross(mesh.points, [0.0, 0.0, 1.0]))
        assert split.norms["coexact"] > 0.999 * split.norms["field"]
        residuals.append(split.reconstruction_residual)
    assert residuals[1] < 0.6 * residuals[0] < 0.02


@pytest.mark.parametrize("name", ["irregular", "tets"])
def test_sharp_of_flat_reproduces_constants(name):
    mesh = MESHES[name]
    field = np.array([1.0, 2.0, 3.0])
    vectors = np.tile(field, (mesh.n_vertices, 1))
    computed = sharp(mesh, flat(mesh, vectors))
    expected = np.tile(field, (len(computed), 1))
    if isinstance(mesh, TriangleMesh):
        expected, _ = tangent_part(mesh, expected)
    assert np.abs(computed - expected).max() < 1e-12
    c = complex_of(mesh)
    load = whitney_load(mesh, np.tile(field, (len(c.corners), 1)))
    assert load == pytest.approx(hodge_star(c, 1) @ flat(mesh, vectors), abs=1e-12)


def test_wedge_is_antisymmetric_and_obeys_leibniz():
    c = complex_of(MESHES["irregular"])
    rng = np.random.default_rng(0)
    f, g = rng.normal(size=(2, c.counts[0]))
    a, b = rng.normal(size=(2, c.counts[1]))
    d0, d1 = c.derivatives
    assert np.abs(wedge(c, a, b) + wedge(c, b, a)).max() < 1e-14
    assert d0 @ wedge(c, f, g) == pytest.approx(wedge(c, d0 @ f, g) + wedge(c, f, d0 @ g), abs=1e-12)
    closed = d0 @ g
    assert d1 @ wedge(c, f, closed) == pytest.approx(wedge(c, d0 @ f, closed), abs=1e-12)


def test_lie_derivative_commutes_with_d_and_moves_functions():
    mesh = MESHES["irregular"]
    c = complex_of(mesh)
    rng = np.random.default_rng(0)
    vectors, _ = tangent_part(mesh, rng.normal(size=(mesh.n_faces, 3)))
    f = rng.normal(size=c.counts[0])
    left = c.derivatives[0] @ lie_derivative(mesh, vectors, f)
    assert left == pytest.approx(lie_derivative(mesh, vectors, c.derivatives[0] @ f), abs=1e-10)
    linear = shapes.grid(6, 6)
    slope = lie_derivative(linear, np.tile([3.0, 4.0, 0.0], (linear.n_faces, 1)), linear.points[:, 0])
    assert slope == pytest.approx(3.0)


def test_interior_product_of_the_area_form_is_the_turned_field():
    mesh = shapes.grid(8, 8, pattern="alternating")
    c = complex_of(mesh)
    field = np.tile([2.0, 1.0, 0.0], (mesh.n_faces, 1))
    contraction = interior_product(mesh, field, c.metric.measure)
    turned = np.tile([-1.0, 2.0, 0.0], (mesh.n_vertices, 1))
    assert contraction == pytest.approx(flat(mesh, turned), abs=1e-12)


@pytest.mark.parametrize("place", ["cell", "edge"])
@pytest.mark.parametrize("seed", range(4))
def test_a_harmonic_field_leaves_no_warning_of_rounding(place, seed, caplog):
    """On a cylinder the field along the axis is harmonic for `normal`: its copotential is rounding."""
    mesh = shapes.cylinder(24, 8)
    turned = rotated(mesh, seed)
    axis = (
        turned.points[-1]
        - turned.points[np.argmin(((mesh.points - mesh.points[-1] * [1, 1, 0]) ** 2).sum(1))]
    )
    if place == "edge":
        ends = turned.points[complex_of(turned).edges]
        split = decompose_form(turned, (ends[:, 1] - ends[:, 0]) @ axis, "normal")
    else:
        vectors = np.tile(axis, (turned.n_faces, 1))
        split = decompose_cell_vectors(turned, tangent_part(turned, vectors)[0], "normal")
    assert split.norms["coexact"] < 1e-12 * split.norms["field"]
    assert split.norms["harmonic"] == pytest.approx(split.norms["field"], rel=1e-12)
    assert "does not sum to zero" not in caplog.text


@pytest.mark.parametrize("place", ["vertex", "cell", "edge"])
@pytest.mark.parametrize("name", ["torus", "solid"])
def test_parts_of_tiny_and_huge_fields_are_those_of_the_field_to_the_last_digit(place, name):
    """Squares of sizes below 1e-162 or above 1e154 leave double precision; powers of two change no digit."""
    mesh = rotated(shapes.torus(12, 8)) if name == "torus" else shapes.box_tetrahedra(2, 2, 2)
    c = complex_of(mesh)
    shape = {"vertex": (mesh.n_vertices, 3), "cell": (len(c.corners), 3), "edge": c.counts[1]}[place]
    field = np.random.default_rng(1).normal(size=shape)
    truth = hodge_analysis(mesh, (field, place), "tangential", False)
    kind = "face" if place == "cell" else place
    for exponent in (-900, -565, 600, 1000):
        run = hodge_analysis(mesh, (np.ldexp(field, exponent), place), "tangential", False)
        assert run.converged == truth.converged and run.accuracy == truth.accuracy
        for name_of_norm, norm in truth.results["norms"].items():
            assert run.results["norms"][name_of_norm] == np.ldexp(norm, exponent) > 0 or norm == 0
        for array in ("exact", "coexact", "harmonic"):
            values = getattr(truth.annotated, kind)[array]
            assert np.array_equal(getattr(run.annotated, kind)[array], np.ldexp(values, exponent))
    if place != "edge":  # vectors of length 1.7e308 over an area or a volume of 1 and more
        with pytest.raises(ParameterError, match="norms are beyond 1e308; rescale"):
            hodge_analysis(mesh, (np.full(shape, np.ldexp(0.99, 1024)), place), "tangential", False)
