"""The incremental potential, which an implicit step minimises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import Potential

MIN_CUT, MAX_CUT = 0.1, 0.5  # bounds of the next fraction of a move over the last one, in a line search


@dataclass(frozen=True, eq=False)
class Increment:
    """Incremental potential a/2 |y - target|_M^2 + V(y) + R(c (y - origin)) / c of a step.

    C. Kane, J. E. Marsden, M. Ortiz, M. West, "Variational integrators and the Newmark algorithm for
    conservative and dissipative mechanical systems", 2000. M are the masses, V the potentials of the system
    and R the frozen dissipation.

    Parameters
    ----------
    a : float
        In 1/s^2; 0 for an equilibrium.
    target : (n, 3) ndarray
        Positions without forces at the end of the step, in m.
    c : float
        In 1/s: the velocity is c (y - origin).
    origin : (n, 3) ndarray, optional
        In m; needed with dissipation.
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
    """An iterate: positions, value of the incremental potential, and sum of its absolute terms."""

    y: NDArray
    value: float
    scale: float


def shorter_fraction(t: float, change: float, downhill: float) -> float:
    """The next fraction of a move in a backtracking line search.

    It is the minimum of the parabola with the slope at 0 and the change at t, limited to [0.1 t, 0.5 t].

    Parameters
    ----------
    t : float
        The last fraction.
    change : float
        Change of the value from 0 to t.
    downhill : float
        Slope at 0, negative.

    Returns
    -------
    float

    References
    ----------
    J. Nocedal, S. Wright, "Numerical optimization", 2006, section 3.5.
    """
    above = change - t * downhill  # value minus that of the tangent at 0
    least = -0.5 * downhill * t * t / above if np.isfinite(above) and above > 0 else 0.5 * t
    return min(max(least, MIN_CUT * t), MAX_CUT * t)


def worst_vertex(vectors: NDArray) -> str:
    """Name of the vertex with the largest vector, for messages.

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
