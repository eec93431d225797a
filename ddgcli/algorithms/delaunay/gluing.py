"""Triangles glued along their sides, by index alone: flips and splits in batches of disjoint faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NEXT_SIDE = np.array([1, 1, -2])
PREVIOUS_SIDE = np.array([2, -1, -1])


def around(side: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Face of each side, and the next and the previous side in it.

    Parameters
    ----------
    side : (k,) ndarray of int64
        Flat side indices 3*face + j.

    Returns
    -------
    face, following, previous : (k,) ndarray of int64
    """
    face = side // 3
    corner = side - 3 * face
    return face, side + NEXT_SIDE.take(corner), side + PREVIOUS_SIDE.take(corner)


@dataclass(eq=False)
class Gluing:
    """Corners and gluing of triangles, changed in place.

    Parameters
    ----------
    tail : (3m,) ndarray of int64
        Vertex at which a side starts.
    twin : (3m + 1,) ndarray of int64
        Side glued to each side, -1 on the boundary; the last entry absorbs writes to side -1.
    """

    tail: NDArray[np.int64]
    twin: NDArray[np.int64]

    def __post_init__(self) -> None:
        self.place = np.append(np.arange(len(self.tail)), -1)  # scratch: identity between batches
        self._buffers: dict[str, NDArray] = {}  # buffers with spare capacity behind the grown arrays

    @property
    def n_faces(self) -> int:
        return len(self.tail) // 3

    def grow(self, n_new: int) -> None:
        """Append n_new unglued faces."""
        old = len(self.tail)
        self._lengthen("tail", 3 * n_new, -1)
        self._lengthen("twin", 3 * n_new, -1)
        self._lengthen("place", 3 * n_new, -1)
        self.place[old:-1] = np.arange(old, old + 3 * n_new)

    def _lengthen(self, name: str, more: int, fill: float) -> None:
        """Append to an array; a reallocation adds half of the length as spare capacity."""
        array = getattr(self, name)
        buffer = self._buffers.get(name, array)
        if len(buffer) < len(array) + more:
            buffer = self._buffers[name] = np.empty(3 * (len(array) + more) // 2, dtype=array.dtype)
            buffer[: len(array)] = array
        longer = buffer[: len(array) + more]
        longer[len(array) :] = fill
        setattr(self, name, longer)

    def _move(self, old: NDArray, new: NDArray) -> None:
        """Move sides to other places, and update their neighbours, also those moved in the same batch."""
        self.place[old] = new
        neighbour = self.place.take(self.twin.take(old))
        self.place[old] = old
        self.twin[new] = neighbour
        self.twin[neighbour] = new
        self.twin[-1] = -1

    def _join(self, a: NDArray, b: NDArray) -> None:
        self.twin[a], self.twin[b] = b, a

    def flip_sides(self, here: NDArray, after: NDArray, before: NDArray) -> None:
        """Flip the edges between the sides here[0] and here[1]; all (2, k), with the next and previous sides.

        here[0] takes the side at after[1], here[1] that at after[0]; the new edge stands at both `after`.
        """
        self._move(after[::-1].ravel(), here.ravel())
        self._join(after[0], after[1])
        self.tail[after] = self.tail.take(before[::-1])

    def split_faces(self, face: NDArray, vertex: NDArray) -> NDArray[np.int64]:
        """Cut faces (a, b, c) into three around a new vertex v.

        Returns
        -------
        (2, k) ndarray of int64
            The new faces (b, c, v) and (c, a, v); the old one becomes (a, b, v).
        """
        first = self.n_faces
        new = first + np.arange(2 * len(face)).reshape(2, -1)
        self.grow(2 * len(face))
        a, b, c = (3 * face + k for k in range(3))
        p, q = 3 * new[0], 3 * new[1]
        tail = self.tail
        tail[p], tail[p + 1], tail[p + 2] = tail[b], tail[c], vertex
        tail[q], tail[q + 1], tail[q + 2] = tail[c], tail[a], vertex
        self._move(np.concatenate([b, c]), np.concatenate([p, q]))
        tail[c] = vertex
        self._join(b, p + 2)
        self._join(p + 1, q + 2)
        self._join(q + 1, c)
        return new

    def split_boundary(self, side: NDArray, vertex: NDArray) -> NDArray[np.int64]:
        """Cut boundary sides ij of faces (i, j, k) at new vertices v; at most one side of each face.

        Returns
        -------
        (k,) ndarray of int64
            The new faces (v, j, k); the old ones become (i, v, k) with iv in place of ij.
        """
        _, jk, ki = around(side)
        new = self.n_faces + np.arange(len(side))
        self.grow(len(side))
        p, tail = 3 * new, self.tail
        tail[p], tail[p + 1], tail[p + 2] = vertex, tail[jk], tail[ki]
        self._move(jk, p + 1)
        tail[jk] = vertex
        self._join(jk, p + 2)
        return new
