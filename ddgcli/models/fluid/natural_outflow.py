"""Sides of a surface through which fluid leaves at constant pressure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index


class NaturalOutflow:
    """Boundary sides whose fluxes are free.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sides : (s, 2) ndarray of int64
        Tail and head of every side, the surface on the left.
    vertices : (n,) ndarray of bool
        Vertices whose stream function is free: those between two of the sides.
    """

    def __init__(self, mesh: SurfaceMesh, sides: NDArray[np.int64], vertices: NDArray[np.bool_]) -> None:
        topology, self.vertices = mesh.topology, vertices
        self.tail, self.head = sides.T
        self.edge = edge_indices(topology.edges, sides)
        self.sign = np.where(topology.edges[self.edge, 0] == self.tail, 1.0, -1.0)
        length = np.zeros(topology.n_edges)
        length[topology.side_edge] = mesh.side_length
        self.length = length[self.edge]

    def speed(self, edge_flux: NDArray[np.float64]) -> NDArray[np.float64]:
        """(s,) speed [m/s] at which fluid leaves through every side, of fluxes (e,) through the edges."""
        return self.sign * edge_flux[self.edge] / self.length

    def head_rates(
        self, edge_flux: NDArray[np.float64], harmonic: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rates of vorticity (n,) and of harmonic coefficients (b,) by the kinetic head |u|^2 / 2.

        The pressure is constant; where fluid enters, the total head is, so that no energy does (directional
        do-nothing condition: M. Braack and P. B. Mucha, 2014).
        """
        n = len(self.vertices)
        pressure = 0.5 * np.maximum(self.speed(edge_flux), 0.0) ** 2
        vorticity = sum_by_index(self.tail, pressure, n) - sum_by_index(self.head, pressure, n)
        inner = np.where(self.vertices, vorticity, 0.0)  # at the ends the flux is prescribed
        return inner, -(harmonic[:, self.edge] @ (self.sign * pressure))
