"""Exponential of a diffusion operator applied to a vector, at many times from one small space."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.linalg.factor import Factor

# Of a pole: its time relative to the geometric mean of the times that it serves, and the ratio of those
# times. With these values 20 to 40 solves resolve any function, on any mesh.
POLE_TIME, TIME_RATIO = 0.2, 64.0
TOLERANCE = 1e-7  # of a further vector's change, relative to the solution
FLOOR = 1e-12  # relative to the start, below which a change is rounding
INVARIANT = 1e-12  # share of a new vector that rounding explains: the space holds the solution
MAX_VECTORS = 150
NO_CHANGE = 1e-3  # of the shortest time of the mesh: a shorter pole has no effect
MAX_STIFFNESS = 1e13  # of a pole: above it M + time L is singular to rounding


class HeatSemigroup:
    """Solution of M w' = -L w, L and M positive semidefinite, from a start without a part that stays.

    The solution is that of Galerkin in the space of (M + c L)^-1 M applied again and again to the start.
    Whatever the spectrum, its error falls by a factor of about 2.4 with each solve, at all times near 5 c
    at once (J. van den Eshof, M. Hochbruck, "Preconditioning Lanczos approximations to the matrix
    exponential", 2006). Times of a wide range take a few poles c, each with its factorisation. There are
    no steps in time; the energy of the solution decreases as that of the exact one.

    Parameters
    ----------
    L, M : (n, n) csc_array
    start : (n,) ndarray
    first, last : float
        Shortest and longest time.
    project : callable
        Function of a vector that removes its part in the null space of L. The start has none, and rounding
        must not add one.

    Attributes
    ----------
    basis : (k, n) ndarray
        M-orthonormal rows.
    solves : int
    """

    def __init__(
        self,
        L: csc_array,
        M: csc_array,
        start: NDArray[np.float64],
        first: float,
        last: float,
        project: Callable[[NDArray], NDArray],
    ) -> None:
        self._L, self._M, self._project = L, M, project
        self.basis, self.solves = np.empty((0, len(start))), 0
        self._projected = np.empty((0, 0))  # L in the basis
        self._is_complete = False  # the space holds the solution
        self._moment, self._coordinates = M @ start, np.empty(0)
        self._size = math.sqrt(max(float(start @ self._moment), 0.0))
        if self._size > 0:
            self._build(start, first, last)
        self._modes, self._coarse = self._eigenpairs(len(self.basis)), self._eigenpairs(len(self.basis) - 1)

    def at(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Solution at a time, and its change by the last vector of the basis, which bounds its error."""
        if len(self.basis) == 0:
            return np.zeros(self.basis.shape[1]), np.zeros(self.basis.shape[1])
        fine, coarse = _decayed(self._modes, time), _decayed(self._coarse, time)
        before = fine if self._is_complete else np.append(coarse, 0.0)
        values, change = np.stack((fine, fine - before)) @ self.basis
        return values, change

    def _build(self, start: NDArray, first: float, last: float) -> None:
        """Add vectors pole by pole, from short times to long ones, until a further vector has no effect."""
        count = max(1, math.ceil(math.log(last / first) / math.log(TIME_RATIO) - 1e-9))
        ends = np.geomspace(first, last, count + 1)
        times = np.append(first * 2.0 ** np.arange(math.log2(last / first)), last)
        low, high = _useful_poles(self._L.diagonal(), self._M.diagonal())
        factor, previous = None, 0.0
        for begin, end in zip(ends[:-1], ends[1:]):
            pole = min(max(POLE_TIME * math.sqrt(begin) * math.sqrt(end), low), high)
            if pole == previous:
                continue
            matrix = csc_array(self._M + pole * self._L)
            factor = Factor(matrix) if factor is None else factor.refactor(matrix)
            previous = pole
            if not self._extend(factor, start, times[times <= end * (1 + 1e-9)]):
                return

    def _extend(self, factor: Factor, start: NDArray, times: NDArray) -> bool:
        """Add vectors of one pole until one changes nothing; False once the space is complete."""
        before = None
        while len(self.basis) < MAX_VECTORS:
            self.solves += 1
            if not self._add(factor.solve(self._M @ (self.basis[-1] if len(self.basis) else start))):
                self._is_complete = True
                return False
            after = _decayed(self._eigenpairs(len(self.basis)), times)
            if before is not None:
                change = after.copy()
                change[:, :-1] -= before
                size = np.linalg.norm(after, axis=1) + FLOOR / TOLERANCE * self._size
                if (np.linalg.norm(change, axis=1) <= TOLERANCE * size).all():
                    return True
            before = after
        return False

    def _add(self, vector: NDArray) -> bool:
        """Add the part of a vector that the space lacks, unless that is rounding."""
        size = math.sqrt(float(vector @ (self._M @ vector)))
        for _ in range(2):
            moment = self._M @ vector
            vector = self._project(vector - (self.basis @ moment) @ self.basis)
        norm = math.sqrt(float(vector @ (self._M @ vector)))
        if not norm > INVARIANT * size:
            return False
        vector = vector / norm
        self.basis = np.vstack((self.basis, vector))
        column = self.basis @ (self._L @ vector)
        self._projected = np.block([[self._projected, column[:-1, None]], [column[None, :]]])
        self._coordinates = np.append(self._coordinates, vector @ self._moment)
        return True

    def _eigenpairs(self, k: int) -> tuple[NDArray, NDArray, NDArray]:
        """Rates and modes of the first k vectors of the basis, and the start in the modes."""
        if k < 1:
            return np.empty(0), np.empty((0, 0)), np.empty(0)
        rates, modes = np.linalg.eigh(self._projected[:k, :k])
        return rates, modes, modes.T @ self._coordinates[:k]


def _useful_poles(stiffness: NDArray, mass: NDArray) -> tuple[float, float]:
    """Poles below which no function changes, and above which M + c L is singular to rounding."""
    heavy = mass > 0
    fastest = float((stiffness[heavy] / mass[heavy]).max(initial=0.0))
    mean = float(stiffness.sum() / (mass.sum() or 1.0))
    return (NO_CHANGE / fastest, MAX_STIFFNESS / mean) if fastest > 0 else (0.0, math.inf)


def _decayed(eigenpairs: tuple[NDArray, NDArray, NDArray], time: float | NDArray) -> NDArray[np.float64]:
    """Coordinates at a time, or at each of many (rows)."""
    rates, modes, start = eigenpairs
    return (np.exp(-np.multiply.outer(time, np.maximum(rates, 0.0))) * start) @ modes.T
