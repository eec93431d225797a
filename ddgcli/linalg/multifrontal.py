"""Multifrontal Cholesky factorisation in stacks of dense fronts: numpy's own loops do the work.

I. Duff, J. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", 1983.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from ddgcli.linalg.fronts import FrontGroup, Stage

# entries of the fronts that are factorised together, so that they stay in the cache
CACHED = 1 << 17
# triangles up to this size are inverted in stacks
SMALL_TRIANGLE = 24


@dataclass(frozen=True, eq=False)
class FactoredGroup:
    """Eliminated fronts.

    Parameters
    ----------
    pivot : (g, s) ndarray of int64
    update : (g, u) ndarray of int64
    inverse : (g, s, s) ndarray
        Inverse of the Cholesky factor of the pivots, lower triangular.
    below : (g, u, s) ndarray
        Rows of the Cholesky factor below the pivots.
    """

    pivot: NDArray[np.int64]
    update: NDArray[np.int64]
    inverse: NDArray
    below: NDArray

    def some(self, fronts: NDArray) -> FactoredGroup:
        """Some of the fronts."""
        return FactoredGroup(
            self.pivot[fronts], self.update[fronts], self.inverse[fronts], self.below[fronts]
        )


def factored(stages: list[Stage], data: NDArray) -> list[FactoredGroup]:
    """Cholesky factor of a matrix with the given entries, stage by stage.

    Raises
    ------
    numpy.linalg.LinAlgError
        When a pivot is not positive.
    """
    found = _unfilled([group for stage in stages for group in stage.groups], data.dtype)
    to_fill = iter(found)
    memory = np.zeros(stages[0].size, dtype=data.dtype)
    for k, stage in enumerate(stages):
        memory[stage.place] += data[stage.entry]
        memory[stage.padding] = 1.0
        above = np.zeros(stages[k + 1].size if k + 1 < len(stages) else 0, dtype=data.dtype)
        for group in stage.groups:
            _eliminate(group, memory, above, next(to_fill))
        memory = above
    return found


def _unfilled(groups: list[FrontGroup], kind: np.dtype) -> list[FactoredGroup]:
    """Room for the factor in one piece of memory, so that what is scratch in between leaves no holes."""
    shapes = [(*group.pivot.shape, group.update.shape[1]) for group in groups]
    room = np.empty(sum(g * s * (s + u) for g, s, u in shapes), dtype=kind)
    found, begin = [], 0
    for group, (g, s, u) in zip(groups, shapes, strict=True):
        middle, end = begin + g * s * s, begin + g * s * (s + u)
        inverse, below = room[begin:middle].reshape(g, s, s), room[middle:end].reshape(g, u, s)
        found.append(FactoredGroup(group.pivot, group.update, inverse, below))
        begin = end
    return found


def _eliminate(group: FrontGroup, memory: NDArray, above: NDArray, found: FactoredGroup) -> None:
    """Eliminate a group, some fronts at a time, and add their updates to the memory of the next stage."""
    g, s = group.pivot.shape
    f = s + group.update.shape[1]
    stack = memory[group.start : group.start + g * f * f].reshape(g, f, f)
    step = max(1, CACHED // (f * f))
    for begin in range(0, g, step):
        some = slice(begin, begin + step)
        front, inverse, below = stack[some], found.inverse[some], found.below[some]
        inverse[:] = inverted_triangles(np.linalg.cholesky(front[:, :s, :s]))
        np.matmul(front[:, s:, :s], _adjoint(inverse), out=below)
        if f > s:
            update = front[:, s:, s:] - below @ _adjoint(below)
            place = group.row[some][:, :, None] + group.column[some][:, None, :]
            np.add.at(above, place.ravel(), update.ravel())


def inverted_triangles(lower: NDArray) -> NDArray:
    """(g, s, s) inverses of lower triangular matrices: many small ones row by row, others one by one."""
    g, s = lower.shape[:2]
    inverse = np.zeros_like(lower)
    if s > SMALL_TRIANGLE or g < 2 * s:
        (invert,) = get_lapack_funcs(("trtri",), (lower,))
        for one, found in zip(lower, inverse, strict=True):
            found[:] = invert(one.T, lower=0)[0].T
        return inverse
    pivot = 1.0 / np.einsum("gii->gi", lower)
    for i in range(s):
        inverse[:, i, :i] = (lower[:, i, None, :i] @ inverse[:, :i, :i])[:, 0] * -pivot[:, i, None]
        inverse[:, i, i] = pivot[:, i]
    return inverse


def solved(groups: list[FactoredGroup], rhs: NDArray) -> NDArray:
    """Solution for (n,) or (n, k) right-hand sides; what a sparse one does not reach is passed over."""
    n, k = len(rhs), 1 if rhs.ndim == 1 else rhs.shape[1]
    x = np.zeros((n + 1, k), dtype=rhs.dtype)  # the last row is for what pads
    x[:n] = rhs.reshape(n, k)
    flat = x.reshape(-1)
    for group in groups:
        known = x[group.pivot]
        lit = np.flatnonzero(known.any(axis=(1, 2)))
        if not len(lit):
            continue
        if 2 * len(lit) < len(known):
            group, known = group.some(lit), known[lit]
        reduced = x[group.pivot] = group.inverse @ known
        place = group.update.ravel() if k == 1 else (group.update[:, :, None] * k + np.arange(k)).ravel()
        np.subtract.at(flat, place, (group.below @ reduced).ravel())
    if np.iscomplexobj(x):
        x = x.conj()  # once, instead of every block
    for group in reversed(groups):
        known = x[group.pivot] - group.below.swapaxes(1, 2) @ x[group.update]
        x[group.pivot] = group.inverse.swapaxes(1, 2) @ known
    found = x[:n].reshape(rhs.shape)
    return found.conj() if np.iscomplexobj(found) else found


def _adjoint(stack: NDArray) -> NDArray:
    return stack.swapaxes(-1, -2).conj() if np.iscomplexobj(stack) else stack.swapaxes(-1, -2)
