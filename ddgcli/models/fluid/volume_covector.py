"""Transport of the velocity in a volume as a covector field, pulled back by the map of points backwards.

As on surfaces (`covector`): the vertices are carried backwards, the line integrals along the carried edges of
a cell make one covector, and the discrete flow nearest to all of them is the new flow; what a step of no
length would lose is added before; the step is repeated backwards and half its error subtracted. Energy never
rises.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.cells import TET_EDGES
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.volume_transport import rate, without_rise
from ddgcli.simulation.model import Observation, StepRejected

TAIL, HEAD = np.array(TET_EDGES).T


class VolumeCovectorTransport(FlowPhase):
    """Pull-back; what it loses is booked in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.space, self.paths = setting.volume, setting.volume_paths
        space = self.space
        cell_of_vertex = np.zeros(space.n, dtype=np.int64)
        cell_of_vertex[space.cells.ravel()] = np.repeat(np.arange(len(space.cells)), 4)
        self.here = cell_of_vertex, np.array(space.mesh.points)
        # of the basis covector (Whitney form) of each edge, at the centre of the cell
        self.of_edge = 0.25 * (space.slope[:, HEAD] - space.slope[:, TAIL])

    def start(self) -> dict[str, NDArray]:
        return {"loss": np.zeros(2)}

    def _pulled_back(self, ends: tuple, velocity: NDArray) -> NDArray[np.float64]:
        """(F,) fluxes of the discrete flow nearest to the pull-back of cell velocities."""
        space = self.space
        end_velocity = self.paths.interpolated(space.vertex_means(velocity), *ends)[space.cells]
        place = ends[1][space.cells]
        along = 0.5 * np.einsum(
            "kea,kea->ke", end_velocity[:, TAIL] + end_velocity[:, HEAD], place[:, HEAD] - place[:, TAIL]
        )
        return space.projected(np.einsum("ke,kea->ka", along, self.of_edge), inflow=False)

    def _sharpened(self, velocity: NDArray) -> NDArray[np.float64]:
        """Cell velocities and what a pull-back by no map would take from them."""
        return 2.0 * velocity - self.space.velocity(self._pulled_back(self.here, velocity))

    def _carried(self, ends: tuple, velocity: NDArray) -> NDArray[np.float64]:
        return self.space.velocity(self._pulled_back(ends, self._sharpened(velocity)))

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, dt = self.space, step.dt
        velocity = space.cell_velocity(state)
        carrier = space.vertex_means(space.velocity(state["flux"] + 0.5 * dt * rate(space, state["flux"])))
        back, forth = (self.paths.carried(carrier, *self.here, span) for span in (dt, -dt))
        again = self._carried(forth, self._carried(back, velocity))
        flux = self._pulled_back(back, self._sharpened(1.5 * velocity - 0.5 * again))
        energy, energy_after = space.kinetic_energy(velocity), space.kinetic_energy(space.velocity(flux))
        if not np.isfinite(energy_after):
            raise StepRejected("not finite")
        if energy_after > energy:
            flux = without_rise(space, flux, self._pulled_back(back, velocity), energy)
        after = state.replaced(flux=flux)
        loss = np.array([energy - space.energy(after), 0.0])
        return after.with_passive(loss=state["loss"] + loss)

    def observed(self, state: FluidState) -> Observation:
        return Observation(None, {}, {"lost_energy": float(state["loss"][0])})


def transport(setting: FluidSetting, parameters: object) -> VolumeCovectorTransport:
    """Transport phase of the integrator in [time]."""
    return VolumeCovectorTransport(setting)
