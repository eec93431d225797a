"""What the steps of a flow evaluate at a state: energies, gradients, preconditioners; and its frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.conformal import log_ratio_change
from ddgcli.models.willmore.constraints import Constraints, areas
from ddgcli.models.willmore.descent import (
    EnergyGradient,
    Preconditioner,
    TopologyTerms,
    energy_gradient,
    preconditioner_at,
)
from ddgcli.models.willmore.energies import EnergyBuilder
from ddgcli.models.willmore.least_energies import EnergyBounds
from ddgcli.models.willmore.observation import counters, frame_of, measured
from ddgcli.models.willmore.remesh_step import RemeshTarget
from ddgcli.models.willmore.second_energy import SecondEnergy
from ddgcli.models.willmore.state import FlowState, Stop
from ddgcli.models.willmore.step_lengths import longest_step
from ddgcli.simulation.model import Ending, Observation


@dataclass(eq=False)
class FlowTerms:
    """What the steps of a flow evaluate, besides the state, and what a frame shows of a state.

    Parameters
    ----------
    topology : Topology
        Of the start.
    energy_kind : callable
        Topology -> Energy.
    convention : str
        What its number approximates.
    free : (k,) ndarray of int
        Vertices that move.
    constraints : Constraints
        At unit size.
    mean_curvature : bool
    scheme : str
        Of `flow_options.SCHEMES`, for timed steps.
    timed : bool
        Steps have the length that the loop prescribes (else each is as long as the descent allows).
    stop : Stop
    centre : (3,) ndarray
    scale : float
        Length unit of the states, in the input's unit.
    area : float
        At the start, at unit size.
    original : (n, 3) ndarray
        Positions at the start, of the input.
    bounds : EnergyBounds
        Bounds of the smooth energy.
    keeps_triangles : bool
        Before and after steps to rest, vertices slide along the surface where angles are small, and edges
        flip.
    reported : mapping of str to callable
        Energies besides the one that the flow lowers, in every frame: Topology -> Energy.
    second : SecondEnergy, optional
    of_area : bool
        The energy that steps to rest lower is an area, or a volume with the other sign.
    energy_power : int
        Of the length unit in the energy.
    kind : str
        `descent`; `newton`: steps by a trust region; `conformal`: steps change the curvature, by a share.
    of_surface : bool
        The energy approximates one of smooth surfaces, whose gradient has no part along the surface.
    remesh : RemeshTarget, optional
        Edges are split, collapse and flip before steps.
    by_pairs : bool
        Steps of the descent to rest are quasi-Newton motions by secant pairs (else with momentum).
    ending_at_start : Ending or None
        Why no vertex moves.
    """

    topology: Topology
    energy_kind: EnergyBuilder
    convention: str
    free: NDArray[np.int64]
    constraints: Constraints
    mean_curvature: bool
    scheme: str
    timed: bool
    stop: Stop
    centre: NDArray[np.float64]
    scale: float
    area: float
    original: NDArray[np.float64]
    bounds: EnergyBounds
    keeps_triangles: bool = False
    reported: Mapping[str, EnergyBuilder] = field(default_factory=dict)
    second: SecondEnergy | None = None
    of_area: bool = False
    energy_power: int = 0
    kind: str = "descent"
    of_surface: bool = True
    remesh: RemeshTarget | None = None
    by_pairs: bool = False
    ending_at_start: Ending | None = None
    _last_terms: TopologyTerms | None = None
    _last_gradient: EnergyGradient | None = None
    _last_preconditioner: tuple[Preconditioner, float] | None = None

    @cached_property
    def longest(self) -> float:
        """Longest step of the descent, at unit size."""
        return longest_step(self.area, self.of_area)

    @property
    def time_unit(self) -> float:
        """Time unit of the states in the input's: length^4, for mean curvature flow length^2."""
        return self.scale ** (2 if self.mean_curvature or self.of_area else 4)

    @cached_property
    def _unit_start(self) -> TriangleMesh:
        return TriangleMesh((self.original - self.centre) / self.scale, self.topology)

    @cached_property
    def component_area(self) -> NDArray[np.float64]:
        """(c,) area of each component at the start, at unit size."""
        return areas(self._unit_start, self.topology.vertex_component)

    def mesh(self, state: FlowState) -> TriangleMesh:
        return TriangleMesh(state.points, state.topology)

    def _terms(self, topology: Topology) -> TopologyTerms:
        """What depends on the faces alone; that of the last topology is kept."""
        if self._last_terms is None or self._last_terms.topology is not topology:
            second = None if self.second is None else self.second.builder(topology)
            self._last_terms = TopologyTerms(topology, self.energy_kind(topology), second, self.of_area)
        return self._last_terms

    def energy_of(self, mesh: TriangleMesh) -> float:
        """Energy of a surface at unit size."""
        return self._terms(mesh.topology).energy.value(mesh.points)

    def _second(self, state: FlowState) -> float:
        second = self._terms(state.topology).second
        return math.inf if second is None else second.value(state.points)

    def _below_lower_bound(self, energy: float) -> bool:
        return energy < self.bounds.lowest

    def _gradient(self, state: FlowState) -> EnergyGradient:
        """Gradient at the state; the last one is kept, since a rejected step starts there again."""
        if self._last_gradient is None or self._last_gradient.mesh.points is not state.points:
            energy = self._terms(state.topology).energy
            self._last_gradient = energy_gradient(
                self.mesh(state), energy, self.free_of(state), self.constraints, self.kind == "newton"
            )
        return self._last_gradient

    def _preconditioner(self, at: EnergyGradient, dt: float) -> Preconditioner:
        """Preconditioner for a step of length dt; the last one is kept, for `reason` and the step after."""
        last = self._last_preconditioner
        if last is None or last[0].at is not at or last[1] != dt:
            factor = self._terms(at.mesh.topology).factor(at.free)
            metric = preconditioner_at(at, dt, factor, self.of_area, self.kind == "newton")
            last = self._last_preconditioner = metric, dt
        return last[0]

    def movable(self, state: FlowState) -> NDArray[np.bool_]:
        """(n,) whether each vertex of a state moves: those of the start that do, and all new ones."""
        origin = state.remeshing.origin
        start = np.bincount(self.free, minlength=self.topology.n_vertices) > 0
        return start if origin is None else (origin < 0) | start[origin]

    def free_of(self, state: FlowState) -> NDArray[np.int64]:
        """(k,) vertices of a state that move."""
        return self.free if state.remeshing.origin is None else np.flatnonzero(self.movable(state))

    def restored(self, state: FlowState) -> TriangleMesh:
        """The surface of a state, back on the constraints."""
        if not self.constraints.active:
            return self.mesh(state)
        preconditioner = self._preconditioner(self._gradient(state), state.dt)
        return self.constraints.restore(self.mesh(state), self.free_of(state), preconditioner.solve)

    def observe(self, state: FlowState) -> Observation:
        """The surface in the input's frame, its energy, area, volume and smallest angle."""
        mesh = self.mesh(state)
        scalar = counters(state, self.scale**self.energy_power)
        scalar |= measured(mesh, self.constraints, self.scale, self.topology.n_components)
        if self.kind == "conformal":
            scalar |= log_ratio_change(self._unit_start, mesh)
        for name, kind in self.reported.items():
            scalar[f"energy_{name}"] = kind(state.topology).value(mesh.points)
        where = (self.original, self.movable(state), self.scale, self.centre)
        return frame_of(state, scalar, *where, self.keeps_triangles)

    def pack(self, state: FlowState) -> dict[str, NDArray]:
        """The state as arrays of fixed shape (without the ending)."""
        return state.arrays(descent=not self.timed, pairs=self.by_pairs)

    def unpack(self, arrays: dict[str, NDArray]) -> FlowState:
        state = FlowState.of_arrays(arrays, self.topology, len(self.free))
        if len(state.ends.time):
            left = state.ends.remaining(self.topology, self.topology.vertex_component)
            state = replace(state, topology=left)
        return replace(state, ending=self.ending_at_start)
