"""Curves as results: surface paths, their entries in the summary, and their accuracy."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.path_results import describe_paths
from ddgcli.algorithms.geodesics.paths import SurfacePaths, joints
from ddgcli.algorithms.tracing.trace import FAILURE_STATUS, STATUS_TEXT, Tracer, check_lengths
from ddgcli.geometry.face_frames import to_space
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback


@dataclass(frozen=True, eq=False)
class Curves:
    """Paths with their summary entries, accuracy and arrays.

    Parameters
    ----------
    paths : SurfacePaths
    entries : list of dict
        One entry for each path, for `results.paths` of the summary.
    accuracy : dict
    converged : bool
        False if a curve does not reach its end.
    arrays : dict of str to ndarray
        On the points of the paths.
    """

    paths: SurfacePaths
    entries: list[dict[str, Any]]
    accuracy: dict[str, Any] = field(default_factory=dict)
    converged: bool = True
    arrays: dict[str, NDArray] = field(default_factory=dict)


def concatenate_curves(curve_sets: list[Curves]) -> Curves:
    """Concatenate several sets of curves; merge their accuracies.

    Parameters
    ----------
    curve_sets : list of Curves

    Returns
    -------
    Curves
        Converged if all are.
    """
    accuracy: dict[str, Any] = {}
    for curve_set in curve_sets:
        accuracy |= curve_set.accuracy
    return Curves(
        SurfacePaths.concatenate([curve_set.paths for curve_set in curve_sets]),
        [entry for curve_set in curve_sets for entry in curve_set.entries],
        accuracy,
        all(curve_set.converged for curve_set in curve_sets),
        _concatenate_arrays(curve_sets),
    )


def _concatenate_arrays(curve_sets: list[Curves]) -> dict[str, NDArray]:
    """Arrays on the points of all curves; -1 on curves without the array."""
    names = dict.fromkeys(name for curve_set in curve_sets for name in curve_set.arrays)
    joined = {}
    for name in names:
        like = next(curve_set.arrays[name] for curve_set in curve_sets if name in curve_set.arrays)
        missing = [np.full((len(curve_set.paths.face), *like.shape[1:]), -1.0) for curve_set in curve_sets]
        joined[name] = np.concatenate(
            [curve_set.arrays.get(name, gap) for curve_set, gap in zip(curve_sets, missing)]
        )
    return joined


def trace_curves(
    mesh: SurfaceMesh,
    face: NDArray,
    barycentric: NDArray,
    direction: NDArray,
    length: NDArray,
    *,
    at_boundary: str = "stop",
    progress: ProgressCallback | None = None,
) -> Curves:
    """Trace straightest geodesics as curves.

    Parameters
    ----------
    mesh, face, barycentric, direction, length, at_boundary, progress
        As in `ddgcli.algorithms.tracing.trace.trace`.

    Returns
    -------
    Curves
        `accuracy.trace_angle_defect` is computed from the resulting points.
    """
    tracer = Tracer(mesh)
    check_lengths(mesh, face, np.broadcast_to(length, np.shape(face)), at_boundary)
    lines = tracer.trace(
        face, barycentric, direction, length, at_boundary=at_boundary, record=True, progress=progress
    )
    paths = SurfacePaths.of_traces(lines)
    kinds: list[dict[str, Any]] = []
    for i, status in enumerate(lines.status):
        kind: dict[str, Any] = {
            "kind": "trace",
            "target_length": float(np.broadcast_to(length, (len(paths),))[i]),
        }
        kind |= {"status": STATUS_TEXT[status], "crossings": int(lines.crossings[i])}
        if isinstance(mesh, TriangleMesh):
            end = to_space(mesh, lines.face[i : i + 1], lines.direction[i : i + 1])[0]
            kind["end_direction"] = end.tolist()
        kinds.append(kind)
    accuracy = {"trace_angle_defect": largest_angle_defect(mesh, paths)}
    return Curves(
        paths, describe_paths(mesh, paths, kinds), accuracy, bool((lines.status != FAILURE_STATUS).all())
    )


def largest_angle_defect(mesh: SurfaceMesh, paths: SurfacePaths) -> float:
    """Largest |left - right| / 2 at the inner points of curves, in radians; 0 for a straightest geodesic.

    Joints at segments shorter than 1e-6 of the longest side of the mesh are ignored.
    """
    joint = joints(mesh, paths)
    return float(np.nanmax(joint.angle_defect[joint.accurate], initial=0.0))


def add_geodesic_curvature(mesh: SurfaceMesh, curves: Curves) -> Curves:
    """Add the discrete geodesic curvature to curves: at each point in radians, and in total.

    It is (2 pi / total)(total / 2 - left), positive where the curve turns left; 0 at open ends.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    curves : Curves

    Returns
    -------
    Curves
        With the array `geodesic_curvature`, and `total_geodesic_curvature` in the entries.
    """
    turning = np.nan_to_num(joints(mesh, curves.paths).geodesic_curvature)
    total = sum_by_index(curves.paths.of_point(), turning, len(curves.paths))
    entries = [
        entry | {"total_geodesic_curvature": float(sum_)}
        for entry, sum_ in zip(curves.entries, total, strict=True)
    ]
    return replace(curves, entries=entries, arrays=curves.arrays | {"geodesic_curvature": turning})
