"""The function that the implicit steps of a system minimise: value, gradient, Hessian, line search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.admissible import longest_fraction
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.constant_matrices import ConstantMatrices
from ddgcli.mechanics.hessian import assembly_of, total_hessian
from ddgcli.mechanics.hessian_solver import HessianSolver
from ddgcli.mechanics.increment import Increment, Point, shorter_fraction
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode
from ddgcli.mesh.vectors import row_dot

MOVE_TOLERANCE = 1e-9  # a move below this fraction of the object's size ends an iteration
HESSIAN_SOLVER = "hessian solver"  # key of a cache
MIN_STEP_FRACTION, ARMIJO_FRACTION = 1e-10, 1e-4


class Objective:
    """Value, gradient and Hessian of the function of an `Increment`, for one system.

    The cache of the system keeps the pattern of the Hessian and its symbolic factorisation for all its steps,
    as it does the factors of constant matrices: the same system at another time has the same sparsity.
    """

    def __init__(self, system: System) -> None:
        self.system = system

    @property
    def constant(self) -> ConstantMatrices:
        """Factors of the matrices of a linear system."""
        return self.system.cache.setdefault("constant matrices", ConstantMatrices())

    def is_linear(self, increment: Increment) -> bool:
        """Whether the matrix never changes: every potential is quadratic, axis by axis."""
        return self.system.linear and not increment.frozen

    def at(self, increment: Increment, y: NDArray) -> Point:
        """The function at `y`."""
        system = self.system
        energies = list(system.energies(y).values())
        if increment.a:
            away = y - increment.target
            energies.append(0.5 * increment.a * float(system.mass @ row_dot(away, away)))
        for potential in increment.frozen:
            with system.account.within(potential.name):
                energies.append(potential.energy(increment.velocity(y)) / increment.c)
        return Point(y, float(np.sum(energies)), float(np.sum(np.abs(energies))))

    def gradient(self, increment: Increment, y: NDArray) -> NDArray:
        """(n, 3) gradient, zero at fixed coordinates."""
        system = self.system
        total = system.gradient(y)
        if increment.a:
            total += (increment.a * system.mass)[:, None] * (y - increment.target)
        for potential in increment.frozen:
            with system.account.within(potential.name):
                total += potential.gradient(increment.velocity(y))
        return system.only_free(total)

    def hessian(
        self, increment: Increment, y: NDArray, mode: Mode, shift: float = 0.0, *, keep_factor: bool = False
    ) -> Any:
        """Hessian over the free coordinates and internal unknowns, plus `shift` times the masses.

        In the format that `solver` prefers. `keep_factor`: whether the last factorisation is still used.
        """
        solver = self.solver(increment)
        if not keep_factor:
            solver.release()
        return total_hessian(
            self.system, increment, solver.assembly, y, mode, shift, by_blocks=solver.by_blocks
        )

    def solver(self, increment: Increment) -> HessianSolver:
        """Solver of systems with these Hessians; made once."""
        cache = self.system.cache
        if HESSIAN_SOLVER not in cache:
            with self.system.account.within("solver"):
                cache[HESSIAN_SOLVER] = HessianSolver(assembly_of(self.system, increment))
        return cache[HESSIAN_SOLVER]

    @property
    def _assembly(self) -> Assembly:
        return self.system.cache[HESSIAN_SOLVER].assembly

    def spread(self, step: NDArray) -> NDArray:
        """(n, 3) move of the vertices in a solution over the unknowns of the last Hessian."""
        return self._assembly.spread(step)

    def entries(self, g: NDArray) -> NDArray:
        """Right-hand side of a vector (n, 3): internal unknowns are in balance."""
        return self._assembly.vector(g)

    def columns(self, y: NDArray) -> NDArray | None:
        """Columns of the term of low rank, over the unknowns of the last Hessian."""
        dense = self.system.low_rank(y)
        return None if dense is None else self.entries(dense)

    def search(
        self, increment: Increment, point: Point, move: NDArray, downhill: float
    ) -> tuple[float, Point]:
        """Backtracking from the whole step, or from the barrier: the fraction taken and where it ends.

        Each fraction is the least point of the parabola through the values so far, within bounds.
        """
        t = longest_fraction(self.system, point.y, move)
        while t > MIN_STEP_FRACTION:
            trial = self.at(increment, point.y + t * move)
            slack = sum_rounding(max(point.scale, trial.scale), len(move))
            if trial.value <= point.value + ARMIJO_FRACTION * t * downhill + slack:
                return t, trial
            t = shorter_fraction(t, trial.value - point.value, downhill)
        return 0.0, point

    def further(self, increment: Increment, point: Point, move: NDArray) -> Point:
        """Along a move of negative curvature, as far as doubling it again and again lowers the value."""
        while longest_fraction(self.system, point.y, move) == 1.0:
            trial = self.at(increment, point.y + move)
            if not trial.value < point.value:
                break
            point, move = trial, 2 * move
        return point
