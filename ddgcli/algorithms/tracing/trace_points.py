"""Record the points of lines step by step, and sort them by line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.topology import NEXT

MAX_BUFFER_SIZE = 1 << 20  # marks allocated at once; large allocations use large pages
BLOCK_SIZE = 1 << 14  # points converted at once; they fit in the cache


class PointRecorder:
    """Points of lines after each step, as marks: the fraction along a side plus 1j times the side index.

    An entry holds one step of all active lines, or several steps of the same lines, one row each.
    """

    def __init__(self) -> None:
        self.entries: list[tuple[NDArray, NDArray]] = []
        self.buffer, self.size = np.empty(0, dtype=np.complex128), 64

    def record(self, line: NDArray, side: NDArray, x: NDArray, width: NDArray) -> None:
        """Record one step: lines are on sides, at x from their tails."""
        if len(self.buffer) < len(line):
            self.size = min(2 * self.size, MAX_BUFFER_SIZE)
            self.buffer = np.empty(max(self.size, 16 * len(line)), dtype=np.complex128)
        marks, self.buffer = self.buffer[: len(line)], self.buffer[len(line) :]
        np.divide(x, width, out=marks.real)
        marks.imag = side
        self.entries.append((line, marks))

    def record_steps(self, line: NDArray, marks: list[complex]) -> None:
        """Record several steps of the same lines."""
        self.entries.append((line, np.array(marks).reshape(-1, len(line))))

    def in_order(self, crossings: NDArray, has_start: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Faces and barycentric coordinates of the points, line by line, with free entries for starts and
        ends.

        Ended lines may still be recorded for some steps. Those points land in entries of later lines, at
        steps which these lines made before; writing backward in time overwrites them with the right points.

        Returns
        -------
        start : (k+1,) ndarray of int64
            Points of line i are start[i]:start[i+1]: its start if `has_start`, its crossings, its end.
        face, barycentric : (p,), (p, 3) ndarray
            Entries of starts and ends are not set.
        """
        start = list_starts(has_start + crossings + 1)
        base = start[:-1] + has_start
        rows = [marks.size // max(len(line), 1) for line, marks in self.entries]
        step = sum(rows)
        face, barycentric = np.empty(start[-1], dtype=np.int64), np.empty((start[-1] + step, 3))
        place = barycentric[:, :2].view(np.complex128)[:, 0]  # store marks where their points will be
        previous, first = None, base
        for (line, marks), n in zip(reversed(self.entries), reversed(rows), strict=True):
            step -= n
            if line is not previous:
                previous, first = line, base.take(line)
            place[first + step if n == 1 else first + np.arange(step, step + n)[:, None]] = marks
        barycentric = barycentric[: len(face)]
        for a in range(0, len(face), BLOCK_SIZE):
            block = slice(a, a + BLOCK_SIZE)
            with np.errstate(invalid="ignore"):  # entries without a mark
                _convert_marks(
                    place[a : min(a + BLOCK_SIZE, len(face))].copy(), face[block], barycentric[block]
                )
        return start, face, barycentric


def _convert_marks(marks: NDArray, face: NDArray, barycentric: NDArray) -> None:
    """Convert marks to `face` and `barycentric`, in place."""
    share = np.fmax(marks.real, 0.0)  # nan on a side without length
    side = marks.imag.astype(np.int64)
    np.floor_divide(side, 3, out=face)
    side -= 3 * face
    at = np.arange(0, 3 * len(side), 3)
    barycentric.fill(0.0)
    flat = barycentric.reshape(-1)
    flat[at + side] = 1.0 - share
    at += NEXT.take(side)
    flat[at] = share
