"""Solids: signed distances to half-spaces, balls, boxes and cylinders; winding numbers of surfaces."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_cross, row_dot, unit_vectors, vector_length

WINDING_CHUNK = 4_000_000  # pairs of points and faces at a time


class Surface(Protocol):
    """A solid with a signed distance, negative inside."""

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Distances (n,) of points and their gradients (n, 3)."""
        ...

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3, 3) second derivatives of the distances of points outside."""
        ...

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        """Fraction of each move at which the distance is zero, inf where it never is."""
        ...


class PlaneGap:
    """Half-space below a plane, on the side opposite to its normal."""

    def __init__(self, point: Any, normal: Any) -> None:
        self.point = np.array(point, dtype=float)
        self.normal = np.array(normal, dtype=float) / np.linalg.norm(normal)

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        return (x - self.point) @ self.normal, np.broadcast_to(self.normal, x.shape)

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        return np.zeros((len(x), 3, 3))

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        d, speed = (x - self.point) @ self.normal, move @ self.normal
        return np.where(speed < 0, d / np.where(speed < 0, -speed, 1.0), np.inf)


class SphereGap:
    """A ball."""

    def __init__(self, center: Any, radius: float) -> None:
        self.center, self.radius = np.array(center, dtype=float), radius

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        away = x - self.center
        distance = vector_length(away)
        return distance - self.radius, unit_vectors(away)

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        away = x - self.center
        distance = vector_length(away)
        return (np.eye(3) - _outer(away / distance[:, None])) / distance[:, None, None]

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        return _first(*_ball_interval(x - self.center, move, self.radius))


class BoxGap:
    """A closed box with its edges along the axes."""

    def __init__(self, corner: Any, size: Any) -> None:
        self.half = 0.5 * np.array(size, dtype=float)
        self.center = np.array(corner, dtype=float) + self.half

    def _beyond(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Distances beyond the faces (n, 3), negative inside, and the signs of the sides (n, 3)."""
        away = x - self.center
        return np.abs(away) - self.half, np.where(away < 0, -1.0, 1.0)

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        beyond, sign = self._beyond(x)
        outer = np.maximum(beyond, 0.0)
        distance = vector_length(outer)
        inside = distance == 0
        nearest = np.eye(3)[np.argmax(beyond, axis=1)]
        gradient = np.where(inside[:, None], nearest, outer / np.where(inside, 1.0, distance)[:, None])
        return np.where(inside, beyond.max(axis=1), distance), sign * gradient

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        beyond, _ = self._beyond(x)
        distance, gradient = self.gap(x)
        active = (beyond > 0).astype(float)
        return (active[:, :, None] * np.eye(3) - _outer(gradient)) / distance[:, None, None]

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        away = x - self.center
        entries, exits = zip(*(_slab_interval(away[:, k], move[:, k], self.half[k]) for k in range(3)))
        return _first(np.max(entries, axis=0), np.min(exits, axis=0))


class CylinderGap:
    """A solid cylinder with flat ends."""

    def __init__(self, start: Any, end: Any, radius: float) -> None:
        start, end = np.array(start, dtype=float), np.array(end, dtype=float)
        self.center, self.radius = 0.5 * (start + end), radius
        length = float(np.linalg.norm(end - start))
        self.axis, self.half = (end - start) / length, 0.5 * length

    def _split(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Height above the middle (n,), distance from the axis (n,) and unit vectors away from it (n, 3)."""
        away = x - self.center
        height = away @ self.axis
        radial = away - height[:, None] * self.axis
        distance = vector_length(radial)
        return height, distance, radial / np.where(distance > 0, distance, 1.0)[:, None]

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        height, distance, outward = self._split(x)
        side, end = distance - self.radius, np.abs(height) - self.half
        up = np.where(height < 0, -1.0, 1.0)[:, None] * self.axis
        outer = np.hypot(np.maximum(side, 0.0), np.maximum(end, 0.0))
        inside = outer == 0
        safe = np.where(inside, 1.0, outer)
        a = np.where(inside, side >= end, np.maximum(side, 0.0) / safe)
        b = np.where(inside, side < end, np.maximum(end, 0.0) / safe)
        return np.where(inside, np.maximum(side, end), outer), a[:, None] * outward + b[:, None] * up

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        height, distance, outward = self._split(x)
        d, gradient = self.gap(x)
        side, end = distance - self.radius, np.abs(height) - self.half
        axial = np.broadcast_to(self.axis, x.shape)
        active = (side > 0)[:, None, None] * _outer(outward) + (end > 0)[:, None, None] * _outer(axial)
        around = np.eye(3) - _outer(outward) - _outer(axial)
        bent = np.maximum(side, 0.0) / (d * np.where(distance > 0, distance, 1.0))
        return (active - _outer(gradient)) / d[:, None, None] + bent[:, None, None] * around

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        away = x - self.center
        height, rise = away @ self.axis, move @ self.axis
        around = away - height[:, None] * self.axis, move - rise[:, None] * self.axis
        entry, leave = _ball_interval(*around, self.radius)
        low, high = _slab_interval(height, rise, self.half)
        return _first(np.maximum(entry, low), np.minimum(leave, high))


def _outer(v: NDArray) -> NDArray[np.float64]:
    return v[:, :, None] * v[:, None, :]


def _first(entry: NDArray, leave: NDArray) -> NDArray[np.float64]:
    """The entry into what several intervals share, inf where they share nothing ahead."""
    return np.where((entry <= leave) & (leave >= 0), np.maximum(entry, 0.0), np.inf)


def _slab_interval(x: NDArray, move: NDArray, half: float) -> tuple[NDArray, NDArray]:
    """Fractions of a move in which |x + t move| <= half: (entry, leave), empty as (inf, -inf)."""
    still = move == 0
    safe = np.where(still, 1.0, move)
    a, b = (-half - x) / safe, (half - x) / safe
    within = np.abs(x) <= half
    entry = np.where(still, np.where(within, -np.inf, np.inf), np.minimum(a, b))
    leave = np.where(still, np.where(within, np.inf, -np.inf), np.maximum(a, b))
    return entry, leave


def _ball_interval(x: NDArray, move: NDArray, radius: float) -> tuple[NDArray, NDArray]:
    """Fractions of a move in which |x + t move| <= radius: (entry, leave), empty as (inf, -inf)."""
    a = row_dot(move, move)
    b = row_dot(x, move)
    c = row_dot(x, x) - radius**2
    root = b * b - a * c
    hits, still = (root >= 0) & (a > 0), a == 0
    root = np.sqrt(np.where(hits, root, 0.0))
    # c / (root - b) is the entry without cancellation where the ball lies ahead
    ahead = hits & (b < 0)
    entry = np.where(ahead, c / np.where(ahead, root - b, 1.0), (-b - root) / np.where(hits, a, 1.0))
    leave = (-b + root) / np.where(hits, a, 1.0)
    entry = np.where(hits, entry, np.where(still & (c <= 0), -np.inf, np.inf))
    return entry, np.where(hits, leave, np.where(still & (c <= 0), np.inf, -np.inf))


def winding_number(triangles: NDArray, points: NDArray) -> NDArray[np.float64]:
    """Winding number of triangles about points.

    Parameters
    ----------
    triangles : (m, 3, 3) ndarray of float64
        Corners.
    points : (k, 3) ndarray of float64

    Returns
    -------
    (k,) ndarray of float64
        1 inside a closed surface with outward orientation, 0 outside.

    References
    ----------
    A. van Oosterom and J. Strackee, "The solid angle of a plane triangle", 1983.
    """
    total = np.zeros(len(points))
    rows = max(1, WINDING_CHUNK // max(len(triangles), 1))
    for first in range(0, len(points), rows):
        a, b, c = (triangles[None, :, k] - points[first : first + rows, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        volume = row_dot(a, row_cross(b, c))
        dots = la * lb * lc + row_dot(a, b) * lc + row_dot(b, c) * la + row_dot(c, a) * lb
        total[first : first + rows] = np.arctan2(volume, dots).sum(axis=1) / (2.0 * np.pi)
    return total
