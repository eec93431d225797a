"""The quadratic energy of isometric bending: its Hessian is constant, made of a reference surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import hinge_constant
from ddgcli.geometry.hinges import hinge_cotans
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.hinges import Hinges


@dataclass(frozen=True, eq=False)
class QuadraticEnergy:
    """Sum over inner edges of |sum c_i x_i|^2 / (4 (A1 + A2)), plus the constant of the hinge energy.

    Parameters
    ----------
    reference : TriangleMesh
        The coefficients c and the areas A are its own, whatever the positions x.

    Notes
    -----
    M. Bergou, M. Wardetzky, D. Harmon, D. Zorin, E. Grinspun, "A quadratic bending model for inextensible
    surfaces", 2006: an edge's sum c_i x_i is the Laplacian of x against the edge's non-conforming hat
    function, of length 2 |e| sin(theta / 2) where the surface is isometric to the reference. There the sum is
    that of the hinge energy with 2 sin(theta / 2) in place of theta, and approximates what that does.
    """

    reference: TriangleMesh

    @cached_property
    def _hinges(self) -> Hinges:
        return Hinges.of(self.reference.topology)

    @cached_property
    def _coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """(h, 4) c, (h,) 1 / (4 (A1 + A2)), and the constant."""
        topology = self.reference.topology
        both = face_area(self.reference.side_length)[self._hinges.face].sum(axis=1)
        weight = np.divide(0.25, both, out=np.zeros_like(both), where=both > 0)
        constant = hinge_constant(topology.euler_characteristic, topology.is_closed)
        return hinge_cotans(self.reference), weight, constant

    def _bent(self, points: NDArray) -> NDArray[np.float64]:
        return np.einsum("hi,hij->hj", self._coefficients[0], points[self._hinges.vertex])

    def value(self, points: NDArray) -> float:
        """Energy; NaN on a surface of another number of vertices."""
        if len(points) != self.reference.n_vertices:
            return math.nan
        _, weight, constant = self._coefficients
        return float(np.sum(weight[:, None] * self._bent(points) ** 2)) + constant

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        cotan, weight, constant = self._coefficients
        curvature = self._bent(points)
        pull = weight[:, None] * curvature
        gradient = sum_by_index(self._hinges.vertex, 2.0 * cotan[:, :, None] * pull[:, None], len(points))
        return float(np.sum(pull * curvature)) + constant, gradient
