"""Choice of the sparse factorisation behind `Factor`: our own, SuperLU of scipy, CHOLMOD of the extra `fast`.

Each backend analyses a sorted CSC matrix once and factorises new values of the same pattern. `like` is a
backend of another matrix of the same pattern, whose analysis is used again, or an `Analysis` of the pattern.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.choices import ITERATIVE_SOLVERS, LINEAR_SOLVERS
from ddgcli.errors import ParameterError
from ddgcli.linalg.assembly_tree import AssemblyLevel, assembly_levels
from ddgcli.linalg.cholmod import Cholmod, NotPositiveDefinite, cholmod_available
from ddgcli.linalg.dissection import Dissection, nested_dissection
from ddgcli.linalg.iterative import Iterative, preferred_iterative_solver
from ddgcli.linalg.multifrontal import PivotOrder, cholesky_groups, cholesky_solve
from ddgcli.linalg.superlu import PivotedLU, SymmetricLU
from ddgcli.memory import available_memory

log = logging.getLogger("ddgcli")

# bytes of a factor: at most this times n^(4/3) in meshes of tetrahedra, less on surfaces
MAX_FACTOR_BYTES = 250.0
MIN_CHECKED_UNKNOWNS = 20_000  # smaller factors fit
MATRIX_BYTES = 24.0  # per entry of a matrix while it is assembled: value, row, position, sums
# unknowns below which importing the CHOLMOD wheel costs more than it saves
MIN_CHOLMOD_UNKNOWNS = 3000
# entries below which dissection costs more than minimum degree (8,600 vertices of a mesh, 350 of a shell)
MIN_MULTIFRONTAL_ENTRIES = 100_000
# eigenpairs and entries from which a shift among the eigenvalues costs less
MIN_SHIFTED_PAIRS, MIN_SHIFTED_ENTRIES = 30, 10_000


class Backend(Protocol):
    """One analysed pattern with the values of the last `refactor`."""

    name: str
    repeats: bool  # `refactor` of the same matrix gives the same bits

    @property
    def order(self) -> NDArray[np.int64] | None:
        """Unknown eliminated at each step, for other matrices of the same pattern; None if not kept."""

    def refactor(self, matrix: csc_array) -> None:
        """Factorise new values of the same pattern."""

    def solve(self, rhs: NDArray) -> NDArray:
        """Solution for (n,) or (n, k)."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """Elimination order and frontal matrices of a pattern, by which any backend can start."""

    dissection: Dissection
    levels: list[AssemblyLevel]

    @property
    def order(self) -> NDArray[np.int64]:
        return self.dissection.order

    @cached_property
    def entries(self) -> float:
        """Peak number of entries that a multifrontal factorisation stores; a bound for other backends."""
        groups = [
            (*group.pivot.shape, group.update.shape[1]) for level in self.levels for group in level.groups
        ]
        factors = sum(g * s * (s + u) for g, s, u in groups)
        sizes = [level.size for level in self.levels] + [0]
        return float(factors + max(below + above for below, above in zip(sizes, sizes[1:], strict=False)))


def analyse(matrix: csc_array) -> Analysis | None:
    """Symbolic analysis of a matrix by nested dissection.

    Parameters
    ----------
    matrix : (n, n) csc_array
        Symmetric pattern.

    Returns
    -------
    Analysis or None
        None for graphs without short separators.
    """
    dissection = nested_dissection(matrix)
    return None if dissection is None else Analysis(dissection, assembly_levels(matrix, dissection))


def choose_solver(
    solver: str | None,
    matrix: csc_array,
    definite: bool,
    *,
    entries: float | None = None,
) -> tuple[str, Analysis | None]:
    """Name of the solver for a matrix, and its symbolic analysis if the memory estimate required one.

    Parameters
    ----------
    solver : str or None
        Name that the caller requires; None for the setting of DDGCLI_SOLVER, which is `auto` by default.
    matrix : (n, n) csc_array
    definite : bool
        Positive definite; other matrices are factorised with pivoting.
    entries : float, optional
        `Analysis.entries` of the pattern, if known.

    Returns
    -------
    name : str
    analysis : Analysis or None
    """
    name = _solver_setting(solver)
    if name == "pivoted" or not definite:
        return "pivoted", None
    if name != "auto":
        return (name if matrix.shape[0] else "superlu"), None  # multigrid has no empty level
    iterative, analysis = _solver_of_little_memory(matrix, entries)
    return (iterative, None) if iterative else (_by_size(matrix), analysis)


def shift_is_cheap(solver: str | None, matrix: csc_array, k: int) -> bool:
    """Whether k eigenpairs cost least by a multifrontal factor of the matrix with a shift.

    Few pairs cost little more than the factor of the solver itself.

    Parameters
    ----------
    solver : str or None
        As in `choose_solver`.
    matrix : (n, n) csc_array
    k : int

    Returns
    -------
    bool
    """
    name = _solver_setting(solver)
    if name == "auto" and k < MIN_SHIFTED_PAIRS:
        name = _by_size(matrix)
    if name != "auto":
        return name == "multifrontal"
    return matrix.nnz >= MIN_SHIFTED_ENTRIES and direct_fits(matrix)


def displacement_solver(graph: csc_array, size: int) -> str | None:
    """Iterative solver of a system that has (size, size) blocks in the places of a graph's entries.

    Parameters
    ----------
    graph : (n, n) csc_array
        Pattern of the vertices that are coupled.
    size : int
        Unknowns of a vertex.

    Returns
    -------
    str or None
        None where the factors and the matrix, which does not exist yet, fit into the available memory, or
        DDGCLI_SOLVER names a direct solver.
    """
    name = _solver_setting(None)
    if name != "auto":
        return name if name in ITERATIVE_SOLVERS else None
    return _solver_of_little_memory(graph, None, size, MATRIX_BYTES * size**2 * graph.nnz)[0]


def direct_solver(matrix: csc_array) -> str:
    """Direct solver of a positive definite matrix whose factors fit into memory.

    Parameters
    ----------
    matrix : (n, n) csc_array

    Returns
    -------
    str
        That of DDGCLI_SOLVER, else by the size of the matrix.
    """
    name = _solver_setting(None)
    return _by_size(matrix) if name == "auto" else name


def _solver_setting(solver: str | None) -> str:
    """`solver`, else DDGCLI_SOLVER, else auto."""
    name = solver or os.environ.get("DDGCLI_SOLVER") or "auto"
    if name not in LINEAR_SOLVERS:
        raise ParameterError(
            f"solver {name!r} is not one of {', '.join(LINEAR_SOLVERS)}; change DDGCLI_SOLVER"
        )
    if name == "cholmod" and not cholmod_available():
        raise ParameterError(
            "solver 'cholmod' is not installed; pip install 'ddgcli[fast]', or use 'superlu'"
        )
    return name


def _by_size(matrix: csc_array) -> str:
    """Direct solver of a definite matrix."""
    if matrix.shape[0] >= MIN_CHOLMOD_UNKNOWNS and cholmod_available():
        return "cholmod"
    return "multifrontal" if matrix.nnz >= MIN_MULTIFRONTAL_ENTRIES else "superlu"


def _solver_of_little_memory(
    matrix: csc_array, entries: float | None, size: int = 1, further: float = 0.0
) -> tuple[str | None, Analysis | None]:
    """Iterative solver where the factors do not fit, with a warning, else None; and the analysis if made.

    Each entry of the pattern is a (size, size) block. `further` bytes are added.
    """
    n = size * matrix.shape[0]
    available = max(available_memory() - further, 0.0) if n >= MIN_CHECKED_UNKNOWNS else np.inf
    required_bytes, analysis = _needed_bytes(matrix, available, entries, size)
    if required_bytes <= available:
        return None, analysis
    iterative = preferred_iterative_solver()
    log.warning(
        "the factors of %d unknowns need about %.3g GiB, %.3g GiB are available: %s solve instead",
        n, required_bytes / 2**30, available / 2**30,
        "conjugate gradients with multigrid" if iterative == "multigrid" else "conjugate gradients",
    )  # fmt: skip
    return iterative, None


def direct_fits(matrix: csc_array) -> bool:
    """Whether a factorisation of a positive definite matrix fits into the available memory.

    Parameters
    ----------
    matrix : (n, n) csc_array

    Returns
    -------
    bool
        True without an estimate for small matrices.
    """
    available = available_memory() if matrix.shape[0] >= MIN_CHECKED_UNKNOWNS else np.inf
    return factor_bytes(matrix, available) <= available


def factor_bytes(matrix: csc_array, enough: float) -> float:
    """Bytes of a Cholesky factorisation: an upper bound below `enough`, else by symbolic analysis.

    For graphs without short separators, which have no cheap analysis, this is an upper bound.
    """
    return _needed_bytes(matrix, enough, None)[0]


def _needed_bytes(
    matrix: csc_array, enough: float, entries: float | None, block: int = 1
) -> tuple[float, Analysis | None]:
    """`factor_bytes`, and the analysis if one was made; entries are blocks of block^2 numbers."""
    n, size = block * matrix.shape[0], matrix.dtype.itemsize
    bound = min(MAX_FACTOR_BYTES * n ** (4 / 3), 4.0 * n * n) * (size / 8)
    if bound <= enough:
        return bound, None
    if entries is not None:
        return entries * size, None
    analysis = analyse(matrix)
    return (bound, None) if analysis is None else (block**2 * analysis.entries * size, analysis)


def make_backend(name: str, matrix: csc_array, like: Backend | Analysis | None = None) -> Backend:
    """Analyse and factorise a matrix with a named solver.

    Parameters
    ----------
    name : str
        Such as `multifrontal`, `superlu`, `cholmod`, `pivoted` or the name of an iterative solver.
    matrix : (n, n) csc_array
    like : Backend or Analysis, optional
        Backend for a matrix with the same pattern, whose analysis is reused.

    Returns
    -------
    Backend
    """
    if name in ITERATIVE_SOLVERS:
        return Iterative(matrix, name)
    kinds: dict[str, Callable[[csc_array, Backend | Analysis | None], Backend]]
    kinds = {
        "multifrontal": _multifrontal,
        "superlu": SymmetricLU,
        "cholmod": Cholmod,
        "pivoted": PivotedLU,
    }
    return kinds[name](matrix, like)


def _multifrontal(matrix: csc_array, like: Backend | Analysis | None) -> Backend:
    """Multifrontal, or SuperLU for graphs without short separators."""
    if isinstance(like, Multifrontal | Analysis):
        return Multifrontal(matrix, like.dissection, like.levels)
    analysis = None if isinstance(like, SymmetricLU) else analyse(matrix)
    if analysis is None:
        return SymmetricLU(matrix, like)
    return Multifrontal(matrix, analysis.dissection, analysis.levels)


class Multifrontal:
    """Multifrontal Cholesky factorisation ordered by nested dissection; for definite matrices."""

    name = "multifrontal"
    repeats = True

    def __init__(self, matrix: csc_array, dissection: Dissection, levels: list[AssemblyLevel]) -> None:
        self.dissection, self.levels = dissection, levels
        self.refactor(matrix)

    @property
    def order(self) -> NDArray[np.int64]:
        return self.dissection.order

    def refactor(self, matrix: csc_array) -> None:
        try:
            self._groups = cholesky_groups(self.levels, matrix.data)
            self._pivot_order: PivotOrder | None = None
        except np.linalg.LinAlgError as error:
            raise NotPositiveDefinite("the matrix is not positive definite") from error

    def solve(self, rhs: NDArray) -> NDArray:
        if self._pivot_order is None:
            self._pivot_order = PivotOrder.of(self._groups, len(rhs))
        return cholesky_solve(self._groups, rhs, self._pivot_order)
