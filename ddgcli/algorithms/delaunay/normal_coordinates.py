"""Normal coordinates: the number of crossings of each edge of a triangulation with edges of the input.

An edge of the input has coordinate -1. The coordinates are integers without geometry, so that rounding cannot
break the correspondence.
After Gillespie, Sharp, Crane, "Integer Coordinates for Intrinsic Geometry Processing", 2021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import repeat_with_place
from ddgcli.mesh.sides import next_side, previous_side

STEP_BITS = 32  # bits of the step in a label of a crossing
STEP_MASK = (1 << STEP_BITS) - 1
BLOCK_SIZE = 1 << 16  # crossings looked at together, so that temporaries stay in cache


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
    """Normal coordinate of edge kl after the flip of ij between the faces (i, j, k) and (j, i, l).

    Parameters
    ----------
    ij, jk, ki, il, lj : (k,) ndarray of int64
        Normal coordinates of the five edges.

    Returns
    -------
    (k,) ndarray of int64

    References
    ----------
    GillespieSharpCrane2021 in docs/references.bib.
    """
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
    """Crossings of a triangulation's edges with those of a base triangulation, on both sides of each edge.

    Crossings are numbered along the edges, in the order of their first sides. Crossing x is two
    half-crossings: 2x on the first side of the edge, 2x+1 on the other. An arc is the part of a base edge
    inside a face; from a half-crossing it leads into the side's own face. Along a side come the arcs that cut
    off its tail, those that leave the corner opposite, those that cut off its head.

    Parameters
    ----------
    count : (3m,) ndarray of int64
        Crossings of a side.
    first : (3m,) ndarray of int64
        The half-crossing of a side that is nearest its tail; undefined on sides without crossings.
    cut, leaving : (3m,) ndarray of int64
        Arcs that cut off a corner, and that end at it.
    side : (k,) ndarray of int64
        The first sides of the edges that are crossed.
    """

    count: NDArray[np.int64]
    first: NDArray[np.int64]
    cut: NDArray[np.int64]
    leaving: NDArray[np.int64]
    side: NDArray[np.int64]

    @property
    def total(self) -> int:
        """Number of half-crossings."""
        return 2 * int(self.count[self.side].sum())

    def at(self, side: NDArray, place: NDArray | int) -> NDArray[np.int64]:
        """The half-crossings at places along sides, counted from the tail."""
        return ahead(self.first[side], place)

    def last(self, side: NDArray) -> NDArray[np.int64]:
        """The half-crossings of sides that are nearest the head."""
        return self.at(side, self.count[side] - 1)


def ahead(half: NDArray, places: NDArray | int) -> NDArray[np.int64]:
    """Half-crossings a number of places nearer the head of the same side.

    Parameters
    ----------
    half : (k,) ndarray of int64
    places : (k,) ndarray of int64 or int

    Returns
    -------
    (k,) ndarray of int64
    """
    return half + places * (2 - 4 * (half & 1))


def crossings_of(coordinate: NDArray, side_twin: NDArray) -> Crossings:
    """Half-crossings and arcs of normal coordinates.

    Parameters
    ----------
    coordinate : (m, 3) ndarray of int64
        Normal coordinate of each side.
    side_twin : (m, 3) ndarray of int64
        Gluing of the sides.

    Returns
    -------
    Crossings
    """
    count, twin = np.maximum(coordinate, 0), side_twin.ravel()
    flat = count.ravel()
    side = np.flatnonzero((flat > 0) & (np.arange(len(flat)) < twin))
    first, end = np.zeros_like(flat), 2 * np.cumsum(flat[side])
    first[side], first[twin[side]] = end - 2 * flat[side], end - 1
    cut, leaving = np.empty_like(count), np.empty_like(count)
    for begin in range(0, len(count), BLOCK_SIZE // 4):
        faces = slice(begin, begin + BLOCK_SIZE // 4)
        a, b, c = np.ascontiguousarray(count[faces].T)  # a runs from corner 0 to corner 1
        arcs = [corner_arcs(*sides) for sides in ((b, a, c), (c, b, a), (a, c, b))]
        for k, (left, surplus) in enumerate(arcs):
            leaving[faces, k] = left
            cut[faces, k] = np.maximum((surplus - arcs[k - 1][0] - arcs[k - 2][0]) >> 1, 0)
    return Crossings(flat, first, cut.ravel(), leaving.ravel(), side)


def blocks(count: NDArray, together: int) -> list[slice]:
    """Slices of ragged lists with about `together` members in total, so that temporaries stay in cache.

    Parameters
    ----------
    count : (k,) ndarray of int64
        Members of each list.
    together : int

    Returns
    -------
    list of slice
    """
    block_number = (np.cumsum(count) - count) // together
    bounds = np.concatenate([[0], np.flatnonzero(block_number[1:] != block_number[:-1]) + 1, [len(count)]])
    return [slice(a, b) for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist()) if a < b]


@dataclass(frozen=True, eq=False)
class BaseEdges:
    """Crossed base edges, each as two chains of its crossings, one from each end.

    Parameters
    ----------
    tail, head : (k,) ndarray of int64
        Vertices that a chain runs to and from: seen from its half-crossings, it comes from `tail` and ends at
        `head`.
    reverse, length : (k,) ndarray of int64
        The chain of the same edge from the other end, and the number of crossings.
    label : (x,) ndarray of int64
        One of the two chains through each crossing, times 2^33, plus 2^32 where its half-crossing is the one
        on the second side, plus the number of crossings between the crossing and the chain's head.
    """

    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    reverse: NDArray[np.int64]
    length: NDArray[np.int64]
    label: NDArray[np.int64]


def base_edges_of(c: Crossings, tail: NDArray) -> BaseEdges:
    """Follow the base edges from both ends at once, a crossing at a time, until they meet.

    Parameters
    ----------
    c : Crossings
    tail : (3m,) ndarray of int64
        Vertex at each corner.

    Returns
    -------
    BaseEdges
    """
    onward, here, corner = _arcs(c)
    head = tail[corner]
    reverse, length = np.empty_like(here), np.empty_like(here)
    label = np.full(len(onward) // 2, -1, dtype=np.int64)
    name = np.arange(len(here)) << STEP_BITS + 1
    label[here >> 1] = name + ((here & 1) << STEP_BITS)
    here, passed = onward.take(here), 1
    alone = np.flatnonzero(here < 0)  # a single crossing: both ends were there at once
    reverse[alone], length[alone] = ~here[alone], 1
    going = np.flatnonzero(here >= 0)
    here, name = here[going], name[going]
    while len(here):
        x = here >> 1
        other = label.take(x)
        complete = np.flatnonzero(other >= 0)
        if len(complete):
            going = np.flatnonzero(other < 0)
            chain, other = name.take(complete) >> STEP_BITS + 1, other.take(complete)
            reverse[chain] = other >> STEP_BITS + 1
            length[chain] = passed + 1 + (other & STEP_MASK)
            here, x, name = here.take(going), x.take(going), name.take(going)
        label[x] = name + (passed + ((here & 1) << STEP_BITS))
        here, passed = onward.take(here), passed + 1
    return BaseEdges(head[reverse], head, reverse, length, label)


def _arcs(c: Crossings) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Connections of half-crossings by arcs.

    Returns
    -------
    onward : (c,) ndarray of int64
        End of the arc that continues from a half-crossing beyond its side; ~e for the e-th arc that ends at a
        corner.
    end, corner : (e,) ndarray of int64
        The half-crossing of each arc that ends at a corner, and the flat index of that corner.
    """
    onward = np.empty(c.total, dtype=np.int64)
    cut = np.flatnonzero(c.cut)
    for block in blocks(c.cut[cut], BLOCK_SIZE):
        corner, before = cut[block], previous_side(cut[block])
        index, place = repeat_with_place(np.arange(len(corner)), c.cut[corner])
        x = ahead(c.first[corner].take(index), place)  # the arc's ends on both sides of the corner
        y = ahead(c.last(before).take(index), -place)
        onward[x ^ 1] = y
        onward[y ^ 1] = x
    left = np.flatnonzero(c.leaving)
    opposite = next_side(left)
    which, place = repeat_with_place(np.arange(len(left)), c.leaving[left])
    end = ahead(c.at(opposite, c.cut[opposite]).take(which), place)
    onward[end ^ 1] = ~np.arange(len(end))
    return onward, end, left.take(which)
