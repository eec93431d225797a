"""Velocities that walls, and streams through the boundary, prescribe at the vertices there.

Frames and pressures take them in place of what is recovered from the flow: that is extrapolated to the
boundary, without the layers that are thinner than a cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import unit_vectors
from ddgcli.models.fluid.boundary_motion import rest_kind, velocity_at
from ddgcli.models.fluid.effect_parts import BoundaryPart


class BoundaryVelocity:
    """Prescribed velocities at the vertices of the boundary of a surface or a volume.

    A wall has the part along itself. Where two sections meet the vertex has their mean, but that of the walls
    beside a stream; beside a wall of free slip a stream has a speed along the wall that nothing prescribes.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    points : (n, 3) ndarray of float64
    ends : (b, d) ndarray of int64
        Vertices of the boundary sides (d = 2) or faces (d = 3).
    direction : (b, 3) ndarray of float64
        Along the sides of a surface, out of the faces of a volume; as long as they are large.
    owner : (b,) ndarray of int64
        Number of the section of each, len(sections) for the rest.
    """

    def __init__(
        self,
        sections: Sequence[BoundaryPart],
        points: NDArray[np.float64],
        ends: NDArray[np.int64],
        direction: NDArray[np.float64],
        owner: NDArray[np.int64],
    ) -> None:
        self.points, self.is_surface = points, ends.shape[1] == 2
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
            summed = np.repeat(direction[own, None], ends.shape[1], axis=1)
            unit = unit_vectors(sum_by_index(ends[own], summed, len(points))[vertices])
            self.groups.append((every[number], vertices, unit if is_wall[number] else None))

    def at(self, time: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Vertices (k,) and their velocities (k, 3) [m/s] at a time [s].

        Without the vertices where an expression has no value: the flow meets it inside the sides only.
        """
        total, count = np.zeros_like(self.points), np.zeros(len(self.points))
        for section, vertices, direction in self.groups:
            velocity = np.zeros((len(vertices), 3))
            if section.velocity is not None:
                try:
                    velocity = velocity_at(section, self.points[vertices], time)
                except ValueError:
                    continue
            if direction is not None:
                share = np.einsum("ia,ia->i", velocity, direction)[:, None] * direction
                velocity = share if self.is_surface else velocity - share
            total[vertices] += velocity
            count[vertices] += 1.0
        vertices = np.flatnonzero(count)
        return vertices, total[vertices] / count[vertices, None]
