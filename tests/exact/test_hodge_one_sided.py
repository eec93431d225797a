"""Hodge decomposition without an orientation, against dense projections; the fields of `accuracy` move."""

import numpy as np
import pytest
from scipy.linalg import null_space

from ddgcli.algorithms.hodge import decomposition, harmonic
from ddgcli.algorithms.hodge.decomposition import decompose_cell_vectors, decompose_form, tangent_part
from ddgcli.algorithms.hodge.harmonic import ClosedProjection, SolidProjection, harmonic_basis
from ddgcli.algorithms.hodge.hodge_analysis import check_mesh
from ddgcli.algorithms.hodge.homology import betti_numbers, closed_cochains, generator_loops
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.whitney import flat, sharp
from tests.exact.test_dec import jittered_tets
from tests.exact.test_homology import hollow_tets, klein, moebius, rank_of, ring_tets


def projective_plane() -> TriangleMesh:
    """The sphere with antipodes identified, its 81 vertices at random places."""
    sphere = shapes.icosphere(2)
    key = np.round(sphere.points, 6) + 0.0
    number = {tuple(row): k for k, row in enumerate(key)}
    pair = np.array([min(k, number[tuple(0.0 - row)]) for k, row in enumerate(key)])
    corners, vertex = np.unique(pair, return_inverse=True)
    faces = vertex[sphere.faces]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return TriangleMesh.from_arrays(np.random.default_rng(0).normal(size=(len(corners), 3)), faces[first])


def side_by_side(a: TriangleMesh, b: TriangleMesh) -> TriangleMesh:
    return TriangleMesh.from_arrays(
        np.concatenate([a.points, b.points]), np.concatenate([a.faces, b.faces + a.n_vertices])
    )


def klein_and_torus() -> TriangleMesh:
    return side_by_side(klein(6), shapes.torus(8, 6))


# rational and modulo 2: absolute, relative
SURFACES = {
    "moebius": (moebius(), (1, 1, 0), (0, 0, 0), (1, 1, 0), (0, 1, 1)),
    "klein": (klein(6), (1, 1, 0), (1, 1, 0), (1, 2, 1), (1, 2, 1)),
    "projective plane": (projective_plane(), (1, 0, 0), (1, 0, 0), (1, 1, 1), (1, 1, 1)),
    "klein and torus": (
        side_by_side(klein(6), shapes.torus(8, 6)),
        (2, 3, 1),
        (2, 3, 1),
        (2, 4, 2),
        (2, 4, 2),
    ),
    "torus": (shapes.torus(8, 6), (1, 2, 1), (1, 2, 1), (1, 2, 1), (1, 2, 1)),
}


@pytest.mark.parametrize("name", SURFACES)
def test_betti_numbers_over_both_fields(name):
    mesh, *expected = SURFACES[name]
    rational, modulo_2 = betti_numbers(mesh), betti_numbers(mesh, modulo_2=True)
    assert [rational.absolute, rational.relative, modulo_2.absolute, modulo_2.relative] == expected
    assert len(generator_loops(mesh)) == modulo_2.absolute[1]


@pytest.mark.parametrize("name", ["moebius", "klein", "projective plane", "moebius and torus"])
def test_only_closed_one_sided_components_have_generators_of_finite_order(name, caplog):
    """The rational Betti number falls short of the number of generators there, and is equal elsewhere."""
    mesh = side_by_side(moebius(), shapes.torus(8, 6)) if "and" in name else SURFACES[name][0]
    check_mesh(mesh)
    assert "one-sided" in caplog.text
    n_infinite, n_generators = betti_numbers(mesh).absolute[1], len(generator_loops(mesh))
    assert ("finite order" in caplog.text) == (n_infinite < n_generators)


def free_edges(mesh, boundary):
    c = complex_of(mesh)
    return ~c.boundary_edge if boundary == "normal" else np.ones(c.counts[1], dtype=bool)


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("name", SURFACES)
def test_cochains_without_an_orientation_span_the_rational_cohomology(name, boundary):
    mesh, absolute, relative, *_ = SURFACES[name]
    c = complex_of(mesh)
    forms = closed_cochains(mesh, boundary).toarray()
    assert forms.shape[1] == (absolute if boundary == "tangential" else relative)[1]
    assert not (c.derivatives[1] @ forms).any()
    assert not forms[~free_edges(mesh, boundary)].any()
    d0 = c.derivatives[0].toarray().astype(float)
    if boundary == "normal":
        d0 = d0[:, ~c.boundary_vertex]
    assert rank_of(np.hstack([d0, forms])) == rank_of(d0) + forms.shape[1]


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("name", SURFACES)
def test_parts_are_the_dense_projections(name, boundary):
    """Closed forms are the kernel of d1, whatever the faces' orientation: the reference is dense."""
    mesh = SURFACES[name][0]
    c, free = complex_of(mesh), free_edges(mesh, boundary)
    kernel = np.zeros((c.counts[1], 0))
    if free.any():
        local = null_space(c.derivatives[1].toarray()[:, free].astype(float))
        kernel = np.zeros((c.counts[1], local.shape[1]))
        kernel[free] = local
    star = ClosedProjection(mesh, boundary).star1.toarray()
    form = np.random.default_rng(3).normal(size=c.counts[1])
    closed = kernel @ np.linalg.solve(kernel.T @ star @ kernel, kernel.T @ star @ form)
    split = decompose_form(mesh, form, boundary)
    assert np.abs(split.exact + split.harmonic - closed).max() < 1e-9
    assert np.abs(split.coexact - (form - closed)).max() < 1e-9
    assert split.reconstruction_residual < 1e-11 and split.orthogonality < 1e-12
    vectors, _ = tangent_part(mesh, np.random.default_rng(4).normal(size=(mesh.n_faces, 3)))
    basis = np.zeros((3 * mesh.n_faces, kernel.shape[1]))
    for k, column in enumerate(kernel.T):
        basis[:, k] = sharp(mesh, column).ravel()
    weight = np.repeat(c.metric.measure, 3)
    gram = basis.T @ (weight[:, None] * basis)
    closed = (basis @ np.linalg.solve(gram, basis.T @ (weight * vectors.ravel()))).reshape(-1, 3)
    split = decompose_cell_vectors(mesh, vectors, boundary)
    assert np.abs(split.exact + split.harmonic - closed).max() < 1e-9
    assert split.reconstruction_residual < 1e-11 and split.orthogonality < 1e-12


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("make", [lambda: jittered_tets(2), hollow_tets, ring_tets])
def test_the_curl_part_of_tetrahedra_is_computed_independently(make, boundary):
    mesh = make()
    split = decompose_cell_vectors(
        mesh, np.random.default_rng(0).normal(size=(len(mesh.tetrahedra), 3)), boundary
    )
    assert split.reconstruction_residual < 1e-10


def test_an_inverted_tetrahedron_does_not_break_the_sum():
    mesh = jittered_tets(2)
    inner = np.flatnonzero(~complex_of(mesh).boundary_vertex)[0]
    points = mesh.points.copy()
    points[inner] += [0.6, 0.1, 0.05]
    folded = type(mesh).from_arrays(points, mesh.tetrahedra)
    assert len(set(np.sign(folded.signed_volume))) == 2
    split = decompose_cell_vectors(folded, np.random.default_rng(0).normal(size=(len(mesh.tetrahedra), 3)))
    assert split.reconstruction_residual < 1e-10


@pytest.mark.parametrize("thickness", [1e-3, 1e-6, 1e-7])
@pytest.mark.parametrize("boundary", ["tangential", "normal"])
def test_the_parts_of_a_field_in_a_thin_plate_with_a_hole_do_not_depend_on_its_thickness(thickness, boundary):
    def plate(height):
        box = shapes.box_tetrahedra(5, 5, 1)
        centre = box.points[box.tetrahedra].mean(axis=1)
        ring = TetMesh.from_arrays(box.points, box.tetrahedra[np.abs(centre[:, :2] - 0.5).max(axis=1) > 0.1])
        x, y, _ = ring.points[ring.tetrahedra].mean(axis=1).T
        return ring.moved(ring.points * [1, 1, height]), np.stack([y, y**2 - x, 0.3 + 0 * x], axis=1)

    split = decompose_cell_vectors(*plate(thickness), boundary)
    assert max(split.orthogonality, split.harmonic_residual) < 1e-9
    assert split.reconstruction_residual < 1e-8
    thick = decompose_cell_vectors(*plate(1e-2), boundary)
    for name in ("exact", "coexact", "harmonic"):
        share, truth = (s.norms[name] / s.norms["field"] for s in (split, thick))
        assert share == pytest.approx(truth, abs=1e-3)
    assert harmonic_basis(plate(thickness)[0], boundary).residual < 1e-9


def test_curls_in_a_thin_plate_of_irregular_cells_are_as_accurate():
    """One pass of LSMR ends at 5e-8 here, at 2e-4 with four times the cells."""
    rng = np.random.default_rng(0)
    box = shapes.box_tetrahedra(3, 3, 1)
    points = box.points + rng.uniform(-0.2, 0.2, box.points.shape) / [3, 3, 1]
    plate = box.moved(points * [1, 1, 1e-6])
    split = decompose_cell_vectors(plate, rng.normal(size=(len(plate.tetrahedra), 3)), "normal")
    assert split.reconstruction_residual < 1e-9


@pytest.mark.parametrize("kind", ["form", "cell"])
@pytest.mark.parametrize("make", [ring_tets, lambda: shapes.torus(8, 6), klein])
def test_an_error_in_any_part_moves_the_accuracy(make, kind, monkeypatch):
    """Planted: harmonic and exact parts 1 % too long, a wrong potential, a harmonic form with divergence."""
    mesh = make()
    rng = np.random.default_rng(0)
    c = complex_of(mesh)
    field = rng.normal(size=c.counts[1]) if kind == "form" else rng.normal(size=(len(c.corners), 3))
    if kind == "cell" and isinstance(mesh, TriangleMesh):
        field, _ = tangent_part(mesh, field)
    split = decompose_form if kind == "form" else decompose_cell_vectors
    sound = split(mesh, field)
    assert max(sound.orthogonality, sound.reconstruction_residual, sound.harmonic_residual) < 1e-8
    if kind == "cell" and isinstance(mesh, TetMesh):  # whose harmonic part does not follow from the exact one
        right = SolidProjection.harmonic_part
        exact = 0.01 * flat(mesh, sound.exact)
        monkeypatch.setattr(SolidProjection, "harmonic_part", lambda self, load: right(self, load) + exact)
        assert split(mesh, field).harmonic_residual > 1e-5
        monkeypatch.undo()
        right = SolidProjection.potential
        monkeypatch.setattr(SolidProjection, "potential", lambda self, load: 1.01 * right(self, load))
        assert split(mesh, field).reconstruction_residual > 1e-3
        return
    right = ClosedProjection.closed_part
    monkeypatch.setattr(ClosedProjection, "closed_part", lambda self, load: 1.01 * right(self, load))
    wrong = split(mesh, field)
    assert wrong.reconstruction_residual > 1e-3 and wrong.harmonic_residual > 1e-5
    monkeypatch.undo()
    right = ClosedProjection.potential
    monkeypatch.setattr(ClosedProjection, "potential", lambda self, load: 1.01 * right(self, load))
    wrong = split(mesh, field)
    assert wrong.orthogonality > 1e-5 and wrong.harmonic_residual > 1e-5


def test_a_wrong_harmonic_basis_has_a_residual(monkeypatch):
    mesh = klein(6)
    assert harmonic_basis(mesh).residual < 1e-12
    right = harmonic._orthonormal
    monkeypatch.setattr(harmonic, "_orthonormal", lambda columns, inner: right(columns, inner) + 1e-3)
    assert harmonic_basis(mesh).residual > 1e-5


def test_a_wrong_curl_part_moves_the_reconstruction(monkeypatch):
    mesh = ring_tets()
    field = np.random.default_rng(0).normal(size=(len(mesh.tetrahedra), 3))
    right = decomposition._tetrahedron_curl
    monkeypatch.setattr(decomposition, "_tetrahedron_curl", lambda *arguments: 1.001 * right(*arguments))
    assert decompose_cell_vectors(mesh, field).reconstruction_residual > 1e-4


@pytest.mark.parametrize(
    ("mesh", "boundary"), [(shapes.icosphere(1), "tangential"), (shapes.grid(3, 3), "normal")]
)
def test_a_surface_without_harmonic_fields_has_an_empty_basis_without_a_factorisation(
    mesh, boundary, monkeypatch
):
    monkeypatch.setattr(harmonic, "closed_projection", None)
    basis = harmonic_basis(mesh, boundary)
    assert basis.forms.shape == (0, mesh.topology.n_edges) and basis.residual == 0
