"""Dihedral angles at the inner edges, and how they change with the vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import hinge_sides, hinges
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.vectors import row_cross, row_dot
from ddgcli.models.willmore.vertex_energies import FaceSides


@dataclass(frozen=True, eq=False)
class Hinges:
    """The inner edges of a surface with their two faces.

    Parameters
    ----------
    face : (h, 2) ndarray of int
    vertex : (h, 4) ndarray of int
        Tail, head, apex of each face.
    """

    face: NDArray[np.int64]
    vertex: NDArray[np.int64]

    @classmethod
    def of(cls, topology: Topology) -> Hinges:
        """All inner edges."""
        side, other = hinge_sides(topology)
        return cls(np.stack([side // 3, other // 3], axis=1), hinges(topology))

    def bent(self, points: NDArray, faces: FaceSides) -> BentHinges:
        """Lengths and angles at given positions; `faces` are those of the same positions."""
        edge = points[self.vertex[:, 1]] - points[self.vertex[:, 0]]
        squared = row_dot(edge, edge)
        n0, n1 = faces.normal[self.face[:, 0]], faces.normal[self.face[:, 1]]
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = edge / np.sqrt(squared)[:, None]
        angle = np.arctan2(row_dot(row_cross(n0, n1), unit), row_dot(n0, n1))
        return BentHinges(self, points, faces, edge, squared, angle)


@dataclass(frozen=True, eq=False)
class BentHinges:
    """Hinges at given positions.

    Parameters
    ----------
    hinges : Hinges
    points : (n, 3) ndarray
    faces : FaceSides
    edge : (h, 3) ndarray
        From tail to head.
    squared : (h,) ndarray
        Squared lengths.
    angle : (h,) ndarray
        Signed angle between the normals of the two faces about the edge, positive where convex.
    """

    hinges: Hinges
    points: NDArray[np.float64]
    faces: FaceSides
    edge: NDArray[np.float64]
    squared: NDArray[np.float64]
    angle: NDArray[np.float64]

    def gradient(self, by_angle: NDArray, by_squared: NDArray) -> NDArray[np.float64]:
        """(n, 3) derivative by the points of a function of angles and squared lengths with these derivatives.

        Notes
        -----
        Each apex moves the angle along its face's normal by 1 / height; the ends balance force and moment.
        """
        face, vertex = self.hinges.face, self.hinges.vertex
        length, area = np.sqrt(self.squared), self.faces.area[face]
        by_apex = -self.faces.normal[face] * (0.5 * length[:, None] / area)[:, :, None]
        arm = self.points[vertex[:, 2:]] - self.points[vertex[:, 0]][:, None]
        foot_share = row_dot(arm, self.edge[:, None]) / self.squared[:, None]
        by_head = -np.einsum("hk,hkj->hj", foot_share, by_apex)
        by_tail = -by_apex.sum(axis=1) - by_head
        weight, stretch = by_angle[:, None], 2.0 * by_squared[:, None] * self.edge
        local = np.stack(
            [weight * by_tail - stretch, weight * by_head + stretch,
             weight * by_apex[:, 0], weight * by_apex[:, 1]], axis=1
        )  # fmt: skip
        return sum_by_index(vertex, local, len(self.points))
