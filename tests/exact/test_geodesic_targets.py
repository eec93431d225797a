"""Exact distance at points inside faces."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import jittered, noisy_torus, pillow, with_holes


def random_points(mesh, count: int, seed: int = 0) -> SurfacePoints:
    """Inside faces, on sides and at corners."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet([1, 1, 1], count)
    weights[: count // 4, rng.integers(3)] = 0
    weights[: count // 8] = np.eye(3)[rng.integers(0, 3, count // 8)]
    weights /= weights.sum(axis=1, keepdims=True)
    return SurfacePoints(rng.integers(0, mesh.n_faces, count), weights)


@pytest.mark.parametrize("source", [0, 60])
def test_targets_inside_faces_of_the_plane_have_euclidean_distance(source):
    mesh = jittered(shapes.grid(12, 12), 0.03)
    targets = random_points(mesh, 200)
    truth = np.linalg.norm(targets.positions(mesh) - mesh.points[source], axis=1)
    assert np.abs(exact_distance(mesh, source, targets=targets).target_distance - truth).max() < 1e-12


def test_targets_at_side_centres_of_a_cube_equal_the_closed_form():
    mesh = shapes.box(1, 1, 1)
    rows, diagonal = np.arange(mesh.n_faces), np.argmax(mesh.side_length, axis=1)
    weights = np.zeros((mesh.n_faces, 3))
    weights[rows, diagonal] = weights[rows, (diagonal + 1) % 3] = 0.5
    centres = SurfacePoints(rows, weights)
    beside = (centres.positions(mesh) == mesh.points[0]).any(axis=1)
    truth = np.where(beside, np.sqrt(0.5), np.hypot(0.5, 1.5))
    assert np.abs(exact_distance(mesh, 0, targets=centres).target_distance - truth).max() < 1e-14


@pytest.mark.parametrize("shape", [noisy_torus, with_holes, lambda: pillow(5)])
def test_distance_between_points_is_symmetric(shape):
    mesh = shape()
    points = random_points(mesh, 12, seed=2)
    none = np.zeros(0, dtype=int)
    table = np.stack(
        [
            exact_distance(
                mesh, Sources(none, SurfacePoints(points.face[[i]], points.barycentric[[i]])), targets=points
            ).target_distance
            for i in range(12)
        ]
    )
    assert np.abs(np.diag(table)).max() < 1e-14
    assert np.abs(table - table.T).max() < 1e-13 * table.max()
    assert (table[:, None, :] <= table[:, :, None] + table[None, :, :] + 1e-13).all()


def test_targets_at_corners_equal_vertices_and_have_their_source():
    mesh = noisy_torus()
    sources = np.array([5, 300])
    corner = SurfacePoints(np.arange(mesh.n_faces), np.tile([0.0, 1.0, 0.0], (mesh.n_faces, 1)))
    measured = exact_distance(mesh, sources, targets=corner)
    vertex = mesh.faces[:, 1]
    assert np.abs(measured.target_distance - measured.distance[vertex]).max() < 1e-14
    assert np.array_equal(measured.target_source, measured.nearest_source[vertex])


def test_targets_on_islands_have_infinite_distance():
    one, two = shapes.icosphere(1), shapes.icosphere(1)
    faces = np.concatenate([one.faces, two.faces + one.n_vertices])
    mesh = TriangleMesh.from_arrays(np.concatenate([one.points, two.points]), faces)
    targets = SurfacePoints(np.array([0, one.n_faces]), np.full((2, 3), 1 / 3))
    measured = exact_distance(mesh, 0, targets=targets)
    assert np.isfinite(measured.target_distance[0]) and np.isinf(measured.target_distance[1])
    assert measured.target_source[1] == -1
