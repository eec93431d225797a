"""Velocities at the vertices of a surface: recovered from the flow, and prescribed by the boundary."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.boundary_velocity import BoundaryVelocity
from ddgcli.models.fluid.recovery import Recovery
from ddgcli.operators.averages import cells_to_vertices


class VertexVelocity:
    """Velocities at vertices, for frames and pressures.

    Parameters
    ----------
    recovery : Recovery
    area : (m,) ndarray of float64
        Of the faces.
    to_space : callable, optional
        Turns vectors in planar frames (m,) into vectors in space (m, 3); `in_space` needs it.
    prescribed : BoundaryVelocity, optional
        What stands at vertices of the boundary in place of what is recovered there.
    """

    def __init__(
        self,
        recovery: Recovery,
        area: NDArray[np.float64],
        to_space: Callable[[NDArray], NDArray] | None,
        prescribed: BoundaryVelocity | None,
    ) -> None:
        self.recovery, self.area, self.to_space, self.prescribed = recovery, area, to_space, prescribed

    def in_space(self, side_flux: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """(n, 3) of fluxes (m, 3) through the sides of the faces, at a time [s]."""
        planar, (x, y) = self.recovery.matrix @ side_flux.ravel(), self.axes
        velocity = planar.real[:, None] * x + planar.imag[:, None] * y
        if self.prescribed is not None:
            vertices, there = self.prescribed.at(time)
            velocity[vertices] = there
        return velocity

    def at_corners(self, side_flux: NDArray[np.float64], time: float) -> NDArray[np.complex128]:
        """(m, 3) of fluxes (m, 3) through the sides, in the planar frames of the faces, at a time [s]."""
        planar = self.recovery.matrix @ side_flux.ravel()
        if self.prescribed is not None:
            vertices, there = self.prescribed.at(time)
            x, y = (row_dot(there, axis[vertices]) for axis in self.axes)
            planar[vertices] = x + 1j * y
        return planar[self.recovery.faces] * np.conj(self.recovery.to_vertex)

    def squared_speed(self, side_flux: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """(n,) of fluxes (m, 3) through the sides of the faces, at a time [s]."""
        squared = np.abs(self.recovery.matrix @ side_flux.ravel()) ** 2
        if self.prescribed is not None:
            vertices, there = self.prescribed.at(time)
            squared[vertices] = row_dot(there, there)
        return squared

    @cached_property
    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Axes (n, 3) in space of the frames of `recovery`: means over the faces of a vertex, by area."""
        to_space, faces = self.to_space, self.recovery.faces
        if to_space is None:
            raise ValueError("vectors in space need to_space")
        turned = np.conj(self.recovery.to_vertex)

        def mean(of_corners: NDArray) -> NDArray[np.float64]:
            rows = np.stack([to_space(v) for v in of_corners.T], axis=1)  # (m, 3, 3)
            return cells_to_vertices(faces, self.area, rows, self.recovery.matrix.shape[0])

        return mean(turned), mean(1j * turned)
