"""Vertex normals, tangent frames and symmetric tensors in tangent planes, for all vertices at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class Principal:
    """Pointwise curvature of a surface at its vertices; positive where convex with outward orientation.

    Parameters
    ----------
    low, high : (n,) ndarray
        Principal curvatures, low <= high, in 1/length.
    low_direction, high_direction : (n, 3) ndarray
        Unit tangents, orthogonal; any pair where the two curvatures agree.
    gaussian : (n,) ndarray
        The scheme's own Gaussian curvature, in 1/length^2.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    low_direction: NDArray[np.float64]
    high_direction: NDArray[np.float64]
    gaussian: NDArray[np.float64]

    @property
    def mean(self) -> NDArray[np.float64]:
        """(n,) half the sum of the principal curvatures."""
        return 0.5 * (self.low + self.high)


def cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(3, k) cross products of (3, k) arrays: components first, so that every pass is contiguous."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(k,) scalar products of (3, k) arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def vertex_sum(mesh: TriangleMesh, corner_values: NDArray) -> NDArray[np.float64]:
    """(..., n) sums of (..., m, 3) corner values at vertices."""
    corner, n = mesh.faces.ravel(), mesh.n_vertices
    rows = corner_values.reshape(-1, len(corner))
    total = np.stack([np.bincount(corner, row, n) for row in rows]).astype(np.float64, copy=False)
    return total.reshape(*corner_values.shape[:-2], n)


def vertex_sum_of_faces(mesh: TriangleMesh, face_values: NDArray) -> NDArray[np.float64]:
    """(k, n) sums of (k, m) face values at the faces' vertices."""
    corner, n = mesh.faces.ravel(), mesh.n_vertices
    return np.stack([np.bincount(corner, np.repeat(row, 3), n) for row in face_values])


def unit_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n, 3) vertex normals with Max's weights, exact on any mesh inscribed in a sphere; +z where undefined.

    Notes
    -----
    N. Max, "Weights for Computing Vertex Normals from Facet Normals", 1999: each corner adds the cross
    product of its two sides divided by the squares of both lengths.
    """
    side = mesh.side_vector
    squared = np.einsum("fki,fki->fk", side, side)
    doubled = cross(side[:, 0].T, side[:, 1].T)
    product = squared * squared[:, [2, 0, 1]]
    weight = np.divide(1.0, product, out=np.zeros_like(product), where=product > 0)
    total = vertex_sum(mesh, weight * doubled[:, :, None])
    length = np.sqrt(dot(total, total))
    unit = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    unit[2, length == 0] = 1.0
    return np.ascontiguousarray(unit.T)


def tangent_frame(normal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two (n, 3) unit tangents that make a right-handed frame with unit normals.

    Notes
    -----
    T. Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = normal.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)


def eigen_2x2(xx: NDArray, xy: NDArray, yy: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Eigenvalues low <= high of symmetric 2 x 2 matrices, and cos and sin of the high one's direction."""
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    reach = np.hypot(half, xy)
    angle = 0.5 * np.arctan2(xy, half)
    return middle - reach, middle + reach, np.cos(angle), np.sin(angle)


def in_tangent_plane(
    tensor: NDArray, first: NDArray, second: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Entries xx, xy, yy of (6, n) symmetric tensors (xx, yy, zz, yz, zx, xy) in tangent frames."""

    def form(a: NDArray, b: NDArray) -> NDArray[np.float64]:
        (ax, ay, az), (bx, by, bz) = a.T, b.T
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
    """Directions cos, sin and -sin, cos in frames: (n, 3) each."""
    return cos[:, None] * first + sin[:, None] * second, cos[:, None] * second - sin[:, None] * first
