"""The points of lines under way, noted step by step and put in order line by line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT

ROOM = 1 << 20  # marks at most that are made room for at once: large pieces of memory come in large pages
BLOCK = 1 << 14  # points written out at once: they stay in the cache


class Record:
    """Where lines stood after each step: a mark is the share of the way along a side, and 1j times the side.

    A note is one step of all lines under way, or several steps of the same lines: a row each.
    """

    def __init__(self) -> None:
        self.notes: list[tuple[NDArray, NDArray]] = []
        self.room, self.size = np.empty(0, dtype=np.complex128), 64

    def note(self, line: NDArray, side: NDArray, x: NDArray, width: NDArray) -> None:
        """Lines stand on sides at x from their tails."""
        if len(self.room) < len(line):
            self.size = min(2 * self.size, ROOM)
            self.room = np.empty(max(self.size, 16 * len(line)), dtype=np.complex128)
        marks, self.room = self.room[: len(line)], self.room[len(line) :]
        np.divide(x, width, out=marks.real)
        marks.imag = side
        self.notes.append((line, marks))

    def note_steps(self, line: NDArray, marks: list[complex]) -> None:
        """Several steps of lines that all went on, step by step."""
        self.notes.append((line, np.array(marks).reshape(-1, len(line))))

    def in_order(self, crossings: NDArray, has_start: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Faces and barycentric coordinates, one line after the other; room is left for starts and ends.

        A line that had ended may still have been noted for some steps. What is noted of it lands in places of
        later lines, at steps that those had made before: written backward in time, they have the last word.

        Returns
        -------
        start : (k+1,) ndarray of int64
            Points of line i are start[i]:start[i+1]: its start if `has_start`, its crossings, its end.
        face, barycentric : (p,), (p, 3) ndarray
            The points that are starts or ends hold nothing yet.
        """
        start = np.concatenate([[0], np.cumsum(has_start + crossings + 1)])
        base = start[:-1] + has_start
        rows = [marks.size // max(len(line), 1) for line, marks in self.notes]
        step = sum(rows)
        face, barycentric = np.empty(start[-1], dtype=np.int64), np.empty((start[-1] + step, 3))
        place = barycentric[:, :2].view(np.complex128)[:, 0]  # the marks wait where their points will be
        known, first = None, base
        for (line, marks), n in zip(reversed(self.notes), reversed(rows), strict=True):
            step -= n
            if line is not known:
                known, first = line, base.take(line)
            place[first + step if n == 1 else first + np.arange(step, step + n)[:, None]] = marks
        barycentric = barycentric[: len(face)]
        for a in range(0, len(face), BLOCK):
            part = slice(a, a + BLOCK)
            with np.errstate(invalid="ignore"):  # where nothing was noted
                _write_out(place[a : min(a + BLOCK, len(face))].copy(), face[part], barycentric[part])
        return start, face, barycentric


def _write_out(marks: NDArray, face: NDArray, barycentric: NDArray) -> None:
    """Write points on sides to `face` and `barycentric`."""
    share = np.fmax(marks.real, 0.0)  # a side without length has no shares
    side = marks.imag.astype(np.int64)
    np.floor_divide(side, 3, out=face)
    side -= 3 * face
    at = np.arange(0, 3 * len(side), 3)
    barycentric.fill(0.0)
    flat = barycentric.reshape(-1)
    flat[at + side] = 1.0 - share
    at += NEXT.take(side)
    flat[at] = share
