"""Distances of points inside faces, from the windows that cross their faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.dominance import DOMINANCE_TOLERANCE, reaching
from ddgcli.algorithms.geodesics.exact.pool import WindowOrigins
from ddgcli.algorithms.geodesics.exact.tables import SideTables
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.ragged import ranges


class WindowTargets:
    """Upper bounds of the distances of points on faces, in the scale of the tables.

    Parameters
    ----------
    tables : SideTables
    points : SurfacePoints
        Checked.
    """

    def __init__(self, tables: SideTables, points: SurfacePoints) -> None:
        self.tables, self.points = tables, points
        self.order = np.argsort(points.face, kind="stable")
        self.face = points.face[self.order]
        self.distance = np.full(len(points), np.inf)
        self.origin = np.full(len(points), -1, dtype=np.int64)

    @property
    def faces(self) -> NDArray[np.bool_]:
        """(m,) True for faces with targets."""
        with_targets = np.zeros(len(self.tables.shape) // 3, dtype=bool)
        with_targets[self.face] = True
        return with_targets

    def update(self, lines: NDArray, where: NDArray, origins: WindowOrigins) -> None:
        """Lower distances by windows that cross their faces: columns as in `WindowPool`."""
        row, target = self._inside(where[0] // 3)
        if not len(row):
            return
        lines, (side, origin) = lines[:4].take(row, axis=1), where[:2].take(row, axis=1)
        x, y = self._place(side, target)
        dx, dy = x - lines[2], y - lines[3]
        reached = reaching(lines[2] - dx * lines[3] / dy, lines, dx, dy)
        self._lower(
            target[reached],
            (origins.distance.take(origin) + np.sqrt(dx * dx + dy * dy))[reached],
            origin[reached],
        )

    def update_by_strips(self, lines: NDArray, where: NDArray) -> None:
        """Lower distances by strips that cross their faces: columns as in `propagate_strips`."""
        row, target = self._inside(where[0] // 3)
        if not len(row):
            return
        (b0, b1, ux, uy, c), (side, origin) = lines.take(row, axis=1), where[:2].take(row, axis=1)
        x, y = self._place(side, target)
        at = x - y * ux / uy
        reached = (at >= b0 - DOMINANCE_TOLERANCE) & (at <= b1 + DOMINANCE_TOLERANCE)
        self._lower(target[reached], (c + ux * x + uy * y)[reached], origin[reached])

    def update_from_point(self, face: int, weights: NDArray, origin: int) -> None:
        """Lower distances in a face by a source point in the same face."""
        side, target = np.array([3 * face]), self.order[self.face == face]
        length, ax, ay = self.tables.shape[3 * face, :3]
        x, y = self._place(side.repeat(len(target)), target)
        from_x, from_y = weights[1] * length + weights[2] * ax, weights[2] * ay
        self._lower(target, np.hypot(x - from_x, y - from_y), np.full(len(target), origin))

    def finish(self, distance: NDArray, origin: NDArray) -> None:
        """Lower distances by paths through the corners of the faces, whose distances are final."""
        target = self.order
        for j in range(3):
            side = 3 * self.face + j
            x, y = self._place(side, target)
            corner = self.tables.ids[side, 0]
            self._lower(target, distance[corner] + np.hypot(x, y), origin[corner])

    def _inside(self, face: NDArray) -> tuple[NDArray, NDArray]:
        """(row of `face`, target) for every target in each face."""
        start = np.searchsorted(self.face, face)
        count = np.searchsorted(self.face, face, side="right") - start
        return np.arange(len(face)).repeat(count), self.order[ranges(start, count)[0]]

    def _place(self, side: NDArray, target: NDArray) -> tuple[NDArray, NDArray]:
        """Coordinates of each target in the frame of a side of its face."""
        length, ax, ay = self.tables.shape.take(side, axis=0)[:, :3].T
        j, weights = side % 3, self.points.barycentric
        apex = weights[target, (j + 2) % 3]
        return weights[target, (j + 1) % 3] * length + apex * ax, apex * ay

    def _lower(self, target: NDArray, distance: NDArray, origin: NDArray) -> None:
        better = distance < self.distance[target]
        target, distance, origin = target[better], distance[better], origin[better]
        np.minimum.at(self.distance, target, distance)
        won = distance == self.distance[target]
        self.origin[target[won]] = origin[won]
