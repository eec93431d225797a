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
        Vertices of the elements whose blocks will come.
    """

    def __init__(self, free: NDArray[np.bool_], stencils: list[NDArray]) -> None:
        own = np.arange(len(free))
        low, high, triple, stride, size = [own], [own], [], [], 0
        for stencil in stencils:
            k, s = stencil.shape
            i, j = np.repeat(stencil, s, axis=1).ravel(), np.tile(stencil, (1, s)).ravel()
            # number of the sub-block's first row, counted in rows of three numbers; the next are s further on
            corner = (np.arange(k)[:, None, None] * 3 * s + np.arange(s)[:, None] * 3) * s + np.arange(s)
            kept = i <= j
            low.append(i[kept])
            high.append(j[kept])
            triple.append(size + corner.ravel()[kept])
            stride.append(np.full(len(triple[-1]), s))
            size += 3 * s * s * k
        keys, pair = np.unique(np.concatenate(high) * len(free) + np.concatenate(low), return_inverse=True)
        self._own, pair = pair[: len(free)], pair[len(free) :]
        first, step = (np.concatenate(part or [own[:0]]) for part in (triple, stride))
        self._gather = _row_sums(pair, first, step, len(keys), size)
        self._values = np.zeros((size, 3))
        self._layout = _layout(free, keys % len(free), keys // len(free))

    def matrix(self, blocks: list[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of (k, 3s, 3s) blocks, in the order of the stencils, plus (n,) numbers times the identity."""
        flat, end = self._values.reshape(-1), 0
        for block in blocks:
            start, end = end, end + block.size
            flat[start:end] = block.ravel()
        sums = (self._gather @ self._values).reshape(-1, 9)
        for axis in range(3):
            sums[self._own, 4 * axis] += diagonal
        layout = self._layout
        return csc_array((sums.ravel()[layout.data], layout.indices, layout.indptr), shape=layout.shape)


def _row_sums(pair: NDArray, first: NDArray, step: NDArray, pairs: int, size: int) -> csr_array:
    """(3 pairs, size) matrix of ones that sums rows of sub-blocks to the rows of the pairs' (3, 3) blocks."""
    order = np.argsort(pair, kind="stable")
    first, step, count = first[order], step[order], np.bincount(pair, minlength=pairs)
    begin = np.concatenate([[0], np.cumsum(count)])[:-1]
    # the three rows of a pair stand behind each other: entry k of row a is at 3 begin + a count + k
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
