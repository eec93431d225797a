"""Multifrontal factorisation in stacks of dense frontal matrices, vectorised with numpy.

A = L L^T if A is positive definite, else A = L J L^T with signs J. Frontal matrices whose pivots are not
definite are eliminated one by one with pivoting inside of each: at most one for each negative eigenvalue and
the others of its chunk.

I. Duff, J. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", 1983.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs, ldl

from ddgcli.linalg.assembly_tree import AssemblyLevel, FrontalGroup

# entries of the frontal matrices that are factorised together, so that they stay in the cache
MAX_CACHED_ENTRIES = 1 << 17
# triangular matrices up to this size are inverted in stacks
MAX_STACKED_TRIANGLE = 24


@dataclass(frozen=True, eq=False)
class CholeskyGroup:
    """Factors of a group of frontal matrices.

    Parameters
    ----------
    pivot : (g, s) ndarray of int64
    update : (g, u) ndarray of int64
    inverse : (g, s, s) ndarray
        Inverse of the factor of the pivots; lower triangular where they are definite.
    below : (g, u, s) ndarray
        Rows of the factor below the pivots.
    first : int
        Row of the first pivot among the pivots of all groups; those of one group lie together.
    update_row : (g, u) ndarray of int64
        `update` as such rows.
    sign : (g, s) ndarray of float64, or None
        Signs of the pivots; None if all are positive.
    """

    pivot: NDArray[np.int64]
    update: NDArray[np.int64]
    inverse: NDArray
    below: NDArray
    first: int
    update_row: NDArray[np.int64]
    sign: NDArray[np.float64] | None = None

    @property
    def negative(self) -> int:
        """Number of negative pivots; by Sylvester's law, over all groups that of negative eigenvalues."""
        return 0 if self.sign is None else int((self.sign < 0).sum())

    def subset(self, members: NDArray) -> CholeskyGroup:
        """Factors of some frontal matrices of the group."""
        inverse, below = self.inverse[members], self.below[members]
        row = self.update_row[members]
        sign = None if self.sign is None else self.sign[members]
        return CholeskyGroup(self.pivot[members], self.update[members], inverse, below, self.first, row, sign)


def cholesky_groups(
    levels: list[AssemblyLevel], data: NDArray, *, definite: bool = True
) -> list[CholeskyGroup]:
    """Factor of a matrix with the entries `data`, level by level.

    Parameters
    ----------
    levels : list of AssemblyLevel
    data : (nnz,) ndarray
        Entries of the matrix, in the order of the pattern that was analysed.
    definite : bool
        Positive definite: L L^T; else L J L^T with signs J.

    Returns
    -------
    list of CholeskyGroup
        Factors of the frontal matrices, leaves first.

    Raises
    ------
    numpy.linalg.LinAlgError
        A pivot is not positive; with definite=False, for real matrices, a block of pivots is singular.
    """
    empty = _empty_factors([group for level in levels for group in level.groups], data.dtype)
    return list(_factors(levels, data, iter(empty), definite))


def count_negative(levels: list[AssemblyLevel], data: NDArray) -> int:
    """Number of negative eigenvalues of a real matrix with the entries `data`; its factor is not stored.

    Parameters
    ----------
    levels : list of AssemblyLevel
    data : (nnz,) ndarray
        Entries of the matrix, in the order of the pattern that was analysed.

    Returns
    -------
    int

    Raises
    ------
    numpy.linalg.LinAlgError
        A block of pivots is singular.
    """
    empty = (_one_empty_factor(group) for level in levels for group in level.groups)
    return sum(factor.negative for factor in _factors(levels, data, empty, False))


def _factors(
    levels: list[AssemblyLevel], data: NDArray, empty: Iterator[CholeskyGroup], definite: bool
) -> Iterator[CholeskyGroup]:
    """The factors of all groups, level by level, in the memory of `empty`."""
    memory = np.zeros(levels[0].size, dtype=data.dtype)
    for k, level in enumerate(levels):
        memory[level.place] += data[level.entry]
        memory[level.padding] = 1.0
        above = np.zeros(levels[k + 1].size if k + 1 < len(levels) else 0, dtype=data.dtype)
        for group in level.groups:
            yield _eliminate(group, memory, above, next(empty), definite)
        memory = above


def _one_empty_factor(group: FrontalGroup) -> CholeskyGroup:
    """Uninitialised factor of one group, for no solution."""
    (g, s), u = group.pivot.shape, group.update.shape[1]
    return CholeskyGroup(group.pivot, group.update, np.empty((g, s, s)), np.empty((g, u, s)), 0, group.update)


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


def _eliminate(
    group: FrontalGroup, memory: NDArray, above: NDArray, factor: CholeskyGroup, definite: bool
) -> CholeskyGroup:
    """Eliminate a group in chunks that fit in the cache; add the updates to the memory of the next level."""
    sign = None
    g, s = group.pivot.shape
    f = s + group.update.shape[1]
    stack = memory[group.start : group.start + g * f * f].reshape(g, f, f)
    step = max(1, MAX_CACHED_ENTRIES // (f * f))
    for begin in range(0, g, step):
        chunk = slice(begin, begin + step)
        frontal, inverse, below = stack[chunk], factor.inverse[chunk], factor.below[chunk]
        try:
            inverse[:] = inverse_triangles(np.linalg.cholesky(frontal[:, :s, :s]))
            of_chunk = None
        except np.linalg.LinAlgError:
            if definite:
                raise
            of_chunk = _invert_factors(frontal[:, :s, :s], inverse)
            sign = np.ones((g, s)) if sign is None else sign
            sign[chunk] = of_chunk
        np.matmul(frontal[:, s:, :s], _adjoint(inverse), out=below)
        if f > s:
            signed = below if of_chunk is None else below * of_chunk[:, None, :]
            update = frontal[:, s:, s:] - signed @ _adjoint(below)
            place = group.row[chunk][:, :, None] + group.column[chunk][:, None, :]
            np.add.at(above, place.ravel(), update.ravel())
    return replace(factor, sign=sign)


def _invert_factors(pivots: NDArray, inverse: NDArray) -> NDArray[np.float64]:
    """Write the inverses C of factors with C P C^T = J of the (g, s, s) pivots P; the signs J, (g, s)."""
    sign = np.ones(pivots.shape[:2])
    for i, lower in enumerate(pivots):
        factor, blocks, order = ldl(lower, lower=True)
        w, Q = _diagonal_blocks(blocks)
        if not (w != 0).all():
            raise np.linalg.LinAlgError("a block of pivots is singular")
        (invert,) = get_lapack_funcs(("trtri",), (factor,))
        inverse[i][:, order] = (Q.T / np.sqrt(np.abs(w))[:, None]) @ invert(factor[order], lower=1)[0]
        sign[i] = np.sign(w)
    return sign


def _diagonal_blocks(blocks: NDArray) -> tuple[NDArray, NDArray]:
    """Eigenvalues and eigenvectors of a symmetric matrix with blocks of one or two rows on its diagonal."""
    w, Q = np.diag(blocks).copy(), np.eye(len(blocks))
    for i in np.flatnonzero(np.diag(blocks, -1)):
        pair = slice(i, i + 2)
        w[pair], Q[pair, pair] = np.linalg.eigh(blocks[pair, pair])
    return w, Q


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
        Index of each unknown in `unknown`.
    """

    unknown: NDArray[np.int64]
    row: NDArray[np.int64]

    @classmethod
    def of(cls, groups: list[CholeskyGroup], n: int) -> PivotOrder:
        """The order for n unknowns."""
        return cls(np.concatenate([group.pivot.ravel() for group in groups]), _rows_of_pivots(groups)[:n])


def cholesky_solve(groups: list[CholeskyGroup], rhs: NDArray, order: PivotOrder | None = None) -> NDArray:
    """Solution of a system from the factor of its matrix; skips frontal matrices without a non-zero entry.

    Parameters
    ----------
    groups : list of CholeskyGroup
    rhs : (n,) or (n, k) ndarray
    order : PivotOrder, optional
        That of the groups, if many systems are solved.

    Returns
    -------
    (n,) or (n, k) ndarray
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
            change = group.below.swapaxes(1, 2) @ x.take(group.update_row, axis=0)
            pivots -= change if group.sign is None else group.sign[:, :, None] * change
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
        reduced = pivots[active] = _reduced(group, pivots[active])
    else:
        reduced = _reduced(group, pivots)
        pivots[:] = reduced
    k = x.shape[1]
    place = (k * group.update_row[:, :, None] + np.arange(k)).ravel()
    np.subtract.at(x.reshape(-1), place, (group.below @ reduced).ravel())


def _reduced(group: CholeskyGroup, loads: NDArray) -> NDArray:
    """Loads (g, s, k) of the pivots by the inverse of the factor and the signs."""
    reduced = group.inverse @ loads
    return reduced if group.sign is None else group.sign[:, :, None] * reduced


def _adjoint(stack: NDArray) -> NDArray:
    return stack.swapaxes(-1, -2).conj() if np.iscomplexobj(stack) else stack.swapaxes(-1, -2)
