"""Signed distances of solids, and winding numbers."""

import numpy as np
import pytest

from ddgcli.geometry.solids import BoxGap, CylinderGap, PlaneGap, SphereGap, winding_number
from ddgcli.mesh import shapes

SOLIDS = {
    "half-space": PlaneGap([0.1, 0.0, 0.2], [1.0, 2.0, -1.0]),
    "ball": SphereGap([0.3, -0.1, 0.2], 0.7),
    "box": BoxGap([-0.5, -0.4, -0.6], [1.0, 0.7, 1.1]),
    "cylinder": CylinderGap([0.0, -0.3, 0.1], [0.5, 0.6, 0.4], 0.5),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_the_point_at_the_distance_against_the_gradient_lies_on_the_surface(name):
    points = np.random.default_rng(0).uniform(-2, 2, (300, 3))
    distance, gradient = SOLIDS[name].gap(points)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, rtol=1e-14)
    foot = points - distance[:, None] * gradient
    np.testing.assert_allclose(SOLIDS[name].gap(foot)[0], 0.0, atol=1e-14)


def test_the_centre_of_a_ball_has_a_distance_though_no_direction():
    distance, gradient = SphereGap([1.0, 2.0, 3.0], 0.5).gap(np.array([[1.0, 2.0, 3.0]]))
    assert distance[0] == -0.5 and np.array_equal(gradient, np.zeros((1, 3)))


def test_winding_numbers_count_the_layers_around_a_point():
    ball = shapes.icosphere(1)
    triangles = ball.points[ball.faces]
    points = np.array([[0.0, 0, 0], [0.3, -0.2, 0.5], [2.0, 0, 0]])
    np.testing.assert_allclose(winding_number(triangles, points), [1, 1, 0], atol=1e-14)
    twice = np.concatenate([triangles, 0.5 * triangles])
    np.testing.assert_allclose(winding_number(twice, points), [2, 1, 0], atol=1e-14)
