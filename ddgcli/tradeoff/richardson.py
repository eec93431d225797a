"""Limits of sequences of refined answers, with uncertainties estimated from the sequences."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray


def richardson_limit(coarse: NDArray, middle: NDArray, fine: NDArray) -> tuple[NDArray, NDArray]:
    """Limit of three answers on meshes each twice as fine as the last, and the uncertainty of each entry.

    Parameters
    ----------
    coarse, middle, fine : (k,) ndarray

    Returns
    -------
    limit : (k,) ndarray
        Aitken's extrapolation with each entry's observed rate, clipped to 0.5 .. 4 powers of h.
    uncertainty : (k,) ndarray
        Distance of the limit from the finest answer.
    """
    first, second = middle - coarse, fine - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(second != 0, np.abs(first / second), 4.0)
    ratio = np.clip(np.where(np.isfinite(ratio), ratio, 4.0), 2**0.5, 2**4)
    limit = fine + second / (ratio - 1.0)
    return limit, np.abs(limit - fine)


def mesh_limit(*answers: NDArray, converges: bool = True) -> tuple[NDArray, NDArray]:
    """Limit of answers on meshes each twice as fine as the last, and a second answer as far off as it may be.

    Parameters
    ----------
    *answers : ndarray
        Two or three, of the same shape, coarse ones first.
    converges : bool
        Whether they have a limit at all.

    Returns
    -------
    limit : ndarray
        Extrapolation with one rate for all entries: that of the root mean squares of three answers, clipped
        to 0.5 .. 4 powers of h; the second power for two.
    other : ndarray
        An answer whose distance from the limit is its uncertainty: the last difference; half of the one
        before where differences fall faster than methods of second order converge, which is an accident (a
        slow part of the error shows in neither); where they do not fall, or have no limit, five times the
        larger, from the finest.
    """
    differences = [fine - coarse for coarse, fine in itertools.pairwise(answers)]
    last = differences[-1]
    sizes = [float(np.sqrt(np.mean(d**2))) for d in differences]
    falls = len(sizes) == 1 or sizes[-1] * MIN_DIFFERENCE_RATIO <= sizes[-2]
    if not (converges and falls):
        return answers[-1], answers[-1] + UNSETTLED_FACTOR * np.abs(differences).max(axis=0)
    if len(differences) == 1:
        limit = answers[-1] + last / 3.0
        return limit, limit + last
    ratio = min(max(sizes[-2] / sizes[-1], 2**0.5), 2.0**4) if sizes[-1] > 0 else 2.0**4
    limit = answers[-1] + last / (ratio - 1.0)
    return limit, limit + (last if ratio <= MAX_DIFFERENCE_RATIO else differences[-2] / 2.0)


MIN_DIFFERENCE_RATIO = (
    1.1  # ratio of successive differences below which a sequence counts as not yet converging
)
MAX_DIFFERENCE_RATIO = 5.0  # above which it is not the rate of a method of second order
UNSETTLED_FACTOR = (
    5.0  # of the largest difference, where those of a scheme of known order do not fall as they should
)


def remaining_error(*differences: float, order: float | None = None) -> float:
    """Estimate the distance of the last answer, each with half the step, from the limit of small steps.

    Parameters
    ----------
    *differences : float
        Differences of successive answers: signed for numbers, else norms. Only the last two count unless
        `order` is set.
    order : float, optional
        Order of the scheme. If differences change sign, or their ratio is below 2/3 or above twice 2^order,
        the sequence has not begun to converge (no step resolves the stiff modes).

    Returns
    -------
    float
        The larger difference (two answers may agree by accident), or the remainder of the geometric series of
        their ratio, if that is larger; ten times the last difference if they do not fall; five times the
        largest if `order` shows that the sequence has not begun to converge; at least rounding.
    """
    first, second = (abs(d) for d in differences[-2:])
    if not (np.isfinite(first) and second > 0.0):
        return float(max(first, second, 1e-14))
    if order is not None and not _differences_fall(np.array(differences), 2.0**order):
        return float(UNSETTLED_FACTOR * max(abs(d) for d in differences))
    return float(max(first, second, second / (max(first / second, MIN_DIFFERENCE_RATIO) - 1.0), 1e-14))


def _differences_fall(differences: NDArray, ratio: float) -> bool:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = differences[:-1] / differences[1:]
    return bool(((ratios > ratio / 1.5) & (ratios < 2.0 * ratio)).all())
