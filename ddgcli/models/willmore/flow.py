"""A flow as a model for the one time loop: what moves, how it steps, when it stops, what it shows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
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
    GAMMAS,
    Metric,
    Slope,
    accurate_step,
    descent,
    followed,
    fourth_order,
    mean_curvature_step,
    metric,
    slope,
)
from ddgcli.models.willmore.energies import Energy
from ddgcli.simulation.time_loop import Observation, StepRejected

# steps of the descent, for a surface with the area of the unit sphere
LONGEST, SHORTEST = 0.05, 1e-14
SHARES = (1.0, 0.25, 0.0625)  # of a motion, tried before a shorter step is factorised
ENOUGH = 0.01  # of the fall that the slope promises, for a step of the descent to be taken
# a surface is near rest where steps above that share of the longest promise less than that of the energy
UNHINDERED, NEAR = 0.01, 0.1
IMPOSSIBLE = 0.9  # of the least energy of its topology, below which only the mesh's error takes a surface
TOO_UNEVEN = (
    "the next step would go below the least energy of such surfaces: the mesh is too coarse or uneven"
)
REACHED = 0.985  # of the least energy of its topology, above which a surface that is below it is at rest
LEAST_REACHED = "the least energy of such surfaces is reached, and the next step would go far below it"
CRUMPLING_RISE = 1.2  # of a second energy over its lowest value, at which the faces crumple
CRUMPLED = f"a second energy rose by a factor of {CRUMPLING_RISE} while this one fell: the faces crumple"
UNRESOLVED = (TOO_UNEVEN, CRUMPLED)
# time schemes of each flow, the default first; `semi-implicit` is of first order
SCHEMES = {"quadratic": ("rosenbrock", "semi-implicit"), "mean-curvature": ("semi-implicit",)}
VANISHED = 1e-12  # energy at which nothing is left to release
ENERGY_UNIT = 1.0  # energies are free of units; rounding of smaller ones is compared with this
HELD = 1e-13  # relative predicted fall of the energy below which rounding decides: the surface is kept
COLLAPSED = 1e-3  # share of the area at the start below which a surface counts as gone
ROUNDING = 1e-13  # relative rise of the energy that counts as one


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


def rounding_scale(energy: float) -> float:
    """What the rounding of an energy is relative to."""
    return max(abs(energy), ENERGY_UNIT)


def longest_step(flow: Flow) -> float:
    """First and longest step of the descent, at unit size."""
    return LONGEST * (flow.area / (4.0 * math.pi)) ** 2


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
        Positions at the start, as given.
    least : float
        Lower bound of the smooth energy, 0 where none is known.
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
    second_energy: Energy | None = None
    _kept: Slope | None = None
    _prepared: tuple[Metric, float] | None = None

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
        at = self._slope(state)
        return self._timed_step(state, at, dt) if self.timed else self._longest_step(state, at)

    def reason(self, state: FlowState) -> str:
        """Why the flow ends at a state, or ""."""
        if state.stopped or self.mean_curvature:
            return state.stopped
        at = self._slope(state)
        if self.stop.mesh_error and abs(at.energy) <= VANISHED:
            return "the energy has vanished"
        if self.stop.gradient is not None and at.size <= self.stop.gradient:
            return f"gradient below {self.stop.gradient:g}"
        if self.stop.mesh_error and state.dt >= UNHINDERED * longest_step(self):
            preconditioner, least = self._metric(at, state.dt), NEAR * abs(at.energy) / state.dt
            if (
                preconditioner.descent_power() <= 2.0 * least
            ):  # what the two parts release is half of it or more
                across, along = preconditioner.powers()
                if across + along <= least and along >= across:
                    return "what is left of the gradient is the mesh's own error"
        return ""

    def mesh(self, state: FlowState) -> TriangleMesh:
        return TriangleMesh(state.points, self.topology)

    def _slope(self, state: FlowState) -> Slope:
        """Gradient at the state; the last one is kept, since a rejected step starts there again."""
        if self._kept is None or self._kept.mesh.points is not state.points:
            self._kept = slope(self.mesh(state), self.energy, self.free, self.constraints)
        return self._kept

    def _metric(self, at: Slope, dt: float) -> Metric:
        """Preconditioner for a step of length dt; the last one is kept, for `reason` and the step after."""
        if self._prepared is None or self._prepared[0].at is not at or self._prepared[1] != dt:
            self._prepared = metric(at, dt, self._factor), dt
        return self._prepared[0]

    @cached_property
    def _factor(self) -> Factor:
        """Its order and analysis serve every preconditioner; of the start, also after --resume."""
        start = TriangleMesh((self.original - self.centre) / self.scale, self.topology)
        return Factor(fourth_order(start, self.free, longest_step(self)))

    def _timed_step(self, state: FlowState, at: Slope, dt: float) -> FlowState:
        for moved in self._attempts(at, dt / self.time_unit):
            energy = self.energy.value(moved.points)
            if self._impossible(energy):
                return replace(state, stopped=TOO_UNEVEN)
            if energy <= at.energy:
                return self._stepped(state, at, moved, energy, dt)
        promised = float(np.sum(at.gradient * (at.mesh.points - moved.points)[self.free]))
        if abs(promised) <= HELD * rounding_scale(at.energy):
            return replace(state, time=state.time + dt, steps=state.steps + 1)
        raise StepRejected("energy rises", value=energy - at.energy)

    def _impossible(self, energy: float) -> bool:
        return self.least > 0.0 and energy < IMPOSSIBLE * self.least

    def _attempts(self, at: Slope, dt: float) -> Iterator[TriangleMesh]:
        """The surface after dt, by what is tried in turn."""
        if self.scheme == "semi-implicit":
            inner = self._metric(at, dt)
            yield followed(inner, descent(inner, dt, self.constraints), 1.0, self.constraints)
            return
        for gamma in GAMMAS:
            yield accurate_step(self._metric(at, gamma * dt), dt, self.energy, self.constraints)

    def _longest_step(self, state: FlowState, at: Slope) -> FlowState:
        """Descent step, shortened until the energy falls enough; the next one starts at twice a length that
        did, whole or by its first share. A share of the same motion costs no factorisation, so that is tried
        first."""
        dt, shrink = state.dt, 0.25
        while dt >= SHORTEST:
            preconditioner = self._metric(at, dt)
            motion = descent(preconditioner, dt, self.constraints)
            promised = -float(np.sum(at.gradient * motion))
            for share in SHARES:
                moved = followed(preconditioner, motion, share, self.constraints)
                energy = self.energy.value(moved.points)
                if energy <= at.energy - ENOUGH * share * promised:
                    if self._impossible(energy):
                        reached = REACHED * self.least <= at.energy <= self.least
                        return replace(state, stopped=LEAST_REACHED if reached else TOO_UNEVEN)
                    at_once = dt == state.dt and share >= SHARES[1]
                    stepped = self._stepped(state, at, moved, energy, share * dt * self.time_unit)
                    return replace(stepped, dt=min(longest_step(self), 2.0 * dt if at_once else dt))
            dt, shrink = dt * shrink, 0.25 * shrink
        return replace(state, stopped="no step lowers the energy")

    def _stepped(
        self, state: FlowState, at: Slope, moved: TriangleMesh, energy: float, dt: float
    ) -> FlowState:
        stopped = ""
        if self.stop.fall is not None and at.energy - energy < self.stop.fall * abs(energy):
            stopped = f"energy fell by less than {self.stop.fall:g} of itself in a step"
        lowest = state.lowest_second
        if self.second_energy is not None:
            second = self.second_energy.value(moved.points)
            lowest = min(lowest, second)
            stopped = CRUMPLED if second > CRUMPLING_RISE * lowest else stopped
        rose = energy - at.energy > ROUNDING * rounding_scale(at.energy)
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
        stopped = "the surface collapsed" if after < COLLAPSED * self.area else ""
        if self.stop.fall is not None and not stopped and before - after < self.stop.fall * before:
            stopped = f"area fell by less than {self.stop.fall:g} of itself in a step"
        return replace(
            state, points=moved.points, energy=energy, time=state.time + dt, stopped=stopped,
            steps=state.steps + 1,
            increases=state.increases + (energy - state.energy > ROUNDING * rounding_scale(state.energy)),
            area_increases=state.area_increases + (after > before * (1.0 + ROUNDING)),
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
        }
        if self.topology.is_closed:
            scalar["volume"] = enclosed_volume(mesh) * self.scale**3
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
            state.lowest_second,
        ]  # fmt: skip
        return {"points": state.points, "numbers": np.array(numbers, dtype=np.float64)}

    def unpack(self, arrays: dict[str, NDArray]) -> FlowState:
        energy, time, dt, steps, increases, area_increases, lowest = (float(x) for x in arrays["numbers"])
        counts = int(steps), int(increases), int(area_increases)
        return FlowState(arrays["points"], energy, time, dt, *counts, lowest_second=lowest)
