"""Nested dissection of a graph by its own distances.

Coordinates are breadth-first distances from a few vertices far apart, so that only the connectivity is used.
Every part is halved at the median of its longest direction, all parts of a level at once; the separators are
computed last from the edges between the halves (`separators.py`).

A. George, "Nested dissection of a regular finite element mesh", 1973.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ddgcli.linalg.indices import compact
from ddgcli.linalg.separators import separator_level

N_LANDMARKS = 5
N_SMOOTHING_STEPS = 3
LEAF_SIZE = 32  # vertices of a part that is not divided
MIN_COMPONENT_SIZE = 2000  # smaller components are dissected as one graph
MIN_CONDENSED_ROW = 12  # entries per row from which unknowns with the same neighbours are merged
# vertices that determine direction and median, of each part and of all parts
SAMPLE_SIZE, TOTAL_SAMPLE_SIZE = 128, 4096
N_SQUARINGS = 4  # of a covariance, for its longest direction
MIN_HALF_SHARE = 0.2  # of a part


@dataclass(frozen=True, eq=False)
class Dissection:
    """Recursive halving of a graph: a binary tree of parts, or several.

    Parameters
    ----------
    leaf : (n,) ndarray of int64
        Index of the smallest part that contains each vertex. Its part of height h is `leaf >> h`, unless
        its tree is lower than h.
    height : (n,) ndarray of int64
        Height of the part whose halves the vertex separates; 0 in leaves.
    """

    leaf: NDArray[np.int64]
    height: NDArray[np.int64]

    @property
    def order(self) -> NDArray[np.int64]:
        """(n,) elimination order: both halves of a part, then its separator.

        Every subtree is contiguous: in its symmetric mode SuperLU does not sort the tree itself, and halves
        far apart in memory cost it twice the time.
        """
        last = (((self.leaf >> self.height) + 1) << self.height) - 1  # leaf below the separated part
        return np.argsort((last << 6) + self.height, kind="stable")


def nested_dissection(matrix: csc_array) -> Dissection | None:
    """Nested dissection of the graph of a matrix.

    Unknowns with the same neighbours (the coordinates of one vertex) stay together. Components are
    dissected one after the other; small ones share leaves.

    Parameters
    ----------
    matrix : (n, n) csc_array
        Only the pattern is read; made symmetric.

    Returns
    -------
    Dissection or None
        None where a large part has no short separator.
    """
    graph = compact(_symmetric_graph(matrix))
    if graph.nnz < MIN_CONDENSED_ROW * graph.shape[0]:
        return _graph_dissection(graph)
    alike = _indistinguishable(graph)
    tail = np.repeat(alike, np.diff(graph.indptr))
    count = int(alike.max(initial=-1)) + 1
    condensed = coo_array((graph.data, (tail, alike[graph.indices])), shape=(count, count))
    dissection = _graph_dissection(
        compact(csr_array(condensed)), max(2, LEAF_SIZE * count // max(len(alike), 1))
    )
    return dissection and Dissection(dissection.leaf[alike], dissection.height[alike])


def _indistinguishable(graph: csr_array) -> NDArray[np.int64]:
    """(n,) index of the set of unknowns with the same neighbours, themselves included, of each unknown."""
    n = graph.shape[0]
    weight = np.random.default_rng(0).integers(0, 1 << 62, n)
    total = np.append(0, np.cumsum(weight[graph.indices]))  # wraps around
    own = np.ones(n, dtype=bool)
    own[graph.indices[graph.indices == np.repeat(np.arange(n), np.diff(graph.indptr))]] = False
    return np.unique(np.diff(total[graph.indptr]) + own * weight, return_inverse=True)[1]


def _graph_dissection(graph: csr_array, leaf_size: int = LEAF_SIZE) -> Dissection | None:
    """Nested dissection of a symmetric graph."""
    n = graph.shape[0]
    count, label = connected_components(graph, directed=False)
    if count == 1:
        result = _component_dissection(graph, leaf_size)
        return result and result[0]
    size = np.bincount(label, minlength=1)
    leaf, height = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    small = size <= leaf_size
    in_small = small[label]
    leaf[in_small] = ((np.cumsum(size * small) - 1) // leaf_size)[label[in_small]]
    n_leaves = int(leaf.max(initial=-1)) + 1
    large = size >= MIN_COMPONENT_SIZE
    rest = np.flatnonzero(~in_small)
    group = np.where(large, np.cumsum(large), 0)[label[rest]]
    members = np.split(
        rest[np.argsort(group, kind="stable")], np.cumsum(np.bincount(group, minlength=1))[:-1]
    )
    for vertices in members:
        if len(vertices):
            result = _component_dissection(_connected(compact(graph[vertices][:, vertices])), leaf_size)
            if result is None:
                return None
            dissected, levels = result
            n_leaves = -(-n_leaves >> levels << levels)  # so that part numbers are unique
            leaf[vertices], height[vertices] = n_leaves + dissected.leaf, dissected.height
            n_leaves += 1 << levels
    return Dissection(leaf, height)


def _symmetric_graph(matrix: csc_array) -> csr_array:
    """Graph of a symmetric matrix, whose zeros a product may have dropped in one triangle only."""
    n = matrix.shape[0]
    graph = csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=(n, n))
    other = matrix.tocsr()
    if np.array_equal(other.indptr, graph.indptr) and np.array_equal(other.indices, graph.indices):
        return graph
    return csr_array(graph + graph.T)


def _component_dissection(graph: csr_array, leaf_size: int) -> tuple[Dissection, int] | None:
    """Nested dissection of a connected graph, and the height of its tree."""
    graph, index = _breadth_first(graph)
    levels = max(1, int(np.ceil(np.log2(graph.shape[0] / leaf_size))))
    path = _halving_paths(_landmark_distances(graph), levels)
    level = separator_level(path, levels, graph)
    if level is None:
        return None
    leaf, height = np.empty_like(path), np.empty_like(path)
    leaf[index], height[index] = path, levels - level
    return Dissection(leaf, height), levels


def _connected(graph: csr_array) -> csr_array:
    """The graph with an edge from each component to the next."""
    n = graph.shape[0]
    _, first = np.unique(connected_components(graph, directed=False)[1], return_index=True)
    a, b = first[:-1], first[1:]
    links = coo_array((np.ones(2 * len(a)), (np.append(a, b), np.append(b, a))), shape=(n, n))
    return compact(csr_array(graph + links))


def _breadth_first(graph: csr_array) -> tuple[csr_array, NDArray[np.int64]]:
    """The graph renumbered breadth first, and the old index of each vertex."""
    order = breadth_first_order(graph, 0, return_predecessors=False).astype(np.int64)
    return compact(graph[order][:, order]), order


def _landmark_distances(graph: csr_array) -> NDArray[np.float32]:
    """(N_LANDMARKS, n) smoothed distances from vertices far apart, in a graph numbered breadth first."""
    n = graph.shape[0]
    place = np.empty((n, N_LANDMARKS), dtype=np.float32)
    nearest, source = np.full(n, np.inf, dtype=np.float32), n - 1
    for j in range(N_LANDMARKS):
        place[:, j] = _distances(graph, source)
        nearest = np.minimum(nearest, place[:, j])
        source = int(np.argmax(nearest))
    weight = (1.0 / np.diff(graph.indptr)).astype(np.float32)[:, None]
    mean = csr_array((np.ones(graph.nnz, dtype=np.float32), graph.indices, graph.indptr), shape=(n, n))
    for _ in range(N_SMOOTHING_STEPS):
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


def _halving_paths(place: NDArray[np.float32], levels: int) -> NDArray[np.int64]:
    """(n,) path of each vertex through `levels` halvings, a bit each, the first one highest."""
    n = place.shape[1]
    part_number = np.zeros(n, dtype=np.int64)
    for level in range(levels):
        some = _sample(n, max(SAMPLE_SIZE << level, TOTAL_SAMPLE_SIZE))
        axis, median = _median_planes(place[:, some], part_number[some], 1 << level)
        along = -median[part_number]
        for x, a in zip(place, axis, strict=True):
            along += x * a[part_number]
        part_number = 2 * part_number + _balanced_halves(along > 0, along, part_number, 1 << level)
    return part_number


def _balanced_halves(upper: NDArray, along: NDArray, part_number: NDArray, n_parts: int) -> NDArray[np.bool_]:
    """(n,) whether in the upper half; uneven parts are halved in order along their direction.

    Vertices with equal coordinates (the ends of a star, the rim of a fan) are ordered by index.
    """
    size, above = (
        np.bincount(part_number, minlength=n_parts),
        np.bincount(part_number[upper], minlength=n_parts),
    )
    uneven = np.minimum(above, size - above) < MIN_HALF_SHARE * size
    some = np.flatnonzero(uneven[part_number])
    some = some[np.lexsort((along[some], part_number[some]))]
    size[~uneven] = 0
    upper[some] = np.arange(len(some)) >= np.repeat(np.cumsum(size) - size // 2, size)
    return upper


def _sample(n: int, size: int) -> NDArray[np.int64] | slice:
    """About `size` of n vertices at random: every k-th vertex of a regular mesh may lie on one side."""
    stride = n // size
    if stride < 2:
        return slice(None)
    begin = np.arange(0, n - stride + 1, stride)
    return begin + np.random.default_rng(0).integers(0, stride, len(begin))


def _median_planes(place: NDArray, part_number: NDArray, n_parts: int) -> tuple[NDArray, NDArray]:
    """Longest direction of each part (k, p), and its approximate median along that direction (p,)."""

    def mean(values: NDArray) -> NDArray:
        return np.bincount(part_number, values, n_parts) / size

    k = len(place)
    size = np.maximum(np.bincount(part_number, minlength=n_parts), 1)
    centre = np.stack([mean(x) for x in place])
    offset = [x - c[part_number] for x, c in zip(place, centre, strict=True)]
    spread = np.empty((n_parts, k, k))
    for i in range(k):
        for j in range(i, k):
            spread[:, i, j] = spread[:, j, i] = mean(offset[i] * offset[j])
    axis = _longest_axis(spread)
    along = sum(x * a[part_number] for x, a in zip(offset, axis, strict=True))
    median, width = np.zeros(n_parts), np.sqrt(mean(along * along))
    for _ in range(2):
        share = np.bincount(part_number[along > median[part_number]], minlength=n_parts) / size
        median += 2.5 * width * (share - 0.5)  # a normal density has the height 1 / 2.5 at its median
    median += (centre * axis).sum(axis=0)
    return axis.astype(np.float32), median.astype(np.float32)


def _longest_axis(spread: NDArray) -> NDArray[np.float64]:
    """(k, p) approximate direction of the largest variance of each (p, k, k) covariance, by squaring."""
    tiny = np.finfo(float).tiny
    power = spread
    for _ in range(N_SQUARINGS):
        power = power / np.maximum(np.abs(power).max(axis=(1, 2), keepdims=True), tiny)
        power = power @ power
    column = np.einsum("pii->pi", power).argmax(axis=1)
    axis = power[np.arange(len(power)), column]
    return (axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), tiny)).T
