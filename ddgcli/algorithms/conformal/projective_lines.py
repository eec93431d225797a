"""Crossings of Ptolemy-flipped edges with the edges of the triangulation before the flips.

Both triangulations are ideal ones of one hyperbolic surface, and their edges geodesics, straight in every
face (in Klein's model, the circumdisk). Where the geodesic from a to b crosses the edge from i to j,

    share of j : share of i = l_ai l_bi : l_aj l_bj,    share of b : share of a = l_ai l_aj : l_bi l_bj,

in barycentric coordinates of the plain lengths, with the lengths l of the diagonals of the strip of faces
under the geodesic, which follow from Ptolemy's relation one after the other: sums of products of positive
numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.sides import next_side, previous_side


def projective_lines_over(
    base: SurfaceMesh, base_side: NDArray, count: NDArray, length: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Positions where geodesics cross the edges of a triangulation; arguments and result as for `lines_over`.

    Parameters
    ----------
    base : TriangleMesh or IntrinsicMesh
    base_side : (x,) ndarray of int64
        The base sides crossed, from right to left, edge after edge.
    count : (k,) ndarray of int64
        Crossings of each edge, at least 1.
    length : (k,) ndarray of float64
        Plain lengths of the edges.

    Returns
    -------
    along, share : (x,) ndarray of float64
        Barycentric coordinates of the heads, on the edges and on the base sides, under plain lengths.
    residual : float
        Largest relative difference between an edge's length and that by the relations in its strip.
    """
    along, share = np.empty((2, len(base_side)))
    if len(count) == 0:
        return along, share, 0.0
    strips = _Strips(base, base_side)
    order = np.argsort(-count, kind="stable")
    start = (np.cumsum(count) - count)[order]
    count = count[order]
    from_tail, end = strips.forward(start, count)
    from_head = strips.backward(start, count)
    at_right, at_left = from_tail[:, 0] * from_head[:, 0], from_tail[:, 1] * from_head[:, 1]
    share = at_right / (at_right + at_left)
    near, far = from_tail[:, 0] * from_tail[:, 1], from_head[:, 0] * from_head[:, 1]
    along = near / (near + far)
    residual = np.abs(end - length[order]) / length[order]
    return along, share, float(residual.max())


class _Strips:
    """Lengths of the diagonals of strips of faces from one end of the line to the ends of crossed sides.

    Parameters
    ----------
    base : TriangleMesh or IntrinsicMesh
    base_side : (x,) ndarray of int64
    """

    def __init__(self, base: SurfaceMesh, base_side: NDArray) -> None:
        self.side = base_side
        self.twin = base.topology.side_twin.ravel()
        self.length = base.side_length.ravel()

    def forward(self, start: NDArray, count: NDArray) -> tuple[NDArray, NDArray]:
        """(x, 2) lengths from the tail to the right and left end of each crossed side, and to the head."""
        from_tail = np.empty((len(self.side), 2))
        end = np.empty(len(start))
        first = self.side[start]
        right, left = self.length[previous_side(first)], self.length[next_side(first)]
        n_active = len(start)
        for step in range(int(count[0])):
            at = start[:n_active] + step
            right, left = right[:n_active], left[:n_active]
            from_tail[at, 0], from_tail[at, 1] = right, left
            side = self.side[at]
            entered = self.twin[side]  # runs from left to right
            to_right, to_left = self.length[next_side(entered)], self.length[previous_side(entered)]
            corner = (left * to_right + right * to_left) / self.length[side]
            going = int(np.searchsorted(-count[:n_active], -(step + 1), side="left"))
            end[going:n_active] = corner[going:]
            n_active = going
            keeps_right = self.side[start[:n_active] + step + 1] == next_side(entered[:n_active])
            right, left = (
                np.where(keeps_right, right[:n_active], corner[:n_active]),
                np.where(keeps_right, corner[:n_active], left[:n_active]),
            )
        return from_tail, end

    def backward(self, start: NDArray, count: NDArray) -> NDArray[np.float64]:
        """(x, 2) lengths from the head to the right and left end of each crossed side."""
        from_head = np.empty((len(self.side), 2))
        last = start + count - 1
        entered = self.twin[self.side[last]]
        right, left = self.length[next_side(entered)], self.length[previous_side(entered)]
        n_active = len(start)
        for step in range(int(count[0])):
            at = last[:n_active] - step
            right, left = right[:n_active], left[:n_active]
            from_head[at, 0], from_head[at, 1] = right, left
            n_active = int(np.searchsorted(-count[:n_active], -(step + 1), side="left"))
            side, right, left = self.side[at[:n_active]], right[:n_active], left[:n_active]
            to_right, to_left = self.length[previous_side(side)], self.length[next_side(side)]
            corner = (left * to_right + right * to_left) / self.length[side]
            came_through = self.twin[self.side[at[:n_active] - 1]]
            keeps_right = side == next_side(came_through)
            right, left = np.where(keeps_right, right, corner), np.where(keeps_right, corner, left)
        return from_head
