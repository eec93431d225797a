"""Nested dissection of a graph by its own distances, all parts of a level at once.

Coordinates are breadth-first distances from a few vertices far apart, so only the connectivity counts. Every
part is cut at the median of its longest direction; the vertices on one side of the cut are its separator.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order

LANDMARKS = 5
SMOOTHING = 3
LEAF = 16
# cuts one below the other; parts shrink by a fifth at least
MOST_LEVELS = 60
# a bad cut has a separator longer than so many square roots of its part, or a half smaller than this share
LONGEST_SEPARATOR, SMALLEST_SHARE = 5.0, 0.2
# a part up to this size may stay whole; a bad cut of a larger one gives the whole dissection up
MAY_STAY_WHOLE = 2000


def dissected(matrix: csc_array) -> NDArray[np.int64] | None:
    """(n,) elimination order: both halves of a part, then its separator, so that every subtree is contiguous.

    (In its symmetric mode SuperLU does not sort the tree itself; halves far apart in memory cost it twice the
    time.) None where a large part has no short separator (or the graph is not connected).
    """
    n = matrix.shape[0]
    place = _landmark_distances(matrix)
    if place is None:
        return None
    column = np.repeat(np.arange(n, dtype=np.int32), np.diff(matrix.indptr))
    upper = column < matrix.indices
    tail, head = column[upper], matrix.indices[upper].astype(np.int32)
    depth = np.full(n, n, dtype=np.int32)  # of the cut that took the vertex out; n for leaves
    last = np.zeros(n, dtype=np.uint64)  # where the part that held the vertex last ends, among the leaves
    vertex, part, n_parts, level = np.arange(n), np.zeros(n, dtype=np.int32), 1, 0
    path = np.zeros(1, dtype=np.uint64)  # of each part: a bit a cut
    while len(vertex):
        size = np.bincount(part, minlength=n_parts)
        upper_half, separator, good = _cut(place, part, size, tail, head)
        if level == MOST_LEVELS or (size[~good] > MAY_STAY_WHOLE).any():
            return None
        separator &= good[part]
        depth[vertex[separator]] = level
        last[vertex] = _end(path, level)[part]
        half = 2 * part + upper_half
        live = good[part] & ~separator
        half_path = np.repeat(path * np.uint64(2), 2)
        half_path[1::2] += np.uint64(1)
        last[vertex[live]] = _end(half_path, level + 1)[half[live]]
        split_on = np.bincount(half[live], minlength=2 * n_parts) > LEAF
        number = np.cumsum(split_on, dtype=np.int32) - 1
        keep = live & split_on[half]
        vertex, place, part, tail, head = _kept(keep, number[half], vertex, place, tail, head)
        path, n_parts, level = half_path[split_on], int(split_on.sum()), level + 1
    return np.lexsort((-depth, last))


def _end(path: NDArray, level: int) -> NDArray[np.uint64]:
    """Where the interval of leaves below each part ends."""
    shift = np.uint64(MOST_LEVELS + 1 - level)
    return ((path + np.uint64(1)) << shift) - np.uint64(1)


def _kept(
    keep: NDArray, part: NDArray, vertex: NDArray, place: NDArray, tail: NDArray, head: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """The arrays of the vertices that go on, and the edges inside their parts, renumbered."""
    inside = keep[tail] & keep[head]
    inside &= part[tail] == part[head]
    number = np.cumsum(keep, dtype=np.int32) - 1
    return vertex[keep], place[keep], part[keep], number[tail[inside]], number[head[inside]]


def _landmark_distances(matrix: csc_array) -> NDArray[np.float32] | None:
    """(n, LANDMARKS) smoothed graph distances from vertices far apart; None if not connected."""
    n = matrix.shape[0]
    graph = csr_array((np.ones(matrix.nnz, dtype=np.float32), matrix.indices, matrix.indptr), shape=(n, n))
    first = _distances(graph, 0)
    if first is None:
        return None
    place = np.empty((n, LANDMARKS), dtype=np.float32)
    nearest, source = np.full(n, np.inf, dtype=np.float32), int(np.argmax(first))
    for j in range(LANDMARKS):
        place[:, j] = _distances(graph, source)
        nearest = np.minimum(nearest, place[:, j])
        source = int(np.argmax(nearest))
    weight = (1.0 / np.diff(matrix.indptr)).astype(np.float32)[:, None]
    for _ in range(SMOOTHING):
        place = (graph @ place) * weight
    return place


def _distances(graph: csr_array, source: int) -> NDArray[np.float32] | None:
    """(n,) number of edges to the source; None where some vertex is out of reach."""
    n = graph.shape[0]
    order, before = breadth_first_order(graph, source)
    if len(order) < n:
        return None
    rank = np.empty(n, dtype=np.int32)
    rank[order] = np.arange(n, dtype=np.int32)
    parent = rank[before[order[1:]]]  # ascending, so each ring of vertices is found by bisection
    ring = [0, 1]
    while ring[-1] < n:
        ring.append(1 + int(np.searchsorted(parent, ring[-1])))
    distance = np.empty(n, dtype=np.float32)
    distance[order] = np.repeat(np.arange(len(ring) - 1, dtype=np.float32), np.diff(ring))
    return distance


def _cut(
    place: NDArray, part: NDArray, size: NDArray, tail: NDArray, head: NDArray
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Upper half and separator of every part, on vertices, and whether the part's cut is good."""
    n_parts = len(size)
    upper = _upper_half(place, part, size)
    crossing = upper[tail] != upper[head]
    a, b = tail[crossing], head[crossing]
    touched = np.zeros(len(part), dtype=bool)
    touched[a] = touched[b] = True
    above, below = touched & upper, touched & ~upper
    n_above = np.bincount(part[above], minlength=n_parts)
    n_below = np.bincount(part[below], minlength=n_parts)
    separator = np.where((n_above <= n_below)[part], above, below)
    in_upper = np.bincount(part[upper], minlength=n_parts)
    least = np.minimum(in_upper, size - in_upper)
    good = np.minimum(n_above, n_below) <= LONGEST_SEPARATOR * np.sqrt(size)
    return upper, separator, good & (least >= SMALLEST_SHARE * size)


def _upper_half(place: NDArray, part: NDArray, size: NDArray) -> NDArray[np.bool_]:
    """(n,) whether a vertex lies beyond the median of its part's longest direction (nearly the median)."""
    n_parts, k = len(size), place.shape[1]
    mean = np.stack([np.bincount(part, place[:, j], n_parts) for j in range(k)], axis=1) / size[:, None]
    offset = place - mean[part].astype(np.float32)
    spread = np.empty((n_parts, k, k))
    for i in range(k):
        for j in range(i, k):
            product = np.bincount(part, offset[:, i] * offset[:, j], n_parts)
            spread[:, i, j] = spread[:, j, i] = product
    value, direction = np.linalg.eigh(spread)
    along = np.einsum("ij,ij->i", offset, direction[:, :, -1].astype(np.float32)[part])
    width = np.sqrt(np.maximum(value[:, -1], 0.0) / size)
    median = np.zeros(n_parts)
    for _ in range(3):
        share = np.bincount(part, along > median[part], n_parts) / size
        median += 3.0 * width * (share - 0.5)
    return along > median[part]
