"""Sparse Hessians from element blocks: pattern and scatter are found once, values flow through them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, csr_array

from ddgcli.linalg.indices import matrix_indices
from ddgcli.mechanics.block_layout import BlockLayout, ones
from ddgcli.mechanics.pair_blocks import vertex_pairs
from ddgcli.mesh.ragged import unique_keys


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
    by_pairs : sequence of bool, optional
        Of each stencil, whose elements have distinct vertices: its blocks come as those of pairs,
        see `pair_blocks`. Default: no; they come whole, (k, 3s, 3s).

    Attributes
    ----------
    by_pairs : list of bool
    internal : int
        Number of internal unknowns.
    """

    def __init__(
        self, free: NDArray[np.bool_], stencils: list[NDArray], by_pairs: Sequence[bool] = ()
    ) -> None:
        n, self._free = len(free), free
        stencils, self.internal = _numbered(stencils, n)
        scalar = np.broadcast_to([True, False, False], (self.internal, 3))
        free = np.concatenate([free, scalar])
        self.by_pairs = by_pairs = list(by_pairs) or [False] * len(stencils)
        entries = [_pairs if paired else _sub_blocks for paired in by_pairs]
        own = np.arange(len(free)) * (len(free) + 1)
        keys = [unique_keys(_keys(of(s), len(free))) for of, s in zip(entries, stencils)]
        key = unique_keys(np.concatenate([own, *keys]))
        del keys
        self._count = len(key)
        self._own = np.searchsorted(key, own)
        self._gathers = [
            _gather(np.searchsorted(key, _keys(of(s), len(free))), of(s)[2], s, paired)
            for of, s, paired in zip(entries, stencils, by_pairs)
        ]
        low, high = (matrix_indices(index, len(free)) for index in (key % len(free), key // len(free)))
        del key
        self._layout = BlockLayout(free, low, high, scalars=self.internal > 0)

    @property
    def graph(self) -> csc_array:
        """Vertices and internal unknowns with those whose blocks they share."""
        return self._layout.graph()

    @property
    def by_vertex(self) -> bool:
        """Whether the unknowns are the three coordinates of each vertex that is free."""
        return self._layout.by_vertex

    def matrix(self, blocks: Iterable[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of blocks of elements, in the order of the stencils, plus (n,) numbers times the identity."""
        return self._layout.scalar_matrix(self._sums(blocks, diagonal))

    def block_matrix(self, blocks: Iterable[NDArray], diagonal: NDArray) -> bsr_array:
        """`matrix` with (3, 3) blocks, a third less memory; where unknowns are `by_vertex`."""
        return self._layout.block_matrix(self._sums(blocks, diagonal))

    def _sums(self, blocks: Iterable[NDArray], diagonal: NDArray) -> NDArray[np.float64]:
        """(3, 3, pairs) blocks of the pairs of vertices."""
        sums = np.zeros((3, 3, self._count))
        whole, blocks = [], iter(blocks)
        for gather, paired in zip(self._gathers, self.by_pairs):
            block = next(blocks)
            if paired:
                for i, j in np.ndindex(3, 3):
                    sums[i, j][gather.pairs] += gather.matrix @ block[i, j].ravel()
            else:
                whole.append((gather, block))
            del block  # before the next one is computed
        for _ in blocks:  # what else is computed along with them
            pass
        if any(self.by_pairs):
            self._subtract_translated(sums)
        for gather, block in whole:
            rows = (gather.matrix @ block.reshape(-1, 3)).reshape(-1, 3, 3)
            sums[:, :, gather.pairs] += rows.transpose(1, 2, 0)
        for axis in range(3):
            sums[axis, axis, self._own[: len(diagonal)]] += diagonal
        return sums

    def _subtract_translated(self, sums: NDArray) -> None:
        """Give each vertex minus its blocks with all others: a translation of all of them does nothing."""
        for i in range(3):
            for j in range(i, 3):
                mean = sums[i, i] if i == j else 0.5 * (sums[i, j] + sums[j, i])
                total = self._layout.sums_of_vertices(mean)
                sums[i, j, self._own] -= total
                if i < j:
                    sums[j, i, self._own] -= total

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(np.count_nonzero(self._free)) + self.internal

    def vector(self, v: NDArray) -> NDArray[np.float64]:
        """Entries of a vector (n, 3) or (n, 3, k) in the matrix; 0 for internal unknowns."""
        entries = v[self._free]
        return np.concatenate([entries, np.zeros((self.internal, *entries.shape[1:]))])

    def spread(self, entries: NDArray) -> NDArray[np.float64]:
        """(n, 3) vector with these entries, 0 at coordinates that are not free."""
        v = np.zeros(self._free.shape)
        v[self._free] = entries[: len(entries) - self.internal]
        return v


def _numbered(stencils: list[NDArray], n: int) -> tuple[list[NDArray], int]:
    """Stencils whose internal unknowns are numbered one after another, and the number of these."""
    numbered, count = [], 0
    for stencil in stencils:
        numbered.append(np.where(stencil >= n, stencil + count, stencil) if count else stencil)
        count += max(int(stencil.max(initial=0)) + 1 - n, 0)
    return numbered, count


def _sub_blocks(stencil: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices i <= j of (3, 3) sub-blocks of whole blocks, and their first rows.

    Rows of three numbers are counted; the next rows of a sub-block are s further on.
    """
    k, s = stencil.shape
    i, j = np.repeat(stencil, s, axis=1).ravel(), np.tile(stencil, (1, s)).ravel()
    corner = (np.arange(k)[:, None, None] * 3 * s + np.arange(s)[:, None] * 3) * s + np.arange(s)
    upper = i <= j
    return i[upper], j[upper], corner.ravel()[upper]


def _pairs(stencil: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices i < j of the blocks of pairs, and the numbers of these blocks."""
    ends = [np.sort(stencil[:, pair], axis=1) for pair in map(list, vertex_pairs(stencil.shape[1]))]
    low, high = np.concatenate(ends).T
    return low, high, np.arange(len(low))


def _keys(entries: tuple[NDArray, NDArray, NDArray], n: int) -> NDArray[np.int64]:
    """One number for each pair of vertices."""
    low, high, _ = entries
    return high * np.int64(n) + low


class _BlockSums(NamedTuple):
    """Sums of blocks of elements: to which pairs of vertices they belong, and a matrix of ones."""

    pairs: slice | NDArray[np.int64]
    matrix: csr_array


def _gather(pair: NDArray, first: NDArray, stencil: NDArray, paired: bool) -> _BlockSums:
    """`_BlockSums` of the blocks of a stencil, whose pairs and `first` entries are given."""
    begin, end = int(pair.min(initial=0)), int(pair.max(initial=-1)) + 1
    count = np.bincount(pair - begin, minlength=end - begin)
    pairs: slice | NDArray = slice(begin, end)
    if np.count_nonzero(count) < 0.5 * len(count):  # far from each other
        present = np.flatnonzero(count)
        pairs, count = begin + present, count[present]
    order = np.argsort(pair, kind="stable")
    if paired:
        return _BlockSums(pairs, _pair_sums(order, count))
    k, s = stencil.shape
    return _BlockSums(pairs, _row_sums(first[order], count, s, 3 * k * s * s))


def _pair_sums(order: NDArray, count: NDArray) -> csr_array:
    """(pairs, size) matrix of ones that sums blocks of elements' pairs to the blocks of the pairs."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return csr_array((ones(len(order)), order.astype(np.int32), ends), shape=(len(count), len(order)))


def _row_sums(first: NDArray, count: NDArray, step: int, size: int) -> csr_array:
    """(3 pairs, size) matrix of ones that sums rows of sub-blocks to the rows of the pairs' (3, 3) blocks."""
    begin = np.concatenate([[0], np.cumsum(count)])[:-1]
    # the three rows of a pair follow each other: entry k of row a is at 3 begin + a count + k
    place = 2 * np.repeat(begin, count) + np.arange(len(first))
    columns = np.empty(3 * len(first), dtype=np.int32)
    for row in range(3):
        columns[place + row * np.repeat(count, count)] = first + row * step
    ends = np.concatenate([[0], np.cumsum(np.repeat(count, 3))]).astype(np.int32)
    return csr_array((ones(len(columns)), columns, ends), shape=(3 * len(count), size))
