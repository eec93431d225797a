"""Multifrontal Cholesky factorisation in stacks of dense frontal matrices, vectorised with numpy.

I. Duff, J. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", 1983.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from ddgcli.linalg.assembly_tree import AssemblyLevel, FrontalGroup

# entries of the frontal matrices that are factorised together, so that they stay in the cache
MAX_CACHED_ENTRIES = 1 << 17
# triangular matrices up to this size are inverted in stacks
MAX_STACKED_TRIANGLE = 24


@dataclass(frozen=True, eq=False)
class CholeskyGroup:
    """Cholesky factors of a group of frontal matrices.

    Parameters
    ----------
    pivot : (g, s) ndarray of int64
    update : (g, u) ndarray of int64
    inverse : (g, s, s) ndarray
        Inverse of the Cholesky factor of the pivots, lower triangular.
    below : (g, u, s) ndarray
        Rows of the Cholesky factor below the pivots.
    first : int
        Row of the first pivot among the pivots of all groups; those of one group lie together.
    update_row : (g, u) ndarray of int64
        `update` as such rows.
    """

    pivot: NDArray[np.int64]
    update: NDArray[np.int64]
    inverse: NDArray
    below: NDArray
    first: int
    update_row: NDArray[np.int64]

    def subset(self, members: NDArray) -> CholeskyGroup:
        """Factors of some frontal matrices of the group."""
        inverse, below = self.inverse[members], self.below[members]
        row = self.update_row[members]
        return CholeskyGroup(self.pivot[members], self.update[members], inverse, below, self.first, row)


def cholesky_groups(levels: list[AssemblyLevel], data: NDArray) -> list[CholeskyGroup]:
    """Cholesky factor of a matrix with the entries `data`, level by level.

    Raises
    ------
    numpy.linalg.LinAlgError
        A pivot is not positive.
    """
    factors = _empty_factors([group for level in levels for group in level.groups], data.dtype)
    next_factor = iter(factors)
    memory = np.zeros(levels[0].size, dtype=data.dtype)
    for k, level in enumerate(levels):
        memory[level.place] += data[level.entry]
        memory[level.padding] = 1.0
        above = np.zeros(levels[k + 1].size if k + 1 < len(levels) else 0, dtype=data.dtype)
        for group in level.groups:
            _eliminate(group, memory, above, next(next_factor))
        memory = above
    return factors


def _empty_factors(groups: list[FrontalGroup], kind: np.dtype) -> list[CholeskyGroup]:
    """Uninitialised factors in one array, so that temporary arrays do not fragment the memory."""
    shapes = [(*group.pivot.shape, group.update.shape[1]) for group in groups]
    storage = np.empty(sum(g * s * (s + u) for g, s, u in shapes), dtype=kind)
    factors, begin, first = [], 0, 0
    row = _rows_of_pivots(groups)
    for group, (g, s, u) in zip(groups, shapes, strict=True):
        middle, end = begin + g * s * s, begin + g * s * (s + u)
        inverse, below = storage[begin:middle].reshape(g, s, s), storage[middle:end].reshape(g, u, s)
        factors.append(
            CholeskyGroup(group.pivot, group.update, inverse, below, first, row.take(group.update))
        )
        begin, first = end, first + g * s
    return factors


def _rows_of_pivots(groups: list[FrontalGroup] | list[CholeskyGroup]) -> NDArray[np.int64]:
    """Row of each unknown among the pivots of all groups; of the padding, a row that stays zero."""
    unknown = np.concatenate([group.pivot.ravel() for group in groups])
    count = 1 + max(int(numbers.max(initial=0)) for g in groups for numbers in (g.pivot, g.update))
    row = np.full(count, len(unknown))
    row[unknown] = np.arange(len(unknown))
    return row


def _eliminate(group: FrontalGroup, memory: NDArray, above: NDArray, factor: CholeskyGroup) -> None:
    """Eliminate a group in chunks that fit in the cache; add the updates to the memory of the next level."""
    g, s = group.pivot.shape
    f = s + group.update.shape[1]
    stack = memory[group.start : group.start + g * f * f].reshape(g, f, f)
    step = max(1, MAX_CACHED_ENTRIES // (f * f))
    for begin in range(0, g, step):
        chunk = slice(begin, begin + step)
        frontal, inverse, below = stack[chunk], factor.inverse[chunk], factor.below[chunk]
        inverse[:] = inverse_triangles(np.linalg.cholesky(frontal[:, :s, :s]))
        np.matmul(frontal[:, s:, :s], _adjoint(inverse), out=below)
        if f > s:
            update = frontal[:, s:, s:] - below @ _adjoint(below)
            place = group.row[chunk][:, :, None] + group.column[chunk][:, None, :]
            np.add.at(above, place.ravel(), update.ravel())


def inverse_triangles(lower: NDArray) -> NDArray:
    """(g, s, s) inverses of lower triangular matrices: stacked by rows if small, else one after the other."""
    g, s = lower.shape[:2]
    inverse = np.zeros_like(lower)
    if s > MAX_STACKED_TRIANGLE or g < 2 * s:
        (invert,) = get_lapack_funcs(("trtri",), (lower,))
        for triangle, result in zip(lower, inverse, strict=True):
            result[:] = invert(triangle.T, lower=0)[0].T
        return inverse
    pivot = 1.0 / np.einsum("gii->gi", lower)
    for i in range(s):
        inverse[:, i, :i] = (lower[:, i, None, :i] @ inverse[:, :i, :i])[:, 0] * -pivot[:, i, None]
        inverse[:, i, i] = pivot[:, i]
    return inverse


@dataclass(frozen=True, eq=False)
class PivotOrder:
    """Unknowns in the order of the pivots of all groups, those of one group together.

    Parameters
    ----------
    unknown : (p,) ndarray of int64
        n for padding.
    row : (n,) ndarray of int64
        Of each unknown, its place in `unknown`.
    """

    unknown: NDArray[np.int64]
    row: NDArray[np.int64]

    @classmethod
    def of(cls, groups: list[CholeskyGroup], n: int) -> PivotOrder:
        """The order for n unknowns."""
        return cls(np.concatenate([group.pivot.ravel() for group in groups]), _rows_of_pivots(groups)[:n])


def cholesky_solve(groups: list[CholeskyGroup], rhs: NDArray, order: PivotOrder | None = None) -> NDArray:
    """Solution for (n,) or (n, k) right-hand sides; skips frontal matrices without a non-zero entry.

    `order` is that of the groups, for many solves.
    """
    n, k = len(rhs), 1 if rhs.ndim == 1 else rhs.shape[1]
    order = order or PivotOrder.of(groups, n)
    padded = np.zeros((n + 1, k), dtype=rhs.dtype)
    padded[:n] = rhs.reshape(n, k)
    x = np.zeros((len(order.unknown) + 1, k), dtype=rhs.dtype)  # the last row is padding
    np.take(padded, order.unknown, axis=0, out=x[:-1], mode="clip")
    sparse = 2 * int(np.count_nonzero(padded)) < padded.size
    for group in groups:
        _forward(group, x, sparse)
    if np.iscomplexobj(x):
        np.conjugate(x, out=x)  # once, instead of every block
    for group in reversed(groups):
        pivots = _pivot_rows(group, x)
        if group.update.shape[1]:
            pivots -= group.below.swapaxes(1, 2) @ x.take(group.update_row, axis=0)
        pivots[:] = group.inverse.swapaxes(1, 2) @ pivots
    solution = x.take(order.row, axis=0).reshape(rhs.shape)
    return np.conjugate(solution, out=solution) if np.iscomplexobj(solution) else solution


def _pivot_rows(group: CholeskyGroup, x: NDArray) -> NDArray:
    """(g, s, k) view of the rows of the pivots of a group."""
    g, s = group.pivot.shape
    return x[group.first : group.first + g * s].reshape(g, s, x.shape[1])


def _forward(group: CholeskyGroup, x: NDArray, sparse: bool) -> None:
    """Eliminate the pivots of a group from the right-hand sides."""
    pivots = _pivot_rows(group, x)
    active = np.flatnonzero(pivots.reshape(len(pivots), -1).any(axis=1)) if sparse else None
    if active is not None and 2 * len(active) < len(pivots):
        if not len(active):
            return
        group = group.subset(active)
        reduced = pivots[active] = group.inverse @ pivots[active]
    else:
        reduced = group.inverse @ pivots
        pivots[:] = reduced
    change, row = group.below @ reduced, group.update_row.ravel()
    for j in range(x.shape[1]):
        np.subtract.at(x[:, j], row, change[:, :, j].ravel())


def _adjoint(stack: NDArray) -> NDArray:
    return stack.swapaxes(-1, -2).conj() if np.iscomplexobj(stack) else stack.swapaxes(-1, -2)
