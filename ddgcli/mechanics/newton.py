"""Implicit steps as minimisations: Newton with line search on the shared solver layer.

Every scheme needs the minimiser y of

    a/2 |y - target|_M^2 + V(y) + R(c (y - origin)) / c,

V the potentials and R the dissipation frozen at the start of the step: its stationarity is the equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.linalg.conjugate import NewtonStep, truncated_conjugate_gradients
from ddgcli.mechanics import low_rank
from ddgcli.mechanics.constant_matrices import ConstantMatrices
from ddgcli.mechanics.hessian import assembly_of, total_hessian
from ddgcli.mechanics.hessian_solver import HessianSolver
from ddgcli.mechanics.increment import Increment, Point, shorter_fraction
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.secant import MAX_SECANT_RATIO, Secants
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode
from ddgcli.simulation.model import StepRejected

MOVE_TOLERANCE = 1e-9  # a Newton step below this fraction of the object's size ends the iteration
# a first guess whose acceleration misses no more than this part needs no iteration
ACCELERATION_TOLERANCE = 1e-8
ROUNDED_SPACINGS = 2.0
HALF_ULP = 0.25 * float(np.finfo(float).eps)  # a move that changes no digit
# moves of which the line search leaves less than that part, and how many may be
SHORT_STEP_FRACTION, MAX_SHORT_STEPS = 1e-3, 10
MAX_BALANCE_MOVES = 4  # further moves for the balance of momentum, once moves are short enough
# a stiff sheet that has struck something needs many, and halves of the step no fewer
MAX_NEWTON_ITERATIONS = 300
MIN_STEP_FRACTION, ARMIJO_FRACTION = 1e-10, 1e-4
# rounds of conjugate gradients that cost about a factorisation; and what of a move may be missing at most
MAX_CG_ROUNDS, MAX_CG_RESIDUAL = 15, 0.1


class Newton:
    """Newton's iteration for one system; keeps its scatter pattern and the symbolic factorisation.

    A step factorises once, at its first guess: the projected Hessian, in contact the exact one. Later moves
    come from that factorisation and the changes of the gradient, as long as they shrink fast enough; else
    from the exact Hessian, by conjugate gradients preconditioned by that factorisation, as exactly as needed,
    or by a new one after too many rounds. The result of a step depends only on its arguments.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self._solver: HessianSolver | None = None
        self._fresh = False  # whether the factorisation belongs to the step under way
        self._secants = Secants()
        self._constant = ConstantMatrices()

    # ------------------------------------------------------------ the function

    def at(self, increment: Increment, y: NDArray) -> Point:
        """The function at `y`."""
        system = self.system
        energies = list(system.energies(y).values())
        if increment.a:
            away = y - increment.target
            energies.append(0.5 * increment.a * float(system.mass @ np.einsum("ni,ni->n", away, away)))
        for potential in increment.frozen:
            with system.account.within(potential.name):
                energies.append(potential.energy(increment.velocity(y)) / increment.c)
        return Point(y, float(np.sum(energies)), float(np.sum(np.abs(energies))))

    def slope(self, increment: Increment, y: NDArray) -> NDArray:
        """(n, 3) gradient, zero where held."""
        system = self.system
        total = system.gradient(y)
        if increment.a:
            total += (increment.a * system.mass)[:, None] * (y - increment.target)
        for potential in increment.frozen:
            with system.account.within(potential.name):
                total += potential.gradient(increment.velocity(y))
        return system.only_free(total)

    def matrix(self, increment: Increment, y: NDArray, mode: Mode, shift: float = 0.0) -> Any:
        """Hessian over the free coordinates and internal unknowns, in the format that `solver` prefers."""
        solver = self.solver(increment)
        if mode == "projected" or not self._fresh:  # it will be factorised, or nothing is
            solver.release()
        return total_hessian(
            self.system, increment, solver.assembly, y, mode, shift, by_blocks=solver.by_blocks
        )

    def solver(self, increment: Increment) -> HessianSolver:
        """Solver of the systems of the steps, with the pattern of the Hessians; made once."""
        if self._solver is None:
            with self.system.account.within("solver"):
                self._solver = HessianSolver(assembly_of(self.system, increment))
        return self._solver

    # ------------------------------------------------------------ the iteration

    def start(self, increment: Increment, x: NDArray, guesses: Sequence[NDArray], since: float) -> Point:
        """The guess of least value among those that no barrier keeps from `x`; else `x`.

        Vertices near obstacles have moved with these from their place at the time `since`, and prescribed
        vertices are where they belong at the time of the system; StepRejected where a barrier keeps them from
        there.
        """
        x = self.with_prescribed(self.carried(x, since))
        if self.is_linear(increment):  # one solve leads from any guess to the same place
            return Point(self.system.held_as(x, guesses[0]), 0.0, 0.0)
        points = []
        for guess in guesses:
            move = self.system.only_free(guess - x)
            if self.reach(x, move) == 1.0:
                points.append(self.at(increment, x + move))
        return min(points, key=lambda point: point.value) if points else self.at(increment, x)

    def carried(self, x: NDArray, since: float) -> NDArray:
        """Positions x of the time `since`, with vertices near moving obstacles carried along by them."""
        moving = [barrier for barrier in self.system.barriers if hasattr(barrier, "carried")]
        for barrier in moving:
            with self.system.account.within(barrier.name):
                moved = barrier.carried(x, since)
            if moved is None:
                raise StepRejected("barrier crossed")
            move = self.system.only_free(moved - x)
            if move.any():
                for other in self.system.barriers:
                    if other not in moving and other.longest(x, move) < 1.0:
                        raise StepRejected("barrier crossed", worst(move))
                x = x + move
        for barrier in moving:
            crossed = barrier.outside(x)
            if crossed is not None:
                raise StepRejected("barrier crossed", f"vertex {crossed[0]}", crossed[1])
        return x

    def with_prescribed(self, x: NDArray) -> NDArray:
        """Positions `x` with the prescribed vertices at the time of the system."""
        moved = self.system.prescribed_state(x, x, x)[0]
        if moved is not x and self.reach(x, moved - x) < 1.0:
            raise StepRejected("barrier crossed", worst(moved - x))
        return moved

    def minimise(self, increment: Increment, guess: Point) -> tuple[NDArray, int]:
        """The minimiser near `guess`, which must be inside every barrier; and the iterations.

        Raises
        ------
        StepRejected
            No convergence, with the vertex of the largest residual.
        """
        system = self.system
        if self.is_linear(increment):
            return self._constant.minimiser(system, increment.a, increment.target, guess.y), 1
        self._fresh, self._secants = False, Secants()
        # far from the origin, moves of the spacing of numbers there come from rounded positions
        spacing = float(np.spacing(np.abs(guess.y).max()))
        enough = max(MOVE_TOLERANCE * system.size, ROUNDED_SPACINGS * spacing)
        point, before, cut, near = guess, np.inf, 0, 0
        for iteration in range(1, MAX_NEWTON_ITERATIONS + 1):
            g = self.slope(increment, point.y)
            if not np.isfinite(point.value) or not np.isfinite(g).all():
                raise StepRejected("not finite", worst(g))
            if near:
                point, g = self._translated(increment, point, g)
            if self._settled(increment, point.y, g) or (near and self._in_balance(increment, point.y, g)):
                return point.y, iteration - 1
            if near > MAX_BALANCE_MOVES:
                return point.y, iteration - 1
            exact = 0.1 * (self._moved(increment, point.y) if near else enough)
            direction = self._direction(increment, point.y, g, before, exact)
            move = self.spread(direction.x)
            short = direction.convex and max(float(np.abs(move).max()), direction.error) <= enough
            if short and self.reach(point.y, move) == 1.0:
                # too short for values to judge: they differ by rounding
                point, near = self.at(increment, point.y + move), near + 1
                continue
            t, point = self.search(increment, point, move, float(np.vdot(g, move)))
            if t == 1.0 and not direction.convex:
                point = self._further(increment, point, move)
            if t == 0.0:
                direction = self._projected_direction(increment, point.y, g)
                move = self.spread(direction.x)
                t, point = self.search(increment, point, move, float(np.vdot(g, move)))
            size = float(np.abs(move).max())
            if t == 0.0 and size > enough:
                raise StepRejected("line search", worst(g), float(np.abs(g).max()))
            cut += t < SHORT_STEP_FRACTION
            if cut > MAX_SHORT_STEPS:
                break
            # the next move is to this one as this one to the last: near the end, Newton does better than that
            quick = direction.convex and t == 1.0 and size < before < np.inf
            following = max(size * size / before, direction.error) if quick else size * max(t, 1e-3)
            before = size if t == 1.0 else np.inf
            near = near + 1 if following <= enough else 0
        raise StepRejected("newton", worst(g), size)

    def is_linear(self, increment: Increment) -> bool:
        """Whether the matrix never changes: every potential is quadratic, axis by axis."""
        return self.system.linear and not increment.frozen

    def _settled(self, increment: Increment, y: NDArray, g: NDArray) -> bool:
        """Whether inertia alone already bounds the next move.

        What a step leaves undone is an error of the acceleration, so it is measured by what the acceleration
        moves in the step: an absolute bound would add up to any error in enough short steps.
        """
        left = float((np.abs(g) / (increment.a * self.system.mass[:, None])).max())
        return left <= min(1e-3 * MOVE_TOLERANCE * self.system.size, self._moved(increment, y))

    def _moved(self, increment: Increment, y: NDArray) -> float:
        """The part that counts of what the acceleration moves in the step; at least rounding."""
        moved = ACCELERATION_TOLERANCE * float(np.abs(self.system.only_free(y - increment.target)).max())
        return max(moved, self._rounding(y))

    @staticmethod
    def _rounding(y: NDArray) -> float:
        """A move that changes no digit of the largest coordinate."""
        return HALF_ULP * float(np.abs(y).max())

    def _in_balance(self, increment: Increment, y: NDArray, g: NDArray) -> bool:
        """Whether the forces on all vertices together move their middle no more than that."""
        return float(np.abs(self._imbalance(increment, g)).max()) <= self._moved(increment, y)

    def _imbalance(self, increment: Increment, g: NDArray) -> NDArray:
        """(3,) translation whose inertia balances the sum of the forces; 0 along axes held everywhere."""
        mass = self.system.mass @ self.system.free
        return np.divide(-g.sum(axis=0), increment.a * mass, out=np.zeros(3), where=mass > 0)

    def _translated(self, increment: Increment, point: Point, g: NDArray) -> tuple[Point, NDArray]:
        """The point moved by the translation that balances the momentum, and the gradient there.

        The Hessian along a translation is inertia alone unless something outside holds the object, but a
        solve sees it beside the stiffness: where that is 1e12 times inertia (a strip of needles) rounding
        leaves an arbitrary part of the imbalance, which depends on the processor. The sum of the gradient has
        no such cancellation, because the forces of each element sum to zero up to their own rounding. A
        translation that does not halve the imbalance (pins, contact) is not taken.
        """
        left = self._imbalance(increment, g)
        if float(np.abs(left).max()) <= self._moved(increment, point.y):
            return point, g
        move = self.system.only_free(np.broadcast_to(left, point.y.shape))
        if self.reach(point.y, move) < 1.0:
            return point, g
        moved = point.y + move
        slope = self.slope(increment, moved)
        if not np.abs(self._imbalance(increment, slope)).max() <= 0.5 * np.abs(left).max():
            return point, g
        return self.at(increment, moved), slope

    def spread(self, step: NDArray) -> NDArray:
        """(n, 3) move of the vertices in a solution over the unknowns of the last matrix."""
        return self._solver.assembly.spread(step)  # type: ignore[union-attr]

    def entries(self, g: NDArray) -> NDArray:
        """Right-hand side of a vector (n, 3): internal unknowns are in balance."""
        return self._solver.assembly.vector(g)  # type: ignore[union-attr]

    def columns(self, y: NDArray) -> NDArray | None:
        """Columns of the part of low rank, over the unknowns of the last matrix."""
        dense = self.system.low_rank(y)
        return None if dense is None else self.entries(dense)

    def _direction(
        self, increment: Increment, y: NDArray, g: NDArray, before: float, least: float
    ) -> NewtonStep:
        """Descent direction by the present factorisation and secants, or by the exact Hessian.

        The first one of a step is that of the projected Hessian, which costs half and always factorises; in
        contact that of the exact one where definite. `before`: length of the last move; `least`: its error.
        """
        if not self._fresh and not self._in_contact(y):
            first = self._projected_direction(increment, y, g).x
            self._secants.add(self.entries(y), self.entries(g))
            return NewtonStep(first, float(np.abs(self.spread(first)).max()), 0, True)
        quick = self._secant_direction(y, g, before)
        if quick is not None:
            return quick
        matrix, rhs, columns = self.matrix(increment, y, "exact"), self.entries(-g), self.columns(y)
        if not self._fresh:
            self._secants.add(self.entries(y), -rhs)
            step = self._solved(y, matrix, columns, rhs)
            if step is not None:
                error = self.solver(increment).error * float(np.abs(step).max(initial=0.0))
                return NewtonStep(step, error, 0, True)
            self._factorise_projected(increment, y, g)
        with self.system.account.within("solver"):
            direction = truncated_conjugate_gradients(
                low_rank.product(matrix.__matmul__, columns), self._precondition, rhs,
                lambda first: max(min(MAX_CG_RESIDUAL, first / before) * first, least), MAX_CG_ROUNDS,
                # near the end a stationary point is a solution, whether or not it could buckle
                through=lambda first: first < MAX_CG_RESIDUAL * before < np.inf,
            )  # fmt: skip
        if direction is None:
            return self._projected_direction(increment, y, g)
        self._fresh = direction.rounds < MAX_CG_ROUNDS
        return direction

    def _secant_direction(self, y: NDArray, g: NDArray, before: float) -> NewtonStep | None:
        """Direction by the present factorisation and past moves, or None where it contracts too little.

        Or where something is in contact: then a move costs a search for contacts, more than a Hessian.
        """
        if not self._fresh or self._in_contact(y):
            return None
        rhs = self.entries(-g)
        self._secants.add(self.entries(y), -rhs)
        if not before < np.inf:
            return None
        with self.system.account.within("solver"):
            step = self._secants.solve(rhs, self._precondition)
        size = float(np.abs(self.spread(step)).max())
        if not size <= MAX_SECANT_RATIO * before or not float(rhs @ step) > 0:
            return None
        # later moves may shrink less than this one did: the ratio of two lengths would promise too much
        return NewtonStep(step, size, 0, True)

    def _in_contact(self, y: NDArray) -> bool:
        return any(barrier.energy(y) for barrier in self.system.barriers)

    def _projected_direction(self, increment: Increment, y: NDArray, g: NDArray) -> NewtonStep:
        """Descent direction of the projected Hessian, which is positive definite."""
        self._factorise_projected(increment, y, g)
        with self.system.account.within("solver"):
            return NewtonStep(self._precondition(self.entries(-g)), 0.0, 0, False)

    def _solved(self, y: NDArray, matrix: Any, columns: NDArray | None, rhs: NDArray) -> NDArray | None:
        """Solution with a new factorisation, or None where the matrix is not positive definite."""
        with self.system.account.within("solver"):
            try:
                self._factorise(matrix, y, columns)
                step = self._solver.solve(rhs)  # type: ignore[union-attr]
            except SolveError:
                return None
            return step if float(rhs @ step) > 0 or not rhs.any() else None

    def _factorise_projected(self, increment: Increment, y: NDArray, g: NDArray) -> None:
        matrix = self.matrix(increment, y, "projected")
        with self.system.account.within("solver"):
            try:
                self._factorise(matrix, y, self.columns(y))
            except SolveError as error:
                raise StepRejected("singular", worst(g)) from error

    def _factorise(self, matrix: Any, y: NDArray, columns: NDArray | None) -> None:
        self._fresh = False
        self._solver.factorise(self.system, matrix, y, columns)  # type: ignore[union-attr]
        self._fresh = True
        self._secants.restart()

    def _precondition(self, rhs: NDArray) -> NDArray:
        try:
            return self._solver.solve(rhs)  # type: ignore[union-attr]
        except SolveError as error:
            raise StepRejected(str(error)) from error

    def reach(self, y: NDArray, move: NDArray) -> float:
        """Largest fraction of a move that stays inside every barrier."""
        t = 1.0
        for barrier in self.system.barriers:
            with self.system.account.within(barrier.name):
                t = min(t, barrier.longest(y, move))
        return t

    def search(
        self, increment: Increment, point: Point, move: NDArray, downhill: float
    ) -> tuple[float, Point]:
        """Backtracking from the whole step, or from the barrier: the fraction taken and where it ends.

        Each fraction is the least point of the parabola through what is known, within bounds.
        """
        t = self.reach(point.y, move)
        while t > MIN_STEP_FRACTION:
            trial = self.at(increment, point.y + t * move)
            slack = sum_rounding(max(point.scale, trial.scale), len(move))
            if trial.value <= point.value + ARMIJO_FRACTION * t * downhill + slack:
                return t, trial
            t = shorter_fraction(t, trial.value - point.value, downhill)
        return 0.0, point

    def _further(self, increment: Increment, point: Point, move: NDArray) -> Point:
        """Along a move that curves downhill, as far as doubling it again and again gains."""
        while self.reach(point.y, move) == 1.0:
            trial = self.at(increment, point.y + move)
            if not trial.value < point.value:
                break
            point, move = trial, 2 * move
        return point


def newton_of(system: System) -> Newton:
    """Newton solver of a system; one for all its steps, so that the factorisation is analysed once.

    Parameters
    ----------
    system : System

    Returns
    -------
    Newton
    """
    if "newton" not in system.cache:
        system.cache["newton"] = Newton(system)
    system.cache["newton"].system = system  # the same system at another time has the same sparsity
    return system.cache["newton"]


def worst(g: NDArray) -> str:
    """Name of the vertex with the largest residual, for messages.

    Parameters
    ----------
    g : (n, 3) ndarray of float64
        Residual forces.

    Returns
    -------
    str
    """
    with np.errstate(invalid="ignore"):
        size = np.abs(np.nan_to_num(g, nan=np.inf)).max(axis=1)
    return f"vertex {int(np.argmax(size))}"
