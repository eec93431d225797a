"""Curvature of polylines in the plane and in space (chapter 1, and 1.3 of chapter 3)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.curve_frames import (
    FRAME_SCALARS,
    FRAME_VECTORS,
    check_frames,
    curve_frames,
    resampled,
)
from ddgcli.errors import MeshError, renamed_parameters
from ddgcli.mesh.curve import CurveSet, are_parallel, plane_normals
from ddgcli.mesh.plane import nearest_axis
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import ratio, row_cross, row_dot, vector_length

log = logging.getLogger("ddgcli")


# sums whose terms have the sign of a view of their planes
SIGNED_SUMS = ("total_signed_curvature", "turning_number")


@dataclass(frozen=True, eq=False)
class PolylineCurvature:
    """Arrays on points by name, the results and the accuracy of the summary, and the measured curves."""

    vertex: dict[str, NDArray]
    results: dict[str, Any]
    accuracy: dict[str, Any]
    curves: CurveSet


def measure_curves(
    curves: CurveSet, *, with_frames: bool = False, resample: int | None = None
) -> PolylineCurvature:
    """Measure turning, curvature, torsion and their sums for each polyline of a set.

    The turning of a curve that lies in a plane (any plane; see `plane_normal`) has a sign; others are space
    curves.

    Parameters
    ----------
    curves : CurveSet
    with_frames : bool
        Also compute the arrays of `curve_frames`.
    resample : int, optional
        First replace each curve by this number of points at even arc lengths.

    Returns
    -------
    PolylineCurvature
        Arrays of length n, 0 at points of no curve; `results` hold the sums over all curves, and one entry
        a curve in `curves` where there are several.

    Raises
    ------
    MeshError
        No segment of positive length.
    """
    own: dict[str, NDArray] = {}
    if resample is not None:
        with renamed_parameters(count="resample"):
            curves = resampled(curves, resample)
        own = dict(curves.point_arrays)
    normals = plane_normals(curves)
    planar = all(normal is not None for normal in normals)
    names = _scalar_names(planar)
    vertex = {name: np.zeros(curves.n_vertices) for name in names}
    vertex["gauss_map"] = np.zeros((curves.n_vertices, 3))
    each = []
    for (path, closed), normal in zip(curves.paths, normals, strict=True):
        arrays, results = measure_curve(curves.points[path], closed, normal)
        for name in vertex:
            vertex[name][path] = arrays[name]
        each.append(results)
    if not each or not any(r["length"] > 0 for r in each):
        raise _no_length_error()
    results = _together(each, parallel := are_parallel(normals))
    residuals = [r["turning_number_residual"] for r in each if r["turning_number_residual"] is not None]
    for r in (results, *each):
        del r["turning_number_residual"]
    results |= {name: _range(vertex[name]) for name in names}
    if len(each) > 1:
        results["curves"] = each
    if residuals and planar and not parallel:
        log.warning(
            "turning_number and total_signed_curvature have no sum over curves in planes that are not "
            "parallel: see those of each curve"
        )
    if with_frames:
        arrays, holonomy = curve_frames(curves)
        own, results = own | arrays, results | holonomy
    accuracy = {"turning_number_residual": max(residuals, default=None)}
    return PolylineCurvature(vertex | own, results, accuracy, curves)


def check_query(curves: CurveSet, *, with_frames: bool = False, resample: int | None = None) -> None:
    """Raise the errors of `measure_curves`, before it measures.

    Parameters
    ----------
    curves : CurveSet
    with_frames : bool
    resample : int, optional
        As in `measure_curves`.
    """
    if resample is not None:
        with renamed_parameters(count="resample"):
            curves = resampled(curves, resample)
    if not any((vector_length(np.diff(curves.points[path], axis=0)) > 0).any() for path, _ in curves.paths):
        raise _no_length_error()
    if with_frames:
        check_frames(curves)


def array_names(
    curves: CurveSet, *, with_frames: bool = False, resample: int | None = None
) -> tuple[list[str], list[str]]:
    """Names of the arrays of `measure_curves`.

    Parameters
    ----------
    curves : CurveSet
    with_frames : bool
    resample : int, optional
        As in `measure_curves`.

    Returns
    -------
    scalars, vectors : list of str
    """
    planar = all(normal is not None for normal in plane_normals(curves))
    of_resampling = ["arc_length"] if resample is not None and not with_frames else []
    scalars = [*_scalar_names(planar), *of_resampling, *(FRAME_SCALARS if with_frames else ())]
    return scalars, ["gauss_map", *(FRAME_VECTORS if with_frames else ())]


def _scalar_names(planar: bool) -> list[str]:
    return ["turning_angle", "curvature", "vertex_length", "gauss_angle" if planar else "torsion"]


def _no_length_error() -> MeshError:
    return MeshError("no segment of positive length; curvature needs a curve: check the points")


def _together(each: list[dict[str, Any]], parallel: bool) -> dict[str, Any]:
    """Sums over the curves; a sum is unknown where one of its terms is.

    Signed ones are where the planes are not parallel: from which side each is seen depends on the axes.
    """
    if len(each) == 1:
        return dict(each[0])
    total: dict[str, Any] = {
        "closed": all(r["closed"] for r in each),
        "planar": all(r["planar"] for r in each),
    }
    for name in dict.fromkeys(name for r in each for name in r):
        if name in total or name == "unknotted_by_fary_milnor":
            continue
        values = [r.get(name, 0.0) for r in each]  # a plane curve has no torsion
        all_defined = all(v is not None for v in values)
        combine = max if name in ("longest_segment", "turning_number_residual") else sum
        all_defined &= parallel or name not in SIGNED_SUMS
        total[name] = combine(values) if all_defined else None
    return total


def _range(values: NDArray) -> dict[str, float]:
    return {"min": float(values.min()), "max": float(values.max()), "mean": float(values.mean())}


def measure_curve(
    points: NDArray, closed: bool, normal: NDArray | None
) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Arrays and results of one polyline.

    Parameters
    ----------
    points : (n, 3) ndarray
        In order; the first is not repeated.
    closed : bool
    normal : (3,) ndarray, optional
        Normal of the plane of a curve; a left turn, seen from its tip, is positive.

    Returns
    -------
    arrays : dict
        `turning_angle` (n,) between successive segments, in radians (0 at the ends of an open curve; in
        space never negative); `vertex_length` half the length of the segments at a point; `curvature` their
        quotient; `gauss_map` (n, 3) normal, a quarter turn left of the segment that leaves the point (in
        space: that segment's direction); in the plane `gauss_angle`, its angle followed continuously, in
        space `torsion`, the angle by which the osculating plane turns over the segments at a point, over
        their length; positive for right-handed helices.
    results : dict

    Notes
    -----
    Points that repeat their predecessor are skipped: their values are 0.
    """
    n, planar = len(points), normal is not None
    following = np.roll(points, -1, axis=0) - points
    has_length = vector_length(following) > 0
    if not closed and n:
        has_length[-1] = False
    # a point is kept where a segment of positive length leaves it; an open curve's last one too
    keep = np.flatnonzero(has_length)
    if not closed and len(keep):
        keep = np.append(keep, min(keep[-1] + 1, n - 1))
    arrays = {name: np.zeros(n) for name in ("turning_angle", "curvature", "vertex_length", "gauss_angle")}
    arrays |= {"torsion": np.zeros(n), "gauss_map": np.zeros((n, 3))}
    segment = following[keep] if closed else np.diff(points[keep], axis=0)
    if len(segment) == 0:
        return arrays, _results(arrays, np.zeros(0), closed, planar)
    length = vector_length(segment)
    tangent = segment / length[:, None]
    before, after, at = _joints(len(segment), closed)
    angle = _turning(tangent[before], tangent[after], normal)
    arrays["turning_angle"][keep[at]] = angle
    first = np.arange(len(segment))
    ends = np.concatenate([first, (first + 1) % len(keep)])
    half = sum_by_index(ends, np.tile(length / 2, 2), len(keep))
    arrays["vertex_length"][keep] = half
    arrays["curvature"][keep] = arrays["turning_angle"][keep] / half
    _gauss_map(arrays, keep, tangent, closed, normal)
    if not planar:
        _torsion(arrays, keep, tangent, length, closed)
    return arrays, _results(arrays, length, closed, planar)


def _joints(segments: int, closed: bool) -> tuple[NDArray, NDArray, NDArray]:
    """Segments before and after each point where two meet, and these points."""
    if closed:
        point = np.arange(segments)
        return point - 1, point, point
    point = np.arange(1, segments)
    return point - 1, point, point


def _turning(before: NDArray, after: NDArray, normal: NDArray | None) -> NDArray[np.float64]:
    cosine = row_dot(before, after)
    binormal = row_cross(before, after)
    return np.arctan2(vector_length(binormal) if normal is None else binormal @ normal, cosine)


def _gauss_map(
    arrays: dict[str, NDArray], keep: NDArray, tangent: NDArray, closed: bool, normal: NDArray | None
) -> None:
    leaving = tangent if closed else np.concatenate([tangent, tangent[-1:]])
    if normal is None:
        arrays["gauss_map"][keep] = leaving
        return
    arrays["gauss_map"][keep] = left = row_cross(normal, leaving)
    # axes of the plane: x and y in a horizontal one, and their cyclic images in the others
    first = np.eye(3)[(nearest_axis(normal) + 1) % 3]
    first = first - (first @ normal) * normal
    second = row_cross(normal, first)
    turning = arrays["turning_angle"][keep]
    start = np.arctan2(left[0] @ second, left[0] @ first)
    arrays["gauss_angle"][keep] = start + np.concatenate([[0.0], np.cumsum(turning[1:])])


def _torsion(
    arrays: dict[str, NDArray], keep: NDArray, tangent: NDArray, length: NDArray, closed: bool
) -> None:
    before, after, at = _joints(len(tangent), closed)
    binormal = np.zeros((len(keep), 3))
    binormal[at] = row_cross(tangent[before], tangent[after])
    k = np.arange(len(tangent))
    here, there = binormal[k], binormal[(k + 1) % len(keep)]
    sine = row_dot(row_cross(here, there), tangent)
    cosine = row_dot(here, there)
    # angle between planes, not binormals: at an inflection the binormal jumps by pi and the plane does not
    angle = np.arctan2(np.where(cosine < 0, -sine, sine), np.abs(cosine))
    defined = np.flatnonzero((vector_length(here) > 0) & (vector_length(there) > 0))
    ends = np.concatenate([defined, (defined + 1) % len(keep)])
    total = sum_by_index(ends, np.tile(angle[defined], 2), len(keep))
    width = sum_by_index(ends, np.tile(length[defined], 2), len(keep))
    arrays["torsion"][keep] = ratio(total, width)


def _results(arrays: dict[str, NDArray], length: NDArray, closed: bool, planar: bool) -> dict[str, Any]:
    angle = arrays["turning_angle"]
    signed = float(angle.sum()) if planar else None
    total = float(np.abs(angle).sum())
    turns = round(signed / (2 * np.pi)) if closed and signed is not None else None
    results = {
        "closed": closed,
        "planar": planar,
        "length": float(length.sum()),
        "longest_segment": float(length.max(initial=0.0)),
        "total_signed_curvature": signed,
        "turning_number": turns,
        "turning_number_residual": None if turns is None else abs(signed / (2 * np.pi) - turns),  # type: ignore[operator]
        "total_curvature": total,
    }
    if not planar:
        results["total_torsion"] = float((arrays["torsion"] * arrays["vertex_length"]).sum())
        # Fary and Milnor: a knotted closed curve has total curvature above 4 pi
        results["unknotted_by_fary_milnor"] = total <= 4 * np.pi if closed else None
    return results
