"""Factorisation of symmetric systems: the only solver of sparse linear systems in the project."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, eye_array, sparray

from ddgcli.errors import SolveError
from ddgcli.linalg.backends import (
    Analysis,
    Backend,
    NotPositiveDefinite,
    choose_solver,
    make_backend,
)
from ddgcli.linalg.indices import compact
from ddgcli.linalg.iterative import Iterative
from ddgcli.linalg.superlu import SymmetricLU

log = logging.getLogger("ddgcli")

REFINEMENT_TOLERANCE = 1e-13  # componentwise backward error at which a solution needs no refinement
FAILURE_RESIDUAL = 1e-2  # relative residual at which a solution has no correct digit
MAX_REFINEMENTS = 4
# of an LDL^T whose pivots are counted: largest backward error, and multiples of the shift to try
INERTIA_BACKWARD_ERROR, INERTIA_SHIFTS = 1e-8, (1.0, 1.3, 0.7)


class Factor:
    """One factorisation of a symmetric (or complex Hermitian) matrix, many solves.

    Parameters
    ----------
    matrix : (n, n) sparse array
        Non-singular; both triangles stored. For a Laplacian with its null space see `Poisson`, for fixed
        unknowns `Dirichlet`.
    definite : bool
        False: the matrix is indefinite (a saddle point) and is factorised with pivoting at once. With True an
        indefinite matrix is factorised with pivoting after a failed attempt.
    pivot : bool
        False raises `NotPositiveDefinite` instead of the second attempt, where the factorisation detects it;
        SuperLU does not.
    solver : str, optional
        'auto', 'multifrontal', 'superlu', 'cholmod', 'pivoted', 'multigrid' or 'conjugate-gradients'.
        Default: the environment variable DDGCLI_SOLVER, else for large systems CHOLMOD where the extra
        `fast` is installed, otherwise our multifrontal factorisation, and for small ones SuperLU of scipy;
        where the factors do not fit into the available memory, conjugate gradients (`iterative.py`).
    like : Factor, optional
        Factor of a matrix with the same pattern, whose elimination order and symbolic analysis are reused.

    Attributes
    ----------
    matrix : csc_array
    solver : str
        Name of the backend: 'multifrontal', 'superlu' or 'cholmod' (definite), 'pivoted' (anything).

    Raises
    ------
    SolveError
        The matrix is not square, holds values that are not finite, or is singular.
    """

    def __init__(
        self,
        matrix: sparray,
        *,
        definite: bool = True,
        pivot: bool = True,
        solver: str | None = None,
        like: Factor | None = None,
    ) -> None:
        self.matrix, self._pivot = _checked(matrix), pivot
        if like and not like.same_pattern(self.matrix):
            like = None
        if definite and not (self.matrix.diagonal().real > 0).all():
            definite = self._reject_definite(NotPositiveDefinite("a diagonal entry is not positive"))
        # entries of the factors, if the analysis counted them
        self._entries: float | None = like._entries if like else None
        name, analysis = choose_solver(solver, self.matrix, definite, entries=self._entries)
        if analysis:
            self._entries = analysis.entries
        self._factorise(name, like._backend if like else analysis)
        self._analysed = True  # the backend has the pattern of the matrix

    @property
    def n(self) -> int:
        return self.matrix.shape[0]

    @property
    def solver(self) -> str:
        return self._backend.name

    @property
    def iterative(self) -> Iterative | None:
        """Conjugate gradients that take the place of the factorisation; None where there is one."""
        return self._backend if isinstance(self._backend, Iterative) else None

    @property
    def repeats(self) -> bool:
        """Whether factors of the same matrix are the same bits, the first time and later."""
        return self._backend.repeats

    @property
    def order(self) -> NDArray[np.int64] | None:
        """Unknown eliminated at each step; None where pivoting decides."""
        return self._backend.order

    def same_pattern(self, other: csc_array) -> bool:
        """Whether another matrix stores the same entries in the same order."""
        mine = self.matrix
        return (
            mine.shape == other.shape
            and (mine.indptr is other.indptr or np.array_equal(mine.indptr, other.indptr))
            and (mine.indices is other.indices or np.array_equal(mine.indices, other.indices))
        )

    def _factorise(self, name: str, like: Backend | Analysis | None = None) -> None:
        self._magnitude: csc_array | None = None
        self._row_scale: NDArray | None = None
        try:
            self._backend = make_backend(name, self.matrix, like)
        except NotPositiveDefinite as error:
            self._reject_definite(error)
            self._backend = make_backend("pivoted", self.matrix)

    def _reject_definite(self, error: NotPositiveDefinite) -> bool:
        """Return False, the new value of `definite`; raise `error` if pivoting is not allowed."""
        if not self._pivot:
            raise error
        log.info("%s: factorised with pivoting instead", error)
        return False

    def refactor(self, matrix: sparray) -> Factor:
        """Factorise new values; ordering and symbolic analysis are kept when the pattern is the same.

        The bits of solutions depend on the matrix alone, not on those before it.
        """
        matrix = _checked(matrix)
        same = self._analysed and self.matrix.dtype == matrix.dtype and self.same_pattern(matrix)
        self.matrix, self._magnitude, self._row_scale = matrix, None, None
        if not same:
            self._analysed = False  # where this fails, the analysis is that of another pattern
            self._factorise(self.solver)
            if not self.repeats:  # the bits must not depend on the matrices before
                self._backend.refactor(matrix)
            self._analysed = True
            return self
        try:
            if not self._pivot and not (matrix.diagonal().real > 0).all():
                raise NotPositiveDefinite("a diagonal entry is not positive")
            self._backend.refactor(matrix)
        except NotPositiveDefinite as error:
            self._reject_definite(error)
            self._backend = make_backend("pivoted", matrix)
        return self

    def solve(self, rhs: NDArray, *, refine: bool = True) -> NDArray:
        """Solution of matrix @ x = rhs for (n,) or (n, k) right-hand sides.

        Iterative refinement runs until the componentwise backward error is at rounding level; `refine=False`
        omits the check and the refinement, for inner solves of an iteration that measures its own residual.

        Raises
        ------
        SolveError
            The right-hand side is not finite, or the matrix is singular to working precision and no
            solution with a small residual exists.
        """
        b = self._checked_rhs(rhs)
        if b.size == 0:
            return b
        x = self._backend.solve(b)
        if not refine:
            return x
        x = self._refined(x, b)
        is_wrong = self._is_wrong(x, b)
        if is_wrong and self.solver != "pivoted":
            log.info("the solution by %s has no correct digit: factorised with pivoting", self.solver)
            self._backend = make_backend("pivoted", self.matrix)
            x = self._refined(self._backend.solve(b), b)
            is_wrong = self._is_wrong(x, b)
        if is_wrong:
            raise SolveError(
                "the matrix is singular to working precision: no solution with a small residual was found; "
                "fix an unknown of every component, or remove degenerate faces"
            )
        return x

    def _is_wrong(self, x: NDArray, b: NDArray) -> bool:
        """Whether the residual, rows scaled by the diagonal, is not small relative to the right-hand side."""
        if self._row_scale is None:
            diagonal = np.abs(self.matrix.diagonal())
            self._row_scale = 1.0 / np.sqrt(
                np.where(diagonal > 0, diagonal, diagonal.max(initial=0.0) or 1.0)
            )
        scale = self._row_scale if b.ndim == 1 else self._row_scale[:, None]
        residual = np.abs(scale * (self.matrix @ x - b)).max()
        return not residual <= FAILURE_RESIDUAL * np.abs(scale * b).max()

    def _checked_rhs(self, rhs: NDArray) -> NDArray:
        rhs = np.asarray(rhs)
        if rhs.shape[:1] != (self.n,) or rhs.ndim > 2:
            raise SolveError(f"the right-hand side has shape {rhs.shape}, the matrix {self.matrix.shape}")
        b = np.array(rhs, dtype=np.result_type(self.matrix.dtype, rhs.dtype, np.float64))
        if np.iscomplexobj(b) and not np.iscomplexobj(self.matrix):
            raise SolveError("a complex right-hand side needs a complex matrix")
        if not np.isfinite(b).all():
            raise SolveError("the right-hand side holds values that are not finite")
        return b

    def _refined(self, x: NDArray, b: NDArray) -> NDArray:
        """Solution after at most MAX_REFINEMENTS corrections, as long as each halves the backward error."""
        error = self.backward_error(x, b)
        for _ in range(MAX_REFINEMENTS):
            if error <= REFINEMENT_TOLERANCE or not np.isfinite(error):
                break
            candidate = x + self._backend.solve(np.asfortranarray(b - self.matrix @ x))
            new_error = self.backward_error(candidate, b)
            if not new_error < error:
                break
            stalled = new_error > 0.5 * error
            x, error = candidate, new_error
            if stalled:
                break
        return x

    def backward_error(self, x: NDArray, rhs: NDArray) -> float:
        """Largest |A x - b| / (|A| |x| + |b|) over the rows: the relative change of A and b that explains x.

        W. Oettli, W. Prager, "Compatibility of approximate solution of linear equations", 1964.
        """
        if not np.isfinite(x).all():
            return float("inf")
        if self._magnitude is None:
            A = self.matrix
            self._magnitude = csc_array((np.abs(A.data), A.indices, A.indptr), shape=A.shape)
        numerator = np.abs(self.matrix @ x - rhs)
        denominator = self._magnitude @ np.abs(x) + np.abs(rhs)
        # rows whose terms are all negligible carry no information
        denominator = np.maximum(denominator, np.finfo(float).tiny / np.finfo(float).eps)
        return float((numerator / denominator).max(initial=0.0))

    def residual(self, x: NDArray, rhs: NDArray) -> float:
        """Largest |A x - b| relative to the largest |b| (or 1 where b vanishes)."""
        return float(np.abs(self.matrix @ x - rhs).max(initial=0.0) / (np.abs(rhs).max(initial=0.0) or 1.0))


def negative_eigenvalues(matrix: sparray, below: float = 0.0) -> int | None:
    """Number of eigenvalues of a real symmetric matrix that are smaller than -below.

    Sylvester's law of inertia: matrix + below I = L D L^T has as many negative eigenvalues as D negative
    entries. The factorisation takes its pivots from the diagonal, and may be unstable where the matrix is
    indefinite: a solution by it is checked, and if it fails a number close to `below` is tried.

    Parameters
    ----------
    matrix : (n, n) sparse array
    below : float
        Eigenvalues within it count as zero.

    Returns
    -------
    int, or None if every factorisation failed the check.
    """
    checked = _checked(matrix)
    probe = np.random.default_rng(0).normal(size=checked.shape[0])
    for factor in INERTIA_SHIFTS if checked.shape[0] else ():
        shifted = _checked(checked + eye_array(checked.shape[0], format="csc") * (factor * below))
        try:
            lu = SymmetricLU(shifted)
        except SolveError:
            continue
        x, negative = lu.solve(probe), lu.negative_pivots()
        size = abs(shifted) @ np.abs(x) + np.abs(probe)
        if negative is not None and (np.abs(shifted @ x - probe) <= INERTIA_BACKWARD_ERROR * size).all():
            return negative
    return None if checked.shape[0] else 0


def _checked(matrix: sparray) -> csc_array:
    """The matrix in sorted CSC form, square and finite."""
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise SolveError(f"the matrix is not square: {matrix.shape}")
    csc = compact(csc_array(matrix))
    if csc.dtype not in (np.float64, np.complex128):
        csc = csc.astype(np.result_type(csc.dtype, np.float64))
    if not csc.has_canonical_format:
        csc = csc.copy()
        csc.sum_duplicates()
    if not np.isfinite(csc.data).all():
        row = csc.indices[np.flatnonzero(~np.isfinite(csc.data))[0]]
        raise SolveError(f"the matrix holds a value that is not finite (row {row})")
    return csc
