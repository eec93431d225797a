"""Transport of the velocity as a covector field, pulled back by the map that carries points backwards.

    u(t + dt) = P (d psi)^T u(t, psi),      psi the backward map, P the projection onto discrete flows.

The vertices are carried backwards. The line integral of the velocity along every side of a face is measured
along the carried side, between the velocities that its ends meet; the three numbers of a face make one
covector, and the discrete flow nearest to all of them is the new flow. What a step of no length would lose is
added before; the step is repeated backwards, and half of the error at its start is subtracted. While nothing
else changes the flow, the map is followed over several steps back to one flow, so that interpolation acts
once in them. Of second order in space and time; energy and enstrophy never rise.

M. S. Nabizadeh, S. Wang, R. Ramamoorthi, A. Chern, "Covector fluids", ACM Transactions on Graphics, 2022.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.conservative import rate
from ddgcli.models.fluid.limits import (
    ENERGY_RISE_TOLERANCE,
    MAX_DEFORMATION,
    SMALL_DEFORMATION,
    Flow,
    FlowLimits,
    along_walls,
    keep_total,
)
from ddgcli.models.fluid.loss_account import LossAccount
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import BackwardPaths, Transport
from ddgcli.simulation.model import Observation, StepRejected

MAX_MAP_STEPS = 4  # over which one map is followed
MAX_MAP_DEFORMATION = 0.5  # sum of the deformations of these steps


@dataclass(frozen=True, eq=False)
class FlowMap:
    """Start and steps of a backward map.

    Parameters
    ----------
    start : Flow
        What is pulled back.
    velocity : list of (m, 3) ndarray of complex
        At the corners of the faces in the middle of each step, the oldest first.
    dt : list of float
    """

    start: Flow
    velocity: list[NDArray[np.complex128]]
    dt: list[float]


class CovectorAdvection:
    """A surface prepared for pulling velocities back.

    With `keeps_own`, what a face's own velocity has beyond that of its corners stays with the face: of no
    length a step is then the identity. At a wall that starts to move, where the layer is thinner than a cell,
    interpolation would spread it by some cells in a few steps, and add momentum.
    """

    def __init__(
        self, space: SurfaceSpace, transport: Transport | None = None, keeps_own: bool = False
    ) -> None:
        self.space, self.keeps_own = space, keeps_own
        self.transport = transport or Transport(space)
        self.limits = FlowLimits(space)
        self.to_face = np.conj(space.recovery.to_vertex)
        self.no_map = self.vertex_paths([np.zeros_like(self.to_face)], [0.0])
        # of the basis covector (Whitney form) of each side, at the centre of the face
        slope = self.transport.slope
        self.of_side = (slope[:, NEXT] - slope) / 3.0
        self.rim = np.flatnonzero(space.mesh.topology.boundary_vertex)

    def vertex_paths(self, velocity: list[NDArray], dt: list[float]) -> BackwardPaths:
        """The vertices after steps backwards in turn, the first one first."""
        first = self.transport.vertices_backwards(velocity[0], np.arange(self.space.n), dt[0])
        face, barycentric, turn, shift = first.face, first.barycentric, first.turn, first.shift
        for corner, span in zip(velocity[1:], dt[1:]):
            moved = self.transport.backwards(corner, face, barycentric, span)
            shift, turn = shift + turn * moved.shift, turn * moved.turn
            face, barycentric = moved.face, moved.barycentric
        return BackwardPaths(face, barycentric, shift, turn)

    def pulled_back(self, paths: BackwardPaths, flow: Flow, evolve: bool) -> Flow:
        """The discrete flow nearest to the pull-back of a flow without inflow.

        A map that the flow makes changes a harmonic covector by a gradient alone, which the projection takes
        off: the harmonic part is kept as it is, and gains what the pull-back of the rest contains.
        """
        space = self.space
        flux = space.side_flux(space.stream_function_change(flow[0]), np.zeros(0))
        corner = self.transport.corners(flux)
        velocity = self.transport.end_velocity(corner, paths)[space.faces] * self.to_face
        shift = paths.shift[space.faces] * self.to_face
        carried = self._covector(velocity, space.side + shift[:, NEXT] - shift)
        still = self._covector(corner, space.side)
        own = space.face_velocity(flux) - still if self.keeps_own else 0.0
        after = space.vorticity_of_face_velocity(carried + own)
        coefficients = space.harmonic_part(carried - still)  # of interpolation alone there is no gain
        if len(self.rim):
            rim = BackwardPaths(*(array[self.rim] for array in vars(paths).values()))
            after = np.where(space.inside, after, along_walls(space, rim, flow[0]))
            keep_total(space, after, flow[0])
        return after, flow[1] + coefficients if evolve else flow[1]

    def _covector(self, velocity: NDArray, side: NDArray) -> NDArray[np.complex128]:
        """(m,) face velocities with the line integrals of corner velocities (m, 3) along sides (m, 3)."""
        along = 0.5 * ((velocity + velocity[:, NEXT]) * np.conj(side)).real
        return (along * self.of_side).sum(axis=1)

    def sharpened(self, flow: Flow, evolve: bool) -> Flow:
        """The flow and what a pull-back by no map would take from it."""
        if self.keeps_own:
            return flow
        there = self.pulled_back(self.no_map, flow, evolve)
        return 2.0 * flow[0] - there[0], 2.0 * flow[1] - there[1]

    def middle_velocity(self, flow: Flow, dt: float, evolve: bool) -> NDArray[np.complex128]:
        """(m, 3) velocity at the corners of the faces half a step ahead."""
        space = self.space
        d_vorticity, d_coefficients, flux = rate(space, *flow, evolve)
        change = space.side_flux(space.stream_function_change(d_vorticity), d_coefficients)
        return self.transport.corners(flux + 0.5 * dt * change)

    def end_of(
        self, flow_map: FlowMap, before: Flow, evolve: bool
    ) -> tuple[Flow, float, NDArray[np.float64]]:
        """The flow at the end of a map, the relative rise of its energy, and the `CORRECTIONS`.

        `before` is the flow at the start of the map's last step.
        """
        start, velocity, dt = flow_map.start, flow_map.velocity, flow_map.dt
        back = self.vertex_paths(velocity[::-1], dt[::-1])
        forth = self.vertex_paths(velocity, [-span for span in dt])
        there = self.pulled_back(back, self.sharpened(start, evolve), evolve)
        again = self.pulled_back(forth, self.sharpened(there, evolve), evolve)
        corrected = 1.5 * start[0] - 0.5 * again[0], 1.5 * start[1] - 0.5 * again[1]
        after = self.pulled_back(back, self.sharpened(corrected, evolve), evolve)
        return self.limits.limited(before, after, lambda: self.pulled_back(back, start, evolve))


class CovectorTransport(FlowPhase):
    """Transport by pull-back; the start of the map, its steps and its losses are in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.evolve = setting.evolve_harmonic
        self.advection = CovectorAdvection(setting.space, setting.tracing, keeps_own=setting.no_slip)
        self.account = LossAccount(setting, ("energy", "enstrophy"), corrects=True)

    def start(self) -> dict[str, NDArray]:
        space = self.advection.space
        size = space.n + len(space.harmonic)
        return {
            "map_start": np.zeros(size), "map_end": np.zeros(size), "map_dt": np.zeros(MAX_MAP_STEPS),
            "map_flow": np.zeros((MAX_MAP_STEPS, size)), **self.account.start(),
        }  # fmt: skip

    def advance(self, step: Step, state: FluidState) -> FluidState:
        advection = self.advection
        flow = state["vorticity"], state["coefficients"]
        now = np.concatenate(flow)
        map_steps = np.count_nonzero(state["map_dt"])
        past = (
            state["map_flow"][:map_steps] if np.array_equal(now, state["map_end"]) else state["map_flow"][:0]
        )
        spans = state["map_dt"][: len(past)]
        velocity = [
            advection.middle_velocity(self._flow(then), dt, self.evolve)
            for then, dt in zip([*past, now], [*spans, step.dt])
        ]
        spans = np.append(spans, step.dt)
        bends = [advection.limits.deformation(v, dt) for v, dt in zip(velocity, spans)]
        if not bends[-1] <= MAX_DEFORMATION:
            raise StepRejected("loops fold", value=bends[-1])
        if len(bends) > MAX_MAP_STEPS or sum(bends) > MAX_MAP_DEFORMATION:
            past, velocity, spans, bends = past[:0], velocity[-1:], spans[-1:], bends[-1:]
        start = self._flow(state["map_start"]) if len(past) else flow
        after, rise, acted = advection.end_of(FlowMap(start, velocity, list(spans)), flow, self.evolve)
        if len(past) and not rise <= ENERGY_RISE_TOLERANCE:  # by the steps before, whatever this one
            past, velocity, spans, start = past[:0], velocity[-1:], spans[-1:], flow
            after, rise, acted = advection.end_of(FlowMap(start, velocity, list(spans)), flow, self.evolve)
        if bends[-1] > SMALL_DEFORMATION and not rise <= ENERGY_RISE_TOLERANCE:
            raise StepRejected("energy rises", value=rise)
        changed = state.replaced(vorticity=after[0], coefficients=after[1])
        changed = changed.with_passive(
            **self._map(np.concatenate(start), np.concatenate(after), np.vstack([past, now[None]]), spans)
        )
        return self.account.booked(state, changed, step.dt, acted)

    def _flow(self, packed: NDArray) -> Flow:
        n = self.advection.space.n
        return packed[:n], packed[n:]

    def _map(self, start: NDArray, end: NDArray, flows: NDArray, spans: NDArray) -> dict[str, NDArray]:
        rest = MAX_MAP_STEPS - len(flows)
        return {
            "map_start": start, "map_end": end, "map_dt": np.append(spans, np.zeros(rest)),
            "map_flow": np.vstack([flows, np.zeros((rest, len(start)))]),
        }  # fmt: skip

    def observed(self, state: FluidState) -> Observation:
        return self.account.observed(state)


def transport(setting: FluidSetting, parameters: Any) -> CovectorTransport:
    """Transport phase of the integrator in [time]."""
    return CovectorTransport(setting)
