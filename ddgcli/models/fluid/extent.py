"""Middle, box and plane of a fluid: wherever it lies, and whatever vertices no cell has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.plane import PLANARITY_TOLERANCE, nearest_axis, plane_normal
from ddgcli.mesh.vectors import row_cross, row_dot, tangential, unit_vectors
from ddgcli.models.fluid.context import FluidContext

MAX_SPHERE_RADIUS = 2.0  # over the size of a part of a sphere, whose own middle counts if it is flatter


def plane_axes(context: FluidContext) -> NDArray[np.float64] | None:
    """Axes of the plane in which a fluid lies, to `PLANARITY_TOLERANCE` of its size.

    Parameters
    ----------
    context : FluidContext

    Returns
    -------
    (3, 3) ndarray of float64 or None
        In rows: two along the plane and its normal; x, y and z where it is horizontal. The normal is that of
        `plane_normal`; the first is the projection of x, of y where the normal is nearest to x, of z where it
        is nearest to y. None for curved surfaces and volumes.
    """
    normal = None if context.is_volume else plane_normal(context.points)
    if normal is None:
        return None
    first = unit_vectors(tangential(np.eye(3)[(nearest_axis(normal) + 1) % 3], normal))
    return np.stack([first, row_cross(normal, first), normal])


def is_horizontal(context: FluidContext) -> bool:
    """Whether a fluid lies in a plane z = constant, to `PLANARITY_TOLERANCE` of its size.

    Parameters
    ----------
    context : FluidContext

    Returns
    -------
    bool
    """
    sizes = np.ptp(context.points, axis=0)
    return not context.is_volume and bool(sizes[2] <= PLANARITY_TOLERANCE * sizes.max())


def bounding_box(context: FluidContext) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates from the corner of the bounding box, and its sizes.

    Parameters
    ----------
    context : FluidContext

    Returns
    -------
    place : (n, 3) ndarray of float64
        Along the axes of the plane in which the fluid lies, else along x, y and z.
    sizes : (3,) ndarray of float64
        Extents along these axes; the periods of a periodic grid.
    """
    axes = plane_axes(context)
    place = context.points if axes is None else context.points @ axes.T
    place = place - place.min(axis=0)
    return place, np.where(context.period > 0, context.period, place.max(axis=0))


def middle(context: FluidContext) -> NDArray[np.float64]:
    """Centre of the sphere on which a fluid lies, else its centroid by area or volume.

    Parameters
    ----------
    context : FluidContext

    Returns
    -------
    (3,) ndarray of float64
    """
    if not context.is_volume and plane_axes(context) is None:
        centre = sphere_centre(context.points[context.used])
        if centre is not None:
            return centre
    mesh = context.mesh
    size = np.abs(mesh.signed_volume) if context.is_volume else face_area(mesh.side_length)
    return (size / size.sum()) @ context.face_points()


def sphere_centre(points: NDArray) -> NDArray[np.float64] | None:
    """Centre of the sphere on which points lie, to `PLANARITY_TOLERANCE` of its radius.

    Parameters
    ----------
    points : (n, 3) ndarray of float64

    Returns
    -------
    (3,) ndarray of float64 or None
        None where they do not, or where the radius exceeds `MAX_SPHERE_RADIUS` of their size.
    """
    origin = points.mean(axis=0)
    apart = points - origin
    size = float(np.linalg.norm(apart, axis=1).max()) or 1.0
    x = apart / size  # |x|^2 = 2 c . x + (r^2 - |c|^2)
    centre = np.linalg.lstsq(np.column_stack([2.0 * x, np.ones(len(x))]), row_dot(x, x), rcond=None)[0][:3]
    radius = np.linalg.norm(x - centre, axis=1)
    if np.ptp(radius) > PLANARITY_TOLERANCE * radius.max() or radius.max() > MAX_SPHERE_RADIUS:
        return None
    return origin + size * centre
