"""The hinge energy: squared dihedral angles, weighted, with its exact gradient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import hinge_bending
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.models.willmore.vertex_energies import FaceSides, area_gradient


@dataclass(frozen=True, eq=False)
class HingeEnergy:
    """Sum over inner edges of |e|^2 theta^2 / (4 (A1 + A2)), plus a constant: `hinge_bending`.

    Parameters
    ----------
    topology : Topology

    Notes
    -----
    E. Grinspun et al., "Discrete shells", 2003. On other meshes than equilateral ones the sum is another
    quadratic form of the curvatures: it depends on the pattern of the mesh, however fine.
    """

    topology: Topology

    @cached_property
    def _hinges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(h, 2) faces and (h, 4) vertices of each inner edge: tail, head, apex of each face."""
        side = self.topology.interior_sides
        other = self.topology.side_twin.ravel()[side]
        flat = self.topology.faces.ravel()
        apex = np.stack([side - side % 3 + (side + 2) % 3, other - other % 3 + (other + 2) % 3], axis=1)
        vertices = np.stack(
            [
                self.topology.side_tail[side],
                self.topology.side_head[side],
                flat[apex[:, 0]],
                flat[apex[:, 1]],
            ],
            axis=1,
        )
        return np.stack([side // 3, other // 3], axis=1), vertices

    def value(self, points: NDArray) -> float:
        """Energy; not finite where an angle is undefined."""
        face, vertex = self._hinges
        faces = FaceSides.at(points, self.topology.faces)
        edge = points[vertex[:, 1]] - points[vertex[:, 0]]
        angle, squared = _angle(faces, face, edge), np.einsum("ij,ij->i", edge, edge)
        terms, constant = self._bending(squared, angle, faces.area[face].sum(axis=1))
        return float(terms.sum()) + constant

    def _bending(self, squared: NDArray, angle: NDArray, area: NDArray) -> tuple[NDArray[np.float64], float]:
        return hinge_bending(
            squared, angle, area, self.topology.euler_characteristic, self.topology.is_closed
        )

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        face, vertex = self._hinges
        corners, n = self.topology.faces, self.topology.n_vertices
        faces = FaceSides.at(points, corners)
        origin = points[vertex[:, 0]]
        edge = points[vertex[:, 1]] - origin
        angle, squared = _angle(faces, face, edge), np.einsum("ij,ij->i", edge, edge)
        area = faces.area[face]
        total = area.sum(axis=1)
        terms, constant = self._bending(squared, angle, total)

        # dtheta: each apex along its face's normal by 1/height; the ends balance force and moment
        length = np.sqrt(squared)
        by_apex = -faces.normal[face] * (0.5 * length[:, None] / area)[:, :, None]
        foot = np.einsum("hkj,hj->hk", points[vertex[:, 2:]] - origin[:, None], edge) / squared[:, None]
        by_head = -np.einsum("hk,hkj->hj", foot, by_apex)
        by_tail = -by_apex.sum(axis=1) - by_head
        weight = (0.5 * squared * angle / total)[:, None]
        stretch = (0.5 * angle**2 / total)[:, None] * edge
        local = np.stack(
            [weight * by_tail - stretch, weight * by_head + stretch,
             weight * by_apex[:, 0], weight * by_apex[:, 1]], axis=1
        )  # fmt: skip
        gradient = sum_by_index(vertex, local, n)
        by_area = sum_by_index(face.ravel(), np.repeat(-terms / total, 2), len(corners))
        gradient += sum_by_index(corners, by_area[:, None, None] * area_gradient(faces), n)
        return float(terms.sum()) + constant, gradient


def _angle(faces: FaceSides, face: NDArray, edge: NDArray) -> NDArray[np.float64]:
    """(h,) signed angle between the two faces' normals about the edge, positive where convex."""
    n0, n1 = faces.normal[face[:, 0]], faces.normal[face[:, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = edge / np.sqrt(np.einsum("ij,ij->i", edge, edge))[:, None]
    return np.arctan2(np.einsum("ij,ij->i", np.cross(n0, n1), unit), np.einsum("ij,ij->i", n0, n1))
