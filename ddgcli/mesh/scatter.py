"""Sums of values by index: of corners by vertex, of sides by edge, of cells by component."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def sum_by_index(index: NDArray, values: NDArray, n: int) -> NDArray:
    """Sum the values that share an index.

    Parameters
    ----------
    index : (...) ndarray of int
        In 0 .. n-1; any shape.
    values : (..., *d) ndarray
        One value or one row of values for each index; real or complex.
    n : int

    Returns
    -------
    (n, *d) ndarray of float64 or complex128
        Zero where no index points. Terms are added in the order of `index`.
    """
    if np.iscomplexobj(values):
        return sum_by_index(index, values.real, n) + 1j * sum_by_index(index, values.imag, n)
    flat, trailing = index.ravel(), values.shape[index.ndim :]
    if not trailing:
        return np.bincount(flat, weights=values.ravel(), minlength=n).astype(np.float64, copy=False)
    sums = np.zeros((n, int(np.prod(trailing))))
    for column, value in enumerate(values.reshape(len(flat), sums.shape[1]).T):
        sums[:, column] = np.bincount(flat, weights=value, minlength=n)
    return sums.reshape(n, *trailing)


def columns_at(x: NDArray, index: NDArray) -> list[NDArray]:
    """Gather rows at the columns of an index, as contiguous components.

    Numpy works on whole components several times as fast as on rows of three.

    Parameters
    ----------
    x : (n, 3) ndarray of float64
    index : (k, s) ndarray of int64

    Returns
    -------
    list of s arrays (3, k)
    """
    corners = np.take(np.ascontiguousarray(x.T), index.T, axis=1)
    return [corners[:, k] for k in range(index.shape[1])]


def sum_columns_by_index(index: NDArray, columns: Sequence[NDArray], n: int) -> NDArray[np.float64]:
    """Add up vectors at the rows that an index names; the transpose of `columns_at`.

    Parameters
    ----------
    index : (k, s) ndarray of int64
    columns : sequence of s arrays (3, k)
    n : int

    Returns
    -------
    (n, 3) ndarray of float64
    """
    flat = index.T.ravel()
    sums = np.empty((n, 3))
    for axis in range(3):
        weights = np.concatenate([column[axis] for column in columns])
        sums[:, axis] = np.bincount(flat, weights=weights, minlength=n)
    return sums
