"""Angles, areas and cotangents of triangles from their side lengths alone.

All functions take `side_length` (m, 3), side j from corner j to corner j+1, and return values on corners:
corner k lies opposite side k+1.

All formulas use the perimeter p and the excesses u_j = (sum of the other two sides) - side j. Kahan's order
of subtraction gives each full relative precision even on needles:

    16 area^2 = p u_a u_b u_c,   tan^2(A/2) = u_b u_c / (p u_a),   cot A = (p u_a - u_b u_c) / (8 area).

W. Kahan, "Miscalculating Area and Angles of a Needle-like Triangle", 2014.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

# faces handled at once, so that the temporaries stay in cache
BLOCK_FACES = 8192
# lengths outside this range are scaled first: their fourth powers leave the range of float64
MIN_UNSCALED_LENGTH, MAX_UNSCALED_LENGTH = 1e-70, 1e70


def face_area(side_length: NDArray) -> NDArray[np.float64]:
    """Areas of triangles from their side lengths.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64
        Side j runs from corner j to corner j+1.

    Returns
    -------
    (m,) ndarray of float64
        In length^2. Zero where the triangle inequality fails or is an equality; infinite above the range of
        numbers.

    Notes
    -----
    Heron's formula in Kahan's order of subtraction.

    Examples
    --------
    >>> face_area(np.array([[3.0, 4.0, 5.0], [1.0, 1.0, 2.0]])).tolist()
    [6.0, 0.0]
    """
    area = np.empty(len(side_length))
    with np.errstate(over="ignore"):
        for block, p, u, scale in _blocks(side_length):
            area[block] = 0.25 * np.sqrt(p * u[0]) * np.sqrt(u[1] * u[2]) * scale * scale
    return area


def corner_cotan(side_length: NDArray) -> NDArray[np.float64]:
    """Cotangent of the angle at each corner.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        Never NaN: in a triangle without area plus and minus infinity at the angles 0 and pi. Angles that the
        lengths do not determine (at a side of length zero) count as right, with cotangent zero.

    Examples
    --------
    >>> corner_cotan(np.array([[3.0, 4.0, 5.0]])).round(3).tolist()
    [[0.75, 0.0, 1.333]]
    """
    return cotan_and_area(side_length)[0]


def cotan_and_area(side_length: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cotangents of the corners and areas, in one pass.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    cotan : (m, 3) ndarray of float64
        `corner_cotan`.
    area : (m,) ndarray of float64
        `face_area`, in length^2.
    """
    m = len(side_length)
    cotan, area = np.empty((m, 3)), np.empty(m)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for block, p, (u0, u1, u2), scale in _blocks(side_length):
            pu, uu = p * u0, u1 * u2
            four_area = np.sqrt(pu) * np.sqrt(uu)
            factor = 0.5 / four_area
            cotan[block, 2] = (pu - uu) * factor
            cotan[block, 0] = (p * u1 - u2 * u0) * factor
            cotan[block, 1] = (p * u2 - u0 * u1) * factor
            area[block] = 0.25 * four_area * scale * scale
    if not np.isfinite(area).all() or (area == 0).any():
        np.nan_to_num(cotan, copy=False, nan=0.0, posinf=np.inf, neginf=-np.inf)
    return cotan, area


def half_angle_tangent(side_length: NDArray) -> NDArray[np.float64]:
    """Tangent of half the angle at each corner.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        In [0, inf]: inf at a corner of 180 degrees.
    """
    sine, cosine = _half_angle(side_length)
    with np.errstate(divide="ignore"):
        tangent: NDArray[np.float64] = sine / cosine
    return tangent


def corner_angle(side_length: NDArray) -> NDArray[np.float64]:
    """Interior angle at each corner.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        In radians, in [0, pi].

    Examples
    --------
    >>> np.degrees(corner_angle(np.array([[1.0, np.sqrt(2.0), 1.0]]))).round(9).tolist()
    [[90.0, 45.0, 45.0]]
    """
    sine, cosine = _half_angle(side_length)
    return 2.0 * np.arctan2(sine, cosine)


def mixed_voronoi_share(squared_length: NDArray, cotan: NDArray, area: NDArray) -> NDArray[np.float64]:
    """Share of each corner in the area of its triangle: the Voronoi part where the triangle is acute.

    An obtuse corner gets half of its triangle, the other two corners a quarter each.

    Parameters
    ----------
    squared_length : (3, m) ndarray
        Squares of the sides; side j runs from corner j to corner j+1.
    cotan : (3, m) ndarray
        Cotangents of the corner angles.
    area : (m,) ndarray

    Returns
    -------
    (3, m) ndarray
        In length units squared; the shares of a triangle sum to its area.

    Notes
    -----
    M. Meyer, M. Desbrun, P. Schroder, A. Barr, "Discrete differential-geometry operators for triangulated
    2-manifolds", 2003.
    """
    # part of side j at each of its ends
    half = np.stack([0.125 * squared_length[j] * cotan[(j + 2) % 3] for j in range(3)])
    share = half + half[[2, 0, 1]]
    least = np.minimum(np.minimum(cotan[0], cotan[1]), cotan[2])
    obtuse = np.flatnonzero((least < 0) | ~np.isfinite(share[0] + share[1] + share[2]))
    share[:, obtuse] = 0.25 * area[obtuse]
    share[np.argmin(cotan[:, obtuse], axis=0), obtuse] *= 2.0
    return share


def triangle_excess(side_length: NDArray) -> NDArray[np.float64]:
    """By how much the two other sides together are longer than side j.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        A length; zero where the triangle inequality fails.

    Notes
    -----
    Kahan's order of subtraction, so that the relative precision is full even on needles.
    """
    result = np.empty(side_length.shape)
    for block, _, u, scale in _blocks(side_length):
        for j in range(3):
            result[block, j] = u[j] * scale
    return result


def _half_angle(side_length: NDArray) -> tuple[NDArray, NDArray]:
    """(m, 3) multiples of sine and cosine of half the angle at each corner.

    Angles that the lengths do not determine (at a side of length zero) count as right.
    """
    sine, cosine = np.empty(side_length.shape), np.empty(side_length.shape)
    for block, p, u, _ in _blocks(side_length):
        for corner in range(3):
            a, b, c = (corner + 1) % 3, (corner + 2) % 3, corner
            sine[block, corner] = np.sqrt(u[b] * u[c])
            cosine[block, corner] = np.sqrt(p * u[a])
    undetermined = cosine == 0
    undetermined &= sine == 0
    sine[undetermined] = cosine[undetermined] = 1.0
    return sine, cosine


def _blocks(side_length: NDArray) -> Iterator[tuple[slice, NDArray, list[NDArray], float]]:
    """Blocks of faces: rows, perimeter, the three excesses, and the scale that divides both."""
    side_length = np.asarray(side_length, dtype=np.float64)
    largest = side_length.max(initial=0.0)
    scale = (
        1.0
        if MIN_UNSCALED_LENGTH < largest < MAX_UNSCALED_LENGTH or largest == 0
        else float(2.0 ** np.frexp(largest)[1])
    )
    for start in range(0, len(side_length), BLOCK_FACES):
        block = slice(start, min(start + BLOCK_FACES, len(side_length)))
        a, b, c = side_length[block].T.copy() if scale == 1.0 else side_length[block].T / scale
        u = [excess(a, b, c), excess(b, c, a), excess(c, a, b)]
        yield block, (a + b) + c, u, scale


def excess(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Triangle excess max(b + c - a, 0), without loss of relative precision where it cancels.

    Parameters
    ----------
    a, b, c : (k,) ndarray
        Lengths, in any float precision.

    Returns
    -------
    (k,) ndarray
        In the precision of the lengths.
    """
    result = signed_excess(a, b, c)
    return np.maximum(result, 0.0, out=result)


def signed_excess(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Triangle excess b + c - a, without loss of relative precision where it cancels.

    Parameters
    ----------
    a, b, c : (k,) ndarray
        Lengths, in any float precision.

    Returns
    -------
    (k,) ndarray
        In the precision of the lengths; negative where the triangle inequality fails.

    Notes
    -----
    The two close numbers are subtracted first.
    """
    result = np.maximum(b, c)
    result -= a
    result += np.minimum(b, c)
    return result
