"""Quasi-Newton moves (limited-memory BFGS) that start from a factorised Hessian."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.secant import secant_solve

MAX_SECANTS = 8
# ratio to the last move up to which quasi-Newton moves cost less than a move with a new Hessian
MAX_SECANT_RATIO = 0.8


class Secants:
    """Moves and gradient changes for limited-memory BFGS in one step; a new factorisation discards them.

    J. Nocedal, S. Wright, "Numerical optimization", 2006, section 7.2.
    """

    def __init__(self) -> None:
        self._pairs: list[tuple[NDArray, NDArray]] = []
        self._last: tuple[NDArray, NDArray] | None = None

    def add(self, y: NDArray, g: NDArray) -> None:
        """Add positions and the gradient there, as vectors over the unknowns."""
        if self._last is not None:
            move, change = y - self._last[0], g - self._last[1]
            if float(move @ change) > 0:
                self._pairs = [*self._pairs, (move, change)][-MAX_SECANTS:]
        self._last = y, g

    def restart(self) -> None:
        """Keep the last point only."""
        self._pairs = []

    def solve(self, rhs: NDArray, precondition: Callable[[NDArray], NDArray]) -> NDArray[np.float64]:
        """Approximate solution with the Hessian, given solves with a nearby positive definite matrix."""
        return secant_solve(rhs, self._pairs, precondition)
