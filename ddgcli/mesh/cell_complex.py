"""Tetrahedra under local changes: which cells meet at a vertex, while cells are replaced."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.tet_mesh import FLAT_POSITION_TOLERANCE, TetMesh, relative_volume

Cell = tuple[int, int, int, int]


class CellComplex:
    """Tetrahedra that are replaced one by one; each keeps its index, new ones have further indices.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    tetrahedra : (k, 4) ndarray of int64
        No cell names a vertex twice.

    Attributes
    ----------
    points : (n, 3) ndarray of float64
    removed : set of int
        Indices of the cells that are replaced.
    merged : dict of int to int
        Vertices that no longer exist, and the vertices in their place.
    """

    def __init__(self, points: NDArray, tetrahedra: NDArray) -> None:
        self.points, self._input = points, tetrahedra
        self._new: list[Cell] = []
        self._origin: list[int] = []
        flat = tetrahedra.ravel()
        self._by_vertex = np.argsort(flat, kind="stable") // 4
        self._start = list_starts(np.bincount(flat, minlength=len(points)))
        self._star: dict[int, set[int]] = {}
        self.removed: set[int] = set()
        self.merged: dict[int, int] = {}

    def corners(self, cell: int) -> Cell:
        """Corners of a cell.

        Parameters
        ----------
        cell : int

        Returns
        -------
        tuple of int
        """
        if cell >= len(self._input):
            return self._new[cell - len(self._input)]
        a, b, c, d = self._input[cell].tolist()
        return a, b, c, d

    def around(self, *vertices: int) -> set[int]:
        """Cells that have all of some vertices.

        Parameters
        ----------
        *vertices : int

        Returns
        -------
        set of int
        """
        return set.intersection(*(self._star_of(v) for v in vertices))

    def near(self, cell: int) -> set[int]:
        """Cells that have a vertex of a cell, that cell among them.

        Parameters
        ----------
        cell : int

        Returns
        -------
        set of int
        """
        return set.union(*(self._star_of(v) for v in self.corners(cell)))

    def _star_of(self, vertex: int) -> set[int]:
        if vertex not in self._star:
            cells = self._by_vertex[self._start[vertex] : self._start[vertex + 1]]
            self._star[vertex] = set(cells.tolist())
        return self._star[vertex]

    def shapes(self, cells: Sequence[Cell]) -> NDArray[np.float64]:
        """Signed volumes of cells over their longest edges cubed.

        Parameters
        ----------
        cells : sequence of tuple of int

        Returns
        -------
        (m,) ndarray of float64
        """
        return relative_volume(self.points[np.array(cells, dtype=np.int64).reshape(-1, 4)])

    def volumes(self, cells: Sequence[Cell]) -> NDArray[np.float64]:
        """Signed volumes of cells.

        Parameters
        ----------
        cells : sequence of tuple of int

        Returns
        -------
        (m,) ndarray of float64
        """
        return TetMesh(self.points, np.array(cells, dtype=np.int64).reshape(-1, 4)).signed_volume

    def flat(self, cells: Iterable[int]) -> list[int]:
        """Those of some cells that are flat, in ascending order.

        Parameters
        ----------
        cells : iterable of int

        Returns
        -------
        list of int
        """
        ordered = sorted(cells)
        shape = self.shapes([self.corners(cell) for cell in ordered])
        return [
            cell for cell, value in zip(ordered, shape.tolist()) if not abs(value) > FLAT_POSITION_TOLERANCE
        ]

    def replace(self, old: Sequence[int], new: Sequence[Cell]) -> list[int]:
        """Replace cells, and return the indices of the new ones.

        A new cell comes from that of the old ones with volume whose centroid is nearest.

        Parameters
        ----------
        old : sequence of int
        new : sequence of tuple of int

        Returns
        -------
        list of int
        """
        first = len(self._input) + len(self._new)
        if new:
            flat = set(self.flat(old))
            sources = [cell for cell in old if cell not in flat] or list(old)
            center = self.points[np.array([self.corners(cell) for cell in sources])].mean(axis=1)
            place = self.points[np.array(new)].mean(axis=1)
            nearest = ((place[:, None] - center[None]) ** 2).sum(axis=2).argmin(axis=1)
            self._origin += [self.origin(sources[k]) for k in nearest.tolist()]
        self._new += new
        added = list(range(first, first + len(new)))
        self._exchange(old, added)
        return added

    def restore(self, old: Sequence[int], added: Sequence[int]) -> None:
        """Undo `replace`.

        Parameters
        ----------
        old, added : sequence of int
        """
        self._exchange(added, old)

    def _exchange(self, old: Sequence[int], new: Sequence[int]) -> None:
        for cell in old:
            for vertex in self.corners(cell):
                self._star_of(vertex).discard(cell)
        self.removed.update(old)
        for cell in new:
            for vertex in self.corners(cell):
                self._star_of(vertex).add(cell)
        self.removed.difference_update(new)

    def origin(self, cell: int) -> int:
        """Input cell that a cell comes from.

        Parameters
        ----------
        cell : int

        Returns
        -------
        int
        """
        return cell if cell < len(self._input) else self._origin[cell - len(self._input)]

    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cells that are left, (k, 4) corners, and the input cell of each; new cells come last.

        Returns
        -------
        corners : (k, 4) ndarray of int64
        origin : (k,) ndarray of int64
        """
        corners = np.concatenate([self._input, np.array(self._new, dtype=np.int64).reshape(-1, 4)])
        origin = np.concatenate([np.arange(len(self._input)), np.array(self._origin, dtype=np.int64)])
        is_left = np.ones(len(corners), dtype=bool)
        is_left[list(self.removed)] = False
        return corners[is_left], origin[is_left]
