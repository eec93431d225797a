"""CHOLMOD of SuiteSparse through cvxopt, the extra `fast` (GPL-3)."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.errors import SolveError
from ddgcli.linalg.ordering import Ordered

log = logging.getLogger("ddgcli")

NUMPY_CORE = "numpy._core._multiarray_umath"  # lists the instructions of the processor
KERNEL_VARIABLE = "OPENBLAS_CORETYPE"  # read by OpenBLAS when it is loaded
COLUMNS_PER_SOLVE = 4  # right-hand sides that CHOLMOD's sparse solve treats together
# Unknowns and entries of a row up to which factors by single columns cost no more than those by blocks (a
# sixth more in complex numbers); their solves take 0.5 to 0.7 of the time.
MAX_COLUMNWISE_UNKNOWNS, MAX_COLUMNWISE_ENTRIES = 12_000, 9
DIAGONAL, PERMUTATION = 6, 7  # codes of the systems that `solve` can solve
NUMBERS = {"d": np.float64, "z": np.complex128}
BY_COLUMNS, BY_BLOCKS = 0, 2  # CHOLMOD's option `supernodal`


class NotPositiveDefinite(SolveError):
    """A Cholesky pivot is not positive; the caller factorises with pivoting instead."""


@cache
def cholmod_available() -> bool:
    """Whether CHOLMOD of the extra `fast` can be imported; reported at level INFO.

    Returns
    -------
    bool
        False, with a warning, where cvxopt is installed and its import fails: a library of it is missing.
    """
    if importlib.util.find_spec("cvxopt") is None:
        return False
    try:
        with _kernels_of_the_processor():
            importlib.import_module("cvxopt.cholmod")
    except ImportError as error:
        log.warning(
            "cvxopt is installed, but its import fails (%s): other solvers take its place; "
            "pip install --force-reinstall cvxopt",
            error,
        )
        return False
    log.info("CHOLMOD (cvxopt, GPL-3) is installed and used for large systems")
    return True


@contextmanager
def _kernels_of_the_processor() -> Iterator[None]:
    """Let a BLAS that is loaded meanwhile use AVX2 where the processor has it.

    The OpenBLAS in the wheel of cvxopt is older than many processors; on those that its list lacks, it takes
    kernels of 2004, with which a factorisation lasts three times as long. A choice of the user stays.
    """
    features = getattr(importlib.import_module(NUMPY_CORE), "__cpu_features__", {})
    if KERNEL_VARIABLE in os.environ or not (features.get("AVX2") and features.get("FMA3")):
        yield
        return
    os.environ[KERNEL_VARIABLE] = "Haswell"
    try:
        yield
    finally:
        del os.environ[KERNEL_VARIABLE]  # processes that start later choose for themselves


class Cholmod:
    """Cholesky factors of SuiteSparse through cvxopt (GPL-3); for definite matrices."""

    name = "cholmod"
    repeats = True

    def __init__(self, matrix: csc_array, like: Ordered | None = None) -> None:
        from cvxopt import cholmod, sparse, spmatrix
        from cvxopt import matrix as dense

        self._cholmod, self._dense, self._sparse = cholmod, dense, sparse
        n = matrix.shape[0]
        column = np.repeat(np.arange(n, dtype=np.int64), np.diff(matrix.indptr))
        self._lower = np.flatnonzero(matrix.indices >= column)
        rows = matrix.indices[self._lower].astype(np.int64)
        self._diagonal = rows == column[self._lower]
        self._matrix = spmatrix(self._values(matrix), dense(rows), dense(column[self._lower]), (n, n))
        self._by_columns = n <= MAX_COLUMNWISE_UNKNOWNS and matrix.nnz <= MAX_COLUMNWISE_ENTRIES * n
        order = like.order if like else None
        self._symbolic = self._analysed(None if order is None else dense(order.astype(np.int64)))
        self._numeric()

    def _analysed(self, order: Any) -> Any:
        """Symbolic factorisation in `order` only; without one CHOLMOD tries its own orders."""
        options = {"supernodal": BY_COLUMNS if self._by_columns else BY_BLOCKS}
        before = dict(self._cholmod.options)
        self._cholmod.options.update(options if order is None else options | {"nmethods": 1})
        try:
            return self._cholmod.symbolic(self._matrix, **({} if order is None else {"p": order}))
        finally:
            self._cholmod.options.clear()
            self._cholmod.options.update(before)

    @property
    def order(self) -> NDArray[np.int64]:
        numbers = self._dense(np.arange(self._matrix.size[0]).astype(NUMBERS[self._matrix.typecode]))
        self._cholmod.solve(self._symbolic, numbers, sys=PERMUTATION)
        return np.array(numbers).ravel().real.astype(np.int64)

    def _values(self, matrix: csc_array) -> Any:
        """Entries of the lower triangle; factors by columns refuse a diagonal that is real up to rounding."""
        values = matrix.data[self._lower]
        if np.iscomplexobj(values):
            values.imag[self._diagonal] = 0.0
        return self._dense(values)

    def refactor(self, matrix: csc_array) -> None:
        self._matrix.V = self._values(matrix)
        self._numeric()

    def _numeric(self) -> None:
        try:
            self._cholmod.numeric(self._matrix, self._symbolic)
        except ArithmeticError as error:
            raise NotPositiveDefinite(f"the matrix is not positive definite (column {error})") from error
        if self._by_columns:  # LDL^T, which exists where pivots are negative too
            inverse = self._dense(np.ones(self._matrix.size[0], dtype=NUMBERS[self._matrix.typecode]))
            self._cholmod.solve(self._symbolic, inverse, sys=DIAGONAL)
            negative = np.flatnonzero(~(np.array(inverse).real.ravel() > 0))
            if len(negative):
                raise NotPositiveDefinite(f"the matrix is not positive definite (column {negative[0]})")

    def solve(self, rhs: NDArray) -> NDArray:
        if rhs.ndim == 2 and rhs.shape[1] > 1:
            return self._solve_blocks(rhs)
        x = self._dense(rhs)
        self._cholmod.solve(self._symbolic, x)
        return np.array(x).reshape(rhs.shape)

    def _solve_blocks(self, rhs: NDArray) -> NDArray:
        """Solution for several right-hand sides, in half the time of one after the other.

        cvxopt hands the columns of a dense right-hand side to CHOLMOD one by one, a sparse one as a whole.
        """
        x = np.empty(rhs.shape, dtype=rhs.dtype, order="F")
        for begin in range(0, rhs.shape[1], COLUMNS_PER_SOLVE):
            columns = slice(begin, begin + COLUMNS_PER_SOLVE)
            block = self._sparse(self._dense(rhs[:, columns]))
            x[:, columns] = self._dense(self._cholmod.spsolve(self._symbolic, block))
        return x
