"""Tangential redistribution: better triangles, the same surface."""

import numpy as np
import pytest

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh import shapes
from ddgcli.models.willmore.redistribution import MIN_ANGLE, redistribute


def shaken_ellipsoid(level):
    """Axes 1, 1, 1.5; vertices moved along the surface by up to a third of an edge."""
    ball = shapes.icosphere(level)
    noise = np.random.default_rng(0).uniform(-1.0, 1.0, ball.points.shape) * 0.35 / 2**level
    points = ball.points + noise
    points /= np.linalg.norm(points, axis=1)[:, None]
    return ball.moved(points * [1.0, 1.0, 1.5])


def distance_off(points):
    """Distance from the ellipsoid, to first order."""
    scaled = points / [1.0, 1.0, 1.5]
    level = (scaled**2).sum(axis=1) - 1.0
    return np.abs(level) / np.linalg.norm(2.0 * scaled / [1.0, 1.0, 1.5], axis=1)


def everywhere(mesh):
    return np.ones(mesh.n_vertices, dtype=bool)


def smallest_angles(mesh):
    return corner_angle(mesh.side_length).min(axis=1)


def exact_normals(mesh):
    normal = mesh.points / np.array([1.0, 1.0, 1.5]) ** 2
    return normal / np.linalg.norm(normal, axis=1)[:, None]


@pytest.mark.parametrize("normals, order", [(exact_normals, 3), (sphere_normals, 2)])
def test_the_surface_stays(normals, order):
    """To third order with exact normals; those of uneven meshes have errors of first order."""
    error = []
    for level in (2, 3, 4):
        mesh = shaken_ellipsoid(level)
        slid = redistribute(mesh, normals(mesh), everywhere(mesh))
        assert np.abs(slid.points - mesh.points).max() > 1e-2 / 2**level
        error.append(np.sqrt((distance_off(slid.points) ** 2).mean()))
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert (rates > order - 0.4).all()


def test_small_angles_grow():
    mesh = shaken_ellipsoid(3)
    before = smallest_angles(mesh)
    after = smallest_angles(redistribute(mesh, sphere_normals(mesh), everywhere(mesh)))
    assert after.min() >= before.min() and (after < MIN_ANGLE).sum() < 0.8 * (before < MIN_ANGLE).sum()


@pytest.mark.parametrize("movable", [True, False])
def test_nothing_slides_without_need(movable):
    mesh = shapes.icosphere(2) if movable else shaken_ellipsoid(2)
    assert redistribute(mesh, sphere_normals(mesh), np.full(mesh.n_vertices, movable)) is None
