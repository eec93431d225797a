"""Equilibria: stationary points of the potentials, reached downhill with a shifted Hessian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.linalg.low_rank import negative_eigenvalues_of_sum
from ddgcli.mechanics.admissible import longest_fraction
from ddgcli.mechanics.increment import Increment, Point, worst
from ddgcli.mechanics.objective import MOVE_TOLERANCE, Objective
from ddgcli.mechanics.rigid_motions import moves_freely, unsupported_fields
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode
from ddgcli.mechanics.turning import turned
from ddgcli.simulation.model import Cause, StepRejected

MAX_EQUILIBRIUM_ITERATIONS = 2000
MAX_CONTRACTION = 0.5  # of a move, what a whole one may leave where energies do not judge it
MAX_SHIFT = 1e12  # of the first shift
# sizes of the object: what moves farther has no rest, nor have nearly all halves of its step
MAX_TRAVEL, HALVINGS_AFTER_TRAVEL = 1e4, 3
BALANCE_TOLERANCE = 1e-8  # what may be left of the largest force on a vertex
# further moves for the balance, each with that part of the shift of the one before; and what is none
MAX_BALANCE_MOVES, SHIFT_CUT, NO_SHIFT = 8, 1e-3, 1e-12
# iterations before which moves through large rotations are tried, from that part of the first shift
TURNS_AT, TURN_SHIFT = (16, 64, 256, 1024), 1e-6
INERTIA_ROUNDING = 16 * float(np.finfo(float).eps)  # of the Hessian's norm


class Equilibrium:
    """Levenberg's iteration: the Hessian plus a multiple of the masses, less of it as the steps succeed."""

    def __init__(self, system: System) -> None:
        self.system, self.objective, self._moves_freely = system, Objective(system), False

    def find(self, start: NDArray) -> tuple[NDArray, int]:
        """The equilibrium downhill from `start`, and the iterations.

        Raises
        ------
        StepRejected
            No convergence, with the vertex of the largest residual; or no bound of the energy within reach.
        """
        objective, increment = self.objective, Increment(0.0, start)
        enough = MOVE_TOLERANCE * self.system.size
        point, before = objective.at(increment, start), np.inf
        unit, self._moves_freely = self._unit(increment, start), moves_freely(self.system, start)
        shift, exact_allowed, near, imbalance, moves = unit, False, 0, np.inf, 0
        for iteration in range(1, MAX_EQUILIBRIUM_ITERATIONS + 1):
            if iteration in TURNS_AT:
                end, count = turned(objective, point, TURN_SHIFT * unit)
                moves += count
                if end is not None and unstable_directions(self.system, end.y) == 0:
                    point, shift, exact_allowed, before = end, NO_SHIFT * unit, True, np.inf
            g = self._gradient(increment, point, start)
            try:
                move, exact_used = self._direction(increment, point.y, g, exact_allowed, shift)
            except SolveError as error:
                # what nothing holds moves freely: where the shift is lost in rounding, the matrix is singular
                if shift >= MAX_SHIFT * unit:
                    raise StepRejected("singular", worst(g)) from error
                shift, exact_allowed = max(10 * shift, unit), False
                continue
            except StepRejected:
                rounding = self._is_rounding(increment, point.y, g)
                if rounding or self._imbalance(increment, point.y) <= BALANCE_TOLERANCE:
                    return point.y, iteration + moves  # what is left has the direction of rounding
                raise
            size = float(np.abs(move).max())
            t, point = self._searched(increment, point, move, g, exact_used)
            if t == 0.0 and size > enough:
                if shift >= MAX_SHIFT * unit:
                    raise StepRejected("line search", worst(g), float(np.abs(g).max()))
                shift, exact_allowed = max(10 * shift, unit), False
                continue
            shift = shift / 10 if t == 1.0 else shift * (1.0 if t > 0.1 else 4.0)
            exact_allowed = shift < 1e-3 * unit and t == 1.0
            quick = exact_used and t == 1.0 and size < before < np.inf
            following = max(size * size / before if quick else size, objective.solver(increment).error * size)
            before = size if t == 1.0 else np.inf
            if following <= enough:
                missing, imbalance = imbalance, self._imbalance(increment, point.y)
                rounded = imbalance > MAX_CONTRACTION * missing and shift < NO_SHIFT * unit
                if imbalance <= BALANCE_TOLERANCE or rounded or near == MAX_BALANCE_MOVES:
                    return point.y, iteration + moves
                # short because of the shift, where the shell is soft; or long beside a small displacement
                near, shift, exact_allowed, before = near + 1, SHIFT_CUT * shift, True, np.inf
        raise StepRejected("newton", worst(g), size)

    def _gradient(self, increment: Increment, point: Point, start: NDArray) -> NDArray[np.float64]:
        """The gradient at a point.

        Raises
        ------
        StepRejected
            It is not finite, or the point is too far from the start.
        """
        g = self.objective.gradient(increment, point.y)
        if not np.isfinite(point.value) or not np.isfinite(g).all():
            raise StepRejected(Cause.NOT_FINITE, worst(g))
        self._check_travel(point.y - start)
        return g

    def _searched(
        self, increment: Increment, point: Point, move: NDArray, g: NDArray, exact: bool
    ) -> tuple[float, Point]:
        """Share of a move that a line search takes, and the point there; all of exact moves that contract."""
        t, end = self.objective.search(increment, point, move, float(np.vdot(g, move)))
        if t < 1.0 and exact and self._contracts(increment, point.y, move):
            return 1.0, self.objective.at(increment, point.y + move)
        return t, end

    def _imbalance(self, increment: Increment, y: NDArray) -> float:
        """The largest force on a free vertex, over the largest of a single term on any vertex."""
        terms = self.system.potentials
        largest = max((float(np.abs(term.gradient(y)).max(initial=0.0)) for term in terms), default=0.0)
        left = float(np.abs(self.objective.gradient(increment, y)).max(initial=0.0))
        return left / largest if left > 0 else 0.0

    def _is_rounding(self, increment: Increment, y: NDArray, g: NDArray) -> bool:
        """Whether rounding of its position makes the force on every vertex, as of a shell without loads."""
        stiffness = self.objective.spread(self.objective.hessian(increment, y, "projected").diagonal())
        largest = self.system.rounding.length * stiffness.sum(axis=1, keepdims=True)
        return bool((np.abs(g) <= largest).all())

    def _check_travel(self, moved: NDArray) -> None:
        farthest = float(np.abs(moved).max())
        if farthest > MAX_TRAVEL * self.system.size:
            raise StepRejected("motion without bound", worst(moved), farthest, halvings=HALVINGS_AFTER_TRAVEL)

    def _contracts(self, increment: Increment, y: NDArray, move: NDArray) -> bool:
        """Whether the whole move leaves less than half of it to do, by the factorisation that made it.

        Near an equilibrium the energies of two points differ by rounding, and cannot judge a move: the
        natural monotonicity test [P. Deuflhard, "Newton methods for nonlinear problems", 2004].
        """
        objective = self.objective
        if longest_fraction(self.system, y, move) < 1.0:
            return False
        g = objective.gradient(increment, y + move)
        if not np.isfinite(g).all():
            return False
        with self.system.account.within("solver"):
            try:
                left = objective.spread(objective.solver(increment).solve(objective.entries(-g)))
            except SolveError:
                return False
        return float(np.abs(left).max()) <= MAX_CONTRACTION * float(np.abs(move).max())

    def _unit(self, increment: Increment, y: NDArray) -> float:
        """First shift, per mass: a fraction of the system's own stiffness."""
        matrix = self.objective.hessian(increment, y, "projected")
        return 1e-6 * float(matrix.diagonal().sum()) / (3 * float(self.system.mass.sum()))

    def _direction(
        self, increment: Increment, y: NDArray, g: NDArray, exact_allowed: bool, shift: float
    ) -> tuple[NDArray, bool]:
        """Descent direction: with the exact Hessian where that descends, else with the projected one."""
        modes: tuple[Mode, ...] = ("exact", "projected") if exact_allowed else ("projected",)
        solver = self.objective.solver(increment)
        for mode in modes:
            matrix = self.objective.hessian(increment, y, mode, shift)
            with self.system.account.within("solver"):
                try:
                    solver.factorise(self.system, matrix, y, self.objective.columns(y))
                    move = self.objective.spread(solver.solve(self.objective.entries(-g)))
                    move = self._without_free_motion(y, move) if mode == "exact" else move
                except SolveError:
                    if mode == "exact":
                        continue
                    raise
            downhill = float(np.vdot(g, move))
            if np.isfinite(downhill) and downhill <= 0:
                return move, mode == "exact"
        raise StepRejected("no descent", worst(g), float(np.abs(g).max()))

    def _without_free_motion(self, y: NDArray, move: NDArray) -> NDArray:
        """A move less the rigid motions that nothing resists: rounding over the shift, without bound."""
        if not self._moves_freely:
            return move
        fields = unsupported_fields(self.system, y).reshape(move.size, -1)
        root = np.sqrt(np.repeat(self.system.mass, 3))
        motion = np.linalg.lstsq(root[:, None] * fields, root * move.ravel(), rcond=None)[0]
        return move - self.system.only_free((fields @ motion).reshape(move.shape))


def unstable_directions(system: System, x: NDArray) -> int | None:
    """Number of negative eigenvalues of the exact Hessian at an equilibrium.

    0 at a minimum; more at a saddle point, which a disturbance leaves. Rounding moves the forces by eps of
    the stiffness, and the stress by eps max |x| over the length of an edge: eigenvalues within that count as
    zero (the rigid motions of what nothing holds).

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    int or None
        None where the factorisation fails or does not fit into memory.
    """
    objective, increment = Objective(system), Increment(0.0, x)
    if objective.solver(increment).by_blocks:
        return None  # its factors do not fit
    matrix = objective.hessian(increment, x, "exact")
    edges = np.sqrt(len(x)) * float(np.abs(x).max()) / system.size
    norm = float(abs(matrix).sum(axis=0).max(initial=0.0))
    below = INERTIA_ROUNDING * norm * (1 + edges)
    return negative_eigenvalues_of_sum(matrix, objective.columns(x), below)
