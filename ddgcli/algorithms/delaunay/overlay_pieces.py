"""Cut the faces of a triangulation along the arcs that cross them, by integers alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.normal_coordinates import (
    BLOCK_SIZE,
    Crossings,
    ahead,
    blocks,
)
from ddgcli.mesh.ragged import repeat_with_place
from ddgcli.mesh.sides import next_side, previous_side


@dataclass(frozen=True, eq=False)
class Names:
    """Numbering of the corners of faces and of the half-crossings on their sides.

    Parameters
    ----------
    corner : (3m,) ndarray of int64
    offset, shift : int
        The index of a half-crossing is offset + half / 2^shift.
    """

    corner: NDArray[np.int64]
    offset: int
    shift: int

    def half(self, half: NDArray) -> NDArray[np.int64]:
        """The names of half-crossings."""
        return self.offset + (half >> self.shift)


@dataclass(frozen=True, eq=False)
class Labels:
    """Input faces at crossings and of faces without arcs.

    Parameters
    ----------
    crossed : (x,) ndarray of int64
        Base side of each crossing, as it is seen from the first side: from its right to its left.
    beside : (b, 2) ndarray of int64
        Input face that holds the face of a base side, and the one beyond.
    holder : (m,) ndarray of int64
        Input face of the faces that no arc crosses.
    """

    crossed: NDArray[np.int64]
    beside: NDArray[np.int64]
    holder: NDArray[np.int64]

    def before(self, half: NDArray) -> NDArray[np.int64]:
        """The input face at a half-crossing before its arc, along the direction of the side."""
        return self.beside.ravel().take(2 * self.crossed.take(half >> 1) + (half & 1))

    def beyond(self, half: NDArray) -> NDArray[np.int64]:
        """The input face at a half-crossing beyond its arc, along the direction of the side."""
        return self.before(half ^ 1)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles that fill the pieces of all faces.

    Parameters
    ----------
    corner : (t, 3) ndarray of int64
        The names of their corners, oriented as the faces are.
    face, input_face : (t,) ndarray of int64
        The face that was cut, and the input face that holds the piece.
    """

    corner: NDArray[np.int64]
    face: NDArray[np.int64]
    input_face: NDArray[np.int64]


def cut_faces(c: Crossings, names: Names, labels: Labels) -> Pieces:
    """Cut faces along their arcs into convex pieces, and those into fans of triangles.

    Parameters
    ----------
    c : Crossings
    names : Names
        Indices of the vertices and crossings in the result.
    labels : Labels
        Which input faces lie beside the arcs.

    Returns
    -------
    Pieces

    Notes
    -----
    Around a corner that arcs cut off lie a triangle and quadrilaterals. What is left is one polygon of at
    most six corners, or, where arcs leave a corner, a fan of pieces around it. Every face and every
    half-crossing adds one triangle.
    """
    m = len(c.count) // 3
    total = m + c.total
    pieces = Pieces(*(np.empty(shape, dtype=np.int64) for shape in ((total, 3), total, total)))
    cutter = _Cutter(c, names, labels)
    filled = 0
    for block in blocks(c.count.reshape(m, 3).sum(axis=1) + 1, BLOCK_SIZE):
        for corners, face, input_face in cutter.groups(block):
            rows = slice(filled, filled + len(face))
            for k in range(3):
                pieces.corner[rows, k] = corners[k]
            pieces.face[rows], pieces.input_face[rows] = face, input_face
            filled = rows.stop
    return pieces


PieceGroup = tuple[tuple[NDArray, NDArray, NDArray], NDArray[np.int64], NDArray[np.int64]]


class _Cutter:
    """The kinds of pieces; methods return parts: triangles by name, face, input face."""

    def __init__(self, c: Crossings, names: Names, labels: Labels) -> None:
        self.c, self.names, self.labels = c, names, labels

    def groups(self, block: slice) -> list[PieceGroup]:
        """The pieces of a run of faces."""
        sides = slice(3 * block.start, 3 * block.stop)
        cut = 3 * block.start + np.flatnonzero(self.c.cut[sides])
        left = 3 * block.start + np.flatnonzero(self.c.leaving[sides])
        whole = np.ones(block.stop - block.start, dtype=bool)
        whole[left // 3 - block.start] = False
        groups = [self._tips(cut), *self._quads(cut), *self._middles(block.start + np.flatnonzero(whole))]
        return [*groups, *self._fans(left)] if len(left) else groups

    def _tips(self, corner: NDArray) -> PieceGroup:
        """The tip of each corner that is cut off."""
        x, y = self.c.first[corner], self.c.last(previous_side(corner))
        tip = self.names.corner[corner], self.names.half(x), self.names.half(y)
        return tip, corner // 3, self.labels.before(x)

    def _quads(self, corner: NDArray) -> list[PieceGroup]:
        """Between two arcs that cut off the same corner, each with the one before it."""
        index, place = repeat_with_place(np.arange(len(corner)), self.c.cut[corner] - 1)
        other = previous_side(corner)
        x = ahead(self.c.first[corner].take(index), place)
        y = ahead(self.c.last(other).take(index), -place)
        a, d = self.names.half(x), self.names.half(y)
        x, y = ahead(x, 1), ahead(y, -1)
        b, c = self.names.half(x), self.names.half(y)
        face, input_face = (corner // 3).take(index), self.labels.before(x)
        return [((a, b, c), face, input_face), ((a, c, d), face, input_face)]

    def _outermost(self, corner: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """The rest of a face at a corner that arcs cut off.

        Returns
        -------
        arriving, leaving : (k,) ndarray of int64
            Names of the ends of the last arc that cuts the corner off; of the corner itself and -1 where none
            does.
        half : (k,) ndarray of int64
            The end of that arc on the side that leaves the corner.
        """
        last, other = self.c.cut[corner] - 1, previous_side(corner)
        x, y = self.c.at(corner, last), self.c.at(other, self.c.count[other] - 1 - last)
        arriving = np.where(last >= 0, self.names.half(y), self.names.corner[corner])
        return arriving, np.where(last >= 0, self.names.half(x), -1), x

    def _middles(self, face: NDArray) -> list[PieceGroup]:
        """The rest of faces whose corners are cut off, and where no arc ends at a corner."""
        arriving, leaving, input_face = [], [], self.labels.holder[face]
        for k in range(3):
            into, out, half = self._outermost(3 * face + k)
            arriving.append(into)
            leaving.append(out)
            off = np.flatnonzero(out >= 0)
            input_face[off] = self.labels.beyond(half[off])
        a, b, c = arriving
        ears = [(a, leaving[0], b), (b, leaving[1], c), (c, leaving[2], a)]
        return [((a, b, c), face, input_face), *(_present((ear, face, input_face)) for ear in ears)]

    def _fans(self, corner: NDArray) -> list[PieceGroup]:
        """The pieces around corners that arcs leave."""
        count, opposite = self.c.leaving[corner], next_side(corner)
        face, tip = corner // 3, self.names.corner[corner]
        first = self.c.at(opposite, self.c.cut[opposite])
        last = ahead(first, count - 1)
        arriving, leaving, _ = self._outermost(opposite)
        input_face = self.labels.before(first)
        middle = np.where(leaving >= 0, leaving, arriving)
        groups = [
            _present(((tip, arriving, leaving), face, input_face)),
            ((tip, middle, self.names.half(first)), face, input_face),
        ]
        arriving, leaving, _ = self._outermost(previous_side(corner))
        input_face = self.labels.beyond(last)
        groups += [
            ((tip, self.names.half(last), arriving), face, input_face),
            _present(((tip, arriving, leaving), face, input_face)),
        ]
        index, place = repeat_with_place(np.arange(len(corner)), count - 1)
        x = ahead(first.take(index), place)
        after = ahead(x, 1)
        between = tip.take(index), self.names.half(x), self.names.half(after)
        return [*groups, (between, face.take(index), self.labels.before(after))]


def _present(piece_group: PieceGroup) -> PieceGroup:
    """The triangles without a missing corner (-1)."""
    (a, b, c), face, input_face = piece_group
    there = np.flatnonzero((b >= 0) & (c >= 0))
    return (a[there], b[there], c[there]), face[there], input_face[there]
