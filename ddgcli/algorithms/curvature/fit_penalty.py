"""Residuals of fits of several degrees to heights, and the penalty that predicts the heights best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import tangent_frame
from ddgcli.algorithms.curvature.polynomial_fits import (
    LOW_TERM_PENALTY,
    QUARTIC,
    local_coordinates,
    normal_equations,
    scaled,
    sums,
)
from ddgcli.algorithms.curvature.regions import Regions, chunks

_PENALTIES = (1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4)  # from a quartic fit to a quadratic one
QUADRATIC_PENALTY = _PENALTIES[-1]
_MAX_TESTED = 400  # vertices of a region
_MAX_PAIRS = 40_000  # neighbours handled at once


def cross_validated_penalty(columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray) -> float:
    """Penalty whose fits over the regions of some vertices predict their data best.

    Parameters
    ----------
    columns, normal : (3, n) ndarray of float64
        Positions, and unit normals.
    some : Regions
        Regions of the k vertices.
    vertices : (k,) ndarray of int64

    Returns
    -------
    float
        Relative penalty of the terms of degree three and four.

    Notes
    -----
    Generalised cross-validation: the least of residual / (data - degrees of freedom)^2, in the mean of the
    logarithms, so that a few creases do not decide for all.
    """
    if len(vertices) == 0:
        return _PENALTIES[-1]
    return _best_penalty(*_systems(columns, normal, some, vertices))


def testable_regions(regions: Regions) -> NDArray[np.int64]:
    """Choose the regions with enough vertices to test a fit, and not so many that each takes long.

    Parameters
    ----------
    regions : Regions

    Returns
    -------
    (c,) ndarray of int64
        Numbers of regions.
    """
    return np.flatnonzero((regions.count > len(QUARTIC.terms) + 3) & (regions.count <= _MAX_TESTED))


def sampled_regions(columns: NDArray, centre: NDArray, regions: Regions, most: int) -> NDArray[np.int64]:
    """Choose about `most` regions with enough vertices to test a fit, small and large ones.

    Parameters
    ----------
    columns : (3, n) ndarray of float64
        Positions.
    centre : (3, k) ndarray of float64
        Centres of the regions.
    regions : Regions
    most : int

    Returns
    -------
    (c,) ndarray of int64
        Numbers of regions, ordered by their size where there are more than `most`, so that the choice does
        not depend on the numbering of the vertices.
    """
    able = testable_regions(regions)
    if len(able) > most:
        size = _squared_offset(columns, centre, regions)[able]
        able = able[np.argsort(size, kind="stable")][:: len(able) // most]
    return able


def _systems(
    columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Normal equations (k, p, p), right-hand sides (k, p, 1), squared heights and counts of some vertices."""
    vertex_frame = np.concatenate([*tangent_frame(normal[:, vertices]), normal[:, vertices]])
    x, y, z = local_coordinates(columns, columns[:, vertices], vertex_frame, some.start, some.member)
    x, y, _ = scaled(x, y, some.start)
    matrix, right = normal_equations(x, y, z, some.start)
    return matrix.transpose(2, 0, 1), right.T[..., None], sums(z * z, some.start), some.count


def polynomial_residuals(
    columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray, degrees: tuple[int, ...]
) -> NDArray[np.float64]:
    """Standard deviation of the heights around each vertex from their fits of some degrees.

    An unbiased estimate of the noise of vertices along the normal, where the surface itself is a polynomial
    of that degree.

    Parameters
    ----------
    columns, normal : (3, n) ndarray of float64
        Positions, and unit normals.
    some : Regions
        Regions of the k vertices.
    vertices : (k,) ndarray of int64
    degrees : tuple of d ints
        Up to 4.

    Returns
    -------
    (d, k) ndarray of float64
        A length; NaN where a region has too few vertices for a fit.
    """
    matrix, right, squared, count = _systems(columns, normal, some, vertices)
    deviation = []
    for degree in degrees:
        low = np.array([k for k, (a, b) in enumerate(QUARTIC.terms) if a + b <= degree])
        low_block = matrix[:, low[:, None], low] + LOW_TERM_PENALTY * count[:, None, None] * np.eye(len(low))
        explained = np.einsum("nij,nij->n", right[:, low], _inverse(low_block) @ right[:, low])
        free = np.where(count > len(low), count - len(low), np.nan)
        deviation.append(np.sqrt(np.maximum(squared - explained, 0.0) / free))
    return np.stack(deviation)


def _best_penalty(matrix: NDArray, right: NDArray, squared: NDArray, count: NDArray) -> float:
    flat = squared <= 0
    squared = np.where(flat, 1.0, squared)
    scores = []
    for penalty in _PENALTIES:
        weight = np.diag(QUARTIC.weight * (penalty * QUARTIC.is_high + LOW_TERM_PENALTY))
        inverse = _inverse(matrix + weight * count[:, None, None])
        fitted = inverse @ right
        explained = np.einsum("nij,nij->n", 2 * right - matrix @ fitted, fitted)
        degrees = np.einsum("nij,nji->n", inverse, matrix)
        rest = np.maximum(1.0 - explained / squared, 1e-26)
        scores.append(float(np.log(rest / (count - degrees) ** 2).mean()))
    return _PENALTIES[int(np.argmin(scores))]


def _inverse(matrix: NDArray) -> NDArray[np.float64]:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # a sampled vertex whose neighbours lie on a line
        return np.linalg.pinv(matrix, hermitian=True)


def _squared_offset(columns: NDArray, centre: NDArray, regions: Regions) -> NDArray[np.float64]:
    """(k,) squared distance from each centre to the mean of its region: a size that needs no frame."""
    total = np.zeros(len(regions.start) - 1)
    for begin, end in chunks(regions, _MAX_PAIRS):
        member = regions.member[regions.start[begin] : regions.start[end]].astype(np.intp, copy=False)
        start = regions.start[begin : end + 1] - regions.start[begin]
        count = np.diff(start)
        for c, o in zip(columns, centre):
            mean = np.zeros(end - begin)
            mean[count > 0] = np.add.reduceat(np.take(c, member), start[:-1][count > 0])
            total[begin:end] += (mean / np.maximum(count, 1) - o[begin:end]) ** 2
    return total
