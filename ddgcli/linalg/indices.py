"""Integer types of indices: 8 bytes for arrays of numpy, 4 bytes in sparse matrices.

On 1.3 million faces (`python -m benchmarks.peers.indices`): numpy converts indices of 4 bytes to 8 bytes at
each gather, so that `take`, `bincount` and indexing take 1.1 to 1.9 times as long with them. Sparse matrices
keep the type of the indices that they are made of: with 4 bytes they need three quarters of the memory, are
assembled in 0.85 of the time, multiply in 0.8 to 0.9, and solvers, which take 4 bytes, do not convert them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array

    Compressed = TypeVar("Compressed", csr_array, csc_array)

LARGEST_INT32 = 2**31 - 1


def matrix_indices(index: NDArray, *sizes: int) -> NDArray[np.integer]:
    """Indices of a sparse matrix: int32 where the sizes fit, else int64.

    Parameters
    ----------
    index : ndarray of int
        Rows, columns or starts of rows; each below the largest size, or equal to it.
    sizes : int
        Numbers of rows, of columns, of entries: whatever the matrix has to count.

    Returns
    -------
    ndarray of int32 or int64
        The input itself where it has the type already.
    """
    return index.astype(np.int32 if max(sizes) <= LARGEST_INT32 else np.int64, copy=False)


def compact(matrix: Compressed) -> Compressed:
    """Matrix with indices of the type of `matrix_indices`; shares the values.

    Products inherit the type; graph algorithms and factorisations of scipy before 1.17 take no others.

    Parameters
    ----------
    matrix : csr_array or csc_array

    Returns
    -------
    csr_array or csc_array
        The input itself where its indices have the type already.
    """
    sizes = (*matrix.shape, len(matrix.indices))
    index, start = matrix_indices(matrix.indices, *sizes), matrix_indices(matrix.indptr, *sizes)
    if index is matrix.indices and start is matrix.indptr:
        return matrix
    return type(matrix)((matrix.data, index, start), shape=matrix.shape)
