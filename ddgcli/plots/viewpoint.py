"""Viewpoint of a picture: up axis and side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.raster import VIEWS, View, flat_view, unit_box, view_axes

BASE_LAYER = 0.02  # of the height: points of the base of a shape
MIN_BASE_RATIO = 2.0  # of base areas, for y as up axis
HEIGHT_FIELD_SHARE = 0.98  # of the area seen along an axis that shows the same side: the rest are overhangs
MIN_VIEW_GAIN = 1.2  # of the visible interest, for another side than the default
AZIMUTHS = (-60.0, 30.0, 120.0, 210.0)


def up_axis_of(mesh: TriangleMesh) -> str:
    """Up axis of a surface.

    For a height field over the xy or the xz plane, such as a terrain, the axis across this plane; over both,
    across that on which its projection is larger. Other surfaces have y up if their base is much larger with
    y up than with z up, else z. The base is the bounding rectangle of the lowest fiftieth of the height.

    Parameters
    ----------
    mesh : TriangleMesh
        Its area must neither over- nor underflow.

    Returns
    -------
    {'y', 'z'}
    """
    points = mesh.points[mesh.topology.referenced_vertex] if mesh.n_faces else mesh.points
    if len(points) == 0:
        return "z"
    area_vector = face_area_vector(mesh)
    projection, seen = np.abs(area_vector.sum(axis=0)), np.abs(area_vector).sum(axis=0)
    height_field = np.where(projection > HEIGHT_FIELD_SHARE * seen, projection, 0.0)
    if height_field[1:].any():
        return "y" if height_field[1] > height_field[2] else "z"
    base = {axis: _base_area(points, "xyz".index(axis)) for axis in "yz"}
    return "y" if base["y"] > MIN_BASE_RATIO * base["z"] else "z"


def _base_area(points: NDArray, axis: int) -> float:
    height = points[:, axis]
    layer = points[height <= height.min() + BASE_LAYER * np.ptp(height)]
    across = [i for i in range(3) if i != axis]
    return float(np.prod(np.ptp(layer[:, across], axis=0)))


def best_view(mesh: TriangleMesh, interest: NDArray | None, up: str) -> View:
    """View of a surface that shows most of the interest, from above or below.

    Parameters
    ----------
    mesh : TriangleMesh
    interest : (n,) or (m,) ndarray, optional
        Weight of each vertex or face; not negative.
    up : {'z', 'y', 'x'}
        Axis that points up on the page.

    Returns
    -------
    (float, float) or None
        Elevation and azimuth in degrees; None, the default of `view_axes`, for a flat surface, without
        interest, and where no view shows a fifth more than that one.
    """
    extent = np.ptp(mesh.points[mesh.topology.referenced_vertex], axis=0) if mesh.n_faces else np.zeros(3)
    if interest is None or not np.isfinite(interest).any() or flat_view(extent):
        return None
    elevation = VIEWS["iso"][0]
    weight = np.where(np.isfinite(interest), interest, 0.0)
    on_face = weight[mesh.faces].mean(axis=1) if len(weight) == mesh.n_vertices else weight
    area_vector = face_area_vector(mesh)
    amount = [
        float((on_face * np.maximum(area_vector @ view_axes(mesh.points, (e, azimuth), up)[2], 0.0)).sum())
        for e in (elevation, -elevation)
        for azimuth in AZIMUTHS
    ]
    best = int(np.argmax(amount))
    if amount[best] <= MIN_VIEW_GAIN * amount[0]:
        return None
    return (elevation if best < len(AZIMUTHS) else -elevation, AZIMUTHS[best % len(AZIMUTHS)])


def curve_interest(mesh: TriangleMesh, curves: Sequence[NDArray]) -> NDArray[np.float64]:
    """Weights of the faces for a view that shows curves on the surface: length of the curves per area.

    Parameters
    ----------
    mesh : TriangleMesh
    curves : sequence of (k, 3) ndarray
        Polylines whose segments are about as long as the edges, or shorter.

    Returns
    -------
    (m,) ndarray
        A segment counts at the face whose barycentre is nearest to its middle.
    """
    placed = unit_box(mesh.points)
    mesh = mesh.moved_unchecked(placed(mesh.points))
    polylines = [placed(curve) for curve in curves]
    segments = np.concatenate([np.stack([curve[:-1], curve[1:]], axis=1) for curve in polylines])
    segments = segments[np.isfinite(segments).all(axis=(1, 2))]
    if mesh.n_faces == 0 or len(segments) == 0:
        return np.zeros(mesh.n_faces)
    face = cKDTree(mesh.points[mesh.faces].mean(axis=1)).query(segments.mean(axis=1))[1]
    length = np.bincount(face, np.linalg.norm(np.diff(segments, axis=1)[:, 0], axis=1), mesh.n_faces)
    area = np.linalg.norm(face_area_vector(mesh), axis=1)
    return np.divide(length, area, out=np.zeros(mesh.n_faces), where=area > 0)
