"""Implicit steps of linear systems: one solve with a constant matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from ddgcli.linalg.factor import REFINEMENT_TOLERANCE, Factor
from ddgcli.mechanics.system import System

MAX_MATRICES = 8  # cached factorisations, for different step lengths


class ConstantMatrices:
    """Factorisations of masses plus stiffness, for potentials that are quadratic with one matrix per axis."""

    def __init__(self) -> None:
        self._matrices: dict[float, _ConstantMatrix] = {}

    def minimiser(self, system: System, a: float, target: NDArray, y: NDArray) -> NDArray[np.float64]:
        """(n, 3) minimiser of a/2 |y - target|_M^2 plus the potentials; held coordinates are those of `y`."""
        gradient = system.full_gradient(y)
        with system.account.within("solver"):
            if a not in self._matrices:
                if len(self._matrices) >= MAX_MATRICES:
                    self._matrices.clear()
                self._matrices[a] = _ConstantMatrix(system, a)
            return self._matrices[a].minimiser(target, y, gradient)


class _ConstantMatrix:
    """The matrix of one axis for one step length, factorised.

    One scalar matrix serves the three axes: the unknowns of an axis are not coupled to those of the others.
    Whether its solutions need refinement is decided once, with a random right-hand side.
    """

    def __init__(self, system: System, a: float) -> None:
        self._system, self._inertia = system, np.repeat(a * system.mass, 3).reshape(-1, 3)
        whole = diags_array(a * system.mass).tocsr()
        for potential in system.potentials:
            if len(potential.stencil):
                whole = whole + potential.matrix
        free = system.free[:, 0]
        # held vertices have a diagonal row, so that no step gathers or scatters unknowns
        coupled = csc_array(diags_array(free.astype(float)) @ whole @ diags_array(free.astype(float)))
        coupled.eliminate_zeros()
        matrix = csc_array(coupled + diags_array(np.where(free, 0.0, a * system.mass)))
        self._factor = Factor(matrix)
        probe = np.random.default_rng(0).normal(size=self._factor.n)
        error = self._factor.backward_error(self._factor.solve(probe, refine=False), probe)
        self._refine = not error <= REFINEMENT_TOLERANCE

    def minimiser(self, target: NDArray, y: NDArray, gradient: NDArray) -> NDArray[np.float64]:
        force = target - y
        force *= self._inertia
        force -= gradient
        move = self._factor.solve(self._system.only_free(force), refine=self._refine)
        move += y
        return move
