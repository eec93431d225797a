"""Points carried backwards by a flow, along straightest geodesics, and the velocity they meet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.crossing import VERTEX_TOLERANCE
from ddgcli.algorithms.tracing.lines import BOUNDARY_STATUS, LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.crossings import crossed_faces
from ddgcli.models.fluid.surface_space import SurfaceSpace

MAX_LEGS = 100  # of a line along walls, about one for each boundary side
LEAST_REST = 1e-12  # of a line, in cells, down to which it continues


@dataclass(frozen=True, eq=False)
class BackwardPaths:
    """k points after a step backwards.

    Parameters
    ----------
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray
    shift : (k,) ndarray of complex
        From the start to the end, unfolded along the way, in the planar frame of the start's face.
    turn : (k,) ndarray of complex
        Takes vectors at the end back in parallel to the frame of the start's face.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    shift: NDArray[np.complex128]
    turn: NDArray[np.complex128]


class Transport:
    """A surface prepared for tracing points by velocities that are linear in every face.

    At walls the rest of a line runs along them; where fluid crosses the boundary the line ends.

    A velocity has a slope of its own in every face. Points in faces take that of their face, vertices the
    mean of the faces around them: lines from vertices do not depend on the order of the faces.
    """

    def __init__(self, space: SurfaceSpace) -> None:
        self.space = space
        self.tracer = Tracer(space.mesh)
        self.longest_side = space.mesh.side_length.max(axis=1)
        self.crossed = crossed_faces(space)
        self.slope = 1j * space.side[:, NEXT] / (2.0 * space.area[:, None])  # of the barycentric coordinates
        around = sum_by_index(space.faces, np.repeat(space.area, 3), space.n)
        self.area_around = np.where(around > 0, around, 1.0)
        self.unit = space.side.ravel() / np.abs(space.side.ravel())

    def corners(self, side_flux: NDArray) -> NDArray[np.complex128]:
        """(m, 3) velocity at the corners of every face, in its planar frame."""
        return self.space.recovery.smooth_at_corners(side_flux)

    def backwards(self, corner: NDArray, face: NDArray, barycentric: NDArray, dt: float) -> BackwardPaths:
        """Points carried by -dt along straight lines, by the velocity half-way that the local slope gives."""
        at = corner[face]
        here = row_dot(barycentric, at)
        along = (here[:, None] * np.conj(self.slope[face])).real
        velocity = here - 0.5 * dt * row_dot(along, at)
        speed = np.abs(velocity)
        away = -np.copysign(1.0, dt) * velocity
        direction = np.where(speed > 0, away / np.where(speed > 0, speed, 1.0), 1.0 + 0.0j)
        return self._carried(face, barycentric, direction, speed, dt)

    def vertices_backwards(self, corner: NDArray, vertices: NDArray, dt: float) -> BackwardPaths:
        """Vertices carried by -dt; `shift` and `turn` refer to the frames of vertices, those of `recovery`.

        Parameters
        ----------
        corner : (m, 3) ndarray of complex
            As `corners` returns it.
        vertices : (k,) ndarray of int64
            Those without faces stay somewhere.
        dt : float

        Returns
        -------
        BackwardPaths
        """
        fans, to_vertex = self.tracer.fans, self.space.recovery.to_vertex.ravel()
        fan = self.fan_of_vertex[vertices]
        first = fans.corner[fans.start[fan]]
        here = to_vertex[first] * corner.ravel()[first]
        velocity = here - 0.5 * dt * self._change_along(corner, here, vertices)
        start, direction = self._faces_along(fan, -np.copysign(1.0, dt) * velocity)
        paths = self._carried(start // 3, np.eye(3)[start % 3], direction, np.abs(velocity), dt)
        return BackwardPaths(
            paths.face, paths.barycentric, to_vertex[start] * paths.shift, to_vertex[start] * paths.turn
        )

    def _change_along(self, corner: NDArray, direction: NDArray, vertices: NDArray) -> NDArray[np.complex128]:
        """(k,) change of the velocity along directions at vertices, by the mean slope of their faces."""
        space, to_vertex = self.space, self.space.recovery.to_vertex
        # in a face: linear * direction + antilinear * conj(direction)
        linear = 0.5 * (corner * np.conj(self.slope)).sum(axis=1)[:, None]
        antilinear = 0.5 * (corner * self.slope).sum(axis=1)[:, None] * to_vertex**2
        area, around = space.area[:, None], self.area_around[vertices]
        linear, antilinear = (
            sum_by_index(space.faces, area * np.broadcast_to(of_corner, to_vertex.shape), space.n)[vertices]
            for of_corner in (linear, antilinear)
        )
        return (linear * direction + antilinear * np.conj(direction)) / around

    def _faces_along(self, fan: NDArray, away: NDArray) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
        """Corners into which vectors in the frames of vertices point, and directions in their faces.

        Out of the surface they start from the nearer boundary side.
        """
        fans = self.tracer.fans
        total, is_open = fans.total_angle[fan], fans.is_open[fan]
        middle = np.where(is_open, 0.5 * total, np.pi)
        angle = middle + (np.angle(away) - middle + np.pi) % (2.0 * np.pi) - np.pi
        angle *= np.where(is_open, 1.0, total / (2.0 * np.pi))
        corner = fans.locate(fan, angle)
        return corner, self.unit[corner] * np.exp(1j * (angle - fans.angle_before[corner]))

    @cached_property
    def fan_of_vertex(self) -> NDArray[np.int64]:
        """(n,) one for each vertex, 0 for vertices without faces."""
        fans, fan = self.tracer.fans, np.zeros(self.space.n, dtype=np.int64)
        fan[fans.vertex] = np.arange(len(fans.vertex))
        return fan

    def _carried(
        self, face: NDArray, barycentric: NDArray, direction: NDArray, speed: NDArray, dt: float
    ) -> BackwardPaths:
        """Points carried along lines of a length speed * dt, at walls along these."""
        planar = direction.view(np.float64).reshape(-1, 2)
        paths, rest, at_end = self._line(LineStart(face, barycentric, planar, speed * abs(dt)))
        crossed = self.crossed[0 if dt > 0 else 1]  # lines run against the flow, to where it entered
        for _ in range(MAX_LEGS):
            # lines with a rest, as where the boundary ended them
            has_rest = rest > LEAST_REST * self.longest_side[paths.face]
            active = np.flatnonzero(has_rest & ~crossed[paths.face])
            if not len(active):
                break
            start, turn = self._along_wall(
                paths.face[active], paths.barycentric[active], at_end[active], rest[active]
            )
            leg, rest[active], at_end[active] = self._line(start)
            paths.face[active], paths.barycentric[active] = leg.face, leg.barycentric
            paths.turn[active] *= turn
            paths.shift[active] += paths.turn[active] * leg.shift
            paths.turn[active] *= leg.turn
        return paths

    def _line(self, start: LineStart) -> tuple[BackwardPaths, NDArray[np.float64], NDArray[np.complex128]]:
        """Straight lines, what the boundary leaves of their lengths, and the directions at their ends."""
        ended = self.tracer.trace_checked(start)
        direction, at_end = (d[:, 0] + 1j * d[:, 1] for d in (start.direction, ended.direction))
        turn = direction * np.conj(at_end)
        shift = (ended.length * direction).astype(np.complex128)
        paths = BackwardPaths(ended.face, ended.barycentric, shift, turn)
        return paths, np.where(ended.status == BOUNDARY_STATUS, start.length - ended.length, 0.0), at_end

    def _along_wall(
        self, face: NDArray, barycentric: NDArray, direction: NDArray, rest: NDArray
    ) -> tuple[LineStart, NDArray[np.complex128]]:
        """Lines that continue along the sides at which they ended, from vertices along the nearer side.

        With what turns vectors of the frames in which they start into those of the faces where they ended.
        """
        space, side = self.space, np.array(NEXT)[np.argmin(barycentric, axis=1)]  # opposite the corner
        along = space.side[face, side] / np.abs(space.side[face, side])
        cosine = (direction * np.conj(along)).real
        at_vertex = np.partition(barycentric, 1, axis=1)[:, 1] <= VERTEX_TOLERANCE
        slides = ~at_vertex & (space.mesh.topology.side_twin[face, side] < 0)
        direction = np.where(slides, np.copysign(1.0, cosine) * along, direction)
        length = np.where(slides, np.abs(cosine), 1.0) * rest
        turn = np.ones(len(face), dtype=np.complex128)
        vertex = np.flatnonzero(at_vertex)
        corner = 3 * face[vertex] + np.argmax(barycentric[vertex], axis=1)
        corner, direction[vertex], share, turn[vertex] = self._from_vertices(corner, direction[vertex])
        face, barycentric = np.array(face), np.array(barycentric)
        face[vertex], barycentric[vertex] = corner // 3, np.eye(3)[corner % 3]
        length[vertex] *= share
        start = LineStart(face, barycentric, np.stack([direction.real, direction.imag], axis=1), length)
        return start, turn

    def _from_vertices(self, corner: NDArray, direction: NDArray) -> tuple[NDArray, ...]:
        """Directions at vertices, those that leave the surface along the nearer boundary side.

        Returns corners of these vertices, directions in their faces, the cosine of the angle between old and
        new (0 where both sides lead back), and what turns vectors in these faces into those before.
        """
        fans = self.tracer.fans
        fan = fans.fan[corner]
        here = fans.angle_of(corner, np.angle(direction * np.conj(self.unit[corner])))
        total = fans.total_angle[fan]
        outside = fans.is_open[fan] & ((here < 0.0) | (here > total))
        nearer = np.where(np.cos(here - total) > np.cos(here), total, 0.0)
        target = np.where(outside, nearer, here)
        corner = np.where(outside, fans.locate(fan, target), corner)
        along = self.unit[corner] * np.exp(-1j * fans.angle_before[corner])
        share = np.where(outside, np.maximum(np.cos(here - target), 0.0), 1.0)
        return corner, along * np.exp(1j * target), share, direction * np.conj(along * np.exp(1j * here))

    def end_velocity(self, corner: NDArray, carried: BackwardPaths) -> NDArray[np.complex128]:
        """(k,) velocity at the ends, in the frames of the starts' faces."""
        return carried.turn * row_dot(carried.barycentric, corner[carried.face])
