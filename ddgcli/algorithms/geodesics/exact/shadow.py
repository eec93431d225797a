"""Shadows: the directions in which a shortest path may leave a vertex.

A path through a vertex is shortest only if the angles on both sides are at least pi (at a boundary: the one
angle that exists). Only the shadow of the incoming direction therefore needs windows; straight lines past the
vertex reach everything outside it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import PREVIOUS, Topology

MARGIN = 1e-4  # radians by which a shadow is widened, because directions have rounding errors


def corner_turns(topology: Topology, angle: NDArray, vertices: NDArray) -> tuple[NDArray, NDArray]:
    """Angles around vertices, counter-clockwise from one corner of each, or from the boundary.

    Parameters
    ----------
    topology : Topology
        Oriented, no edge with three faces.
    angle : (m, 3) ndarray of float64
        Angles of the corners.
    vertices : ndarray of int64
        At a vertex with several fans only one fan gets angles.

    Returns
    -------
    turn : (m, 3) ndarray of float64
        Angle at which corner k begins; nan at other vertices and in other fans.
    total : (n,) ndarray of float64
        Angle of the fan; inf where it is open.
    """
    turn = np.full(topology.faces.size, np.nan)
    total = np.full(topology.n_vertices, np.inf)
    following = topology.side_twin[:, PREVIOUS].ravel()  # the next corner of the same vertex
    angle = angle.ravel()
    first = np.empty(topology.n_vertices, dtype=np.int64)
    first[topology.faces.ravel()] = np.arange(len(turn))
    start = np.flatnonzero(topology.side_twin.ravel() < 0)
    first[topology.faces.ravel()[start]] = start
    vertex, here = vertices, first[vertices]
    end, sum_so_far = here, np.zeros(len(here))
    while len(here):
        turn[here] = sum_so_far
        sum_so_far = sum_so_far + angle.take(here)
        here = following.take(here)
        closed = here == end
        total[vertex[closed]] = sum_so_far[closed]
        on = (~closed & (here >= 0)).nonzero()[0]
        if len(on) < len(here):
            vertex, here, end, sum_so_far = vertex[on], here[on], end[on], sum_so_far[on]
    return turn.reshape(-1, 3), total


def shadow_of(
    turn: NDArray, angle: NDArray, total: NDArray, incoming: NDArray, margin: float = MARGIN
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Interval [begin, end] of each corner inside the shadow, in radians from the begin of the corner.

    Parameters
    ----------
    turn, angle : (k,) ndarrays
        Begin and width of the corners; turn nan: the whole corner.
    total, incoming : (k,) ndarrays
        Angle of each corner's fan (inf: open), and direction back along the path (nan: the whole corner).
    margin : float
        Radians by which the shadow is widened on both sides.

    Returns
    -------
    begin, end : (k,) ndarray of float64
        Empty where end <= begin.
    """
    after = turn - incoming
    after = np.where((after < 0) & (total < np.inf), after + total, after)
    before = after < 0  # beside a boundary: the corner comes before the path
    begin = np.where(before, 0.0, np.pi - margin - after)
    end = np.where(before, margin - np.pi, total + (margin - np.pi)) - after
    return np.fmax(begin, 0.0), np.fmin(end, angle)
