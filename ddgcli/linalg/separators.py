"""Vertex separators of a graph that is halved again and again, from the edges between the halves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching

# a bad cut has a separator longer than so many square roots of its part, or a half smaller than this share
LONGEST_SEPARATOR, SMALLEST_SHARE = 12.0, 0.2
# parts up to this size may be cut badly
MAY_BE_BAD = 2000


def separator_level(path: NDArray[np.int64], levels: int, graph: csr_array) -> NDArray[np.int64] | None:
    """(n,) level at which each vertex separates the halves of its part; `levels` for those of no separator.

    Parameters
    ----------
    path : (n,) ndarray of int64
        Half that holds the vertex at each level, a bit each, the first level highest.
    levels : int
    graph : (n, n) csr_array
        Symmetric pattern.

    Returns
    -------
    (n,) ndarray of int64, or None where a large part is cut badly.
    """
    n = len(path)
    level = np.full(n, levels, dtype=np.int64)
    tail, head, since = _cut_edges(path, levels, graph)
    for here in range(levels):
        a, b = tail[since[here] : since[here + 1]], head[since[here] : since[here + 1]]
        still = (level[a] == levels) & (level[b] == levels)
        a, b = a[still], b[still]
        upper = (path[a] >> (levels - 1 - here)) & 1 == 1
        level[_vertex_cover(np.where(upper, b, a), np.where(upper, a, b))] = here
        if n >> here > MAY_BE_BAD and not _all_good(path >> (levels - 1 - here), level == here):
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

    D. König, "Gráfok és mátrixok", 1931: from a largest matching, the vertices of one side that no
    alternating path from its unmatched vertices reaches, and those of the other side that one does.
    """
    if not len(lower):
        return lower
    left, i = np.unique(lower, return_inverse=True)
    right, j = np.unique(upper, return_inverse=True)
    a, b = len(left), len(right)
    between = csr_array((np.ones(len(i)), (i, j)), shape=(a, b))
    partner = maximum_bipartite_matching(between, perm_type="row")  # of each vertex on the right
    matched = partner[j] == i
    alone = np.setdiff1d(np.arange(a), partner)
    start = a + b
    source = np.concatenate([i[~matched], a + j[matched], np.full(len(alone), start)])
    target = np.concatenate([a + j[~matched], i[matched], alone])
    alternating = csr_array((np.ones(len(source)), (source, target)), shape=(start + 1, start + 1))
    reached = np.zeros(start + 1, dtype=bool)
    reached[breadth_first_order(alternating, start, return_predecessors=False)] = True
    return np.append(left[~reached[:a]], right[reached[a:start]])


def _all_good(half: NDArray, separator: NDArray) -> bool:
    """Whether no large part has a long separator or a small half."""
    size = np.bincount(half, minlength=2 * (int(half.max()) // 2 + 1)).reshape(-1, 2)
    whole, least = size.sum(axis=1), size.min(axis=1)
    length = np.bincount(half[separator] // 2, minlength=len(whole))
    good = (length <= LONGEST_SEPARATOR * np.sqrt(whole)) & (least >= SMALLEST_SHARE * whole)
    return bool(good[whole > MAY_BE_BAD].all())
