"""Points carried by a flow through tetrahedra, along straight lines that slide on walls.

Where fluid crosses the boundary they end.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.tet_mesh import TET_FACES
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.volume_space import VolumeSpace

MAX_CROSSINGS = 4000  # cells that one line may cross; the line ends there
MAX_STALLS = 100  # crossings one after another without progress, as between two walls; the line ends there
WEIGHT_ROUNDING = 1e-12  # barycentric coordinate up to which a point lies on the face
STALL_SHARE = 1e-9  # progress over the length of the whole shift


class VolumePaths:
    """Neighbours of every cell, ready for tracing."""

    def __init__(self, space: VolumeSpace) -> None:
        self.space = space
        flat = space.cell_face.ravel()
        order = np.argsort(flat, kind="stable")
        paired = flat[order[1:]] == flat[order[:-1]]
        a, b = order[:-1][paired], order[1:][paired]
        beyond = np.full(space.cell_face.size, -1, dtype=np.int64)
        beyond[a], beyond[b] = b // 4, a // 4
        self.neighbour = beyond.reshape(-1, 4)
        crossed = np.zeros(space.n_faces, dtype=bool)
        if space.conditions is not None:
            crossed = space.conditions.crossed
        self.crossed = crossed[space.cell_face]
        self.cell_of_vertex = np.zeros(space.n, dtype=np.int64)
        self.cell_of_vertex[space.cells.ravel()] = np.repeat(np.arange(len(space.cells)), 4)

    def barycentric(self, cell: NDArray, points: NDArray) -> NDArray[np.float64]:
        """(p, 4) coordinates of points in cells."""
        apart = points - self.space.centre[cell]
        return 0.25 + np.einsum("pia,pa->pi", self.space.slope[cell], apart)

    def interpolated(self, values: NDArray, cell: NDArray, points: NDArray) -> NDArray[np.float64]:
        """Values of a function that is linear in every cell, by its values (n, ...) at the vertices."""
        return np.einsum("pi,pi...->p...", self.barycentric(cell, points), values[self.space.cells[cell]])

    def moved(self, cell: NDArray, points: NDArray, shift: NDArray) -> tuple[NDArray[np.int64], NDArray]:
        """Cells and positions after straight shifts (p, 3); the rest of one runs along the wall it meets."""
        cell, points, shift = np.array(cell), np.array(points), np.array(shift)
        active = np.arange(len(cell))
        least = STALL_SHARE * np.linalg.norm(shift, axis=1)
        stalls = np.zeros(len(cell), dtype=np.int64)
        for _ in range(MAX_CROSSINGS):
            here, step = cell[active], shift[active]
            weight = self.barycentric(here, points[active])
            weight = np.where(weight > WEIGHT_ROUNDING, weight, 0.0)
            fall = -np.einsum("pia,pa->pi", self.space.slope[here], step)
            reach = np.divide(weight, fall, out=np.full_like(weight, np.inf), where=fall > 1e-14)
            exit_ = self._first_exit(here, reach, fall)
            share = np.minimum(reach[np.arange(len(active)), exit_], 1.0)
            points[active] += share[:, None] * step
            rest = (1.0 - share)[:, None] * step
            inside = share >= 1.0
            beyond = self.neighbour[here, exit_]
            cell[active] = np.where(inside | (beyond < 0), here, beyond)
            wall = ~inside & (beyond < 0)
            if wall.any():
                normal = self.space.area[here[wall], exit_[wall]]
                normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
                out = np.maximum(row_dot(rest[wall], normal), 0.0)
                rest[wall] -= out[:, None] * normal
                rest[wall & self.crossed[here, exit_]] = 0.0
            shift[active] = rest
            progress = share * np.sqrt(row_dot(step, step))
            stalls[active] = np.where(progress > least[active], 0, stalls[active] + 1)
            active = active[~inside & (np.abs(rest).max(axis=1) > 0) & (stalls[active] < MAX_STALLS)]
            if not len(active):
                break
        return cell, points

    def _first_exit(self, cell: NDArray, reach: NDArray, fall: NDArray) -> NDArray[np.int64]:
        """(p,) faces that shifts reach first; at edges and vertices the one that they cross most steeply.

        `fall` (p, 4) is how fast the barycentric coordinates fall, over the heights of the cells a length.
        """
        first = reach <= reach.min(axis=1, keepdims=True)
        return np.argmax(np.where(first, fall * self._height[cell], -np.inf), axis=1)

    def carried(self, vertex_velocity: NDArray, cell: NDArray, points: NDArray, dt: float) -> tuple:
        """Cells and positions after -dt in a velocity linear in every cell: midpoint rule."""
        first = self.interpolated(vertex_velocity, cell, points)
        middle = self.moved(cell, points, -0.5 * dt * first)
        return self.moved(cell, points, -dt * self.interpolated(vertex_velocity, *middle))

    def vertices_carried(
        self, vertex_velocity: NDArray, vertices: NDArray, dt: float
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Cells and positions of vertices after -dt, as `carried` has them; whatever the order of the cells.

        Parameters
        ----------
        vertex_velocity : (n, 3) ndarray
        vertices : (k,) ndarray of int64
            Those without cells stay somewhere.
        dt : float

        Returns
        -------
        cell : (k,) ndarray of int64
        points : (k, 3) ndarray of float64
        """
        points = np.asarray(self.space.mesh.points)[vertices]
        shift = -0.5 * dt * vertex_velocity[vertices]
        middle = self.moved(self._cells_along(vertices, shift), points, shift)
        shift = -dt * self.interpolated(vertex_velocity, *middle)
        return self.moved(self._cells_along(vertices, shift), points, shift)

    def _cells_along(self, vertices: NDArray, shift: NDArray) -> NDArray[np.int64]:
        """(k,) cells of vertices in which shifts (k, 3) start.

        Inside of the fluid any cell of the vertex leads into the right one. At walls a shift that leads out
        slides along the first wall that it meets: there the cell is the one out of which it leads least.
        """
        space, corner = self.space, self._boundary_corners
        here, by_vertex = space.cells.ravel()[corner], np.zeros((space.n, 3))
        by_vertex[vertices] = shift
        inward = np.einsum("cia,ca->ci", self._inward[corner // 4], by_vertex[here])
        inward[np.arange(len(corner)), corner % 4] = np.inf  # the face opposite the vertex
        order = np.lexsort((inward.min(axis=1), here))
        cell = np.array(self.cell_of_vertex)
        cell[here[order]] = corner[order] // 4  # the last of a vertex stays
        return cell[vertices]

    @cached_property
    def _height(self) -> NDArray[np.float64]:
        """(m, 4) heights of the corners above the faces opposite."""
        return 1.0 / np.linalg.norm(self.space.slope, axis=2)

    @cached_property
    def _inward(self) -> NDArray[np.float64]:
        """(m, 4, 3) unit normals of the faces into the cell."""
        return self.space.slope * self._height[:, :, None]

    @cached_property
    def _boundary_corners(self) -> NDArray[np.int64]:
        """Corners, as 4 cell + corner, of the vertices at the boundary."""
        space = self.space
        cell, face = space.boundary
        at_boundary = np.zeros(space.n, dtype=bool)
        at_boundary[space.cells[cell[:, None], TET_FACES[face]]] = True
        return np.flatnonzero(at_boundary[space.cells])
