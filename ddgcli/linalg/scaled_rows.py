"""Sparse matrices with rows multiplied by numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array


def scaled_rows(matrix: csr_array, factor: NDArray) -> csr_array:
    """Matrix with each row multiplied by a number; symmetric where a block of the matrix has one number.

    Parameters
    ----------
    matrix : (n, n) csr_array
    factor : (n,) ndarray of float64

    Returns
    -------
    (n, n) csr_array
        Shares the indices.
    """
    data = np.repeat(factor, np.diff(matrix.indptr)) * matrix.data
    return csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)
