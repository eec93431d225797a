"""Angles between the circumcircles of two triangles with a common edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import cross, dot


def side_product(
    a: NDArray, b: NDArray, c: NDArray, d: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Product of the unit sides of quadrilaterals as imaginary quaternions.

    Parameters
    ----------
    a, b, c, d : (3, h) ndarray of float64
        Unit vectors.

    Returns
    -------
    real : (h,) ndarray of float64
    imaginary : (3, h) ndarray of float64

    Notes
    -----
    The angle between both circles through three successive corners is pi less the argument of the product
    (A. Bobenko, P. Schroeder, "Discrete Willmore flow", 2005).
    """
    ab, cd, left, right = dot(a, b), dot(c, d), cross(a, b), cross(c, d)
    return dot(left, right) - ab * cd, cross(left, right) - ab * right - cd * left


def circle_angle(real: NDArray, imaginary: NDArray) -> NDArray[np.float64]:
    """Angles between the circumcircles, by both parts of the product of sides.

    Parameters
    ----------
    real : (h,) ndarray of float64
    imaginary : (3, h) ndarray of float64
        As returned by `side_product`.

    Returns
    -------
    (h,) ndarray of float64
        In radians, in [0, pi]. The arccosine of one part alone loses half the digits near 0 and pi.

    Examples
    --------
    The corners of a square lie on one circle:

    >>> a, b = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [1.0], [0.0]])
    >>> circle_angle(*side_product(a, b, -a, -b)).tolist()
    [0.0]
    """
    return np.arctan2(np.sqrt(dot(imaginary, imaginary)), real)
