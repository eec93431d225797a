"""Velocities that walls, and streams through the boundary, prescribe at the vertices there.

Frames and pressures take them in place of what is recovered from the flow: that is extrapolated to the
boundary, without the layers that are thinner than a cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import row_cross, tangential, unit_vectors
from ddgcli.models.fluid.boundary_motion import rest_kind, velocity_at
from ddgcli.models.fluid.effect_parts import BoundaryPart


class BoundaryVelocity:
    """Prescribed velocities at the vertices of the boundary of a surface or a volume.

    A wall has the part along itself, a stream that within the surface. Where two sections meet the vertex has
    their mean, but that of the walls beside a stream; beside a wall of free slip a stream has a speed along
    the wall that nothing prescribes.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    points : (n, 3) ndarray of float64
    ends : (b, d) ndarray of int64
        Vertices of the boundary sides (d = 2) or faces (d = 3).
    outward : (b, 3) ndarray of float64
        Out of the surface or the volume, as long as the sides or faces are large [m, m^2].
    owner : (b,) ndarray of int64
        Index of the section of each, len(sections) for the rest.
    along : (b, 3) ndarray of float64, optional
        The sides of a surface [m].
    """

    def __init__(
        self,
        sections: Sequence[BoundaryPart],
        points: NDArray[np.float64],
        ends: NDArray[np.int64],
        outward: NDArray[np.float64],
        owner: NDArray[np.int64],
        along: NDArray[np.float64] | None = None,
    ) -> None:
        self.points = points
        every = [*sections, BoundaryPart(rest_kind(sections))]
        is_wall = np.array([section.kind in ("no-slip", "wall") for section in every])
        is_stream = ~is_wall & np.array([section.velocity is not None for section in every])
        on_section = np.zeros((len(every), len(points)), dtype=bool)
        for number in range(len(every)):
            on_section[number, ends[owner == number]] = True
        only_streams = ~on_section[~is_stream].any(axis=0)
        self.groups = []
        for number in np.flatnonzero(is_wall | is_stream).tolist():
            vertices = np.flatnonzero(on_section[number] & (is_wall[number] | only_streams))
            own = owner == number

            def unit(vectors: NDArray, own: NDArray = own, vertices: NDArray = vertices) -> NDArray:
                summed = np.repeat(vectors[own, None], ends.shape[1], axis=1)
                return unit_vectors(sum_by_index(ends[own], summed, len(points))[vertices])

            across = unit(outward)
            if along is None:
                lost = [across] if is_wall[number] else []
            else:
                tangent = unit(along)
                normal = unit_vectors(row_cross(tangent, across))
                lost = [normal, row_cross(normal, tangent)] if is_wall[number] else [normal]
            self.groups.append((every[number], vertices, lost))

    def at(self, time: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Vertices (k,) and their velocities (k, 3) [m/s] at a time [s].

        Without the vertices where an expression has no value: the flow meets it inside the sides only.
        """
        total, count = np.zeros_like(self.points), np.zeros(len(self.points))
        for section, vertices, lost in self.groups:
            velocity = np.zeros((len(vertices), 3))
            if section.velocity is not None:
                try:
                    velocity = velocity_at(section, self.points[vertices], time)
                except ValueError:
                    continue
            for direction in lost:
                velocity = tangential(velocity, direction)
            total[vertices] += velocity
            count[vertices] += 1.0
        vertices = np.flatnonzero(count)
        return vertices, total[vertices] / count[vertices, None]
