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
    side : (c,) ndarray of int64
        Side of a half-crossing.
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
    across: NDArray[np.int64]
    cut: NDArray[np.int64]
    leaving: NDArray[np.int64]


def crossings_of(coordinate: NDArray, side_twin: NDArray) -> Crossings:
    """Half-crossings and arcs of normal coordinates (m, 3) on a gluing (m, 3)."""
    count = np.maximum(coordinate, 0)
    flat = count.ravel()
    start = np.cumsum(flat) - flat
    side = np.repeat(np.arange(len(flat)), flat)
    # what a half-crossing and its other half add up to is the same all along a side
    across = np.repeat(start + start[side_twin.ravel()] + flat - 1, flat)
    across -= np.arange(len(across))
    leaving, surplus = corner_arcs(count[:, [1, 2, 0]], count, count[:, [2, 0, 1]])
    cut = (surplus - leaving[:, [1, 2, 0]] - leaving[:, [2, 0, 1]]) // 2
    return Crossings(flat, start, side, across, np.maximum(cut, 0), leaving)


def arc_partner(c: Crossings) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the arc of each half-crossing leads inside its face.

    Returns
    -------
    partner : (c,) ndarray of int64
        The half-crossing at its other end, -1 where it ends at a corner.
    corner : (e,) ndarray of int64
        The flat number of that corner, for the half-crossings whose arcs end at one, in their order.
    """
    m = len(c.cut)
    after, before = np.array([1, 2, 0]), np.array([2, 0, 1])
    start, count = c.start.reshape(m, 3), c.count.reshape(m, 3)
    # along a side: arcs that cut off its tail, that end at the corner opposite, that cut off its head
    parts = np.stack([c.cut, c.leaving[:, before], c.cut[:, after]], axis=2)
    total = np.zeros((m, 3, 3), dtype=np.int64)  # of the two halves' numbers
    total[..., 0] = start + start[:, before] + count[:, before] - 1
    total[..., 2] = start + count - 1 + start[:, after]
    partner = np.repeat(total.ravel(), parts.ravel())
    partner -= np.arange(len(partner))
    partner[np.repeat(np.tile([False, True, False], 3 * m), parts.ravel())] = -1
    opposite = (3 * np.arange(m)[:, None] + before).ravel()
    return partner, np.repeat(opposite, parts[..., 1].ravel())


@dataclass(frozen=True, eq=False)
class BaseEdges:
    """The base edges that are crossed, each twice: as the chain of its crossings from either end.

    Parameters
    ----------
    tail, head : (k,) ndarray of int64
        Vertices that a chain runs to and from: half-crossings look back to `head`.
    reverse : (k,) ndarray of int64
        The chain of the same edge from the other end.
    chain, step : (c,) ndarray of int64
        The chain whose head the base edge of a half-crossing ends at when it is followed into the side's
        face, and the crossings passed on the way.
    """

    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    reverse: NDArray[np.int64]
    chain: NDArray[np.int64]
    step: NDArray[np.int64]


def base_edges_of(c: Crossings, tail: NDArray) -> BaseEdges:
    """Follow the base edges from all of their ends at once, a crossing at a time.

    Parameters
    ----------
    c : Crossings
    tail : (3m,) ndarray of int64
        Vertex at each corner.
    """
    partner, corner = arc_partner(c)
    onward = partner[c.across]
    here = np.flatnonzero(partner < 0)
    head = tail[corner]
    name = np.arange(len(here))
    chain, step = np.empty_like(partner), np.empty_like(partner)
    last = here.copy()
    passed = 0
    while len(here):
        chain[here], step[here] = name, passed
        after = onward[here]
        going = after >= 0
        ended = ~going
        last[name[ended]] = here[ended]
        here, name, passed = after[going], name[going], passed + 1
    reverse = chain[c.across[last]]
    return BaseEdges(head[reverse], head, reverse, chain, step)
