"""Faces of a surface with components first, so that every pass reads contiguous memory.

Gathering rows of (n, 3) points costs ten times as much as gathering three columns; all curvature kernels read
these arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import cross, dot, ratio


@dataclass(frozen=True, eq=False)
class Faces:
    """Corners and positions of a triangle surface, with the quantities derived from them.

    Parameters
    ----------
    corner : (3, m) ndarray of int64
        Vertex at corner k.
    points : (3, n) ndarray of float64
    """

    corner: NDArray[np.int64]
    points: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: TriangleMesh) -> Faces:
        return cls(np.ascontiguousarray(mesh.faces.T), np.ascontiguousarray(mesh.points.T))

    @property
    def n_vertices(self) -> int:
        return self.points.shape[1]

    def at_corners(self, columns: NDArray) -> NDArray[np.float64]:
        """(3, d, m) values of (d, n) vertex arrays at the corners."""
        return np.stack([[np.take(column, c) for column in columns] for c in self.corner])

    def at_vertices(self, values: NDArray) -> NDArray[np.float64]:
        """(..., n) sums at vertices of (..., 3, m) corner values."""
        rows = values.reshape(-1, *self.corner.shape)
        n = self.n_vertices
        total = np.zeros((len(rows), n))
        for sums, row in zip(total, rows):
            for c, value in zip(self.corner, row):
                sums += sum_by_index(c, value, n)
        return total.reshape(*values.shape[:-2], n)

    def stars(self, values: NDArray) -> NDArray[np.float64]:
        """(d, n) sums over the stars of vertices of (d, m) face values."""
        n = self.n_vertices
        return np.stack([sum(sum_by_index(c, value, n) for c in self.corner) for value in values])

    @cached_property
    def side(self) -> NDArray[np.float64]:
        """(3, 3, m) vector (second axis) of side j (first axis), from corner j to corner j + 1."""
        side = np.zeros((3, *self.corner.shape))
        for i, column in enumerate(self.points):
            a, b, c = (np.take(column, corner) for corner in self.corner)
            np.subtract(b, a, out=side[0, i])
            np.subtract(c, b, out=side[1, i])
            np.subtract(a, c, out=side[2, i])
        return side

    @cached_property
    def squared_length(self) -> NDArray[np.float64]:
        """(3, m) of each side."""
        return np.stack([dot(s, s) for s in self.side])

    @cached_property
    def length(self) -> NDArray[np.float64]:
        """(3, m) of each side."""
        return np.sqrt(self.squared_length)

    @cached_property
    def doubled(self) -> NDArray[np.float64]:
        """(3, m) normal times twice the area; for needles from the two shortest sides, which rounds least."""
        product = cross(self.side[0], self.side[1])
        squared = self.squared_length
        longest = np.maximum(np.maximum(squared[0], squared[1]), squared[2])
        with np.errstate(over="ignore"):  # above the range of numbers no face counts as a needle
            needles = np.flatnonzero(dot(product, product) < 1e-3 * longest * longest)
        for j in range(2):  # side 2 is not among the factors above
            where = needles[squared[j, needles] == longest[needles]]
            a, b = self.side[NEXT[j]][:, where], self.side[PREVIOUS[j]][:, where]
            product[:, where] = cross(a, b)
        return product

    @cached_property
    def doubled_area(self) -> NDArray[np.float64]:
        """(m,) twice the area of each face; infinite above the range of numbers."""
        with np.errstate(over="ignore"):
            return np.sqrt(dot(self.doubled, self.doubled))

    @cached_property
    def doubled_star(self) -> NDArray[np.float64]:
        """(3, n) sum of `doubled` over the star of each vertex."""
        return self.stars(self.doubled)

    @cached_property
    def area(self) -> NDArray[np.float64]:
        """(m,) area of each face."""
        return 0.5 * self.doubled_area

    @cached_property
    def flat(self) -> NDArray[np.bool_]:
        """(m,) faces whose area is rounding error: collinear or coincident corners."""
        a, b, c = self.squared_length
        return self.doubled_area <= 1e-14 * np.maximum(np.maximum(a, b), c)

    @cached_property
    def normal(self) -> NDArray[np.float64]:
        """(3, m) unit normals; zero where flat."""
        return np.where(self.flat, 0.0, ratio(self.doubled, self.doubled_area))

    @cached_property
    def dot(self) -> NDArray[np.float64]:
        """(3, m) scalar product of the two sides that leave corner k."""
        return np.stack([-dot(self.side[k], self.side[PREVIOUS[k]]) for k in range(3)])

    @cached_property
    def cotan(self) -> NDArray[np.float64]:
        """(3, m) cotangent of the angle at corner k; 0 in flat faces, which then do not contribute."""
        area = np.where(self.flat, 0.0, self.doubled_area)
        return np.stack([ratio(d, area) for d in self.dot])

    @cached_property
    def angle(self) -> NDArray[np.float64]:
        """(3, m) angle at corner k, in radians; they sum to pi in every face.

        A face with a side of no length has two right angles at that side's ends (the limit of an isosceles
        needle); a face that is a point has three equal ones.
        """
        angle = np.stack([np.arctan2(self.doubled_area, d) for d in self.dot])
        a, b, c = self.squared_length
        bad = np.flatnonzero(np.minimum(np.minimum(a, b), c) == 0)
        if len(bad):
            none = self.squared_length[:, bad] == 0
            angle[:, bad] = np.where(none | none[PREVIOUS], np.pi / 2, 0.0)
            angle[:, bad[none.all(axis=0)]] = np.pi / 3
        return angle
