"""Triangles from side lengths keep full relative precision, against exact arithmetic."""

import mpmath
import numpy as np
import pytest

from ddgcli.geometry.intrinsic import (
    corner_angle,
    corner_cotan,
    cotan_and_area,
    face_area,
    half_angle_tangent,
    triangle_excess,
)

mpmath.mp.dps = 60
ROUNDING_UNIT = np.finfo(float).eps

# each side is one float64, so that the truth below is that of exactly these lengths
SHAPES = {
    "right": [3.0, 4.0, 5.0],
    "equilateral": [1.0, 1.0, 1.0],
    "needle": [1.0, 1.0, 1e-12],
    "long needle": [1e5, 1e5 + 3e-6, 1e-5],
    "flat cap": [1.0, 1.0, 2.0 - 1e-14],
    "skew cap": [0.3, 0.7000000000000002, 1.0],
    "almost right needle": [1e-9, 1.0, 1.0],
}


def truth(a, b, c):
    """Area, and angle and cotangent at the corner opposite a, in 60 digits."""
    a, b, c = mpmath.mpf(a), mpmath.mpf(b), mpmath.mpf(c)
    area = mpmath.sqrt((a + b + c) * (b + c - a) * (a + c - b) * (a + b - c)) / 4
    tangent = mpmath.sqrt((a + b - c) * (a - b + c) / ((a + b + c) * (b + c - a)))
    return area, 2 * mpmath.atan(tangent), (b * b + c * c - a * a) / (4 * area)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize("scale", [1.0, 2.0**-400, 2.0**400])
def test_angles_and_cotangents_have_full_relative_precision(name, turn, scale):
    side = np.roll(np.array(SHAPES[name]), turn)
    lengths = scale * side[None, :]
    cotan, angle = corner_cotan(lengths)[0], corner_angle(lengths)[0]
    for corner in range(3):
        a, b, c = side[(corner + 1) % 3], side[(corner + 2) % 3], side[corner]
        area, true_angle, true_cotan = truth(a, b, c)
        assert abs(angle[corner] / true_angle - 1) < 16 * ROUNDING_UNIT
        # relative wherever the cotangent is not itself a difference that vanishes (angles near 90 degrees)
        assert abs(cotan[corner] - true_cotan) < 16 * ROUNDING_UNIT * max(abs(true_cotan), 1)
        assert (
            abs(half_angle_tangent(lengths)[0, corner] / mpmath.tan(true_angle / 2) - 1) < 16 * ROUNDING_UNIT
        )
    if 1e-150 < scale < 1e150:
        assert abs(face_area(lengths)[0] / (area * mpmath.mpf(scale) ** 2) - 1) < 8 * ROUNDING_UNIT


def test_degenerate_triangles_give_no_nan():
    lengths = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 3.0], [3.0, 4.0, 5.0]])
    cotan, area = cotan_and_area(lengths)
    assert not np.isnan(cotan).any()
    assert np.array_equal(area, [0, 0, 0, 0, 6])
    assert cotan[0, 1] == -np.inf and cotan[0, 0] == cotan[0, 2] == np.inf
    assert not np.isnan(corner_angle(lengths)).any() and not np.isnan(half_angle_tangent(lengths)).any()


def test_angles_sum_to_pi_and_excess_follows_its_definition():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20_000, 3, 3))
    lengths = np.linalg.norm(points[:, [1, 2, 0]] - points, axis=2)
    assert np.abs(corner_angle(lengths).sum(axis=1) - np.pi).max() < 1e-13
    expected = lengths.sum(axis=1, keepdims=True) - 2 * lengths
    assert np.abs(triangle_excess(lengths) - expected).max() < 1e-14
