"""Integral curves of tangent fields by geodesic Runge-Kutta methods.

K. Polthier, M. Schmies: the point y + h v of the plane becomes the end of the straightest geodesic from y
with direction v and length h |v|; field values there are transported back to y along that geodesic. Orders
1 (Euler), 2 (midpoint) and 4 (classical) hold where the field is smooth along the curve.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SurfacePaths
from ddgcli.algorithms.tangent_fields.tangent_field import TangentField
from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import BOUNDARY_STATUS, FAILURE_STATUS, Tracer, Traces
from ddgcli.errors import ParameterError, counted
from ddgcli.geometry.component_sides import component_mean_side
from ddgcli.geometry.face_frames import relative_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.ragged import list_starts, ranges
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback

_log = logging.getLogger("ddgcli")

MAX_STEPS = 10_000  # of a curve
TIME_STOP, BOUNDARY_STOP, CRITICAL_POINT_STOP, STALL_STOP = "time", "boundary", "critical point", "gave up"


@dataclass(frozen=True, eq=False)
class IntegralCurves:
    """Integral curves from k starts.

    Parameters
    ----------
    paths : SurfacePaths
    time : (k,) ndarray of float64
        Time integrated.
    steps : (k,) ndarray of int64
    stopped_because : list of str
        'time', 'boundary', 'critical point' or 'gave up'.
    error_estimate : (k,) ndarray of float64
        Estimated distance of the end from the end of the exact curve, in length units.
    """

    paths: SurfacePaths
    time: NDArray[np.float64]
    steps: NDArray[np.int64]
    stopped_because: list[str]
    error_estimate: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _CurvePositions:
    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]

    def take(self, rows: NDArray) -> _CurvePositions:
        return _CurvePositions(self.face[rows], self.barycentric[rows])


def runge_kutta_step(
    tracer: Tracer, field: TangentField, at: _CurvePositions, h: NDArray, order: int
) -> Traces:
    """One Runge-Kutta step of size h from each point; the traced lines with recorded points."""
    v1 = _complex(field(at.face, at.barycentric))
    if order == 1:
        return _trace_step(tracer, at, h * v1, record=True)
    v2 = _field_transported_back(tracer, field, at, 0.5 * h * v1)
    if order == 2:
        return _trace_step(tracer, at, h * v2, record=True)
    v3 = _field_transported_back(tracer, field, at, 0.5 * h * v2)
    v4 = _field_transported_back(tracer, field, at, h * v3)
    return _trace_step(tracer, at, h * (v1 + 2 * v2 + 2 * v3 + v4) / 6, record=True)


def _complex(planar: NDArray) -> NDArray[np.complex128]:
    return planar[:, 0] + 1j * planar[:, 1]


def _trace_step(tracer: Tracer, at: _CurvePositions, way: NDArray, record: bool = False) -> Traces:
    """Trace straightest lines by complex vectors in the frames of the faces."""
    length = np.abs(way)
    unit = np.where(length > 0, way / np.where(length > 0, length, 1.0), 1.0)
    direction = np.stack([unit.real, unit.imag], axis=1)
    return tracer.trace_checked(LineStart(at.face, at.barycentric, direction, length), record=record)


def _field_transported_back(
    tracer: Tracer, field: TangentField, at: _CurvePositions, way: NDArray
) -> NDArray[np.complex128]:
    """Field at the ends of straightest lines, transported back to their starts."""
    end = _trace_step(tracer, at, way)
    unit = np.where(np.abs(way) > 0, way / np.where(np.abs(way) > 0, np.abs(way), 1.0), 1.0)
    return _complex(field(end.face, end.barycentric)) * _complex(end.direction).conj() * unit


def integral_curves(
    mesh: TriangleMesh,
    field: TangentField,
    starts: SurfacePoints,
    duration: float,
    *,
    order: int = 4,
    step: float | None = None,
    tolerance: float | None = None,
    progress: ProgressCallback | None = None,
) -> IntegralCurves:
    """Integral curves of a tangent field from points of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented.
    field : TangentField
        See `field_of_array`; any function of face and barycentric coordinates is valid.
    starts : SurfacePoints
    duration : float
        Positive time; the unit of the field is length per time.
    order : {1, 2, 4}
    step : float, optional
        Fixed time step, at least the duration over MAX_STEPS. A second run with doubled steps then
        estimates the error.
    tolerance : float, optional
        Without `step`: largest error of a step, in length units, estimated by two half steps. Default: 1 % of
        the mean side length of its component.
    progress : callable, optional
        Called with the integrated time and the total time of all curves.

    Returns
    -------
    IntegralCurves
        A warning reports curves that end after MAX_STEPS steps.

    Raises
    ------
    ParameterError
        For an order, a duration, a step or a tolerance out of range.
    """
    if order not in (1, 2, 4):
        raise ParameterError(f"must be 1, 2 or 4, not {order}", parameter="order")
    if not 0 < duration < np.inf:
        raise ParameterError(f"must be positive and finite, not {duration}", parameter="duration")
    check_field_step(step, duration)
    if tolerance is not None and not 0 < tolerance < np.inf:
        raise ParameterError(f"must be positive and finite, not {tolerance}", parameter="tolerance")
    tracer = Tracer(mesh)
    if step is None:
        run = _CurveIntegrator(tracer, field, starts, duration, order, progress)
        run.integrate_adaptively(tolerance)
        return run.result()
    run = _CurveIntegrator(tracer, field, starts, duration, order, progress)
    run.integrate_uniformly(step)
    rough = _CurveIntegrator(tracer, field, starts, duration, order)
    rough.integrate_uniformly(2 * step)
    run.error = _gap(mesh, run.at, rough.at)
    return run.result()


def check_field_step(step: float | None, duration: float) -> None:
    """Raise an error for a fixed step that needs more steps than a curve may have.

    Parameters
    ----------
    step : float, optional
    duration : float
        Of the curves.

    Raises
    ------
    ParameterError
    """
    if step is None:
        return
    if not 0 < step < np.inf:
        raise ParameterError(f"must be positive and finite, not {step}", parameter="step")
    if duration > step * MAX_STEPS * (1 + 1e-9):
        raise ParameterError(
            f"a step of {step:g} takes {duration / step:.3g} steps to the time {duration:g}, more than "
            f"{MAX_STEPS:,}; use a step of at least {1.01 * duration / MAX_STEPS:.3g}, or a time of at most "
            f"{0.99 * step * MAX_STEPS:.3g}",
            parameter="step",
        )


def _gap(mesh: TriangleMesh, a: _CurvePositions, b: _CurvePositions) -> NDArray[np.float64]:
    """Distances in space between surface points."""
    first, second = (relative_position(mesh, end.face, end.barycentric) for end in (a, b))
    return np.linalg.norm(first - second, axis=1)


class _CurveIntegrator:
    """State of the curves: positions, times, and traced lines."""

    def __init__(
        self,
        tracer: Tracer,
        field: TangentField,
        starts: SurfacePoints,
        duration: float,
        order: int,
        progress: ProgressCallback | None = None,
    ) -> None:
        self.tracer, self.field, self.duration, self.order = tracer, field, duration, order
        self.progress = progress
        self.at = _CurvePositions(np.array(starts.face), np.array(starts.barycentric))
        self.starts = self.at
        k = len(starts)
        self.time, self.steps, self.error = np.zeros(k), np.zeros(k, dtype=np.int64), np.zeros(k)
        self.stop_reason = np.full(k, "", dtype=object)
        self.lines: list[tuple[NDArray, Traces]] = []  # (curve of each line, lines)
        # curves stay on their components, each of which has its own units of length and of speed
        self.component = tracer.mesh.topology.face_component[self.at.face]
        self.speed = np.zeros(tracer.mesh.topology.n_components)

    def integrate_uniformly(self, step: float) -> None:
        """Integrate with equal steps; the last one is shortened to end on time."""
        self._stop_at_critical_points()
        while len(active := np.flatnonzero(self.stop_reason == "")):
            h = np.minimum(step, self.duration - self.time[active])
            lines = runge_kutta_step(self.tracer, self.field, self.at.take(active), h, self.order)
            self._accept(active, h, [lines])
            self._report_progress()

    def integrate_adaptively(self, tolerance: float | None) -> None:
        """Integrate with steps whose difference from two half steps is below a tolerance."""
        mesh, order = self.tracer.mesh, self.order
        self._stop_at_critical_points()
        side = component_mean_side(mesh)[self.component]
        size = np.minimum(self.duration, side / self._speed(slice(None)))
        allowed = 1e-2 * side if tolerance is None else np.full(len(side), tolerance)
        least = 1e-7 * self.duration
        while len(active := np.flatnonzero(self.stop_reason == "")):
            at = self.at.take(active)
            h = np.minimum(size[active], self.duration - self.time[active])
            twice, k = np.tile(np.arange(len(active)), 2), len(active)
            both = runge_kutta_step(
                self.tracer, self.field, at.take(twice), np.concatenate([h, h / 2]), order
            )
            whole, first = _rows(both, np.arange(k)), _rows(both, np.arange(k, 2 * k))
            second = runge_kutta_step(self.tracer, self.field, _end(first), h / 2, order)
            # not over 2^order - 1: on curved meshes, where the order is one, that understates the error
            error = _gap(mesh, _end(whole), _end(second))  # type: ignore[arg-type]
            factor = 0.9 * (allowed[active] / np.maximum(error, 1e-300)) ** (1.0 / (order + 1))
            good = (error <= allowed[active]) | (h <= least)
            size[active] = np.maximum(h * np.clip(factor, 0.2, 4.0), least)
            rows = np.flatnonzero(good)
            self.error[active[rows]] += error[rows]
            self._accept(active[rows], h[rows], [_rows(first, rows), _rows(second, rows)])
            self.steps[active[~good]] += 1
            self._abandon()
            self._report_progress()

    def _accept(self, curves: NDArray, h: NDArray, traced_halves: list[Traces]) -> None:
        """Move curves to the ends of the last traced lines."""
        if not len(curves):
            return
        at_boundary = np.zeros(len(curves), dtype=bool)
        stalled = np.zeros(len(curves), dtype=bool)
        for lines in traced_halves:  # a curve that stopped in the first half has no second
            rows = np.flatnonzero(~at_boundary)
            line_ends = _rows(lines, rows)
            self.lines.append((curves[rows], line_ends))
            at_boundary[rows] |= line_ends.status == BOUNDARY_STATUS
            stalled[rows] |= line_ends.status == FAILURE_STATUS
            self.at.face[curves[rows]] = line_ends.face
            self.at.barycentric[curves[rows]] = line_ends.barycentric
        self.time[curves] += h
        self.steps[curves] += 1
        self.stop_reason[curves[self.time[curves] >= self.duration * (1 - 1e-12)]] = TIME_STOP
        self.stop_reason[curves[at_boundary]] = BOUNDARY_STOP
        self.stop_reason[curves[stalled]] = STALL_STOP
        self._stop_at_critical_points()
        self._abandon()

    def _stop_at_critical_points(self) -> None:
        active = np.flatnonzero(self.stop_reason == "")
        v = np.abs(_complex(self.field(self.at.face[active], self.at.barycentric[active])))
        np.maximum.at(self.speed, self.component[active], v)
        self.stop_reason[active[v <= 1e-12 * self._speed(active)]] = CRITICAL_POINT_STOP

    def _speed(self, curves: NDArray | slice) -> NDArray[np.float64]:
        """Largest speed so far on the components of curves; 1 where the field is zero."""
        speed: NDArray[np.float64] = self.speed[self.component[curves]]
        return np.where(speed > 0, speed, 1.0)

    def _report_progress(self) -> None:
        if self.progress is not None:
            elapsed = np.where(self.stop_reason == "", self.time, self.duration)
            self.progress(float(elapsed.sum()), len(elapsed) * self.duration)

    def _abandon(self) -> None:
        stuck = np.flatnonzero((self.stop_reason == "") & (self.steps >= MAX_STEPS))
        self.stop_reason[stuck] = STALL_STOP
        if len(stuck):
            curves = counted(len(stuck), "integral curve", "integral curves")
            _log.warning(
                f"{curves} (first: {stuck[0]}) stopped after {MAX_STEPS} steps; "
                "shorten the time or raise the tolerance"
            )

    def result(self) -> IntegralCurves:
        why = [str(w) for w in self.stop_reason]
        return IntegralCurves(self._paths(), self.time, self.steps, why, self.error)

    def _paths(self) -> SurfacePaths:
        """Concatenate the lines of each curve, without the ends of all lines but the last."""
        k = len(self.time)
        curve, face, barycentric, is_end = [np.arange(k)], [self.starts.face], [self.starts.barycentric], []
        is_end.append(np.ones(k, dtype=bool))
        for curves, lines in self.lines:
            count = np.diff(lines.path_start)
            curve.append(np.repeat(curves, count))
            face.append(lines.path_face)
            barycentric.append(lines.path_barycentric)
            end = np.zeros(len(lines.path_face), dtype=bool)
            end[lines.path_start[1:] - 1] = True
            is_end.append(end)
        owner, ends = np.concatenate(curve), np.concatenate(is_end)
        order = np.argsort(owner, kind="stable")
        last = np.ones(len(order), dtype=bool)
        last[:-1] = owner[order][1:] != owner[order][:-1]
        order = order[~ends[order] | last]
        start = np.searchsorted(owner[order], np.arange(k + 1))
        return SurfacePaths(
            np.concatenate(face)[order], np.concatenate(barycentric)[order], start, np.zeros(k, dtype=bool)
        )


def _end(lines: Traces) -> _CurvePositions:
    return _CurvePositions(lines.face, lines.barycentric)


def _rows(lines: Traces, rows: NDArray) -> Traces:
    """Select lines, with their points."""
    count = np.diff(lines.path_start)[rows]
    start = list_starts(count)
    index = ranges(lines.path_start[rows], count)[0]
    ends = (lines.face[rows], lines.barycentric[rows], lines.direction[rows], lines.length[rows])
    counts = (lines.status[rows], lines.crossings[rows])
    return Traces(*ends, *counts, start, lines.path_face[index], lines.path_barycentric[index])
