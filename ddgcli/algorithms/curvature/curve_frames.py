"""Frenet and Bishop frames, osculating circles and arc length of polylines; resampling by arc length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.vectors import ratio, row_cross, row_dot, unit_vectors, vector_length

MAX_SAMPLES = 10_000_000


def curve_frames(curves: CurveSet) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Frames and osculating circles of each polyline of a set.

    Parameters
    ----------
    curves : CurveSet
        Without points that repeat their predecessor.

    Returns
    -------
    arrays : dict
        On points: `arc_length` (n,) from the start of the curve; `frenet_tangent` (n, 3), the mean of the
        directions of the two segments (at an end of an open curve its one segment), `frenet_normal`, the
        direction of the curvature vector, `frenet_binormal`, their cross product (both zero where the curve
        does not turn); `bishop_1`, `bishop_2` (n, 3), a frame normal to `frenet_tangent` that does not turn
        about it: parallel transport along the curve; `osculating_radius` (n,) and `osculating_centre` (n, 3),
        the circle through a point and its neighbours (radius inf and the point itself where they lie on a
        line, and at ends). Zero at points of no curve.
    results : dict
        `bishop_holonomy`: angle in radians by which the Bishop frame of each closed curve returns turned,
        from
        -pi to pi; None for open curves.

    Raises
    ------
    MeshError
        Where successive points coincide, or the curve turns back on itself (a frame has no transport there).
    """
    n = curves.n_vertices
    arrays: dict[str, NDArray] = {name: np.zeros((n, 3)) for name in FRAME_VECTORS}
    arrays |= {name: np.zeros(n) for name in FRAME_SCALARS}
    holonomy: list[float | None] = []
    for path, closed in curves.paths:
        own, turned = _frenet_and_bishop(curves.points[path], closed, path)
        for name, values in own.items():
            arrays[name][path] = values
        holonomy.append(turned)
    return arrays, {"bishop_holonomy": holonomy}


FRAME_VECTORS = (
    "frenet_tangent", "frenet_normal", "frenet_binormal", "bishop_1", "bishop_2", "osculating_centre",
)  # fmt: skip
FRAME_SCALARS = ("arc_length", "osculating_radius")


def check_frames(curves: CurveSet) -> None:
    """Raise the errors of `curve_frames`, without computing.

    Parameters
    ----------
    curves : CurveSet
    """
    for path, closed in curves.paths:
        _segment_directions(curves.points[path], closed, path)


def _segment_directions(
    points: NDArray, closed: bool, path: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Lengths and directions of segments, and (n, 3) directions before and after each point of a polyline."""
    segment = np.roll(points, -1, axis=0) - points if closed else np.diff(points, axis=0)
    length = vector_length(segment)
    if not (length > 0).all():
        bad = int(np.argmin(length > 0))
        raise MeshError(
            f"points {path[bad]} and {path[(bad + 1) % len(path)]} coincide: the segment between them has no "
            "direction; remove one of them"
        )
    direction = segment / length[:, None]
    before = np.roll(direction, 1, axis=0) if closed else np.concatenate([direction[:1], direction])
    after = direction if closed else np.concatenate([direction, direction[-1:]])
    if (row_dot(before, after) <= -1 + 1e-12).any():
        bad = int(np.argmin(row_dot(before, after)))
        raise MeshError(
            f"the curve turns back at point {path[bad]}, where frames have no transport; remove it"
        )
    return length, direction, before, after


def _frenet_and_bishop(
    points: NDArray, closed: bool, path: NDArray
) -> tuple[dict[str, NDArray], float | None]:
    """Arrays of one polyline, and the holonomy of its Bishop frame."""
    length, direction, before, after = _segment_directions(points, closed, path)
    tangent = unit_vectors(before + after)
    turn = after - before
    normal = unit_vectors(np.where(vector_length(turn)[:, None] > 1e-14, turn, 0.0))
    radius, centre = _osculating(points, closed)
    along, holonomy = _bishop(direction, closed)
    # the frame of a point: that of the segment before it, turned half of the way
    one = along[:-1] if closed else np.concatenate([along[:1], along])
    one = _half_turned(before, tangent, one)
    arrays = {
        "arc_length": np.concatenate([[0.0], np.cumsum(length)])[: len(points)],
        "frenet_tangent": tangent, "frenet_normal": normal, "frenet_binormal": row_cross(tangent, normal),
        "bishop_1": one, "bishop_2": row_cross(tangent, one),
        "osculating_radius": radius, "osculating_centre": centre,
    }  # fmt: skip
    return arrays, holonomy


def _half_turned(start: NDArray, end: NDArray, vector: NDArray) -> NDArray[np.float64]:
    """Vectors normal to `start` moved by the smallest rotation that takes `start` to `end`."""
    total = start + end
    return vector - (row_dot(vector, total) / (1.0 + row_dot(start, end)))[:, None] * total


def _bishop(direction: NDArray, closed: bool) -> tuple[NDArray[np.float64], float | None]:
    """Parallel unit normals of segments, and the holonomy of a closed curve.

    For a closed curve there is one more row: the frame before the first segment is the first row, that of the
    segment k is row k + 1; the last row is the transported frame of the last segment.
    """
    # any normals, and by cumulative sums of their connection the angle of the parallel ones against them
    axis = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    free = unit_vectors(row_cross(direction, axis))
    other = row_cross(direction, free)
    chain = np.concatenate([direction, direction[:1]]) if closed else direction
    free_chain = np.concatenate([free, free[:1]]) if closed else free
    other_chain = np.concatenate([other, other[:1]]) if closed else other
    moved = _half_turned(chain[:-1], chain[1:], free_chain[:-1])
    step = np.arctan2(row_dot(moved, other_chain[1:]), row_dot(moved, free_chain[1:]))
    angle = np.concatenate([[0.0], np.cumsum(step)])[:, None]
    parallel = np.cos(angle) * free_chain + np.sin(angle) * other_chain
    if not closed:
        return parallel, None
    holonomy = float(np.remainder(angle[-1, 0] + np.pi, 2 * np.pi) - np.pi)
    # begin at the first point, in the segment before it: transported back from the first segment
    first = _half_turned(direction[:1], direction[-1:], parallel[:1])
    return np.concatenate([first, parallel[:-1]]), holonomy


def _osculating(points: NDArray, closed: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Radius and centre of the circle through each point and its neighbours."""
    back, ahead = np.roll(points, 1, axis=0) - points, np.roll(points, -1, axis=0) - points
    normal = row_cross(back, ahead)
    doubled = vector_length(normal)
    a, b = vector_length(back), vector_length(ahead)
    curved = doubled > 1e-14 * a * b
    if not closed:
        curved[[0, -1]] = False
    chord = vector_length(ahead - back)
    radius = np.where(curved, ratio(a * b * chord, 2.0 * doubled), np.inf)
    offset = row_cross((a**2)[:, None] * ahead - (b**2)[:, None] * back, normal)
    offset = offset * ratio(0.5, doubled**2)[:, None]
    return radius, points + np.where(curved[:, None], offset, 0.0)


def resampled(curves: CurveSet, count: int) -> CurveSet:
    """Polylines with `count` points each, evenly spaced by arc length along the given ones.

    Parameters
    ----------
    curves : CurveSet
    count : int
        Points of each curve; 3 or more, of open ones with both ends.

    Returns
    -------
    CurveSet
        With the point array `arc_length` on the given curve. The points lie on the given polyline; the
        ends of open curves and the first points of closed ones are kept.

    Raises
    ------
    ParameterError
        On fewer than 3 points.
    MeshError
        When a curve has no length.
    """
    if not 3 <= count <= MAX_SAMPLES:
        raise ParameterError(f"needs 3 to {MAX_SAMPLES:,} points, not {count}", parameter="count")
    paths, lines, reaches = [], [], []
    for number, (path, closed) in enumerate(curves.paths):
        points = curves.points[path]
        chain = np.concatenate([points, points[:1]]) if closed else points
        reach = np.concatenate([[0.0], np.cumsum(vector_length(np.diff(chain, axis=0)))])
        if not reach[-1] > 0:
            raise MeshError(f"curve {number} (first point {path[0]}) has no length; remove it")
        at = reach[-1] * np.arange(count) / (count if closed else count - 1)
        paths.append(np.stack([np.interp(at, reach, chain[:, axis]) for axis in range(3)], axis=1))
        reaches.append(at)
        own = number * count + np.arange(count)
        lines.append(np.stack([own, np.roll(own, -1)], axis=1)[: count if closed else -1])
    if not paths:
        raise MeshError("no segments; resampling needs a curve")
    return CurveSet(np.concatenate(paths), np.concatenate(lines), {"arc_length": np.concatenate(reaches)})
