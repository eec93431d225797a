"""Parts that effects of a fluid declare before its space is assembled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Start = Callable[[Any], dict[str, NDArray[np.float64]]]


@dataclass(frozen=True)
class Initial:
    """A flow to begin with: arrays of the space's state; several add up."""

    make: Start


@dataclass(frozen=True)
class BoundaryPart:
    """One section of the effect `boundary`.

    Parameters
    ----------
    kind : {'free-slip', 'no-slip', 'wall', 'inflow', 'outflow'}
    velocity : three expressions, optional
        In x, y, z and t.
    flux : float or str, optional
        Leaves through an outflow [m^2/s; m^3/s in volumes]: a number, or an expression in t.
    where : str, optional
        Expression that is not 0 on its part of the boundary.
    obstacle : str, optional
        Name of the obstacle that cuts its part of the boundary.
    """

    kind: str
    velocity: list[str] | None = None
    flux: float | str | None = None
    where: str | None = None
    obstacle: str | None = None


@dataclass(frozen=True)
class Harmonic:
    """The flows without vorticity that a surface with handles or several boundaries has."""

    evolve: bool
