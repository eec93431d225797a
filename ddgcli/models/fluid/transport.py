"""Points carried backwards by a flow, along straightest geodesics, and the velocity they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.recovery import recovery
from ddgcli.models.fluid.surface_space import SurfaceSpace


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
    """A surface prepared for tracing points by velocities that are linear in every face."""

    def __init__(self, space: SurfaceSpace) -> None:
        self.space = space
        self.tracer = Tracer(space.mesh)
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
        ended = self.tracer.trace_checked(LineStart(face, barycentric, planar, speed * abs(dt)))
        end_direction = ended.direction[:, 0] + 1j * ended.direction[:, 1]
        shift = (ended.length * direction).astype(np.complex128)
        return BackwardPaths(ended.face, ended.barycentric, shift, direction * np.conj(end_direction))

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
