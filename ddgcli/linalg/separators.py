"""Vertex separators of a recursively halved graph, from the edges between the halves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from ddgcli.linalg.indices import matrix_indices

MAX_SEPARATOR_RATIO = 3.0  # length over the square root of the entries of the part (surfaces: near 1)
MIN_CHECKED_SIZE = 2000  # parts up to this size may have longer separators


def separator_level(path: NDArray[np.int64], levels: int, graph: csr_array) -> NDArray[np.int64] | None:
    """Level at which each vertex separates the halves of its part of a recursively halved graph.

    Parameters
    ----------
    path : (n,) ndarray of int64
        Half that contains the vertex at each level, a bit each, the first level highest.
    levels : int
    graph : (n, n) csr_array
        Symmetric pattern.

    Returns
    -------
    (n,) ndarray of int64 or None
        `levels` for vertices that separate nothing; None if the separator of a large part is too long.
    """
    n = len(path)
    level = np.full(n, levels, dtype=np.int64)
    tail, head, since = _cut_edges(path, levels, graph)
    for here in range(levels):
        a, b = tail[since[here] : since[here + 1]], head[since[here] : since[here + 1]]
        remaining = (level[a] == levels) & (level[b] == levels)
        a, b = a[remaining], b[remaining]
        upper = (path[a] >> (levels - 1 - here)) & 1 == 1
        level[_vertex_cover(np.where(upper, b, a), np.where(upper, a, b))] = here
        if n >> here > MIN_CHECKED_SIZE and not _are_short(
            path >> (levels - 1 - here), level == here, graph.nnz / n
        ):
            return None
    return level


def _cut_edges(path: NDArray, levels: int, graph: csr_array) -> tuple[NDArray, NDArray, NDArray]:
    """Edges between parts, in the order of the level that cuts them, and where each level begins."""
    tail = np.repeat(np.arange(graph.shape[0], dtype=np.int32), np.diff(graph.indptr))
    once = tail < graph.indices
    tail, head = tail[once], graph.indices[once]
    differ = path[tail] ^ path[head]
    cut = differ > 0
    tail, head = tail[cut], head[cut]
    level = (levels - np.frexp(differ[cut].astype(np.float64))[1]).astype(np.int16)
    order = np.argsort(level, kind="stable")
    return tail[order], head[order], np.searchsorted(level[order], np.arange(levels + 1))


def _vertex_cover(lower: NDArray, upper: NDArray) -> NDArray:
    """Fewest vertices that touch every edge (lower[i], upper[i]) of a bipartite graph.

    D. König, "Gráfok és mátrixok", 1931: the lower vertices that the source cannot reach in the residual of a
    maximum flow from source to lower to upper to sink, and the upper vertices that it can. (The bipartite
    matching of scipy gives the flow too, but takes exponential time for edges in blocks, as in Hessians.)
    """
    if not len(lower):
        return lower
    left, i = np.unique(lower, return_inverse=True)
    right, j = np.unique(upper, return_inverse=True)
    a, b = len(left), len(right)
    source, sink = a + b, a + b + 1
    tail = np.concatenate([i, np.full(a, source), a + np.arange(b)])
    head = np.concatenate([a + j, np.arange(a), np.full(b, sink)])
    ends = matrix_indices(tail, sink + 1), matrix_indices(head, sink + 1)
    network = csr_array((np.ones(len(tail), dtype=np.int32), ends), shape=(sink + 1, sink + 1))
    residual = csr_array(network - maximum_flow(network, source, sink).flow)
    residual.eliminate_zeros()
    from_source = np.zeros(sink + 1, dtype=bool)
    from_source[breadth_first_order(residual, source, return_predecessors=False)] = True
    return np.append(left[~from_source[:a]], right[from_source[a:source]])


def _are_short(half: NDArray, separator: NDArray, row_length: float) -> bool:
    """Whether no large part has a long separator; `row_length`: mean entries per row."""
    whole = np.bincount(half // 2)
    length = np.bincount(half[separator] // 2, minlength=len(whole))
    good = length <= MAX_SEPARATOR_RATIO * np.sqrt(row_length * whole)
    return bool(good[whole > MIN_CHECKED_SIZE].all())
