"""Inverse of L - shift M with a shift inside of the spectrum, and counts of eigenvalues by its inertia."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from ddgcli.linalg.backends import analyse
from ddgcli.linalg.indices import compact
from ddgcli.linalg.multifrontal import PivotOrder, cholesky_groups, cholesky_solve, count_negative

log = logging.getLogger("ddgcli")

# Weyl: the k-th eigenvalue of a surface is 4 pi k / tr M, and the diagonal of L is sqrt(12) on equilateral
# triangles; other units of L change both alike
WEYL = 4 * np.pi / np.sqrt(12)
AIM = 0.5  # share of the pairs below the shift
MAX_SHIFTS = 4  # factorisations
MAX_BACKWARD_ERROR = 1e-9  # of a solution
MAX_NEARNESS = 1e5  # shift over its distance from the next eigenvalue; digits are lost near an eigenvalue


class ShiftInvert:
    """Multifrontal factor of L - shift M, about half of whose k smallest eigenvalues are below the shift.

    Block Lanczos needs a quarter fewer solutions than with the inverse of L: the pairs lie on both sides of
    the shift, each side with half of them.

    Parameters
    ----------
    stiffness, mass : (n, n) csr_array
        Semidefinite and definite.

    Attributes
    ----------
    shift : float
        Shift of the factor; set by `factorise_near`.
    """

    def __init__(self, stiffness: csr_array, mass: csr_array) -> None:
        # both matrices in one pattern: the entries of real and imaginary terms
        both = csc_array(stiffness + 1j * mass)
        both.sort_indices()
        self._pattern = compact(both)
        self._stiffness, self._mass = both.data.real.copy(), both.data.imag.copy()
        self._analysis = analyse(self._matrix(0.0))
        self._mean_mass = float(mass.diagonal().mean())
        # for one pair
        self._weyl = WEYL * float(np.median(stiffness.diagonal())) / float(mass.diagonal().sum())
        self.shift = 0.0

    def factorise_near(self, k: int) -> bool:
        """Factorise with a shift near the k smallest eigenvalues; False if none of a few tries succeeds.

        The first shift follows from Weyl's law, its inertia is the number of eigenvalues below it.
        """
        shift = AIM * k * self._weyl
        if self._analysis is None or not (shift > 0 and np.isfinite(self._data(shift)).all()):
            return False
        for _ in range(MAX_SHIFTS):
            try:
                self._groups = cholesky_groups(self._analysis.levels, self._data(shift), definite=False)
            except np.linalg.LinAlgError:
                shift *= 0.9
                continue
            self.shift, self._order = shift, PivotOrder.of(self._groups, self._pattern.shape[0])
            below = sum(group.negative for group in self._groups)
            if below > k:
                log.info("%d eigenvalues are below the shift %g: a smaller one follows", below, shift)
                shift *= AIM * k / below
            elif self._is_accurate():
                return True
            else:
                shift *= 0.9
        return False

    def solve(self, rhs: NDArray) -> NDArray[np.float64]:
        """Solution of (L - shift M) x = rhs for (n, c) right-hand sides."""
        return cholesky_solve(self._groups, rhs, self._order)

    def count_below(self, value: float) -> int | None:
        """Number of eigenvalues below a value; None where a block of pivots is singular."""
        try:
            return count_negative(self._analysis.levels, self._data(value)) if self._analysis else None
        except np.linalg.LinAlgError:
            return None

    def _is_accurate(self) -> bool:
        """Whether solutions have small residuals, and the shift is not close to an eigenvalue."""
        matrix = self._matrix(self.shift)
        b = np.random.default_rng(0).normal(size=(matrix.shape[0], 1)) * self._mean_mass
        x = self.solve(b)
        error = np.abs(matrix @ x - b).max()
        if not error <= MAX_BACKWARD_ERROR * (abs(matrix) @ np.abs(x) + np.abs(b)).max():
            return False
        again = self.solve(x * self._mean_mass)
        return bool(self.shift * np.linalg.norm(again) < MAX_NEARNESS * np.linalg.norm(x))

    def _data(self, shift: float) -> NDArray[np.float64]:
        return self._stiffness - shift * self._mass

    def _matrix(self, shift: float) -> csc_array:
        pattern = self._pattern
        return csc_array((self._data(shift), pattern.indices, pattern.indptr), shape=pattern.shape)
