"""The function that an implicit step minimises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import Potential

MIN_CUT, MAX_CUT = 0.1, 0.5  # of a fraction of a move, what the next one may be


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


@dataclass(frozen=True, eq=False)
class Point:
    """A place of the iteration: positions, the function's value there, and the size of its summands."""

    y: NDArray
    value: float
    scale: float


def shorter_fraction(t: float, change: float, downhill: float) -> float:
    """The next fraction of a move to try in a line search.

    Where the parabola with the slope at 0 and the change at t is least, between a tenth and a half of t.

    Parameters
    ----------
    t : float
        Fraction tried.
    change : float
        Of the value from 0 to t.
    downhill : float
        Slope at 0, negative.

    Returns
    -------
    float

    References
    ----------
    J. Nocedal, S. Wright, "Numerical optimization", 2006, section 3.5.
    """
    above = change - t * downhill  # of the value over the tangent
    least = -0.5 * downhill * t * t / above if np.isfinite(above) and above > 0 else 0.5 * t
    return min(max(least, MIN_CUT * t), MAX_CUT * t)


def worst(vectors: NDArray) -> str:
    """Name of the vertex with the largest residual, for messages.

    Parameters
    ----------
    vectors : (n, 3) ndarray of float64
        Residual forces, or moves.

    Returns
    -------
    str
    """
    with np.errstate(invalid="ignore"):
        size = np.abs(np.nan_to_num(vectors, nan=np.inf)).max(axis=1)
    return f"vertex {int(np.argmax(size))}"
