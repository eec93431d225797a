"""Passive scalars carried by a flow: second order, without new extrema, of constant amount.

Every vertex is traced back to where the flow brings it from and takes the value there of a cubic interpolant
whose slopes are recovered at the vertices (`recovery`). The value is limited to those of the corners of the
face met. What limiting and interpolation change in the amount is returned to the vertices that have room
between their bounds, in proportion to it. Through an open boundary the flow takes the amount that is there:
the trapezoidal rule over the step. Where fluid enters, the scalar is that at the start.

R. Bermejo and A. Staniforth, "The conversion of semi-Lagrangian advection schemes to quasi-monotone schemes",
Monthly Weather Review, 1992; R. Bermejo and J. Conde, "A conservative quasi-monotone semi-Lagrangian scheme",
Monthly Weather Review, 2002.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.crossings import entering_vertices, turning_vertices
from ddgcli.models.fluid.phases import Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import BackwardPaths, Transport
from ddgcli.scenes.expressions import evaluate
from ddgcli.simulation.model import Observation

N_SOURCE_TIMES = 17  # at which the size of a source is estimated


class SurfaceTracer:
    """Advection of values at the vertices of a surface."""

    def __init__(self, space: SurfaceSpace, transport: Transport) -> None:
        self.space, self.transport = space, transport
        self.vertices = np.flatnonzero(space.mesh.topology.referenced_vertex)
        self.entering = entering_vertices(space)

    @property
    def turning(self) -> NDArray[np.int64]:
        """Vertices at which fluid enters at one time and leaves at another."""
        return turning_vertices(self.space)

    def entering_in(self, before: FluidState, after: FluidState) -> NDArray[np.int64]:
        """Vertices at which fluid enters between two states."""
        space = self.space
        if space.lift_in_time is None:
            return self.entering
        return entering_vertices(space, 0.5 * (space.flow(before).side_flux + space.flow(after).side_flux))

    def advance(self, values: NDArray, side_flux: NDArray, dt: float) -> NDArray[np.float64]:
        """(n,) values after a time dt in the flow with side fluxes (m, 3)."""
        transport, vertices, space = self.transport, self.vertices, self.space
        moved = transport.vertices_backwards(transport.corners(side_flux), vertices, dt)
        corners = values[self.space.faces[moved.face]]
        bounds = Bounds(corners.min(axis=1), corners.max(axis=1))
        after = np.array(values)
        after[vertices] = np.clip(self._interpolated(values, moved), *bounds)
        label = self.space.mesh.topology.vertex_component
        leaving = self._leaving(0.5 * (values + after), side_flux, dt, label)
        after[vertices] = conserved(
            values[vertices], after[vertices], bounds, self.space.mass[vertices], label[vertices], leaving
        )
        entering = self.entering
        if space.lift_in_time is not None:
            entering = entering_vertices(space, side_flux)
        after[entering] = values[entering]
        return after

    def _leaving(self, values: NDArray, side_flux: NDArray, dt: float, label: NDArray) -> NDArray | None:
        """Amount of each component that crosses the boundary in a time dt; None between walls."""
        space = self.space
        if space.boundary_values is None:
            return None
        face, k, ends = space.boundary_sides
        crossing = dt * side_flux[face, k] * values[ends].mean(axis=1)
        return sum_by_index(label[ends[:, 0]], crossing, space.mesh.topology.n_components)

    def _interpolated(self, values: NDArray, moved: BackwardPaths) -> NDArray[np.float64]:
        """Cubic along every side, with the recovered slopes at its ends; exact for quadratic functions."""
        space = self.space
        difference = space.side_flux(values, np.zeros(0))
        slope = 1j * self.transport.corners(difference)  # a stream function's velocity, turned back
        face, weight = moved.face, moved.barycentric
        side, rise, at = space.side[face], difference[face], slope[face]
        bend_tail = (at * np.conj(side)).real - rise
        bend_head = rise - (at[:, NEXT] * np.conj(side)).real
        tail, head = weight, weight[:, NEXT]
        cubic = tail * head * (tail * bend_tail + head * bend_head)
        middle = 0.5 * weight.prod(axis=1) * (bend_tail + bend_head).sum(axis=1)
        linear = row_dot(values[space.faces[face]], weight)
        return linear + cubic.sum(axis=1) + middle

    def carried(
        self, before: FluidState, after: FluidState, values: NDArray, dt: float
    ) -> NDArray[np.float64]:
        """(n,) values after dt, in the mean of the side fluxes of two states."""
        space = self.space
        return self.advance(values, 0.5 * (space.flow(before).side_flux + space.flow(after).side_flux), dt)


class Bounds(NamedTuple):
    """Least and largest value that each vertex may take."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]


def conserved(
    before: NDArray,
    after: NDArray,
    bounds: Bounds,
    mass: NDArray,
    label: NDArray,
    leaving: NDArray | None = None,
) -> NDArray[np.float64]:
    """Restore the amount of a scalar on every component: within its own bounds, then within all.

    Where some of it leaves, its own bounds alone: its amount there is an estimate.

    Parameters
    ----------
    before, after, mass : (k,) ndarray
    bounds : Bounds
    label : (k,) ndarray of int64
        Component of each entry.
    leaving : (components,) ndarray of float64, optional
        Amount that leaves.

    Returns
    -------
    (k,) ndarray of float64
        `after` with the amounts of `before`, less what leaves.
    """
    count = int(label.max(initial=-1)) + 1
    lowest, highest = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(lowest, label, before)
    np.maximum.at(highest, label, before)
    lowest, highest = lowest[label], highest[label]
    after = np.array(after)
    for lower, upper in (bounds, (lowest, highest))[: 2 if leaving is None else 1]:
        missing = sum_by_index(label, mass * (before - after), count)
        if leaving is not None:
            missing -= leaving[:count]
        margin = np.where(missing[label] > 0, upper - after, after - lower)
        whole = sum_by_index(label, mass * margin, count)
        share = np.divide(missing, whole, out=np.zeros(count), where=whole > 0)
        after += np.clip(share, -1.0, 1.0)[label] * margin
    return np.clip(after, lowest, highest)


class Source:
    """What is added to a scalar at the vertices a second, by an expression in x, y, z and t."""

    def __init__(self, context: FluidContext, expression: str) -> None:
        self.points, self.used, self.expression = context.points, context.used, expression
        self.rate(0.0)  # refuses what cannot be evaluated

    def rate(self, time: float) -> NDArray[np.float64]:
        variables = {**dict(zip("xyz", self.points.T)), "t": np.full(len(self.points), time)}
        return np.where(self.used, evaluate(self.expression, variables), 0.0)


class TracerPhase:
    """The phase of a passive scalar, with the flow's side fluxes averaged over the step.

    Parameters
    ----------
    effect : str
        Also the name of its array in states and frames.
    amount : (n,) ndarray
        At the start.
    tracer : SurfaceTracer or VolumeTracer
    source : Source, optional
    """

    step_stage: Literal["transport", "source", "tracer"] = "tracer"
    order = 2

    def __init__(self, effect: str, amount: NDArray, tracer: Any, source: Source | None = None) -> None:
        self.effect, self.amount, self.tracer, self.source = effect, amount, tracer, source

    @property
    def array(self) -> str:
        """Name of the scalar in states and frames."""
        return self.effect

    def start(self) -> dict[str, NDArray]:
        return {self.array: self.amount}

    def distance(self, a: FluidState, b: FluidState, start: FluidState, duration: float) -> float:
        """Difference of the amounts, relative to the largest of `start`, `b` and what sources add in a run.

        Values point by point would shorten steps without end: what interpolation adds in two short steps and
        in a long one does not vanish with the step.
        """
        mass, name = self.tracer.space.mass, self.array
        size = max(float(mass @ np.abs(state[name])) for state in (start, b)) + self._supply(duration)
        return abs(float(mass @ (a[name] - b[name]))) / (size or 1.0)

    def _supply(self, duration: float) -> float:
        """Bound on the amount that the source adds in a run."""
        if self.source is None:
            return 0.0
        rates = (np.abs(self.source.rate(time)) for time in np.linspace(0.0, duration, N_SOURCE_TIMES))
        return duration * max(float(self.tracer.space.mass @ rate) for rate in rates)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        return state.with_passive(**{self.effect: self.carried(step, state, state[self.effect])})

    def carried(self, step: Step, state: FluidState, values: NDArray) -> NDArray[np.float64]:
        """Values after the span, with half of what the source adds before and half after."""
        if self.source is None:
            return self.tracer.carried(step.before, state, values, step.dt)
        half = 0.5 * step.dt * self.source.rate(step.time + 0.5 * step.dt)
        half[self.tracer.entering_in(step.before, state)] = 0.0
        return self.tracer.carried(step.before, state, values + half, step.dt) + half

    def observed(self, state: FluidState) -> Observation:
        values, mass = state[self.effect], self.tracer.space.mass
        whole = {
            f"total_{self.effect}": float(values @ mass),
            f"absolute_{self.effect}": float(np.abs(values) @ mass),
        }
        return Observation(None, {self.effect: values}, whole)
