"""Crossings of straight lines over a triangulation with its edges, computed in unfolded strips of faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.normal_coordinates import BLOCK_SIZE, STEP_BITS, STEP_MASK, BaseEdges, blocks
from ddgcli.errors import SolveError
from ddgcli.mesh.triangle_mesh import TriangleMesh, unit_side_blocks
from ddgcli.mesh.vectors import cross, dot


def lines_over(
    base: TriangleMesh, base_side: NDArray, count: NDArray, length: NDArray
) -> tuple[NDArray, NDArray, float]:
    """Positions where edges cross a base triangulation, from the unfolded strip of base faces under each.

    Parameters
    ----------
    base : TriangleMesh
    base_side : (x,) ndarray of int64
        The base sides crossed, from right to left, edge after edge.
    count : (k,) ndarray of int64
        Crossings of each edge, at least 1.
    length : (k,) ndarray of float64
        Lengths of the edges.

    Returns
    -------
    along : (x,) ndarray of float64
        Share of the edge's length, from its tail.
    share : (x,) ndarray of float64
        Share of the base side's length, from its tail.
    residual : float
        Largest relative difference between an edge's length and its straight line's.
    """
    along, share = np.empty((2, len(base_side)))
    if len(count) == 0:
        return along, share, 0.0
    most = int(count.max())
    longest_first = np.argsort((most - count).astype(np.min_scalar_type(most)), kind="stable")
    count, start = count[longest_first], (np.cumsum(count) - count)[longest_first]
    strips = Strips(base, base_side, along, share)
    straight = np.concatenate([strips.draw(start[b], count[b]) for b in blocks(count, BLOCK_SIZE)])
    length = length[longest_first]
    return along, share, float((np.abs(straight - length) / length).max())


class Strips:
    """Strips of base faces under straight lines, unfolded in the plane of complex numbers.

    Parameters
    ----------
    base : TriangleMesh
    base_side : (x,) ndarray of int64
    along, share : (x,) ndarray of float64
        Positions of crossings on the lines and on the base sides, from 0 to 1; `draw` fills them.
    """

    def __init__(self, base: TriangleMesh, base_side: NDArray, along: NDArray, share: NDArray) -> None:
        self.base_side, self.along, self.share = base_side, along, share
        self.apex, self.twin = _apex(base), base.topology.side_twin.ravel()
        self.length = base.side_length.ravel()

    @np.errstate(over="ignore", invalid="ignore")  # chains through faces without area have no place
    def draw(self, start: NDArray, count: NDArray) -> NDArray[np.float64]:
        """Lengths of the straight lines whose crossings begin at `start`, longest chains first."""
        n_active = len(count) - np.cumsum(np.bincount(count))[:-1]  # chains of more than 0, 1, ... crossings
        right, left, end = self._unfolded(start, n_active)
        step = np.repeat(np.arange(len(n_active)), n_active)
        line = np.arange(len(step)) - (np.cumsum(n_active) - n_active).take(step)
        length = np.abs(end)
        unit = np.where(length > 0, length, 1.0)
        turn = np.where(length > 0, np.conj(end) / unit, 1.0).take(line)
        right *= turn
        left *= turn
        left -= right
        share = np.divide(-right.imag, left.imag, out=np.full(len(step), 0.5), where=left.imag > 0)
        np.clip(share, 0.0, 1.0, out=share)
        place = start.take(line)
        place += step
        self.share[place] = share
        share *= left.real
        share += right.real
        share /= unit.take(line)
        self.along[place] = np.clip(share, 0.0, 1.0, out=share)
        return length

    def _unfolded(self, start: NDArray, n_active: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """The strips laid out with the tails of the lines at 0.

        Returns
        -------
        right, left : (c,) ndarray of complex128
            Ends of the crossed sides: the first ones of all lines, then the second ones, and so on.
        end : (k,) ndarray of complex128
            Heads of the lines.
        """
        right, left = np.empty((2, int(n_active.sum())), dtype=np.complex128)
        end = np.empty(len(start), dtype=np.complex128)
        crossed = self.base_side.take(start)
        length, apex = self.length.take(crossed), self.apex.take(crossed)
        p, q = left[: len(start)], right[: len(start)]
        np.multiply(1.0 - apex, length, out=p)
        np.multiply(-apex, length, out=q)
        filled = len(start)
        for step, going in enumerate([*n_active[1:].tolist(), 0], start=1):
            entered = self.twin.take(crossed)
            corner = q - p
            corner *= self.apex.take(entered)
            corner += p
            end[going : len(corner)] = corner[going:]
            p, q, corner, entered = p[:going], q[:going], corner[:going], entered[:going]
            crossed = self.base_side.take(start[:going] + step)
            onward = crossed - entered
            if ((crossed // 3 != entered // 3) | (onward == 0)).any():
                raise SolveError("a chain of crossings leaves the strip of faces that it runs through")
            keeps_right = (onward == 1) | (onward == -2)
            rows = slice(filled, filled + going)
            left[rows], right[rows] = np.where(keeps_right, corner, p), np.where(keeps_right, q, corner)
            p, q, filled = left[rows], right[rows], rows.stop
        return right, left, end


def _apex(mesh: TriangleMesh) -> NDArray[np.complex128]:
    """(3m,) the corner opposite each side, in the frame where the side runs from 0 to 1."""
    apex = np.empty((mesh.n_faces, 3), dtype=np.complex128)
    for faces, side in unit_side_blocks(mesh):
        normal = cross(side[:, 0], side[:, 2])
        doubled_area = np.sqrt(dot(normal, normal))
        for k in range(3):
            squared = dot(side[:, k], side[:, k])
            squared[squared == 0.0] = 1.0
            apex.real[faces, k] = -dot(side[:, k], side[:, k - 1]) / squared
            apex.imag[faces, k] = doubled_area / squared
    return apex.ravel()


def in_order(share: NDArray, label: NDArray, edges: BaseEdges) -> NDArray[np.float64]:
    """Shares along base sides, sorted where rounding contradicts the order of the integers.

    Parameters
    ----------
    share : (x,) ndarray of float64
        Position on the crossed base side, seen from the first side of the edge.
    label : (x,) ndarray of int64
        Labels of all crossings of some base edges: see `BaseEdges.label`.
    edges : BaseEdges

    Returns
    -------
    (x,) ndarray of float64
    """
    one = np.arange(len(edges.reverse)) < edges.reverse  # of the two chains of an edge
    present = np.zeros(len(one), dtype=bool)
    present[label >> STEP_BITS + 1] = True
    length = np.where(one & (present | present[edges.reverse]), edges.length, 0)
    first = np.cumsum(length) - length
    first = np.where(one, first + length - 1, ~first[edges.reverse])
    line_blocks = [slice(begin, begin + BLOCK_SIZE) for begin in range(0, len(label), BLOCK_SIZE)]

    def places(block: slice) -> tuple[NDArray, NDArray]:
        """Positions of crossings from the tail of `one` on, and True where it runs to their left."""
        mark = label[block]
        end = first.take(mark >> STEP_BITS + 1)
        along_one = end >= 0
        step = mark & STEP_MASK
        return np.where(along_one, end - step, ~end + step), along_one == ((mark >> STEP_BITS) & 1 == 0)

    ordered = np.empty_like(share)
    for block in line_blocks:
        place, forward = places(block)
        ordered[place] = np.where(forward, share[block], 1.0 - share[block])
    falls = ordered[1:] < ordered[:-1]
    falls[np.cumsum(length[length > 0])[:-1] - 1] = False
    if not falls.any():
        return share
    ordered = ordered[np.lexsort((ordered, np.repeat(np.arange(len(length)), length)))]
    for block in line_blocks:
        place, forward = places(block)
        along = ordered.take(place)
        share[block] = np.where(forward, along, 1.0 - along)
    return share
