"""Self-crossings of plane polylines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import ranges
from ddgcli.mesh.vectors import row_cross, unit_vectors
from ddgcli.models.curve.polygon import Polygons

MAX_PAIRS = 1 << 20  # pairs of segments handled at once


def self_crossings(mesh: Polygons, points: NDArray) -> NDArray[np.float64]:
    """Count the crossings of each plane curve with itself.

    A point of the curve that lies on another segment counts as to its left, so that a curve that passes
    through one of its own points crosses there once, and one that touches it crosses not at all or twice.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    (c,) ndarray of float64
        0 for curves in space.
    """
    count = np.zeros(mesh.n_curves)
    for k in np.flatnonzero(mesh.normal.any(axis=1)):
        own = mesh.curve[mesh.tail] == k
        tail, head = mesh.tail[own], mesh.head[own]
        across, up = _plane_axes(mesh.normal[k])
        z = points @ across + 1j * (points @ up)
        count[k] = _crossings(z[tail], z[head], tail, head)
    return count


def _plane_axes(normal: NDArray) -> tuple[NDArray, NDArray]:
    axis = np.eye(3)[np.abs(normal).argmin()]
    across = unit_vectors(row_cross(normal, axis)[None])[0]
    return across, row_cross(normal, across)


def _crossings(start: NDArray, end: NDArray, tail: NDArray, head: NDArray) -> int:
    """Number of crossing pairs of segments without a common point, by a sweep along the real axis."""
    low, high = np.minimum(start.real, end.real), np.maximum(start.real, end.real)
    order = np.argsort(low, kind="stable")
    start, end, tail, head = (a[order] for a in (start, end, tail, head))
    low, high = low[order], high[order]
    last = np.searchsorted(low, high, side="right")  # segments that begin before this one ends
    number = last - np.arange(len(low)) - 1
    block_number = (np.cumsum(number) - number) // MAX_PAIRS
    total = 0
    for block in np.split(np.arange(len(low)), np.flatnonzero(block_number[1:] != block_number[:-1]) + 1):
        i = np.repeat(block, number[block])
        j, _ = ranges(block + 1, number[block])
        apart = (tail[i] != tail[j]) & (tail[i] != head[j]) & (head[i] != tail[j]) & (head[i] != head[j])
        i, j = i[apart], j[apart]
        total += int((_separates(start[i], end[i], start[j], end[j])
                      & _separates(start[j], end[j], start[i], end[i])).sum())  # fmt: skip
    return total


def _separates(a: NDArray, b: NDArray, p: NDArray, q: NDArray) -> NDArray[np.bool_]:
    """Whether the lines through a and b have p and q on different sides; on the line counts as left."""
    along = np.conj(b - a)
    return ((along * (p - a)).imag >= 0) != ((along * (q - a)).imag >= 0)
