"""Implicit steps as minimisations: Newton's iteration with line search.

Every scheme needs the minimiser y of

    a/2 |y - target|_M^2 + V(y) + R(c (y - origin)) / c,

V the potentials and R the frozen dissipation: its stationarity is the equation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.conjugate import NewtonStep
from ddgcli.mechanics.admissible import admissible_start, longest_fraction
from ddgcli.mechanics.directions import Directions
from ddgcli.mechanics.increment import Increment, Point, worst
from ddgcli.mechanics.objective import MOVE_TOLERANCE, Objective
from ddgcli.mechanics.system import System
from ddgcli.simulation.model import Cause, StepRejected

# a first guess whose acceleration misses no more than this part needs no iteration
ACCELERATION_TOLERANCE = 1e-8
ROUNDED_SPACINGS = 2.0
HALF_ULP = 0.25 * float(np.finfo(float).eps)  # a move that changes no digit
# moves of which the line search leaves less than that part, and how many may be
SHORT_STEP_FRACTION, MAX_SHORT_STEPS = 1e-3, 10
MAX_BALANCE_MOVES = 4  # further moves for the balance of momentum, once moves are short enough
# a stiff sheet that has struck something needs many, and halves of the step no fewer
MAX_NEWTON_ITERATIONS = 300


def first_guess(
    system: System, increment: Increment, x: NDArray, guesses: Sequence[NDArray], since: float
) -> Point:
    """The guess of least value among those that no barrier separates from `x`; else `x`.

    Parameters
    ----------
    system : System
        At the end of the step.
    increment : Increment
    x : (n, 3) ndarray of float64
        Positions at the start of the step, at the time `since`; see `admissible_start`.
    guesses : sequence of (n, 3) ndarray of float64
    since : float
        s.

    Returns
    -------
    Point

    Raises
    ------
    StepRejected
        Where a barrier keeps a vertex from its place.
    """
    x = admissible_start(system, x, since)
    objective = Objective(system)
    if objective.is_linear(increment):  # one solve leads from any guess to the same place
        return Point(system.fixed_as(x, guesses[0]), 0.0, 0.0)
    points = []
    for guess in guesses:
        move = system.only_free(guess - x)
        if longest_fraction(system, x, move) == 1.0:
            points.append(objective.at(increment, x + move))
    return min(points, key=lambda point: point.value) if points else objective.at(increment, x)


def minimise(system: System, increment: Increment, guess: Point) -> tuple[NDArray, int]:
    """The minimiser near a guess; it depends only on the arguments.

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
        Iterations.

    Raises
    ------
    StepRejected
        No convergence, with the vertex of the largest residual.
    """
    objective = Objective(system)
    if objective.is_linear(increment):
        return objective.constant.minimiser(system, increment.a, increment.target, guess.y), 1
    return _Newton(objective, increment).minimiser(guess)


def is_resolved(system: System, increment: Increment, y: NDArray, change: NDArray) -> bool:
    """Whether a change of the forces moves a minimiser by more than the iteration leaves.

    Parameters
    ----------
    system : System
    increment : Increment
    y : (n, 3) ndarray of float64
        The minimiser.
    change : (n, 3) ndarray of float64
        Of the forces, in N.

    Returns
    -------
    bool
    """
    return not _Newton(Objective(system), increment).is_settled(y, system.only_free(change))


class _Newton:
    """Newton's iteration in one implicit step."""

    def __init__(self, objective: Objective, increment: Increment) -> None:
        self._objective, self._increment, self._system = objective, increment, objective.system
        self._directions = Directions(objective, increment)

    def minimiser(self, guess: Point) -> tuple[NDArray, int]:
        """The minimiser near `guess`, and the iterations."""
        # far from the origin, moves of the spacing of numbers there come from rounded positions
        spacing = float(np.spacing(np.abs(guess.y).max()))
        enough = max(MOVE_TOLERANCE * self._system.size, ROUNDED_SPACINGS * spacing)
        # length of the last whole move; moves that the line search cut; further moves since they are short
        point, before, n_cut, n_further = guess, np.inf, 0, 0
        for iteration in range(1, MAX_NEWTON_ITERATIONS + 1):
            g = self._finite_gradient(point)
            if n_further:
                point, g = self._translated(point, g)
            if self._is_end(point.y, g, n_further):
                return point.y, iteration - 1
            exact = 0.1 * (self._significant_move(point.y) if n_further else enough)
            direction = self._directions.at(point.y, g, before, exact)
            move = self._objective.spread(direction.x)
            short = direction.convex and max(float(np.abs(move).max()), direction.error) <= enough
            if short and longest_fraction(self._system, point.y, move) == 1.0:
                # too short for values to judge: they differ by rounding
                point, n_further = self._objective.at(self._increment, point.y + move), n_further + 1
                continue
            t, point, move, direction = self._searched(point, g, move, direction)
            size = float(np.abs(move).max())
            if t == 0.0 and size > enough:
                raise StepRejected("line search", worst(g), float(np.abs(g).max()))
            n_cut += t < SHORT_STEP_FRACTION
            if n_cut > MAX_SHORT_STEPS:
                break
            # the next move is to this one as this one to the last: near the end, Newton does better than that
            quick = direction.convex and t == 1.0 and size < before < np.inf
            following = max(size * size / before, direction.error) if quick else size * max(t, 1e-3)
            before = size if t == 1.0 else np.inf
            n_further = n_further + 1 if following <= enough else 0
        raise StepRejected("newton", worst(g), size)

    def _finite_gradient(self, point: Point) -> NDArray:
        g = self._objective.gradient(self._increment, point.y)
        if not np.isfinite(point.value) or not np.isfinite(g).all():
            raise StepRejected(Cause.NOT_FINITE, worst(g))
        return g

    def _searched(
        self, point: Point, g: NDArray, move: NDArray, direction: NewtonStep
    ) -> tuple[float, Point, NDArray, NewtonStep]:
        """Fraction of the move, its end, and the move and direction taken.

        Those of the projected Hessian where no fraction of the first move descends.
        """
        objective, increment = self._objective, self._increment
        t, end = objective.search(increment, point, move, float(np.vdot(g, move)))
        if t == 1.0 and not direction.convex:
            end = objective.further(increment, end, move)
        if t == 0.0:
            direction = self._directions.projected(point.y, g)
            move = objective.spread(direction.x)
            t, end = objective.search(increment, point, move, float(np.vdot(g, move)))
        return t, end, move, direction

    def _is_end(self, y: NDArray, g: NDArray, n_further: int) -> bool:
        """Whether the iteration has converged, `n_further` moves after they are short enough."""
        if self.is_settled(y, g) or n_further > MAX_BALANCE_MOVES:
            return True
        return n_further > 0 and float(np.abs(self._imbalance(g)).max()) <= self._significant_move(y)

    def is_settled(self, y: NDArray, g: NDArray) -> bool:
        """Whether inertia alone already bounds the next move.

        What a step leaves undone is an error of the acceleration, so it is measured by what the acceleration
        moves in the step: an absolute bound would add up to any error in enough short steps.
        """
        left = float((np.abs(g) / (self._increment.a * self._system.mass[:, None])).max())
        return left <= min(1e-3 * MOVE_TOLERANCE * self._system.size, self._significant_move(y))

    def _significant_move(self, y: NDArray) -> float:
        """The fraction that counts of what the acceleration moves in the step; at least rounding."""
        moved = self._system.only_free(y - self._increment.target)
        return max(ACCELERATION_TOLERANCE * float(np.abs(moved).max()), HALF_ULP * float(np.abs(y).max()))

    def _imbalance(self, g: NDArray) -> NDArray:
        """(3,) translation whose inertia balances the sum of the forces; 0 along axes fixed everywhere."""
        mass = self._system.mass @ self._system.free
        return np.divide(-g.sum(axis=0), self._increment.a * mass, out=np.zeros(3), where=mass > 0)

    def _translated(self, point: Point, g: NDArray) -> tuple[Point, NDArray]:
        """The point moved by the translation that balances the momentum, and the gradient there.

        The Hessian along a translation is inertia alone unless something outside holds the object, but a
        solve sees it beside the stiffness: where that is 1e12 times inertia (a strip of needles) rounding
        leaves an arbitrary part of the imbalance, which depends on the processor. The sum of the gradient has
        no such cancellation, because the forces of each element sum to zero up to their own rounding. A
        translation that does not halve the imbalance (pins, contact) is not taken.
        """
        left = self._imbalance(g)
        if float(np.abs(left).max()) <= self._significant_move(point.y):
            return point, g
        move = self._system.only_free(np.broadcast_to(left, point.y.shape))
        if longest_fraction(self._system, point.y, move) < 1.0:
            return point, g
        moved = point.y + move
        gradient = self._objective.gradient(self._increment, moved)
        if not np.abs(self._imbalance(gradient)).max() <= 0.5 * np.abs(left).max():
            return point, g
        return self._objective.at(self._increment, moved), gradient
