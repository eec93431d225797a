"""A flow as a model for the one time loop: what moves, how it steps, when it stops, what it shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import (
    ROSENBROCK_GAMMAS,
    EnergyGradient,
    Preconditioner,
    TopologyTerms,
    descent_motion,
    energy_gradient,
    mean_curvature_step,
    moved_along,
    preconditioner_at,
    rosenbrock_step,
    vertex_normals,
)
from ddgcli.models.willmore.edge_flips import delaunay_flips, improved
from ddgcli.models.willmore.energies import EnergyBuilder
from ddgcli.models.willmore.redistribution import redistribute
from ddgcli.models.willmore.state import FlowState, Stop, rounding_scale
from ddgcli.simulation.model import Observation, StepRejected

# steps of the descent, for a surface with the area of the unit sphere
MAX_DESCENT_STEP, MIN_DESCENT_STEP = 0.05, 1e-14
MOTION_FRACTIONS = (1.0, 0.25, 0.0625)  # of a motion, tried before a shorter step is factorised
MOMENTUM_SHARE = 0.9  # part of the last step's motion that is added to the next one
KEPT_FALL_SHARE = 0.5  # of the energy's fall in a step, that slides and flips must leave
SUFFICIENT_DECREASE = 0.01  # of the fall that the slope promises, for a step of the descent to be taken
# a surface is near rest where steps above that share of the longest promise less than that of the energy
NEAR_REST_STEP_FRACTION, NEAR_REST_ENERGY_FRACTION = 0.01, 0.1
# of the least energy of its topology, below which only the mesh's error takes a surface
LOWER_BOUND_FRACTION = 0.9
LOWER_BOUND_REASON = (
    "the next step would go below the least energy of such surfaces: the mesh is too coarse or uneven"
)
# relative rise of a second energy over its lowest value, at which the flow ends if the first has since fallen
# by less than that
SECOND_ENERGY_RISE = 0.01
MESH_ERROR_REASON = "what is left of the gradient is the mesh's own error"
AGREEMENT_RATIO = 1.05  # ratio of the two energies up to which the surface is then at rest
CRUMPLING_REASON = "a second energy rises faster than this one falls: the faces crumple"
RESOLUTION_REASONS = (LOWER_BOUND_REASON, CRUMPLING_REASON)
# time schemes of each flow, the default first; `semi-implicit` is of first order
SCHEMES = {"quadratic": ("rosenbrock", "semi-implicit"), "mean-curvature": ("semi-implicit",)}
ZERO_ENERGY = 1e-12  # energy at which nothing is left to release
# relative predicted fall of the energy below which rounding decides: the surface is kept
PREDICTED_FALL_TOLERANCE = 1e-13
COLLAPSED_AREA_FRACTION = 1e-3  # share of the area at the start below which a surface counts as gone
ENERGY_ROUNDING = 1e-13  # relative rise of the energy that counts as one


def longest_step(flow: Flow) -> float:
    """First and longest step of the descent, at unit size."""
    return MAX_DESCENT_STEP * (flow.area / (4.0 * math.pi)) ** 2


@dataclass(eq=False)
class Flow:
    """Everything that a step needs besides the state.

    Parameters
    ----------
    topology : Topology
        Of the start.
    energy_kind : callable
        Topology -> Energy.
    convention : str
        What its number stands for.
    free : (k,) ndarray of int
        Vertices that move.
    constraints : Constraints
        At unit size.
    mean_curvature : bool
    scheme : str
        Of SCHEMES, for timed steps.
    timed : bool
        Steps have the length that the loop asks for (else each is as long as the descent allows).
    stop : Stop
    centre : (3,) ndarray
    scale : float
        Length unit of the states, in the input's unit.
    area : float
        At the start, at unit size.
    original : (n, 3) ndarray
        Positions at the start, of the input.
    least : float
        Lower bound of the smooth energy, 0 where none is known.
    keeps_triangles : bool
        Before and after steps to rest, vertices slide along the surface where angles are small, and edges
        flip.
    reported : mapping of str to callable
        Energies besides the one that the flow lowers, in every frame: Topology -> Energy.
    second_kind : callable, optional
        It shows bending that the first does not see: the flow ends where it rises.
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
    least: float
    keeps_triangles: bool = False
    reported: Mapping[str, EnergyBuilder] = field(default_factory=dict)
    second_kind: EnergyBuilder | None = None
    _last_terms: TopologyTerms | None = None
    _last_gradient: EnergyGradient | None = None
    _last_preconditioner: tuple[Preconditioner, float] | None = None

    @property
    def time_unit(self) -> float:
        """Time unit of the states in the input's: length^4, for mean curvature flow length^2."""
        return self.scale ** (2 if self.mean_curvature else 4)

    def advance(self, state: FlowState, time: float, dt: float) -> FlowState:
        """One step; StepRejected where a timed step would raise the energy."""
        if state.stopped:
            return state
        if state.steps == 0 and (rest := self.reason(state)):
            return replace(state, stopped=rest)
        if self.mean_curvature:
            return self._curvature_step(state, dt)
        at = self._gradient(state)
        if self.timed:
            return self._timed_step(state, at, dt)
        improved = self._improved_start(state) if state.steps == 0 and self.keeps_triangles else None
        if improved is not None:
            stepped = self._longest_step(improved, self._gradient(improved))
            if stepped.steps and stepped.energy <= state.energy:
                return stepped
        return self._longest_step(state, at)

    def reason(self, state: FlowState) -> str:
        """Why the flow ends at a state, or ""."""
        if state.stopped or self.mean_curvature:
            return state.stopped
        at = self._gradient(state)
        if self.stop.mesh_error and abs(at.energy) <= ZERO_ENERGY:
            return "the energy has vanished"
        if self.stop.gradient is not None and at.size <= self.stop.gradient:
            return f"gradient below {self.stop.gradient:g}"
        if self.stop.mesh_error and state.dt >= NEAR_REST_STEP_FRACTION * longest_step(self):
            preconditioner = self._preconditioner(at, state.dt)
            least = NEAR_REST_ENERGY_FRACTION * abs(at.energy) / state.dt
            if (
                preconditioner.descent_power() <= 2.0 * least
            ):  # what the two parts release is half of it or more
                across, along = preconditioner.powers()
                if across + along <= least and along >= across:
                    return MESH_ERROR_REASON
        return ""

    def _second(self, state: FlowState) -> float:
        second = self._terms(state.topology).second
        return math.inf if second is None else second.value(state.points)

    def mesh(self, state: FlowState) -> TriangleMesh:
        return TriangleMesh(state.points, state.topology)

    def _terms(self, topology: Topology) -> TopologyTerms:
        """What depends on the faces alone; that of the last topology is kept."""
        if self._last_terms is None or self._last_terms.topology is not topology:
            second = None if self.second_kind is None else self.second_kind(topology)
            self._last_terms = TopologyTerms(topology, self.energy_kind(topology), second, self.free)
        return self._last_terms

    def _energy(self, mesh: TriangleMesh) -> float:
        return self._terms(mesh.topology).energy.value(mesh.points)

    def _gradient(self, state: FlowState) -> EnergyGradient:
        """Gradient at the state; the last one is kept, since a rejected step starts there again."""
        if self._last_gradient is None or self._last_gradient.mesh.points is not state.points:
            energy = self._terms(state.topology).energy
            self._last_gradient = energy_gradient(self.mesh(state), energy, self.free, self.constraints)
        return self._last_gradient

    def _preconditioner(self, at: EnergyGradient, dt: float) -> Preconditioner:
        """Preconditioner for a step of length dt; the last one is kept, for `reason` and the step after."""
        last = self._last_preconditioner
        if last is None or last[0].at is not at or last[1] != dt:
            factor = self._terms(at.mesh.topology).factor
            last = self._last_preconditioner = preconditioner_at(at, dt, factor), dt
        return last[0]

    def _timed_step(self, state: FlowState, at: EnergyGradient, dt: float) -> FlowState:
        for moved in self._attempts(at, dt / self.time_unit):
            energy = self._energy(moved)
            if self._below_lower_bound(energy):
                return replace(state, stopped=LOWER_BOUND_REASON)
            if energy <= at.energy:
                return self._accepted(state, at, moved, energy, dt)
        promised = float(np.sum(at.gradient * (at.mesh.points - moved.points)[self.free]))
        if abs(promised) <= PREDICTED_FALL_TOLERANCE * rounding_scale(at.energy):
            return replace(state, time=state.time + dt, steps=state.steps + 1)
        raise StepRejected("energy rises", value=energy - at.energy)

    def _below_lower_bound(self, energy: float) -> bool:
        return self.least > 0.0 and energy < LOWER_BOUND_FRACTION * self.least

    def _attempts(self, at: EnergyGradient, dt: float) -> Iterator[TriangleMesh]:
        """The surface after dt, by what is tried in turn."""
        if self.scheme == "semi-implicit":
            inner = self._preconditioner(at, dt)
            yield moved_along(inner, descent_motion(inner, dt, self.constraints), 1.0, self.constraints)
            return
        for gamma in ROSENBROCK_GAMMAS:
            energy = self._terms(at.mesh.topology).energy
            yield rosenbrock_step(self._preconditioner(at, gamma * dt), dt, energy, self.constraints)

    def _longest_step(self, state: FlowState, at: EnergyGradient) -> FlowState:
        """Descent step, shortened until the energy falls enough; the next one starts at twice a length that
        did, whole or by its first share. A share of the same motion costs no factorisation, so that is tried
        first. To the first motion of a step a part of the last step's is added where that goes downhill."""
        dt, shrink = state.dt, 0.25
        last = state.motion[self.free] if state.motion is not None else None
        if last is not None and float(np.sum(at.gradient * last)) >= 0.0:
            last = None
        while dt >= MIN_DESCENT_STEP:
            preconditioner = self._preconditioner(at, dt)
            plain = descent_motion(preconditioner, dt, self.constraints)
            motions = [plain] if last is None else [plain + MOMENTUM_SHARE * last, plain]
            for motion in motions:
                stepped = self._shared_step(state, at, preconditioner, motion, dt)
                if stepped is not None:
                    return stepped
            last = None
            dt, shrink = dt * shrink, 0.25 * shrink
        return replace(state, stopped="no step lowers the energy")

    def _shared_step(
        self, state: FlowState, at: EnergyGradient, preconditioner: Preconditioner, motion: NDArray, dt: float
    ) -> FlowState | None:
        """The largest share of a motion that lowers the energy enough; None where none does."""
        promised = -float(np.sum(at.gradient * motion))
        for share in MOTION_FRACTIONS:
            moved = moved_along(preconditioner, motion, share, self.constraints)
            energy = self._energy(moved)
            if energy <= at.energy - SUFFICIENT_DECREASE * share * promised:
                if self._below_lower_bound(energy):
                    return replace(state, stopped=LOWER_BOUND_REASON)
                at_once = dt == state.dt and share >= MOTION_FRACTIONS[1]
                carried = np.zeros_like(state.points)
                carried[self.free] = share * motion
                if self.keeps_triangles:
                    state, moved, energy = self._better_triangles(state, at, preconditioner, moved, energy)
                stepped = self._accepted(state, at, moved, energy, share * dt * self.time_unit)
                return replace(
                    stepped, dt=min(longest_step(self), 2.0 * dt if at_once else dt), motion=carried
                )
        return None

    def _better_triangles(
        self, state: FlowState, at: EnergyGradient, preconditioner: Preconditioner, moved: TriangleMesh,
        energy: float,
    ) -> tuple[FlowState, TriangleMesh, float]:  # fmt: skip
        """After a step vertices slide and edges flip, each kept where half of the energy's fall is left.

        The counts in the state, the surface and its energy.
        """
        highest = at.energy - KEPT_FALL_SHARE * (at.energy - energy)
        slid = redistribute(moved, vertex_normals(moved), self._movable)
        if slid is not None:
            slid = self.constraints.restore(slid, self.free, preconditioner.solve)
            if (slid_energy := self._energy(slid)) <= highest:
                moved, energy = slid, slid_energy
                state = replace(state, redistributions=state.redistributions + 1)
        topology = delaunay_flips(moved, self._movable)
        if topology is not None:
            flipped = self.constraints.restore(
                TriangleMesh(moved.points, topology), self.free, preconditioner.solve
            )
            if (flipped_energy := self._energy(flipped)) <= highest:
                moved, energy, state = flipped, flipped_energy, replace(state, flips=state.flips + 1)
        return state, moved, energy

    @cached_property
    def _movable(self) -> NDArray[np.bool_]:
        movable = np.zeros(self.topology.n_vertices, dtype=bool)
        movable[self.free] = True
        return movable

    def _improved_start(self, state: FlowState) -> FlowState | None:
        """The surface with flips and slides before the first step; None where there are none."""
        mesh = improved(self.mesh(state), vertex_normals, self._movable)
        if mesh is None:
            return None
        changed = replace(state, points=mesh.points, topology=mesh.topology)
        if self.constraints.active:
            preconditioner = self._preconditioner(self._gradient(changed), state.dt)
            mesh = self.constraints.restore(mesh, self.free, preconditioner.solve)
        slides = int(not np.array_equal(mesh.points, state.points))
        return replace(
            changed, points=mesh.points, energy=self._energy(mesh), redistributions=slides,
            flips=int(mesh.topology is not state.topology),
        )  # fmt: skip

    def _accepted(
        self, state: FlowState, at: EnergyGradient, moved: TriangleMesh, energy: float, dt: float
    ) -> FlowState:
        stopped = ""
        if self.stop.fall is not None and at.energy - energy < self.stop.fall * abs(energy):
            stopped = f"energy fell by less than {self.stop.fall:g} of itself in a step"
        lowest, then = state.lowest_second, state.energy_then
        if (second_energy := self._terms(moved.topology).second) is not None:
            second = second_energy.value(moved.points)
            if second - lowest > max(SECOND_ENERGY_RISE * lowest, then - energy):
                agree = 1.0 / AGREEMENT_RATIO < self._second(state) / state.energy < AGREEMENT_RATIO
                return replace(state, stopped=MESH_ERROR_REASON if agree else CRUMPLING_REASON)
            lowest, then = (second, energy) if second < lowest else (lowest, then)
        rose = energy - at.energy > ENERGY_ROUNDING * rounding_scale(at.energy)
        return replace(
            state, points=moved.points, topology=moved.topology, energy=energy, time=state.time + dt,
            steps=state.steps + 1, increases=state.increases + rose, stopped=stopped,
            lowest_second=lowest, energy_then=then,
        )  # fmt: skip

    def _curvature_step(self, state: FlowState, dt: float) -> FlowState:
        mesh = self.mesh(state)
        before = area(mesh)
        try:
            moved = mean_curvature_step(mesh, self.free, dt / self.time_unit)
        except SolveError:
            return replace(state, stopped=f"the surface became singular at time {state.time:.6g}")
        after, energy = area(moved), self._energy(moved)
        if not math.isfinite(energy):
            return replace(state, stopped=f"the surface became singular at time {state.time:.6g}")
        rose = energy - state.energy > ENERGY_ROUNDING * rounding_scale(state.energy)
        stopped = "the surface collapsed" if after < COLLAPSED_AREA_FRACTION * self.area else ""
        if self.stop.fall is not None and not stopped and before - after < self.stop.fall * before:
            stopped = f"area fell by less than {self.stop.fall:g} of itself in a step"
        return replace(
            state, points=moved.points, energy=energy, time=state.time + dt, stopped=stopped,
            steps=state.steps + 1,
            increases=state.increases + rose,
            area_increases=state.area_increases + (after > before * (1.0 + ENERGY_ROUNDING)),
        )  # fmt: skip

    def distance(self, a: FlowState, b: FlowState) -> float:
        """Largest distance between two states' vertices, relative to the surface's radius."""
        apart = np.sqrt(np.max(np.sum((a.points - b.points) ** 2, axis=1), initial=0.0))
        return float(apart / math.sqrt(self.area / (4.0 * math.pi)))

    def observe(self, state: FlowState) -> Observation:
        """The surface in the input's frame, its energy, area, volume and smallest angle."""
        mesh = self.mesh(state)
        angles = corner_angle(mesh.side_length)
        scalar = {
            "energy": state.energy,
            "area": area(mesh) * self.scale**2,
            "min_angle_degrees": float(np.degrees(angles.min())),
            "steps": float(state.steps),
            "energy_increases": float(state.increases),
            "area_increases": float(state.area_increases),
            "redistributions": float(state.redistributions),
            "flips": float(state.flips),
        }
        if self.topology.is_closed:
            volume = enclosed_volume(mesh)
            scalar["volume"] = volume * self.scale**3
            scalar["reduced_volume"] = 6.0 * math.sqrt(math.pi) * abs(volume) / area(mesh) ** 1.5
        for name, kind in self.reported.items():
            scalar[f"energy_{name}"] = kind(state.topology).value(mesh.points)
        for name, residual in self.constraints.residuals(mesh).items():
            scalar[f"{name}_residual"] = residual
        points = np.array(self.original)
        if state.steps:
            points[self.free] = state.points[self.free] * self.scale + self.centre
        return Observation(points, {}, scalar, faces=mesh.faces if self.keeps_triangles else None)

    def pack(self, state: FlowState) -> dict[str, NDArray]:
        """The state as arrays of fixed shape (why it stopped need not go on)."""
        return state.arrays(descent=not self.timed)

    def unpack(self, arrays: dict[str, NDArray]) -> FlowState:
        return FlowState.of_arrays(arrays, self.topology)
