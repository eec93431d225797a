"""Wedge, interior product and Lie derivative on tetrahedra: identities, and convergence to smooth fields."""

import numpy as np
import pytest

from ddgcli.errors import MeshError
from ddgcli.geometry.remedies import remedy_for_bad_shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.form_products import form_products
from ddgcli.operators.stars import hodge_star
from ddgcli.operators.whitney import flux_vectors, interior_product, lie_derivative, wedge
from tests.exact.test_dec import MESHES, face_area_vectors, jittered_tets

SOLID: TetMesh = MESHES["tets"]  # a third of its cells are wrongly oriented
COMPLEX = complex_of(SOLID)
GAUSS = list(zip(0.5 + np.sqrt(0.15) * np.array([-1, 0, 1]), np.array([5, 8, 5]) / 18))
INNER, OUTER = 0.13819660112501053, 0.5854101966249685  # 4 points, exact for quadratics


def random_form(degree: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=COMPLEX.counts[degree])


def derivative(form: np.ndarray, degree: int) -> np.ndarray | float:
    return COMPLEX.derivatives[degree] @ form if degree < 3 else 0.0


@pytest.mark.parametrize("p, q", [(p, q) for p in range(3) for q in range(3 - p)])
def test_the_derivative_of_a_wedge_obeys_the_leibniz_rule(p, q):
    a, b = random_form(p, 1), random_form(q, 2)
    left = derivative(wedge(COMPLEX, a, b), p + q)
    right = wedge(COMPLEX, derivative(a, p), b) + (-1.0) ** p * wedge(COMPLEX, a, derivative(b, q))
    assert left == pytest.approx(right, abs=1e-12)


@pytest.mark.parametrize("p, q", [(p, q) for p in range(4) for q in range(4 - p)])
def test_a_wedge_commutes_up_to_the_sign_of_the_degrees(p, q):
    a, b = random_form(p, 1), random_form(q, 2)
    assert wedge(COMPLEX, a, b) == pytest.approx((-1.0) ** (p * q) * wedge(COMPLEX, b, a), abs=1e-13)
    if p == q == 1:
        assert np.abs(wedge(COMPLEX, a, a)).max() == 0


def test_the_wedge_of_closed_forms_is_closed():
    f, g = random_form(0, 1), random_form(0, 2)
    df, dg = derivative(f, 0), derivative(g, 0)
    assert np.abs(derivative(wedge(COMPLEX, df, dg), 2)).max() < 1e-13
    # a closed 1-form and a closed 2-form: the sum over the solid is the flux of f dd h = 0 of its boundary
    inner = np.where(COMPLEX.boundary_vertex, 0.0, f)
    whole = wedge(COMPLEX, derivative(inner, 0), derivative(random_form(1, 3), 1)).sum()
    assert abs(whole) < 1e-12


def test_products_of_constant_fields_are_exact():
    u, v, w = np.array([[1.0, -2.0, 0.5], [0.3, 1.0, 2.0], [-1.0, 0.2, 0.7]])
    along = SOLID.points[COMPLEX.edges[:, 1]] - SOLID.points[COMPLEX.edges[:, 0]]
    area = face_area_vectors(SOLID)
    volume = np.abs(SOLID.signed_volume)
    field = np.tile(v, (len(volume), 1))
    assert wedge(COMPLEX, along @ u, along @ v) == pytest.approx(area @ np.cross(u, v), abs=1e-14)
    assert wedge(COMPLEX, along @ u, area @ w) == pytest.approx((u @ w) * volume, abs=1e-14)
    assert flux_vectors(SOLID, area @ w) == pytest.approx(np.tile(w, (len(volume), 1)), abs=1e-12)
    assert interior_product(SOLID, field, along @ u) == pytest.approx(u @ v, abs=1e-12)
    assert interior_product(SOLID, field, area @ w) == pytest.approx(along @ np.cross(w, v), abs=1e-13)
    assert interior_product(SOLID, field, 2.0 * volume) == pytest.approx(2.0 * area @ v, abs=1e-13)


def test_constants_pass_through_the_wedge_and_functions_multiply_the_cells():
    b = random_form(2)
    assert wedge(COMPLEX, np.full(COMPLEX.counts[0], 3.0), b) == pytest.approx(3.0 * b)
    x = SOLID.points[:, 0]
    centre = SOLID.points[SOLID.tetrahedra].mean(axis=1)[:, 0]
    volume = np.abs(SOLID.signed_volume)
    assert wedge(COMPLEX, x, volume) == pytest.approx(centre * volume)


@pytest.mark.parametrize("degree", range(3))
def test_the_lie_derivative_commutes_with_the_derivative(degree):
    field = np.random.default_rng(3).normal(size=(COMPLEX.counts[3], 3))
    form = random_form(degree)
    before = lie_derivative(SOLID, field, derivative(form, degree))
    after = derivative(lie_derivative(SOLID, field, form), degree)
    assert after == pytest.approx(before, abs=1e-11 * np.abs(before).max())


def test_residuals_of_products_that_vanish_are_of_the_order_of_rounding():
    """Constant fields and forms: both sides of each identity are zero but for rounding."""
    along = SOLID.points[COMPLEX.edges[:, 1]] - SOLID.points[COMPLEX.edges[:, 0]]
    area, v = face_area_vectors(SOLID), np.array([1.0, 2.0, -1.0])
    field = np.tile(v, (COMPLEX.counts[3], 1))
    for form in (area @ np.array([0.2, 0.7, 0.4]), area @ v):
        accuracy = form_products(SOLID, {"lie_derivative": (field, form)}).accuracy
        assert accuracy["lie_commutation_residual"] < 1e-12
    accuracy = form_products(SOLID, {"wedge": (along @ v, along @ np.array([0.2, 0.7, 0.4]))}).accuracy
    assert accuracy["leibniz_residual"] < 1e-12


# --- convergence: the field X, the function f, the vector proxy u of 1- and 2-forms ---


def field(p):
    return np.stack(
        [1 + p[..., 1] * p[..., 2], np.sin(p[..., 0]), p[..., 0] * p[..., 1] - p[..., 2]], axis=-1
    )


def function(p):
    return np.sin(2 * p[..., 0] + p[..., 1] - p[..., 2])


def proxy(p):
    return np.stack([np.cos(p[..., 1]), p[..., 0] * p[..., 2], np.sin(p[..., 0] + p[..., 1])], axis=-1)


def witness(p):
    return np.stack([np.sin(p[..., 2]), np.cos(p[..., 0] + p[..., 1]), p[..., 1] ** 2], axis=-1)


def jacobian(F, p, step=1e-5):
    return np.stack([(F(p + e) - F(p - e)) / (2 * step) for e in step * np.eye(3)], axis=-1)


def slope(F, p):
    return np.einsum("...ij,...j->...i", jacobian(F, p), field(p))


def divergence(p):
    return np.trace(jacobian(field, p), axis1=-2, axis2=-1)


def lie_of_function(p):
    return slope(lambda q: function(q)[..., None], p)[..., 0]


def lie_of_one_form(p):
    return slope(proxy, p) + np.einsum("...j,...ji->...i", proxy(p), jacobian(field, p))


def lie_of_flux(p):
    stretched = np.einsum("...ij,...j->...i", jacobian(field, p), proxy(p))
    return slope(proxy, p) - stretched + proxy(p) * divergence(p)[..., None]


def lie_of_density(p):
    return lie_of_function(p) + function(p) * divergence(p)


def edge_integrals(mesh, F):
    a, b = np.moveaxis(mesh.points[mesh.edges], 1, 0)
    return sum(w * (F(a + t * (b - a)) * (b - a)).sum(axis=1) for t, w in GAUSS)


def face_fluxes(mesh, F):
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    normal = 0.5 * np.cross(b - a, c - a)
    return sum((F(q) * normal).sum(axis=1) for q in ((a + b) / 2, (b + c) / 2, (c + a) / 2)) / 3


def cell_integrals(mesh, F):
    corners = mesh.points[mesh.tetrahedra]
    weights = INNER + (OUTER - INNER) * np.eye(4)
    return sum(F(np.einsum("mcd,c->md", corners, w)) for w in weights) / 4 * np.abs(mesh.signed_volume)


def forms_of(mesh, scalar, vector, flux, density):
    """Forms of degree 0 to 3 of smooth fields."""
    return (scalar(mesh.points), edge_integrals(mesh, vector), face_fluxes(mesh, flux),
            cell_integrals(mesh, density))  # fmt: skip


@pytest.fixture(scope="module")
def products():
    """Errors in L2 of interior products, and of Lie derivatives against smooth forms, on refined solids."""
    interior, lie = [], []
    for n in (3, 6, 12):
        mesh = jittered_tets(n)
        c = complex_of(mesh)
        star = [hodge_star(c, k) for k in range(4)]
        moving = field(mesh.points[mesh.tetrahedra].mean(axis=1))
        forms = forms_of(mesh, function, proxy, proxy, function)
        exact = forms_of(mesh, lie_of_function, lie_of_one_form, lie_of_flux, lie_of_density)
        smooth = forms_of(mesh, lambda p: function(p) + 1, witness, witness, lambda p: function(p) + 1)
        contracted = ((field(mesh.points) * proxy(mesh.points)).sum(axis=1),
                      edge_integrals(mesh, lambda p: np.cross(proxy(p), field(p))),
                      face_fluxes(mesh, lambda p: field(p) * function(p)[:, None]))  # fmt: skip
        interior.append([norm(interior_product(mesh, moving, forms[k + 1]) - contracted[k], star[k])
                         / norm(contracted[k], star[k]) for k in range(3)])  # fmt: skip
        lie.append([abs(smooth[k] @ star[k] @ (lie_derivative(mesh, moving, forms[k]) - exact[k]))
                    / norm(exact[k], star[k]) / norm(smooth[k], star[k]) for k in range(4)])  # fmt: skip
    return np.array(interior), np.array(lie)


def norm(form, star):
    return np.sqrt(form @ star @ form)


def test_interior_products_on_tetrahedra_converge_at_first_order(products):
    errors, _ = products
    assert np.log2(errors[:-1] / errors[1:]).min() > 1.0
    assert errors[-1].max() < 0.02


def test_lie_derivatives_on_tetrahedra_converge_at_first_order_against_smooth_forms(products):
    _, errors = products
    assert np.log2(errors[1] / errors[2]).min() > 0.8
    assert errors[-1].max() < 0.04


def test_cells_are_flat_in_every_position_and_numbering_and_wherever_their_lengths_are_those_of_flat_ones():
    """Near the tolerance a cell was flat or not by its rotation: refused, and left by the repair."""
    rng = np.random.default_rng(0)
    ends = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [0.5, 0, 1.0]])
    cells = np.array([[0, 1, 2, 3], [0, 1, 2, 4]])
    refused = 0
    for height in np.geomspace(1e-8, 1e-6, 30):
        points = ends + [0, 0, height] * (np.arange(5) == 2)[:, None]
        turned = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T
        meshes = [TetMesh.from_arrays(p, cells[:, rng.permutation(4)]) for p in (points, turned, turned)]
        flat = [len(mesh.flat_tetrahedra) for mesh in meshes]
        assert min(flat) == max(flat)
        for mesh in meshes:
            try:
                complex_of(mesh)
            except MeshError:
                refused += 1
                assert len(mesh.flat_tetrahedra) == 1
    assert 0 < refused < 90


@pytest.mark.parametrize(
    "height, text", [(1e-6, "mesh the body again"), (0.0, "repair_cells=drop_degenerate")]
)
def test_the_remedy_of_thin_cells_is_a_repair_only_where_cells_have_no_volume(height, text):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, height], [0.3, 0.3, 1.0]])
    mesh = TetMesh.from_arrays(points, np.array([[0, 1, 2, 3], [0, 1, 3, 4]]))
    assert text in remedy_for_bad_shapes(mesh)
