"""Equilibria: stationary points of the potential energy, by descent with a shifted Hessian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.linalg.low_rank import negative_eigenvalues_of_sum
from ddgcli.mechanics.admissible import collision_free_fraction
from ddgcli.mechanics.increment import Increment, Point, worst_vertex
from ddgcli.mechanics.objective import MOVE_TOLERANCE, Objective
from ddgcli.mechanics.rigid_motions import moves_freely, unsupported_fields
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode
from ddgcli.mechanics.turning import turned
from ddgcli.simulation.model import Cause, StepRejected

MAX_EQUILIBRIUM_ITERATIONS = 2000
MAX_CONTRACTION = 0.5  # ratio of the next move to a move that is accepted although its energy rises
MAX_SHIFT = 1e12  # over the first shift
MAX_TRAVEL = 1e4  # displacement over the object's size above which there is no equilibrium
HALVINGS_AFTER_TRAVEL = 3  # of a load step without an equilibrium: nearly all shorter steps have none either
BALANCE_TOLERANCE = 1e-8  # residual force over the largest force of a single term
MAX_BALANCE_MOVES = 8  # further moves that reduce the residual force, once moves are short enough
SHIFT_CUT = 1e-3  # factor on the shift in each of these moves
NO_SHIFT = 1e-12  # shift over the first shift below which it has no effect
TURNS_AT = (16, 64, 256, 1024)  # iterations before which moves through large rotations are tried
TURN_SHIFT = 1e-6  # shift of these moves over the first shift
INERTIA_ROUNDING = 16 * float(np.finfo(float).eps)  # rounding of eigenvalues over the norm of the Hessian


class Equilibrium:
    """Levenberg's method: Newton moves with the Hessian plus a multiple of the masses (the shift).

    The shift decreases as moves succeed.
    """

    def __init__(self, system: System) -> None:
        self.system, self.objective, self._moves_freely = system, Objective(system), False

    def find(self, start: NDArray) -> tuple[NDArray, int]:
        """Equilibrium reached by descent from `start`, and the number of iterations.

        Raises
        ------
        StepRejected
            If it does not converge, with the vertex of the largest residual; or if the motion has no bound.
        """
        objective, increment = self.objective, Increment(0.0, start)
        tolerance = MOVE_TOLERANCE * self.system.size
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
                # free rigid motions: with a shift below rounding the matrix is singular
                if shift >= MAX_SHIFT * unit:
                    raise StepRejected("singular", worst_vertex(g)) from error
                shift, exact_allowed = max(10 * shift, unit), False
                continue
            except StepRejected:
                rounding = self._is_rounding(increment, point.y, g)
                if rounding or self._imbalance(increment, point.y) <= BALANCE_TOLERANCE:
                    return point.y, iteration + moves  # the residual, and so its direction, is rounding
                raise
            size = float(np.abs(move).max())
            t, point = self._searched(increment, point, move, g, exact_used)
            if t == 0.0 and size > tolerance:
                if shift >= MAX_SHIFT * unit:
                    raise StepRejected("line search", worst_vertex(g), float(np.abs(g).max()))
                shift, exact_allowed = max(10 * shift, unit), False
                continue
            shift = shift / 10 if t == 1.0 else shift * (1.0 if t > 0.1 else 4.0)
            exact_allowed = shift < 1e-3 * unit and t == 1.0
            quick = exact_used and t == 1.0 and size < before < np.inf
            following = max(size * size / before if quick else size, objective.solver(increment).error * size)
            before = size if t == 1.0 else np.inf
            if following <= tolerance:
                previous_imbalance, imbalance = imbalance, self._imbalance(increment, point.y)
                rounded = imbalance > MAX_CONTRACTION * previous_imbalance and shift < NO_SHIFT * unit
                if imbalance <= BALANCE_TOLERANCE or rounded or near == MAX_BALANCE_MOVES:
                    return point.y, iteration + moves
                # the move may be short only because of the shift, or not small relative to the displacement
                near, shift, exact_allowed, before = near + 1, SHIFT_CUT * shift, True, np.inf
        raise StepRejected("newton", worst_vertex(g), size)

    def _gradient(self, increment: Increment, point: Point, start: NDArray) -> NDArray[np.float64]:
        """The gradient at a point.

        Raises
        ------
        StepRejected
            If it is not finite, or the point is too far from the start.
        """
        g = self.objective.gradient(increment, point.y)
        if not np.isfinite(point.value) or not np.isfinite(g).all():
            raise StepRejected(Cause.NOT_FINITE, worst_vertex(g))
        self._check_travel(point.y - start)
        return g

    def _searched(
        self, increment: Increment, point: Point, move: NDArray, g: NDArray, exact: bool
    ) -> tuple[float, Point]:
        """Fraction of a move by line search, and its end; 1 for exact moves that contract."""
        t, end = self.objective.search(increment, point, move, float(np.vdot(g, move)))
        if t < 1.0 and exact and self._contracts(increment, point.y, move):
            return 1.0, self.objective.at(increment, point.y + move)
        return t, end

    def _imbalance(self, increment: Increment, y: NDArray) -> float:
        """Largest force on a free vertex, over the largest force of a single term on any vertex."""
        terms = self.system.potentials
        largest = max((float(np.abs(term.gradient(y)).max(initial=0.0)) for term in terms), default=0.0)
        left = float(np.abs(self.objective.gradient(increment, y)).max(initial=0.0))
        return left / largest if left > 0 else 0.0

    def _is_rounding(self, increment: Increment, y: NDArray, g: NDArray) -> bool:
        """Whether rounding of the positions explains the force on every vertex, as without loads."""
        stiffness = self.objective.scatter(self.objective.hessian(increment, y, "projected").diagonal())
        largest = self.system.rounding.length * stiffness.sum(axis=1, keepdims=True)
        return bool((np.abs(g) <= largest).all())

    def _check_travel(self, moved: NDArray) -> None:
        farthest = float(np.abs(moved).max())
        if farthest > MAX_TRAVEL * self.system.size:
            vertex = worst_vertex(moved)
            raise StepRejected("motion without bound", vertex, farthest, halvings=HALVINGS_AFTER_TRAVEL)

    def _contracts(self, increment: Increment, y: NDArray, move: NDArray) -> bool:
        """Whether the next move, with the same factorisation, would be at most half as long as this one.

        Near an equilibrium energies differ only by rounding, so they cannot judge a move. This is the natural
        monotonicity test [P. Deuflhard, "Newton methods for nonlinear problems", 2004].
        """
        objective = self.objective
        if collision_free_fraction(self.system, y, move) < 1.0:
            return False
        g = objective.gradient(increment, y + move)
        if not np.isfinite(g).all():
            return False
        with self.system.account.within("solver"):
            try:
                left = objective.scatter(objective.solver(increment).solve(objective.gather(-g)))
            except SolveError:
                return False
        return float(np.abs(left).max()) <= MAX_CONTRACTION * float(np.abs(move).max())

    def _unit(self, increment: Increment, y: NDArray) -> float:
        """First shift (1/s^2): a fraction of the mean ratio of stiffness and mass."""
        matrix = self.objective.hessian(increment, y, "projected")
        return 1e-6 * float(matrix.diagonal().sum()) / (3 * float(self.system.mass.sum()))

    def _direction(
        self, increment: Increment, y: NDArray, g: NDArray, exact_allowed: bool, shift: float
    ) -> tuple[NDArray, bool]:
        """Descent direction of the exact Hessian if allowed and downhill, else of the projected one."""
        modes: tuple[Mode, ...] = ("exact", "projected") if exact_allowed else ("projected",)
        solver = self.objective.solver(increment)
        for mode in modes:
            matrix = self.objective.hessian(increment, y, mode, shift)
            with self.system.account.within("solver"):
                try:
                    solver.factorise(self.system, matrix, y, self.objective.columns(y))
                    move = self.objective.scatter(solver.solve(self.objective.gather(-g)))
                    move = self._without_free_motion(y, move) if mode == "exact" else move
                except SolveError:
                    if mode == "exact":
                        continue
                    raise
            downhill = float(np.vdot(g, move))
            if np.isfinite(downhill) and downhill <= 0:
                return move, mode == "exact"
        raise StepRejected("no descent", worst_vertex(g), float(np.abs(g).max()))

    def _without_free_motion(self, y: NDArray, move: NDArray) -> NDArray:
        """A move without free rigid motions, whose components are rounding divided by the shift."""
        if not self._moves_freely:
            return move
        fields = unsupported_fields(self.system, y).reshape(move.size, -1)
        root = np.sqrt(np.repeat(self.system.mass, 3))
        motion = np.linalg.lstsq(root[:, None] * fields, root * move.ravel(), rcond=None)[0]
        return move - self.system.only_free((fields @ motion).reshape(move.shape))


def unstable_directions(system: System, x: NDArray) -> int | None:
    """Number of negative eigenvalues of the exact Hessian at an equilibrium.

    It is 0 at a minimum, and positive at a saddle point, which is unstable. Eigenvalues within rounding count
    as zero, such as those of free rigid motions: rounding changes forces by eps times the stiffness, and the
    stress by eps max |x| over the length of an edge.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    int or None
        None if the factorisation fails or does not fit into memory.
    """
    objective, increment = Objective(system), Increment(0.0, x)
    if objective.solver(increment).by_blocks:
        return None  # factors do not fit into memory
    matrix = objective.hessian(increment, x, "exact")
    edges = np.sqrt(len(x)) * float(np.abs(x).max()) / system.size
    norm = float(abs(matrix).sum(axis=0).max(initial=0.0))
    below = INERTIA_ROUNDING * norm * (1 + edges)
    return negative_eigenvalues_of_sum(matrix, objective.columns(x), below)
