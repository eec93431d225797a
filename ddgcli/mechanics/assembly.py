"""Sparse Hessians from element blocks: pattern and scatter are found once, values flow through them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array


class Assembly:
    """Pattern of a symmetric Hessian over the free coordinates.

    Element blocks are symmetric: only the (3, 3) blocks of vertex pairs i <= j are summed, and the matrix
    takes both its halves from them.

    Parameters
    ----------
    free : (n, 3) ndarray of bool
    stencils : list of (k, s) ndarrays
        Vertices of the elements whose blocks will come. Numbers from n on are internal unknowns of a
        potential, one scalar each, over which its energy is least; they are not shared between potentials,
        and come last in the matrix.
    """

    def __init__(self, free: NDArray[np.bool_], stencils: list[NDArray]) -> None:
        n, self._free = len(free), free
        stencils, self._internal = _numbered(stencils, n)
        scalar = np.broadcast_to([True, False, False], (self._internal, 3))
        free = np.concatenate([free, scalar])
        own = np.arange(len(free))
        low, high, first = [own], [own], []
        for stencil in stencils:
            k, s = stencil.shape
            i, j = np.repeat(stencil, s, axis=1).ravel(), np.tile(stencil, (1, s)).ravel()
            # number of the sub-block's first row, counted in rows of three numbers; the next are s further on
            corner = (np.arange(k)[:, None, None] * 3 * s + np.arange(s)[:, None] * 3) * s + np.arange(s)
            kept = i <= j
            low.append(i[kept])
            high.append(j[kept])
            first.append(corner.ravel()[kept])
        keys, pair = np.unique(np.concatenate(high) * len(free) + np.concatenate(low), return_inverse=True)
        self._pairs = len(keys)
        self._own, *pairs = np.split(pair, np.cumsum([len(row_of_pair) for row_of_pair in low])[:-1])
        self._gathers = [
            _row_sums(pair, row, stencil.shape[1], len(keys), 3 * stencil.size * stencil.shape[1])
            for pair, row, stencil in zip(pairs, first, stencils)
        ]
        self._layout = _layout(free, keys % len(free), keys // len(free))

    def matrix(self, blocks: list[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of (k, 3s, 3s) blocks, in the order of the stencils, plus (n,) numbers times the identity."""
        sums = np.zeros((3 * self._pairs, 3))
        for gather, block in zip(self._gathers, blocks):
            sums += gather @ block.reshape(-1, 3)
        sums = sums.reshape(-1, 9)
        for axis in range(3):
            sums[self._own[: len(diagonal)], 4 * axis] += diagonal
        layout = self._layout
        return csc_array((sums.ravel()[layout.data], layout.indices, layout.indptr), shape=layout.shape)

    def vector(self, v: NDArray) -> NDArray[np.float64]:
        """Entries of a vector (n, 3) or (n, 3, k) in the matrix; 0 for internal unknowns."""
        entries = v[self._free]
        return np.concatenate([entries, np.zeros((self._internal, *entries.shape[1:]))])

    def spread(self, entries: NDArray) -> NDArray[np.float64]:
        """(n, 3) vector with these entries, 0 at coordinates that are not free."""
        v = np.zeros(self._free.shape)
        v[self._free] = entries[: len(entries) - self._internal]
        return v


def _numbered(stencils: list[NDArray], n: int) -> tuple[list[NDArray], int]:
    """Stencils whose internal unknowns are numbered one behind another, and the number of these."""
    numbered, count = [], 0
    for stencil in stencils:
        numbered.append(np.where(stencil >= n, stencil + count, stencil) if count else stencil)
        count += max(int(stencil.max(initial=0)) + 1 - n, 0)
    return numbered, count


def _row_sums(pair: NDArray, first: NDArray, step: int, pairs: int, size: int) -> csr_array:
    """(3 pairs, size) matrix of ones that sums rows of sub-blocks to the rows of the pairs' (3, 3) blocks."""
    order = np.argsort(pair, kind="stable")
    first, count = first[order], np.bincount(pair, minlength=pairs)
    begin = np.concatenate([[0], np.cumsum(count)])[:-1]
    # the three rows of a pair follow each other: entry k of row a is at 3 begin + a count + k
    place = 2 * np.repeat(begin, count) + np.arange(len(pair))
    columns = np.empty(3 * len(pair), dtype=np.int32)
    for row in range(3):
        columns[place + row * np.repeat(count, count)] = first + row * step
    ends = np.concatenate([[0], np.cumsum(np.repeat(count, 3))]).astype(np.int32)
    return csr_array((np.ones(len(columns)), columns, ends), shape=(3 * pairs, size))


def _layout(free: NDArray[np.bool_], low: NDArray, high: NDArray) -> csc_array:
    """Matrix over the free coordinates whose entries are the numbers of the values that belong there."""
    number = np.where(free.ravel(), np.cumsum(free.ravel()) - 1, -1)
    axis = np.arange(3)
    shape = (len(low), 3, 3)
    row = np.broadcast_to(number[3 * low[:, None] + axis][:, :, None], shape)
    column = np.broadcast_to(number[3 * high[:, None] + axis][:, None, :], shape)
    value = np.arange(row.size).reshape(shape)
    off = low < high
    rows = np.concatenate([row.ravel(), column[off].ravel()])
    columns = np.concatenate([column.ravel(), row[off].ravel()])
    values = np.concatenate([value.ravel(), value[off].ravel()])
    kept = (rows >= 0) & (columns >= 0)
    n = int(free.sum())
    layout = csc_array((values[kept], (rows[kept], columns[kept])), shape=(n, n))
    layout.sort_indices()
    return layout
