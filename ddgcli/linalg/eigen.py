"""Smallest eigenpairs of L x = lambda M x, by block Lanczos on the inverse of L."""

from __future__ import annotations

import functools
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.sparse import csc_array, csr_array, sparray, triu
from scipy.sparse.linalg import splu

from ddgcli.errors import ParameterError
from ddgcli.linalg.backends import direct_fits, shift_is_cheap
from ddgcli.linalg.constrain import Poisson, components, floating_components
from ddgcli.linalg.eigenspaces import canonical_vectors
from ddgcli.linalg.indices import compact
from ddgcli.linalg.lanczos import BlockLanczos
from ddgcli.linalg.ordering import fill_reducing_ordering
from ddgcli.linalg.shift_invert import ShiftInvert
from ddgcli.memory import check_memory
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")

MAX_DENSE_SIZE = 400  # unknowns; larger problems are dense only for more than a third of the spectrum
VECTORS_PER_PAIR = 4  # vectors in memory per eigenpair
SHIFTED_WIDTH = 8  # vectors per block: the multifrontal solver takes as long for eight as for four
MIN_MULTIFRONTAL_COUNT = 50_000  # stored entries above which a multifrontal factor counts inertia faster
SMALL = 1e-2  # eigenvalue over the shift below which it loses at least two digits
MAX_SCALE_RATIO = 1e6  # ratio of mean eigenvalues of components that are solved together
EQUAL = 1e-6  # relative difference of copies of a multiple eigenvalue, far above the tolerance of Lanczos
ROUNDING = 1e-9  # rounding of a zero eigenvalue over the shift
ITERATIVE_RESIDUAL = 1e-13  # residual of conjugate gradients, a thousandth of the tolerance of Lanczos


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Eigenpairs in ascending order.

    Parameters
    ----------
    values : (k,) ndarray of float64
        Zero exactly, once for each component without mass term.
    vectors : (n, k) ndarray of float64
        M-orthonormal; bases of multiple eigenvalues and signs are those of `canonical_vectors`.
    residuals : (k,) ndarray of float64
        Norm of L x - lambda M x relative to that of |L| |x|, the terms that L x is summed from, plus that of
        lambda M x: the relative change of L that would make the pair exact.
    complete : bool
        Whether no eigenvalue is missing below the last one. Lanczos finds all copies of a multiple eigenvalue
        if there are fewer than the vectors of a block (4 for few pairs); otherwise they are counted by
        inertia. A multiple last eigenvalue is returned with only as many copies as k allows. True, with a
        warning, if the count does not fit into memory.
    solver : str
        Name of the linear solver; 'dense' for few unknowns, 'none' where all eigenvalues are zero.
    """

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]
    residuals: NDArray[np.float64]
    complete: bool
    solver: str = "none"

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class NullSpace:
    """Null space of a stiffness, and multiples of the mass that make the stiffness definite.

    Parameters
    ----------
    vectors : (n, c) ndarray of float64
        M-orthonormal, each on one component. A basis, or as many vectors of one as pairs are computed.
    shift : (n,) ndarray of float64
        Of the size of the smallest eigenvalues of the component of each unknown, and constant there.
    """

    vectors: NDArray[np.float64]
    shift: NDArray[np.float64]

    __repr__ = short_repr

    def of_unknowns(self, rows: NDArray) -> NullSpace:
        """Null space of the components with these unknowns.

        Parameters
        ----------
        rows : (m,) ndarray of int64

        Returns
        -------
        NullSpace
        """
        vectors = self.vectors[rows]
        return NullSpace(vectors[:, vectors.any(axis=0)], self.shift[rows])


def smallest_eigenpairs(
    stiffness: sparray,
    mass: sparray,
    k: int,
    *,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    null_space: NullSpace | None = None,
    **options: Any,
) -> Eigenpairs:
    """The k smallest eigenpairs of a semidefinite stiffness with a positive definite mass.

    Parameters
    ----------
    stiffness : (n, n) sparse array
        Symmetric positive semidefinite. The pairs of its null space are exact; the others are computed in
        their complement.
    mass : (n, n) sparse array
        Symmetric positive definite.
    k : int
    seed : int
        Seed of the starting block.
    progress : callable, optional
        Called with (converged pairs, k).
    null_space : NullSpace, optional
        Default the constants of the components whose rows sum to zero, which need no shift.
    options
        Passed on to `Factor`.

    Returns
    -------
    Eigenpairs
        Ascending; vectors (n, k) orthonormal in the mass.

    Raises
    ------
    ParameterError
        k is not between 1 and n.
    """
    L, M = csr_array(stiffness), csr_array(mass)
    n = L.shape[0]
    check_memory(8.0 * n * VECTORS_PER_PAIR * k, f"{k} eigenvectors of {n} unknowns", "compute fewer")
    if not 1 <= k <= n:
        raise ParameterError(f"{k} eigenpairs of a matrix with {n} unknowns; compute 1 to {n}", parameter="k")
    groups = _groups_of_scale(L, M)
    if len(groups) > 1:
        solved = [
            smallest_eigenpairs(
                L[rows][:, rows],
                M[rows][:, rows],
                min(k, len(rows)),
                seed=seed,
                progress=progress,
                null_space=null_space and null_space.of_unknowns(rows),
                **options,
            )
            for rows in groups
        ]
        return _merged(solved, groups, k)
    # masses near 1, by a power of 4 without rounding: squares of huge and tiny masses over- or underflow
    unit = 4.0 ** round(0.5 * math.log2(float(np.abs(M.data).max(initial=0.0)) or 1.0))
    scaled = null_space and NullSpace(null_space.vectors * math.sqrt(unit), null_space.shift * unit)
    pairs = _scaled_eigenpairs(L, M / unit, k, seed, progress, scaled, options)
    return replace(pairs, values=pairs.values / unit, vectors=pairs.vectors / math.sqrt(unit))


def _groups_of_scale(L: csr_array, M: csr_array) -> list[NDArray[np.int64]]:
    """Unknowns of the components that can be solved together, as their eigenvalues have similar sizes.

    The errors of a solve are relative to its smallest eigenvalue, so that those of much larger ones
    would have no digits.
    """
    count, label = components(L)
    if count == 1 or M.nnz != M.shape[0]:
        count, label = components(abs(L) + abs(M))
    if count == 1:
        return [np.arange(L.shape[0])]
    with np.errstate(divide="ignore", over="ignore"):
        mean = np.log10(np.bincount(label, L.diagonal()) / np.bincount(label, M.diagonal()))
    order = np.argsort(mean, kind="stable")
    group, first = np.zeros(count, dtype=np.int64), order[0]
    for last, component in zip(order, order[1:]):
        if mean[component] - mean[first] > np.log10(MAX_SCALE_RATIO):
            first = component
        group[component] = group[last] + (first == component)
    return [np.flatnonzero(group[label] == g) for g in range(int(group.max()) + 1)]


def _merged(solved: list[Eigenpairs], groups: list[NDArray[np.int64]], k: int) -> Eigenpairs:
    """The k smallest of the pairs of several groups of unknowns."""
    n = sum(len(rows) for rows in groups)
    group = np.repeat(np.arange(len(groups)), [len(pairs.values) for pairs in solved])
    column = np.concatenate([np.arange(len(pairs.values)) for pairs in solved])
    values = np.concatenate([pairs.values for pairs in solved])
    first = np.argsort(values, kind="stable")[:k]
    vectors = np.zeros((n, k))
    for g, (pairs, rows) in enumerate(zip(solved, groups)):
        at = np.flatnonzero(group[first] == g)
        vectors[rows[:, None], at] = pairs.vectors[:, column[first[at]]]
    residuals = np.concatenate([pairs.residuals for pairs in solved])[first]
    solver = next(
        (pairs.solver for pairs in solved if pairs.solver not in ("none", "dense")), solved[0].solver
    )
    return Eigenpairs(values[first], vectors, residuals, all(pairs.complete for pairs in solved), solver)


def _scaled_eigenpairs(
    L: csr_array,
    M: csr_array,
    k: int,
    seed: int,
    progress: ProgressCallback | None,
    null_space: NullSpace | None,
    options: dict[str, Any],
) -> Eigenpairs:
    """`smallest_eigenpairs` for masses near 1."""
    n, label, weight = L.shape[0], floating_components(L), M @ np.ones(L.shape[0])
    definite, shift = L, 0.0
    if null_space is None:
        null = _null_vectors(label, weight, k)
    else:
        # the least of the components, beside which no eigenvalue loses digits
        null, shift = null_space.vectors[:, :k], float(null_space.shift.min())
        definite = csr_array(L + shift * M)
    n_null = null.shape[1]
    if n_null == k:
        return _with_residuals(L, M, np.zeros(k), null, n_null, complete=True)
    if n <= MAX_DENSE_SIZE or 3 * k > n:
        values, vectors = _dense(M, Poisson(definite, weight, **options), shift, null, k)
        pairs = _with_residuals(L, M, values, vectors, n_null, complete=True)
        return replace(pairs, solver="dense")
    inverse = _shifted(L, M, k, **options) or _pinned(L, definite, M, weight, shift, options)
    values, vectors, complete = _lanczos(M, inverse, null, k - n_null, seed, progress)
    values = _with_small_values(L, M, label, values, vectors, SMALL * inverse.shift)
    values = np.concatenate([np.zeros(n_null), values])
    pairs = _with_residuals(L, M, values, np.column_stack([null, vectors]), n_null, complete=complete)
    return replace(pairs, solver=inverse.solver)


def _dense(M: csr_array, problem: Poisson, shift: float, null: NDArray, k: int) -> tuple[NDArray, NDArray]:
    """All eigenpairs of the inverse of L + shift M, whose largest are the smallest to full precision."""
    c = null.shape[1]
    R = cholesky(M.toarray())
    inverse = R @ problem.apply_inverse(np.asfortranarray(R.T))
    excluded = R @ null
    for _ in range(2):  # the inverse is symmetric
        inverse = inverse.T - excluded @ (excluded.T @ inverse.T)
    theta, S = eigh(0.5 * (inverse + inverse.T))
    theta, S = theta[::-1][: k - c], S[:, ::-1][:, : k - c]
    return np.concatenate([np.zeros(c), 1.0 / theta - shift]), np.column_stack([null, solve_triangular(R, S)])


def _null_vectors(label: NDArray, weight: NDArray, k: int) -> NDArray[np.float64]:
    """(n, min(c, k)) normalised indicators of components that have the constants as null space."""
    count = int(label.max(initial=-1)) + 1
    vectors = np.zeros((len(label), min(count, k)))
    inside = np.flatnonzero((label >= 0) & (label < k))
    size = np.bincount(label[inside], weights=weight[inside], minlength=count)
    vectors[inside, label[inside]] = 1.0 / np.sqrt(size[label[inside]])
    return vectors


def _with_residuals(
    L: csr_array, M: csr_array, values: NDArray, X: NDArray, n_null: int, *, complete: bool
) -> Eigenpairs:
    """Eigenpairs with unique bases and signs, and their residuals."""
    X = canonical_vectors(values, X, M @ X, n_single=n_null)
    LX, MX = L @ X, M @ X
    norm = np.linalg.norm
    scale = norm(abs(L) @ np.abs(X), axis=0) + values * norm(MX, axis=0)
    return Eigenpairs(values, X, norm(LX - MX * values, axis=0) / scale, complete)


def _with_small_values(
    L: csr_array, M: csr_array, label: NDArray, values: NDArray, X: NDArray, bound: float
) -> NDArray[np.float64]:
    """Values; those below a bound are Rayleigh quotients of squared differences, which keep their digits."""
    small = np.flatnonzero(values < bound)
    if not len(small):
        return values
    X = X[:, small]
    edges = triu(L, 1).tocoo()
    row_sum = np.where(label < 0, L @ np.ones(len(X)), 0.0)
    energy = row_sum @ X**2 - edges.data @ (X[edges.row] - X[edges.col]) ** 2
    values = values.copy()
    values[small] = energy / (X * (M @ X)).sum(axis=0)
    return values


@dataclass(frozen=True, eq=False)
class _Inverse:
    """Inverse of L - shift M, and the number of eigenvalues below a value (None: not counted)."""

    solve: Callable[[NDArray], NDArray]
    count_below: Callable[[float], int | None]
    solver: str
    shift: float = 0.0
    width: int = 4  # vectors of a block


def _shifted(L: csr_array, M: csr_array, k: int, solver: str | None = None) -> _Inverse | None:
    """Inverse with a shift among the k eigenvalues; None for other solvers, or without a good shift."""
    if not shift_is_cheap(solver, csc_array(L), k):
        return None
    shifted = ShiftInvert(L, M)
    if not shifted.factorise_near(k):
        return None

    def count(value: float) -> int:
        below = shifted.count_below(value)
        return count_below(L, M, value) if below is None else below

    return _Inverse(shifted.solve, count, "multifrontal", shifted.shift, SHIFTED_WIDTH)


def _pinned(
    L: csr_array, definite: csr_array, M: csr_array, weight: NDArray, shift: float, options: dict[str, Any]
) -> _Inverse:
    """Inverse of `definite`, L + shift M, in the complement of constants, with the solver of `Factor`."""
    problem = Poisson(definite, weight, **options)
    if problem.factor.iterative:
        problem.factor.iterative.sufficient_residual = ITERATIVE_RESIDUAL

    @functools.cache
    def counter() -> ShiftInvert:  # its analysis serves all counts
        return ShiftInvert(L, M)

    def count(value: float) -> int | None:
        order = problem.order
        if order is None and not direct_fits(csc_array(L)):
            return None
        if L.nnz >= MIN_MULTIFRONTAL_COUNT:
            below = counter().count_below(value)
            if below is not None:
                return below
        return count_below(L, M, value, order)

    return _Inverse(problem.pinned_solve, count, problem.factor.solver, -shift)


def _lanczos(
    M: csr_array,
    inverse: _Inverse,
    null: NDArray,
    k: int,
    seed: int,
    progress: ProgressCallback | None,
) -> tuple[NDArray, NDArray, bool]:
    """The k smallest eigenpairs orthogonal to the null space `null`, and whether none is missing.

    A diagonal mass is applied on both sides, M^(1/2) (L - shift M)^-1 M^(1/2), so that the inner product is
    Euclidean.
    """
    diagonal = M.diagonal() if M.nnz == M.shape[0] else np.zeros(1)
    root = np.sqrt(diagonal) if (diagonal > 0).all() else None
    shift = inverse.shift

    def apply(block: NDArray) -> NDArray:
        if root is None:
            return inverse.solve(M @ block.T).T
        return inverse.solve((block * root).T).T * root

    excluded = null.T if root is None else null.T * root
    inner = M if root is None else None
    search = BlockLanczos(apply, inner, excluded, seed, lambda theta: _ascending(theta, shift), inverse.width)
    theta, vectors, complete = search.first(
        k, lambda theta: _none_missing(theta, inverse, null.shape[1], search.width), progress
    )
    if not complete:
        log.warning("eigenvalues below the last one are missing; compute fewer, or check the list")
    return shift + 1.0 / theta, (vectors if root is None else vectors / root).T, complete


def _ascending(theta: NDArray, shift: float) -> NDArray[np.int64]:
    """Order of Ritz values 1 / (lambda - shift) by lambda; of negative lambda (not converged) last."""
    value = shift + 1.0 / np.where(theta == 0, np.finfo(float).tiny, theta)
    return np.lexsort((value, value < -ROUNDING * abs(shift)))


def _none_missing(theta: NDArray, inverse: _Inverse, n_null: int, width: int) -> bool:
    """Whether no eigenvalue is missing below the cluster of the last one of converged 1 / (lambda - shift).

    A block of random vectors has as many independent components in an eigenspace as it has vectors, so that
    only more equal eigenvalues than those can lack copies; others that converge are eigenvectors, which no
    smaller part of the space of a cluster contains. Where as many are equal, inertia counts.
    """
    if _most_equal(theta) < width:
        return True
    values = inverse.shift + 1.0 / theta
    last = values[-1]
    smaller = values[values < last * (1 - 1e-6)]
    count = inverse.count_below(0.5 * (last + (smaller[-1] if len(smaller) else 0.0)))
    if count is None:
        log.warning(
            "whether an eigenvalue is missing was not counted: the factors do not fit into memory; "
            "use a coarser mesh to check"
        )
        return True
    return count <= len(smaller) + n_null


def _most_equal(theta: NDArray) -> int:
    """Largest number of values that each differ from the next by rounding."""
    theta = np.sort(theta)
    apart = np.flatnonzero(np.diff(theta) > EQUAL * np.abs(theta[1:]))
    return int(np.diff(np.concatenate([[-1], apart, [len(theta) - 1]])).max())


def count_below(L: sparray, M: sparray, shift: float, order: NDArray | None = None) -> int:
    """Number of eigenvalues of L x = lambda M x below `shift`, by Sylvester's law of inertia.

    `order` is an elimination order for the pattern of L, valid if M is diagonal.
    """
    shifted = csc_array(L - shift * M)
    final = order is not None
    if order is None:
        ordering = fill_reducing_ordering(shifted)
        order, final = ordering.order, ordering.final
    lu = splu(
        compact(shifted[order][:, order].tocsc()),
        permc_spec="NATURAL" if final else "MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return int((lu.U.diagonal() < 0).sum())
