"""Averages of values on cells at the vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import ratio


def cells_to_vertices(corners: NDArray, measure: NDArray, values: NDArray, n: int) -> NDArray[np.float64]:
    """Means over the cells around each vertex, weighted with their measures.

    Parameters
    ----------
    corners : (m, c) ndarray of int64
        Vertices of the cells.
    measure : (m,) ndarray of float64
    values : (m, d) ndarray of float64
        On the cells; (m, c, d) on their corners.
    n : int
        Number of vertices.

    Returns
    -------
    (n, d) ndarray of float64
        Zero at vertices without cells.

    Examples
    --------
    >>> corners = np.array([[0, 1, 2], [2, 1, 3]])
    >>> cells_to_vertices(corners, np.array([1.0, 3.0]), np.array([[0.0], [4.0]]), 5)[:, 0].tolist()
    [0.0, 3.0, 3.0, 4.0, 0.0]
    """
    if values.ndim == 2:
        values = values[:, None]
    weighted = np.broadcast_to(measure[:, None, None] * values, (*corners.shape, values.shape[-1]))
    weight = sum_by_index(corners, np.broadcast_to(measure[:, None], corners.shape), n)
    return ratio(sum_by_index(corners, weighted, n), weight[:, None])


def vertex_measure(corners: NDArray, measure: NDArray, n: int) -> NDArray[np.float64]:
    """Measures of the vertices: equal shares of those of the cells around them.

    Parameters
    ----------
    corners : (m, c) ndarray of int64
    measure : (m,) ndarray of float64
    n : int

    Returns
    -------
    (n,) ndarray of float64
        Their sum is that of the cells.
    """
    share = measure[:, None] / corners.shape[1]
    return sum_by_index(corners, np.broadcast_to(share, corners.shape), n)
