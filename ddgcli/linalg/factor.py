"""The one solver layer: every symmetric system of the project is factorised here and nowhere else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, sparray
from scipy.sparse.linalg import splu

from ddgcli.errors import SolveError


class Factor:
    """One factorisation of a symmetric matrix, many solves.

    Parameters
    ----------
    matrix : (n, n) sparse array
        Symmetric, non-singular (see `Poisson` for a Laplacian with its null space).

    Raises
    ------
    SolveError
        When the matrix is singular to working precision.
    """

    def __init__(self, matrix: sparray) -> None:
        self.matrix = csc_array(matrix)
        try:
            self._lu = splu(
                self.matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise SolveError(f"the matrix is singular: {error}") from error

    def solve(self, rhs: NDArray) -> NDArray[np.float64]:
        """Solution of matrix @ x = rhs for (n,) or (n, k) right-hand sides."""
        return self._lu.solve(np.asarray(rhs, dtype=np.float64))

    def residual(self, x: NDArray, rhs: NDArray) -> float:
        """Largest |A x - b| relative to the largest |b| (or 1 where b vanishes)."""
        return float(np.abs(self.matrix @ x - rhs).max() / (np.abs(rhs).max() or 1.0))
