"""Assembly of sparse Hessians from element blocks, with a pattern that is computed once."""

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

    Element blocks are symmetric: only the (3, 3) blocks of vertex pairs i <= j are summed, and both halves of
    the matrix are copied from them.

    Parameters
    ----------
    free : (n, 3) ndarray of bool
    stencils : list of (k, s) ndarrays
        Vertices of the elements whose blocks will be summed. Indices from n on are internal unknowns of a
        potential, one scalar each, over which its energy is minimised; they are not shared between
        potentials, and are last in the matrix.
    by_pairs : sequence of bool, optional
        For each stencil, whether its blocks are given by pairs of vertices (see `pair_blocks`; elements must
        have distinct vertices). By default all are whole element blocks, (k, 3s, 3s).

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
        self._block_sums = [
            _sums_of_stencil(np.searchsorted(key, _keys(of(s), len(free))), of(s)[2], s, paired)
            for of, s, paired in zip(entries, stencils, by_pairs)
        ]
        low, high = (matrix_indices(index, len(free)) for index in (key % len(free), key // len(free)))
        del key
        self._layout = BlockLayout(free, low, high, scalars=self.internal > 0)

    @property
    def graph(self) -> csc_array:
        """Matrix of ones with the block pattern: vertices and internal unknowns that share an element."""
        return self._layout.graph()

    @property
    def by_vertex(self) -> bool:
        """Whether each vertex has all its coordinates free or none, and there are no internal unknowns."""
        return self._layout.by_vertex

    def matrix(self, blocks: Iterable[NDArray], diagonal: NDArray) -> csc_array:
        """Sum of the element blocks, in the order of the stencils, plus (n,) values on the diagonal."""
        return self._layout.scalar_matrix(self._sums(blocks, diagonal))

    def block_matrix(self, blocks: Iterable[NDArray], diagonal: NDArray) -> bsr_array:
        """The `matrix` with (3, 3) blocks, in a third less memory; requires `by_vertex`."""
        return self._layout.block_matrix(self._sums(blocks, diagonal))

    def _sums(self, blocks: Iterable[NDArray], diagonal: NDArray) -> NDArray[np.float64]:
        """(3, 3, pairs) blocks of the pairs of vertices."""
        sums = np.zeros((3, 3, self._count))
        whole, blocks = [], iter(blocks)
        for sums_of, paired in zip(self._block_sums, self.by_pairs):
            block = next(blocks)
            if paired:
                for i, j in np.ndindex(3, 3):
                    sums[i, j][sums_of.pairs] += sums_of.matrix @ block[i, j].ravel()
            else:
                whole.append((sums_of, block))
            del block  # before the next one is computed
        for _ in blocks:  # exhaust the generator, which also collects Hessians without elements
            pass
        if any(self.by_pairs):
            self._subtract_translated(sums)
        for sums_of, block in whole:
            rows = (sums_of.matrix @ block.reshape(-1, 3)).reshape(-1, 3, 3)
            sums[:, :, sums_of.pairs] += rows.transpose(1, 2, 0)
        for axis in range(3):
            sums[axis, axis, self._own[: len(diagonal)]] += diagonal
        return sums

    def _subtract_translated(self, sums: NDArray) -> None:
        """Set diagonal blocks to minus the sum of their row, since the energy is translation invariant."""
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

    def gather(self, v: NDArray) -> NDArray[np.float64]:
        """Entries of a vector (n, 3) or (n, 3, k) at the unknowns; 0 for internal unknowns."""
        entries = v[self._free]
        return np.concatenate([entries, np.zeros((self.internal, *entries.shape[1:]))])

    def scatter(self, entries: NDArray) -> NDArray[np.float64]:
        """(n, 3) vector from entries at the unknowns, 0 at coordinates that are not free."""
        v = np.zeros(self._free.shape)
        v[self._free] = entries[: len(entries) - self.internal]
        return v


def _numbered(stencils: list[NDArray], n: int) -> tuple[list[NDArray], int]:
    """Stencils whose internal unknowns have consecutive indices, and the number of internal unknowns."""
    numbered, count = [], 0
    for stencil in stencils:
        numbered.append(np.where(stencil >= n, stencil + count, stencil) if count else stencil)
        count += max(int(stencil.max(initial=0)) + 1 - n, 0)
    return numbered, count


def _sub_blocks(stencil: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices i <= j of the (3, 3) sub-blocks of whole element blocks, and index of their first row.

    Indices count rows of three values; the next row of a sub-block has an index greater by s.
    """
    k, s = stencil.shape
    i, j = np.repeat(stencil, s, axis=1).ravel(), np.tile(stencil, (1, s)).ravel()
    corner = (np.arange(k)[:, None, None] * 3 * s + np.arange(s)[:, None] * 3) * s + np.arange(s)
    upper = i <= j
    return i[upper], j[upper], corner.ravel()[upper]


def _pairs(stencil: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices i < j of the blocks of pairs, and the indices of these blocks."""
    ends = [np.sort(stencil[:, pair], axis=1) for pair in map(list, vertex_pairs(stencil.shape[1]))]
    low, high = np.concatenate(ends).T
    return low, high, np.arange(len(low))


def _keys(entries: tuple[NDArray, NDArray, NDArray], n: int) -> NDArray[np.int64]:
    """Key of each pair of vertices, ascending by column, then by row."""
    low, high, _ = entries
    return high * np.int64(n) + low


class _BlockSums(NamedTuple):
    """Summation of element blocks by pairs of vertices: the pairs, and a matrix of ones that sums."""

    pairs: slice | NDArray[np.int64]
    matrix: csr_array


def _sums_of_stencil(pair: NDArray, first: NDArray, stencil: NDArray, paired: bool) -> _BlockSums:
    """`_BlockSums` of a stencil, from the pair and the first row of each block."""
    begin, end = int(pair.min(initial=0)), int(pair.max(initial=-1)) + 1
    count = np.bincount(pair - begin, minlength=end - begin)
    pairs: slice | NDArray = slice(begin, end)
    if np.count_nonzero(count) < 0.5 * len(count):  # a slice would contain mostly other pairs
        present = np.flatnonzero(count)
        pairs, count = begin + present, count[present]
    order = np.argsort(pair, kind="stable")
    if paired:
        return _BlockSums(pairs, _pair_sums(order, count))
    k, s = stencil.shape
    return _BlockSums(pairs, _row_sums(first[order], count, s, 3 * k * s * s))


def _pair_sums(order: NDArray, count: NDArray) -> csr_array:
    """(pairs, size) matrix of ones that sums the pair blocks of the elements by pairs of vertices."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return csr_array((ones(len(order)), order.astype(np.int32), ends), shape=(len(count), len(order)))


def _row_sums(first: NDArray, count: NDArray, step: int, size: int) -> csr_array:
    """(3 pairs, size) matrix of ones that sums rows of sub-blocks by rows of the pairs' (3, 3) blocks."""
    begin = np.concatenate([[0], np.cumsum(count)])[:-1]
    # the three rows of a pair follow each other: entry k of row a is at 3 begin + a count + k
    position = 2 * np.repeat(begin, count) + np.arange(len(first))
    columns = np.empty(3 * len(first), dtype=np.int32)
    for row in range(3):
        columns[position + row * np.repeat(count, count)] = first + row * step
    ends = np.concatenate([[0], np.cumsum(np.repeat(count, 3))]).astype(np.int32)
    return csr_array((ones(len(columns)), columns, ends), shape=(3 * len(count), size))
