"""Solves with fixed unknowns, and with the constants of every component as null space."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, sparray
from scipy.sparse.csgraph import connected_components

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.indices import compact

log = logging.getLogger("ddgcli")

BALANCE_TOLERANCE = 1e-10  # relative sum of a right-hand side over a component


def components(matrix: sparray) -> tuple[int, NDArray[np.int64]]:
    """Connected components of the pattern of non-zero entries.

    Parameters
    ----------
    matrix : (n, n) sparse array

    Returns
    -------
    count : int
    label : (n,) ndarray of int64
        Component of each unknown.
    """
    graph = compact(csc_array(matrix)).T  # the same graph by rows, which csgraph takes without a copy
    if (graph.data == 0).any():
        graph = graph.copy()
        graph.eliminate_zeros()
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int64)


def floating_components(matrix: sparray) -> NDArray[np.int64]:
    """Components of unknowns that have the constants as null space.

    A component floats when every one of its rows sums to zero, relative to the row's absolute sum.

    Parameters
    ----------
    matrix : (n, n) sparse array

    Returns
    -------
    (n,) ndarray of int64
        Index of the floating component of each unknown; -1 elsewhere.
    """
    count, label = components(matrix)
    ones = np.ones(matrix.shape[0])
    row_sum, row_size = np.abs(matrix @ ones), np.abs(matrix) @ ones
    fixed = np.zeros(count, dtype=bool)
    fixed[label[row_sum > 1e-9 * row_size]] = True
    number = np.cumsum(~fixed) - 1
    return np.where(fixed[label], -1, number[label])


class Dirichlet:
    """Factorisation of a symmetric matrix with some fixed unknowns.

    Parameters
    ----------
    matrix : (n, n) sparse array
    fixed : (k,) ndarray of int, or (n,) ndarray of bool
        Fixed unknowns. A component without one must be non-singular.
    like : Factor, optional
        Factor of a matrix of the same pattern, with the fixed unknowns, whose analysis is reused: these then
        remain in the system, decoupled, instead of being removed.
    options
        Passed on to `Factor`.
    """

    def __init__(
        self, matrix: sparray, fixed: NDArray, *, like: Factor | None = None, **options: Any
    ) -> None:
        columns = csc_array(matrix)
        is_fixed = np.zeros(columns.shape[0], dtype=bool)
        is_fixed[np.asarray(fixed)] = True
        self.fixed, self.free = np.flatnonzero(is_fixed), np.flatnonzero(~is_fixed)
        self._whole_pattern = (
            like is not None and like.same_pattern(columns) and _all_stored(columns, is_fixed)
        )
        self.factor = Factor(self._split(columns), like=like, **options)

    def _split(self, columns: csc_array) -> csc_array:
        self._coupling = columns[:, self.fixed]
        return (
            _decoupled(columns, self.fixed)
            if self._whole_pattern
            else csc_array(columns[self.free][:, self.free])
        )

    def refactor(self, matrix: sparray) -> Dirichlet:
        """New values of the same pattern."""
        self.factor.refactor(self._split(csc_array(matrix)))
        return self

    def solve(self, values: NDArray, rhs: NDArray | None = None, *, refine: bool = True) -> NDArray:
        """(n,) or (n, c) solution that takes `values` on the fixed unknowns, in the order of `self.fixed`.

        Parameters
        ----------
        values : (k,) or (k, c) ndarray, or a number
        rhs : (n,) or (n, c) ndarray, optional
            Right-hand side; rows of fixed unknowns are not read. Default zero.
        """
        like = values if np.ndim(values) or rhs is None else rhs
        shape = (len(self.fixed), *np.shape(like)[1:])
        kind = np.result_type(self.factor.matrix.dtype, np.asarray(values).dtype)
        values = np.broadcast_to(np.asarray(values, dtype=kind), shape)
        x = self.solve_held_at_zero(self._load(values, rhs), refine=refine)
        x[self.fixed] = values
        return x

    def solve_held_at_zero(self, rhs: NDArray, *, refine: bool = True) -> NDArray:
        """(n,) or (n, c) solution that vanishes on the fixed unknowns, whose rows of `rhs` are not read."""
        if self._whole_pattern:
            b = np.array(rhs)
            b[self.fixed] = 0.0
            return self.factor.solve(b, refine=refine)
        # by rows of the transpose, which lie together in memory
        free = self.factor.solve(np.take(rhs.T, self.free, axis=-1).T, refine=refine)
        x = np.zeros(rhs.shape[::-1], dtype=free.dtype)
        x[..., self.free] = free.T
        return x.T

    def residual(self, x: NDArray, rhs: NDArray | None = None) -> float:
        """Largest |A x - b| on the free rows, relative to the largest term of the right-hand side."""
        load = self._load(x[self.fixed], rhs)
        solution = x.copy()
        if self._whole_pattern:
            solution[self.fixed] = load[self.fixed] = 0.0
            return self.factor.residual(solution, load)
        return self.factor.residual(solution[self.free], load[self.free])

    def _load(self, values: NDArray, rhs: NDArray | None) -> NDArray:
        """Right-hand side less what the fixed values cause."""
        load = -(self._coupling @ values)
        return load if rhs is None else load + np.asarray(rhs)


def _all_stored(columns: csc_array, is_fixed: NDArray) -> bool:
    """Whether the diagonal entries of the fixed unknowns are part of the pattern."""
    column = np.repeat(np.arange(len(is_fixed)), np.diff(columns.indptr))
    return np.count_nonzero(is_fixed[column] & (columns.indices == column)) == np.count_nonzero(is_fixed)


def _decoupled(matrix: csc_array, fixed: NDArray) -> csc_array:
    """The same pattern, with nothing but the largest entry on the diagonal in fixed rows and columns."""
    is_fixed = np.zeros(matrix.shape[0], dtype=bool)
    is_fixed[fixed] = True
    column = np.repeat(np.arange(matrix.shape[0], dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    in_fixed = is_fixed[matrix.indices] | is_fixed[column]
    data = np.where(in_fixed, 0.0, matrix.data)
    data[in_fixed & (matrix.indices == column)] = np.abs(matrix.data).max(initial=0.0) or 1.0
    return csc_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


class Poisson:
    """Factorisation of a semidefinite matrix whose null space is the constants of each component.

    One unknown of every such component is pinned, so nothing is added to the matrix; solutions have mean zero
    on each of them. Components without null space (some row does not sum to zero) are solved as they are.

    Parameters
    ----------
    stiffness : (n, n) sparse array
        Positive semidefinite, rows summing to zero.
    mass : (n, n) sparse array or (n,) ndarray, optional
        Weights of the mean; default one each.
    options
        Passed on to `Dirichlet`.

    Attributes
    ----------
    imbalance : float
        Imbalance of the last `solve`: the largest |sum of the right-hand side| over a component, relative to
        the sum of the absolute values of its terms. If it is not zero, the problem has no solution, and the
        right-hand side was replaced by its balanced part.
    """

    def __init__(self, stiffness: sparray, mass: sparray | NDArray | None = None, **options: Any) -> None:
        n = stiffness.shape[0]
        self.matrix = csc_array(stiffness)
        self.weight = _weights(mass, n)
        # of means: weights of about 1, whose products with huge and tiny values stay numbers
        self._unit_weight = self.weight / 2.0 ** np.frexp(np.abs(self.weight).max(initial=0.0))[1]
        self.label = floating_components(self.matrix)
        self.count = int(self.label.max(initial=-1)) + 1
        self._floating = np.flatnonzero(self.label >= 0)
        place = (self.label[self._floating], self._floating)
        self._indicator = csr_array((np.ones(len(self._floating)), place), shape=(self.count, n))
        _, first = np.unique(place[0], return_index=True)
        self.pinned = self._floating[first]
        self._dirichlet = Dirichlet(self.matrix, self.pinned, **options)
        self.factor = self._dirichlet.factor
        self.imbalance = 0.0

    def refactor(self, stiffness: sparray) -> Poisson:
        """New values of the same pattern and the same components."""
        self.matrix = csc_array(stiffness)
        self._dirichlet.refactor(stiffness)
        return self

    def _sums(self, values: NDArray) -> NDArray:
        """(count, ...) sum over each floating component."""
        return self._indicator @ values

    def balanced(self, rhs: NDArray, size: NDArray | None = None) -> NDArray:
        """The right-hand side without its mean on each component (a multiple of the mass is subtracted).

        `size`: sums of the absolute values of the terms of each entry, by default |rhs|.
        """
        rhs = np.array(rhs, dtype=np.float64)
        if not np.isfinite(rhs).all():
            raise SolveError("the right-hand side holds values that are not finite")
        total, whole = self._sums(rhs), self._sums(np.abs(rhs) if size is None else size)
        self.imbalance = float((np.abs(total) / np.where(whole > 0, whole, 1.0)).max(initial=0.0))
        rhs -= self._spread(total)
        isolated = self.pinned[self._sums(self.weight) == 0]
        rhs[isolated] = 0.0
        return rhs

    def solve(self, rhs: NDArray, *, refine: bool = True, size: NDArray | None = None) -> NDArray[np.float64]:
        """Solution of mean zero per component, for integrated (n,) or (n, c) right-hand sides.

        With a sum other than zero over a component there is no solution: the mean is subtracted first, and a
        warning reports its size. Where terms of the right-hand side cancel, `size` holds the sums of their
        absolute values: the sum over a component has rounding errors of their size.
        """
        b = self.balanced(rhs, size)
        if self.imbalance > BALANCE_TOLERANCE:
            log.warning(
                "the right-hand side does not sum to zero on every component (%.2g of its size): "
                "its mean was subtracted, because the Laplacian has no solution otherwise",
                self.imbalance,
            )
        x = self._dirichlet.solve(np.zeros((len(self.pinned), *b.shape[1:])), b, refine=refine)
        return self.centred(x)

    def apply_inverse(self, rhs: NDArray) -> NDArray[np.float64]:
        """`solve` for inner iterations: balanced without a warning, not refined."""
        return self.centred(self.pinned_solve(rhs - self._spread(self._sums(rhs))))

    def pinned_solve(self, rhs: NDArray) -> NDArray[np.float64]:
        """`apply_inverse` for a balanced (n,) or (n, c) right-hand side, but zero at the pinned unknowns."""
        return self._dirichlet.solve_held_at_zero(rhs, refine=False)

    @property
    def order(self) -> NDArray[np.int64] | None:
        """Elimination order of all unknowns, the pinned ones last; None where pivoting decides."""
        inner = self.factor.order
        if inner is None or len(inner) == len(self.weight):
            return inner
        return np.append(self._dirichlet.free[inner], self.pinned)

    def _spread(self, total: NDArray) -> NDArray:
        """(n, ...) multiple of the mass, with the (count, ...) sum `total` over each floating component."""
        weight = self._sums(self.weight)
        share = total.T / np.where(weight > 0, weight, 1.0)
        return (self.weight * (share @ self._indicator)).T

    def centred(self, x: NDArray) -> NDArray[np.float64]:
        """The values without their weighted mean on each floating component."""
        weight = self._sums(self._unit_weight)
        total = self._sums((self._unit_weight * x.T).T)
        mean = (total.T / np.where(weight > 0, weight, 1.0)).T
        if self.count == 1 and len(self._floating) == len(x):
            return x - mean[0]
        x = np.array(x, dtype=np.float64)
        x[self._floating] -= mean[self.label[self._floating]]
        return x

    def residual(self, x: NDArray, rhs: NDArray) -> float:
        """Largest |L x - b|, for the balanced right-hand side b, relative to the largest |rhs|.

        The scale is that before balancing: of a constant, balancing leaves nothing but rounding.
        """
        b = self.balanced(rhs)
        return float(np.abs(self.matrix @ x - b).max(initial=0.0) / (np.abs(rhs).max(initial=0.0) or 1.0))


def _weights(mass: sparray | NDArray | None, n: int) -> NDArray[np.float64]:
    if mass is None:
        return np.ones(n)
    if isinstance(mass, np.ndarray) and mass.ndim == 1:
        return mass.astype(np.float64)
    return np.asarray(mass @ np.ones(n), dtype=np.float64)
