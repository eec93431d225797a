"""Bias of quadratic fits in balls that a comparison of radii does not reveal.

If the smallest balls contain whole features, wider ones have similar errors, and the curvature changes by
less than its error. Two other estimates are used. First, the height of a circle grows faster than the square
of the distance, so fits in strongly curved balls overestimate the curvature. Second, the fits of the default
region are nearly free of bias. Their noise minus that of a good fit in a ball is independent of the latter
(otherwise a mean of both would be a better fit), so the difference depends on the curvature in balls only
through a bias, as in Hausman's test.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures

# A circle of curvature k has the height k x^2 / 2 + k^3 x^4 / 8. The curvature of its quadratic fit over a
# disk of radius a is too large by this fraction of (k a)^2.
CIRCLE_OVERSHOOT = 3 / 16
MIN_SIGNIFICANCE = 2.0  # variance that the regression explains, over that which each term explains by chance
MIN_INDEPENDENT = 1e-3  # share of a term that earlier ones do not explain, below which it is left out
MAX_TAIL = 3.0  # bound of the differences, over their median size


def hidden_bias(
    default: NDArray,
    at: PrincipalCurvatures,
    after: PrincipalCurvatures,
    radius: float,
    *,
    bound: float = np.inf,
    independent: bool = True,
) -> float:
    """Mean size of the bias of the mean curvature in balls that its changes with the radius do not show.

    Parameters
    ----------
    default : (k,) ndarray of float64
        Mean curvature over the default region.
    at, after : PrincipalCurvatures
        Fits in balls of the radius, and of the next one.
    radius : float
    bound : float
        Bound of the overshoot at a vertex over the median one.
    independent : bool
        Whether vertices deviate at random; on stairs, neighbours deviate together.

    Returns
    -------
    float
        In 1/length.

    References
    ----------
    J. A. Hausman, "Specification tests in econometrics", 1978.
    """
    overshoot = np.abs(_overshoot(at, radius))
    if bound < np.inf:
        overshoot = np.minimum(overshoot, bound * np.median(overshoot))
    bias = float(overshoot.mean())
    if not independent:
        return bias
    terms = [at.mean - at.mean.mean(), at.mean - after.mean - (at.mean - after.mean).mean()]
    return max(bias, _explained(default - at.mean, terms))


def _overshoot(fits: PrincipalCurvatures, radius: float) -> NDArray[np.float64]:
    """(k,) share of the mean curvature that circles of the fitted curvatures would have too much of."""
    total = np.zeros(len(fits.low))
    for curvature in (fits.low, fits.high):
        # the disk of a ball of radius r on a sphere: r^2 (1 - (k r)^2 / 4), largest where k r is root of two
        squared = np.minimum((curvature * radius) ** 2, 2.0)
        share = CIRCLE_OVERSHOOT * squared * (1 - squared / 4)
        total += 0.5 * curvature * share / (1 + share)
    return total


def _explained(difference: NDArray, terms: list[NDArray]) -> float:
    """Mean size of what a regression on a constant and some terms explains, beyond chance."""
    most = MAX_TAIL * float(np.median(np.abs(difference)))
    difference = np.clip(difference, -most, most)
    basis = [np.full(len(difference), len(difference) ** -0.5)]
    for term in terms:
        rest = term - _along(term, basis)
        size = float(rest @ rest) ** 0.5
        if size > MIN_INDEPENDENT * float(term @ term) ** 0.5:
            basis.append(rest / size)
    explained = _along(difference, basis)
    square = float(explained @ explained)
    free = max(1, len(difference) - len(basis))
    by_chance = len(basis) * float(np.sum((difference - explained) ** 2)) / free
    if not square > MIN_SIGNIFICANCE * by_chance:
        return 0.0
    return float(np.abs(explained).mean()) * (1 - MIN_SIGNIFICANCE * by_chance / square) ** 0.5


def _along(values: NDArray, basis: list[NDArray]) -> NDArray[np.float64]:
    """Component of values along orthonormal ones."""
    axes = np.stack(basis)
    return (axes @ values) @ axes
