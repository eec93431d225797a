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


def left_to_go(first: float, second: float) -> float:
    """How far the last of three answers, each with half the step, may be from the limit of small steps.

    Parameters
    ----------
    first, second : float
        Sizes of the successive differences, 0 or more.

    Returns
    -------
    float
        The larger difference (two answers may agree by accident), or what a geometric series of their ratio
        still adds up to, if that is more; where they do not fall, ten times the last one. Where all agree,
        rounding is left.
    """
    if not (np.isfinite(first) and second > 0.0):
        return float(max(first, second, 1e-14))
    return float(max(first, second, second / (max(first / second, SLOWEST) - 1.0), 1e-14))
