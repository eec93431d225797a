"""Trim windows on the same side to the intervals where each gives the smaller distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# of the longest side of the component (in [1/2, 1) here); windows are kept within it
DOMINANCE_TOLERANCE = 1e-12
TIE_TOLERANCE = 1e-13  # of the distance: windows along one line from vertices on it differ by rounding


def dominate(
    lines: NDArray, where: NDArray, shape: NDArray, origin_distance: NDArray
) -> tuple[NDArray, NDArray]:
    """Sort windows by side, and trim neighbours to the intervals where each gives the smaller distance.

    Only parts where another window of the batch is at least as near are cut, so no distance changes by more
    than a tie (TIE_TOLERANCE).

    Parameters
    ----------
    lines : (c, k) ndarray of float64
        Windows: b0, b1, source, ...
    where : (2 or 3, k) ndarray of int64
        Side of each window, its origin vertex, and optionally the number of faces that it has
        crossed.
    shape : ndarray of float64
        `SideTables.shape`.
    origin_distance : (n,) ndarray of float64

    Returns
    -------
    lines, where : ndarray
        The windows that are left, sorted by side.

    Notes
    -----
    On a side, the difference of two windows' distances has at most one interior extremum, where the line
    through the two sources meets the side; hence at most two roots, found by bracketing (the closed
    quadratic cancels when the sources nearly coincide).
    """
    order = _by_side(where[0], lines[0], shape)
    lines, where = lines.take(order, axis=1), where.take(order, axis=1)
    side = where[0]
    overlapping = ((side[1:] == side[:-1]) & (lines[0, 1:] < lines[1, :-1])).nonzero()[0]
    if not len(overlapping):
        return lines, where
    _trim(lines, overlapping, origin_distance.take(where[1]))
    nonempty = (lines[1] - lines[0] > DOMINANCE_TOLERANCE).nonzero()[0]
    if len(nonempty) == len(side):
        return lines, where
    return lines.take(nonempty, axis=1), where.take(nonempty, axis=1)


def _by_side(side: NDArray, b0: NDArray, shape: NDArray) -> NDArray[np.int64]:
    """Order of windows by side, then by their begin.

    One key for both is fastest, but beside the index of a side it keeps a begin to 1e-10 of the side only.
    Trimming windows in a wrong order leaves gaps of that size, through which the line to a vertex may pass.
    """
    order = np.argsort(side + 0.9999999 * b0 / shape[side, 0])
    sorted_side, sorted_b0 = side.take(order), b0.take(order)
    wrong = (sorted_side[1:] == sorted_side[:-1]) & (sorted_b0[1:] < sorted_b0[:-1])
    return np.lexsort((b0, side)) if wrong.any() else order


def _trim(lines: NDArray, i: NDArray, base: NDArray) -> None:
    """Trim windows i and i + 1, which overlap, in place; `base` are the distances of the windows' origins."""
    p, q = lines.take(i, axis=1), lines.take(i + 1, axis=1)
    base_p, base_q = base.take(i), base.take(i + 1)
    px, py, qx, qy = p[2], p[3], q[2], q[3]
    contained = q[1] <= p[1]
    at = np.empty((3, len(i)))  # both ends of the overlap, and where the difference has its extremum
    lo, hi, middle = at
    lo[:] = q[0]
    np.minimum(p[1], q[1], out=hi)
    np.divide((qx - px) * py, py - qy, out=middle)
    middle += px
    np.fmin(np.fmax(middle, lo, out=middle), hi, out=middle)
    g_lo, g_hi, g_mid = _gap(at, (base_p, px, py), (base_q, qx, qy))
    tie = TIE_TOLERANCE * (1 + np.maximum(base_p, base_q))
    p_wins = (g_lo <= tie) & (g_hi <= tie) & (g_mid <= tie)
    q_wins = (g_lo > 0) & (g_hi > 0) & (g_mid > 0) & ~contained & ~p_wins
    p_first = (g_lo < 0) & (g_hi > 0) & ~p_wins  # of a tie, only one window is cut
    q_first = contained & (g_lo > 0) & (g_hi < 0)
    root = np.flatnonzero(p_first | q_first)
    if len(root):
        a, b = lo[root], hi[root]
        lo_r, hi_r = _bracket(
            a,
            b,
            g_lo[root],
            g_hi[root],
            (base_p[root], px[root], py[root]),
            (base_q[root], qx[root], qy[root]),
        )
        forward = p_first[root]
        lines[0, i[root[forward]] + 1] = lo_r[forward]
        cut_p = forward & ~contained[root]
        lines[1, i[root[cut_p]]] = hi_r[cut_p]
        lines[1, i[root[~forward]] + 1] = hi_r[~forward]
    lines[0, i[p_wins] + 1] = hi[p_wins]
    lines[1, i[q_wins]] = lo[q_wins]


def reaching(at: NDArray, lines: NDArray, dx: NDArray, dy: NDArray) -> NDArray[np.bool_]:
    """True where the lines to points of the faces of windows pass through the windows.

    Parameters
    ----------
    at : (k,) ndarray of float64
        Where the lines cross the sides.
    lines : (4, k) ndarray of float64
        b0, b1, ... of the windows.
    dx, dy : (k,) ndarrays of float64
        The lines, from the unfolded sources to the points.

    Returns
    -------
    (k,) ndarray of bool

    Notes
    -----
    A line through a vertex lies on the common end of two windows, and rounding opens a gap between them:
    as wide as the rounding of the unfolded source, which grows with the length of the line, and wider by the
    inverse of the sine of the angle at which the line crosses the side. So the tolerance is measured across
    the line: a line that passes the vertex on the wrong side is too short by no more than that.
    """
    length = np.abs(dx)
    length += dy
    tolerance = length + 1.0
    tolerance *= length
    tolerance *= DOMINANCE_TOLERANCE
    tolerance /= dy
    return (at >= lines[0] - tolerance) & (at <= lines[1] + tolerance)


def _gap(x: NDArray, p: tuple, q: tuple) -> NDArray[np.float64]:
    """Distance at x by window p less that by q, each (distance of the origin, sx, sy)."""
    gap = _length(x - p[1], p[2])
    gap -= _length(x - q[1], q[2])
    gap += p[0] - q[0]
    return gap


def _length(x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Length of (x, y) for one or several rows of x; overwrites x."""
    x *= x
    x += y * y
    return np.sqrt(x, out=x)


def _bracket(lo: NDArray, hi: NDArray, g_lo: NDArray, g_hi: NDArray, p: tuple, q: tuple) -> tuple:
    """Shrink [lo, hi] around the sign change of p - q: two steps of regula falsi, the second overshooting."""

    rising = g_lo < 0
    for step in (1.0, 2.0):
        slope = (g_hi - g_lo) / (hi - lo)
        if step == 1.0:
            x = lo - g_lo / slope
        else:
            nearest = np.where(np.abs(g_lo) < np.abs(g_hi), lo, hi)
            g_near = np.where(np.abs(g_lo) < np.abs(g_hi), g_lo, g_hi)
            x = nearest - 2 * g_near / slope
        x = np.where((x > lo) & (x < hi), x, 0.5 * (lo + hi))
        g = _gap(x, p, q)
        low = np.where(rising, g <= 0, g > 0)
        lo, hi = np.where(low, x, lo), np.where(low, hi, x)
        g_lo, g_hi = np.where(low, g, g_lo), np.where(low, g_hi, g)
    return lo, hi
