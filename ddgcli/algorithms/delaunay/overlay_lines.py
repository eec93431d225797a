"""Where straight lines over a triangulation cross its edges, measured in unfolded strips of faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.gluing import around
from ddgcli.algorithms.delaunay.normal_coordinates import Crossings
from ddgcli.errors import SolveError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

TOGETHER = 1 << 17  # crossings unfolded at a time, so that temporaries stay in cache


def lines_over(
    mesh: IntrinsicMesh, base: TriangleMesh, c: Crossings, base_side: NDArray
) -> tuple[NDArray, NDArray, float]:
    """Where crossings lie, by unfolding the strip of base faces under each edge.

    Returns
    -------
    along : (c,) ndarray of float64
        Share of the intrinsic side's length, from its tail; nan on one of the two sides.
    share : (c,) ndarray of float64
        Share of the base side's length, from its tail.
    residual : float
        Largest relative difference between an edge's length and its straight line's.
    """
    twin = mesh.topology.side_twin.ravel()
    side = np.flatnonzero((c.count > 0) & (np.arange(len(twin)) < twin))
    side = side[np.argsort(-c.count[side], kind="stable")]
    along, share = np.full(len(c.side), np.nan), np.full(len(c.side), np.nan)
    if len(side) == 0:
        return along, share, 0.0
    count, start = c.count[side], c.start[side]
    strips = Strips(base, base_side)
    straight = np.empty(len(side))
    part = (np.cumsum(count) - count) // TOGETHER
    for block in np.split(np.arange(len(side)), np.flatnonzero(part[1:] != part[:-1]) + 1):
        n, first = count[block], start[block]
        crossed, position, straight[block] = strips.lines(first, n)
        mine = np.arange(len(crossed)) + np.repeat(first - (np.cumsum(n) - n), n)
        share[mine], along[mine] = crossed, position
    length = mesh.side_length.ravel()[side]
    return along, share, float((np.abs(straight - length) / length).max())


class Strips:
    """Strips of base faces under straight lines, unfolded in the plane of complex numbers."""

    def __init__(self, base: TriangleMesh, base_side: NDArray) -> None:
        self.base_side = base_side
        self.apex, self.twin = _apex(base), base.topology.side_twin.ravel()
        self.length = base.side_length.ravel()

    def lines(self, start: NDArray, count: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Straight lines whose crossings begin at `start`, longest first.

        Returns
        -------
        share, along : (c,) ndarray of float64
            Where crossings lie on the base sides and on the lines, line after line; both from 0 to 1.
        length : (k,) ndarray of float64
            Of the lines.
        """
        right, left, end = self._unfolded(start, count)
        length = np.abs(end)
        unit = np.where(length > 0, length, 1.0)
        turn = np.repeat(np.where(length > 0, np.conj(end) / unit, 1.0), count)
        right *= turn
        left *= turn
        rise = left.imag - right.imag
        share = np.where(rise > 0, -right.imag / np.where(rise > 0, rise, 1.0), 0.5)
        np.clip(share, 0.0, 1.0, out=share)
        along = (right.real + share * (left.real - right.real)) / np.repeat(unit, count)
        return share, np.clip(along, 0.0, 1.0), length

    def _unfolded(self, start: NDArray, count: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """The strips laid out with the tails of the lines at 0.

        Returns
        -------
        right, left : (c,) ndarray of complex128
            Ends of the crossed sides, line after line.
        end : (k,) ndarray of complex128
            Heads of the lines.
        """
        apex, twin, base_side = self.apex, self.twin, self.base_side
        place = np.cumsum(count) - count
        right, left = np.empty((2, int(count.sum())), dtype=np.complex128)
        here = base_side[start]
        length = self.length[here]
        right[place], left[place] = -apex[here] * length, (1.0 - apex[here]) * length
        end = np.zeros(len(start), dtype=np.complex128)
        alive = len(start)
        longer = alive - np.cumsum(np.bincount(count))  # strips of more crossings than so many
        for step in range(1, int(count[0]) + 1):
            entered = twin[base_side[start[:alive] + step - 1]]
            previous = place[:alive] + step - 1
            p, q = left[previous], right[previous]
            corner = p + apex[entered] * (q - p)
            going = int(longer[step])
            end[going:alive] = corner[going:]
            now, entered = place[:going] + step, entered[:going]
            crossed = base_side[start[:going] + step]
            _, following, before = around(entered)
            keeps_right = crossed == following
            if not (keeps_right | (crossed == before)).all():
                raise SolveError("a chain of crossings leaves the strip of faces that it runs through")
            left[now] = np.where(keeps_right, corner[:going], p[:going])
            right[now] = np.where(keeps_right, q[:going], corner[:going])
            alive = going
        return right, left, end


def _apex(mesh: TriangleMesh) -> NDArray[np.complex128]:
    """(3m,) the corner opposite each side, in the frame where the side runs from 0 to 1."""
    side = mesh.side_vector
    to_apex = -side[:, [2, 0, 1]]
    squared = np.einsum("fij,fij->fi", side, side)
    squared[squared == 0.0] = 1.0
    x = np.einsum("fij,fij->fi", side, to_apex) / squared
    y = np.linalg.norm(np.cross(side[:, 0], to_apex[:, 0]), axis=1)[:, None] / squared
    return (x + 1j * y).ravel()


def in_order(share: NDArray, base_side: NDArray, index: NDArray, base: TriangleMesh) -> NDArray[np.float64]:
    """Shares along base sides, exchanged where rounding put them in another order than the integers say."""
    twin = base.topology.side_twin.ravel()
    forward = base_side < twin[base_side]
    edge = np.where(forward, base_side, twin[base_side])
    total = np.bincount(edge, minlength=len(twin))[edge]
    along = np.where(forward, share, 1.0 - share)
    rank = np.where(forward, index, total - 1 - index)
    count = np.bincount(edge, minlength=len(twin))
    place = (np.cumsum(count) - count)[edge] + rank  # every rank of an edge occurs once
    owner, ordered = np.empty_like(edge), np.empty_like(along)
    owner[place], ordered[place] = edge, along
    if ((ordered[1:] < ordered[:-1]) & (owner[1:] == owner[:-1])).any():
        ordered = ordered[np.lexsort((ordered, owner))]
    along = ordered[place]
    return np.where(forward, along, 1.0 - along)
