"""Eigenpairs of a self-adjoint operator at one end of an order, by block Lanczos with thick restarts."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.progress import ProgressCallback

log = logging.getLogger("ddgcli")


MAX_BLOCK_WIDTH = 32  # vectors a step, of many pairs: fewer passes over the basis
MIN_FREE_VECTORS = 32  # of a basis, beyond the eigenvectors that it keeps
MIN_BASIS_SIZE = 200  # vectors
RESIDUAL_TOLERANCE = 1e-10  # relative, before the last step; eigenvalues are accurate to its square
SAME_VALUES = 1e-8  # of the sum of Ritz values, relative to the last one: a smaller change is rounding
MAX_RESTARTS = 60
MAX_UNCHANGED = 8  # full bases in a row into which no missing eigenvalue comes
COLUMNS_PER_PRODUCT = 2048  # up to three times as fast as products of all columns at once


class BlockLanczos:
    """Block Lanczos, with vectors as rows.

    Every new block is orthogonalised against the whole basis, so that the projected matrix consists of the
    coefficients and no ghost copies appear. A block finds as many copies of a multiple eigenvalue as it has
    vectors; the caller counts whether that is enough.

    K. Wu, H. Simon, "Thick-restart Lanczos method for large symmetric eigenvalue problems", 2000.

    Parameters
    ----------
    apply : callable
        (w, n) rows to their images; self-adjoint in the inner product.
    mass : (n, n) csr_array or None
        The inner product; None is Euclidean.
    excluded : (c, n) ndarray
        Orthonormal vectors; the search is in their complement.
    seed : int
        Seed of the starting block.
    order : callable, optional
        Ritz values to their order; the search is for the first ones. Default: the largest first.
    min_width : int
        Least number of vectors in a block: few for few pairs (fewer applications).
    """

    def __init__(
        self,
        apply: Callable[[NDArray], NDArray],
        mass: csr_array | None,
        excluded: NDArray,
        seed: int,
        order: Callable[[NDArray], NDArray] = lambda theta: np.argsort(-theta, kind="stable"),
        min_width: int = 4,
    ) -> None:
        self.apply, self.mass, self.excluded = apply, mass, excluded
        self.order, self.min_width = order, min_width
        self.rng = np.random.default_rng(seed)
        self.n = excluded.shape[1]

    def first(
        self, k: int, none_missing: Callable[[NDArray], bool], progress: ProgressCallback | None = None
    ) -> tuple[NDArray, NDArray, bool]:
        """The first k eigenvalues (k,), vectors (k, n), and whether none is missing at the end."""
        self.progress, self.n_converged = progress, 0
        self.width = min(max(self.min_width, k // 25), MAX_BLOCK_WIDTH)
        free = max(MIN_FREE_VECTORS, 8 * self.width)
        limit = min(self.n - len(self.excluded), max(2 * k, min(4 * k, MIN_BASIS_SIZE)) + free)
        self.basis = np.empty((limit + self.width, self.n))
        self.projected = np.zeros((limit + self.width, limit + self.width))
        self.n_basis = self.n_restart = 0
        complete = False
        incomplete: NDArray | None = None  # Ritz values below which pairs were missing
        unchanged = 0
        block = self._random_block()
        for restart in range(MAX_RESTARTS):
            theta, S, coupling, block = self._expand(block, k, limit, incomplete)
            error = np.linalg.norm(coupling @ S[-len(coupling) :], axis=0) / np.abs(theta)
            done = bool((error[:k] < RESIDUAL_TOLERANCE).all())
            if done and _differ(theta[:k], incomplete):
                if none_missing(theta[:k]):
                    complete = True
                    break
                if restart == MAX_RESTARTS - 1:
                    break
                log.info(
                    "eigenvalues are missing below the last one: the search continues from random vectors"
                )
                incomplete, unchanged = theta[:k], 0
                self._restart(theta[:k], S[:, :k])
                block = self._random_block()
            else:
                unchanged += done
                if unchanged == MAX_UNCHANGED or restart == MAX_RESTARTS - 1:
                    break
                keep = min(len(theta) - self.width, k + (limit - k) // 3)
                self._restart(theta[:keep], S[:, :keep])
        # the product with the next block is already known: one step of power iteration at no cost
        added = (coupling @ S[-len(coupling) :, :k]) / theta[:k]
        return theta[:k], S[:, :k].T @ self.basis[: len(S)] + added.T @ block, complete

    def _expand(
        self, block: NDArray, k: int, limit: int, incomplete: NDArray | None
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Grow the basis until k pairs have converged, not all of them the incomplete ones, or it is full.

        Returns Ritz values (in order) and vectors, the coupling of the last block to the next, the next.
        """
        check = max(self.n_basis, k)  # the projected problem costs its size cubed: solve it rarely
        while True:
            start, self.n_basis = self.n_basis, self.n_basis + len(block)
            self.basis[start : self.n_basis] = block
            # by the recurrence, an image couples to the last two blocks, the first one to the restart basis
            near = 0 if start <= self.n_restart else start - self.width
            image, coefficients = self._against_basis(self.apply(block), near)
            self.projected[: self.n_basis, start : self.n_basis] = coefficients
            self.projected[start : self.n_basis, : self.n_basis] = coefficients.T
            block, coupling = self._orthonormal(image)
            full = self.n_basis + self.width > limit
            if full or self.n_basis >= check + max(2 * self.width, k // 10):
                check = self.n_basis
                T = self.projected[: self.n_basis, : self.n_basis]
                theta, S = np.linalg.eigh(0.5 * (T + T.T))
                order = self.order(theta)
                theta, S = theta[order], S[:, order]
                error = np.linalg.norm(coupling @ S[-len(coupling) :, :k], axis=0)
                converged = error < RESIDUAL_TOLERANCE * np.abs(theta[:k])
                if self.progress is not None:
                    self.n_converged = max(
                        self.n_converged, int(converged.sum())
                    )  # later copies of an eigenvalue can lower the count
                    self.progress(self.n_converged, k)
                if full or (converged.all() and _differ(theta[:k], incomplete)):
                    return theta, S, coupling, block

    def _restart(self, theta: NDArray, S: NDArray) -> None:
        keep = len(theta)
        self.basis[:keep] = S.T @ self.basis[: len(S)]
        self.projected[:] = 0.0
        self.projected[np.arange(keep), np.arange(keep)] = theta
        self.n_basis = self.n_restart = keep

    def _random_block(self) -> NDArray:
        image = self.apply(self.rng.normal(size=(self.width, self.n)))
        return self._orthonormal(self._against_basis(image)[0])[0]

    def _weighted(self, block: NDArray) -> NDArray:
        return block if self.mass is None else (self.mass @ block.T).T

    def _against_basis(self, block: NDArray, since: int = 0) -> tuple[NDArray, NDArray]:
        """The block without its parts along the basis, and their coefficients (n_basis, w).

        The first pass removes the large parts, along the basis vectors from `since` on; the second pass
        covers the whole basis.
        """
        total = np.zeros((self.n_basis, len(block)))
        for first in (since, 0):
            block = block - (self._weighted(block) @ self.excluded.T) @ self.excluded
            Q = self.basis[first : self.n_basis]
            coefficients = _products(self._weighted(block), Q)
            block -= coefficients @ Q
            total[first:] += coefficients.T
        return block, total

    def _orthonormal(self, block: NDArray) -> tuple[NDArray, NDArray]:
        """Orthonormal rows Q and R with block = R^T Q, from eigenvectors of the Gram matrix, twice."""
        R = np.eye(len(block))
        for _ in range(2):
            gram = self._weighted(block) @ block.T
            scale = np.sqrt(np.diag(gram))
            scale[scale == 0] = 1.0
            w, V = np.linalg.eigh(gram / np.outer(scale, scale))
            w = np.maximum(w, 1e-14 * w[-1])
            block = ((V / np.sqrt(w)).T / scale) @ block
            R = (np.sqrt(w)[:, None] * V.T) @ (scale[:, None] * R)
        return block, R


def _differ(theta: NDArray, incomplete: NDArray | None) -> bool:
    """Whether a missing eigenvalue has come in and moved the last of the incomplete ones out."""
    if incomplete is None:
        return True
    return bool(abs((theta - incomplete).sum()) > SAME_VALUES * np.abs(incomplete[-1]))


def _products(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(w, m) scalar products of the rows of a (w, n) and b (m, n)."""
    total = np.zeros((len(a), len(b)))
    for begin in range(0, a.shape[1], COLUMNS_PER_PRODUCT):
        columns = slice(begin, begin + COLUMNS_PER_PRODUCT)
        total += a[:, columns] @ b[:, columns].T
    return total
