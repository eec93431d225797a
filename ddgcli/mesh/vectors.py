"""Vector algebra on arrays: rows (..., d), and columns (3, ...) where contiguous passes matter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def vector_length(vectors: NDArray) -> NDArray[np.float64]:
    """(...,) Euclidean length of (..., d) vectors, safe at 1e-160 and 1e160."""
    largest = np.abs(vectors).max(initial=0.0)
    if largest == 0.0 or 1e-100 < largest < 1e150:
        return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    scaled = vectors / largest
    return largest * np.sqrt(np.einsum("...i,...i->...", scaled, scaled))


def bounding_box(points: NDArray) -> tuple[NDArray, NDArray]:
    """(d,) least and greatest coordinates of (n, d) points, n > 0.

    Column by column: reductions of rows of three take 25 times as long.
    """
    return np.array([c.min() for c in points.T]), np.array([c.max() for c in points.T])


def row_matrix(values: NDArray) -> NDArray:
    """(n, k) entries of each of n rows, of any shape; `reshape(n, -1)` fails where n is 0."""
    return values.reshape(len(values), int(np.prod(values.shape[1:])))


def unit_vectors(vectors: NDArray) -> NDArray[np.float64]:
    """(..., d) vectors at unit length; zero where they are zero."""
    length = vector_length(vectors)[..., None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def row_dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(...,) scalar products of (..., d) vectors."""
    return np.einsum("...i,...i->...", a, b)


def cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(3, ...) cross products of (3, ...) columns."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(...) scalar products of (3, ...) columns."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def ratio(a: NDArray | float, b: NDArray) -> NDArray[np.float64]:
    """Quotient a / b, and 0 where b is 0."""
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(np.shape(a), b.shape)), where=b != 0)


def angle_of(sine: NDArray, cosine: NDArray) -> NDArray[np.float64]:
    """(k,) angle in radians, in -pi .. pi, of multiples of its sine and cosine.

    The arctangent of the quotient takes half the time of `np.arctan2`, which computes the obtuse ones.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        angle = np.divide(sine, cosine)
    np.arctan(angle, out=angle)
    obtuse = np.flatnonzero(~(cosine > 0))
    if len(obtuse):
        angle[obtuse] = np.arctan2(sine[obtuse], cosine[obtuse])
    return angle


def cone_volume(a: NDArray, b: NDArray, c: NDArray) -> NDArray[np.float64]:
    """(m,) signed volumes of tetrahedra over triangles with corners a, b, c (3, m), apex at the origin."""
    return dot(cross(a, b), c) / 6.0


def moved_rigidly(points: NDArray, row: NDArray) -> NDArray[np.float64]:
    """(n, 3) points after a rigid motion, given as (12,) rotation by rows, then translation."""
    return points @ row[:9].reshape(3, 3).T + row[9:12]


def tangents(normal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors that make a right-handed frame with a unit normal (3,); axes where it is one."""
    axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    second = np.cross(normal, axis)
    second /= np.linalg.norm(second)
    return np.cross(second, normal), second
