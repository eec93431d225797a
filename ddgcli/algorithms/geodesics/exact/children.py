"""Children of windows across a face: unfolded into the two neighbouring faces, cut at the apex, and
filtered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.dominance import DOMINANCE_TOLERANCE
from ddgcli.algorithms.geodesics.exact.tables import WindowTables


def children(
    n_left: int,
    lines: NDArray,
    cut: NDArray,
    shape: NDArray,
    corner: NDArray,
    base: NDArray,
    slack: float,
) -> tuple[NDArray, NDArray, NDArray]:
    """Child windows on the two other sides of a face; the first `n_left` leave by (v0, apex).

    Inside, all are seen in a frame that starts at their near vertex, v0 or mirrored v1, and runs along the
    old side. Overwrites its arguments.

    Parameters
    ----------
    n_left : int
    lines : (c, k) ndarray of float64
        Windows in the frames of their sides: b0, b1, x and y of the source, ...
    cut : (k,) ndarray of float64
        Where the line to the apex crosses the side, in the frames of the sides.
    shape : (5, k) ndarray of float64
        Length of the old side, apex, and lengths of both new sides.
    corner : (3, k) ndarray of float64
        Distances of v0, v1 and the apex.
    base : (k,) ndarray of float64
        Distance of the unfolded source.
    slack : float
        By how much the wavefront lets windows exceed a known distance.

    Returns
    -------
    rows : ndarray of int64
        Indices of the windows that pass the filter.
    out, key : ndarrays
        Their columns (b0, b1, sx, sy) in the frame across, and their least distances.
    """
    length, apex_x, apex_y, edge, other_edge = shape
    near, far, x, y = lines[:4]
    d_near, d_other, d_apex = corner
    back = slice(n_left, None)
    edge[back] = other_edge[back]
    for coordinate in (near, far, x, apex_x, cut):
        np.subtract(length[back], coordinate[back], out=coordinate[back])
    near[back], far[back] = far[back], near[back].copy()
    d_near[back], d_other[back] = d_other[back], d_near[back].copy()

    ends = lines[:2]
    cross = apex_x * y
    cross -= apex_y * x
    slope = ends * apex_y
    slope += cross
    fraction = ends * y  # along the side towards the apex, for both ends
    fraction /= np.minimum(slope, -1e-300, out=slope)
    np.minimum(fraction, 1.0, out=fraction)
    np.copyto(fraction[1], 1.0, where=cut <= far)
    u, v = fraction * apex_x, fraction * apex_y
    detour = norm(length - u[0], v[0].copy())
    u -= x
    v -= y
    reach = norm(u, v)
    reach += base
    r0, r1 = reach
    fraction *= edge
    s0, s1 = fraction
    margin = DOMINANCE_TOLERANCE - slack * edge if slack > 0 else DOMINANCE_TOLERANCE
    keep = s1 - s0 > DOMINANCE_TOLERANCE
    keep &= r1 <= d_near + s1 + margin
    keep &= r0 <= d_apex + (edge - s0) + margin
    keep &= r0 <= d_other + detour + margin

    rows = keep.nonzero()[0]
    x *= apex_x
    x += y * apex_y
    x /= edge
    cross /= edge
    inside = (x > s0) & (x < s1)
    key = np.where(inside, base - cross, np.minimum(r0, r1)).take(rows)
    near[:], far[:], y[:] = s0, s1, cross
    np.subtract(edge[back], s1[back], out=near[back])
    np.subtract(edge[back], s0[back], out=far[back])
    np.subtract(edge[back], x[back], out=x[back])
    return rows, lines.take(rows, axis=1), key


def norm(x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Length of plane vectors of order 1, whose squares are safe; overwrites both arguments.

    Parameters
    ----------
    x, y : (k,) ndarray of float64

    Returns
    -------
    (k,) ndarray of float64
    """
    x *= x
    y *= y
    x += y
    return np.sqrt(x, out=x)


def reflect(lines: NDArray, flip: NDArray, length: NDArray) -> None:
    """Mirror some windows in place: x becomes length - x.

    Parameters
    ----------
    lines : (4 or 6, k) ndarray of float64
        Windows: b0, b1, source; perhaps the direction in which the path leaves, and its sense.
    flip : (k,) ndarray of bool
        Which to mirror.
    length : (k,) ndarray of float64
        Of their sides.
    """
    i = np.flatnonzero(flip)
    b0, b1, sx = lines[:3, i]
    lines[:3, i] = length[i] - np.stack([b1, b0, sx])
    if len(lines) > 4:
        lines[4, i] += np.pi * lines[5, i]
        lines[5, i] *= -1.0


def side_turns(tables: WindowTables) -> NDArray[np.float64]:
    """Rotations from the frame of each side to those across (v0, apex) and across (apex, v1).

    Parameters
    ----------
    tables : WindowTables

    Returns
    -------
    (6m,) ndarray of float64
        In radians, two for each side.
    """
    length, x, y = tables.shape[:, :3].T
    return np.stack([np.arctan2(y, x), -np.arctan2(y, length - x)], axis=1).ravel()
