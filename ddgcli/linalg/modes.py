"""Eigenpairs of elastic systems: symmetric matrices of any inertia, and unknowns without mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csc_array, csr_array, diags_array

from ddgcli.errors import ParameterError
from ddgcli.linalg.eigen import MAX_DENSE_SIZE
from ddgcli.linalg.eigenspaces import canonical_vectors
from ddgcli.linalg.factor import Factor, negative_eigenvalues
from ddgcli.linalg.lanczos import BlockLanczos
from ddgcli.linalg.low_rank import negative_eigenvalues_of_sum, solver

ROUNDING = 64 * float(np.finfo(float).eps)  # of the norm of M^-1/2 K M^-1/2: smaller eigenvalues are zero
FIRST_SHIFT, SHIFT_GROWTH, MAX_SHIFTS = 1e-9, 30.0, 9  # first shift by that norm, and how it grows
FINAL_SHIFT = 0.1  # of the largest eigenvalue of the first pass


def lowest_eigenpairs(
    stiffness: csc_array, mass: NDArray, k: int, seed: int = 0, columns: NDArray | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The k lowest eigenpairs of (K + U U^T) x = lambda M x, M diagonal.

    Parameters
    ----------
    stiffness : (n, n) csc_array
        Symmetric, of any inertia; positive definite over the unknowns without mass.
    mass : (n,) ndarray
        Zero for unknowns without mass, which follow the others.
    k : int
    seed : int
        Seed of the starting block.
    columns : (n, c) ndarray of float64, optional
        U, zero for unknowns without mass; none by default.

    Returns
    -------
    values : (k,) ndarray
        Ascending; those within rounding are 0.
    vectors : (n, k) ndarray
        M-orthonormal; bases of multiple eigenvalues and signs are those of `canonical_vectors`.

    Raises
    ------
    ParameterError
        k is not between 1 and the number of masses.
    """
    heavy = np.flatnonzero(mass > 0)
    if not 1 <= k <= len(heavy):
        n = len(heavy)
        raise ParameterError(f"{k} eigenpairs of {n} free coordinates; compute 1 to {n}", parameter="k")
    root = np.zeros(len(mass))
    root[heavy] = np.sqrt(mass[heavy])
    scaled = abs(stiffness)[heavy][:, heavy].multiply(1 / root[heavy]).tocsr()
    columns = np.zeros((len(mass), 0)) if columns is None else columns
    norm = float((scaled.sum(axis=1) / root[heavy]).max())
    zero = ROUNDING * (norm + float(np.sum(columns[heavy] ** 2 / mass[heavy, None])))
    if _is_dense(len(heavy), k):
        values, vectors = _dense(stiffness, columns, root, heavy, k)
    else:
        # without the columns, so that the factors are those of a sparse matrix
        shift = _definite_shift(stiffness, mass, FIRST_SHIFT * norm)
        values, vectors = _shifted(stiffness, columns, mass, root, heavy, k, shift, seed)
        if shift and np.abs(values).max() > zero:
            # nearly singular: once more, with a shift in proportion to the eigenvalues; where all are
            # rounding no such shift is left, and the first one has found them
            shift = max(FINAL_SHIFT * float(np.abs(values).max()), -2 * float(values.min()), zero)
            values, vectors = _shifted(stiffness, columns, mass, root, heavy, k, shift, seed)
    values = np.where(np.abs(values) <= zero, 0.0, values)
    return values, canonical_vectors(values, vectors, mass[:, None] * vectors, rounding=zero)


def _is_dense(n: int, k: int) -> bool:
    """Whether k pairs of n are computed as all are: a basis of Lanczos has room for 2 k vectors and more."""
    return n <= MAX_DENSE_SIZE or 3 * k > n


def _dense(
    stiffness: csc_array, columns: NDArray, root: NDArray, heavy: NDArray, k: int
) -> tuple[NDArray, NDArray]:
    light = np.flatnonzero(root == 0)
    follow = np.zeros((len(light), len(heavy)))
    whole = stiffness[heavy][:, heavy].toarray() + columns[heavy] @ columns[heavy].T
    if len(light):
        mixed = stiffness[light][:, heavy].toarray()
        follow = -Factor(csc_array(stiffness[light][:, light])).solve(mixed)
        whole = whole + mixed.T @ follow
    inverse = 1 / root[heavy]
    whole = inverse[:, None] * whole * inverse
    values, small = eigh(0.5 * (whole + whole.T), subset_by_index=[0, k - 1])
    vectors = np.zeros((len(root), k))
    vectors[heavy] = inverse[:, None] * small
    vectors[light] = follow @ vectors[heavy]
    return values, vectors


def _definite_shift(stiffness: csc_array, mass: NDArray, first: float) -> float:
    """0 where the matrix is positive definite by more than rounding, else a shift that makes it so."""
    inertia = diags_array(mass).tocsc()
    if negative_eigenvalues(csc_array(stiffness - first * ROUNDING / FIRST_SHIFT * inertia)) == 0:
        return 0.0
    shift = first
    for _ in range(MAX_SHIFTS):
        if negative_eigenvalues(csc_array(stiffness + shift * inertia)) == 0:
            break
        shift *= SHIFT_GROWTH
    return shift


def _shifted(
    stiffness: csc_array,
    columns: NDArray,
    mass: NDArray,
    root: NDArray,
    heavy: NDArray,
    k: int,
    shift: float,
    seed: int,
) -> tuple[NDArray, NDArray]:
    """Block Lanczos on M^1/2 (K + U U^T + shift M)^-1 M^1/2; eigenvalues by Rayleigh's quotient."""
    inertia = diags_array(mass).tocsc()
    dense = columns if columns.shape[1] else None
    solution = solver(Factor(csc_array(stiffness + shift * inertia)).solve, dense)

    def solve(rows: NDArray) -> NDArray:
        rhs = np.zeros((len(mass), len(rows)))
        rhs[heavy] = (rows * root[heavy]).T
        return solution(rhs)

    def inverse(rows: NDArray) -> NDArray:
        return solve(rows)[heavy].T * root[heavy]

    def none_missing(theta: NDArray) -> bool:
        values = 1 / theta - shift
        below = values[values < values[-1] - 1e-6 * abs(values[-1])]
        middle = 0.5 * (values[-1] + (below[-1] if len(below) else values[-1] - abs(values[-1])))
        count = negative_eigenvalues_of_sum(csc_array(stiffness - middle * inertia), dense)
        return count is None or count <= len(below)

    search = BlockLanczos(inverse, None, np.zeros((0, len(heavy))), seed)
    theta, rows, _ = search.first(k, none_missing)
    vectors = solve(rows) / theta
    vectors /= np.sqrt(np.einsum("nk,n,nk->k", vectors, mass, vectors))
    values = np.einsum("nk,nk->k", vectors, stiffness @ vectors) + np.sum((columns.T @ vectors) ** 2, axis=0)
    order = np.argsort(values)
    return values[order], vectors[:, order]


def largest_ratios(
    numerator: csc_array, stiffness: csc_array, k: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Largest eigenpairs of A x = mu K x with A symmetric and K positive definite.

    Parameters
    ----------
    numerator : (n, n) csc_array
        A.
    stiffness : (n, n) csc_array
        K.
    k : int

    Returns
    -------
    values : (k,) ndarray of float64
        Descending; fewer if n < k.
    vectors : (n, k) ndarray of float64
        Orthonormal in K; bases of multiple eigenvalues and signs are those of `canonical_vectors`.
    """
    n = stiffness.shape[0]
    if _is_dense(n, k):
        values, vectors = eigh(
            numerator.toarray(), stiffness.toarray(), subset_by_index=[max(n - k, 0), n - 1]
        )
        values, vectors = values[::-1], vectors[:, ::-1]
        return values, canonical_vectors(values, vectors, stiffness @ vectors)
    factor = Factor(stiffness)

    def apply(rows: NDArray) -> NDArray:
        return factor.solve(np.asfortranarray(numerator @ rows.T)).T

    search = BlockLanczos(apply, csr_array(stiffness), np.zeros((0, n)), seed=0)
    values, rows, _ = search.first(k, lambda theta: True)
    return values, canonical_vectors(values, rows.T, stiffness @ rows.T)
