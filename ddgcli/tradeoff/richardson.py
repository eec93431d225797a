"""Limits of refined answers, with the uncertainty that the refinements themselves show."""

from __future__ import annotations

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
        Aitken's extrapolation with each entry's own observed rate, held between 0.5 and 4 powers of h.
    uncertainty : (k,) ndarray
        How far the limit lies from the finest answer: the extrapolation itself is not trusted beyond.
    """
    first, second = middle - coarse, fine - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(second != 0, np.abs(first / second), 4.0)
    ratio = np.clip(np.where(np.isfinite(ratio), ratio, 4.0), 2**0.5, 2**4)
    limit = fine + second / (ratio - 1.0)
    return limit, np.abs(limit - fine)


SLOWEST = 1.1  # ratio of successive differences below which a sequence counts as not yet converging
UNSETTLED = (
    5.0  # of the largest difference, where those of a scheme of known order do not fall as they should
)


def left_to_go(*differences: float, order: float | None = None) -> float:
    """How far the last of several answers, each with half the step, may be from the limit of small steps.

    Parameters
    ----------
    *differences : float
        Successive ones: of a number with their signs, else their sizes. The last two count, or all with
        `order`.
    order : float, optional
        Of the scheme. Differences that change sign, or whose ratio is not 2^order but for a factor of two,
        have not begun to fall (stiff modes that no step resolved so far).

    Returns
    -------
    float
        The larger difference (two answers may agree by accident), or what a geometric series of their ratio
        still adds up to, if that is more; where they do not fall, ten times the last one. Where the order
        says that they have not begun to, five times the largest. Where all agree, rounding is left.
    """
    first, second = (abs(d) for d in differences[-2:])
    if not (np.isfinite(first) and second > 0.0):
        return float(max(first, second, 1e-14))
    if order is not None and not _settled(np.array(differences), 2.0**order):
        return float(UNSETTLED * max(abs(d) for d in differences))
    return float(max(first, second, second / (max(first / second, SLOWEST) - 1.0), 1e-14))


def _settled(differences: NDArray, ratio: float) -> bool:
    with np.errstate(divide="ignore", invalid="ignore"):
        found = differences[:-1] / differences[1:]
    return bool(((found > 0.5 * ratio) & (found < 2.0 * ratio)).all())
