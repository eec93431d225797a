"""Points of curves at even distances, where steps have left them uneven.

Long steps shorten segments faster than slides, which are no longer than segments, lengthen them: there
points move along splines. The points of a loop that has shrunk away lie at one place; tangents between them
are rounding, and would hold the curve there: those points move along the segments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import vector_length
from ddgcli.models.curve import polygon
from ddgcli.models.curve.polygon import Polygons

LEAST_SPACING = 1e-4  # of the mean segment: below it a curve gets points at even distances in any case
UNEVEN_SPACING = 0.25  # of the longest segment: below it too, where that does not raise the objective
MAX_SPLINE_TURNING = np.pi / 2  # at a point: above it no spline stands for the curve


def uneven_curves(mesh: Polygons, points: NDArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Curves of uneven segments, and those of them with segments of almost no length.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    uneven, shrunk : (c,) ndarray of bool
    """
    curve, length = mesh.curve[mesh.tail], vector_length(points[mesh.head] - points[mesh.tail])
    shortest, longest = np.full(mesh.n_curves, np.inf), np.zeros(mesh.n_curves)
    np.minimum.at(shortest, curve, length)
    np.maximum.at(longest, curve, length)
    mean = mesh.by_curve(mesh.tail, length) / np.bincount(curve, minlength=mesh.n_curves)
    shrunk = shortest < LEAST_SPACING * mean
    return shrunk | (shortest < UNEVEN_SPACING * longest), shrunk


def even_points(mesh: Polygons, points: NDArray, k: int, smooth: bool) -> NDArray[np.float64] | None:
    """Points with those of a curve at even distances, on its segments or on the cubic spline through them.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64
    k : int
        Of the curve.
    smooth : bool
        On the spline.

    Returns
    -------
    (n, 3) ndarray of float64 or None
        None where the curve is too sharp at a point for a spline.
    """
    if smooth:
        turning = polygon.geometry(mesh, points).turning
        if turning[mesh.curve[mesh.joint] == k].max(initial=0.0) > MAX_SPLINE_TURNING:
            return None
    own = np.flatnonzero(mesh.curve == k)
    ring = np.append(own, own[0]) if mesh.closed[k] else own
    along = np.append(0.0, np.cumsum(vector_length(np.diff(points[ring], axis=0))))
    even = along[-1] * np.arange(len(own)) / (len(ring) - 1)
    moved = points.copy()
    if smooth:
        from scipy.interpolate import CubicSpline

        ends = "periodic" if mesh.closed[k] else "natural"
        moved[own] = CubicSpline(along, points[ring], bc_type=ends)(even)
    else:
        moved[own] = np.stack([np.interp(even, along, x) for x in points[ring].T], axis=1)
    return moved
