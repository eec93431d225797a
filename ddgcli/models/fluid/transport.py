"""Points carried backwards by a flow, along straightest geodesics, and the velocity they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.trace import Tracer
from ddgcli.geometry.unfolding import face_corner_angle, vertex_fans
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.models.fluid.space import FlowSpace


@dataclass(frozen=True, eq=False)
class Carried:
    """k points after a step backwards.

    Parameters
    ----------
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray
    shift : (k,) ndarray of complex
        From the start to the end, unfolded along the way, in the planar frame of the start's face.
    velocity, sharp : (k,) ndarray of complex
        At the end, carried back in parallel to the frame of the start's face: continuous and smoothed, or
        with the slope of each face.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    shift: NDArray[np.complex128]
    velocity: NDArray[np.complex128]
    sharp: NDArray[np.complex128]


class Transport:
    """A surface made ready for carrying points: centres of faces, frames of vertices.

    A face's velocity is taken for that of its barycentre, where it is of second order. Continuously it is
    linear in the six triangles that barycentre, corners and middles of sides make of a face: at a vertex the
    mean over its faces (in the frame of its angles, stretched to a full turn), at the middle of a side
    between the two barycentres.
    """

    def __init__(self, space: FlowSpace) -> None:
        self.space = space
        self.tracer = Tracer(space.mesh)
        self.centre = np.full((len(space.faces), 3), 1.0 / 3.0)
        self.centre_position = space.corner.mean(axis=1)
        self._vertex_frames()
        self._side_frames()

    def _vertex_frames(self) -> None:
        """(m, 3) turns from a face's frame to the frames of its corners' vertices; weights of the mean."""
        space = self.space
        fans = vertex_fans(space.mesh)
        angle = face_corner_angle(space.mesh).ravel()
        total = fans.total_angle[fans.fan]
        stretch = np.where(fans.is_open[fans.fan], 1.0, 2.0 * np.pi / total)
        bisector = stretch * (fans.angle_before + 0.5 * angle)
        along = np.exp(1j * np.angle(space.side).ravel()) * np.exp(0.5j * angle)
        self.to_vertex = (np.exp(1j * bisector) / along).reshape(-1, 3)
        self.weight = (angle / total).reshape(-1, 3)

    def _side_frames(self) -> None:
        """(m, 3) turns from the neighbour's frame across side j, and the neighbour's share at its middle."""
        space = self.space
        twin = space.mesh.topology.side_twin
        side = space.side.ravel()
        other = np.maximum(twin, 0)
        self.neighbour = np.where(twin >= 0, other // 3, np.arange(len(twin))[:, None])
        turn = -space.side / side[other]
        self.from_neighbour = np.where(twin >= 0, turn / np.abs(turn), 1.0)
        middle = 0.5 * (space.corner + space.corner[:, NEXT])
        reach = np.abs(middle - self.centre_position[:, None])
        reach_other = reach.ravel()[other]
        total = reach + reach_other
        share = np.divide(reach, total, out=np.full_like(reach, 0.5), where=total > 0)
        self.share = np.where(twin >= 0, share, 0.0)

    # ------------------------------------------------------------------ velocity between the centres

    def nodes(self, velocity: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Face velocities (m,) as values at centres (m,), corners (m, 3) and middles of sides (m, 3)."""
        space = self.space
        local = self.weight * self.to_vertex * velocity[:, None]
        index = space.faces.ravel()
        mean = np.bincount(index, weights=local.real.ravel(), minlength=space.n) + 1j * np.bincount(
            index, weights=local.imag.ravel(), minlength=space.n
        )
        corner = mean[space.faces] * np.conj(self.to_vertex)
        across = self.from_neighbour * velocity[self.neighbour]
        middle = (1.0 - self.share) * velocity[:, None] + self.share * across
        return velocity, corner, middle

    def sample(
        self, nodes: tuple[NDArray, NDArray, NDArray], face: NDArray, barycentric: NDArray
    ) -> NDArray[np.complex128]:
        """(k,) velocity at surface points, in the planar frames of their faces."""
        at_centre, at_corner, at_middle = nodes
        far = np.argmin(barycentric, axis=1)
        row = np.arange(len(face))
        third = np.maximum(barycentric[row, far], 0.0)
        alpha = 3.0 * third
        a, b = NEXT[far], PREVIOUS[far]  # the sector of side a, which runs from corner a to corner b
        beta, gamma = barycentric[row, a] - third, barycentric[row, b] - third
        nearer = np.where(beta >= gamma, a, b)
        return (
            alpha * at_centre[face]
            + np.abs(beta - gamma) * at_corner[face, nearer]
            + 2.0 * np.minimum(beta, gamma) * at_middle[face, a]
        )

    def sample_linear(
        self, nodes: tuple[NDArray, NDArray, NDArray], face: NDArray, barycentric: NDArray
    ) -> NDArray[np.complex128]:
        """(k,) as `sample`, but linear in every face: its own velocity at the centre, the corners' slope."""
        at_centre, at_corner, _ = nodes
        away = barycentric - 1.0 / 3.0
        return at_centre[face] + np.einsum("ij,ij->i", away, at_corner[face])

    # ------------------------------------------------------------------ backwards

    def backwards(
        self,
        nodes: tuple[NDArray, NDArray, NDArray],
        face: NDArray,
        barycentric: NDArray,
        velocity: NDArray,
        dt: float,
    ) -> Carried:
        """Points carried by -dt: half a step for the velocity on the way, then the whole step with it."""
        half = self._walked(nodes, face, barycentric, velocity, 0.5 * dt)
        return self._walked(nodes, face, barycentric, half.velocity, dt)

    def _walked(
        self, nodes: tuple[NDArray, NDArray, NDArray], face: NDArray, barycentric: NDArray, velocity: NDArray,
        dt: float,
    ) -> Carried:  # fmt: skip
        speed = np.abs(velocity)
        direction = np.where(speed > 0, -velocity / np.where(speed > 0, speed, 1.0), 1.0 + 0.0j)
        ended = self.tracer.trace(
            face, barycentric, np.stack([direction.real, direction.imag], axis=1), speed * dt
        )
        end_direction = ended.direction[:, 0] + 1j * ended.direction[:, 1]
        back = direction * np.conj(end_direction)
        met = back * self.sample(nodes, ended.face, ended.barycentric)
        sharp = back * self.sample_linear(nodes, ended.face, ended.barycentric)
        shift = (ended.length * direction).astype(np.complex128)
        return Carried(ended.face, ended.barycentric, shift, met, sharp)
