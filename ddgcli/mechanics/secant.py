"""Quasi-Newton moves: one factorisation of a Hessian, corrected by the moves since then."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.secant import secant_solve

MAX_SECANTS = 8
# of the last move: up to this length, a move by secants costs less than one by a new Hessian
MAX_SECANT_RATIO = 0.8


class Secants:
    """Limited-memory BFGS about a factorisation: J. Nocedal, S. Wright, "Numerical optimization", 2006, 7.2.

    The moves and changes of the gradient of one step; a new factorisation starts again.
    """

    def __init__(self) -> None:
        self._pairs: list[tuple[NDArray, NDArray]] = []
        self._last: tuple[NDArray, NDArray] | None = None

    def add(self, y: NDArray, g: NDArray) -> None:
        """Positions and the gradient there, as vectors of the unknowns."""
        if self._last is not None:
            move, change = y - self._last[0], g - self._last[1]
            if float(move @ change) > 0:
                self._pairs = [*self._pairs, (move, change)][-MAX_SECANTS:]
        self._last = y, g

    def restart(self) -> None:
        """Keep the last point only."""
        self._pairs = []

    def solve(self, rhs: NDArray, precondition: Callable[[NDArray], NDArray]) -> NDArray[np.float64]:
        """Approximate solution with the Hessian, by that with a nearby matrix, positive definite like it."""
        return secant_solve(rhs, self._pairs, precondition)
