"""Loads beside the rounding of elastic forces, which hides smaller ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import System

MAX_UNBALANCED = 0.1  # of the largest load on a vertex: what an equilibrium may leave without a warning


def largest_load(system: System, x: NDArray) -> float:
    """Largest component of the loads on a vertex in N, where it may move.

    Parameters
    ----------
    system : System
        At the time of the loads.
    x : (n, 3) ndarray
        Positions in m.

    Returns
    -------
    float
    """
    loads = [potential.gradient(x) for potential in system.potentials if potential.scaled is not None]
    return float(np.abs(system.only_free(np.sum([np.zeros_like(x), *loads], axis=0))).max())


def force_rounding(system: System) -> float:
    """Elastic force on a vertex that rounded positions give: nothing moves by less.

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
    """Advice for loads of which too much is left: they are to be larger.

    Parameters
    ----------
    largest : float
        Largest load on a vertex in N.
    left : float
        Force in N that no load balances.

    Returns
    -------
    str
    """
    return f"apply loads {left / (MAX_UNBALANCED * largest):.1g} times as large"
