"""Semi-implicit steps of curve flows, with redistribution of points along the curve.

A step is `x' = x + d + lambda b + s`: `d` solves `(M + dt P Q P) d = dt P F`, `b` the same system with the
gradient of a constraint, and `s` slides points along the curve. `M` holds dual lengths, `F` the negative
gradient, `Q` its linearisation with the weights of the start of the step, `P` the normal projection
(the identity without redistribution). Without `s` the length never rises in curvature flow (Dziuk 1994):
`d.F = d.M d / dt + d.Q d` and `|e'| - |e| <= |e'| (|e'| - |e|) / |e|`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array, diags_array

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.vectors import ratio, row_dot, tangential, vector_length
from ddgcli.models.curve import polygon
from ddgcli.models.curve.crossings import self_crossings
from ddgcli.models.curve.polygon import Polygons
from ddgcli.models.curve.spacing import even_points, uneven_curves
from ddgcli.simulation.model import Cause, Ending, Observation, StepRejected

COLLAPSED_LENGTH = 1e-2  # of the first length: a shorter curve has shrunk to a point
REST_SPEED = 1e-6  # normal speed times radius (elastic: radius^3) at which a curve is at rest
STEP_LIMIT = 0.1  # squared radii of the circle of the shortest curve's length: beyond it points move freely
SLIDING_RATE = 10.0  # diffusivity of the spacing, over that of the flow
MAX_SLIDE = 0.3  # of the shorter segment at a point, in one step
SLIDE_FRACTIONS = (1.0, 0.5, 0.25, 0.0)  # of the slide, until the objective does not rise
ROUNDING_RISE = 1e-12  # relative rise of the objective that rounding explains
MAX_ENERGY_RISE = 1e-3  # relative rise of the elastic energy at which a step is rejected
MAX_HALVINGS = 40  # of a step of elastic flow: the time of a tip is the fourth power of its radius
MAX_CONSTRAINT_ITERATIONS = 12
CONSTRAINT_TOLERANCE = 1e-14  # relative; iterations end there or after the number above
FOLD_TURNING = np.radians(170)  # at a point where a polygon runs back on itself
COLLAPSE, REST = Ending("collapsed", "every curve has shrunk to a point"), Ending("at rest", "at rest")


@dataclass(frozen=True, eq=False)
class CurveState:
    """State of a flow, in units of the scaled curve.

    Parameters
    ----------
    points : (n, 3) ndarray
    active : (c,) ndarray of bool
        Curves that have not shrunk to a point.
    collapse_time : (c,) ndarray
        Time at which a curve shrank to a point; nan before.
    speed : float
        Largest normal speed of the last step, dimensionless.
    increases : (2,) ndarray
        Steps that raised the length, and steps that raised the objective of the flow.
    area_loss : (2, c) ndarray
        Area that curves have lost, and the exact loss of curvature flow, 2 pi times the turning number a unit
        of time: of the steps that keep it.
    """

    points: NDArray[np.float64]
    active: NDArray[np.bool_]
    collapse_time: NDArray[np.float64]
    speed: float
    increases: NDArray[np.float64]
    area_loss: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CurveFlow:
    """Flow of polylines; its methods are those of a `Model`.

    Parameters
    ----------
    mesh : Polygons
    kind : {'curvature', 'area-preserving', 'elastic'}
    redistribute : bool
    length_penalty : float, optional
        Elastic flow: weight of the length in the energy; None keeps the length instead.
    stop_at_rest : bool
    first_length, first_area : (c,) ndarray
    first_radius : (c,) ndarray
        Of the circle of the same length; where simple closed plane curves vanish or keep their area, of the
        same area: they vanish when it does, however long they are.
    simple : (c,) ndarray of bool
        Closed plane curves that do not cross themselves at the start.
    centre : (3,) ndarray
    scale : float
        Input points are `centre + scale * points`; a power of two.
    """

    mesh: Polygons
    kind: str
    redistribute: bool
    length_penalty: float | None
    stop_at_rest: bool
    first_length: NDArray[np.float64]
    first_area: NDArray[np.float64]
    first_radius: NDArray[np.float64]
    simple: NDArray[np.bool_]
    centre: NDArray[np.float64]
    scale: float

    @property
    def time_power(self) -> int:
        """Power of the length that a time is."""
        return 4 if self.kind == "elastic" else 2

    @property
    def time_unit(self) -> float:
        """Time of the input's units for one unit of the scaled curve."""
        return self.scale**self.time_power

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


class NormalStep:
    """Linear system of one step, its motion, and the correction that meets the constraint.

    Parameters
    ----------
    flow : CurveFlow
    state : CurveState
    dt : float
        In scaled units.
    """

    def __init__(self, flow: CurveFlow, state: CurveState, dt: float) -> None:
        mesh = flow.mesh
        self.flow, self.state, self.dt = flow, state, dt
        self.shape = polygon.geometry(mesh, state.points)
        tangents = polygon.circle_tangents if flow.kind == "elastic" else polygon.vertex_tangents
        self.tangent = tangents(mesh, state.points)
        self.free = np.zeros(mesh.n, dtype=bool)
        self.free[mesh.joint] = True
        self.free &= state.active[mesh.curve]
        self._normal = flow.redistribute and not self._is_huge()
        self._points = np.flatnonzero(self.free)
        self._factor = Factor(self._matrix()) if len(self._points) else None
        self.motion = self._solve(-self._gradient())

    def _is_huge(self) -> bool:
        """True for a step of which the normal parts alone would not be the flow: points then move freely.

        Straightening a curve in one step needs motion along it, which the linearisation at the start of the
        step takes for a change of spacing.
        """
        if self.flow.kind == "elastic":
            return False
        length = self.flow.mesh.by_curve(self.flow.mesh.tail, self.shape.length)
        radius = length[self.state.active].min(initial=np.inf) / (2 * np.pi)
        return bool(self.dt > STEP_LIMIT * radius**2)

    def _matrix(self) -> csr_array:
        """`M + dt P Q P` on the free points: (k, k) by coordinate without P, (3k, 3k) with it."""
        rows = self._points
        stiffness = (self.dt * self._stiffness())[rows][:, rows].tocsr()
        mass = self.shape.dual_length[rows]
        if not self._normal:
            return stiffness + diags_array(mass)
        tangent, k = self.tangent[rows], len(rows)
        along = np.eye(3) - tangent[:, :, None] * tangent[:, None, :]
        row = np.repeat(np.arange(k), np.diff(stiffness.indptr))
        blocks = stiffness.data[:, None, None] * (along[row] @ along[stiffness.indices])
        blocks[row == stiffness.indices] += mass[:, None, None] * np.eye(3)
        return bsr_array((blocks, stiffness.indices, stiffness.indptr), shape=(3 * k, 3 * k)).tocsr()

    def projected(self, vectors: NDArray) -> NDArray[np.float64]:
        """(n, 3) vectors without their tangential parts, where points are redistributed."""
        if not self._normal:
            return vectors
        return tangential(vectors, self.tangent)

    def _stiffness(self) -> csr_array:
        mesh, shape = self.flow.mesh, self.shape
        matrix = polygon.stiffness(mesh, shape.length)
        if self.flow.kind != "elastic":
            return matrix
        joint_matrix = matrix[mesh.joint]
        weight = diags_array(2.0 / np.maximum(shape.dual_length[mesh.joint], np.finfo(float).tiny))
        return joint_matrix.T @ weight @ joint_matrix + (self.flow.length_penalty or 0.0) * matrix

    def _gradient(self) -> NDArray[np.float64]:
        mesh = self.flow.mesh
        if self.flow.kind != "elastic":
            return polygon.length_gradient(mesh, self.shape)
        gradient = polygon.elastic_gradient(mesh, self.shape)
        return gradient + (self.flow.length_penalty or 0.0) * polygon.length_gradient(mesh, self.shape)

    def _solve(self, force: NDArray) -> NDArray[np.float64]:
        """Motion by a force in one step."""
        motion = np.zeros(force.shape)
        if self._factor is not None:
            load = self.dt * self.projected(force)[self._points]
            solution = self._factor.solve(load.ravel() if self._normal else load)
            motion[self._points] = solution.reshape(-1, 3)
        return motion

    def constrained(self, points: NDArray) -> NDArray[np.float64]:
        """Points moved along the solution for the constraint's gradient until the constraint holds."""
        if self.flow.kind == "area-preserving":
            return self._with_area(points)
        if self.flow.kind == "elastic" and self.flow.length_penalty is None:
            return self._with_length(points)
        return points

    def _with_area(self, points: NDArray) -> NDArray[np.float64]:
        """Points of the first area; the gradient of the area at the mean of both points lets none rise.

        The area is quadratic: with that gradient g, A(x') - A(x) = g.(x' - x) = 0.
        """
        mesh, later = self.flow.mesh, points
        for _ in range(MAX_CONSTRAINT_ITERATIONS):
            middle = 0.5 * (self.state.points + later)
            direction = self._solve(polygon.area_gradient(mesh, middle))
            constant = polygon.enclosed_area(mesh, points) - self.flow.first_area
            linear = mesh.by_curve(np.arange(mesh.n), row_dot(polygon.area_gradient(mesh, points), direction))
            square = polygon.area_form(mesh, direction)
            discriminant = linear**2 - 4.0 * square * constant
            if (state_bad := self.state.active & ((discriminant < 0) | (linear == 0))).any():
                raise StepRejected("area", f"curve {int(np.argmax(state_bad))}")
            root = linear + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), linear)
            factor = np.where(self.state.active, ratio(-2.0 * constant, root), 0.0)
            previous, later = later, points + factor[mesh.curve][:, None] * direction
            if np.abs(later - previous).max() <= CONSTRAINT_TOLERANCE:
                break
        return later

    def _with_length(self, points: NDArray) -> NDArray[np.float64]:
        """Points of the first length, by Newton's method for one factor per curve."""
        mesh, active = self.flow.mesh, self.state.active
        direction = self._solve(polygon.length_gradient(mesh, self.shape))
        for _ in range(MAX_CONSTRAINT_ITERATIONS):
            shape = polygon.geometry(mesh, points)
            excess = mesh.by_curve(mesh.tail, shape.length) - self.flow.first_length
            slope = mesh.by_curve(np.arange(mesh.n), row_dot(polygon.length_gradient(mesh, shape), direction))
            open_excess = active & (np.abs(excess) > CONSTRAINT_TOLERANCE * self.flow.first_length)
            if not open_excess.any():
                break
            factor = np.where(open_excess, ratio(-excess, slope), 0.0)
            points = points + factor[mesh.curve][:, None] * direction
        worst = np.max(np.where(active, np.abs(excess) / self.flow.first_length, 0.0))
        if not worst < 1e-9:
            raise StepRejected("length", value=float(worst), halvings=MAX_HALVINGS)
        return points


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
