"""From curves and options to a flow."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import CURVE_FLOWS
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.curve import polygon
from ddgcli.models.curve.crossings import self_crossings
from ddgcli.models.curve.flow import CurveFlow, start_state
from ddgcli.simulation.model import Model, Schedule, flow_schedule

MAX_STEPS = 2000
PART_GROWTH = 2.0  # of the parts of a step that fails: a tip grows, and its time with the fourth power
DEFAULT_FRAME_COUNT = 50
DEFAULT_STEP = {  # in squared radii (elastic: fourth powers) of the smallest curve: MAX_STEPS are enough for
    "curvature": 5e-4,  # twice the time in which a circle vanishes
    "area-preserving": 4e-3,  # 24 decay times of an ellipse of small eccentricity
    "elastic": 5e-4,  # more than 15 decay times of such an ellipse
}
DEFAULT_OPEN_STEP = (
    1e-2  # of the half circle, where all are open: MAX_STEPS are 20 decay times of sin(pi s / L)
)
EXTENT_RANGE = (1e-60, 1e60)
MAX_TURNING = np.pi - 1e-6  # radians; a joint that turns back has no elastic energy gradient

log = logging.getLogger("ddgcli")


@dataclass(frozen=True)
class CurveFlowOptions:
    """Options of a curve flow.

    Parameters
    ----------
    flow : str
        Of CURVE_FLOWS.
    redistribute : bool
        Move points along the curve towards equal distances.
    length_penalty : float, optional
        Elastic flow: weight of the length in the energy, 0 for the free flow; None keeps the length.
    stop_at_rest : bool
    """

    flow: str = "curvature"
    redistribute: bool = True
    length_penalty: float | None = None
    stop_at_rest: bool = True


def without_repeated_points(curves: CurveSet) -> CurveSet:
    """Remove unused points, and points that repeat their predecessor.

    Parameters
    ----------
    curves : CurveSet

    Returns
    -------
    CurveSet
        Paths in their order.

    Raises
    ------
    MeshError
        No segment, or a curve with too few different points.
    """
    paths, lines, start, repeated = [], [], 0, 0
    for number, (path, closed) in enumerate(curves.paths):
        points = curves.points[path]
        before = np.roll(points, 1, axis=0)
        distinct = vector_length(points - before) > 0
        if not closed:
            distinct[0] = True
        repeated += int((~distinct).sum())
        distinct_points = points[distinct]
        least = 3 if closed else 2
        if len(distinct_points) < least:
            # of a closed curve in one place, each point repeats its predecessor
            places = counted(max(1, len(distinct_points)), "different point", "different points")
            raise MeshError(
                f"curve {number} (first point {path[0]}) has {places}; "
                f"{'a closed' if closed else 'an open'} curve needs {least}: remove it or correct its points"
            )
        at = start + np.arange(len(distinct_points))
        lines.append(np.stack([at, np.roll(at, -1)], axis=1)[: len(at) if closed else -1])
        paths.append(distinct_points)
        start += len(distinct_points)
    if not paths:
        raise MeshError("no segments; curve-flow needs a curve")
    if repeated:
        text = counted(
            repeated, "point repeats its predecessor and is", "points repeat their predecessor and are"
        )
        log.warning("%s left out", text)
    return CurveSet(np.concatenate(paths), np.concatenate(lines))


def build(curves: CurveSet, options: CurveFlowOptions) -> tuple[CurveFlow, Model]:
    """Flow of curves, and the model that the time loop advances.

    Parameters
    ----------
    curves : CurveSet
        From `without_repeated_points`.
    options : CurveFlowOptions

    Returns
    -------
    CurveFlow, Model

    Raises
    ------
    MeshError, ParameterError
        On curves or options that the flow cannot take.
    """
    if options.flow not in CURVE_FLOWS:
        raise ParameterError(
            f"{options.flow!r} is not available; choose one of {', '.join(CURVE_FLOWS)}", parameter="flow"
        )
    if (penalty := options.length_penalty) is not None:
        if options.flow != "elastic":
            raise ParameterError("belongs to `flow=elastic`; leave it out", parameter="length_penalty")
        if not 0 <= penalty < math.inf:
            raise ParameterError(
                f"must be 0 or a positive number, not {penalty:g}", parameter="length_penalty"
            )
    points, centre, scale = _unit_size(curves)
    mesh = polygon.polygons(CurveSet(points, curves.lines))
    shape = polygon.geometry(mesh, points)
    length, area = mesh.by_curve(mesh.tail, shape.length), polygon.enclosed_area(mesh, points)
    if options.flow == "area-preserving" and not mesh.bounds_area.all():
        bad = int(np.argmin(mesh.bounds_area))
        what = "is open" if not mesh.closed[bad] else "lies in no plane"
        raise MeshError(
            f"curve {bad} {what} and encloses no area; `flow=area-preserving` takes closed plane curves: "
            "use `flow=curvature`"
        )
    if options.flow == "elastic":
        _require_bends(mesh, shape.turning)
        if options.length_penalty is None:
            _require_slack(mesh, points, length)
    penalty = None if penalty is None else penalty * scale**2
    radius = length / (2 * np.pi)
    simple = mesh.bounds_area & (area != 0.0) & (self_crossings(mesh, points) == 0.0)
    if options.flow != "elastic":
        radius = np.where(simple, np.sqrt(np.abs(area) / np.pi), radius)
    flow = CurveFlow(
        mesh, options.flow, options.redistribute, penalty, options.stop_at_rest, length, area, radius, simple,
        centre, scale,
    )  # fmt: skip
    model = Model(
        start_state(flow, points), flow.advance, flow.observe, flow.pack, flow.unpack,
        distance=flow.distance, order=1, stop=flow.ending, time_unit=f"length^{flow.time_power}",
        growth=PART_GROWTH, usual_step=default_step(flow),
    )  # fmt: skip
    return flow, model


def _unit_size(curves: CurveSet) -> tuple[NDArray, NDArray, float]:
    """Points about their centre at a size near 1, the centre, and the scale (a power of two)."""
    centre = 0.5 * (curves.points.min(axis=0) + curves.points.max(axis=0))
    extent = float(np.abs(curves.points - centre).max())
    if not EXTENT_RANGE[0] < extent < EXTENT_RANGE[1]:
        raise MeshError(
            f"the curves measure {extent:.3g} from their centre; curve-flow takes {EXTENT_RANGE[0]:g} to "
            f"{EXTENT_RANGE[1]:g}: rescale"
        )
    scale = 2.0 ** round(math.log2(extent))
    return (curves.points - centre) / scale, centre, scale


def _require_bends(mesh: polygon.Polygons, turning: NDArray) -> None:
    back = np.flatnonzero(turning > MAX_TURNING)
    if len(back):
        raise MeshError(
            f"the curve turns back at {counted(len(back), 'point', 'points')} (first: point "
            f"{mesh.joint[back[0]]}), where its elastic energy has no gradient; remove what turns back, or "
            "use `flow=curvature`"
        )


def _require_slack(mesh: polygon.Polygons, points: NDArray, length: NDArray) -> None:
    """Raise an error for straight open curves between fixed ends: their length leaves nothing to move."""
    ends = np.zeros((mesh.n_curves, 3))
    np.add.at(ends, mesh.curve[mesh.tail], points[mesh.head] - points[mesh.tail])
    straight = ~mesh.closed & (vector_length(ends) > length * (1 - 1e-12))
    if straight.any():
        raise MeshError(
            f"curve {int(np.argmax(straight))} is straight between its fixed ends, and cannot move "
            "at this length; use `length_penalty=0`, or remove it"
        )


def default_step(flow: CurveFlow) -> float:
    """Step of a flow where none is chosen.

    Parameters
    ----------
    flow : CurveFlow

    Returns
    -------
    float
        In the input's unit of time.
    """
    radius, step = float(flow.first_radius.min()), DEFAULT_STEP[flow.kind]
    if not flow.mesh.closed.any():
        radius, step = float(flow.first_length.min()) / math.pi, DEFAULT_OPEN_STEP
    return step * radius**flow.time_power * flow.time_unit


def schedule(flow: CurveFlow, options: Mapping[str, Any]) -> Schedule:
    """When a curve flow steps and records.

    Parameters
    ----------
    flow : CurveFlow
    options : mapping
        `steps`, `duration`, `step`, `frame_every`, `tolerance`.

    Returns
    -------
    Schedule

    Raises
    ------
    ParameterError
        For options without the time that they divide.
    """
    return flow_schedule(options, default_step(flow), max_steps=MAX_STEPS, n_frames=DEFAULT_FRAME_COUNT)
