"""Whether a distance has converged, by its certificate, its estimate of the error and its residuals."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from ddgcli.geometry.remedies import remedy_for_bad_shapes
from ddgcli.linalg.residual_gate import WARNING_RESIDUAL, within_residuals
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh

# violation of the certificate relative to the largest edge distance
WARNING_EXCESS, MAX_EXCESS = 0.05, 0.5
# estimates relative to the largest distance; the error is 0.6 of that of heat in the median
WARNING_ESTIMATE, MAX_ESTIMATE = 0.1, 1.0
REMEDY_OF_ESTIMATE = {
    "error_estimate": "heat smooths distances along boundaries and where shortest paths meet; "
    "`method=fast-marching` and `method=exact` do not",
    "tolerance_error_estimate": "the detours that `tolerance` allows add up; give a smaller one, or none",
}


def has_converged(mesh: SurfaceMesh, method: str, accuracy: Mapping[str, Any]) -> bool:
    """Check the accuracy of a distance; warn where it is bad.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    accuracy : mapping
        Errors and residuals of the method, and its certificate.

    Returns
    -------
    bool
        False if the distance is not a result.
    """
    converged = within_residuals(
        accuracy,
        ("certificate_excess",),
        "bounds that every true distance satisfies are violated; use `method=exact`"
        if method != "exact"
        else partial(remedy_for_bad_shapes, mesh),
        warning=WARNING_EXCESS if method in ("heat", "fast-marching") else 0.0,
        largest=MAX_EXCESS,
    )
    for name, remedy in REMEDY_OF_ESTIMATE.items():
        converged &= within_residuals(
            accuracy, (name,), remedy, warning=WARNING_ESTIMATE, largest=MAX_ESTIMATE
        )
    thin = "rounding on thin triangles; use `method=exact`"
    is_long = accuracy.get("poisson_residual", 1.0) <= WARNING_RESIDUAL  # thin triangles leave errors in both
    long = "rounding of the heat after a long time; give a shorter `heat_time`"
    converged &= within_residuals(accuracy, ("heat_residual",), long if is_long else thin)
    return converged & within_residuals(accuracy, ("poisson_residual",), thin)
