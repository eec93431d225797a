"""Vorticity along walls with friction, as pressure needs it: of the flow there, without its swing.

On irregular triangles the vorticity at a wall swings from vertex to vertex, by a share that no finer mesh
lessens, about values whose mean along the wall is right. The velocities of frames (`vertex_velocity`) have a
vorticity that converges, with an error of one sign. This takes the latter, and of the difference of the two
what is smooth along the wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.surface_space import SurfaceSpace

SMOOTHING_PASSES = 8  # of the difference along the wall, each over the neighbours of a vertex
FIT_RANK_TOLERANCE = 1e-4  # relative: directions in which the faces around a vertex do not spread


class WallVorticity:
    """Vorticity at the boundary of a surface with the swing between neighbours smoothed.

    Parameters
    ----------
    space : SurfaceSpace
    context : FluidContext
    slip : (n,) ndarray of bool, optional
        Vertices of free-slip walls, where the vorticity is zero.
    """

    def __init__(self, space: SurfaceSpace, context: FluidContext, slip: NDArray | None) -> None:
        self.space = space
        on_wall = space.mesh.topology.boundary_vertex & (True if slip is None else ~slip)
        self.vertices = np.flatnonzero(on_wall)
        self.fit = _linear_fits(space, context, self.vertices)
        self.slope = 1j * space.side[:, NEXT] / (2.0 * space.area[:, None])
        face, k, ends = space.boundary_sides
        inner = on_wall[ends].all(axis=1)  # of the walls with friction
        self.ends = ends[inner]
        half = np.repeat(0.5 * space.mesh.side_length[face, k][inner, None], 2, axis=1)
        self.length = sum_by_index(self.ends, half, space.n)
        self.conductance = 0.25 * self.length[self.ends].min(axis=1)

    def smoothed(self, omega: NDArray, side_flux: NDArray, time: float) -> NDArray[np.float64]:
        """(n,) the vorticity [1/s] with that at the walls replaced.

        Parameters
        ----------
        omega : (n,) ndarray of float64
            Of the flow.
        side_flux : (m, 3) ndarray of float64
            Of the flow.
        time : float
            Of what the boundary prescribes.
        """
        corner = self.space.vertex_velocity.at_corners(side_flux, time)
        recovered = omega.copy()
        recovered[self.vertices] = self.fit @ (np.conj(self.slope) * corner).imag.sum(axis=1)
        difference = omega - recovered
        first, second = self.ends.T
        for _ in range(SMOOTHING_PASSES):  # sums over lengths stay as they are
            flow = self.conductance * (difference[second] - difference[first])
            change = sum_by_index(self.ends, np.stack([flow, -flow], axis=1), self.space.n)
            difference += np.divide(change, self.length, out=np.zeros_like(change), where=self.length > 0)
        return recovered + difference


def _linear_fits(space: SurfaceSpace, context: FluidContext, vertices: NDArray[np.int64]) -> csr_array:
    """(k, m) values at vertices of linear functions that fit values (m,) of the faces within three rings."""
    m, k = len(space.faces), len(vertices)
    ones, face = np.ones(3 * m), np.repeat(np.arange(m), 3)
    touches = csr_array((ones, (space.faces.ravel(), face)), shape=(space.n, m))
    beside = touches @ touches.T
    row, face = (touches[vertices] @ touches.T @ beside @ touches).nonzero()
    apart = context.unwrapped(context.face_points()[face] - context.points[vertices[row]])
    count = np.maximum(np.bincount(row, minlength=k), 1)
    size = np.sqrt(sum_by_index(row, row_dot(apart, apart), k) / count)
    terms = np.column_stack([np.ones(len(row)), apart / size[row, None]])
    weighted = terms * space.area[face, None]
    moment = np.zeros((k, 4, 4))
    for i in range(4):
        for j in range(4):
            moment[:, i, j] = sum_by_index(row, weighted[:, i] * terms[:, j], k)
    solved = np.linalg.pinv(moment, rcond=FIT_RANK_TOLERANCE, hermitian=True)[:, 0]
    return csr_array((row_dot(solved[row], weighted), (row, face)), shape=(k, m))
