"""Which of two answers is surely nearer to a truth that is known up to an uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.representation import short_repr

__all__ = ["AnswerDeviation", "is_surely_nearer"]

PARALLEL_TOLERANCE = 1e-12  # relative, of the differences of two deviations and of their lengths


@dataclass(frozen=True, eq=False)
class AnswerDeviation:
    """AnswerDeviation of an answer from a reference.

    Attributes
    ----------
    answer, reference : (k,) or (k, d) ndarray
    error : callable
        (answer, reference) -> (k,) lengths of their differences, in units that depend on the reference alone.
    """

    answer: NDArray
    reference: NDArray
    error: Callable[[NDArray, NDArray], NDArray]

    __repr__ = short_repr

    def is_comparable(self, other: AnswerDeviation) -> bool:
        """Whether both are from the same reference."""
        return self.reference is other.reference and self.answer.shape == other.answer.shape

    def lengths(self) -> NDArray[np.float64]:
        """(k,) lengths, where the reference is finite."""
        return self._finite(self.error(self.answer, self.reference))

    def lengths_between(self, other: AnswerDeviation) -> NDArray[np.float64]:
        """(k,) lengths of the differences from another deviation, where the reference is finite."""
        with np.errstate(invalid="ignore"):
            shifted = self.reference + (self.answer - other.answer)
        return self._finite(self.error(shifted, self.reference))

    def _finite(self, values: NDArray) -> NDArray[np.float64]:
        finite = np.isfinite(self.reference).reshape(len(self.reference), -1).all(axis=1)
        return np.asarray(values, dtype=np.float64)[finite]


def is_surely_nearer(near: AnswerDeviation, far: AnswerDeviation, uncertainty: float, norm: str) -> bool:
    """Whether one answer errs less than another for every truth within the uncertainty of their reference.

    Let the answers deviate by x and y from the reference, and the reference by d from the truth: their errors
    are the norms of x + d and y + d. Where an entry of x and y is on the same side of the reference, d
    changes both in the same way; where they are on opposite sides, their difference by up to 2 |d|.

    Parameters
    ----------
    near, far : AnswerDeviation
        From the same reference.
    uncertainty : float
        Largest norm of d.
    norm : {'max', 'mean'}

    Returns
    -------
    bool
        False where some d may leave the order open.
    """
    x, y, between = near.lengths(), far.lengths(), near.lengths_between(far)
    if not len(y) or not np.isfinite(uncertainty):
        return False
    decide = _is_largest_less if norm == "max" else _is_mean_less
    return decide(x, y, between, uncertainty)


def _is_largest_less(x: NDArray, y: NDArray, between: NDArray, uncertainty: float) -> bool:
    """Whether max |x + d| < max |y + d| for all d whose entries are at most the uncertainty.

    Each entry of x + d has to be less than another entry of y + d, or than the same one: |x + d| < |y + d|
    holds for all such d where the bisector of -x and -y is farther from 0 than the uncertainty.
    """
    first = int(y.argmax())
    other = np.full(len(y), y[first])
    other[first] = np.delete(y, first).max(initial=0.0)
    less_than_other = x + uncertainty < other - uncertainty
    less_than_same = (y - x) * (y + x) > 2.0 * uncertainty * between
    return bool((less_than_other | less_than_same).all())


def _is_mean_less(x: NDArray, y: NDArray, between: NDArray, uncertainty: float) -> bool:
    """Whether mean |x + d| < mean |y + d| for all d with mean |d| up to the uncertainty.

    An entry of d takes at most |y| - |x| + |y - x| from |y + d| - |x + d|, at d = -y, and per unit of |d| at
    most 2, or 2 (|y| - |x|) / |y| where x and y are parallel: the mean falls most where d goes to the entries
    with the highest rate.
    """
    rise = y - x
    total = np.maximum(rise + between, 0.0)
    is_parallel = between <= np.abs(rise) + PARALLEL_TOLERANCE * (x + y)
    rate = np.full(len(y), 2.0)
    np.divide(2.0 * np.maximum(rise, 0.0), y, out=rate, where=is_parallel & (y > 0.0))
    total[is_parallel & (rise <= 0.0)] = 0.0
    is_open = (total > 0.0) & (rate > 0.0)
    rate, total = rate[is_open], total[is_open]
    order = np.argsort(-rate, kind="stable")
    cost, total = (total / rate)[order], total[order]
    share = np.minimum(cost, np.maximum(len(y) * uncertainty - (np.cumsum(cost) - cost), 0.0))
    return bool(rise.sum() > (rate[order] * share).sum())
