"""Descent directions of Newton's method in one implicit step, from as few factorisations as possible."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.linalg import low_rank
from ddgcli.linalg.conjugate import NewtonStep, truncated_conjugate_gradients
from ddgcli.mechanics.increment import Increment, worst_vertex
from ddgcli.mechanics.objective import Objective
from ddgcli.mechanics.secant import MAX_SECANT_RATIO, Secants
from ddgcli.simulation.model import StepRejected

MAX_CG_ROUNDS = 15  # iterations of conjugate gradients that cost about as much as a factorisation
MAX_CG_RESIDUAL = 0.1  # largest relative error of a move by conjugate gradients


class Directions:
    """Descent directions of one implicit step.

    A step factorises once, at its first guess: the projected Hessian, or the exact one in contact. Later
    moves are quasi-Newton moves with that factorisation, as long as they shrink fast enough. Otherwise they
    use the exact Hessian: by conjugate gradients preconditioned by that factorisation, as accurate as needed,
    or by a new factorisation after too many iterations.
    """

    def __init__(self, objective: Objective, increment: Increment) -> None:
        self._objective, self._increment = objective, increment
        self._system, self._solver = objective.system, objective.solver(increment)
        self._has_factor = False  # whether this step has factorised
        self._secants = Secants()

    def at(self, y: NDArray, g: NDArray, before: float, least: float) -> NewtonStep:
        """Direction at the positions y with the gradient g.

        Parameters
        ----------
        y, g : (n, 3) ndarray of float64
        before : float
            Length of the last move; infinite if the line search shortened it, or for the first move.
        least : float
            Sufficient accuracy of a direction.

        Returns
        -------
        NewtonStep
            Direction over the unknowns of the Hessian.

        Raises
        ------
        StepRejected
            If the projected Hessian is singular.
        """
        gather = self._objective.gather
        in_contact = self._in_contact(y)
        if not self._has_factor and not in_contact:
            # the projected Hessian costs half of the exact one, and always factorises
            first = self.projected(y, g).x
            self._secants.add(gather(y), gather(g))
            return NewtonStep(first, float(np.abs(self._objective.scatter(first)).max()), 0, True)
        # in contact a move costs a search for contacts, more than a Hessian
        if self._has_factor and not in_contact:
            quick = self._by_secants(y, g, before)
            if quick is not None:
                return quick
        return self._by_exact_hessian(y, g, before, least)

    def projected(self, y: NDArray, g: NDArray) -> NewtonStep:
        """Descent direction of the projected Hessian, which is positive definite."""
        self._factorise_projected(y, g)
        with self._system.account.within("solver"):
            return NewtonStep(self._precondition(self._objective.gather(-g)), 0.0, 0, False)

    def _by_secants(self, y: NDArray, g: NDArray, before: float) -> NewtonStep | None:
        """Direction from the current factorisation and past moves; None if it shrinks too slowly."""
        rhs = self._objective.gather(-g)
        self._secants.add(self._objective.gather(y), -rhs)
        if not before < np.inf:
            return None
        with self._system.account.within("solver"):
            step = self._secants.solve(rhs, self._precondition)
        size = float(np.abs(self._objective.scatter(step)).max())
        if not size <= MAX_SECANT_RATIO * before or not float(rhs @ step) > 0:
            return None
        # the error is the whole move: extrapolating the ratio of two lengths would be too optimistic
        return NewtonStep(step, size, 0, True)

    def _by_exact_hessian(self, y: NDArray, g: NDArray, before: float, least: float) -> NewtonStep:
        objective = self._objective
        matrix = objective.hessian(self._increment, y, "exact", keep_factor=self._has_factor)
        rhs, columns = objective.gather(-g), objective.columns(y)
        if not self._has_factor:
            self._secants.add(objective.gather(y), -rhs)
            step = self._solution(y, matrix, columns, rhs)
            if step is not None:
                error = self._solver.error * float(np.abs(step).max(initial=0.0))
                return NewtonStep(step, error, 0, True)
            self._factorise_projected(y, g)
        with self._system.account.within("solver"):
            direction = truncated_conjugate_gradients(
                low_rank.product(matrix.__matmul__, columns), self._precondition, rhs,
                lambda first: max(min(MAX_CG_RESIDUAL, first / before) * first, least), MAX_CG_ROUNDS,
                # near the end a stationary point is a solution, whether or not it could buckle
                continue_past=lambda first: first < MAX_CG_RESIDUAL * before < np.inf,
            )  # fmt: skip
        if direction is None:
            return self.projected(y, g)
        self._has_factor = direction.rounds < MAX_CG_ROUNDS
        return direction

    def _in_contact(self, y: NDArray) -> bool:
        return any(barrier.energy(y) for barrier in self._system.barriers)

    def _solution(self, y: NDArray, matrix: Any, columns: NDArray | None, rhs: NDArray) -> NDArray | None:
        """Solution with a new factorisation; None if the matrix is not positive definite."""
        with self._system.account.within("solver"):
            try:
                self._factorise(matrix, y, columns)
                step = self._solver.solve(rhs)
            except SolveError:
                return None
            return step if float(rhs @ step) > 0 or not rhs.any() else None

    def _factorise_projected(self, y: NDArray, g: NDArray) -> None:
        matrix = self._objective.hessian(self._increment, y, "projected")
        with self._system.account.within("solver"):
            try:
                self._factorise(matrix, y, self._objective.columns(y))
            except SolveError as error:
                raise StepRejected("singular", worst_vertex(g)) from error

    def _factorise(self, matrix: Any, y: NDArray, columns: NDArray | None) -> None:
        self._has_factor = False
        self._solver.factorise(self._system, matrix, y, columns)
        self._has_factor = True
        self._secants.restart()

    def _precondition(self, rhs: NDArray) -> NDArray:
        try:
            return self._solver.solve(rhs)
        except SolveError as error:
            raise StepRejected(str(error)) from error
