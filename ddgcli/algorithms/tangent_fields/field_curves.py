"""Integral curves and parallel transport as curve results."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import describe_paths
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tangent_fields.integral_curves import default_duration, field_of_array, integral_curves
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
    """Integral curves of an array of vectors as curves; see `integral_curves`, for `place` `field_of_array`.

    `accuracy.field_error_estimate` is the largest estimated error of an end, in length units.
    """
    followed = field_of_array(mesh, values, place)
    duration = default_duration(mesh, np.asarray(values)) if duration is None else duration
    made = integral_curves(
        mesh, followed, starts, duration, order=order, step=step, tolerance=tolerance, progress=progress
    )
    kinds = [
        {
            "kind": "integral curve",
            "stopped_because": made.stopped_because[i],
            "time": float(made.time[i]),
            "steps": int(made.steps[i]),
            "error_estimate": float(made.error_estimate[i]),
        }
        for i in range(len(starts))
    ]
    estimate = float(made.error_estimate.max(initial=0.0))
    return Curves(
        made.paths,
        describe_paths(mesh, made.paths, kinds),
        {"field_error_estimate": estimate},
        "gave up" not in made.stopped_because,
    )


def add_transport(mesh: TriangleMesh, curves: Curves) -> Curves:
    """The curves with a transported frame on their points, and the holonomy of closed ones."""
    turned = holonomy(mesh, curves.paths)
    entries = [
        entry | ({"holonomy": float(angle)} if np.isfinite(angle) else {})
        for entry, angle in zip(curves.entries, turned, strict=True)
    ]
    arrays = curves.arrays | transported_frame(mesh, curves.paths)
    return replace(curves, entries=entries, arrays=arrays)
