"""Largest eigenpairs of a self-adjoint operator, by block Lanczos with thick restarts."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.progress import ProgressCallback

log = logging.getLogger("ddgcli")


# vectors a step: few for few pairs (fewer applications), more for many (fewer passes over the basis)
NARROWEST, WIDEST = 4, 32
# basis vectors that are held for the asking
FEW = 200
# relative residual before the last step; eigenvalues are accurate to its square
TOLERANCE = 1e-10
MAX_RESTARTS = 60


class BlockLanczos:
    """Block Lanczos, with vectors as rows.

    Every new block is orthogonalised against the whole basis, so the projected matrix is just the
    coefficients, and no ghost copies appear. A block finds an eigenvalue as often as it is multiple, up to
    the block's width; the caller's count at the end tells whether that was enough.

    K. Wu, H. Simon, "Thick-restart Lanczos method for large symmetric eigenvalue problems", 2000.

    Parameters
    ----------
    apply : callable
        (w, n) rows to their images; self-adjoint and positive semidefinite in the inner product.
    mass : (n, n) csr_array or None
        The inner product; None is the common one.
    known : (c, n) ndarray
        Orthonormal vectors that are left out.
    seed : int
        Of the starting block.
    """

    def __init__(
        self,
        apply: Callable[[NDArray], NDArray],
        mass: csr_array | None,
        known: NDArray,
        seed: int,
    ) -> None:
        self.apply, self.mass, self.known = apply, mass, known
        self.rng = np.random.default_rng(seed)
        self.n = known.shape[1]

    def largest(
        self, k: int, none_missing: Callable[[NDArray], bool], progress: ProgressCallback | None = None
    ) -> tuple[NDArray, NDArray, bool]:
        """Eigenvalues (k,) descending, vectors (k, n), and whether none was missed in the end."""
        self.progress, self.found = progress, 0
        self.width = min(max(NARROWEST, k // 25), WIDEST)
        limit = min(self.n - len(self.known), max(2 * k, min(4 * k, FEW)) + 8 * self.width)
        self.basis = np.empty((limit + self.width, self.n))
        self.projected = np.zeros((limit + self.width, limit + self.width))
        self.used = self.kept = 0
        complete = False
        block = self._random_block()
        for _ in range(MAX_RESTARTS):
            theta, S, coupling, block = self._expand(block, k, limit)
            error = np.linalg.norm(coupling @ S[-len(coupling) :], axis=0) / np.abs(theta)
            done = bool((error[:k] < TOLERANCE).all())
            if done and none_missing(theta[:k]):
                complete = True
                break
            keep = k if done else min(len(theta) - self.width, k + (limit - k) // 3)
            self._restart(theta[:keep], S[:, :keep])
            if done:
                log.info("eigenvalues are missing below the last one: the search goes on from random vectors")
                block = self._random_block()
        # what an application would add is known already: a step of power iteration for nothing
        added = (coupling @ S[-len(coupling) :, :k]) / theta[:k]
        return theta[:k], S[:, :k].T @ self.basis[: len(S)] + added.T @ block, complete

    def _expand(self, block: NDArray, k: int, limit: int) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Grow the basis until k pairs have converged or it is full.

        Returns Ritz values (descending) and vectors, the coupling of the last block to the next, the next.
        """
        check = max(self.used, k)  # the projected problem costs its size cubed: look at it now and then
        while True:
            start, self.used = self.used, self.used + len(block)
            self.basis[start : self.used] = block
            # by the recurrence, an image couples to the last two blocks; the first one, to all that was kept
            near = 0 if start <= self.kept else start - self.width
            image, coefficients = self._against_basis(self.apply(block), near)
            self.projected[: self.used, start : self.used] = coefficients
            self.projected[start : self.used, : self.used] = coefficients.T
            block, coupling = self._orthonormal(image)
            full = self.used + self.width > limit
            if full or self.used >= check + max(2 * self.width, k // 10):
                check = self.used
                T = self.projected[: self.used, : self.used]
                theta, S = np.linalg.eigh(0.5 * (T + T.T))
                theta, S = theta[::-1], S[:, ::-1]
                error = np.linalg.norm(coupling @ S[-len(coupling) :, :k], axis=0)
                converged = error < TOLERANCE * np.abs(theta[:k])
                if self.progress is not None:
                    self.found = max(self.found, int(converged.sum()))  # late copies of a value push back
                    self.progress(self.found, k)
                if full or converged.all():
                    return theta, S, coupling, block

    def _restart(self, theta: NDArray, S: NDArray) -> None:
        keep = len(theta)
        self.basis[:keep] = S.T @ self.basis[: len(S)]
        self.projected[:] = 0.0
        self.projected[np.arange(keep), np.arange(keep)] = theta
        self.used = self.kept = keep

    def _random_block(self) -> NDArray:
        image = self.apply(self.rng.normal(size=(self.width, self.n)))
        return self._orthonormal(self._against_basis(image)[0])[0]

    def _weighted(self, block: NDArray) -> NDArray:
        return block if self.mass is None else (self.mass @ block.T).T

    def _against_basis(self, block: NDArray, since: int = 0) -> tuple[NDArray, NDArray]:
        """The block without its parts along the basis, and their coefficients (used, w).

        The first pass takes off what is large, the parts along the basis vectors from `since` on; the second
        goes over the whole basis.
        """
        total = np.zeros((self.used, len(block)))
        for first in (since, 0):
            block = block - (self._weighted(block) @ self.known.T) @ self.known
            Q = self.basis[first : self.used]
            coefficients = self._weighted(block) @ Q.T
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
