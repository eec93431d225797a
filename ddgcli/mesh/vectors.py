"""Vector algebra on arrays: rows (..., d), and columns (3, ...) where contiguous passes matter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def vector_length(vectors: NDArray) -> NDArray[np.float64]:
    """Euclidean length of vectors, safe at 1e-160 and 1e160.

    Parameters
    ----------
    vectors : (..., d) ndarray of float64

    Returns
    -------
    (...,) ndarray of float64
    """
    largest = np.abs(vectors).max(initial=0.0)
    if largest == 0.0 or 1e-100 < largest < 1e150:
        return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    scaled = vectors / largest
    return largest * np.sqrt(np.einsum("...i,...i->...", scaled, scaled))


def bounding_box(points: NDArray) -> tuple[NDArray, NDArray]:
    """Least and greatest coordinates of points.

    Parameters
    ----------
    points : (n, d) ndarray of float64
        At least one.

    Returns
    -------
    low, high : (d,) ndarray of float64

    Notes
    -----
    Column by column: reductions of rows of three take 25 times as long.
    """
    return np.array([c.min() for c in points.T]), np.array([c.max() for c in points.T])


def row_matrix(values: NDArray) -> NDArray:
    """Entries of each of n rows, of any shape, as a matrix; `reshape(n, -1)` fails where n is 0.

    Parameters
    ----------
    values : (n, ...) ndarray

    Returns
    -------
    (n, k) ndarray
    """
    return values.reshape(len(values), int(np.prod(values.shape[1:])))


def unit_vectors(vectors: NDArray) -> NDArray[np.float64]:
    """Scale vectors to unit length.

    Parameters
    ----------
    vectors : (..., d) ndarray of float64

    Returns
    -------
    (..., d) ndarray of float64
        Zero where the vector is zero.
    """
    length = vector_length(vectors)[..., None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def row_dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Scalar products of vectors stored as rows.

    Parameters
    ----------
    a, b : (..., d) ndarray of float64

    Returns
    -------
    (...,) ndarray of float64
    """
    return np.einsum("...i,...i->...", a, b)


def tangential(vectors: NDArray, unit: NDArray) -> NDArray[np.float64]:
    """Parts of vectors stored as rows that are orthogonal to unit vectors.

    Parameters
    ----------
    vectors : (..., d) ndarray of float64
    unit : (..., d) ndarray of float64
        Of unit length: normals leave the tangential part, tangents the normal one.

    Returns
    -------
    (..., d) ndarray of float64

    Examples
    --------
    >>> tangential(np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, 0.0, 1.0]])).tolist()
    [[1.0, 2.0, 0.0]]
    """
    return vectors - row_dot(vectors, unit)[..., None] * unit


def cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Cross products of vectors stored as columns.

    Parameters
    ----------
    a, b : (3, ...) ndarray of float64

    Returns
    -------
    (3, ...) ndarray of float64
    """
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    less = np.empty(product.shape[1:], product.dtype)
    for i in range(3):  # into place: a stack of three rows takes twice as long
        j, k = (i + 1) % 3, (i + 2) % 3
        np.multiply(a[j], b[k], out=product[i, ...])
        np.multiply(a[k], b[j], out=less)
        product[i] -= less
    return product


def row_cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Cross products of vectors stored as rows.

    Parameters
    ----------
    a, b : (..., 3) ndarray of float64

    Returns
    -------
    (..., 3) ndarray of float64

    Notes
    -----
    The bits are those of `np.cross`, which takes twice as long for up to a thousand rows.
    """
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        np.multiply(a[..., j], b[..., k], out=product[..., i])
        product[..., i] -= a[..., k] * b[..., j]
    return product


def cross_matrix(v: NDArray) -> NDArray[np.float64]:
    """Skew-symmetric matrices M of vectors v, with M w = v x w.

    Parameters
    ----------
    v : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3, 3) ndarray of float64
    """
    matrix = np.zeros((len(v), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[:, j, i], matrix[:, i, j] = v[:, k], -v[:, k]
    return matrix


def dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Scalar products of vectors stored as columns.

    Parameters
    ----------
    a, b : (3, ...) ndarray of float64

    Returns
    -------
    (...,) ndarray of float64
    """
    total: NDArray[np.float64] = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def ratio(a: NDArray | float, b: NDArray) -> NDArray[np.float64]:
    """Quotient a / b, and 0 where b is 0.

    Parameters
    ----------
    a : ndarray or float
    b : ndarray

    Returns
    -------
    ndarray of float64
        Has the broadcast shape of `a` and `b`.
    """
    shape = np.broadcast_shapes(np.shape(a), b.shape)
    if b.all():  # a division with a mask takes twice as long
        return np.divide(a, b, out=np.empty(shape))
    return np.divide(a, b, out=np.zeros(shape), where=b != 0)


def angle_of(sine: NDArray, cosine: NDArray) -> NDArray[np.float64]:
    """Angle from multiples of its sine and cosine.

    Parameters
    ----------
    sine, cosine : (k,) ndarray of float64

    Returns
    -------
    (k,) ndarray of float64
        In radians, in [-pi, pi].

    Notes
    -----
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
    """Signed volumes of the tetrahedra over triangles, with their apex at the origin.

    Parameters
    ----------
    a, b, c : (3, m) ndarray of float64
        Corners of the triangles.

    Returns
    -------
    (m,) ndarray of float64
        Positive where the triangle is counter-clockwise as seen from outside.
    """
    return dot(cross(a, b), c) / 6.0


def moved_rigidly(points: NDArray, row: NDArray) -> NDArray[np.float64]:
    """Positions of points after a rigid motion.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    row : (12,) ndarray of float64
        Rotation matrix by rows, then translation.

    Returns
    -------
    (n, 3) ndarray of float64
    """
    return points @ row[:9].reshape(3, 3).T + row[9:12]


def tangents(normal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors that make a right-handed frame with a unit normal.

    Parameters
    ----------
    normal : (3,) ndarray of float64
        Of unit length.

    Returns
    -------
    first, second : (3,) ndarray of float64
        first x second = normal; along axes where the normal is along one.
    """
    axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    second = row_cross(normal, axis)
    second /= np.linalg.norm(second)
    return row_cross(second, normal), second
