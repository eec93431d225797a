"""What effects of a fluid say before its space is made; phases are `phases.Declared`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.surface_space import SurfaceSpace

Start = Callable[[SurfaceSpace], tuple[NDArray[np.float64], NDArray[np.float64]]]


@dataclass(frozen=True)
class Initial:
    """A flow to begin with: integrated vorticity (n,) and harmonic coefficients (b,); several add up."""

    make: Start


@dataclass(frozen=True, eq=False)
class Walls:
    """What the fluid meets at the boundary; `moving` (n,): circulation that a moving wall adds to cells."""

    no_slip: bool
    moving: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Harmonic:
    """The flows without vorticity that a surface with handles or several boundaries has."""

    evolve: bool
