"""Exact distance against closed forms, symmetries and its own invariances."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesic_exact import exact_distance
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def jittered_grid(k: int, seed: int = 0) -> TriangleMesh:
    mesh = shapes.grid(k, k, pattern="alternating")
    inside = ~mesh.topology.boundary_vertex[:, None] * np.array([1, 1, 0])
    return mesh.moved(
        mesh.points + 0.3 / k * inside * np.random.default_rng(seed).uniform(-1, 1, (len(inside), 3))
    )


@pytest.mark.parametrize("mesh", [shapes.grid(12, 9), jittered_grid(12)], ids=["regular", "jittered"])
@pytest.mark.parametrize("source", [0, 60])
def test_flat_square_is_euclidean(mesh, source):
    truth = np.linalg.norm(mesh.points - mesh.points[source], axis=1)
    assert np.abs(exact_distance(mesh, source).distance - truth).max() < 1e-12


@pytest.mark.parametrize("k", [1, 3, 8])
def test_opposite_corners_of_a_cube(k):
    mesh = shapes.box(k, k, k)
    far = int(np.argmax(mesh.points.sum(axis=1)))
    assert exact_distance(mesh, 0).distance[far] == pytest.approx(np.sqrt(5), abs=1e-12)
