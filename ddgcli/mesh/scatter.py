"""Sums of values by index: of corners by vertex, of sides by edge, of cells by component."""

from __future__ import annotations

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
