"""The hinge energy: squared dihedral angles, weighted, with its exact gradient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import hinge_bending
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.models.willmore.hinges import Hinges
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
    def _hinges(self) -> Hinges:
        return Hinges.of(self.topology)

    def value(self, points: NDArray) -> float:
        """Energy; not finite where an angle is undefined."""
        faces = FaceSides.at(points, self.topology.faces)
        shape = self._hinges.bent(points).shape
        area = faces.area[self._hinges.face].sum(axis=1)
        terms, constant = self._bending(shape.length**2, shape.angle, area)
        return float(terms.sum()) + constant

    def _bending(self, squared: NDArray, angle: NDArray, area: NDArray) -> tuple[NDArray[np.float64], float]:
        return hinge_bending(
            squared, angle, area, self.topology.euler_characteristic, self.topology.is_closed
        )

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        corners, n = self.topology.faces, self.topology.n_vertices
        faces = FaceSides.at(points, corners)
        hinges = self._hinges.bent(points)
        length, angle = hinges.shape.length, hinges.shape.angle
        total = faces.area[self._hinges.face].sum(axis=1)
        terms, constant = self._bending(length**2, angle, total)
        gradient = hinges.gradient(0.5 * length**2 * angle / total, 0.5 * length * angle**2 / total)
        by_area = sum_by_index(self._hinges.face.ravel(), np.repeat(-terms / total, 2), len(corners))
        gradient += sum_by_index(corners, by_area[:, None, None] * area_gradient(faces), n)
        return float(terms.sum()) + constant, gradient
