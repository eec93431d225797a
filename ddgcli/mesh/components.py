"""Connected components of graphs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["connected_labels"]


def connected_labels(tail: ArrayLike, head: ArrayLike, n: int) -> tuple[int, NDArray[np.int64]]:
    """Components of an undirected graph, numbered by their lowest nodes.

    Every node points to its lowest neighbour, pointers are followed to their ends, and the edges between
    different ends remain; two rounds halve the number of ends at least. On a mesh this is faster than
    `scipy.sparse.csgraph`, whose import takes a fifth of the start-up time of a command.

    Parameters
    ----------
    tail, head : (k,) array of int
        Nodes of the edges, in 0 ... n-1.
    n : int
        Number of nodes.

    Returns
    -------
    int
        Number of components; a node without an edge is one.
    (n,) ndarray of int64
        Component of each node.
    """
    parent = np.arange(n)
    a, b = np.ravel(tail), np.ravel(head)
    while len(a):
        np.minimum.at(parent, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(further := parent[parent], parent):
            parent = further
        a, b = parent[a], parent[b]
        apart = a != b
        a, b = a[apart], b[apart]
    is_lowest = parent == np.arange(n)
    return int(is_lowest.sum()), (np.cumsum(is_lowest) - 1)[parent]
