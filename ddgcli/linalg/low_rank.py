"""Matrices with a dense term of low rank, such as the stiffness of a gas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, eye_array

from ddgcli.linalg.factor import negative_eigenvalues

Operator = Callable[[NDArray], NDArray]


def product(matrix: Operator, columns: NDArray | None) -> Operator:
    """Product with a matrix plus a term of low rank, A + U U^T.

    Parameters
    ----------
    matrix : callable
        Product with A.
    columns : (n, k) ndarray of float64 or None
        U; None without such a term.

    Returns
    -------
    callable
    """
    if columns is None:
        return matrix
    return lambda v: matrix(v) + columns @ (columns.T @ v)


def solver(solve: Operator, columns: NDArray | None) -> Operator:
    """Solution with A + U U^T from the solution with A, by Woodbury's identity.

    Parameters
    ----------
    solve : callable
        Solution with A.
    columns : (n, k) ndarray of float64 or None
        U; None without such a term.

    Returns
    -------
    callable
    """
    if columns is None:
        return solve
    inverse = np.stack([solve(column) for column in columns.T], axis=1)
    small = np.linalg.inv(np.eye(columns.shape[1]) + columns.T @ inverse)

    def corrected(rhs: NDArray) -> NDArray[np.float64]:
        x = solve(rhs)
        return x - inverse @ (small @ (columns.T @ x))

    return corrected


def negative_eigenvalues_of_sum(matrix: csc_array, columns: NDArray | None, below: float = 0.0) -> int | None:
    """Number of eigenvalues of A + U U^T that are smaller than -below.

    Parameters
    ----------
    matrix : (n, n) csc_array
        A.
    columns : (n, k) ndarray of float64 or None
        U; None without such a term.
    below : float
        Eigenvalues within it count as zero.

    Returns
    -------
    int or None
        None where the factorisation fails.
    """
    if columns is None:
        return negative_eigenvalues(matrix, below)
    # the bordered matrix [[A, U], [U^T, -I]] has the inertia of A + U U^T and of -I
    bordered = block_array(
        [[matrix, csc_array(columns)], [csc_array(columns.T), -eye_array(columns.shape[1])]], format="csc"
    )
    count = negative_eigenvalues(bordered, below)
    return None if count is None else count - columns.shape[1]
