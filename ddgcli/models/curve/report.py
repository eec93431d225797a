"""Results and accuracy of a curve flow, from the scalars of its frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.mesh.vectors import ratio, row_matrix
from ddgcli.models.curve.flow import FOLD_TURNING, REST_SPEED, CurveFlow
from ddgcli.simulation.model import Ending

MAX_AREA_RATE_ERROR = 0.1
MAX_RESOLVED_TURNING = np.pi / 3  # radians at a point; a hexagon's
AREA_ROUNDING = 1e-9  # of the circle of the same length: areas below it are the rounding of loops that cancel
# squared radii of the smallest closed curve: circles vanish less than a tenth too late
ACCURATE_STEP = 7e-3
REST_DECREASE = 1e-11  # of the energy, in a quarter of the frames, at rest

log = logging.getLogger("ddgcli")


def summary(
    flow: CurveFlow,
    times: NDArray,
    series: Mapping[str, NDArray],
    limit: int,
    ending: Ending | None,
    failure: str,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results and accuracy of a run of a curve flow.

    Parameters
    ----------
    flow : CurveFlow
    times : (T,) ndarray
    series : mapping of str to (T,) or (T, c) ndarray
        Scalars of every frame.
    limit : int
        Steps that the schedule allows.
    ending : Ending or None
        Why it ended before.
    failure : str
        Why it failed, or "".

    Returns
    -------
    results, accuracy : dict
    """
    has_total = flow.mesh.has_total_area
    collapse = np.atleast_1d(series["collapse_time_by_curve"][-1])
    results: dict[str, Any] = {
        "times": times.tolist(),
        "length": series["length"].tolist(),
        "area": series["area"].tolist() if has_total else None,
        "elastic_energy": series["elastic_energy"].tolist(),
        "turning_number": int(series["turning_number"][-1]) if has_total else None,
        "self_crossings": series["self_crossings"].astype(int).tolist() if _is_plane(flow) else None,
        "stopped_because": failure or (ending.text if ending else f"{limit} steps were taken"),
        "collapse_times": [None if t < 0 else float(t) for t in collapse],
    }
    if flow.mesh.n_curves > 1:
        results["curves"] = [
            _last_values(series, k, flow.mesh.bounds_area[k]) for k in range(flow.mesh.n_curves)
        ]
    spacing = series["longest_segment"] / np.maximum(series["shortest_segment"], 1e-300)
    accuracy: dict[str, Any] = {
        "length_increases": int(series["length_increases"][-1]),
        "energy_increases": int(series["energy_increases"][-1]) if flow.kind == "elastic" else None,
        "area_drift": _area_drift(series) if flow.kind == "area-preserving" else None,
        "length_drift": _drift(series["length_by_curve"]) if _keeps_length(flow) else None,
        "area_rate_error": _area_rate_error(flow, series),
        "turning_number_changes": _turning_number_changes(series) if flow.mesh.bounds_area.any() else None,
        "self_crossing_changes": int(np.count_nonzero(np.diff(series["self_crossings"])))
        if _is_plane(flow)
        else None,
        "redistributed": flow.redistribute,
        "spacing_ratio": [float(spacing[0]), float(spacing[-1])],
        "largest_turning_degrees": float(np.degrees(series["largest_turning"].max())),
    }
    if flow.mesh.bounds_area.all() and not has_total:
        log.warning(
            "area and turning_number have no sum over curves in planes that are not parallel: see those of "
            "each curve"
        )
    _warn(accuracy, series)
    if flow.stop_at_rest and not (ending or failure):
        _warn_of_motion(flow, limit, float(times[-1]) / limit, series)
    return results, {name: value for name, value in accuracy.items() if value is not None}


def _last_values(series: Mapping[str, NDArray], k: int, bounds_area: bool) -> dict[str, float | None]:
    """Length, area, elastic energy and turning number of curve k at the end."""
    last = {
        name: float(series[f"{name}_by_curve"][-1, k])
        for name in ("length", "area", "elastic_energy", "turning_number")
    }
    if not bounds_area:
        return {**last, "area": None, "turning_number": None}
    return {**last, "turning_number": int(last["turning_number"])}


def _warn_of_motion(flow: CurveFlow, limit: int, dt: float, series: Mapping[str, NDArray]) -> None:
    """Warn that a flow to rest ended before, with steps, longer or more, that reach the time of rest."""
    radius, longest = flow.first_radius, math.inf
    further = limit * _extrapolated_rest(series["elastic_energy" if flow.kind == "elastic" else "length"])
    if flow.kind == "curvature":
        further = limit + _time_to_rest(flow, series) / dt
        if flow.mesh.closed.any():
            longest = ACCURATE_STEP * float(radius[flow.mesh.closed].min()) ** 2 * flow.time_unit
    if math.isinf(further):
        step = dt * max(5.0, float((radius.max() / radius.min()) ** flow.time_power))
        remedy = f"a longer step leads further: `step={step:.3g}`"
    else:
        step, more = min(dt * further / limit, longest), f"more of them: `steps={_hundreds(further)}`"
        n_steps = f" with `steps={_hundreds(dt * further / step)}`" if step == longest else ""
        remedy = f"a longer step leads further: `step={step:.3g}`{n_steps}, or {more}"
        if step <= dt:
            remedy = f"take {more}"
    log.warning("curves still move after %d steps, the most without `steps` or `duration`; %s", limit, remedy)


def _hundreds(n_steps: float) -> int:
    """The next hundred of steps."""
    return math.ceil(n_steps / 100.0) * 100


def _time_to_rest(flow: CurveFlow, series: Mapping[str, NDArray]) -> float:
    """Time within which curvature flow shrinks closed curves to points and straightens open ones.

    Closed curves by Fenchel: (L^2)' <= -8 pi^2; a quarter more, for implicit steps longer than the last
    squared radii. Sines over a length L decay by exp(-pi^2 t / L^2), up to `REST_SPEED`; until a curve is
    nearly such a sine, it takes a time of the size of L^2 / pi^2.
    """
    length = row_matrix(series["length_by_curve"])[-1]
    moves = np.atleast_1d(series["collapse_time_by_curve"][-1]) < 0
    closed = 1.25 * length**2 / (8.0 * np.pi**2)
    straight = (2.0 - math.log(REST_SPEED)) * length**2 / np.pi**2
    return float(np.max(np.where(flow.mesh.closed, closed, straight) * moves))


def _extrapolated_rest(energy: NDArray) -> float:
    """Time until an energy falls no more, over that of its frames; inf without an exponential decay."""
    ends = energy[[len(energy) // 2, 3 * len(energy) // 4, -1]]
    early, late = -np.diff(ends)
    least = REST_DECREASE * ends[-1]
    if not least < late < early:
        return math.inf
    return 1.0 + 0.25 * math.log(late / least) / math.log(early / late)


def _is_plane(flow: CurveFlow) -> bool:
    return bool(flow.mesh.normal.any(axis=1).all())


def _keeps_length(flow: CurveFlow) -> bool:
    return flow.kind == "elastic" and flow.length_penalty is None


def _drift(values: NDArray) -> float:
    """Largest relative change of a quantity of each curve since the start."""
    values = row_matrix(values)
    size = np.maximum(np.abs(values).max(axis=0), 1e-300)
    return float((np.abs(values - values[0]) / size).max())


def _area_drift(series: Mapping[str, NDArray]) -> float:
    """Largest change of the area of a curve, relative to it.

    Where the loops of a curve cancel but for rounding, relative to the circle of its length at the start.
    """
    area = row_matrix(series["area_by_curve"])
    size = np.abs(area).max(axis=0)
    circle = row_matrix(series["length_by_curve"])[0] ** 2 / (4.0 * np.pi)
    size = np.maximum(np.where(size > AREA_ROUNDING * circle, size, circle), 1e-300)
    return float((np.abs(area - area[0]) / size).max())


def _area_rate_error(flow: CurveFlow, series: Mapping[str, NDArray]) -> float | None:
    """Relative error of the loss of area, exactly 2 pi times the turning number a unit of time.

    Of the closed plane curve where it is largest, and of all steps up to the one in which it shrinks to a
    point, but those in which a loop does. None where the rates are zero, or the exact losses would be
    rounding.
    """
    loss, exact = (row_matrix(series[f"{name}_by_curve"])[-1] for name in ("area_loss", "exact_area_loss"))
    circle = row_matrix(series["length_by_curve"])[0] ** 2 / (4.0 * np.pi)
    measured = np.abs(exact) > AREA_ROUNDING * circle
    if flow.kind != "curvature" or not measured.any():
        return None
    return float(np.max(ratio(np.abs(loss - exact), np.abs(exact))[measured]))


def _turning_number_changes(series: Mapping[str, NDArray]) -> int:
    """Frames at which a turning number is not what it was at the frame before."""
    return int(np.diff(row_matrix(series["turning_number_by_curve"]), axis=0).any(axis=1).sum())


def folds_back(series: Mapping[str, NDArray]) -> bool:
    """Whether the last frame runs back on itself at a point, more than the first: it is no curve any more.

    Curves that have shrunk to a point do not count.

    Parameters
    ----------
    series : mapping of str to (T, ...) ndarray
        Scalars of the frames.

    Returns
    -------
    bool
    """
    turning = series["largest_turning"]
    return bool(turning[-1] > max(FOLD_TURNING, turning[0]))


def _warn(accuracy: Mapping[str, Any], series: Mapping[str, NDArray]) -> None:
    if accuracy["turning_number_changes"]:
        log.warning("the turning number changed: a loop of the curve shrank to a point")
    crossings = series["self_crossings"].astype(int)
    if changes := accuracy["self_crossing_changes"]:
        log.warning(
            "the number of self-crossings changes at %s: %d at the start, %d at the end, at most %d",
            counted(changes, "frame", "frames"), crossings[0], crossings[-1], max(crossings),
        )  # fmt: skip
    if (error := accuracy["area_rate_error"] or 0.0) > MAX_AREA_RATE_ERROR:
        log.warning(
            "the area does not fall by 2 pi a unit of time (%.2g %% off, and times with it): use shorter "
            "steps (`step`) or a curve with more points", 100 * error,
        )  # fmt: skip
    if folds_back(series):
        log.error(
            "the curve folds back on itself (it turns by %.3g degrees at one point), which no smooth curve "
            "does: it has shrunk to a line or its points are too few; end the run before, or use more points",
            np.degrees(series["largest_turning"][-1]),
        )
    elif series["largest_turning"][-1] > MAX_RESOLVED_TURNING:
        log.warning(
            "the curve turns by %.3g degrees at one point of the last frame: use a curve with more points",
            np.degrees(series["largest_turning"][-1]),
        )
