"""Hessians of elements as (3, 3) blocks of their pairs of vertices: little more than a third of the numbers.

The energy of such an element does not change by translation, so that the block of a vertex is minus the sum
of its blocks with the others. Blocks are those of pairs (a, b), a < b, in the order of `vertex_pairs`; in an
array (3, 3, p, k) of k elements, rows belong to the vertex of lesser number in the mesh, columns to the
other. Each entry of the blocks has a plane of its own: numpy writes and sums numbers that lie together
several times as fast as those that lie nine apart.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

MAX_KEPT = 2**27  # bytes of an array of blocks that stays in memory between two matrices


@cache
def vertex_pairs(count: int) -> tuple[tuple[int, int], ...]:
    """Pairs (a, b), a < b, of the vertices of an element.

    Parameters
    ----------
    count : int
        Vertices of the element.

    Returns
    -------
    tuple of (int, int)
    """
    return tuple((a, b) for a in range(count) for b in range(a + 1, count))


class PairBlocks:
    """Array of the blocks of every pair of every element, written piece by piece.

    It is written to again and again, because fresh memory costs more than the arithmetic; above MAX_KEPT
    bytes it is released instead.

    Parameters
    ----------
    stencil : (k, s) ndarray
        Vertices of the elements.

    Attributes
    ----------
    values : (3, 3, p, k) ndarray
        p = s (s - 1) / 2 pairs.
    """

    def __init__(self, stencil: NDArray) -> None:
        pairs = vertex_pairs(stencil.shape[1])
        self._shape = (3, 3, len(pairs), len(stencil))
        self._values: NDArray[np.float64] | None = None
        self._descending = _descending(stencil)

    @property
    def values(self) -> NDArray[np.float64]:
        if self._values is None:
            self._values = np.empty(self._shape)
        return self._values

    def transpose_descending(self, rows: slice) -> None:
        """Bring blocks of the elements `rows` into order, whose rows belong to a and columns to b so far."""
        descending = self._descending[:, rows]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            upper, lower = self.values[i, j, :, rows], self.values[j, i, :, rows]
            upper_before = upper.copy()
            np.copyto(upper, lower, where=descending)
            np.copyto(lower, upper_before, where=descending)

    def written(self) -> NDArray[np.float64]:
        """The array, once all pairs of all elements are written; a large one is not kept here."""
        values = self.values
        if values.nbytes > MAX_KEPT:
            self._values = None
        return values


def whole_blocks(stencil: NDArray, pair_blocks: NDArray) -> NDArray[np.float64]:
    """Whole Hessians of elements from the blocks of their pairs of vertices.

    Parameters
    ----------
    stencil : (k, s) ndarray of int64
        Vertices of the elements.
    pair_blocks : (3, 3, p, k) ndarray of float64

    Returns
    -------
    (k, 3s, 3s) ndarray of float64
    """
    blocks = np.where(_descending(stencil), pair_blocks.swapaxes(0, 1), pair_blocks)
    return whole_elements(stencil.shape[1], blocks.transpose(2, 3, 0, 1))


def whole_elements(count: int, blocks: NDArray) -> NDArray[np.float64]:
    """Whole Hessians of elements from the blocks of their pairs, whose rows belong to the first vertex.

    Parameters
    ----------
    count : int
        Vertices of an element, s.
    blocks : (p, k, 3, 3) ndarray of float64
        Of the pairs in the order of `vertex_pairs`.

    Returns
    -------
    (k, 3s, 3s) ndarray of float64
        Symmetric.
    """
    k = blocks.shape[1]
    whole = np.zeros((k, count, 3, count, 3))
    for (a, b), block in zip(vertex_pairs(count), blocks):
        whole[:, a, :, b] = block
        whole[:, b, :, a] = block.transpose(0, 2, 1)
        whole[:, a, :, a] -= block
        whole[:, b, :, b] -= block.transpose(0, 2, 1)
    for a in range(count):  # symmetric, up to rounding: of the sum and of its transpose, the mean
        own = whole[:, a, :, a]
        whole[:, a, :, a] = 0.5 * (own + own.transpose(0, 2, 1))
    return whole.reshape(k, 3 * count, 3 * count)


def _descending(stencil: NDArray) -> NDArray[np.bool_]:
    """(p, k) pairs whose first vertex has the greater number."""
    return np.array([stencil[:, a] > stencil[:, b] for a, b in vertex_pairs(stencil.shape[1])])


def have_distinct_vertices(stencil: NDArray) -> bool:
    """Whether no element has a vertex twice.

    Parameters
    ----------
    stencil : (k, s) ndarray of int64

    Returns
    -------
    bool
    """
    return not any((stencil[:, a] == stencil[:, b]).any() for a, b in vertex_pairs(stencil.shape[1]))
