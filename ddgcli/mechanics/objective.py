"""The incremental potential as the objective of implicit steps: value, gradient, Hessian, line search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.admissible import collision_free_fraction
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.constant_matrices import ConstantMatrices
from ddgcli.mechanics.hessian import assembly_of, total_hessian
from ddgcli.mechanics.hessian_solver import HessianSolver
from ddgcli.mechanics.increment import Increment, Point, shorter_fraction
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode
from ddgcli.mesh.vectors import row_dot

MOVE_TOLERANCE = 1e-9  # move over the object's size below which an iteration ends
HESSIAN_SOLVER = "hessian solver"  # key in the cache of a system
MIN_STEP_FRACTION, ARMIJO_FRACTION = 1e-10, 1e-4  # of the line search


class Objective:
    """Value, gradient and Hessian of an `Increment` for one system.

    The pattern of the Hessian, its symbolic factorisation, and the factors of constant matrices are in the
    cache of the system, for all its steps: the system has the same sparsity at any time.
    """

    def __init__(self, system: System) -> None:
        self.system = system

    @property
    def constant(self) -> ConstantMatrices:
        """Factors of the matrices of a linear system."""
        return self.system.cache.setdefault("constant matrices", ConstantMatrices())

    def is_linear(self, increment: Increment) -> bool:
        """Whether the Hessian is constant: every potential is quadratic with one matrix for each axis."""
        return self.system.linear and not increment.frozen

    def at(self, increment: Increment, y: NDArray) -> Point:
        """The iterate at positions `y`."""
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

        The format is the one that `solver` prefers. `keep_factor`: the last factorisation is still used.
        """
        solver = self.solver(increment)
        if not keep_factor:
            solver.release()
        return total_hessian(
            self.system, increment, solver.assembly, y, mode, shift, by_blocks=solver.by_blocks
        )

    def solver(self, increment: Increment) -> HessianSolver:
        """Solver of linear systems with these Hessians, created once."""
        cache = self.system.cache
        if HESSIAN_SOLVER not in cache:
            with self.system.account.within("solver"):
                cache[HESSIAN_SOLVER] = HessianSolver(assembly_of(self.system, increment))
        return cache[HESSIAN_SOLVER]

    @property
    def _assembly(self) -> Assembly:
        return self.system.cache[HESSIAN_SOLVER].assembly

    def scatter(self, step: NDArray) -> NDArray:
        """(n, 3) moves of the vertices from a solution over the unknowns of the Hessian."""
        return self._assembly.scatter(step)

    def gather(self, g: NDArray) -> NDArray:
        """Entries of a vector (n, 3) at the unknowns of the Hessian; 0 for internal unknowns."""
        return self._assembly.gather(g)

    def columns(self, y: NDArray) -> NDArray | None:
        """Columns of the low-rank term, over the unknowns of the Hessian."""
        dense = self.system.low_rank(y)
        return None if dense is None else self.gather(dense)

    def search(
        self, increment: Increment, point: Point, move: NDArray, downhill: float
    ) -> tuple[float, Point]:
        """Backtracking line search from the largest collision-free fraction: the fraction and its end.

        The fraction is 0 if no fraction decreases the value; see `shorter_fraction`.
        """
        t = collision_free_fraction(self.system, point.y, move)
        while t > MIN_STEP_FRACTION:
            trial = self.at(increment, point.y + t * move)
            slack = sum_rounding(max(point.scale, trial.scale), len(move))
            if trial.value <= point.value + ARMIJO_FRACTION * t * downhill + slack:
                return t, trial
            t = shorter_fraction(t, trial.value - point.value, downhill)
        return 0.0, point

    def further(self, increment: Increment, point: Point, move: NDArray) -> Point:
        """The end of a move of negative curvature that is doubled as long as the value decreases."""
        while collision_free_fraction(self.system, point.y, move) == 1.0:
            trial = self.at(increment, point.y + move)
            if not trial.value < point.value:
                break
            point, move = trial, 2 * move
        return point
