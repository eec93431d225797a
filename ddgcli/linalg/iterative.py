"""Conjugate gradients in place of a factorisation, for systems whose factors do not fit into memory.

Two preconditioners: smoothed-aggregation multigrid of pyamg (the extra `multigrid`), and the inverse of the
diagonal, which needs no further library and many more iterations. Both solve to the residual of a direct
solver: the componentwise backward error is at rounding level, also where a solution spans hundreds of orders
of magnitude (heat).

P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order
elliptic problems", 1996.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, csr_matrix

from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.errors import MissingExtraError, SolveError
from ddgcli.linalg.indices import compact

__all__ = [
    "Iterative",
    "jacobi",
    "preferred_iterative_solver",
    "require_multigrid",
    "v_cycle",
    "without_single_blocks",
]

ROUND_REDUCTION = 1e-10  # of the residual in one round of conjugate gradients
BACKWARD_ERROR = 4e-16  # componentwise, at which a row of the residual is rounding
SMALL_ERROR = 1e-13  # backward error below which rounds end as soon as one does not halve it
MAX_ROUNDS = 80  # ten digits each
MAX_ITERATIONS = 20_000  # of one round
MAX_COARSE = 500  # unknowns of the level that is solved densely
FAILURE_ERROR = 1e-6  # componentwise backward error of a solution that is refused


def preferred_iterative_solver() -> str:
    """Name of the iterative solver to prefer.

    Returns
    -------
    str
        `multigrid` where pyamg is installed, else `conjugate-gradients`.
    """
    return ITERATIVE_SOLVERS[0 if importlib.util.find_spec("pyamg") else 1]


def require_multigrid(name: str) -> None:
    """Raise an error if a solver needs pyamg and it is not installed.

    Parameters
    ----------
    name : str
        Name of the solver.

    Raises
    ------
    MissingExtraError
    """
    if name == "multigrid" and not importlib.util.find_spec("pyamg"):
        raise MissingExtraError(
            "solver 'multigrid' needs pyamg; pip install 'ddgcli[multigrid]', or use 'conjugate-gradients'"
        )


class Iterative:
    """Conjugate gradients with the interface of a factorisation, for definite matrices.

    Parameters
    ----------
    matrix : (n, n) csc_array
    name : {'multigrid', 'conjugate-gradients'}

    Attributes
    ----------
    iterations : int
        Total number of iterations since the last `refactor`.
    most_iterations : int
        Largest number of iterations of a solve since the start.
    residual : float
        Largest |A x - b| / |b| of all solves, Euclidean norms.
    sufficient_residual : float
        Residual at which iterations stop; 0, the default, stops only at rounding in each row.

    Raises
    ------
    MissingExtraError
        Multigrid without pyamg.
    """

    order = None
    repeats = True

    def __init__(self, matrix: csc_array, name: str) -> None:
        require_multigrid(name)
        self.name = name
        self.most_iterations, self.residual, self.sufficient_residual = 0, 0.0, 0.0
        self._order = _local_order(matrix)
        self.refactor(matrix)

    def refactor(self, matrix: csc_array) -> None:
        """Preconditioner of new values."""
        # a symmetric matrix by columns is its conjugate by rows, which multiplies faster
        rows = matrix.T if np.isrealobj(matrix.data) else matrix
        self._matrix = csr_array(csr_array(rows)[self._order][:, self._order])
        self._magnitude = csr_array(
            (np.abs(self._matrix.data), self._matrix.indices, self._matrix.indptr), shape=matrix.shape
        )
        if self.name == "multigrid":
            self._precondition = v_cycle(csr_matrix(self._matrix), max_coarse=MAX_COARSE)
        else:
            self._precondition = jacobi(self._matrix)
        self.iterations = 0

    def solve(self, rhs: NDArray) -> NDArray:
        """Solution for (n,) or (n, k)."""
        columns = np.atleast_2d(rhs.T)
        x = np.empty(columns.shape, dtype=np.result_type(rhs, self._matrix.dtype))
        for column, load in zip(x, columns, strict=True):
            column[self._order] = self._solve(load[self._order])
        return x[0] if rhs.ndim == 1 else x.T

    def _solve(self, b: NDArray) -> NDArray:
        """Rounds of conjugate gradients on the rows whose residual is more than rounding."""
        x = np.zeros(b.shape, dtype=np.result_type(b, self._matrix.dtype))
        least, best, before = np.inf, x, self.iterations
        norm, left = float(np.linalg.norm(b)) or 1.0, np.inf
        sufficient = self.sufficient_residual * norm
        for _ in range(MAX_ROUNDS):
            residual = b - self._matrix @ x
            size = self._magnitude @ np.abs(x) + np.abs(b)
            # rows whose terms are all negligible carry no information
            size = np.maximum(size, np.finfo(float).tiny / np.finfo(float).eps)
            inexact = np.abs(residual) > BACKWARD_ERROR * size
            error, length = float((np.abs(residual) / size).max(initial=0.0)), float(np.linalg.norm(residual))
            ends = not inexact.any() or not np.isfinite(error)
            ends |= error <= SMALL_ERROR and (error > 0.5 * least or sufficient > 0)
            ends |= length <= sufficient
            if error < least or length <= sufficient:
                least, best, left = error, x, length / norm
            if ends:
                break
            unit = float(np.abs(residual[inexact]).max())
            reduction = max(ROUND_REDUCTION, 0.5 * sufficient / length) if sufficient else ROUND_REDUCTION
            step = self._round(np.where(inexact, residual, 0.0) / unit, reduction)
            if step is None:
                break
            x = x + unit * step
        if not (least <= FAILURE_ERROR or left <= self.sufficient_residual):
            raise SolveError(
                f"{self.name} did not converge (backward error {least:.2g}); use a direct solver, or repair "
                "degenerate faces"
            )
        self.most_iterations = max(self.most_iterations, self.iterations - before)
        self.residual = max(self.residual, left)
        return best

    def _round(self, b: NDArray, reduction: float) -> NDArray | None:
        """Conjugate gradients until the residual is `reduction` times the first; None without progress."""
        x, r = np.zeros_like(b), b.copy()
        z = self._precondition(r)
        rz = np.vdot(r, z).real
        p, allowed = z.copy(), reduction**2 * np.vdot(b, b).real
        for k in range(MAX_ITERATIONS):
            ap = self._matrix @ p
            curvature = np.vdot(p, ap).real
            if not curvature > 0 or not rz > 0:
                return x if k else None
            x += rz / curvature * p
            r -= rz / curvature * ap
            self.iterations += 1
            if np.vdot(r, r).real <= allowed:
                break
            z = self._precondition(r)
            before, rz = rz, np.vdot(r, z).real
            p *= rz / before
            p += z
        return x


def _local_order(matrix: csc_array) -> NDArray[np.intp]:
    """Order in which neighbours are near each other in memory: products and smoothing miss the cache less."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    matrix = compact(matrix)
    pattern = csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    return reverse_cuthill_mckee(pattern, symmetric_mode=True)


def jacobi(matrix: csr_array) -> Callable[[NDArray], NDArray]:
    """Jacobi preconditioner: division by the diagonal.

    Parameters
    ----------
    matrix : (n, n) csr_array
        Without zeros on the diagonal.

    Returns
    -------
    callable
        Takes and returns an (n,) ndarray.
    """
    inverse = 1.0 / matrix.diagonal().real
    return lambda r: inverse * r


def v_cycle(matrix: Any, **options: Any) -> Callable[[NDArray], NDArray]:
    """One V-cycle of smoothed aggregation of pyamg, symmetric, from zero; the same bits each time."""
    import pyamg

    sweep = ("gauss_seidel", {"sweep": "symmetric"})
    before = np.random.get_state()  # noqa: NPY002 (pyamg's estimates of norms start from such vectors)
    try:
        np.random.seed(0)  # noqa: NPY002
        hierarchy = pyamg.smoothed_aggregation_solver(
            matrix, symmetry="hermitian", presmoother=sweep, postsmoother=sweep, **options
        )
    finally:
        np.random.set_state(before)  # noqa: NPY002
    for level in hierarchy.levels:
        level.B = None  # of the setup alone
        for name in ("A", "P", "R"):
            setattr(level, name, without_single_blocks(getattr(level, name, None)))
    return hierarchy.aspreconditioner(cycle="V").matvec


def without_single_blocks(matrix: Any) -> Any:
    """A matrix without blocks where those of it are single entries, which pyamg smooths more slowly.

    Parameters
    ----------
    matrix : sparse matrix or None

    Returns
    -------
    sparse matrix or None
        In the format `csr`, or `matrix` itself.
    """
    single = getattr(matrix, "format", "") == "bsr" and matrix.blocksize == (1, 1)
    return matrix.tocsr() if single else matrix
