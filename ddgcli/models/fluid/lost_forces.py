"""Warning of forces that drive harmonic flows which a scene leaves out."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.constrain import Poisson
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.flow_mesh import harmonic_count
from ddgcli.models.fluid.phases import FluidSetting
from ddgcli.models.fluid.surface_space import SurfaceSpace

log = logging.getLogger("ddgcli")
MAX_LOST_FORCE_SHARE = 0.05  # of the squared force, above which a warning reports its harmonic part


class LostForceWarning:
    """Warns, at its first force other than 0, of an effect whose harmonic part moves nothing.

    Walls without slip have a warning of their own.
    """

    def __init__(self, setting: FluidSetting, effect: str) -> None:
        self.setting, self.effect = setting, effect
        self.is_due = not (setting.context.is_volume or setting.no_slip or "harmonic" in setting.effects)
        self.is_due = self.is_due and harmonic_count(setting.space.mesh) > 0

    def check(self, acceleration: NDArray) -> None:
        """Warn of accelerations (m, 3) of the cells."""
        if not self.is_due or not acceleration.any():
            return
        self.is_due = False
        space = self.setting.space
        share = harmonic_share(space, self.setting.context.to_frames(space, acceleration))
        if share > MAX_LOST_FORCE_SHARE:
            log.warning(
                "harmonic flows of %s (round its handles, holes or periods) have %.3g %% of the square of "
                "the effect %s; the scene leaves them out: add the effect harmonic = {}",
                self.setting.context.name, 100.0 * share, self.effect,
            )  # fmt: skip


def harmonic_share(space: SurfaceSpace, vectors: NDArray) -> float:
    """Share of the square of a field that is neither a discrete flow with vorticity nor a gradient.

    Parameters
    ----------
    space : SurfaceSpace
    vectors : (m,) ndarray of complex128
        In the planar frames of the faces; not all 0.

    Returns
    -------
    float
    """
    vorticity, _ = space.of_face_velocity(vectors)
    phi = space.stream_function_change(vorticity)
    rest = vectors - space.face_velocity(space.side_flux(phi, np.zeros(0)))
    slope = 1j * space.side[:, NEXT] / (2.0 * space.area[:, None])  # of the barycentric coordinates
    along = space.area[:, None] * (rest[:, None] * np.conj(slope)).real
    load = sum_by_index(space.faces, along, space.n)
    potential = Poisson(space.stiffness).pinned_solve(load)
    square = float(space.area @ np.abs(rest) ** 2) - float(potential @ load)
    return square / float(space.area @ np.abs(vectors) ** 2)
