"""Bundled windows give the distances of single windows, and are fewer on fine meshes."""

from contextlib import contextmanager

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.exact import bundles as window_bundle
from ddgcli.algorithms.geodesics.exact import wavefront as window_front
from ddgcli.algorithms.geodesics.exact.dominance import reaching
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.exact.pool import WindowOrigins
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import cone, jittered, noisy_torus, on_pillow, pillow, with_holes


@contextmanager
def bound():
    """Use bundles on small meshes with few windows, too; yield all bundle queues."""
    queues = []

    class RecordedBundles(window_bundle.Bundles):
        def __init__(self, *args):
            super().__init__(*args)
            queues.append(self)

    with pytest.MonkeyPatch.context() as patch:
        for cost in ("BUNDLE_COST", "TEST_COST", "BINDING_COST", "ROUND_COST", "MIN_BOUND_WINDOWS"):
            patch.setattr(window_bundle, cost, 0.0)
        patch.setattr(window_bundle, "MIN_BUNDLE_SIZE", 3)
        patch.setattr(window_bundle, "MIN_PART_SIZE", 2)
        patch.setattr(window_front, "Bundles", RecordedBundles)
        yield queues
    assert sum(bundles.moves for bundles in queues) > 500


def stretched():
    sphere = shapes.random_sphere(3000)
    return sphere.moved(sphere.points * [6, 1, 0.3])


SHAPES = [
    lambda: shapes.random_sphere(3000),
    stretched,
    noisy_torus,
    with_holes,
]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("every", [4, 10])
def test_bundles_give_the_distances_of_single_windows(shape, every):
    mesh = shape()
    for source in (0, mesh.n_vertices // 2):
        alone = exact_distance(mesh, source, directions=True)
        with bound():
            bundled = exact_distance(mesh, source, directions=True, dominance_every=every)
        assert np.abs(alone.distance - bundled.distance).max() < 1e-14 * alone.distance.max()
        assert np.array_equal(alone.nearest_source, bundled.nearest_source)
        turned = np.abs(np.exp(1j * alone.departure) - np.exp(1j * bundled.departure))
        assert not (turned > 1e-9).any()


@pytest.mark.parametrize("angle", [1.0, 5.5, 9.0])
def test_bundles_on_cones_and_saddles_equal_the_closed_form(angle):
    mesh, radius, phi = cone(angle, 60, 24)
    source = 200
    turn = np.abs(phi - phi[source])
    turn = np.minimum(turn, angle - turn)
    r, bend = radius[source], np.minimum(turn, np.pi)
    straight = np.sqrt((radius - r) ** 2 + 4 * radius * r * np.sin(bend / 2) ** 2)
    truth = np.where((turn >= np.pi) | (radius == 0), radius + r, straight)
    with bound():
        distance = exact_distance(mesh, source).distance
    assert np.abs(distance - truth).max() < 1e-12 * truth.max()


@pytest.mark.parametrize("mesh", [shapes.grid(40, 40), jittered(shapes.grid(40, 40), 0.007)])
def test_bundles_on_the_plane_equal_the_closed_form(mesh):
    truth = np.linalg.norm(mesh.points - mesh.points[7], axis=1)
    with bound():
        distance = exact_distance(mesh, 7).distance
    assert np.abs(distance - truth).max() < 1e-12


def test_bundles_on_the_pillow_equal_the_closed_form():
    mesh = pillow(24)
    with bound():
        distance = exact_distance(mesh, 100).distance
    assert np.abs(distance - on_pillow(mesh, 24, 100)).max() < 1e-12


def test_bundles_reach_targets_from_several_sources():
    mesh = stretched()
    rng = np.random.default_rng(0)
    points = SurfacePoints(rng.integers(0, mesh.n_faces, 60), rng.dirichlet(np.ones(3), 60))
    sources = Sources(np.array([5, 900]), SurfacePoints(np.array([77]), np.array([[0.2, 0.3, 0.5]])))
    alone = exact_distance(mesh, sources, targets=points)
    with bound():
        bundled = exact_distance(mesh, sources, targets=points)
    scale = alone.distance.max()
    assert np.abs(alone.distance - bundled.distance).max() < 1e-14 * scale
    assert np.abs(alone.target_distance - bundled.target_distance).max() < 1e-14 * scale
    assert np.array_equal(alone.target_source, bundled.target_source)


def test_windows_grow_slower_in_bundles(monkeypatch):
    """Single windows per vertex of a sphere grow with the mesh size; bundles hardly do."""
    monkeypatch.setattr(window_bundle, "ROUND_COST", 0.0)  # as on meshes where rounds have many windows
    monkeypatch.setattr(window_bundle, "MIN_BOUND_WINDOWS", 1000.0)
    sizes = 5_000, 20_000
    spheres = [shapes.random_sphere(n) for n in sizes]
    bundled = [exact_distance(mesh, 0).windows / mesh.n_vertices for mesh in spheres]
    monkeypatch.setattr(window_bundle, "MIN_BOUND_WINDOWS", np.inf)
    alone = [exact_distance(mesh, 0).windows / mesh.n_vertices for mesh in spheres]
    assert alone[1] > 1.5 * alone[0]
    assert bundled[1] < 1.2 * bundled[0]
    assert bundled[1] < 0.5 * alone[1]


@pytest.mark.parametrize("beside", [4e-12, -4e-12])
def test_bundles_release_the_windows_of_a_vertex_as_far_beside_them_as_single_windows_reach(beside):
    """Rounding opens gaps of that size; with a narrower margin 7 of 198,300 distances were too long."""
    mesh = TriangleMesh.from_arrays([[0.0, 0, 0], [0.75, 0, 0], [0.5, 0.5, 0]], [[0, 1, 2]])
    tables = window_tables(mesh)
    apex, source = np.array([0.5, 0.5]), np.array([0.25, -4.0])
    line = apex - source
    at = source[0] - line[0] * source[1] / line[1]
    edge = at + beside + np.linspace(0.0, np.sign(beside) * 1e-3, 13)  # `beside` is the gap
    edge.sort()
    lines = np.stack([edge[:-1], edge[1:], *np.full((2, 12), source[:, None])])

    def reach_apex(windows):
        n = windows.shape[1]
        return reaching(np.full(n, at), windows, np.full(n, line[0]), np.full(n, line[1])).any()

    assert reach_apex(lines)
    origins = WindowOrigins()
    origins.add(np.array([0]), np.array([0]), np.array([0.0]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window_bundle, "MIN_BOUND_WINDOWS", 0.0)
        bundles = window_bundle.Bundles(tables, origins, np.full(3, 10.0))
        bundles.bind(lines, np.zeros((2, 12), dtype=np.int64))
    assert len(bundles) == 1
    assert reach_apex(bundles.advance(np.inf)[0])
