"""Nearest points on a surface to points in space."""

import numpy as np
import pytest

from ddgcli.errors import MeshError
from ddgcli.geometry.surface_points import nearest_on_triangle, nearest_points
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def queries(mesh, k=200, seed=0):
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return np.random.default_rng(seed).uniform(low - (high - low) / 2, high + (high - low) / 2, (k, 3))


@pytest.mark.parametrize("mesh", [shapes.random_sphere(300), shapes.torus(24, 12), shapes.box(2, 3, 4)])
def test_nearest_points_equal_those_of_libigl(mesh):
    igl = pytest.importorskip("igl")
    points = queries(mesh)
    nearest, distance = nearest_points(mesh, points)
    squared, _, position = igl.point_mesh_squared_distance(points, mesh.points, mesh.faces)[:3]
    np.testing.assert_allclose(distance, np.sqrt(squared), rtol=1e-12)
    np.testing.assert_allclose(nearest.positions(mesh), position, atol=1e-7)  # ties: sqrt of rounding


@pytest.mark.parametrize("scale", [1e-300, 1e-8, 1e8, 1e190])
def test_results_scale_with_the_mesh(scale):
    mesh = shapes.random_sphere(300)
    points = queries(mesh)
    once, distance = nearest_points(mesh, points)
    nearest, scaled = nearest_points(mesh.moved(mesh.points * scale), points * scale)
    np.testing.assert_allclose(scaled / scale, distance, rtol=1e-12)
    np.testing.assert_allclose(nearest.positions(mesh), once.positions(mesh), atol=1e-12)


def test_nearest_points_are_invariant_under_translation():
    mesh = shapes.random_sphere(300)
    points = queries(mesh)
    once, _ = nearest_points(mesh, points)
    away = np.array([1e8, -2e8, 3e8])
    nearest, _ = nearest_points(mesh.moved(mesh.points + away), points + away)
    np.testing.assert_allclose(
        nearest.positions(mesh), once.positions(mesh), atol=1e-6
    )  # 3e8 / 2**53 and slopes


@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_point_is_the_nearest_of_all_faces(seed):
    """Of needles, faces of all sizes, and a vertex of no face that is nearer than the surface."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(120, 3)) * np.exp(2 * rng.normal(size=(120, 1)))
    positions = queries(TriangleMesh.from_arrays(points, np.array([[0, 1, 2]])), k=60, seed=seed)
    mesh = TriangleMesh.from_arrays(np.vstack([points, positions[:1]]), np.arange(120).reshape(-1, 3))
    nearest, distance = nearest_points(mesh, positions)
    for k, position in enumerate(positions):
        weights, away = nearest_on_triangle(position, mesh.points[mesh.faces])
        assert nearest.face[k] == np.argmin(away)
        np.testing.assert_allclose(distance[k], away.min(), rtol=1e-10)
        np.testing.assert_allclose(nearest.barycentric[k], weights[nearest.face[k]], atol=1e-8)


def test_meshes_without_faces_are_refused():
    empty = TriangleMesh.from_arrays(np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int64))
    with pytest.raises(MeshError, match="no triangles"):
        nearest_points(empty, [[0.0, 0, 0]])
    assert len(nearest_points(empty, np.zeros((0, 3)))[0]) == 0
