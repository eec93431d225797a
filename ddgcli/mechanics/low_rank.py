"""Hessians with a dense part of low rank, such as the stiffness of a gas: solve by Woodbury's identity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

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
