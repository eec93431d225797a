"""Sparse Hessians from element blocks: pattern and scatter are found once, values flow through them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array


class Assembly:
    """Pattern of a Hessian over the free coordinates.

    Parameters
    ----------
    free : (n, 3) ndarray of bool
    stencils : list of (k, s) ndarrays
        Vertices of the elements whose blocks will come.
    """

    def __init__(self, free: NDArray[np.bool_], stencils: list[NDArray]) -> None:
        n = len(free)
        tails = [np.repeat(s, s.shape[1], axis=1).ravel() for s in stencils]
        heads = [np.tile(s, (1, s.shape[1])).ravel() for s in stencils]
        own = np.arange(n)
        tail, head = np.concatenate([*tails, own]), np.concatenate([*heads, own])
        pairs, where = np.unique(tail * n + head, return_inverse=True)
        count = len(tail) - n
        self._gather = csr_array(
            (np.ones(count), (where[:count], np.arange(count))), shape=(len(pairs), count)
        )
        number = np.cumsum(free.ravel()) - 1
        axis = np.arange(3)
        rows = (3 * (pairs // n))[:, None, None] + axis[:, None] + 0 * axis
        cols = (3 * (pairs % n))[:, None, None] + 0 * axis[:, None] + axis
        keep = (free.ravel()[rows] & free.ravel()[cols]).ravel()
        entry = np.flatnonzero(keep)
        row, col = number[rows.ravel()[entry]], number[cols.ravel()[entry]]
        order = np.lexsort((row, col))
        self._entry = entry[order]
        self.n = int(free.sum())
        self._indices = row[order].astype(np.int32)
        self._indptr = np.searchsorted(col[order], np.arange(self.n + 1)).astype(np.int32)
        self._diagonal = np.flatnonzero(row[order] == col[order])
        self._free = free

    def matrix(self, blocks: list[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of (k, 3s, 3s) blocks, in the order of the stencils, plus an (n, 3) diagonal."""
        pieces = [_by_pair(block) for block in blocks]
        values = np.concatenate(pieces) if pieces else np.zeros((0, 9))
        data = (self._gather @ values).ravel()[self._entry]
        data[self._diagonal] += diagonal[self._free]
        return csc_array((data, self._indices, self._indptr), shape=(self.n, self.n))


def _by_pair(block: NDArray) -> NDArray:
    """(k, 3s, 3s) to (k s s, 9): one row for each pair of vertices of each element."""
    k, s = len(block), block.shape[1] // 3
    return block.reshape(k, s, 3, s, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 9)
