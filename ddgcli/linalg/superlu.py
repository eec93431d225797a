"""Factorisations by SuperLU of scipy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from ddgcli.errors import SolveError
from ddgcli.linalg.ordering import Ordered, Ordering, fill_reducing_ordering, postorder


class SymmetricLU:
    """SuperLU with diagonal pivots in a fill-reducing order of our own; for definite matrices."""

    name = "superlu"
    repeats = False  # its first order is not post-ordered

    def __init__(self, matrix: csc_array, like: Ordered | None = None) -> None:
        order = like.order if like else None
        ordering = fill_reducing_ordering(matrix) if order is None else Ordering(order, final=True)
        self._order, self._final = ordering.order, ordering.final
        self._pattern: csc_array | None = None
        self._lu: Any = None
        self.refactor(matrix)

    def refactor(self, matrix: csc_array) -> None:
        if self._lu is not None and not self._final:
            self._keep_order()
        if self._pattern is None:
            numbered = csc_array((np.arange(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
            self._pattern = _permuted(numbered, self._order)
        pattern = self._pattern
        permuted = csc_array((matrix.data[pattern.data], pattern.indices, pattern.indptr), shape=matrix.shape)
        try:
            self._lu = splu(
                permuted,
                permc_spec="NATURAL" if self._final else "MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise SolveError(f"the matrix is singular: {error}") from error

    def _keep_order(self) -> None:
        """Use the order of minimum degree in later factorisations of this pattern."""
        self._order, self._final, self._pattern = self.order, True, None

    @property
    def order(self) -> NDArray[np.int64]:
        if self._final:
            return self._order
        return self._order[postorder(self._pattern, self._lu.perm_c)]

    def negative_pivots(self) -> int | None:
        """Number of negative pivots; None where pivots are off the diagonal."""
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        return int((self._lu.U.diagonal() < 0).sum())

    def solve(self, rhs: NDArray) -> NDArray:
        # by rows of the transpose, which lie together in memory
        x = np.empty(rhs.shape[::-1], dtype=rhs.dtype)
        x[..., self._order] = self._lu.solve(np.take(rhs.T, self._order, axis=-1).T).T
        return x.T


class PivotedLU:
    """SuperLU with partial pivoting on an equilibrated matrix; for indefinite symmetric systems."""

    name = "pivoted"
    repeats = True
    order = None  # depends on the values

    def __init__(self, matrix: csc_array, like: Ordered | None = None) -> None:
        self.refactor(matrix)

    def refactor(self, matrix: csc_array) -> None:
        n = matrix.shape[0]
        column = np.repeat(np.arange(n), np.diff(matrix.indptr))
        largest = np.zeros(n)
        np.maximum.at(largest, column, np.abs(matrix.data))
        if (largest == 0).any():
            raise SolveError(f"the matrix is singular: row {np.flatnonzero(largest == 0)[0]} is zero")
        self._scale = 1.0 / np.sqrt(largest)
        data = matrix.data * self._scale[column] * self._scale[matrix.indices]
        try:
            self._lu = splu(csc_array((data, matrix.indices, matrix.indptr), shape=(n, n)))
        except RuntimeError as error:
            raise SolveError(f"the matrix is singular: {error}") from error

    def solve(self, rhs: NDArray) -> NDArray:
        scale = self._scale if rhs.ndim == 1 else self._scale[:, None]
        return scale * self._lu.solve(scale * rhs)


def _permuted(matrix: csc_array, order: NDArray) -> csc_array:
    """Matrix with rows and columns in `order` and sorted indices."""
    permuted = matrix[order][:, order].tocsc()
    permuted.sort_indices()
    return permuted
