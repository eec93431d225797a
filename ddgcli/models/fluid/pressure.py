"""Effect `pressure`: the array `pressure` in frames, from the balance of momentum.

The flow needs no pressure; it is what its accelerations leave over. The total head B = p + |u|^2 / 2 solves

    (grad B, grad q) = (- omega n x u + f + nu laplacian u, grad q)      for all q,

f the accelerations by effects. B is linear in every face; at natural outflows it is the head there,
elsewhere the mean of p over each component is zero. The velocity at vertices is that of frames
(`vertex_velocity`). In volumes B has one value per face of the mesh.
"""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.wall_vorticity import WallVorticity
from ddgcli.scenes.sections import Section
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Observation


class PressureSection(Section):
    """Pressure over density [m^2/s^2] at the vertices of every frame."""

    object: str | None = Field(None, description="fluid; by default all")


class PressurePhase(FlowPhase):
    """One solve a frame; the flow is as without it."""

    effect = "pressure"
    step_stage: Literal["transport", "source", "tracer"] = "tracer"

    def __init__(self, setting: FluidSetting) -> None:
        self.setting = setting
        setting.needs_time = True

    def advance(self, step: Step, state: FluidState) -> FluidState:
        return state

    def observed(self, state: FluidState) -> Observation:
        return Observation(None, {"pressure": self.values(state)}, {})

    def values(self, state: FluidState) -> NDArray[np.float64]:
        """(n,) pressure over density at the vertices."""
        raise NotImplementedError

    def accelerations(self, state: FluidState) -> NDArray[np.float64]:
        """(m, 3) sum of what the effects add to the velocity of the cells a second."""
        time = state.time
        total = np.zeros((len(self.setting.context.cells), 3))
        for phase in self.setting.phases:
            acceleration = getattr(phase, "cell_acceleration", None)
            if acceleration is not None:
                total += acceleration(state, time)
        return total


class SurfacePressure(PressurePhase):
    """On surfaces, linear in every face."""

    def __init__(self, setting: FluidSetting) -> None:
        super().__init__(setting)
        space = self.space = setting.space
        open_vertices = np.zeros(space.n, dtype=bool)
        if space.open_sides is not None:
            open_vertices[space.open_sides.ravel()] = True
        topology = space.mesh.topology
        self.open = open_vertices
        label = topology.vertex_component
        self.closed = ~np.isin(np.arange(topology.n_components), label[open_vertices])
        vertices = np.flatnonzero(label >= 0)
        _, first = np.unique(label[vertices], return_index=True)
        pinned = vertices[first][self.closed]
        fixed = open_vertices | ~topology.referenced_vertex
        fixed[pinned] = True
        self.solver = Dirichlet(space.stiffness, np.flatnonzero(fixed))
        self.slope = 1j * space.side[:, NEXT] / (2.0 * space.area[:, None])
        face, k, _ = space.boundary_sides
        self.side_length = space.mesh.side_length[face, k]
        self.chains = self._outflow_chains()

    @cached_property
    def walls(self) -> WallVorticity:
        """Vorticity along walls with friction."""
        return WallVorticity(self.space, self.setting.context, self.setting.slip)

    def _outflow_chains(self) -> list[NDArray[np.int64]]:
        """Indices of the boundary sides of every natural outflow, one after another."""
        space = self.space
        if space.open_sides is None:
            return []
        by_tail = dict(zip(space.boundary_sides[2][:, 0].tolist(), range(len(self.side_length))))
        head_of = dict(space.open_sides.tolist())
        chains = []
        for first in set(head_of) - set(head_of.values()):
            chain, vertex = [], first
            while vertex in head_of:
                chain.append(by_tail[vertex])
                vertex = head_of[vertex]
            chains.append(np.array(chain))
        return chains

    def values(self, state: FluidState) -> NDArray[np.float64]:
        space = self.space
        omega = state["vorticity"] * space.inverse_mass
        side_flux = space.flow(state).side_flux
        velocity = space.face_velocity(side_flux)
        push = -1j * (omega + self.setting.coriolis)[space.faces].mean(axis=1) * velocity
        nu = self.setting.wall_friction
        if nu:  # grad omega acts through the vorticity of the boundary alone
            omega = self.walls.smoothed(omega, side_flux, state.time)
            push += 1j * nu * (omega[space.faces] * self.slope).sum(axis=1)
        push += self.setting.context.to_frames(space, self.accelerations(state))
        rhs = sum_by_index(
            space.faces, space.area[:, None] * (push[:, None] * np.conj(self.slope)).real, space.n
        )
        if space.lift_in_time is not None:
            face, k, ends = space.boundary_sides
            flux = space.side_flux(space.lift_in_time.rate(state.time), np.zeros(0))[face, k]
            rhs -= sum_by_index(ends, 0.5 * np.repeat(flux[:, None], 2, axis=1), space.n)
        with space.timer():
            head = self.solver.solve(self._outflow_head(state)[self.solver.fixed], rhs)
        squared_speed = space.vertex_velocity.squared_speed(side_flux, state.time)
        speed = self._outflow_speed(state)
        squared_speed[self.open] = self._mean_at_outflows(speed**2)[self.open]  # the square that the head has
        return self._centred(head - 0.5 * squared_speed)

    def _outflow_head(self, state: FluidState) -> NDArray[np.float64]:
        """(n,) total head at the vertices of natural outflows: the square of what leaves, half of it."""
        if not self.open.any():
            return np.zeros(self.space.n)
        leaving = np.maximum(self._outflow_speed(state), 0.0)
        return 0.5 * self._mean_at_outflows(leaving**2) + self._work_along_outflows(state)

    def _outflow_speed(self, state: FluidState) -> NDArray[np.float64]:
        """(s,) speed out of the sides of natural outflows."""
        space = self.space
        if space.outflow is None:
            return np.zeros(0)
        return space.outflow.speed(space.edge_flux(space.flow(state).phi, state["coefficients"]))

    def _mean_at_outflows(self, values: NDArray) -> NDArray[np.float64]:
        """(n,) mean at the vertices of natural outflows of values (s,) on their sides; 0 elsewhere."""
        n, ends = self.space.n, self.space.open_sides
        if ends is None:
            return np.zeros(n)
        summed = sum_by_index(ends, np.repeat(values[:, None], 2, axis=1), n)
        return summed / np.maximum(np.bincount(ends.ravel(), minlength=n), 1)

    def _work_along_outflows(self, state: FluidState) -> NDArray[np.float64]:
        """(n,) work of the forces along natural outflows, from where its mean is zero.

        Their gradient part moves nothing, at outflows neither: there the pressure is constant but for it.
        """
        space, time = self.space, state.time
        along = np.zeros(len(space.boundary_sides[0]))
        for phase in self.setting.phases:
            integrals = getattr(phase, "boundary_integrals", None)
            if integrals is not None:
                along += integrals(state, time).sum(axis=1)
        work = np.zeros(space.n)
        for chain in self.chains if along.any() else []:
            ends, length = space.boundary_sides[2][chain], self.side_length[chain]
            steps = np.append(0.0, np.cumsum(along[chain]))
            steps -= float(length @ (0.5 * (steps[1:] + steps[:-1]))) / float(length.sum())
            work[np.append(ends[:, 0], ends[-1, 1])] = steps
        return work

    def _centred(self, pressure: NDArray) -> NDArray[np.float64]:
        space = self.space
        label, count = space.mesh.topology.vertex_component, len(self.closed)
        in_component = label >= 0
        weight = sum_by_index(label[in_component], space.mass[in_component], count)
        mean = sum_by_index(label[in_component], (space.mass * pressure)[in_component], count) / weight
        return np.where(in_component, pressure - np.where(self.closed, mean, 0.0)[np.maximum(label, 0)], 0.0)


class VolumePressure(PressurePhase):
    """In volumes, from the potential that the projection takes off."""

    def values(self, state: FluidState) -> NDArray[np.float64]:
        from ddgcli.models.fluid.volume_transport import rotational_acceleration

        space = self.setting.volume
        push, head = rotational_acceleration(space, state["flux"], state.time)
        push += self.accelerations(state)
        if space.stream_in_time is not None:
            push -= space.velocity(space.stream_in_time.rate(state.time))
        on_faces = space.potential(push, inflow=False, head=head)[space.cell_face]
        velocity = space.cell_velocity(state)
        at_corners = on_faces.sum(axis=1, keepdims=True) - 3.0 * on_faces
        head = sum_by_index(space.cells, 0.25 * space.volume[:, None] * at_corners, space.n)
        at_vertices = space.vertex_velocity(velocity, state.time)
        pressure = head * space.inverse_mass - 0.5 * row_dot(at_vertices, at_vertices)
        if space.conditions is None or not space.conditions.natural.any():
            pressure -= float(space.mass @ pressure) / float(space.mass.sum())
        return pressure


def build(parameters: PressureSection, context: FluidContext) -> list[PhaseRequest]:
    def make(setting: FluidSetting) -> Phase:
        return VolumePressure(setting) if context.is_volume else SurfacePressure(setting)

    return [PhaseRequest(make)]


EFFECT = Effect("pressure", PressureSection, build, "a factorisation, then one solve per frame", ("fluid",))
