"""Faces of a surface with components first, so that every pass reads contiguous memory.

Gathering rows of (n, 3) points costs ten times as much as gathering three columns; all curvature kernels read
these arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import angle_of, cross, dot, ratio

# faces at once where only sums remain: larger blocks take more memory, smaller ones more time
FACES_PER_BLOCK = 1 << 17
# arrays that remain of blocks, as most callers read them later; sides, products and angles do not
REMAINING = ("squared_length", "doubled", "area", "flat", "normal", "cotan")


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
    def of(cls, mesh: TriangleMesh, unit: float = 1.0) -> Faces:
        """Faces of a mesh, with positions in multiples of `unit`."""
        return cls(np.ascontiguousarray(mesh.faces.T), np.ascontiguousarray(mesh.points.T / unit))

    @property
    def n_vertices(self) -> int:
        return self.points.shape[1]

    def store(self, **arrays: NDArray) -> None:
        """Set derived quantities that the caller has computed, by their names."""
        self.__dict__.update(arrays)

    def blocks(self) -> Iterator[tuple[slice, Faces]]:
        """Slices of the faces, and the faces there; the whole itself where it is small."""
        m = self.corner.shape[1]
        if m <= FACES_PER_BLOCK:
            yield slice(0, m), self
            return
        for begin in range(0, m, FACES_PER_BLOCK):
            rows = slice(begin, min(begin + FACES_PER_BLOCK, m))
            block = Faces(self.corner[:, rows], self.points)
            block.store(
                **{name: self.__dict__[name][..., rows] for name in REMAINING if name in self.__dict__}
            )
            yield rows, block

    def vertex_sums(self, *terms: Callable[[Faces], NDArray]) -> list[NDArray[np.float64]]:
        """(..., n) sums at the vertices of each term: its corner values (..., 3, k) of a block of k faces.

        Terms of one call share what they derive from a block; of that, the arrays in `REMAINING` are stored.
        """
        n, m = self.n_vertices, self.corner.shape[1]
        totals: list[NDArray[np.float64]] = []
        remaining: dict[str, NDArray] = {}
        for rows, block in self.blocks():
            for k, term in enumerate(terms):
                value = term(block)
                if k == len(totals):
                    totals.append(np.zeros((*value.shape[:-2], n)))
                columns = value.reshape(-1, *value.shape[-2:])
                for sums, by_corner in zip(totals[k].reshape(-1, n), columns):
                    for corner, column in zip(block.corner, by_corner):
                        np.add.at(sums, corner, column)
            for name in REMAINING:
                if name in block.__dict__ and name not in self.__dict__:
                    array = block.__dict__[name]
                    whole = remaining.setdefault(name, np.empty((*array.shape[:-1], m), array.dtype))
                    whole[..., rows] = array
        self.store(**remaining)
        return totals

    def at_corners(self, columns: NDArray) -> NDArray[np.float64]:
        """(3, d, m) values of (d, n) vertex arrays at the corners."""
        return np.stack([[np.take(column, c) for column in columns] for c in self.corner])

    def stars(self, values: NDArray) -> NDArray[np.float64]:
        """(d, n) sums over the stars of vertices of (d, m) face values."""
        n = self.n_vertices
        return np.stack([sum(sum_by_index(c, value, n) for c in self.corner) for value in values])

    def side_vectors(self, j: NDArray, face: NDArray) -> NDArray[np.float64]:
        """(3, k) vectors of sides j of some faces."""
        return self.points[:, self.corner[NEXT[j], face]] - self.points[:, self.corner[j, face]]

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
        return _rows(dot(s, s) for s in self.side)

    @property
    def length(self) -> NDArray[np.float64]:
        """(3, m) of each side."""
        return np.sqrt(self.squared_length)

    @cached_property
    def mean_length(self) -> float:
        """Mean over all sides."""
        return float(np.mean([np.sqrt(row).mean() for row in self.squared_length]))

    @cached_property
    def sorted_coordinates(self) -> NDArray[np.float64]:
        """(3, n) coordinates of all vertices, each axis in ascending order."""
        return np.sort(self.points, axis=1)

    @cached_property
    def doubled(self) -> NDArray[np.float64]:
        """(3, m) normal times twice the area; for needles from the two shortest sides, which rounds least."""
        product = cross(self.side[0], self.side[1])
        squared = self.squared_length
        longest = np.maximum(np.maximum(squared[0], squared[1]), squared[2])
        with np.errstate(over="ignore"):  # if squares overflow, no face counts as a needle
            needles = np.flatnonzero(dot(product, product) < 1e-3 * longest * longest)
        for j in range(2):  # side 2 is not among the factors above
            where = needles[squared[j, needles] == longest[needles]]
            a, b = self.side[NEXT[j]][:, where], self.side[PREVIOUS[j]][:, where]
            product[:, where] = cross(a, b)
        return product

    @property
    def on_corners(self) -> NDArray[np.float64]:
        """(3, 3, m) `doubled` at each corner, for sums over stars; component first."""
        return np.broadcast_to(self.doubled[:, None, :], (3, *self.corner.shape))

    @cached_property
    def doubled_area(self) -> NDArray[np.float64]:
        """(m,) twice the area of each face; infinite above the floating-point range."""
        if "area" in self.__dict__:
            return 2.0 * self.area
        with np.errstate(over="ignore"):
            return np.sqrt(dot(self.doubled, self.doubled))

    @cached_property
    def doubled_star(self) -> NDArray[np.float64]:
        """(3, n) sum of `doubled` over the star of each vertex."""
        return self.vertex_sums(lambda block: block.on_corners)[0]

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
        normal = ratio(self.doubled, self.doubled_area)
        normal[:, self.flat] = 0.0
        return normal

    @cached_property
    def dot(self) -> NDArray[np.float64]:
        """(3, m) scalar product of the two sides that leave corner k."""
        return _rows(-dot(self.side[k], self.side[PREVIOUS[k]]) for k in range(3))

    @cached_property
    def cotan(self) -> NDArray[np.float64]:
        """(3, m) cotangent of the angle at corner k; 0 in flat faces, which then do not contribute."""
        area = np.where(self.flat, 0.0, self.doubled_area)
        return _rows(ratio(d, area) for d in self.dot)

    @cached_property
    def angle(self) -> NDArray[np.float64]:
        """(3, m) angle at corner k, in radians; they sum to pi in every face.

        A face with a side of no length has two right angles at that side's ends (the limit of an isosceles
        needle); a face that is a point has three equal ones.
        """
        angle = _rows(angle_of(self.doubled_area, d) for d in self.dot)
        a, b, c = self.squared_length
        bad = np.flatnonzero(np.minimum(np.minimum(a, b), c) == 0)
        if len(bad):
            none = self.squared_length[:, bad] == 0
            angle[:, bad] = np.where(none | none[PREVIOUS], np.pi / 2, 0.0)
            angle[:, bad[none.all(axis=0)]] = np.pi / 3
        return angle


def _rows(rows: Iterator[NDArray]) -> NDArray[np.float64]:
    """(3, m) array of three rows, each copied while it is in the cache, as `np.stack` does not."""
    first = next(rows)
    result = np.empty((3, len(first)))
    result[0] = first
    for k, row in enumerate(rows, start=1):
        result[k] = row
    return result
