"""Layout of the (3, 3) blocks of vertex pairs in a symmetric sparse matrix over the free coordinates."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, csr_array

from ddgcli.linalg.indices import matrix_indices

GATHER_SIZE = 1 << 18  # values gathered at a time, because numpy converts 4-byte indices to 8 bytes
SUM_SIZE = 1 << 20  # stored entries of a matrix of ones


class BlockLayout:
    """Pattern of a symmetric matrix from the blocks of vertex pairs i <= j, whose rows belong to i.

    Parameters
    ----------
    free : (n, 3) ndarray of bool
        Coordinates that are unknowns.
    low, high : (pairs,) ndarray of int
        Vertices of the pairs, ascending by `high`, then by `low`; every vertex has a pair with itself.
    scalars : bool
        Whether some of the n are scalar unknowns, with only the first coordinate free.

    Attributes
    ----------
    by_vertex : bool
        Whether each vertex has all its coordinates free or none, and there are no scalars.
    """

    def __init__(self, free: NDArray[np.bool_], low: NDArray, high: NDArray, scalars: bool = False) -> None:
        n, self._free, self._pairs = len(free), free, len(low)
        self.by_vertex = not scalars and bool((free.all(axis=1) == free.any(axis=1)).all())
        off = np.flatnonzero(low < high)
        off = off[np.argsort(low[off], kind="stable")]  # by low, then by high
        above, below = np.bincount(high, minlength=n), np.bincount(low[off], minlength=n)
        size = len(low) + len(off)
        start = np.concatenate([[0], np.cumsum(above + below)])
        # in a column: first the rows up to the diagonal (the column is the high vertex), then those below
        at_high = np.arange(len(low)) + np.repeat(np.cumsum(below) - below, above)
        at_low = np.arange(len(off)) + np.repeat(np.cumsum(above), below)
        self._start = matrix_indices(start, size)
        self._row, self._pair = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int32)
        self._below = np.zeros(size, dtype=bool)  # rows below the diagonal
        self._row[at_high], self._pair[at_high] = low, np.arange(len(low))
        self._row[at_low], self._pair[at_low] = high[off], off
        self._below[at_low] = True

    def graph(self) -> csc_array:
        """(n, n) matrix of ones, with the pattern of the blocks."""
        n = len(self._free)
        return csc_array((np.ones(len(self._row)), self._row, self._start), shape=(n, n))

    def sums_of_vertices(self, values: NDArray) -> NDArray[np.float64]:
        """(n,) sums of (pairs,) values over the pairs of each vertex, including that with itself."""
        sums = [matrix @ values for matrix in self._pairs_of_vertices]
        return sums[0] if len(sums) == 1 else np.concatenate(sums)

    @cached_property
    def _pairs_of_vertices(self) -> list[csr_array]:
        """Matrices of ones that sum over the pairs of consecutive vertices; they share memory."""
        n, matrices = len(self._free), []
        step = max(1, SUM_SIZE * n // max(len(self._row), 1))
        for first in range(0, n, step):
            start = self._start[first : first + step + 1]
            pair = self._pair[start[0] : start[-1]]
            shape = len(start) - 1, self._pairs
            matrices.append(csr_array((ones(len(pair)), pair, start - start[0]), shape=shape))
        return matrices

    def scalar_matrix(self, sums: NDArray) -> csc_array:
        """Matrix over the free coordinates, from the blocks (3, 3, pairs)."""
        value, row, start = self._scalars
        data, numbers = np.empty(len(value)), sums.reshape(-1)
        for first in range(0, len(value), GATHER_SIZE):
            piece = slice(first, first + GATHER_SIZE)
            np.take(numbers, value[piece], out=data[piece], mode="clip")
        return csc_array((data, row, start), shape=(len(start) - 1, len(start) - 1))

    @cached_property
    def _scalars(self) -> tuple[NDArray, NDArray, NDArray]:
        """CSC pattern: index of each entry in the block values, its row; starts of the columns."""
        count = np.diff(self._start)
        column = np.repeat(np.arange(len(count), dtype=np.int32), count)
        size = 9 * len(self._row)
        value = np.empty(size, dtype=np.int32 if size < 2**31 else np.int64)
        row = np.empty(size, dtype=np.int32)
        # entry (b, a) of the k-th block of a column of m is at 9 start + 3 m a + 3 k + b
        position = 3 * np.arange(len(self._row)) + 6 * self._start[:-1].astype(np.int64)[column]
        height = 3 * count[column]
        for a in range(3):
            for b in range(3):
                at = position + height * a + b
                entry = np.where(self._below, 3 * a + b, 3 * b + a).astype(value.dtype)
                value[at] = self._pair + self._pairs * entry
                row[at] = 3 * self._row + b
        start = np.concatenate([[0], np.cumsum(np.repeat(3 * count, 3))])
        free = self._free.ravel()
        if not free.all():
            of_column = np.concatenate([[0], np.cumsum(free[row] & np.repeat(free, np.diff(start)))])
            nonempty = np.flatnonzero(np.diff(of_column))
            unknown = np.cumsum(free) - 1
            value, row = value[nonempty], unknown.astype(np.int32)[row[nonempty]]
            start = np.concatenate([of_column[start[:-1][free]], of_column[-1:]])
        return value, row, matrix_indices(start, len(row))

    def block_matrix(self, sums: NDArray) -> bsr_array:
        """The matrix with (3, 3) blocks; requires `by_vertex`."""
        pair, right, column, start = self._blocks
        data = np.empty((len(pair), 3, 3))
        for first in range(0, len(pair), GATHER_SIZE):
            piece = slice(first, first + GATHER_SIZE)
            own, block = pair[piece], data[piece]
            for i, j in np.ndindex(3, 3):  # a column of blocks is a row of their transposes
                block[:, i, j] = sums[i, j][own]
                if i != j:
                    np.copyto(block[:, i, j], sums[j, i][own], where=~right[piece])
        shape = (3 * (len(start) - 1), 3 * (len(start) - 1))
        return bsr_array((data, column, start), shape=shape)

    @cached_property
    def _blocks(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """BSR pattern: pair of each block, whether it is right of the diagonal, its column; row starts."""
        free = self._free[:, 0]
        if free.all():
            return self._pair, self._below, self._row, self._start
        is_free = free[self._row] & np.repeat(free, np.diff(self._start))
        before = np.concatenate([[0], np.cumsum(is_free)])
        start = matrix_indices(before[self._start[np.append(free, True)]], len(self._row))
        unknown = np.cumsum(free) - 1
        return self._pair[is_free], self._below[is_free], unknown[self._row[is_free]].astype(np.int32), start


_ONES = np.ones(0)


def ones(count: int) -> NDArray[np.float64]:
    """Read-only array of ones, shared by all matrices of ones.

    Parameters
    ----------
    count : int

    Returns
    -------
    (count,) ndarray of float64
    """
    global _ONES
    if len(_ONES) < count:
        _ONES = np.ones(count)
        _ONES.flags.writeable = False
    return _ONES[:count]
