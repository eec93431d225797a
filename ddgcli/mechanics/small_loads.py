"""Comparison of loads with the rounding of elastic forces, which hides smaller loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import System

MAX_UNBALANCED = 0.1  # residual force over the largest load on a vertex, above which a warning is issued


def largest_load(system: System, x: NDArray) -> float:
    """Largest component of the load on a free coordinate, in N.

    Parameters
    ----------
    system : System
        The system at the time of the loads.
    x : (n, 3) ndarray
        Positions in m.

    Returns
    -------
    float
    """
    loads = [potential.gradient(x) for potential in system.potentials if potential.scaled is not None]
    return float(np.abs(system.only_free(np.sum([np.zeros_like(x), *loads], axis=0))).max())


def force_rounding(system: System) -> float:
    """Elastic force on a vertex due to rounding of the positions; smaller loads have no effect.

    Parameters
    ----------
    system : System

    Returns
    -------
    float
        In N.
    """
    rounding = system.rounding
    return rounding.length * rounding.stiffness / len(system.start)


def larger_loads(largest: float, left: float) -> str:
    """Advice to apply larger loads, whose residual is then small enough.

    Parameters
    ----------
    largest : float
        Largest load on a vertex in N.
    left : float
        Residual force in N.

    Returns
    -------
    str
    """
    return f"apply loads {left / (MAX_UNBALANCED * largest):.1g} times as large"
