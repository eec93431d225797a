"""Vertex normals, tangent frames and symmetric tensors in tangent planes, for all vertices at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.faces import Faces
from ddgcli.geometry.normals import area_normal_columns, sphere_normal_columns


@dataclass(frozen=True, eq=False)
class PrincipalCurvatures:
    """Pointwise curvature of a surface at its vertices; positive where convex with outward orientation.

    Parameters
    ----------
    low, high : (n,) ndarray
        Principal curvatures, low <= high, in 1/length.
    low_direction, high_direction : (3, n) ndarray
        Unit tangents, orthogonal; any pair where the two curvatures agree. (3, 0) where the
        caller of `cotan` needs none.
    gaussian : (n,) ndarray
        The scheme's own Gaussian curvature, in 1/length^2.
    in_rings : bool
        Whether fits were to have balls, which hold no more vertices than the rings of any vertex.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    low_direction: NDArray[np.float64]
    high_direction: NDArray[np.float64]
    gaussian: NDArray[np.float64]
    in_rings: bool = False

    @property
    def mean(self) -> NDArray[np.float64]:
        """(n,) half the sum of the principal curvatures."""
        return 0.5 * (self.low + self.high)


def unit_normals(faces: Faces) -> NDArray[np.float64]:
    """Vertex normals with Max's weights, exact on any mesh inscribed in a sphere.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, n) ndarray of float64
        Unit vectors; +z where undefined.
    """
    return _upward_where_zero(sphere_normal_columns(faces))


def area_normals(faces: Faces) -> NDArray[np.float64]:
    """Vertex normals weighted by area: coarser than Max's, but robust to tiny noisy faces.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, n) ndarray of float64
        Unit vectors; +z where undefined.
    """
    return _upward_where_zero(area_normal_columns(faces))


def _upward_where_zero(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    unit[2, ~unit.any(axis=0)] = 1.0
    return unit


def tangent_frame(normal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit tangents that make a right-handed frame with a unit normal.

    Parameters
    ----------
    normal : (3, n) ndarray of float64

    Returns
    -------
    first, second : (3, n) ndarray of float64

    Notes
    -----
    T. Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = normal
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    return first, np.stack([b, sign + y * y * a, -y])


def eigen_2x2(xx: NDArray, xy: NDArray, yy: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Eigenvalues of symmetric 2 x 2 matrices, and the direction of the larger one.

    Parameters
    ----------
    xx, xy, yy : (n,) ndarray of float64
        Entries.

    Returns
    -------
    low, high : (n,) ndarray of float64
        low <= high.
    cos, sin : (n,) ndarray of float64
        Eigenvector of `high`; (-sin, cos) belongs to `low`.
    """
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    reach = np.hypot(half, xy)
    angle = 0.5 * np.arctan2(xy, half)
    return middle - reach, middle + reach, np.cos(angle), np.sin(angle)


def in_tangent_plane(
    tensor: NDArray, first: NDArray, second: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Entries of symmetric tensors in tangent frames.

    Parameters
    ----------
    tensor : (6, n) ndarray of float64
        xx, yy, zz, yz, zx, xy.
    first, second : (3, n) ndarray of float64
        Unit tangents.

    Returns
    -------
    xx, xy, yy : (n,) ndarray of float64
    """

    def form(a: NDArray, b: NDArray) -> NDArray[np.float64]:
        (ax, ay, az), (bx, by, bz) = a, b
        t = tensor
        return (
            t[0] * ax * bx
            + t[1] * ay * by
            + t[2] * az * bz
            + t[3] * (ay * bz + az * by)
            + t[4] * (az * bx + ax * bz)
            + t[5] * (ax * by + ay * bx)
        )

    return form(first, first), form(first, second), form(second, second)


def turned(first: NDArray, second: NDArray, cos: NDArray, sin: NDArray) -> tuple[NDArray, NDArray]:
    """Axes of frames after a rotation in their planes.

    Parameters
    ----------
    first, second : (3, n) ndarray of float64
    cos, sin : (n,) ndarray of float64
        Cosine and sine of the angle.

    Returns
    -------
    first, second : (3, n) ndarray of float64
    """
    return cos * first + sin * second, cos * second - sin * first
