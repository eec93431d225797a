"""Cutting the faces of a triangulation along the arcs that cross them, by number alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.normal_coordinates import Crossings


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles that fill the pieces of all faces.

    Parameters
    ----------
    corner : (t, 3) ndarray of int64
        Where the corners lie, oriented as the faces are: the flat number 3f+k of a corner of the face that
        was cut, or 3m + h for half-crossing h.
    face, input_face : (t,) ndarray of int64
        The face that was cut, and the input face that holds the piece.
    """

    corner: NDArray[np.int64]
    face: NDArray[np.int64]
    input_face: NDArray[np.int64]


def cut_faces(c: Crossings, before: NDArray, beyond: NDArray, holder: NDArray) -> Pieces:
    """Cut faces along their arcs into convex pieces, and those into fans of triangles.

    Parameters
    ----------
    c : Crossings
    before, beyond : (c,) ndarray of int64
        Input face on the side of the arc that a walk along the side leaves, and that it enters.
    holder : (m,) ndarray of int64
        Input face of the faces that no arc crosses.

    Notes
    -----
    Around a corner that arcs cut off lie a triangle and quadrilaterals. What is left is one polygon of at
    most six corners, or, where arcs leave a corner, a fan of pieces around it.
    """
    cutter = _Cutter(c, before, beyond)
    parts = [
        cutter.corner_triangles(),
        *cutter.corner_quads(),
        *cutter.middles(holder),
        *cutter.fan_firsts(),
        cutter.fan_inner(),
        *cutter.fan_lasts(),
    ]
    total = sum(len(face) for _, face, _ in parts)
    pieces = Pieces(*(np.empty(shape, dtype=np.int64) for shape in ((total, 3), total, total)))
    filled = 0
    for corners, corner, input_face in parts:
        rows = slice(filled, filled + len(corner))
        for k in range(3):
            pieces.corner[rows, k] = corners[k]
        pieces.face[rows], pieces.input_face[rows] = corner // 3, input_face
        filled = rows.stop
    return pieces


Part = tuple[tuple[NDArray, NDArray, NDArray], NDArray[np.int64], NDArray[np.int64]]


class _Cutter:
    """The kinds of pieces; methods return parts: triangles by corner, a corner of their face, input face."""

    def __init__(self, c: Crossings, before: NDArray, beyond: NDArray) -> None:
        self.c = c
        self.n_corners = len(c.count)
        self.before, self.beyond = np.append(before, -1), np.append(beyond, -1)
        self.cut, self.leaving = c.cut.ravel(), c.leaving.ravel()

    def _from_tail(self, side: NDArray, place: NDArray) -> NDArray:
        return self.c.start[side] + place

    def _from_head(self, side: NDArray, place: NDArray) -> NDArray:
        return self.c.start[side] + self.c.count[side] - 1 - place

    def _at(self, half: NDArray) -> NDArray:
        """The name of half-crossings as corners of pieces."""
        return self.n_corners + half

    def corner_triangles(self) -> Part:
        """The tip of each corner that is cut off."""
        corner = np.flatnonzero(self.cut > 0)
        x = self._from_tail(corner, np.zeros_like(corner))
        y = self._from_head(_previous(corner), np.zeros_like(corner))
        return (corner, self._at(x), self._at(y)), corner, self.before[x]

    def corner_quads(self) -> list[Part]:
        """Between two arcs that cut off the same corner."""
        count = np.maximum(self.cut - 1, 0)
        corner = np.repeat(np.arange(len(count)), count)
        place = 1 + np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count)
        outer, far = self._from_tail(corner, place), self._from_head(_previous(corner), place)
        a, b, c, d = (self._at(x) for x in (outer - 1, outer, far, far + 1))
        held = self.before[outer]
        return [((a, b, c), corner, held), ((a, c, d), corner, held)]

    def _outermost(self, corner: NDArray) -> tuple[NDArray, NDArray]:
        """Where what is left of a face arrives at and leaves a corner: the last arc's ends, or the corner."""
        cut = self.cut[corner]
        arriving = self._at(self._from_head(_previous(corner), cut - 1))
        leaving = self._at(self._from_tail(corner, cut - 1))
        return np.where(cut > 0, arriving, corner), np.where(cut > 0, leaving, -1)

    def middles(self, holder: NDArray) -> list[Part]:
        """What cut-off corners leave of a face that no arc leaves a corner into."""
        face = np.flatnonzero((self.c.leaving == 0).all(axis=1))
        arriving, leaving, input_face = [], [], holder[face]
        for k in range(3):
            corner = 3 * face + k
            into, out = self._outermost(corner)
            arriving.append(into)
            leaving.append(out)
            cut = self.cut[corner]
            x = np.where(cut > 0, self._from_tail(corner, cut - 1), -1)
            input_face = np.where(cut > 0, self.beyond[x], input_face)
        a, b, c = arriving
        ears = [(a, leaving[0], b), (b, leaving[1], c), (c, leaving[2], a)]
        return [((a, b, c), 3 * face, input_face), *(_present((ear, 3 * face, input_face)) for ear in ears)]

    def _fan_corners(self) -> tuple[NDArray, NDArray, NDArray]:
        """Corners that arcs leave, how many, and the place of the first on the opposite side."""
        corner = np.flatnonzero(self.leaving > 0)
        return corner, self.leaving[corner], self.cut[_following(corner)]

    def fan_firsts(self) -> list[Part]:
        """Between the side that leaves the corner and the first arc."""
        corner, _, first = self._fan_corners()
        arriving, leaving = self._outermost(_following(corner))
        x = self._from_tail(_following(corner), first)
        held = self.before[x]
        middle = np.where(leaving >= 0, leaving, arriving)
        ear = (corner, arriving, leaving), corner, held
        return [_present(ear), ((corner, middle, self._at(x)), corner, held)]

    def fan_inner(self) -> Part:
        """Between two arcs that leave the same corner."""
        corner, count, first = self._fan_corners()
        more = count - 1
        place = 1 + np.arange(more.sum()) - np.repeat(np.cumsum(more) - more, more)
        corner, first = np.repeat(corner, more), np.repeat(first, more)
        x = self._from_tail(_following(corner), first + place)
        return (corner, self._at(x - 1), self._at(x)), corner, self.before[x]

    def fan_lasts(self) -> list[Part]:
        """Between the last arc and the side that arrives at the corner."""
        corner, count, first = self._fan_corners()
        arriving, leaving = self._outermost(_previous(corner))
        x = self._from_tail(_following(corner), first + count - 1)
        held = self.beyond[x]
        ear = (corner, arriving, leaving), corner, held
        return [((corner, self._at(x), arriving), corner, held), _present(ear)]


def _present(part: Part) -> Part:
    """The triangles that no corner is missing from (-1)."""
    (a, b, c), corner, input_face = part
    there = np.flatnonzero((b >= 0) & (c >= 0))
    return (a[there], b[there], c[there]), corner[there], input_face[there]


def _following(corner: NDArray) -> NDArray:
    return corner + np.where(corner % 3 == 2, -2, 1)


def _previous(corner: NDArray) -> NDArray:
    return corner + np.where(corner % 3 == 0, 2, -1)
