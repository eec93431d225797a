"""Implicit steps as minimisations: projected Newton with line search on the shared solver layer.

Every scheme asks for the minimiser y of

    a/2 |y - target|_M^2 + V(y) + R(c (y - origin)) / c,

V the potentials and R the dissipation frozen at the start of the step: its stationarity is the equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from ddgcli.errors import SolveError
from ddgcli.evolve.assembly import Assembly
from ddgcli.evolve.loop import StepRejected
from ddgcli.evolve.system import System
from ddgcli.evolve.terms import Mode, Potential
from ddgcli.linalg.factor import Factor

MOVE = 1e-9  # a Newton step below this fraction of the object's size ends the iteration
MOST = 40
SHORTEST = 1e-10
ARMIJO = 1e-4
ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class Increment:
    """The function that a step minimises.

    Parameters
    ----------
    a : float
        1/s^2; 0 for an equilibrium.
    target, origin : (n, 3) ndarray
    c : float
        1/s: the velocity is c (y - origin).
    frozen : tuple of Potential
        Dissipation as potentials of the velocity.
    """

    a: float
    target: NDArray
    c: float = 1.0
    origin: NDArray | None = None
    frozen: tuple[Potential, ...] = ()

    def velocity(self, y: NDArray) -> NDArray:
        return self.c * (y - self.origin)


class Newton:
    """Projected Newton for one system; keeps its scatter pattern and the symbolic factorisation."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._assembly: Assembly | None = None
        self._factor: Factor | None = None
        self._constant: dict[float, Factor] = {}

    # ------------------------------------------------------------ the function

    def value(self, increment: Increment, y: NDArray) -> tuple[float, float]:
        """(value, size of its summands): the second is the scale of rounding."""
        system = self.system
        parts = list(system.energies(y).values())
        if increment.a:
            parts.append(
                0.5 * increment.a * float(np.sum(system.mass[:, None] * (y - increment.target) ** 2))
            )
        for potential in increment.frozen:
            with system.account.within(potential.name):
                parts.append(potential.energy(increment.velocity(y)) / increment.c)
        return float(np.sum(parts)), float(np.sum(np.abs(parts)))

    def slope(self, increment: Increment, y: NDArray) -> NDArray:
        """(n, 3) gradient, zero where held."""
        system = self.system
        total = system.gradient(y)
        if increment.a:
            total = total + increment.a * system.mass[:, None] * (y - increment.target)
        for potential in increment.frozen:
            with system.account.within(potential.name):
                total = total + potential.gradient(increment.velocity(y))
        return total if system.all_free else np.where(system.free, total, 0.0)

    def matrix(self, increment: Increment, y: NDArray, mode: Mode, shift: float = 0.0) -> csc_array:
        """Hessian over the free coordinates."""
        system = self.system
        blocks = []
        for potential in system.potentials:
            if len(potential.stencil):
                with system.account.within(potential.name):
                    blocks.append(potential.blocks(y, mode))
        for potential in increment.frozen:
            with system.account.within(potential.name):
                blocks.append(increment.c * potential.blocks(increment.velocity(y), mode))
        with system.account.within("solver"):
            if self._assembly is None:
                stencils = [p.stencil for p in system.potentials if len(p.stencil)]
                stencils += [p.stencil for p in increment.frozen]
                self._assembly = Assembly(system.free, stencils)
            diagonal = np.repeat((increment.a + shift) * system.mass[:, None], 3, axis=1)
            return self._assembly.matrix(blocks, diagonal)

    # ------------------------------------------------------------ the iteration

    def minimise(self, increment: Increment, guess: NDArray, most: int = MOST) -> tuple[NDArray, int]:
        """The minimiser near `guess`, which must be inside every barrier; and the iterations.

        Raises
        ------
        StepRejected
            No convergence, with the vertex of the largest residual.
        """
        system = self.system
        if system.linear and increment.a and not increment.frozen:
            return self._linear(increment, guess), 1
        y = guess
        value, scale = self.value(increment, y)
        exact_allowed = increment.a > 0
        shift = 0.0 if increment.a else self._first_shift(increment, y)
        before = np.inf
        for iteration in range(1, most + 1):
            g = self.slope(increment, y)
            if not np.isfinite(value) or not np.isfinite(g).all():
                raise StepRejected("not finite", _worst(g))
            if increment.a and self._settled(increment, g):
                return y, iteration - 1
            move, exact_used = self._direction(increment, y, g, exact_allowed, shift)
            exact_allowed = exact_used or (increment.a == 0 and shift == 0)
            size = float(np.abs(move).max())
            t, y_new, value_new, scale_new = self._search(
                increment, y, value, scale, move, float(np.vdot(g, move))
            )
            if t == 0.0 and size > MOVE * system.size:
                if exact_used and increment.a:
                    exact_allowed = False
                    continue
                if not increment.a and shift < 1e12 * (shift_unit := self._first_shift(increment, y)):
                    shift, exact_allowed = max(10 * shift, shift_unit), False
                    continue
                raise StepRejected("line search", _worst(g), float(np.abs(g).max()))
            y, value, scale = y_new, value_new, scale_new
            if not increment.a:
                shift = shift / 10 if t == 1.0 else shift * (1.0 if t > 0.1 else 4.0)
                exact_allowed = shift < 1e-6 * self._first_shift(increment, y) * 1e3 and t == 1.0
            # the next move is to this one as this one to the last: near the end, Newton does better than that
            quick = exact_used and t == 1.0 and size < before < np.inf
            following = size * size / before if quick else size * max(t, 1e-3)
            before = size if t == 1.0 else np.inf
            if following <= MOVE * system.size:
                return y, iteration
        raise StepRejected("newton", _worst(g), size)

    def _settled(self, increment: Increment, g: NDArray) -> bool:
        """Whether inertia alone already bounds the next move."""
        return bool(
            (np.abs(g) / (increment.a * self.system.mass[:, None])).max() <= 1e-3 * MOVE * self.system.size
        )

    def _first_shift(self, increment: Increment, y: NDArray) -> float:
        """Shift of an equilibrium's Hessian, per mass: a fraction of the system's own stiffness."""
        if not hasattr(self, "_unit"):
            matrix = self.matrix(increment, y, "projected")
            total = 3 * float(self.system.mass.sum())
            self._unit = 1e-6 * float(matrix.diagonal().sum()) / total
        return self._unit

    def _direction(
        self, increment: Increment, y: NDArray, g: NDArray, exact_allowed: bool, shift: float
    ) -> tuple[NDArray, bool]:
        """Descent direction: with the exact Hessian where that descends, else with the projected one."""
        modes: tuple[Mode, ...] = ("exact", "projected") if exact_allowed else ("projected",)
        for mode in modes:
            matrix = self.matrix(increment, y, mode, shift)
            with self.system.account.within("solver"):
                try:
                    step = self._solve(matrix, -g[self.system.free])
                except SolveError as error:
                    if mode == "exact":
                        continue
                    raise StepRejected("singular", _worst(g)) from error
            move = np.zeros_like(g)
            move[self.system.free] = step
            downhill = float(np.vdot(g, move))
            if np.isfinite(downhill) and downhill <= 0:
                return move, mode == "exact"
        raise StepRejected("no descent", _worst(g), float(np.abs(g).max()))

    def _solve(self, matrix: csc_array, rhs: NDArray) -> NDArray:
        if self._factor is None:
            # factorised twice: what comes after must not depend on where a run was resumed
            self._factor = Factor(matrix)
        try:
            self._factor.refactor(matrix)
        except SolveError:
            self._factor = None
            raise
        solution = self._factor.solve(rhs, refine=False)
        if self._factor.solver == "pivoted":
            self._factor = None
        return solution

    def _search(
        self, increment: Increment, y: NDArray, value: float, scale: float, move: NDArray, downhill: float
    ) -> tuple[float, NDArray, float, float]:
        """Backtracking from the whole step, or from the barrier: (fraction, point, value, scale)."""
        t = 1.0
        for barrier in self.system.bounded:
            with self.system.account.within(barrier.name):
                t = min(t, barrier.longest(y, move))
        while t > SHORTEST:
            trial = y + t * move
            value_new, scale_new = self.value(increment, trial)
            slack = ROUNDING * max(scale, scale_new) * np.sqrt(len(y))
            if value_new <= value + ARMIJO * t * downhill + slack:
                return t, trial, value_new, scale_new
            t *= 0.5
        return 0.0, y, value, scale

    # ------------------------------------------------------------ constant matrices

    def _linear(self, increment: Increment, guess: NDArray) -> NDArray:
        """One solve with a matrix that never changes: every potential is quadratic, axis by axis."""
        system = self.system
        g = self.slope(increment, guess)
        with system.account.within("solver"):
            if increment.a not in self._constant:
                if len(self._constant) > 8:
                    self._constant.clear()
                whole = diags_array(increment.a * system.mass).tocsr()
                for potential in system.potentials:
                    if len(potential.stencil):
                        whole = whole + potential.matrix  # type: ignore[attr-defined]
                rows = system.free[:, 0]
                self._constant[increment.a] = Factor(csc_array(whole[rows][:, rows]))
            y = guess.copy()
            y[system.free[:, 0]] -= self._constant[increment.a].solve(g[system.free[:, 0]])
        return y


def _worst(g: NDArray) -> str:
    """The vertex of the largest residual."""
    with np.errstate(invalid="ignore"):
        size = np.abs(np.nan_to_num(g, nan=np.inf)).max(axis=1)
    return f"vertex {int(np.argmax(size))}"
