"""Limits of carried flows: corrections by which neither energy nor enstrophy rises, and what walls carry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.smoothing import Smoothing, first_root, share_at_constant_energy
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import BackwardPaths

MAX_DEFORMATION = 1.0  # change of the velocity along a side times dt over its length, beyond which loops fold
ENERGY_RISE_TOLERANCE = 1e-4  # relative rise of the kinetic energy at which a step is shortened
ENERGY_ROUNDING = 1e-12  # relative rise of the energy that counts as none
SMALL_DEFORMATION = 0.02  # deformation below which a step is taken as it is: a shorter one would be no better
Flow = tuple[NDArray[np.float64], NDArray[np.float64]]  # vorticity (n,), harmonic coefficients (b,)


class FlowLimits:
    """Corrections of a carried flow on one surface."""

    def __init__(self, space: SurfaceSpace) -> None:
        self.space = space
        self.smoothing = Smoothing(space)
        length = space.mesh.side_length
        self.size = np.maximum(length, 0.5 * np.median(length))

    def deformation(self, corner: NDArray, dt: float) -> float:
        """Largest change of the velocity along a side, times dt over its length: from about 1 on loops fold.

        Sides far shorter than most count as longer: what folds among them is lost in their neighbours.
        """
        change = np.abs(corner[:, NEXT] - corner)
        return dt * float((change / self.size).max(initial=0.0))

    def limited(
        self, before: Flow, advected: Flow, smooth: Callable[[], Flow]
    ) -> tuple[Flow, float, NDArray[np.float64]]:
        """The flow without rise of energy and enstrophy, the rise that scaling took, and the `CORRECTIONS`.

        Parameters
        ----------
        before, advected : Flow
            At the start and the end of the step.
        smooth : callable
            Makes the flow after a step of the same order that loses energy.
        """
        space = self.space
        energy, enstrophy = self.energy(before), space.enstrophy(before[0])
        after, energy_after = self._without_rise(advected, energy, smooth)
        rise = energy_after / energy - 1.0 if energy > 0 else 0.0
        mixed = after is not advected
        filtered = space.enstrophy(after[0]) > (1.0 + ENERGY_ROUNDING) * enstrophy
        after = self._without_enstrophy_rise(after, enstrophy)
        energy_after, removed = self.energy(after), 0.0
        if energy_after > energy:
            removed = energy_after - energy if energy_after > (1.0 + ENERGY_ROUNDING) * energy else 0.0
            after = self._at_energy(after, energy_after, energy)
        return after, rise, np.array([mixed, filtered, removed > 0, removed])

    def energy(self, flow: Flow) -> float:
        return self.space.kinetic_energy(self.space.stream_function(flow[0]), flow[1])

    def _without_rise(
        self, after: Flow, energy: float, smooth_step: Callable[[], Flow]
    ) -> tuple[Flow, float]:
        """Mixed with just as much of the smooth step as keeps the energy from rising; the energy reached."""
        space = self.space
        phi = space.stream_function(after[0])
        energy_after = space.kinetic_energy(phi, after[1])
        if energy_after <= energy:
            return after, energy_after
        smooth = smooth_step()
        change, turn = smooth[0] - after[0], smooth[1] - after[1]
        phi_change = space.stream_function_change(change)
        slope = float(phi @ (space.stiffness @ phi_change) + after[1] @ turn)
        curvature = space.kinetic_energy(phi_change, turn)
        share = first_root(energy_after - energy, slope, curvature)
        if energy_after + share * (slope + share * curvature) > (1.0 + ENERGY_ROUNDING) * energy:
            # at walls the smooth step can have more energy itself
            share = min(max(-0.5 * slope / curvature, 0.0), 1.0) if curvature > 0 else 0.0
        mixed = after[0] + share * change, after[1] + share * turn
        return mixed, energy_after + share * (slope + share * curvature)

    def _without_enstrophy_rise(self, flow: Flow, most: float) -> Flow:
        """Filtered until the enstrophy is at most `most`; the energy that the filter takes is put back.

        What a filter takes of the energy is taken at every step, however short. Scaling the filtered flow
        back to the energy before raises the enstrophy less than the filter lowered it, so a share of the
        filter exists that does both, as in the anticipated potential vorticity method (R. Sadourny and
        C. Basdevant, Journal of the Atmospheric Sciences, 1985).
        """
        space, vorticity = self.space, flow[0]
        if not space.enstrophy(vorticity) > most:
            return flow
        phi = space.stream_function_change(vorticity)
        change = self.smoothing.change(vorticity)
        phi_change = space.stream_function_change(change)
        enstrophy = (
            space.enstrophy(vorticity),
            float(vorticity @ (space.inverse_mass * change)),
            space.enstrophy(change),
        )
        none = np.zeros(0)
        energy = (
            space.kinetic_energy(phi, none),
            float(phi @ (space.stiffness @ phi_change)),
            space.kinetic_energy(phi_change, none),
        )
        if not energy[0] > ENERGY_ROUNDING * 0.5 * float(flow[1] @ flow[1]):  # vorticity that is rounding
            return self.smoothing.without_rise(vorticity, most), flow[1]
        share, gain = share_at_constant_energy(enstrophy, energy, most)
        filtered = vorticity + share * change
        scaled = np.where(space.inside, gain * filtered, filtered)
        keep_total(space, scaled, filtered)
        if space.enstrophy(scaled) > space.enstrophy(vorticity):
            scaled = filtered
        return self.smoothing.without_rise(scaled, most), flow[1]

    def _at_energy(self, flow: Flow, energy_before: float, energy: float) -> Flow:
        """The vorticity scaled to `energy`, a last resort on bad meshes."""
        fixed = 0.5 * float(flow[1] @ flow[1])
        if not energy_before > fixed:
            return flow
        share = (max(energy - fixed, 0.0) / (energy_before - fixed)) ** 0.5
        scaled = np.where(self.space.inside, share * flow[0], flow[0])
        keep_total(self.space, scaled, flow[0])
        return scaled, flow[1]


def along_walls(space: SurfaceSpace, rim: BackwardPaths | None, vorticity: NDArray) -> NDArray[np.float64]:
    """Vorticity of the cells at the boundary carried along it, point by point.

    Parameters
    ----------
    space : SurfaceSpace
    rim : BackwardPaths or None
        Of the boundary vertices, in their order.
    vorticity : (n,) ndarray of float64
        Integrated over the cells.

    Returns
    -------
    (n,) ndarray of float64
        Unchanged inside, and everywhere without paths.
    """
    if rim is None:
        return vorticity
    vertices = np.flatnonzero(space.mesh.topology.boundary_vertex)
    omega = (vorticity * space.inverse_mass)[space.faces[rim.face]]
    after = np.array(vorticity)
    after[vertices] = space.mass[vertices] * row_dot(omega, rim.barycentric)
    return after


def keep_total(space: SurfaceSpace, after: NDArray, before: NDArray) -> None:
    """Restore the total vorticity of each component, from the cells at its boundary; in place.

    Parameters
    ----------
    space : SurfaceSpace
    after : (n,) ndarray of float64
        Integrated vorticity, changed at the boundary.
    before : (n,) ndarray of float64
        With the totals to restore.
    """
    rim = space.mesh.topology.boundary_vertex
    if not rim.any():
        return
    label = space.mesh.topology.vertex_component
    missing = space.component_vorticity(before) - space.component_vorticity(after)
    area = sum_by_index(label[rim], space.mass[rim], len(missing))
    share = np.divide(missing, area, out=np.zeros_like(missing), where=area > 0)
    after[rim] += space.mass[rim] * share[label[rim]]
