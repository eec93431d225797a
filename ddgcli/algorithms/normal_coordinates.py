"""Normal coordinates: how often each edge of a triangulation crosses the edges of the input, as integers.

An edge that is an input edge has coordinate -1. No geometry enters, so none can break the correspondence.
After Gillespie, Sharp, Crane, "Integer Coordinates for Intrinsic Geometry Processing", 2021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def corner_arcs(opposite: NDArray, left: NDArray, right: NDArray) -> tuple[NDArray, NDArray]:
    """Arcs at the corner of a triangle that faces the side `opposite`.

    Parameters
    ----------
    opposite, left, right : (k,) ndarray of int64
        Coordinates of the three sides, at least zero.

    Returns
    -------
    leaving : (k,) ndarray of int64
        Arcs that end at the corner and cross the opposite side.
    surplus : (k,) ndarray of int64
        left + right - opposite where that is positive: twice the arcs that cut the corner off, and the arcs
        that leave the two other corners.
    """
    difference = opposite - left - right
    return np.maximum(difference, 0), np.maximum(-difference, 0)


def flipped_crossings(ij: NDArray, jk: NDArray, ki: NDArray, il: NDArray, lj: NDArray) -> NDArray[np.int64]:
    """Coordinate of kl after the flip of ij between the faces (i, j, k) and (j, i, l)."""
    along = np.maximum(-ij, 0)
    ij, jk, ki, il, lj = (np.maximum(n, 0) for n in (ij, jk, ki, il, lj))
    leave_k, cut_k = corner_arcs(ij, jk, ki)
    leave_i1, cut_i1 = corner_arcs(jk, ki, ij)
    leave_j1, cut_j1 = corner_arcs(ki, ij, jk)
    leave_l, cut_l = corner_arcs(ij, il, lj)
    leave_i2, cut_i2 = corner_arcs(lj, ij, il)
    leave_j2, cut_j2 = corner_arcs(il, lj, ij)
    cut_k, cut_i1, cut_j1 = (
        (cut_k - leave_i1 - leave_j1) // 2,
        (cut_i1 - leave_j1 - leave_k) // 2,
        (cut_j1 - leave_k - leave_i1) // 2,
    )
    cut_l, cut_i2, cut_j2 = (
        (cut_l - leave_i2 - leave_j2) // 2,
        (cut_i2 - leave_j2 - leave_l) // 2,
        (cut_j2 - leave_l - leave_i2) // 2,
    )
    twice = (
        2 * (cut_l + cut_k)
        + np.abs(cut_j2 - cut_j1)
        + np.abs(cut_i2 - cut_i1)
        - leave_l
        - leave_k
        + 2 * (leave_i1 + leave_i2 + leave_j1 + leave_j2)
    )
    return twice // 2 + along


@dataclass(frozen=True, eq=False)
class Crossings:
    """Every crossing of a triangulation's edges with the edges of a base triangulation, seen from each side.

    A crossing of an edge is two half-crossings, one on each of its sides, numbered along the sides in order.
    An arc is the part of a base edge inside a face; from a half-crossing it leads into the side's own face.

    Parameters
    ----------
    count, start : (3m,) ndarray of int64
        Half-crossings on a side and the number of its first.
    side, place : (c,) ndarray of int64
        Side of a half-crossing and its place from the side's tail.
    across : (c,) ndarray of int64
        The same crossing on the twin side.
    cut : (m, 3) ndarray of int64
        Arcs that cut off corner k.
    leaving : (m, 3) ndarray of int64
        Arcs that end at corner k.
    """

    count: NDArray[np.int64]
    start: NDArray[np.int64]
    side: NDArray[np.int64]
    place: NDArray[np.int64]
    across: NDArray[np.int64]
    cut: NDArray[np.int64]
    leaving: NDArray[np.int64]


def crossings_of(coordinate: NDArray, side_twin: NDArray) -> Crossings:
    """Half-crossings and arcs of normal coordinates (m, 3) on a gluing (m, 3)."""
    count = np.maximum(coordinate, 0)
    flat = count.ravel()
    start = np.cumsum(flat) - flat
    side = np.repeat(np.arange(len(flat)), flat)
    place = np.arange(len(side)) - start[side]
    other = side_twin.ravel()[side]
    across = start[other] + flat[side] - 1 - place
    leaving, surplus = corner_arcs(count[:, [1, 2, 0]], count, count[:, [2, 0, 1]])
    cut = (surplus - leaving[:, [1, 2, 0]] - leaving[:, [2, 0, 1]]) // 2
    return Crossings(flat, start, side, place, across, np.maximum(cut, 0), leaving)


def arc_partner(c: Crossings) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the arc of each half-crossing leads inside its face.

    Returns
    -------
    partner : (c,) ndarray of int64
        The half-crossing at its other end, -1 where it ends at a corner.
    corner : (c,) ndarray of int64
        The flat number of that corner, -1 elsewhere.
    """
    face, j = c.side // 3, c.side % 3
    after, before = 3 * face + (j + 1) % 3, 3 * face + (j + 2) % 3
    from_head = c.count[c.side] - 1 - c.place
    near_tail = c.place < c.cut.ravel()[c.side]
    near_head = from_head < c.cut.ravel()[after]
    partner = np.where(near_tail, c.start[before] + c.count[before] - 1 - c.place, c.start[after] + from_head)
    ends = ~(near_tail | near_head)
    return np.where(ends, -1, partner), np.where(ends, before, -1)


def base_edge_ends(c: Crossings, tail: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The vertex where the base edge of each half-crossing ends, followed into the side's face.

    Parameters
    ----------
    c : Crossings
    tail : (3m,) ndarray of int64
        Vertex at each corner.

    Returns
    -------
    end : (c,) ndarray of int64
        Vertex.
    steps : (c,) ndarray of int64
        Crossings passed on the way.

    Notes
    -----
    By pointer doubling: as many passes as the logarithm of the longest chain.
    """
    partner, corner = arc_partner(c)
    here = np.arange(len(partner))
    onward = np.where(partner < 0, here, c.across[partner]) if len(here) else here
    steps = (partner >= 0).astype(np.int64)
    open_ = np.flatnonzero(partner >= 0)
    while len(open_):
        jump = onward[open_]
        ahead, further = onward[jump], steps[jump]
        steps[open_] += further
        onward[open_] = ahead
        open_ = open_[ahead != jump]
    return tail[corner[onward]], steps
