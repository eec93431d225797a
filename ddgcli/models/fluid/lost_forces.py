"""Warning of forces that drive harmonic flows which a scene leaves out."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.linalg.constrain import Poisson
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.fluid.flow_mesh import harmonic_count
from ddgcli.models.fluid.phases import FluidSetting
from ddgcli.models.fluid.surface_space import SurfaceSpace

log = logging.getLogger("ddgcli")
MAX_LOST_FORCE_SHARE = 0.05  # of the squared force, above which a warning reports its harmonic part
MAX_LOST_SPEED_SHARE = 0.05  # of the flow's speed that it would gain of harmonic flows


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
        if not self.is_due:
            return
        space = self.setting.space
        tangential = self.setting.context.to_frames(space, acceleration)
        if not tangential.any():
            return
        self.is_due = False
        share = harmonic_share(space, tangential)
        if share > MAX_LOST_FORCE_SHARE:
            log.warning(
                "harmonic flows of %s (round its handles, holes or periods) have %.3g %% of the square of "
                "the effect %s; the scene leaves them out: add the effect harmonic = {}",
                self.setting.context.name, 100.0 * share, self.effect,
            )  # fmt: skip


def warn_of_lost_transport(setting: FluidSetting, vorticities: Sequence[NDArray], duration: float) -> None:
    """Report flows that drive the harmonic flows which a scene leaves out.

    Vorticity drives them on every surface but a flat torus, at the rate of the force - omega n x u. What it
    adds in the run, or while the flow crosses the surface once, is compared with the flow.

    Parameters
    ----------
    setting : FluidSetting
    vorticities : sequence of (n,) ndarray
        Integrated over the cells, at some times of the run.
    duration : float
    """
    if "harmonic" in setting.effects or setting.no_slip or not harmonic_count(setting.space.mesh):
        return
    share = max(gain_share(setting.space, vorticity, duration) for vorticity in vorticities)
    if share > MAX_LOST_SPEED_SHARE:
        log.warning(
            "the flow of %s drives harmonic flows (round its handles and holes) by up to %.2g %% of its "
            "speed; the scene leaves them out: add the effect harmonic = {}",
            setting.context.name, 100.0 * share,
        )  # fmt: skip


def gain_share(space: SurfaceSpace, vorticity: NDArray, duration: float) -> float:
    """Speed that harmonic flows would gain in a time, over that of a flow without them (both L2)."""
    velocity = space.face_velocity(space.side_flux(space.stream_function(vorticity), np.zeros(0)))
    square = float(space.area @ np.abs(velocity) ** 2)
    force = -1j * (vorticity * space.inverse_mass)[space.faces].mean(axis=1) * velocity
    size = float(space.area @ np.abs(force) ** 2)
    if not square > 0 or not size > 0:
        return 0.0
    crossing = float(space.area.sum()) / math.sqrt(square)
    rate = math.sqrt(max(harmonic_share(space, force), 0.0) * size)
    return rate * min(duration, crossing) / math.sqrt(square)


def harmonic_share(space: SurfaceSpace, vectors: NDArray) -> float:
    """Share of the square of a field that harmonic flows have.

    The rest is a flow with vorticity and a slope of a potential that is linear in every face and continuous
    in the middles of the sides (Crouzeix and Raviart), which flows between walls do not contain.

    Parameters
    ----------
    space : SurfaceSpace
    vectors : (m,) ndarray of complex128
        In the planar frames of the faces.

    Returns
    -------
    float
        0 where they are 0, or too small to be squared.
    """
    size = float(space.area @ np.abs(vectors) ** 2)
    if not size > 0:
        return 0.0
    vorticity, _ = space.of_face_velocity(vectors)
    phi = space.stream_function_change(vorticity)
    rest = vectors - space.face_velocity(space.side_flux(phi, np.zeros(0)))
    slope = -1j * space.side / space.area[:, None]  # of the function that is 1 in the middle of a side
    along = space.area[:, None] * (rest[:, None] * np.conj(slope)).real
    load = sum_by_index(space.side_edge, along, space.mesh.topology.n_edges)
    product = space.area[:, None, None] * (slope[:, :, None] * np.conj(slope[:, None, :])).real
    row, column = (np.broadcast_to(edge, product.shape) for edge in (
        space.side_edge[:, :, None], space.side_edge[:, None, :]
    ))  # fmt: skip
    place = (row.ravel(), column.ravel())
    matrix = csr_array(coo_array((product.ravel(), place), shape=(len(load), len(load))))
    potential = Poisson(matrix).pinned_solve(load)
    square = float(space.area @ np.abs(rest) ** 2) - float(potential @ load)
    return square / size
