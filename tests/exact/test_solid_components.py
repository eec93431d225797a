"""Components of a solid: each one is decomposed and measured alone, whatever lies beside it."""

import numpy as np
import pytest

from ddgcli.algorithms.hodge import decomposition
from ddgcli.algorithms.hodge import hodge_analysis as analysis
from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.errors import ParameterError
from ddgcli.mesh.solid_components import solid_components
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import complex_of
from tests.exact.test_homology import hollow_tets, ring_tets

RING, HOLLOW = ring_tets(), hollow_tets()


def side_by_side(size: float) -> TetMesh:
    """Cells of a hollow cube of a size and of a ring in turn, a vertex of no cell between them."""
    n = HOLLOW.n_vertices
    points = np.concatenate([size * HOLLOW.points, [[5.0, 5.0, 5.0]], 3.0 * RING.points + 9.0])
    cells = np.concatenate([RING.tetrahedra + n + 1, HOLLOW.tetrahedra])
    return TetMesh.from_arrays(points, cells[np.random.default_rng(1).permutation(len(cells))])


def fields(mesh: TetMesh, place: str, amplitude: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """Random field, with an amplitude on the hollow cube, and the field on each component."""
    numbers = [
        {"vertex": c.vertices, "cell": c.tetrahedra, "edge": c.edges}[place] for c in solid_components(mesh)
    ]
    count = {"vertex": mesh.n_vertices, "cell": len(mesh.tetrahedra), "edge": len(mesh.edges)}[place]
    field = np.random.default_rng(0).normal(size=count if place == "edge" else (count, 3))
    field[numbers[0]] *= amplitude
    return field, numbers


def test_the_derivatives_of_components_are_blocks_of_those_of_the_mesh():
    mesh = side_by_side(0.1)
    components = solid_components(mesh)
    assert [body.mesh.n_vertices for body in components] == [HOLLOW.n_vertices, RING.n_vertices]
    whole = complex_of(mesh).derivatives
    for body in components:
        numbers = (body.vertices, body.edges, body.triangles, body.tetrahedra)
        for degree, own in enumerate(complex_of(body.mesh).derivatives):
            block = whole[degree].toarray()[numbers[degree + 1]]
            assert np.array_equal(block[:, numbers[degree]], own.toarray())
            assert np.abs(block).sum() == np.abs(own.toarray()).sum()
    assert sorted(np.concatenate([body.edges for body in components])) == list(range(len(mesh.edges)))
    assert solid_components(TetMesh(mesh.points, mesh.tetrahedra[:0])) == []


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("place", ["cell", "edge", "vertex"])
@pytest.mark.parametrize("size, amplitude", [(1e-8, 1.0), (1.0, 1e-9), (1.0, 1e-200)])
def test_the_parts_on_a_component_are_those_of_the_component_alone(size, amplitude, place, boundary):
    mesh = side_by_side(size)
    field, numbers = fields(mesh, place, amplitude)
    whole = analysis.hodge_analysis(mesh, (field, place), boundary, False)
    kind = {"cell": "face"}.get(place, place)
    norms = []
    for body, rows in zip(solid_components(mesh), numbers):
        alone = analysis.hodge_analysis(body.mesh, (field[rows], place), boundary, False)
        unit = np.abs(field[rows]).max()
        for name in ("exact", "coexact", "harmonic"):
            values, truth = (getattr(a.annotated, kind)[name] for a in (whole, alone))
            assert np.abs(values[rows] - truth).max() < 1e-9 * unit
        norms.append(alone.results["norms"]["coexact"])
    assert whole.results["norms"]["coexact"] == pytest.approx(np.hypot(*norms), rel=1e-9)
    assert np.count_nonzero(whole.annotated.vertex["potential"][HOLLOW.n_vertices]) == 0


def test_the_accuracy_is_that_of_the_worst_component(monkeypatch):
    mesh = side_by_side(1e-6)
    field, _ = fields(mesh, "cell", 1.0)

    def residual():
        return analysis.hodge_analysis(mesh, (field, "cell"), "normal", False).accuracy

    assert max(residual().values()) < 1e-10
    right = decomposition._tetrahedron_curl

    def wrong_on_the_small(mesh, *arguments):
        return (1.1 if np.ptp(mesh.points) < 1e-3 else 1.0) * right(mesh, *arguments)

    monkeypatch.setattr(decomposition, "_tetrahedron_curl", wrong_on_the_small)
    assert residual()["reconstruction_residual"] > 1e-2


@pytest.mark.parametrize("boundary, component", [("tangential", 1), ("normal", 0)])
def test_harmonic_forms_lie_on_one_component_each(boundary, component):
    mesh = side_by_side(1e-8)
    body = solid_components(mesh)[component]
    basis, alone = (harmonic_basis(m, boundary) for m in (mesh, body.mesh))
    assert basis.forms[:, body.edges] == pytest.approx(alone.forms, rel=1e-9)
    assert np.count_nonzero(np.delete(basis.forms, body.edges, axis=1)) == 0
    assert basis.residual < 1e-10


def test_norms_of_components_that_overflow_together_are_refused():
    mesh = side_by_side(3.0)
    field, _ = fields(mesh, "vertex", 1.0)
    largest = analysis.hodge_analysis(mesh, (field, "vertex"), "normal", False).results["norms"]["field"]
    huge = field * (1.7e308 / largest)
    analysis.hodge_analysis(mesh, (huge, "vertex"), "normal", False)
    with pytest.raises(ParameterError, match="norms are beyond 1e308"):
        analysis.hodge_analysis(mesh, (1.1 * huge, "vertex"), "normal", False)
