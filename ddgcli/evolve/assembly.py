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
        self.n = int(free.sum())
        number = np.where(free.ravel(), np.cumsum(free.ravel()) - 1, -1)
        rows, cols = [], []
        for stencil in stencils:
            dofs = number[(3 * stencil[:, :, None] + np.arange(3)).reshape(len(stencil), -1)]
            rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
            cols.append(np.tile(dofs, (1, dofs.shape[1])).ravel())
        own = np.arange(self.n)
        row, col = np.concatenate([*rows, own]), np.concatenate([*cols, own])
        count = len(row) - self.n
        kept = np.flatnonzero((row >= 0) & (col >= 0))
        keys, entry = np.unique(col[kept] * self.n + row[kept], return_inverse=True)
        inner = kept < count
        # a product with ones, row by row: every value of the matrix is the sum of its entries in the blocks
        order = np.argsort(entry[inner], kind="stable")
        ends = np.searchsorted(entry[inner][order], np.arange(len(keys) + 1))
        self._gather = csr_array(
            (np.ones(len(order)), kept[inner][order].astype(np.int32), ends.astype(np.int32)),
            shape=(len(keys), count),
        )
        self._indices = (keys % max(self.n, 1)).astype(np.int32)
        self._indptr = np.searchsorted(keys, np.arange(self.n + 1) * self.n).astype(np.int32)
        self._diagonal = entry[~inner]
        self._free = free
        self._values = np.zeros(count)

    def matrix(self, blocks: list[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of (k, 3s, 3s) blocks, in the order of the stencils, plus an (n, 3) diagonal."""
        end = 0
        for block in blocks:
            start, end = end, end + block.size
            self._values[start:end] = block.ravel()
        data = self._gather @ self._values
        data[self._diagonal] += diagonal[self._free]
        return csc_array((data, self._indices, self._indptr), shape=(self.n, self.n))
