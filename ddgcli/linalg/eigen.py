"""Smallest eigenpairs of L x = lambda M x, by block Lanczos on the inverse of L."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.sparse import csc_array, csr_array, sparray
from scipy.sparse.linalg import splu

from ddgcli.errors import ParameterError
from ddgcli.linalg.constrain import Poisson
from ddgcli.linalg.ordering import fill_reducing_ordering

log = logging.getLogger("ddgcli")

# vectors a step: few for few pairs (fewer solves), more for many (fewer passes over the basis)
BLOCK, WIDEST = 4, 32
# relative residual in the inverted spectrum; eigenvalues are accurate to its square
TOLERANCE = 1e-11
MAX_RESTARTS = 60
# problems up to this size, or asked for more than a third of their spectrum, are solved densely
DENSE = 400


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Eigenpairs in ascending order.

    Parameters
    ----------
    values : (k,) ndarray of float64
        Zero exactly, once for each component without mass term.
    vectors : (n, k) ndarray of float64
        M-orthonormal; the first entry within 1e-6 of the largest magnitude is positive.
    residuals : (k,) ndarray of float64
        Norm of L x - lambda M x relative to that of |L| |x|, the terms that L x is summed from, plus that of
        lambda M x: the relative change of L that would make the pair exact.
    complete : bool
        Whether a count by inertia found no eigenvalue missing below the last one (of which, where it is
        multiple, only the copies that k leaves room for are returned).
    """

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]
    residuals: NDArray[np.float64]
    complete: bool


def smallest_eigenpairs(stiffness: sparray, mass: sparray, k: int, *, seed: int = 0, **options) -> Eigenpairs:
    """The k smallest eigenpairs of a semidefinite stiffness with a positive definite mass.

    Parameters
    ----------
    stiffness : (n, n) sparse array
        Symmetric positive semidefinite; its null space is the constants of the components whose rows sum to
        zero. These pairs are exact; all others are found in their complement, so that no shift is needed.
    mass : (n, n) sparse array
        Symmetric positive definite.
    k : int
    seed : int
        Of the starting block.
    options
        Passed on to `Factor`.

    Raises
    ------
    ParameterError
        When k is not between 1 and n.
    """
    L, M = csr_array(stiffness), csr_array(mass)
    n = L.shape[0]
    if not 1 <= k <= n:
        raise ParameterError(f"{k} eigenpairs asked for, but the matrix has {n} unknowns; ask for 1 to {n}")
    problem = Poisson(L, M @ np.ones(n), **options)
    if n <= DENSE or 3 * k > n:
        return _finished(L, M, *_dense(M, problem, k), complete=True)
    null = _null_vectors(problem)[:, :k]
    if null.shape[1] == k:
        return _finished(L, M, np.zeros(k), null, complete=True)
    values, vectors, complete = _BlockLanczos(L, M, problem, seed).run(k - null.shape[1])
    values = np.concatenate([np.zeros(null.shape[1]), values])
    return _finished(L, M, values, np.column_stack([null, vectors]), complete=complete)


def _dense(M: csr_array, problem: Poisson, k: int) -> tuple[NDArray, NDArray]:
    """All eigenpairs of the inverse, whose largest are the smallest ones to full relative precision."""
    null = _null_vectors(problem)[:, :k]
    c = null.shape[1]
    R = cholesky(M.toarray())
    inverse = R @ problem.apply_inverse(np.asfortranarray(R.T))
    theta, S = eigh(0.5 * (inverse + inverse.T))
    theta, S = theta[::-1][: k - c], S[:, ::-1][:, : k - c]
    return np.concatenate([np.zeros(c), 1.0 / theta]), np.column_stack([null, solve_triangular(R, S)])


def _null_vectors(problem: Poisson) -> NDArray[np.float64]:
    """(n, c) normalised indicator of each component that has the constants as null space."""
    vectors = np.zeros((len(problem.label), problem.count))
    inside = np.flatnonzero(problem.label >= 0)
    label = problem.label[inside]
    size = np.bincount(label, weights=problem.weight[inside], minlength=problem.count)
    vectors[inside, label] = 1.0 / np.sqrt(size[label])
    return vectors


def _finished(L: csr_array, M: csr_array, values: NDArray, X: NDArray, *, complete: bool) -> Eigenpairs:
    """Pairs with definite signs and their residuals."""
    k = len(values)
    largest = np.abs(X).max(axis=0)
    first = np.argmax(np.abs(X) >= (1 - 1e-6) * largest, axis=0)
    X = X * np.where(X[first, np.arange(k)] < 0, -1.0, 1.0)
    LX, MX = L @ X, M @ X
    norm = np.linalg.norm
    scale = norm(abs(L) @ np.abs(X), axis=0) + values * norm(MX, axis=0)
    return Eigenpairs(values, X, norm(LX - MX * values, axis=0) / scale, complete)


class _BlockLanczos:
    """Block Lanczos for the inverse, self-adjoint in the M inner product, with thick restarts.

    Every new block is orthogonalised against the whole basis (twice), so the projected matrix is just the
    coefficients, and no ghost copies appear. A block finds an eigenvalue as often as it is multiple, up to
    the block's width; a count of inertia at the end tells whether that was enough.

    K. Wu, H. Simon, "Thick-restart Lanczos method for large symmetric eigenvalue problems", 2000.
    """

    def __init__(self, L: csr_array, M: csr_array, problem: Poisson, seed: int) -> None:
        self.L, self.M, self.problem = L, M, problem
        self.rng = np.random.default_rng(seed)
        self.n = L.shape[0]
        self.space = self.n - problem.count

    def run(self, k: int) -> tuple[NDArray, NDArray, bool]:
        """Eigenvalues (k,), vectors (n, k), and whether none was missed."""
        self.width = min(max(BLOCK, k // 25), WIDEST)
        limit = min(self.space, max(2 * k, k + 32 * self.width) + self.width)
        self.basis = np.empty((self.n, limit + self.width), order="F")
        self.projected = np.zeros((limit + self.width, limit + self.width))
        self.used = self.kept = 0
        complete = False
        block = self._orthonormal(self._random_block())
        for _ in range(MAX_RESTARTS):
            theta, S, coupling, block = self._expand(block, k, limit)
            error = np.linalg.norm(coupling @ S[-coupling.shape[1] :], axis=0) / np.abs(theta)
            done = bool((error[:k] < TOLERANCE).all())
            if done and self._none_missing(1.0 / theta[:k]):
                complete = True
                break
            keep = k if done else min(len(theta) - self.width, k + (limit - k) // 3)
            self._restart(theta[:keep], S[:, :keep])
            if done:
                log.info("eigenvalues are missing below the last one: the search goes on from random vectors")
                block = self._orthonormal(self._against_basis(self._random_block())[0])
        if not complete:
            log.warning("the eigenvalues below the last one could not all be found; take fewer or check them")
        vectors = self.basis[:, : len(S)] @ S[:, :k]
        return 1.0 / theta[:k], vectors, complete

    def _expand(self, block: NDArray, k: int, limit: int) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Grow the basis until k pairs have converged or it is full.

        Returns Ritz values (descending) and vectors, the coupling of the last block to the next, the next.
        """
        check = max(self.used, k)  # the projected problem costs its size cubed: look at it now and then
        while True:
            start, self.used = self.used, self.used + block.shape[1]
            self.basis[:, start : self.used] = block
            image = self.problem.apply_inverse(self.M @ block)
            # by the recurrence, an image couples to the last two blocks; the first one, to all that was kept
            near = 0 if start <= self.kept else start - self.width
            image, coefficients = self._against_basis(image, near)
            self.projected[: self.used, start : self.used] = coefficients
            self.projected[start : self.used, : self.used] = coefficients.T
            block, coupling = self._orthonormal_with_factor(image)
            full = self.used + self.width > limit
            if full or self.used > check + max(3 * self.width, k // 10):
                check = self.used
                T = self.projected[: self.used, : self.used]
                theta, S = np.linalg.eigh(0.5 * (T + T.T))
                theta, S = theta[::-1], S[:, ::-1]
                error = np.linalg.norm(coupling @ S[-coupling.shape[1] :, :k], axis=0)
                if full or (error < TOLERANCE * np.abs(theta[:k])).all():
                    return theta, S, coupling, block

    def _restart(self, theta: NDArray, S: NDArray) -> None:
        keep = len(theta)
        self.basis[:, :keep] = self.basis[:, : len(S)] @ S
        self.projected[:] = 0.0
        self.projected[np.arange(keep), np.arange(keep)] = theta
        self.used = self.kept = keep

    def _random_block(self) -> NDArray:
        block = self.rng.normal(size=(self.n, self.width))
        return self.problem.apply_inverse(self.M @ block)

    def _against_basis(self, block: NDArray, since: int = 0) -> tuple[NDArray, NDArray]:
        """The block without its parts along the basis, and their coefficients.

        The first pass takes off what is large, the parts along the basis vectors from `since` on; the second
        goes over the whole basis.
        """
        total = np.zeros((self.used, block.shape[1]))
        for first in (since, 0):
            Q = self.basis[:, first : self.used]
            coefficients = Q.T @ (self.M @ block)
            block = block - Q @ coefficients
            total[first:] += coefficients
        return block, total

    def _orthonormal(self, block: NDArray) -> NDArray:
        return self._orthonormal_with_factor(block)[0]

    def _orthonormal_with_factor(self, block: NDArray) -> tuple[NDArray, NDArray]:
        """M-orthonormal Q and R with block = Q R, from eigenvectors of the Gram matrix, twice."""
        R = np.eye(block.shape[1])
        for _ in range(2):
            scale = np.sqrt(np.einsum("ij,ij->j", block, self.M @ block))
            scale[scale == 0] = 1.0
            block = block / scale
            gram = block.T @ (self.M @ block)
            w, V = np.linalg.eigh(gram)
            w = np.maximum(w, 1e-14 * w[-1])
            block = block @ (V / np.sqrt(w))
            R = (np.sqrt(w)[:, None] * V.T) @ (scale[:, None] * R)
        return block, R

    def _none_missing(self, values: NDArray) -> bool:
        """Whether inertia counts no more eigenvalues than ours below the cluster that holds the last one."""
        last = values[-1]
        smaller = values[values < last * (1 - 1e-6)]
        shift = 0.5 * (last + (smaller[-1] if len(smaller) else 0.0))
        return count_below(self.L, self.M, shift) <= len(smaller) + self.problem.count


def count_below(L: sparray, M: sparray, shift: float) -> int:
    """Number of eigenvalues of L x = lambda M x below `shift`, by Sylvester's law of inertia."""
    shifted = csc_array(L - shift * M)
    order = fill_reducing_ordering(shifted).order
    permuted = shifted[order][:, order].tocsc()
    lu = splu(permuted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return int((lu.U.diagonal() < 0).sum())
