"""A standard semi-Lagrangian solver: velocities carried as vectors, then projected (J. Stam, 1999).

A peer for the integrators: it uses the same operators, so that only the schemes differ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import Transport


class SemiLagrangian:
    """Every face takes the velocity where its centre comes from; the nearest discrete flow is kept."""

    def __init__(self, space: SurfaceSpace) -> None:
        self.space, self.transport = space, Transport(space)
        self.third = np.full((len(space.faces), 3), 1.0 / 3.0)

    def step(self, vorticity: NDArray, coefficients: NDArray, dt: float) -> tuple[NDArray, NDArray]:
        """Vorticity and harmonic coefficients after dt."""
        space = self.space
        corner = self.transport.corners(space.side_flux(space.stream_function(vorticity), coefficients))
        paths = self.transport.backwards(corner, np.arange(len(corner)), self.third, dt)
        return space.of_face_velocity(self.transport.end_velocity(corner, paths))
