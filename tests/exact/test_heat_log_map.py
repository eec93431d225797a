"""Logarithmic map by vector heat: angles in the plane, errors on the sphere, and shared factors."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.heat_log_map import heat_log_map, vertex_gradient
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.library.fields import logarithmic_map
from ddgcli.mesh import shapes
from tests.geodesic_cases import beside_a_sphere, disk


def by_heat(mesh, source=0):
    sources = Sources.at([source])
    return heat_log_map(mesh, HeatSolver(mesh).distance(sources).distance, sources)


def test_in_the_plane_the_map_is_the_difference_of_positions():
    mesh = shapes.grid(31, 31, pattern="alternating")
    centre = int(np.argmin(np.linalg.norm(mesh.points - mesh.points.mean(axis=0), axis=1)))
    away = mesh.points - mesh.points[centre]
    distance = np.linalg.norm(away, axis=1)
    mapped = heat_log_map(mesh, distance, Sources.at([centre]))
    x = np.array(mapped.axis["x_axis"])
    truth = np.stack([away @ x, away @ np.cross([0, 0, 1], x)], axis=1)
    error = np.linalg.norm(mapped.log_map - truth, axis=1)
    assert np.allclose(np.linalg.norm(mapped.log_map, axis=1), distance, rtol=1e-12)
    assert error.max() < 0.05 * distance.max() and np.median(error) < 0.01 * distance.max()


def test_on_the_sphere_the_root_mean_square_error_is_below_a_tenth():
    mesh = shapes.icosphere(4)
    mapped = by_heat(mesh, 12)
    p, x = mesh.points[12], np.array(mapped.axis["x_axis"])
    x = x - (x @ p) * p
    angle = np.arccos(np.clip(mesh.points @ p, -1, 1))
    planar = mesh.points @ x + 1j * (mesh.points @ np.cross(p, x))
    truth = angle * np.exp(1j * np.angle(planar))
    error = np.abs(mapped.log_map @ [1, 1j] - truth)[angle < 2.5]
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.array_equal(mapped.log_map[12], [0, 0])


@pytest.mark.parametrize("scale", [1e-60, 1e60])
def test_the_map_has_the_unit_of_the_mesh(scale):
    mesh = shapes.random_sphere(400)
    small = by_heat(mesh).log_map
    large = by_heat(mesh.moved(scale * mesh.points)).log_map
    assert np.allclose(large, scale * small, rtol=0, atol=1e-6 * scale)


def test_the_map_of_a_component_does_not_depend_on_the_size_of_another():
    mesh = shapes.random_sphere(400)
    both, first, _ = beside_a_sphere(mesh, 2.0**-8)
    alone, beside = by_heat(mesh, 5).log_map, by_heat(both, first + 5).log_map[first:]
    assert np.allclose(2.0**8 * beside, alone, rtol=0, atol=1e-9)


def test_shared_factors_change_nothing():
    mesh, sources = shapes.torus(24, 16), Sources.at([7])
    distance = HeatSolver(mesh).distance(sources).distance
    shared = heat_log_map(mesh, distance, sources, transport=VectorHeat(mesh), slope=vertex_gradient(mesh))
    assert np.array_equal(shared.log_map, heat_log_map(mesh, distance, sources).log_map)


def test_a_point_in_a_face_is_refused():
    mesh = shapes.icosphere(1)
    point = Sources(np.zeros(0, dtype=np.int64), SurfacePoints(np.array([0]), np.full((1, 3), 1 / 3)))
    with pytest.raises(ParameterError, match="must be a vertex"):
        heat_log_map(mesh, np.ones(mesh.n_vertices), point)


def test_heat_warns_of_directions_from_the_boundary_and_only_there(caplog):
    mesh = disk(500)
    for source, is_wrong in ((0, False), (int(np.flatnonzero(mesh.topology.boundary_vertex)[0]), True)):
        caplog.clear()
        mapped = logarithmic_map(mesh, source, "heat")
        x = np.array(mapped.results["log_map_axis"]["x_axis"])
        away = mesh.points - mesh.points[source]
        truth = np.stack([away @ x, away @ np.cross([0, 0, 1], x)], axis=1)
        error = np.linalg.norm(mapped.vertex["log_map"] - truth, axis=1)
        relative = np.sqrt((error**2).mean()) / np.linalg.norm(truth, axis=1).max()
        assert (relative > 0.05) == is_wrong
        assert any("gradient of heat leans" in text for text in caplog.messages) == is_wrong
