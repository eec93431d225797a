"""The steps of a flow, and why it ends."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import endings, trust_region
from ddgcli.models.willmore import step_rules as rules
from ddgcli.models.willmore.component_ends import component_step, not_finite, with_components_of
from ddgcli.models.willmore.conformal import (
    ConformalStep,
    descending_step,
    distance_from_rest,
)
from ddgcli.models.willmore.constraints import area
from ddgcli.models.willmore.descent import (
    ROSENBROCK_GAMMAS,
    EnergyGradient,
    Preconditioner,
    descent_motion,
    energy_gradient,
    moved_along,
    rosenbrock_step,
    secant_motion,
    size_across,
)
from ddgcli.models.willmore.endings import EndingKind
from ddgcli.models.willmore.film_polish import has_uneven_curvature, polished_film, uneven_rest
from ddgcli.models.willmore.films import film_ending
from ddgcli.models.willmore.flow_terms import FlowTerms
from ddgcli.models.willmore.remesh_step import improved_state, remeshed_state
from ddgcli.models.willmore.self_intersections import checked
from ddgcli.models.willmore.state import FlowState, after_curvature_step, rounding_scale
from ddgcli.models.willmore.triangle_quality import better_triangles
from ddgcli.simulation.model import Ending, StepRejected


class Flow(FlowTerms):
    """A flow as a model for the one time loop.

    Parameters are those of `FlowTerms`.
    """

    def advance(self, state: FlowState, time: float, dt: float) -> FlowState:
        """One step; StepRejected where a timed step would raise the energy."""
        return state if state.ending else checked(state, self._stepped(state, dt))

    def _stepped(self, state: FlowState, dt: float) -> FlowState:
        if self.remesh is not None:
            changed = remeshed_state(
                state, self.remesh, movable=self.movable(state), energy=self.energy_of, restored=self.restored
            )
            if changed is not None:
                return self._after_remeshing(state, changed)
        if state.steps == 0 and (ending := self.ending(state)):
            return replace(state, ending=ending)
        if self.mean_curvature:
            return self._curvature_step(state, dt)
        at = self._gradient(state)
        if self.timed:
            return self._timed_step(state, at, dt)
        if self.of_area and uneven_rest(at, self.constraints, self.stop.gradient):
            return self._polished(state, at) or replace(state, ending=endings.UNEVEN_FILM)
        if self.kind != "descent":
            return self._other_step(state, at)
        first = state.steps == 0 and self.keeps_triangles
        improved = None
        if first:
            improved = improved_state(
                state, movable=self.movable(state), energy=self.energy_of, restored=self.restored
            )
        if improved is not None:
            stepped = self._longest_step(improved, self._gradient(improved))
            if stepped.steps and stepped.energy <= state.energy:
                return stepped
        return self._with_polish(self._longest_step(state, at))

    def _after_remeshing(self, state: FlowState, changed: FlowState) -> FlowState:
        """A step from a remeshed state; the remeshed state alone where none lowers the energy."""
        ending = self.ending(changed)
        stepped = changed if ending else self._longest_step(changed, self._gradient(changed))
        if stepped.steps == state.steps:
            return replace(changed, steps=state.steps + 1, ending=ending or stepped.ending)
        return stepped

    def ending(self, state: FlowState) -> Ending | None:
        """Why the flow ends at a state, if it does; no rest is far above the sphere or torus within reach."""
        ending = self._rest_ending(state)
        if ending is None or ending.kind not in (EndingKind.AT_REST, EndingKind.MESH_ERROR):
            return ending
        if state.energy > self.bounds.round_energy:
            return endings.FALSE_REST
        if self._has_crumpled(state):
            return endings.CRUMPLING
        above = rules.FALSE_REST_FRACTION * self.bounds.least < state.energy < rules.KNOT_ENERGY
        if self.bounds.to_torus and above and ending.kind == EndingKind.MESH_ERROR:
            return endings.FALSE_TORUS_REST
        return ending

    def _has_crumpled(self, state: FlowState) -> bool:
        """Whether the second energy has risen since it was lowest, and the two no longer agree."""
        second, fall = self._second(state), state.energy_then - state.energy
        rises = rules.second_rises(second, state.lowest_second, fall)
        return rises and not rules.agree(second, state.energy)

    def _rest_ending(self, state: FlowState) -> Ending | None:
        if state.ending or self.mean_curvature:
            return state.ending
        at = self._gradient(state)
        if self.stop.mesh_error and abs(at.energy) <= rules.ZERO_ENERGY:
            return endings.VANISHED_ENERGY
        if self.of_area:
            uneven = uneven_rest(at, self.constraints, self.stop.gradient)
            return None if uneven else film_ending(at, self.stop.gradient, self.constraints)
        size = size_across(at) if self.kind == "newton" else at.size
        if self.stop.gradient is not None and size <= self.stop.gradient:
            return endings.small_gradient(self.stop.gradient)
        newton = self.kind == "newton" and self.second is not None
        dt = self.longest if newton else state.dt
        near_rest = dt >= rules.NEAR_REST_STEP_FRACTION * self.longest
        # remeshing, where it succeeds, keeps the triangles good, so that going on is worth while
        may_rest = not (self.remesh and state.remeshing.count and at.energy > self.bounds.round_energy)
        if (
            self.stop.mesh_error
            and may_rest
            and self.of_surface
            and near_rest
            and (newton or self.kind == "descent")
        ) and self._mesh_error_prevails(at, dt):
            return endings.MESH_ERROR
        return None

    def _mesh_error_prevails(self, at: EnergyGradient, dt: float) -> bool:
        """Whether, near rest, the gradient's part along the surface releases more energy than that across."""
        metric = self._preconditioner(at, dt)
        least = rules.NEAR_REST_ENERGY_FRACTION * abs(at.energy) / dt
        if metric.descent_power() > 2.0 * least:  # what the two parts release is half of it or more
            return False
        across, along = metric.powers()
        return across + along <= least and along >= across

    def _leaves_rest(self, at: EnergyGradient, after: FlowState) -> bool:
        """Whether a Newton step of a membrane leads away from where only the mesh's error is left.

        A saddle of the mesh, or a minimum that it has none of: from there the surface crumples.
        """
        if self.kind != "newton" or not (self.constraints.active and self.of_surface):
            return False
        rises = size_across(self._gradient(after)) > size_across(at)
        return rises and self._mesh_error_prevails(at, self.longest)

    def _polished(self, state: FlowState, at: EnergyGradient) -> FlowState | None:
        """The film of equal curvature at all vertices; None where the mesh has none nearby."""
        energy, tolerance = self._terms(state.topology).energy, self.stop.gradient or 0.0
        moved = polished_film(at.mesh, energy, at.free, self.constraints, tolerance)
        if moved is None:
            return None
        stepped = self._accepted(state, at, moved, energy.value(moved.points), 0.0)
        return replace(stepped, ending=endings.equal_curvature(tolerance, at_all_vertices=True))

    def _with_polish(self, state: FlowState) -> FlowState:
        """The state, polished where rounding of a closed film's area ended its flow before it was at rest."""
        if not (self.of_area and state.ending and state.ending.kind == EndingKind.AT_REST):
            return state
        at = self._gradient(state)
        if not has_uneven_curvature(at, self.constraints, self.stop.gradient):
            return state
        return self._polished(replace(state, ending=None), at) or state

    def _timed_step(self, state: FlowState, at: EnergyGradient, dt: float) -> FlowState:
        for gamma, moved in self._attempts(at, dt / self.time_unit):
            energy = self.energy_of(moved)
            if self._below_lower_bound(energy):
                return replace(state, ending=endings.LOWER_BOUND)
            if energy <= at.energy:
                large = gamma == max(ROSENBROCK_GAMMAS)
                state = replace(state, large_constant_steps=state.large_constant_steps + large)
                return self._accepted(state, at, moved, energy, dt)
        predicted = float(np.sum(at.gradient * (at.mesh.points - moved.points)[self.free]))
        if abs(predicted) <= rules.PREDICTED_FALL_TOLERANCE * rounding_scale(at.energy):
            return replace(state, time=state.time + dt, steps=state.steps + 1)
        raise StepRejected("energy rises", value=energy - at.energy)

    def _attempts(self, at: EnergyGradient, dt: float) -> Iterator[tuple[float | None, TriangleMesh]]:
        """The surface after dt by each constant in turn; StepRejected where none keeps the constraints."""
        failure = None
        for gamma in (None,) if self.scheme == "semi-implicit" else ROSENBROCK_GAMMAS:
            try:
                moved = self._after(at, dt, gamma)
            except SolveError as error:
                failure = error
                continue
            yield gamma, moved
        if failure is not None:
            raise StepRejected(str(failure)) from failure

    def _after(self, at: EnergyGradient, dt: float, gamma: float | None) -> TriangleMesh:
        if gamma is None:
            inner = self._preconditioner(at, dt)
            return moved_along(inner, descent_motion(inner, dt, self.constraints), 1.0, self.constraints)
        energy = self._terms(at.mesh.topology).energy
        return rosenbrock_step(self._preconditioner(at, gamma * dt), dt, energy, self.constraints)

    def _longest_step(self, state: FlowState, at: EnergyGradient) -> FlowState:
        """Descent step, shortened until the energy falls enough; the next one starts at twice a length that
        did, whole or by its first share. A share of the same motion costs no factorisation, so that is tried
        first, and before it the motion that the last steps improve."""
        dt, shrink, guided = state.dt, 0.25, True
        while dt >= rules.MIN_DESCENT_STEP:
            preconditioner = self._preconditioner(at, dt)
            motions = [descent_motion(preconditioner, dt, self.constraints)]
            if guided:
                motions[:0] = self._guided(state, preconditioner, motions[0], dt)
            for motion in motions:
                stepped = self._shared_step(state, at, preconditioner, motion, dt)
                if stepped is not None:
                    return stepped
            guided = False
            dt, shrink = dt * shrink, 0.25 * shrink
        return replace(state, ending=endings.NO_STEP)

    def _guided(self, state: FlowState, metric: Preconditioner, plain: NDArray, dt: float) -> list[NDArray]:
        """The motion by secant pairs, or that with momentum, where what it adds goes downhill."""
        at, motion = metric.at, None if state.motion is None else state.motion[metric.at.free]
        if self.by_pairs:
            motion = secant_motion(metric, dt, self.constraints, state.pairs)
        if motion is None or float(np.sum(at.gradient * motion)) >= 0.0:
            return []
        return [motion if self.by_pairs else plain + rules.MOMENTUM_SHARE * motion]

    def _other_step(self, state: FlowState, at: EnergyGradient) -> FlowState:
        step: ConformalStep | trust_region.TrustRegionStep | None
        if self.kind == "conformal":
            step = descending_step(at.mesh, state.dt, self.energy_of, at.energy)
        else:
            metric, energy = (
                self._preconditioner(at, self.longest),
                self._terms(state.topology).energy,
            )
            step = trust_region.descending_newton_step(
                energy, metric, self.constraints, state.dt, trust_region.LEAST_RADIUS * self.area
            )
        if step is None:
            return self._conformal_end(replace(state, ending=endings.NO_STEP))
        if step.mesh is at.mesh:
            return replace(state, ending=endings.ROUNDING)
        if self._below_lower_bound(step.energy):
            return replace(state, ending=endings.LOWER_BOUND)
        stepped = replace(self._accepted(state, at, step.mesh, step.energy, 0.0), dt=step.next_length)
        if (
            step.energy > self.bounds.round_energy
            and at.energy - step.energy < rules.LEAST_NEWTON_FALL * step.energy
        ):
            return replace(stepped, ending=endings.SLOW_NEWTON)
        if self._leaves_rest(at, stepped):
            return replace(state, ending=endings.MESH_ERROR)
        return self._conformal_end(stepped)

    def _conformal_end(self, state: FlowState) -> FlowState:
        """The state, with another reason where a conformal flow has ended before it is at rest."""
        if self.kind != "conformal" or not state.ending:
            return state
        remaining_energy = distance_from_rest(self.mesh(state))
        at_rest = remaining_energy <= rules.CONFORMAL_REST_SHARE * abs(state.energy)
        return state if at_rest else replace(state, ending=endings.NOT_CONFORMAL_REST)

    def _shared_step(
        self, state: FlowState, at: EnergyGradient, preconditioner: Preconditioner, motion: NDArray, dt: float
    ) -> FlowState | None:
        """The largest share of a motion that lowers the energy enough; None where none does."""
        predicted = -float(np.sum(at.gradient * motion))
        for share in rules.MOTION_FRACTIONS:
            try:
                moved = moved_along(preconditioner, motion, share, self.constraints)
            except SolveError:  # too far to return to the constraints
                continue
            energy = self.energy_of(moved)
            fall = rules.least_share(predicted, at.energy, self.of_area) * share * predicted
            if energy <= at.energy - fall:
                if self._below_lower_bound(energy):
                    return replace(state, ending=endings.LOWER_BOUND)
                at_once = dt == state.dt and share >= rules.MOTION_FRACTIONS[1]
                carried, pairs = state.motion, state.pairs
                if not self.by_pairs:
                    carried = np.zeros_like(state.points)
                    carried[at.free] = share * motion
                else:
                    terms = self._terms(moved.topology)
                    ahead = energy_gradient(moved, terms.energy, at.free, self.constraints)
                    travelled = (moved.points - at.mesh.points)[at.free]
                    pairs = pairs.with_pair(travelled, ahead.gradient - at.gradient)
                if self.keeps_triangles and not (self.of_area and rules.is_near_rest(at.energy, energy)):
                    highest = at.energy - rules.KEPT_FALL_SHARE * (at.energy - energy)
                    better = better_triangles(
                        moved, energy, highest, self.movable(state), self.energy_of,
                        lambda mesh: self.constraints.restore(mesh, at.free, preconditioner.solve),
                    )  # fmt: skip
                    moved, energy = better.mesh, better.energy
                    state = replace(
                        state, redistributions=state.redistributions + better.slides,
                        flips=state.flips + better.flips,
                    )  # fmt: skip
                stepped = self._accepted(state, at, moved, energy, share * dt * self.time_unit)
                length = min(self.longest, 2.0 * dt if at_once else dt)
                return replace(stepped, dt=length, motion=carried, pairs=pairs)
        return None

    def _accepted(
        self, state: FlowState, at: EnergyGradient, moved: TriangleMesh, energy: float, dt: float
    ) -> FlowState:
        ending = None
        if self.stop.fall is not None and at.energy - energy < self.stop.fall * abs(energy):
            ending = endings.small_fall(self.stop.fall, self.of_area)
        lowest, then = state.lowest_second, state.energy_then
        if (second_energy := self._terms(moved.topology).second) is not None:
            second = second_energy.value(moved.points)
            high = self.second is not None and self.second.shows_crumpling(second, energy)
            if high and rules.second_rises(second, lowest, then - energy):
                agree = rules.agree(self._second(state), state.energy)
                return replace(state, ending=endings.MESH_ERROR if agree else endings.CRUMPLING)
            lowest, then = (second, energy) if second < lowest else (lowest, then)
        rose = energy - at.energy > rules.ENERGY_ROUNDING * rounding_scale(at.energy)
        return replace(
            state, points=moved.points, topology=moved.topology, energy=energy, time=state.time + dt,
            steps=state.steps + 1, increases=state.increases + rose, ending=ending,
            lowest_second=lowest, energy_then=then,
        )  # fmt: skip

    def _curvature_step(self, state: FlowState, dt: float) -> FlowState:
        """Step of mean curvature flow; components that end in it stay where they are from then on."""
        before, ends, component = self.mesh(state), state.ends, self.topology.vertex_component
        free = self.free[ends.moves[component[self.free]]]
        moved, collapsed, singular = component_step(
            before, component, free, dt / self.time_unit, self.component_area
        )
        if not math.isfinite(self.energy_of(moved)):
            singular |= not_finite(moved, component, self.energy_kind) & ~collapsed
            moved = with_components_of(before, moved, singular, component)
        ends = ends.with_singular(singular, state.time)
        if not ends.moves[component[free]].any():
            return replace(state, ends=ends, ending=ends.ending)
        ends = ends.with_collapsed(collapsed, state.time + dt)
        ending = None if ends.moves[component[free]].any() else ends.ending
        left = TriangleMesh(moved.points, ends.remaining(state.topology, component))
        after = after_curvature_step(state, moved, self.energy_of(left), dt, area(before), self.stop)
        return replace(after, topology=left.topology, ends=ends, ending=ending or after.ending)
