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
        (share,) = harmonic_shares(space, [tangential])
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
    share = max(gain_shares(setting.space, vorticities, duration, MAX_LOST_SPEED_SHARE), default=0.0)
    if share > MAX_LOST_SPEED_SHARE:
        log.warning(
            "the flow of %s drives harmonic flows (round its handles and holes) by up to %.2g %% of its "
            "speed; the scene leaves them out: add the effect harmonic = {}",
            setting.context.name, 100.0 * share,
        )  # fmt: skip


def gain_shares(
    space: SurfaceSpace, vorticities: Sequence[NDArray], duration: float, least: float = 0.0
) -> list[float]:
    """Speeds that harmonic flows would gain in a time, over those of flows without them (both L2).

    Parameters
    ----------
    space : SurfaceSpace
    vorticities : sequence of (n,) ndarray
        Integrated over the cells.
    duration : float
    least : float
        Flows are left out whose whole force would give no more.

    Returns
    -------
    list of float
    """
    forces, most = [], []
    for vorticity in vorticities:
        velocity = space.face_velocity(space.side_flux(space.stream_function(vorticity), np.zeros(0)))
        square = float(space.area @ np.abs(velocity) ** 2)
        force = -1j * (vorticity * space.inverse_mass)[space.faces].mean(axis=1) * velocity
        if not square > 0:
            continue
        crossing = float(space.area.sum()) / math.sqrt(square)
        size = float(space.area @ np.abs(force) ** 2)
        gain = math.sqrt(size) * min(duration, crossing) / math.sqrt(square)
        if gain > least:
            forces.append(force)
            most.append(gain)
    shares = harmonic_shares(space, forces) if forces else []
    return [gain * math.sqrt(max(share, 0.0)) for gain, share in zip(most, shares)]


def harmonic_shares(space: SurfaceSpace, fields: Sequence[NDArray]) -> list[float]:
    """Share of the square of each field that harmonic flows have.

    The rest is a flow with vorticity and a slope of a potential that is linear in every face and continuous
    in the middles of the sides (Crouzeix and Raviart), which flows between walls do not contain.

    Parameters
    ----------
    space : SurfaceSpace
    fields : sequence of (m,) ndarray of complex128
        In the planar frames of the faces.

    Returns
    -------
    list of float
        0 where they are 0, or too small to be squared.
    """
    slope = -1j * space.side / space.area[:, None]  # of the function that is 1 in the middle of a side
    potential = _side_potential(space, slope)
    shares = []
    for vectors in fields:
        size = float(space.area @ np.abs(vectors) ** 2)
        if not size > 0:
            shares.append(0.0)
            continue
        phi = space.stream_function_change(space.vorticity_of_face_velocity(vectors))
        rest = vectors - space.face_velocity(space.side_flux(phi, np.zeros(0)))
        along = space.area[:, None] * (rest[:, None] * np.conj(slope)).real
        load = sum_by_index(space.side_edge, along, space.mesh.topology.n_edges)
        square = float(space.area @ np.abs(rest) ** 2) - float(potential.pinned_solve(load) @ load)
        shares.append(square / size)
    return shares


def _side_potential(space: SurfaceSpace, slope: NDArray) -> Poisson:
    """Equation of potentials with these slopes (m, 3)."""
    product = space.area[:, None, None] * (slope[:, :, None] * np.conj(slope[:, None, :])).real
    row, column = (np.broadcast_to(edge, product.shape) for edge in (
        space.side_edge[:, :, None], space.side_edge[:, None, :]
    ))  # fmt: skip
    place = (row.ravel(), column.ravel())
    n_edges = space.mesh.topology.n_edges
    return Poisson(csr_array(coo_array((product.ravel(), place), shape=(n_edges, n_edges))))
