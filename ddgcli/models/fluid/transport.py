"""Points carried backwards by a flow, along straightest geodesics, and the velocity they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.lines import BOUNDARY_STATUS, LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.crossings import crossed_faces
from ddgcli.models.fluid.recovery import recovery
from ddgcli.models.fluid.surface_space import SurfaceSpace

MAX_LEGS = 100  # of a line along walls, about one for each boundary side
LEAST_REST = 1e-12  # of a line, in cells, down to which it continues
WALL_DISTANCE = 1e-7  # from the wall, in cells or in lengths of the rest, at which it does
VERTEX_DISTANCE = 1e-9  # in cells, within which a line ends at a vertex


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
    """

    def __init__(self, space: SurfaceSpace) -> None:
        self.space = space
        self.tracer = Tracer(space.mesh)
        self.longest_side = space.mesh.side_length.max(axis=1)
        self.crossed = crossed_faces(space)
        fit = recovery(space)
        self.matrix, self.to_face = fit.matrix, np.conj(fit.to_vertex)
        self.slope = 1j * space.side[:, NEXT] / (2.0 * space.area[:, None])  # of the barycentric coordinates

    def corners(self, side_flux: NDArray) -> NDArray[np.complex128]:
        """(m, 3) velocity at the corners of every face, in its planar frame."""
        return (self.matrix @ side_flux.ravel())[self.space.faces] * self.to_face

    def backwards(self, corner: NDArray, face: NDArray, barycentric: NDArray, dt: float) -> BackwardPaths:
        """Points carried by -dt along straight lines, by the velocity half-way that the local slope gives."""
        at = corner[face]
        start = np.einsum("ij,ij->i", barycentric, at)
        along = (start[:, None] * np.conj(self.slope[face])).real
        velocity = start - 0.5 * dt * np.einsum("ij,ij->i", along, at)
        speed = np.abs(velocity)
        away = -np.copysign(1.0, dt) * velocity
        direction = np.where(speed > 0, away / np.where(speed > 0, speed, 1.0), 1.0 + 0.0j)
        planar = direction.view(np.float64).reshape(-1, 2)
        paths, rest, at_end = self._line(LineStart(face, barycentric, planar, speed * abs(dt)))
        crossed = self.crossed[0 if dt > 0 else 1]  # lines run against the flow, to where it entered
        for _ in range(MAX_LEGS):
            # lines with a rest, as where the boundary ended them
            has_rest = rest > LEAST_REST * self.longest_side[paths.face]
            active = np.flatnonzero(has_rest & ~crossed[paths.face])
            if not len(active):
                break
            leg, rest[active], at_end[active] = self._line(
                self._along_wall(paths.face[active], paths.barycentric[active], at_end[active], rest[active])
            )
            paths.face[active], paths.barycentric[active] = leg.face, leg.barycentric
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
    ) -> LineStart:
        """Lines that continue along the sides at which they ended; from vertices as before."""
        space, side = self.space, np.array(NEXT)[np.argmin(barycentric, axis=1)]  # opposite the corner
        along = space.side[face, side] / np.abs(space.side[face, side])
        cosine = (direction * np.conj(along)).real
        slides = np.partition(barycentric, 1, axis=1)[:, 1] > VERTEX_DISTANCE
        slides &= space.mesh.topology.side_twin[face, side] < 0
        direction = np.where(slides, np.copysign(1.0, cosine) * along, direction)
        length = np.where(slides, np.abs(cosine), 1.0) * rest
        distance = (WALL_DISTANCE * np.minimum(1.0, rest / self.longest_side[face]))[:, None]
        inside = barycentric + distance * (1.0 / 3.0 - barycentric)
        return LineStart(face, inside, np.stack([direction.real, direction.imag], axis=1), length)

    def end_velocity(self, corner: NDArray, carried: BackwardPaths) -> NDArray[np.complex128]:
        """(k,) velocity at the ends, in the frames of the starts' faces."""
        return carried.turn * np.einsum("ij,ij->i", carried.barycentric, corner[carried.face])


def corner_of(space: SurfaceSpace, vertices: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """One face at each vertex, and the corner of the vertex in it.

    Parameters
    ----------
    space : SurfaceSpace
    vertices : (k,) ndarray of int64

    Returns
    -------
    face, corner : (k,) ndarray of int64
    """
    flat = np.full(space.n, -1, dtype=np.int64)
    flat[space.faces.ravel()] = np.arange(space.faces.size)
    return flat[vertices] // 3, flat[vertices] % 3
