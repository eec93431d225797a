"""Integral curves and parallel transport as curve results."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.path_results import describe_paths
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tangent_fields.integral_curves import integral_curves
from ddgcli.algorithms.tangent_fields.tangent_field import default_duration, field_of_array
from ddgcli.algorithms.tangent_fields.transport import holonomy, transported_frame
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback


def field_curves(
    mesh: TriangleMesh,
    values: NDArray,
    starts: SurfacePoints,
    duration: float | None = None,
    *,
    order: int = 4,
    step: float | None = None,
    tolerance: float | None = None,
    progress: ProgressCallback | None = None,
    place: str = "",
) -> Curves:
    """Integral curves of an array of vectors, as curves.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n, 3) or (m, 3) ndarray of float64
        Vectors on vertices or faces.
    starts : SurfacePoints
    duration : float, optional
        By default that of `default_duration`.
    order, step, tolerance, progress
        As in `integral_curves`.
    place : {'vertex', 'face', ''}
        Of the vectors; inferred from their number if empty.

    Returns
    -------
    Curves
        `accuracy.field_error_estimate` is the largest estimated error of an end, in length units.
    """
    tangent_field = field_of_array(mesh, values, place)
    duration = default_duration(mesh, np.asarray(values)) if duration is None else duration
    integrated = integral_curves(
        mesh, tangent_field, starts, duration, order=order, step=step, tolerance=tolerance, progress=progress
    )
    kinds = [
        {
            "kind": "integral curve",
            "stopped_because": integrated.stopped_because[i],
            "time": float(integrated.time[i]),
            "steps": int(integrated.steps[i]),
            "error_estimate": float(integrated.error_estimate[i]),
        }
        for i in range(len(starts))
    ]
    estimate = float(integrated.error_estimate.max(initial=0.0))
    return Curves(
        integrated.paths,
        describe_paths(mesh, integrated.paths, kinds),
        {"field_error_estimate": estimate},
        "gave up" not in integrated.stopped_because,
    )


def add_transport(mesh: TriangleMesh, curves: Curves) -> Curves:
    """Add a transported frame to the points of curves, and the holonomy to closed curves.

    Parameters
    ----------
    mesh : TriangleMesh
    curves : Curves

    Returns
    -------
    Curves
    """
    angles = holonomy(mesh, curves.paths)
    entries = [
        entry | ({"holonomy": float(angle)} if np.isfinite(angle) else {})
        for entry, angle in zip(curves.entries, angles, strict=True)
    ]
    arrays = curves.arrays | transported_frame(mesh, curves.paths)
    return replace(curves, entries=entries, arrays=arrays)
