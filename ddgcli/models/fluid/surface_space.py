"""States of an incompressible flow on a surface: energies, distances and what frames show of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.fluid.recovery import Recovery, recovery
from ddgcli.models.fluid.state import TIME, FluidState
from ddgcli.models.fluid.surface_velocities import SurfaceVelocities
from ddgcli.models.fluid.vertex_velocity import VertexVelocity
from ddgcli.simulation.model import Observation


@dataclass(frozen=True, eq=False)
class SurfaceFlow:
    """Stream function (n,) and fluxes (m, 3) through the sides of the faces."""

    phi: NDArray[np.float64]
    side_flux: NDArray[np.float64]


class SurfaceSpace(SurfaceVelocities):
    """Velocities on one surface, and states of a flow there.

    Parameters are those of `SurfaceVelocities`.
    """

    dimension: ClassVar[int] = 2

    # ------------------------------------------------------------------ what is conserved

    def kinetic_energy(self, phi: NDArray, coefficients: NDArray, time: float = 0.0) -> float:
        """Half the integral of |u|^2."""
        energy = 0.5 * float(phi @ (self.stiffness @ phi) + coefficients @ coefficients)
        return energy + float(coefficients @ self.lifted_part_at(time)) if len(coefficients) else energy

    def enstrophy(self, vorticity: NDArray) -> float:
        """Half the integral of the squared vorticity."""
        return 0.5 * float(np.sum(vorticity**2 * self.inverse_mass))

    # ------------------------------------------------------------------ states

    def rest(self) -> dict[str, NDArray]:
        """Integrated vorticity (n,) and harmonic coefficients (b,) of the flow of least energy.

        Between walls it is at rest; with inflow it has no circulation round obstacles.
        """
        return {"vorticity": np.zeros(self.n), "coefficients": -self.lifted_part}

    @cached_property
    def lifted_part(self) -> NDArray[np.float64]:
        """(b,) inner products of the flow through the boundary with the harmonic flows."""
        return self.part_of(self.lift)

    def lifted_part_at(self, time: float) -> NDArray[np.float64]:
        """(b,) `lifted_part` at a time."""
        return self.lifted_part if self.lift_in_time is None else self.part_of(self.lift_at(time))

    def restated(self, state: FluidState, time: float) -> FluidState:
        """The state with what the boundary prescribes at another time, its circulations as they were."""
        if self.lift_in_time is None:
            return state
        shift = self.lifted_part_at(state.time) - self.lifted_part_at(time)
        return state.replaced(coefficients=state["coefficients"] + shift, **{TIME: np.array([time])})

    def part_of(self, lift: NDArray | None) -> NDArray[np.float64]:
        """(b,) inner products of the flow of a stream function without vorticity with the harmonic flows."""
        if lift is None or not len(self.harmonic):  # walls alone are orthogonal to harmonic flows
            return np.zeros(len(self.harmonic))
        return np.asarray(self.harmonic @ (self.edge_inner * self.edge_flux(lift, np.zeros(0))))

    def flow(self, state: FluidState) -> SurfaceFlow:
        """Stream function and side fluxes of a state, computed once."""
        if "flow" not in state.memo:
            state.memo["flow"] = self.flow_of(state["vorticity"], state["coefficients"], state.time)
        return state.memo["flow"]

    def flow_of(self, vorticity: NDArray, coefficients: NDArray, time: float = 0.0) -> SurfaceFlow:
        """Stream function and side fluxes of a flow at a time."""
        phi = self.stream_function(vorticity, time)
        return SurfaceFlow(phi, self.side_flux(phi, coefficients))

    def energy(self, state: FluidState) -> float:
        return self.kinetic_energy(self.flow(state).phi, state["coefficients"], state.time)

    def total_enstrophy(self, state: FluidState) -> float:
        return self.enstrophy(state["vorticity"])

    @property
    def measure(self) -> float:
        return float(self.area.sum())

    @property
    def size(self) -> float:
        return float(np.sqrt(self.measure))

    def distance(self, a: FluidState, b: FluidState, start: FluidState, least_energy: float = 0.0) -> float:
        """L2 distance of vorticities and of harmonic flows, relative to the largest of `start` and `b`.

        A flow of speed u on a surface of area A counts with a vorticity of at least u / sqrt(A): a uniform
        flow has none of its own.
        """
        energy = max(self.energy(start), self.energy(b), least_energy)
        enstrophy = max(self.enstrophy(start["vorticity"]), self.enstrophy(b["vorticity"]))
        enstrophy = max(enstrophy, energy / self.measure)
        apart = np.sqrt(self.enstrophy(a["vorticity"] - b["vorticity"]) / (enstrophy or 1.0))
        harmonic_distance = np.linalg.norm(a["coefficients"] - b["coefficients"])
        return float(apart + harmonic_distance / (np.sqrt(2.0 * energy) or 1.0))

    def observed(self, state: FluidState) -> Observation:
        """Vorticity, stream function, velocity; energies and circulations."""
        vorticity, coefficients, flow = state["vorticity"], state["coefficients"], self.flow(state)
        edge_flux = self.edge_flux(flow.phi, coefficients)
        vertex = {"vorticity": vorticity * self.inverse_mass, "stream_function": self.centred(flow.phi)}
        if self.to_space is not None:
            vertex["velocity"] = self.vertex_velocity.in_space(flow.side_flux, state.time)
            vertex["speed"] = np.linalg.norm(vertex["velocity"], axis=1)
        largest = float(np.abs(flow.side_flux).max(initial=0.0))
        scalar: dict[str, Any] = {
            "kinetic_energy": self.energy(state),
            "enstrophy": self.enstrophy(vorticity),
            "total_vorticity": float(vorticity.sum()),
            "absolute_vorticity": float(np.abs(vorticity).sum()),
            "divergence": float(np.abs(flow.side_flux.sum(axis=1)).max(initial=0.0)) / (largest or 1.0),
        }
        for name, values in (
            ("harmonic_coefficients", coefficients),
            ("boundary_circulation", self.boundary_circulation(vorticity, edge_flux)),
        ):
            if len(values):
                scalar[f"{name}_{self.name}"] = values
        return Observation(None, vertex, scalar)

    @cached_property
    def recovery(self) -> Recovery:
        """Velocities at the vertices from the fluxes through the edges."""
        return recovery(self.mesh, self.side)

    @cached_property
    def vertex_velocity(self) -> VertexVelocity:
        """Velocities at the vertices for frames and pressures."""
        return VertexVelocity(self.recovery, self.area, self.to_space, self.prescribed_velocity)

    def assembled(self) -> dict[str, Any]:
        """Counts for a dry run."""
        return {"vertices": self.n, "harmonic_flows": len(self.harmonic)}

    def circulation_terms(self) -> tuple[float, float]:
        """What a flow of kinetic energy 1/2 may at most add up to before it cancels in the vorticity.

        The first number bounds the sum over the vertices of the absolute circulations along their dual edges
        [1], the second the enstrophy of these sums without their signs [1/m^2].
        """
        star = np.abs(self.edge_inner)
        at_vertex = sum_by_index(self.mesh.topology.edges, np.repeat(star[:, None], 2, axis=1), self.n)
        return float(np.sqrt(2.0 * at_vertex.sum())), float((at_vertex * self.inverse_mass).max(initial=0.0))

    @cached_property
    def loops(self) -> tuple[int, NDArray[np.int64]]:
        """Number of boundary loops, and (n,) the loop of each vertex (-1 inside)."""
        topology = self.mesh.topology
        tail, head = topology.edges[topology.boundary_edges].T
        _, label = connected_labels(tail, head, self.n)
        loop = np.full(self.n, -1, dtype=np.int64)
        rim = np.flatnonzero(topology.boundary_vertex)
        names, loop[rim] = np.unique(label[rim], return_inverse=True)
        return len(names), loop

    def boundary_circulation(self, vorticity: NDArray, edge_flux: NDArray) -> NDArray[np.float64]:
        """(loops,) circulation along every boundary loop, with the surface on the left."""
        count, loop = self.loops
        if count == 0:
            return np.zeros(0)
        rim = loop >= 0
        around = vorticity - self.circulation_around(self.edge_inner * edge_flux)
        return sum_by_index(loop[rim], around[rim], count)

    def component_vorticity(self, vorticity: NDArray) -> NDArray[np.float64]:
        """(components,) total vorticity of each component."""
        label = self.mesh.topology.vertex_component
        in_component = label >= 0
        count = self.mesh.topology.n_components
        return sum_by_index(label[in_component], vorticity[in_component], count)
