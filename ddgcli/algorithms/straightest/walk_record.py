"""The points of lines under way, noted step by step and put in order line by line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT

Note = tuple[NDArray, NDArray, NDArray, NDArray]

CELLS = 1 << 19  # notes that are turned round at once: they stay in the cache
MOST_LINES = 1000  # 8000 bytes: rows that lie a power of two apart would share places in the cache


class Record:
    """Where lines stood after each step: one note a step, of all lines under way, by rising number."""

    def __init__(self) -> None:
        self.notes: list[Note] = []

    def note(self, line: NDArray, side: NDArray, x: NDArray, width: NDArray) -> None:
        """Lines stand on sides at x from their tails; the arrays are kept, not copied."""
        self.notes.append((line, side, x, width))

    def in_order(self, crossings: NDArray, has_start: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Faces and barycentric coordinates, one line after the other; room is left for starts and ends.

        Notes are rows of lines, paths are rows of steps: the turn is made in blocks that fit the cache.

        Returns
        -------
        start : (k+1,) ndarray of int64
            Points of line i are start[i]:start[i+1]: its start if `has_start`, its crossings, its end.
        face, barycentric : (p,), (p, 3) ndarray
            The points that are starts or ends hold nothing yet.
        """
        start = np.concatenate([[0], np.cumsum(has_start + crossings + 1)])
        face, barycentric = np.empty(start[-1], dtype=np.int64), np.zeros((start[-1], 3))
        block = int(np.clip(CELLS // (crossings.max(initial=0) + 2), 16, MOST_LINES))
        edges = np.append(np.arange(0, len(crossings), block), len(crossings))
        bounds = np.array([np.searchsorted(line, edges) for line, *_ in self.notes]).reshape(-1, len(edges))
        for i, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            steps = int(crossings[first:last].max(initial=0))
            side, share = _rows_of_steps(
                self.notes[:steps], bounds[:steps, i].tolist(), bounds[:steps, i + 1].tolist(), first, last
            )
            part = slice(start[first], start[last])
            points, width = start[first : last + 1] - start[first], last - first
            row_before = points[:-1] - ~has_start[first:last]
            cell = np.arange(0, points[-1] * width, width)
            cell += np.repeat(np.arange(width) - row_before * width, np.diff(points))
            _place(side.take(cell), share.take(cell), face[part], barycentric[part])
        return start, face, barycentric


def _rows_of_steps(
    notes: list[Note], low: list[int], high: list[int], first: int, last: int
) -> tuple[NDArray, NDArray]:
    """Sides, and shares of the way along them, of lines first..last: a row a step, one more before and after.

    What is not noted stays open.
    """
    width = last - first
    side, share = np.empty((len(notes) + 2, width), dtype=np.int64), np.empty((len(notes) + 2, width))
    for s, ((line, sides, x, length), a, b) in enumerate(zip(notes, low, high, strict=True), start=1):
        shares = x[a:b] / np.maximum(length[a:b], 1e-300)
        if b - a == width:
            side[s], share[s] = sides[a:b], shares
        else:
            column = line[a:b] - first
            side[s, column], share[s, column] = sides[a:b], shares
    return side, share


def _place(side: NDArray, share: NDArray, face: NDArray, barycentric: NDArray) -> None:
    """Write points on sides to `face` and to `barycentric`, which is zero; overwrites `side`."""
    np.floor_divide(side, 3, out=face)
    side -= 3 * face
    at = 3 * np.arange(len(side))
    flat = barycentric.reshape(-1)
    flat[at + side] = 1.0 - share
    at += NEXT.take(side)
    flat[at] = share
