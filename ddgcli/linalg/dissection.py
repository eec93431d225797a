"""Nested dissection of a graph by its own distances.

Coordinates are breadth-first distances from a few vertices far apart, so only the connectivity counts. Every
part is halved at the median of its longest direction, all parts of a level at once; the separators come last,
from the edges between the halves (`separators.py`).

A. George, "Nested dissection of a regular finite element mesh", 1973.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ddgcli.linalg.separators import separator_level

LANDMARKS = 5
SMOOTHING = 5
# vertices of a part that is not cut any more
LEAF = 32
# smaller components are dissected all together
LARGE = 2000
# levels in which every part has its own principal directions; below, half of them take their parent's
OWN_DIRECTIONS = 8
# across its longest direction a half has a quarter of the variance that its parent had
HALVED = 0.25


def dissected(matrix: csc_array) -> NDArray[np.int64] | None:
    """(n,) elimination order: both halves of a part, then its separator, so that every subtree is contiguous.

    (In its symmetric mode SuperLU does not sort the tree itself; halves far apart in memory cost it twice the
    time.) Components are dissected one after the other. None where a large part has no short separator.
    """
    graph = _both_ways(matrix)
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return _dissected(graph)
    size = np.bincount(label)
    small = size <= LEAF
    by_label = np.argsort(label, kind="stable")
    orders = [by_label[small[label[by_label]]]]
    large = size >= LARGE
    rest = np.flatnonzero(~small[label])
    group = np.where(large, np.cumsum(large), 0)[label[rest]]
    members = np.split(rest[np.argsort(group, kind="stable")], np.cumsum(np.bincount(group))[:-1])
    for vertices in members:
        if len(vertices):
            order = _dissected(_strung_together(graph[vertices][:, vertices]))
            if order is None:
                return None
            orders.append(vertices[order])
    return np.concatenate(orders)


def _both_ways(matrix: csc_array) -> csr_array:
    """The graph of a symmetric matrix, of which a product may have dropped zeros on one side only."""
    n = matrix.shape[0]
    graph = csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=(n, n))
    other = matrix.tocsr()
    if np.array_equal(other.indptr, graph.indptr) and np.array_equal(other.indices, graph.indices):
        return graph
    return csr_array(graph + graph.T)


def _dissected(graph: csr_array) -> NDArray[np.int64] | None:
    """`dissected` for a connected graph."""
    graph, number = _near_in_memory(graph)
    levels = max(1, int(np.ceil(np.log2(graph.shape[0] / LEAF))))
    path = _halved(_landmark_distances(graph), levels)
    level = separator_level(path, levels, graph)
    if level is None:
        return None
    height = levels - level
    last = (((path >> height) + 1) << height) - 1  # of the leaves below the part that the vertex separates
    return number[np.argsort((last << 6) + height, kind="stable")]


def _strung_together(graph: csr_array) -> csr_array:
    """The graph with an edge from each component to the next."""
    n = graph.shape[0]
    _, first = np.unique(connected_components(graph, directed=False)[1], return_index=True)
    a, b = first[:-1], first[1:]
    links = coo_array((np.ones(2 * len(a)), (np.append(a, b), np.append(b, a))), shape=(n, n))
    return csr_array(graph + links)


def _near_in_memory(graph: csr_array) -> tuple[csr_array, NDArray[np.int64]]:
    """The graph renumbered breadth first, and the old number of each vertex."""
    order = breadth_first_order(graph, 0, return_predecessors=False).astype(np.int64)
    return csr_array(graph[order][:, order]), order


def _landmark_distances(graph: csr_array) -> NDArray[np.float32]:
    """(LANDMARKS, n) smoothed distances from vertices far apart, in a graph numbered breadth first."""
    n = graph.shape[0]
    place = np.empty((n, LANDMARKS), dtype=np.float32)
    nearest, source = np.full(n, np.inf, dtype=np.float32), n - 1
    for j in range(LANDMARKS):
        place[:, j] = _distances(graph, source)
        nearest = np.minimum(nearest, place[:, j])
        source = int(np.argmax(nearest))
    weight = (1.0 / np.diff(graph.indptr)).astype(np.float32)[:, None]
    mean = csr_array((np.ones(graph.nnz, dtype=np.float32), graph.indices, graph.indptr), shape=(n, n))
    for _ in range(SMOOTHING):
        place = (mean @ place) * weight
    return np.ascontiguousarray(place.T)


def _distances(graph: csr_array, source: int) -> NDArray[np.float32]:
    """(n,) number of edges to the source."""
    n = graph.shape[0]
    order, before = breadth_first_order(graph, source)
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    parent = rank[before[order[1:]]]  # ascending, so each ring of vertices is found by bisection
    ring = [0, 1]
    while ring[-1] < n:
        ring.append(1 + int(np.searchsorted(parent, np.int32(ring[-1]))))
    distance = np.empty(n, dtype=np.float32)
    distance[order] = np.repeat(np.arange(len(ring) - 1, dtype=np.float32), np.diff(ring))
    return distance


def _halved(place: NDArray[np.float32], levels: int) -> NDArray[np.int64]:
    """(n,) path of each vertex through `levels` halvings, a bit each, the first one highest."""
    k, n = place.shape
    part, n_parts = np.zeros(n, dtype=np.int64), 1
    for level in range(levels):
        size = np.maximum(np.bincount(part, minlength=n_parts), 1)
        if level < OWN_DIRECTIONS or level % 2 == 0:
            offset, variance, direction = _principal_directions(place, part, size)
            owner, chosen = np.arange(n_parts), np.full(n_parts, k - 1)
        else:
            owner = np.arange(n_parts) // 2
            wide = variance[:, -2] > HALVED * variance[:, -1]
            chosen = np.where(wide, k - 2, k - 1)[owner]
        axis = direction[owner, :, chosen].astype(np.float32)
        along = offset[0] * axis[part, 0]
        for j in range(1, k):
            along += offset[j] * axis[part, j]
        part = 2 * part + _beyond_median(along, part, size, np.sqrt(variance[owner, chosen]))
        n_parts *= 2
    return part


def _principal_directions(
    place: NDArray, part: NDArray, size: NDArray
) -> tuple[list[NDArray], NDArray, NDArray]:
    """Coordinates from the centre of each part (k of (n,)), variances ascending (p, k), directions."""
    k, p = len(place), len(size)
    centre = [(np.bincount(part, x, p) / size).astype(np.float32) for x in place]
    offset = [x - c[part] for x, c in zip(place, centre, strict=True)]
    spread = np.empty((p, k, k))
    for i in range(k):
        for j in range(i, k):
            spread[:, i, j] = spread[:, j, i] = np.bincount(part, offset[i] * offset[j], p)
    value, direction = np.linalg.eigh(spread / size[:, None, None])
    return offset, np.maximum(value, 0.0), direction


def _beyond_median(along: NDArray, part: NDArray, size: NDArray, width: NDArray) -> NDArray[np.bool_]:
    """(n,) whether a vertex lies beyond the median of its part, nearly: two corrections of the mean."""
    p = len(size)
    median = np.bincount(part, along, p) / size
    for _ in range(2):
        share = np.bincount(part[along > median.astype(np.float32)[part]], minlength=p) / size
        median += 2.5 * width * (share - 0.5)  # a normal density has the height 1 / 2.5 at its median
    return along > median.astype(np.float32)[part]
