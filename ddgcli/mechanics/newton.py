"""Implicit steps as minimisations, by Newton's method with line search.

Every implicit scheme needs the minimiser y of the incremental potential

    a/2 |y - target|_M^2 + V(y) + R(c (y - origin)) / c

with the potentials V and the frozen dissipation R: its stationarity is the equation of the step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.conjugate import NewtonStep
from ddgcli.mechanics.admissible import admissible_start, collision_free_fraction
from ddgcli.mechanics.directions import Directions
from ddgcli.mechanics.increment import Increment, Point, worst_vertex
from ddgcli.mechanics.objective import MOVE_TOLERANCE, Objective
from ddgcli.mechanics.system import System
from ddgcli.simulation.model import Cause, StepRejected

ACCELERATION_TOLERANCE = 1e-8  # relative error of the acceleration below which no iteration is needed
ROUNDED_SPACINGS = 2.0  # smallest tolerance of a move, in spacings of floats at the largest coordinate
HALF_ULP = 0.25 * float(np.finfo(float).eps)  # relative move that does not change a float
SHORT_STEP_FRACTION = 1e-3  # fraction of a move below which the line search has cut it
MAX_SHORT_STEPS = 10  # largest number of such moves
MAX_BALANCE_MOVES = 4  # further moves for the balance of momentum, once moves are short enough
# a stiff sheet at an impact needs many iterations, and halving the step does not reduce them
MAX_NEWTON_ITERATIONS = 300


def first_guess(
    system: System, increment: Increment, x: NDArray, guesses: Sequence[NDArray], since: float
) -> Point:
    """The guess with the least value among those that no barrier separates from `x`; else `x`.

    Parameters
    ----------
    system : System
        The system at the end of the step.
    increment : Increment
    x : (n, 3) ndarray of float64
        Positions at the start of the step, at the time `since`; see `admissible_start`.
    guesses : sequence of (n, 3) ndarray of float64
    since : float
        In s.

    Returns
    -------
    Point

    Raises
    ------
    StepRejected
        If a barrier prevents a vertex from reaching its position.
    """
    x = admissible_start(system, x, since)
    objective = Objective(system)
    if objective.is_linear(increment):  # one solve leads from any guess to the minimiser
        return Point(system.fixed_as(x, guesses[0]), 0.0, 0.0)
    points = []
    for guess in guesses:
        move = system.only_free(guess - x)
        if collision_free_fraction(system, x, move) == 1.0:
            points.append(objective.at(increment, x + move))
    return min(points, key=lambda point: point.value) if points else objective.at(increment, x)


def minimise(system: System, increment: Increment, guess: Point) -> tuple[NDArray, int]:
    """Minimiser of the incremental potential near a guess; it depends only on the arguments.

    Parameters
    ----------
    system : System
    increment : Increment
    guess : Point
        Inside every barrier.

    Returns
    -------
    (n, 3) ndarray of float64
    int
        Number of iterations.

    Raises
    ------
    StepRejected
        If it does not converge, with the vertex of the largest residual.
    """
    objective = Objective(system)
    if objective.is_linear(increment):
        return objective.constant.minimiser(system, increment.a, increment.target, guess.y), 1
    return _Newton(objective, increment).minimiser(guess)


def is_significant(system: System, increment: Increment, y: NDArray, change: NDArray) -> bool:
    """Whether a change of the forces moves a minimiser by more than Newton's method resolves.

    Parameters
    ----------
    system : System
    increment : Increment
    y : (n, 3) ndarray of float64
        The minimiser.
    change : (n, 3) ndarray of float64
        Change of the forces, in N.

    Returns
    -------
    bool
    """
    return not _Newton(Objective(system), increment).is_settled(y, system.only_free(change))


class _Newton:
    """Newton's method for one implicit step."""

    def __init__(self, objective: Objective, increment: Increment) -> None:
        self._objective, self._increment, self._system = objective, increment, objective.system
        self._directions = Directions(objective, increment)

    def minimiser(self, guess: Point) -> tuple[NDArray, int]:
        """The minimiser near `guess`, and the number of iterations."""
        # far from the origin, rounding of the positions causes moves of the spacing of floats
        spacing = float(np.spacing(np.abs(guess.y).max()))
        tolerance = max(MOVE_TOLERANCE * self._system.size, ROUNDED_SPACINGS * spacing)
        # length of the last full move; number of moves that the line search cut; of further short moves
        point, before, n_cut, n_further = guess, np.inf, 0, 0
        for iteration in range(1, MAX_NEWTON_ITERATIONS + 1):
            g = self._finite_gradient(point)
            if n_further:
                point, g = self._translated(point, g)
            if self._is_end(point.y, g, n_further):
                return point.y, iteration - 1
            exact = 0.1 * (self._significant_move(point.y) if n_further else tolerance)
            direction = self._directions.at(point.y, g, before, exact)
            move = self._objective.scatter(direction.x)
            short = direction.convex and max(float(np.abs(move).max()), direction.error) <= tolerance
            if short and collision_free_fraction(self._system, point.y, move) == 1.0:
                # without a line search, because values differ only by rounding after so short a move
                point, n_further = self._objective.at(self._increment, point.y + move), n_further + 1
                continue
            t, point, move, direction = self._searched(point, g, move, direction)
            size = float(np.abs(move).max())
            if t == 0.0 and size > tolerance:
                raise StepRejected("line search", worst_vertex(g), float(np.abs(g).max()))
            n_cut += t < SHORT_STEP_FRACTION
            if n_cut > MAX_SHORT_STEPS:
                break
            # assume that the next move shrinks at the rate of this one; near the end Newton's is faster
            quick = direction.convex and t == 1.0 and size < before < np.inf
            following = max(size * size / before, direction.error) if quick else size * max(t, 1e-3)
            before = size if t == 1.0 else np.inf
            n_further = n_further + 1 if following <= tolerance else 0
        raise StepRejected("newton", worst_vertex(g), size)

    def _finite_gradient(self, point: Point) -> NDArray:
        g = self._objective.gradient(self._increment, point.y)
        if not np.isfinite(point.value) or not np.isfinite(g).all():
            raise StepRejected(Cause.NOT_FINITE, worst_vertex(g))
        return g

    def _searched(
        self, point: Point, g: NDArray, move: NDArray, direction: NewtonStep
    ) -> tuple[float, Point, NDArray, NewtonStep]:
        """Fraction of the move, its end, and the move and direction.

        Move and direction are those of the projected Hessian if no fraction of the given move descends.
        """
        objective, increment = self._objective, self._increment
        t, end = objective.search(increment, point, move, float(np.vdot(g, move)))
        if t == 1.0 and not direction.convex:
            end = objective.further(increment, end, move)
        if t == 0.0:
            direction = self._directions.projected(point.y, g)
            move = objective.scatter(direction.x)
            t, end = objective.search(increment, point, move, float(np.vdot(g, move)))
        return t, end, move, direction

    def _is_end(self, y: NDArray, g: NDArray, n_further: int) -> bool:
        """Whether the iteration has converged, `n_further` moves after they became short enough."""
        if self.is_settled(y, g) or n_further > MAX_BALANCE_MOVES:
            return True
        return n_further > 0 and float(np.abs(self._imbalance(g)).max()) <= self._significant_move(y)

    def is_settled(self, y: NDArray, g: NDArray) -> bool:
        """Whether inertia alone bounds the next move by the tolerance.

        The residual is an error of the acceleration, so it is compared with the displacement due to the
        acceleration in the step: errors within an absolute bound would add up over many short steps.
        """
        left = float((np.abs(g) / (self._increment.a * self._system.mass[:, None])).max())
        return left <= min(1e-3 * MOVE_TOLERANCE * self._system.size, self._significant_move(y))

    def _significant_move(self, y: NDArray) -> float:
        """Tolerance of moves: a fraction of the displacement by the acceleration in the step, or rounding."""
        moved = self._system.only_free(y - self._increment.target)
        return max(ACCELERATION_TOLERANCE * float(np.abs(moved).max()), HALF_ULP * float(np.abs(y).max()))

    def _imbalance(self, g: NDArray) -> NDArray:
        """(3,) translation whose inertia balances the sum of the forces; 0 along axes that are all fixed."""
        mass = self._system.mass @ self._system.free
        return np.divide(-g.sum(axis=0), self._increment.a * mass, out=np.zeros(3), where=mass > 0)

    def _translated(self, point: Point, g: NDArray) -> tuple[Point, NDArray]:
        """The point after the translation that balances the momentum, and the gradient there.

        Along a translation the Hessian is inertia alone, unless the object is held. In a solve it is added to
        the stiffness: if that is 1e12 times the inertia (a strip of needles), rounding leaves an arbitrary
        part of the imbalance, which depends on the processor. The sum of the gradient does not suffer from
        this cancellation, because the forces of each element sum to zero up to their own rounding. A
        translation that does not halve the imbalance (because of pins or contact) is not applied.
        """
        left = self._imbalance(g)
        if float(np.abs(left).max()) <= self._significant_move(point.y):
            return point, g
        move = self._system.only_free(np.broadcast_to(left, point.y.shape))
        if collision_free_fraction(self._system, point.y, move) < 1.0:
            return point, g
        moved = point.y + move
        gradient = self._objective.gradient(self._increment, moved)
        if not np.abs(self._imbalance(gradient)).max() <= 0.5 * np.abs(left).max():
            return point, g
        return self._objective.at(self._increment, moved), gradient
