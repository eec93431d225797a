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
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import (
    ROSENBROCK_GAMMAS,
    EnergyGradient,
    Preconditioner,
    descent_motion,
    energy_gradient,
    fourth_order_matrix,
    mean_curvature_step,
    moved_along,
    preconditioner_at,
    rosenbrock_step,
    vertex_normals,
)
from ddgcli.models.willmore.energies import Energy
from ddgcli.models.willmore.redistribution import redistribute
from ddgcli.simulation.model import Observation, StepRejected

# steps of the descent, for a surface with the area of the unit sphere
MAX_DESCENT_STEP, MIN_DESCENT_STEP = 0.05, 1e-14
MOTION_FRACTIONS = (1.0, 0.25, 0.0625)  # of a motion, tried before a shorter step is factorised
SUFFICIENT_DECREASE = 0.01  # of the fall that the slope promises, for a step of the descent to be taken
# a surface is near rest where steps above that share of the longest promise less than that of the energy
NEAR_REST_STEP_FRACTION, NEAR_REST_ENERGY_FRACTION = 0.01, 0.1
# of the least energy of its topology, below which only the mesh's error takes a surface
LOWER_BOUND_FRACTION = 0.9
BELOW_LOWER_BOUND = (
    "the next step would go below the least energy of such surfaces: the mesh is too coarse or uneven"
)
# of the least energy of its topology, above which a surface that is below it is at rest
LOWER_BOUND_TOLERANCE = 0.985
LOWER_BOUND_REACHED = "the least energy of such surfaces is reached, and the next step would go far below it"
CRUMPLING_RATIO = 1.2  # of a second energy over its lowest value, at which the faces crumple
CRUMPLING = f"a second energy rose by a factor of {CRUMPLING_RATIO} while this one fell: the faces crumple"
UNRESOLVED = (BELOW_LOWER_BOUND, CRUMPLING)
# time schemes of each flow, the default first; `semi-implicit` is of first order
SCHEMES = {"quadratic": ("rosenbrock", "semi-implicit"), "mean-curvature": ("semi-implicit",)}
ZERO_ENERGY = 1e-12  # energy at which nothing is left to release
ENERGY_UNIT = 1.0  # energies are free of units; rounding of smaller ones is compared with this
# relative predicted fall of the energy below which rounding decides: the surface is kept
PREDICTED_FALL_TOLERANCE = 1e-13
COLLAPSED_AREA_FRACTION = 1e-3  # share of the area at the start below which a surface counts as gone
ENERGY_ROUNDING = 1e-13  # relative rise of the energy that counts as one


@dataclass(frozen=True)
class Stop:
    """When a flow ends early; None leaves a criterion out.

    Parameters
    ----------
    gradient : float or None
        Dimensionless size of the gradient, |grad|_L2 area / energy.
    fall : float or None
        Relative fall of the energy in a step.
    mesh_error : bool
        End where no energy is left, and near rest where the gradient's part along the surface, made by the
        mesh alone, outweighs the part across.
    """

    gradient: float | None = None
    fall: float | None = None
    mesh_error: bool = False


DEFAULT_STOP = Stop(1e-6, 1e-8, True)


@dataclass(frozen=True, eq=False)
class FlowState:
    """A surface on its way, at unit size.

    Parameters
    ----------
    points : (n, 3) ndarray
    energy : float
    time : float
        Flow time so far, in the input's unit.
    dt : float
        Next step of the descent, for the surface at unit size.
    steps : int
        Taken so far.
    increases, area_increases : int
        Steps so far over which the energy, or the area, rose.
    stopped : str
    lowest_second : float
        Lowest value so far of the second energy.
    redistributions : int
        Steps so far after which vertices slid along the surface.
    """

    points: NDArray[np.float64]
    energy: float
    time: float
    dt: float
    steps: int = 0
    increases: int = 0
    area_increases: int = 0
    stopped: str = ""
    lowest_second: float = math.inf
    redistributions: int = 0


def rounding_scale(energy: float) -> float:
    """What the rounding of an energy is relative to."""
    return max(abs(energy), ENERGY_UNIT)


def longest_step(flow: Flow) -> float:
    """First and longest step of the descent, at unit size."""
    return MAX_DESCENT_STEP * (flow.area / (4.0 * math.pi)) ** 2


@dataclass(eq=False)
class Flow:
    """Everything that a step needs besides the state.

    Parameters
    ----------
    topology : Topology
    energy : Energy
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
    along_normals : bool
        Steps to rest move the vertices along their normals.
    redistributes : bool
        After steps to rest, vertices slide along the surface where angles are small.
    reported : mapping of str to Energy
        Energies besides the one that the flow lowers, in every frame.
    second_energy : Energy, optional
        It shows bending that `energy` does not see: the flow ends where it rises by CRUMPLING_RISE.
    """

    topology: Topology
    energy: Energy
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
    along_normals: bool = False
    redistributes: bool = False
    reported: Mapping[str, Energy] = field(default_factory=dict)
    second_energy: Energy | None = None
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
        return self._timed_step(state, at, dt) if self.timed else self._longest_step(state, at)

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
                    return "what is left of the gradient is the mesh's own error"
        return ""

    def mesh(self, state: FlowState) -> TriangleMesh:
        return TriangleMesh(state.points, self.topology)

    def _gradient(self, state: FlowState) -> EnergyGradient:
        """Gradient at the state; the last one is kept, since a rejected step starts there again."""
        if self._last_gradient is None or self._last_gradient.mesh.points is not state.points:
            self._last_gradient = energy_gradient(
                self.mesh(state), self.energy, self.free, self.constraints, self.along_normals
            )
        return self._last_gradient

    def _preconditioner(self, at: EnergyGradient, dt: float) -> Preconditioner:
        """Preconditioner for a step of length dt; the last one is kept, for `reason` and the step after."""
        last = self._last_preconditioner
        if last is None or last[0].at is not at or last[1] != dt:
            last = self._last_preconditioner = preconditioner_at(at, dt, self._factor), dt
        return last[0]

    @cached_property
    def _factor(self) -> Factor:
        """Its order and analysis serve every preconditioner; of the start, also after --resume."""
        start = TriangleMesh((self.original - self.centre) / self.scale, self.topology)
        return Factor(fourth_order_matrix(start, self.free, longest_step(self)))

    def _timed_step(self, state: FlowState, at: EnergyGradient, dt: float) -> FlowState:
        for moved in self._attempts(at, dt / self.time_unit):
            energy = self.energy.value(moved.points)
            if self._below_lower_bound(energy):
                return replace(state, stopped=BELOW_LOWER_BOUND)
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
            yield rosenbrock_step(self._preconditioner(at, gamma * dt), dt, self.energy, self.constraints)

    def _longest_step(self, state: FlowState, at: EnergyGradient) -> FlowState:
        """Descent step, shortened until the energy falls enough; the next one starts at twice a length that
        did, whole or by its first share. A share of the same motion costs no factorisation, so that is tried
        first."""
        dt, shrink = state.dt, 0.25
        while dt >= MIN_DESCENT_STEP:
            preconditioner = self._preconditioner(at, dt)
            motion = descent_motion(preconditioner, dt, self.constraints)
            promised = -float(np.sum(at.gradient * motion))
            for share in MOTION_FRACTIONS:
                moved = moved_along(preconditioner, motion, share, self.constraints)
                energy = self.energy.value(moved.points)
                if energy <= at.energy - SUFFICIENT_DECREASE * share * promised:
                    if self._below_lower_bound(energy):
                        reached = LOWER_BOUND_TOLERANCE * self.least <= at.energy <= self.least
                        return replace(state, stopped=LOWER_BOUND_REACHED if reached else BELOW_LOWER_BOUND)
                    at_once = dt == state.dt and share >= MOTION_FRACTIONS[1]
                    slid = self._redistributed(at, preconditioner, moved) if self.redistributes else None
                    moved, energy = slid or (moved, energy)
                    stepped = self._accepted(state, at, moved, energy, share * dt * self.time_unit)
                    stepped = replace(stepped, redistributions=state.redistributions + (slid is not None))
                    return replace(stepped, dt=min(longest_step(self), 2.0 * dt if at_once else dt))
            dt, shrink = dt * shrink, 0.25 * shrink
        return replace(state, stopped="no step lowers the energy")

    def _redistributed(
        self, at: EnergyGradient, preconditioner: Preconditioner, moved: TriangleMesh
    ) -> tuple[TriangleMesh, float] | None:
        """The surface after a step with vertices slid, and its energy; None where that would raise it."""
        movable = np.zeros(moved.n_vertices, dtype=bool)
        movable[self.free] = True
        slid = redistribute(moved, vertex_normals(moved), movable)
        if slid is None:
            return None
        slid = self.constraints.restore(slid, self.free, preconditioner.solve)
        energy = self.energy.value(slid.points)
        return (slid, energy) if energy <= at.energy else None

    def _accepted(
        self, state: FlowState, at: EnergyGradient, moved: TriangleMesh, energy: float, dt: float
    ) -> FlowState:
        stopped = ""
        if self.stop.fall is not None and at.energy - energy < self.stop.fall * abs(energy):
            stopped = f"energy fell by less than {self.stop.fall:g} of itself in a step"
        lowest = state.lowest_second
        if self.second_energy is not None:
            second = self.second_energy.value(moved.points)
            lowest = min(lowest, second)
            stopped = CRUMPLING if second > CRUMPLING_RATIO * lowest else stopped
        rose = energy - at.energy > ENERGY_ROUNDING * rounding_scale(at.energy)
        return replace(
            state, points=moved.points, energy=energy, time=state.time + dt, steps=state.steps + 1,
            increases=state.increases + rose, stopped=stopped, lowest_second=lowest,
        )  # fmt: skip

    def _curvature_step(self, state: FlowState, dt: float) -> FlowState:
        mesh = self.mesh(state)
        before = area(mesh)
        try:
            moved = mean_curvature_step(mesh, self.free, dt / self.time_unit)
        except SolveError:
            return replace(state, stopped=f"the surface became singular at time {state.time:.6g}")
        after, energy = area(moved), self.energy.value(moved.points)
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
        }
        if self.topology.is_closed:
            volume = enclosed_volume(mesh)
            scalar["volume"] = volume * self.scale**3
            scalar["reduced_volume"] = 6.0 * math.sqrt(math.pi) * abs(volume) / area(mesh) ** 1.5
        for name, energy in self.reported.items():
            scalar[f"energy_{name}"] = energy.value(mesh.points)
        for name, residual in self.constraints.residuals(mesh).items():
            scalar[f"{name}_residual"] = residual
        points = np.array(self.original)
        if state.steps:
            points[self.free] = state.points[self.free] * self.scale + self.centre
        return Observation(points, {}, scalar)

    def pack(self, state: FlowState) -> dict[str, NDArray]:
        """The state as arrays of fixed shape (why it stopped need not go on)."""
        numbers = [
            state.energy, state.time, state.dt, state.steps, state.increases, state.area_increases,
            state.lowest_second, state.redistributions,
        ]  # fmt: skip
        return {"points": state.points, "numbers": np.array(numbers, dtype=np.float64)}

    def unpack(self, arrays: dict[str, NDArray]) -> FlowState:
        energy, time, dt, steps, increases, area_increases, lowest, slides = map(float, arrays["numbers"])
        counts = int(steps), int(increases), int(area_increases)
        return FlowState(
            arrays["points"], energy, time, dt, *counts, lowest_second=lowest, redistributions=int(slides)
        )
