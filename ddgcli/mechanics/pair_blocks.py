"""Element Hessians stored as the (3, 3) blocks of vertex pairs, with little more than a third of the values.

The energy of such an element is translation invariant, so the diagonal block of a vertex is minus the sum of
its blocks with the other vertices. The pairs (a, b), a < b, have the order of `vertex_pairs`. In an array
(3, 3, p, k) for k elements, rows belong to the vertex with the smaller index in the mesh, columns to the
other. Each entry of the blocks is contiguous over the elements: numpy writes and sums contiguous values
several times as fast as values with a stride of nine.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

MAX_CACHED = 2**27  # largest size in bytes of an array of blocks that is reused for the next matrix


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
    """Array of the blocks of all pairs of all elements, written in pieces.

    The array is reused, because new memory costs more time than the arithmetic; above MAX_CACHED bytes it is
    released instead.

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
        """Transpose blocks of the elements `rows` in which vertex a has a larger index than vertex b."""
        descending = self._descending[:, rows]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            upper, lower = self.values[i, j, :, rows], self.values[j, i, :, rows]
            upper_before = upper.copy()
            np.copyto(upper, lower, where=descending)
            np.copyto(lower, upper_before, where=descending)

    def written(self) -> NDArray[np.float64]:
        """The array, after all pairs of all elements are written; a large one is released here."""
        values = self.values
        if values.nbytes > MAX_CACHED:
            self._values = None
        return values


def whole_blocks(stencil: NDArray, pair_blocks: NDArray) -> NDArray[np.float64]:
    """Whole element Hessians from the blocks of vertex pairs.

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
    """Whole element Hessians from blocks of vertex pairs whose rows belong to the first vertex.

    Parameters
    ----------
    count : int
        Number of vertices of an element, s.
    blocks : (p, k, 3, 3) ndarray of float64
        Blocks of the pairs in the order of `vertex_pairs`.

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
    for a in range(count):  # diagonal blocks are symmetric only up to rounding
        own = whole[:, a, :, a]
        whole[:, a, :, a] = 0.5 * (own + own.transpose(0, 2, 1))
    return whole.reshape(k, 3 * count, 3 * count)


def _descending(stencil: NDArray) -> NDArray[np.bool_]:
    """(p, k) whether the first vertex of a pair has the larger index."""
    return np.array([stencil[:, a] > stencil[:, b] for a, b in vertex_pairs(stencil.shape[1])])


def have_distinct_vertices(stencil: NDArray) -> bool:
    """Whether no element contains a vertex twice.

    Parameters
    ----------
    stencil : (k, s) ndarray of int64

    Returns
    -------
    bool
    """
    return not any((stencil[:, a] == stencil[:, b]).any() for a, b in vertex_pairs(stencil.shape[1]))
