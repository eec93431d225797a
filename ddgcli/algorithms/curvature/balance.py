"""Balance laws of chapter 3, 1.4, that hold on every polyhedron.

The outward conormal eta over the boundary of a region D and the mean curvature vector H nu (sum of the
principal curvatures) inside it obey int eta = int H nu, int x cross eta = int x cross H nu, and
int x . eta = int (H nu . x + 2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.measures import BALANCE_DIRECTION
from ddgcli.geometry.extrinsic import EDGES_PER_BLOCK, EdgeBlock
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.vectors import cross, dot, ratio


class RegionBalance:
    """Sums of force, torque and area balance around a region of faces.

    On an edge H nu integrates to 2 |e| sin(theta / 2) against the mean of its two normals, which is computed
    here from the dihedral angle; the conormals come from the faces beside the region's boundary.

    Parameters
    ----------
    faces : Faces
    topology : Topology
        Oriented and manifold.
    normal : (3, m) ndarray of float64
        Unit normals, of flat faces too (`filled_normals`).
    region : (m,) ndarray of bool
        Faces of the region D.
    """

    def __init__(self, faces: Faces, topology: Topology, normal: NDArray, region: NDArray) -> None:
        self._region = region
        # signed and absolute sums of each component
        self._force, self._torque, self._area = np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 1))
        doubled = 2.0 * float(faces.area[region].sum())
        self._area[:, 0] = -doubled, doubled
        rim = self._rim(topology)
        for begin in range(0, len(rim), EDGES_PER_BLOCK):
            side = rim[begin : begin + EDGES_PER_BLOCK]
            tail = faces.points.take(topology.side_tail.take(side), axis=1)
            vector = faces.points.take(topology.side_head.take(side), axis=1) - tail
            self._add(tail + 0.5 * vector, cross(vector, normal.take(side // 3, axis=1)))

    def _rim(self, topology: Topology) -> NDArray[np.int64]:
        """Sides of the region's faces on its boundary."""
        side = np.flatnonzero(np.repeat(self._region, 3))
        twin = topology.side_twin.ravel().take(side)
        return side.compress(~((twin >= 0) & self._region.take(twin // 3, mode="clip")))

    def add(self, edges: EdgeBlock, angle: NDArray) -> None:
        """Add the curvature of the edges inside the region.

        Parameters
        ----------
        edges : EdgeBlock
        angle : (k,) ndarray of float64
            Their dihedral angles in radians, positive where convex.
        """
        inside = self._region.take(edges.side // 3) & self._region.take(edges.twin // 3)
        if not inside.any():
            return
        bisector, middle, length = edges.here + edges.beyond, edges.tail + 0.5 * edges.vector, edges.length
        if not inside.all():
            bisector, middle = bisector.compress(inside, axis=1), middle.compress(inside, axis=1)
            length, angle = length.compress(inside), angle.compress(inside)
        size = ratio(length, np.sqrt(dot(bisector, bisector)))  # of the bisector at unit length
        bisector *= 2.0 * size * np.sin(0.5 * angle)
        self._add(middle, bisector)

    def _add(self, position: NDArray, pull: NDArray) -> None:
        moments = (
            (self._torque, cross(position, pull)),
            (self._area, dot(position, pull)[None]),
            (self._force, pull),
        )
        for sums, terms in moments:
            sums[0] += terms.sum(axis=1)
            sums[1] += np.abs(terms, out=terms).sum(axis=1)

    def residuals(self) -> dict[str, float]:
        """`force`, `torque` and `area`: relative to the sum of the absolute values of the terms."""
        return {
            "force": _residual(self._force),
            "torque": _residual(self._torque),
            "area": _residual(self._area),
        }


def upper_half(faces: Faces) -> NDArray[np.bool_]:
    """Faces whose centroid is above the median height along `BALANCE_DIRECTION`.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (m,) ndarray of bool
    """
    at_vertex = BALANCE_DIRECTION @ faces.points
    height = at_vertex.take(faces.corner[0])
    for corner in faces.corner[1:]:
        height += at_vertex.take(corner)
    return height > np.median(height)


def _residual(sums: NDArray) -> float:
    """Largest component of a sum over that of the sum of absolute values; `sums` has both as rows."""
    total, scale = np.abs(sums[0]).max(), sums[1].max()
    return float(total / scale) if scale > 0 else 0.0


def star_balance(vector: NDArray, conormal: NDArray, link: NDArray, inside: NDArray) -> float:
    """Largest gap between the mean curvature vector of a star and the conormals of its link.

    Parameters
    ----------
    vector : (3, n) ndarray of float64
        As returned by `vector_of`.
    conormal : (n,) ndarray of float64
        Sums of `link_conormal` over the stars.
    link : (n,) ndarray of float64
        Sums of `link_length` over the stars.
    inside : (n,) ndarray of bool
        Where to compare.

    Returns
    -------
    float
        Along `BALANCE_DIRECTION`, relative to the length of the link.
    """
    gap = np.abs(4.0 * (BALANCE_DIRECTION @ vector) - conormal)
    return float(ratio(gap, link)[inside].max(initial=0.0))
