"""Exterior derivatives are exact; the three stars agree where theory predicts it."""

import gc
from copy import copy
from itertools import combinations
from math import factorial
from weakref import ref

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import form_laplacian
from ddgcli.operators.laplacian import stiffness
from ddgcli.operators.stars import hodge_star

STARS = ["circumcentric", "barycentric", "galerkin"]


def jittered_tets(n: int = 3, seed: int = 0) -> TetMesh:
    """Unit cube split in 6 n^3 tetrahedra, inner vertices jittered, a third of them wrongly oriented."""
    i, j, k = np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij")
    points = np.stack([i, j, k], axis=-1).reshape(-1, 3) / n
    inner = ((points > 0) & (points < 1)).all(axis=1)
    rng = np.random.default_rng(seed)
    points[inner] += rng.uniform(-0.15, 0.15, (inner.sum(), 3)) / n
    first = (i[:-1, :-1, :-1] * (n + 1) ** 2 + j[:-1, :-1, :-1] * (n + 1) + k[:-1, :-1, :-1]).ravel()
    stride = np.array([(n + 1) ** 2, n + 1, 1])
    tets = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        step = np.zeros((4, 3), dtype=int)
        for row, axis in enumerate(order, start=1):
            step[row] = step[row - 1]
            step[row, axis] += 1
        tets.append(first[:, None] + step @ stride)
    tets = np.concatenate(tets)
    tets[::3] = tets[::3][:, [1, 0, 2, 3]]
    return TetMesh.from_arrays(points, tets)


MESHES = {
    "torus": shapes.torus(12, 7),
    "annulus": shapes.cylinder(9, 3),
    "irregular": shapes.random_sphere(60),
    "tets": jittered_tets(),
}


@pytest.mark.parametrize("name", MESHES)
def test_dd_is_exactly_zero(name):
    derivatives = complex_of(MESHES[name]).derivatives
    for lower, upper in zip(derivatives, derivatives[1:]):
        product = upper.astype(np.int64) @ lower.astype(np.int64)
        assert abs(product).max() == 0
        assert product.dtype.kind == "i"


def test_derivatives_leave_the_mesh_as_it_was():
    mesh = shapes.torus(5, 4)
    before = mesh.topology.side_edge.copy()
    complex_of(mesh)
    assert (mesh.topology.side_edge == before).all()


@pytest.mark.parametrize("kind", ["circumcentric", "galerkin"])
def test_star_one_gives_the_cotangent_stiffness(kind):
    mesh = MESHES["irregular"]
    c = complex_of(mesh)
    weak = c.derivatives[0].T @ hodge_star(c, 1, kind) @ c.derivatives[0]
    assert abs(weak - stiffness(mesh)).max() < 1e-12 * abs(stiffness(mesh)).max()


@pytest.mark.parametrize("kind", STARS)
@pytest.mark.parametrize("name", MESHES)
def test_star_zero_sums_to_the_measure(name, kind):
    c = complex_of(MESHES[name])
    assert hodge_star(c, 0, kind).sum() == pytest.approx(c.metric.measure.sum(), rel=1e-12)


def dual_measure(points, simplex, top) -> float:
    """Signed measure of a simplex's circumcentric dual inside a cell, one flag after the other.

    A. Hirani, "Discrete exterior calculus", 2003; PyDEC assembles its stars so.
    """
    if len(simplex) == len(top):
        return 1.0
    total = 0.0
    for v in set(top) - set(simplex):
        bigger = (*simplex, v)
        step = circumcentre(points[list(bigger)]) - circumcentre(points[list(simplex)])
        side = np.sign(step @ (points[v] - circumcentre(points[list(simplex)])))
        total += side * np.linalg.norm(step) * dual_measure(points, bigger, top)
    return total / (len(top) - len(simplex))


def circumcentre(p):
    if len(p) == 1:
        return p[0]
    edges = p[1:] - p[0]
    return p[0] + edges.T @ np.linalg.solve(edges @ edges.T, 0.5 * (edges**2).sum(axis=1))


def measure_of(p) -> float:
    edges = p[1:] - p[0]
    return float(np.sqrt(np.linalg.det(edges @ edges.T)) / factorial(len(edges)))


@pytest.mark.parametrize("name", ["irregular", "annulus", "tets"])
def test_circumcentric_stars_are_those_of_a_small_independent_assembly(name):
    mesh = MESHES[name]
    cells = mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.faces
    c = complex_of(mesh)
    for k in range(1, c.dimension + 1):
        dual: dict[tuple[int, ...], float] = {}
        for cell in cells.tolist():
            for simplex in combinations(sorted(cell), k + 1):
                dual[simplex] = dual.get(simplex, 0.0) + dual_measure(mesh.points, simplex, cell)
        # edges and triangles of solids are numbered in sorted order, cells as the mesh has them
        order = [tuple(sorted(cell)) for cell in cells.tolist()] if k == c.dimension else sorted(dual)
        if k == 1:
            order = [tuple(edge) for edge in np.sort(c.edges, axis=1).tolist()]
        expected = [dual[s] / measure_of(mesh.points[list(s)]) for s in order]
        star = hodge_star(c, k, "circumcentric").diagonal()
        assert np.abs(star - expected).max() < 1e-12 * np.abs(expected).max()


def test_lengths_alone_give_the_same_stars():
    mesh = MESHES["torus"]
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    for kind in STARS:
        for k in range(3):
            a, b = (hodge_star(complex_of(m), k, kind) for m in (mesh, intrinsic))
            # areas by cross products and by Heron's formula: some roundings apart
            assert abs(a - b).max() <= 1e-14 * abs(b).max()


def test_caps_thinner_than_lengths_resolve_have_their_area():
    # height 1e-9 of the base: by Heron's formula the area is zero
    mesh = TriangleMesh.from_arrays([[0, 0, 0], [2, 0, 0], [1, 2e-9, 0], [1, -1, 0]], [[0, 1, 2], [1, 0, 3]])
    metric = complex_of(mesh).metric
    assert np.allclose(metric.measure, [2e-9, 1.0], rtol=1e-12)
    assert np.abs(metric.gradient_product.sum(axis=2)).max() <= 1e-15 * np.abs(metric.gradient_product).max()
    turned = mesh.moved(1e-120 * mesh.points[:, [2, 0, 1]])
    assert np.allclose(complex_of(turned).metric.measure, 1e-240 * metric.measure, rtol=1e-12)


def test_galerkin_stars_integrate_constant_fields_in_tetrahedra():
    mesh = MESHES["tets"]
    c = complex_of(mesh)
    field = np.array([1.0, -2.0, 0.5])
    form1 = c.derivatives[0] @ (mesh.points @ field)
    form2 = face_area_vectors(mesh) @ field
    assert form1 @ hodge_star(c, 1) @ form1 == pytest.approx(field @ field, rel=1e-12)
    assert form2 @ hodge_star(c, 2) @ form2 == pytest.approx(field @ field, rel=1e-12)
    assert np.abs(c.derivatives[2] @ form2).max() < 1e-14


def face_area_vectors(mesh: TetMesh) -> np.ndarray:
    """Area vectors of the sorted faces of a tetrahedral mesh."""
    corners = np.sort(mesh.tetrahedra[:, TET_FACES].reshape(-1, 3), axis=1)
    p = mesh.points[np.unique(corners, axis=0)]
    return 0.5 * np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])


def test_divergence_of_the_position_is_three_volumes():
    """3-forms have geometric orientation: positive in wrongly oriented cells too."""
    mesh = MESHES["tets"]
    corners = np.sort(mesh.tetrahedra[:, TET_FACES].reshape(-1, 3), axis=1)
    middle = mesh.points[np.unique(corners, axis=0)].mean(axis=1)
    flux = np.einsum("ij,ij->i", face_area_vectors(mesh), middle)
    divergence = complex_of(mesh).derivatives[2] @ flux
    assert divergence == pytest.approx(3 * np.abs(mesh.signed_volume), rel=1e-12)


def test_stokes_on_a_region_of_tetrahedra():
    """The flux out of a set of cells is the sum of its divergences: wrongly oriented cells included."""
    mesh = MESHES["tets"]
    c = complex_of(mesh)
    form = np.random.default_rng(1).normal(size=c.counts[1])
    curl = c.derivatives[1] @ form
    region = mesh.points[mesh.tetrahedra].mean(axis=1)[:, 0] < 0.5
    out = c.derivatives[2].T @ region.astype(float)
    assert abs(out @ curl) < 1e-12
    assert np.abs(out).sum() > 0


@pytest.mark.parametrize("kind", ["circumcentric", "galerkin"])
def test_laplacian_of_linear_functions_vanishes_inside(kind):
    mesh = MESHES["tets"]
    c = complex_of(mesh)
    gradient = c.derivatives[0] @ mesh.points @ np.array([1.0, 2.0, 3.0])
    weak = c.derivatives[0].T @ (hodge_star(c, 1, kind) @ gradient)
    assert np.abs(weak[~c.boundary_vertex]).max() < 1e-13


def test_laplacian_of_one_forms_has_each_scalar_eigenvalue_twice():
    """On a sphere the non-zero spectrum of 1-forms doubles that of functions (here l = 1 and 2)."""
    c = complex_of(shapes.icosphere(2))
    laplacian, star = form_laplacian(c, 1)
    from scipy.linalg import eigh

    values = eigh(laplacian.toarray(), star.toarray(), eigvals_only=True, subset_by_index=[0, 15])
    assert values[:6] == pytest.approx(2.0, rel=0.03)
    assert values[6:] == pytest.approx(6.0, rel=0.06)


@pytest.mark.parametrize(
    "mesh", [shapes.icosphere(1), shapes.box_tetrahedra(1, 2, 1)], ids=["surface", "solid"]
)
def test_the_complex_of_a_mesh_is_computed_once_and_freed_with_the_mesh(mesh):
    mesh = copy(mesh)
    gradient = ddg.d0(mesh)
    gradient.data[:] = 7  # of the caller alone
    complex_ = complex_of(mesh)
    assert complex_of(mesh) is complex_ and set(complex_.derivatives[0].data) == {-1, 1}
    reference = ref(complex_)
    del mesh, complex_
    gc.collect()
    assert reference() is None
