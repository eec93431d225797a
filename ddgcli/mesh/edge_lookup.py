"""Indices of edges by their end vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def edge_indices(edges: NDArray, pairs: NDArray) -> NDArray[np.int64]:
    """Index of the edge between two vertices.

    Parameters
    ----------
    edges : (e, 2) ndarray of int
        End vertices, no two edges with the same.
    pairs : (..., 2) ndarray of int

    Returns
    -------
    (...) ndarray of int64
        -1 where no edge joins the two.

    Examples
    --------
    >>> edge_indices(np.array([[0, 1], [1, 2], [0, 2]]), np.array([[2, 1], [0, 3]])).tolist()
    [1, -1]
    """
    pairs = np.asarray(pairs, dtype=np.int64)
    if not len(edges) or not pairs.size:
        return np.full(pairs.shape[:-1], -1)
    n = 1 + max(int(edges.max()), int(pairs.max()))
    key, pair_key = (
        ends.min(axis=-1) * n + ends.max(axis=-1) for ends in (np.asarray(edges, np.int64), pairs)
    )
    order = None if (key[1:] > key[:-1]).all() else np.argsort(key)  # edges of a simplicial mesh ascend
    index = np.searchsorted(key, pair_key, sorter=order).clip(max=len(key) - 1)
    index = index if order is None else order[index]
    return np.where(key[index] == pair_key, index, -1)
