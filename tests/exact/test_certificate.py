"""The certificate of a distance: its short proof gives what distances along edges give."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics import certificate as module
from ddgcli.algorithms.geodesics.convergence import has_converged
from ddgcli.algorithms.geodesics.distance import DistanceOptions, measure_distance
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import cone, jittered


def distances():
    mesh = shapes.random_sphere(200)
    exact = exact_distance(mesh, 0).distance
    raised, partial = exact.copy(), exact.copy()
    raised[7] += 1.0
    partial[9] = np.inf
    return mesh, {
        "exact": exact,
        "shifted": exact + 0.1,
        "scaled": 1.5 * exact,
        "lowered": 0.5 * exact,
        "one too far": raised,
        "one unreached": partial,
    }


@pytest.mark.parametrize("name", ["exact", "shifted", "scaled", "lowered", "one too far", "one unreached"])
def test_steps_along_edges_prove_what_edge_distances_show(name, monkeypatch):
    mesh, of = distances()
    short = module.certificate(mesh, Sources.at([0]), of[name])
    monkeypatch.setattr(module, "_below_edge_distance", lambda *_: False)
    assert module.certificate(mesh, Sources.at([0]), of[name]) == short
    assert (short["violations_edge_distance"] > 0) == (name in {"shifted", "scaled", "one too far"})


def test_exact_distances_need_no_distances_along_edges(monkeypatch):
    mesh, of = distances()
    monkeypatch.setattr(module, "edge_distance", None)
    assert module.certificate(mesh, Sources.at([0]), of["exact"])["violations_edge_distance"] == 0


@pytest.mark.parametrize(
    ("angle", "sectors", "rings"), [(2 * np.pi, 16, 40), (2 * np.pi, 9, 12), (3.0, 9, 12)]
)
def test_heat_from_a_pole_states_the_error_of_its_wide_sectors(angle, sectors, rings):
    mesh, radius, _ = cone(angle, sectors, rings)
    heat = measure_distance(mesh, Sources.at([0]), "heat")
    error = np.abs(heat.distance - radius).max() / radius.max()
    assert 0.5 < error / heat.accuracy["error_estimate"] < 1.0


@pytest.mark.parametrize("method_source", [0, 7])
def test_the_stated_error_of_heat_is_no_less_than_the_proven_violation(method_source):
    mesh = shapes.grid(6, 6)
    accuracy = measure_distance(mesh, Sources.at([method_source]), "heat").accuracy
    assert accuracy["error_estimate"] >= accuracy["certificate_excess"] > 0


@pytest.mark.parametrize("seed", [1, 2])
def test_heat_on_needles_from_many_sources_states_its_error_and_has_not_converged(seed, caplog):
    """The error was divided by the far too long distance itself, and edges of needles bound nothing."""
    mesh = jittered(shapes.grid(10, 100, pattern="alternating"), np.array([0.015, 0.0015, 0.0]), 3)
    mesh = mesh.moved(mesh.points * [100.0, 1.0, 0.0])
    rng = np.random.default_rng(seed)
    sources = Sources.at(rng.choice(mesh.n_vertices, 100, replace=False))
    exact, heat = (measure_distance(mesh, sources, method) for method in ("exact", "heat"))
    error = np.abs(heat.distance - exact.distance).max() / exact.distance.max()
    assert error > 1 and 0.5 * error < heat.accuracy["error_estimate"] < 2 * error
    assert exact.converged and not heat.converged
    assert "method=exact" in caplog.text


@pytest.mark.parametrize("name", ["error_estimate", "tolerance_error_estimate"])
def test_large_estimates_warn_and_no_distance_with_an_error_above_its_size_has_converged(name, caplog):
    for estimate, is_large, converged in ((0.05, False, True), (0.2, True, True), (1.2, True, False)):
        caplog.clear()
        assert has_converged(shapes.grid(2, 2), "exact", {name: estimate}) == converged
        assert (f"{name} is" in caplog.text) == is_large


def test_the_stated_error_of_a_tolerance_is_at_most_the_excess_over_straight_lines():
    """Twice the error of near vertices, relative to their radius, was 10 times the error on long cells."""
    mesh = jittered(shapes.grid(80, 80, pattern="alternating"), 0.004, 1)
    mesh = mesh.moved(mesh.points * [10.0, 1.0, 1.0])
    truth = np.linalg.norm(mesh.points - mesh.points[3280], axis=1)
    loose = measure_distance(mesh, Sources.at([3280]), options=DistanceOptions(tolerance=1.0))
    error = (loose.distance - truth).max() / truth.max()
    assert error > 0.02
    assert loose.accuracy["tolerance_error_estimate"] == pytest.approx(error, rel=1e-9)


def test_the_exact_distance_of_a_cone_has_no_gradient_error_though_its_gradients_are_longer_than_1():
    mesh, radius, _ = cone(2 * np.pi, 9, 200)
    assert module.gradient_error(mesh, radius) < 0.25 * module.gradient_error(mesh, radius, circular=False)


@pytest.mark.parametrize(("length", "k", "rows"), [(1e4, 20, 4), (1e4, 1, 8), (100.0, 10, 50)])
@pytest.mark.parametrize("place", [0.0, 0.5])
def test_heat_states_no_large_error_on_a_bar_of_long_cells(length, k, rows, place):
    mesh = shapes.grid(k, rows)
    mesh = mesh.moved(mesh.points * [length, 1.0, 1.0])
    source = int(place * mesh.n_vertices)
    truth = np.linalg.norm(mesh.points - mesh.points[source], axis=1)
    heat = measure_distance(mesh, Sources.at([source]), "heat")
    error = np.abs(heat.distance - truth).max() / truth.max()
    assert 0.5 * error < heat.accuracy["error_estimate"] < 12 * error


def test_an_estimate_lies_between_the_proven_violation_and_what_the_bounds_leave():
    mesh = shapes.grid(8, 8)
    sources = Sources.at([0])
    truth = exact_distance(mesh, 0).distance
    for factor in (0.5, 1.0, 1.2):
        low, high = (module.certificate(mesh, sources, factor * truth, estimate=e) for e in (0.0, 10.0))
        assert low["error_estimate"] == low["certificate_excess"]
        largest = factor * truth.max()
        assert abs(factor - 1) * truth.max() - 1e-12 <= high["error_estimate"] * largest < 0.8 * truth.max()


def test_heat_from_a_whole_boundary_states_no_error_of_circular_wavefronts():
    mesh = shapes.icosphere(4)
    mesh = TriangleMesh.from_arrays(mesh.points, mesh.faces[(mesh.points[mesh.faces][..., 2] > -1e-9).all(1)])
    rim = mesh.topology.boundary_edges
    sources = Sources.at([], SurfacePoints.none(), rim, np.zeros(len(rim), dtype=np.int64))
    exact, heat = (measure_distance(mesh, sources, method) for method in ("exact", "heat"))
    on = mesh.topology.referenced_vertex
    error = np.abs(heat.distance[on] - exact.distance[on]).max() / exact.distance[on].max()
    assert 0.15 < error / heat.accuracy["error_estimate"] < 1.7
