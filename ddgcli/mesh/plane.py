"""Plane in which points lie, and the axis nearest to a direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PLANARITY_TOLERANCE = 1e-6  # of the size of the points: coordinates in text files have six digits


def plane_normal(points: NDArray) -> NDArray[np.float64] | None:
    """Unit normal of the plane in which points lie.

    The plane is viewed from the positive side of the axis nearest to the normal (of equally near ones z, else
    y): for horizontal planes from above. The plane of a straight line is the one nearest to the horizontal.

    Parameters
    ----------
    points : (n, 3) ndarray of float64

    Returns
    -------
    (3,) ndarray of float64 or None
        None where there is none: a point leaves the plane by more than `PLANARITY_TOLERANCE` of the size.
    """
    size = float(np.abs(points - points[0]).max())
    if size == 0 or (points[:, 2] == points[0, 2]).all():
        return np.array([0.0, 0.0, 1.0])
    centred = (points - points[0]) / size
    centred = centred - centred.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    normal, along = axes[:, 0], axes[:, 2]
    if np.abs(centred - np.outer(centred @ along, along)).max() <= PLANARITY_TOLERANCE:
        start = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        normal = start - (start @ along) * along
        normal = normal / np.linalg.norm(normal)
    if np.abs(centred @ normal).max() > PLANARITY_TOLERANCE:
        return None
    return normal * np.sign(normal[nearest_axis(normal)])


def nearest_axis(normal: NDArray) -> int:
    """Index of the axis nearest to a direction.

    Parameters
    ----------
    normal : (3,) ndarray of float64

    Returns
    -------
    int
        The last of components that are equal up to rounding.
    """
    size = np.abs(normal)
    return int(np.flatnonzero(size >= (1 - PLANARITY_TOLERANCE) * size.max())[-1])
