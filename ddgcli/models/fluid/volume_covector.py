"""Transport of the velocity in a volume as a covector field, pulled back by the map of points backwards.

As between walls of surfaces (`covector`): the vertices are carried backwards, the line integrals along the
carried edges of a cell make one covector, and the discrete flow nearest to all covectors is the new flow.
What a cell's own velocity has beyond the vertices' stays with the cell, so that a step of no length is the
identity; the step is repeated backwards and half its error subtracted. Energy never rises.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.cells import TET_EDGES
from ddgcli.models.fluid.loss_account import LossAccount
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.volume_transport import rate, without_rise
from ddgcli.simulation.model import Cause, Observation, StepRejected

TAIL, HEAD = np.array(TET_EDGES).T


class VolumeCovectorTransport(FlowPhase):
    """Pull-back; what it loses is booked in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.space, self.paths = setting.volume, setting.volume_paths
        self.account = LossAccount(setting, ("energy",))
        space = self.space
        self.vertices = np.arange(space.n)
        self.here = self.paths.cell_of_vertex, np.array(space.mesh.points)
        # of the basis covector (Whitney form) of each edge, at the centre of the cell
        self.of_edge = 0.25 * (space.slope[:, HEAD] - space.slope[:, TAIL])

    def start(self) -> dict[str, NDArray]:
        return self.account.start()

    def _carried(self, velocity: NDArray, ends: tuple, smooth: bool = False) -> NDArray[np.float64]:
        """(F,) fluxes of the discrete flow nearest to the pull-back of cell velocities."""
        at_vertices = self.space.vertex_means(velocity)
        covector = self._covector(at_vertices, ends)
        if not smooth:
            covector += velocity - self._covector(at_vertices, self.here)
        return self.space.projected(covector, inflow=False)

    def _covector(self, at_vertices: NDArray, ends: tuple) -> NDArray[np.float64]:
        """(k, 3) cell velocities with the line integrals along the carried edges."""
        end_velocity = self.paths.interpolated(at_vertices, *ends)[self.space.cells]
        place = ends[1][self.space.cells]
        along = 0.5 * np.einsum(
            "kea,kea->ke", end_velocity[:, TAIL] + end_velocity[:, HEAD], place[:, HEAD] - place[:, TAIL]
        )
        return np.einsum("ke,kea->ka", along, self.of_edge)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, dt = self.space, step.dt
        velocity = space.cell_velocity(state)
        change = 0.5 * dt * rate(space, state["flux"], step.time)
        carrier = space.vertex_means(space.velocity(state["flux"] + change))
        back, forth = (self.paths.vertices_carried(carrier, self.vertices, span) for span in (dt, -dt))
        again = space.velocity(self._carried(space.velocity(self._carried(velocity, back)), forth))
        flux = self._carried(1.5 * velocity - 0.5 * again, back)
        energy, energy_after = space.kinetic_energy(velocity), space.kinetic_energy(space.velocity(flux))
        if not np.isfinite(energy_after):
            raise StepRejected(Cause.NOT_FINITE)
        if energy_after > energy:
            flux = without_rise(space, flux, self._carried(velocity, back, smooth=True), energy)
        return self.account.booked(state, state.replaced(flux=flux), dt)

    def observed(self, state: FluidState) -> Observation:
        return self.account.observed(state)


def transport(setting: FluidSetting, parameters: object) -> VolumeCovectorTransport:
    """Transport phase of the integrator in [time]."""
    return VolumeCovectorTransport(setting)
