"""Angles, areas and cotangents of triangles from their side lengths alone.

All functions take `side_length` (m, 3), side j from corner j to corner j+1, and return values on corners:
corner k lies opposite side k+1. The orderings are Kahan's, so needles keep their relative precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT


def face_area(side_length: NDArray) -> NDArray[np.float64]:
    """Areas from side lengths, stable on needles.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m,) ndarray of float64
        Areas in length units squared; zero where the triangle inequality fails.

    Notes
    -----
    W. Kahan, "Miscalculating Area and Angles of a Needle-like Triangle", 2014.
    """
    c, b, a = np.sort(side_length, axis=1).T
    product = (a + (b + c)) * np.maximum(c - (a - b), 0.0) * (c + (a - b)) * (a + (b - c))
    return 0.25 * np.sqrt(product)


def half_angle_tangent(side_length: NDArray) -> NDArray[np.float64]:
    """tan(theta/2) of the angle at each corner, from side lengths.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        In [0, inf]; inf at the flat corner of a degenerate triangle.

    Notes
    -----
    tan^2(theta/2) = ((c+a-b) (b+a-c)) / ((a+b+c) (b+c-a)) for a the side opposite; each difference is taken
    between sorted numbers, after Kahan.
    """
    excess = triangle_excess(side_length)  # excess[:, j] = sum of the other two sides - side j
    perimeter = side_length.sum(axis=1, keepdims=True)
    opposite = excess[:, NEXT]
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = (excess / perimeter) * (excess[:, [2, 0, 1]] / opposite)
    return np.sqrt(np.nan_to_num(squared, nan=0.0, posinf=np.inf))


def triangle_excess(side_length: NDArray) -> NDArray[np.float64]:
    """(m, 3) sum of the other two sides minus side j, clipped at zero; Kahan's order of subtraction."""
    a = side_length
    b, c = side_length[:, NEXT], side_length[:, [2, 0, 1]]
    large, small = np.maximum(b, c), np.minimum(b, c)
    return np.maximum(np.where(a > large, small - (a - large), small + (large - a)), 0.0)


def corner_angle(side_length: NDArray) -> NDArray[np.float64]:
    """(m, 3) interior angle at each corner, in radians."""
    return 2.0 * np.arctan(half_angle_tangent(side_length))


def corner_cotan(side_length: NDArray) -> NDArray[np.float64]:
    """(m, 3) cotangent of the angle at each corner; infinite in a degenerate triangle."""
    t = half_angle_tangent(side_length)
    with np.errstate(divide="ignore", invalid="ignore"):
        return 0.5 * (1.0 / t - t)
