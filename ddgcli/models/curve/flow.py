"""Curve flows: steps with redistribution of points along the curve, and frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.vectors import ratio, tangential, vector_length
from ddgcli.models.curve import polygon
from ddgcli.models.curve.crossings import self_crossings
from ddgcli.models.curve.flow_terms import CurveFlowTerms, CurveState
from ddgcli.models.curve.normal_step import MAX_HALVINGS, NormalStep
from ddgcli.models.curve.spacing import even_points, uneven_curves
from ddgcli.simulation.model import Cause, Ending, Observation, StepRejected

COLLAPSED_LENGTH = 1e-2  # of the first length: a shorter curve has shrunk to a point
REST_SPEED = 1e-6  # normal speed times radius (elastic: radius^3) at which a curve is at rest
SLIDING_RATE = 10.0  # diffusivity of the spacing, over that of the flow
MAX_SLIDE = 0.3  # of the shorter segment at a point, in one step
SLIDE_FRACTIONS = (1.0, 0.5, 0.25, 0.0)  # of the slide, until the objective does not rise
ROUNDING_RISE = 1e-12  # relative rise of the objective that rounding explains
MAX_ENERGY_RISE = 1e-3  # relative rise of the elastic energy at which a step is rejected
FOLD_TURNING = np.radians(170)  # at a point where a polygon runs back on itself
COLLAPSE, REST = Ending("collapsed", "every curve has shrunk to a point"), Ending("at rest", "at rest")


class CurveFlow(CurveFlowTerms):
    """Flow of polylines; its methods are those of a `Model`.

    Parameters are those of `CurveFlowTerms`.
    """

    def objective(self, points: NDArray) -> NDArray[np.float64]:
        """(c,) quantity that the flow decreases: the length, or the elastic energy with its penalty."""
        shape = polygon.geometry(self.mesh, points)
        length = self.mesh.by_curve(self.mesh.tail, shape.length)
        if self.kind != "elastic":
            return length
        return polygon.elastic_energy(self.mesh, shape) + (self.length_penalty or 0.0) * length

    def advance(self, state: CurveState, time: float, dt: float) -> CurveState:
        """One step; curves that have shrunk to a point stay where they are."""
        try:
            return self._stepped(state, time, dt)
        except SolveError as error:
            remedy = "use a shorter `step`"
            if self.length_penalty:
                remedy += " or a smaller `length_penalty`"
            raise SolveError(f"the matrix of a step is singular to working precision; {remedy}") from error

    def _stepped(self, state: CurveState, time: float, dt: float) -> CurveState:
        dt, time = dt / self.time_unit, time / self.time_unit
        before = self.objective(state.points)
        step = NormalStep(self, state, dt)
        slide = self._slide(state, dt, step)
        for fraction in SLIDE_FRACTIONS if slide.any() else (0.0,):
            points = step.constrained(state.points + step.motion + fraction * slide)
            after = self.objective(points)
            risen = (after > before * (1 + ROUNDING_RISE)) & state.active
            if not risen.any():
                break
        worst = float(np.max(np.where(state.active, ratio(after - before, before), 0.0), initial=0.0))
        if not np.isfinite(points).all() or not np.isfinite(worst):
            raise StepRejected(Cause.NOT_FINITE)
        if self.kind == "elastic" and worst > MAX_ENERGY_RISE:
            raise StepRejected("energy", value=worst, halvings=MAX_HALVINGS)
        points = self._respaced(points, state.active, before, step)
        if self.kind == "elastic":
            self._require_turning_number(step.shape, points)
        return self._after(state, points, time, dt, bool(risen.any()))

    def _require_turning_number(self, start: polygon.Geometry, points: NDArray) -> None:
        """Reject a step that leaps past a cusp, which has infinite elastic energy, to fewer or more turns."""
        later = polygon.geometry(self.mesh, points)
        changed = polygon.turning_numbers(self.mesh, later) != polygon.turning_numbers(self.mesh, start)
        if changed.any():
            raise StepRejected("turning number", f"curve {int(np.argmax(changed))}", halvings=MAX_HALVINGS)

    def _respaced(
        self, points: NDArray, active: NDArray, before: NDArray, step: NormalStep
    ) -> NDArray[np.float64]:
        """Points at even distances on curves of uneven segments, where the objective stays below `before`."""
        if not self.redistribute:
            return points
        uneven, shrunk = uneven_curves(self.mesh, points)
        for k in np.flatnonzero(active & uneven).tolist():
            even = even_points(self.mesh, points, k, smooth=not shrunk[k])
            if even is None:
                continue
            moved = step.constrained(even)
            if shrunk[k] or self.objective(moved)[k] <= before[k]:
                points = moved
        return points

    def _after(self, state: CurveState, points: NDArray, time: float, dt: float, risen: bool) -> CurveState:
        old, new = (polygon.geometry(self.mesh, x) for x in (state.points, points))
        lengths = [self.mesh.by_curve(self.mesh.tail, g.length) for g in (old, new)]
        longer = bool(((lengths[1] > lengths[0] * (1 + ROUNDING_RISE)) & state.active).any())
        collapsed = state.active & (lengths[1] < COLLAPSED_LENGTH * self.first_length)
        tangent = polygon.vertex_tangents(self.mesh, state.points)
        moved = points - state.points
        normal = tangential(moved, tangent)
        radius = np.maximum(lengths[0], 1e-300) / (2 * np.pi)
        speed = vector_length(normal) / dt * radius[self.mesh.curve] ** (self.time_power - 1)
        return CurveState(
            points,
            state.active & ~collapsed,
            np.where(collapsed, time + dt, state.collapse_time),
            float(speed[state.active[self.mesh.curve]].max(initial=0.0)),
            state.increases + [longer, risen],
            state.area_loss + state.active * self._area_loss((state.points, points), (old, new), dt),
        )

    def _area_loss(
        self, points: tuple[NDArray, NDArray], shapes: tuple[polygon.Geometry, polygon.Geometry], dt: float
    ) -> NDArray[np.float64]:
        """(2, c) area that curves lose in a step, and the exact loss; zero where the turning number changes.

        That of a simple curve never does: where it seems to, the step was too long. Of others it is rounding
        where they fold back.
        """
        before, after = (polygon.turning_numbers(self.mesh, shape) for shape in shapes)
        known = self.simple | ((before == after) & (self._largest_turning(shapes[1]) < FOLD_TURNING))
        turns = np.where(self.simple, np.sign(self.first_area), after)
        areas = [polygon.enclosed_area(self.mesh, x) for x in points]
        return np.stack([areas[0] - areas[1], 2 * np.pi * turns * dt]) * known

    def _largest_turning(self, shape: polygon.Geometry) -> NDArray[np.float64]:
        """(c,) largest angle by which each curve turns at a point."""
        largest = np.zeros(self.mesh.n_curves)
        np.maximum.at(largest, self.mesh.curve[self.mesh.joint], shape.turning)
        return largest

    def _slide(self, state: CurveState, dt: float, step: NormalStep) -> NDArray[np.float64]:
        """(n, 3) motion along the curve that makes segments equally long: implicit diffusion of arc length.

        Points follow the parabola through tangent and curvature, which leaves the curve by the third order.
        """
        mesh, shape = self.mesh, step.shape
        if not self.redistribute:
            return np.zeros_like(state.points)
        count = np.bincount(mesh.curve[mesh.tail], minlength=mesh.n_curves)
        length = mesh.by_curve(mesh.tail, shape.length)
        mean = (length / count)[mesh.curve]
        rate: NDArray | float = SLIDING_RATE
        if self.kind == "elastic":
            rate = SLIDING_RATE / (length / (2 * np.pi))[mesh.curve[mesh.tail]] ** 2
        springs = polygon.stiffness(mesh, mean[mesh.tail] / rate)
        tension = np.zeros(mesh.n)
        gap = shape.length[mesh.after] - shape.length[mesh.before]
        each = np.broadcast_to(np.asarray(rate), mesh.tail.shape)[mesh.after]
        tension[mesh.joint] = each * gap / mean[mesh.joint]
        free = np.flatnonzero(step.free & (vector_length(step.tangent) > 0))
        shift = np.zeros(mesh.n)
        if len(free):
            matrix = diags_array(mean) + dt * springs
            shift[free] = Factor(matrix[free][:, free]).solve(dt * tension[free])
        shortest = np.zeros(mesh.n)
        shortest[mesh.joint] = np.minimum(shape.length[mesh.before], shape.length[mesh.after])
        shift = np.clip(shift, -MAX_SLIDE * shortest, MAX_SLIDE * shortest)
        bend = ratio(-polygon.length_gradient(mesh, shape), np.repeat(shape.dual_length[:, None], 3, axis=1))
        return shift[:, None] * step.tangent + 0.5 * shift[:, None] ** 2 * step.projected(bend)

    def observe(self, state: CurveState) -> Observation:
        mesh, shape = self.mesh, polygon.geometry(self.mesh, state.points)
        turning = np.zeros(mesh.n)
        turning[mesh.joint] = shape.turning
        mean = mesh.by_curve(mesh.tail, shape.length) / np.bincount(mesh.curve[mesh.tail])
        spacing = ratio(shape.length, mean[mesh.curve[mesh.tail]])
        by_curve = {
            "length": mesh.by_curve(mesh.tail, shape.length) * self.scale,
            "area": polygon.enclosed_area(mesh, state.points) * self.scale**2,
            "elastic_energy": polygon.elastic_energy(mesh, shape) / self.scale,
            "turning_number": polygon.turning_numbers(mesh, shape),
            "self_crossings": self_crossings(mesh, state.points),
        }
        scalar: dict[str, Any] = {name: float(values.sum()) for name, values in by_curve.items()}
        if not self.mesh.has_total_area:
            del scalar["area"], scalar["turning_number"]
        scalar |= {f"{name}_by_curve": values for name, values in by_curve.items()}
        scalar |= {
            "collapsed": float((~state.active).sum()),
            "collapse_time_by_curve": np.nan_to_num(state.collapse_time, nan=-1.0) * self.time_unit,
            "length_increases": float(state.increases[0]),
            "energy_increases": float(state.increases[1]),
            "area_loss_by_curve": state.area_loss[0] * self.scale**2,
            "exact_area_loss_by_curve": state.area_loss[1] * self.scale**2,
            "longest_segment": float(spacing.max()),
            "shortest_segment": float(spacing.min()),
            "largest_turning": float((self._largest_turning(shape) * state.active).max()),
        }
        curvature = ratio(turning, shape.dual_length * self.scale)
        return Observation(
            self.centre + self.scale * state.points, {"curvature": curvature, "path_id": mesh.curve}, scalar
        )

    def pack(self, state: CurveState) -> dict[str, NDArray]:
        return {
            "points": state.points,
            "active": state.active.astype(np.float64),
            "collapse_time": state.collapse_time,
            "counts": np.concatenate([[state.speed], state.increases]),
            "area_loss": state.area_loss,
        }

    def unpack(self, arrays: dict[str, NDArray]) -> CurveState:
        counts = np.asarray(arrays["counts"])
        return CurveState(
            np.asarray(arrays["points"]), np.asarray(arrays["active"]) > 0,
            np.asarray(arrays["collapse_time"]), float(counts[0]), counts[1:],
            np.asarray(arrays["area_loss"]),
        )  # fmt: skip

    def ending(self, state: CurveState) -> Ending | None:
        """Why the flow ends here, if it does."""
        if not state.active.any():
            return COLLAPSE
        return REST if self.stop_at_rest and state.speed < REST_SPEED else None

    def distance(self, a: CurveState, b: CurveState) -> float:
        """Largest distance between points of two states, over the size of the curves at the start."""
        return float(vector_length(a.points - b.points).max())


def start_state(flow: CurveFlow, points: NDArray) -> CurveState:
    """State of a flow at time zero.

    Parameters
    ----------
    flow : CurveFlow
    points : (n, 3) ndarray of float64

    Returns
    -------
    CurveState
    """
    c, points = flow.mesh.n_curves, np.array(points, dtype=np.float64)
    active, never = np.ones(c, dtype=bool), np.full(c, np.nan)
    return CurveState(points, active, never, np.inf, np.zeros(2), np.zeros((2, c)))
