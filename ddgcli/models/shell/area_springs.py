"""Area springs: each face resists a change of its area, in addition to the edge springs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import LinearOperator, Mode, Potential
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import cross_matrix, row_cross, row_dot


class AreaSprings(Potential):
    """Energy k A0 (A / A0 - 1)^2 / 2 per face; the stiffness k in N/m adds to the first Lame constant.

    The gradient of an area with respect to corner i is N x e_i / 2, with the unit normal N and the edge e_i
    opposite the corner.
    """

    name = "stretching"

    def __init__(self, faces: NDArray, rest: NDArray, stiffness: float) -> None:
        self.stencil, self.rest, self.stiffness = faces, rest, stiffness

    def subset(self, rows: NDArray, stencil: NDArray) -> AreaSprings:
        """Some of the faces, with these vertex indices."""
        return AreaSprings(stencil, self.rest[rows], self.stiffness)

    def _area(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Areas (m,), unit normals (m, 3) and opposite edges (m, 3, 3)."""
        corners = x[self.stencil]
        edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        normal = row_cross(edges[:, 1], edges[:, 2])
        double = np.sqrt(row_dot(normal, normal))
        return 0.5 * double, normal / np.where(double > 0, double, 1.0)[:, None], edges

    def energy(self, x: NDArray) -> float:
        return 0.5 * self.stiffness * float(np.sum(self.rest * (self._area(x)[0] / self.rest - 1) ** 2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        area, normal, edges = self._area(x)
        force = self.stiffness * (area / self.rest - 1)
        slope = 0.5 * row_cross(normal[:, None], edges)
        return sum_by_index(self.stencil, force[:, None, None] * slope, len(x))

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with velocities (n, 3)."""
        _, normal, edges = self._area(x)
        slope = 0.5 * row_cross(normal[:, None], edges)

        def multiply(v: NDArray) -> NDArray[np.float64]:
            rate = np.einsum("mij,mij->m", slope, v[self.stencil])
            return sum_by_index(
                self.stencil, (self.stiffness / self.rest * rate)[:, None, None] * slope, len(v)
            )

        return multiply

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        area, normal, edges = self._area(x)
        slope = 0.5 * row_cross(normal[:, None], edges).reshape(-1, 9)
        block = (self.stiffness / self.rest)[:, None, None] * slope[:, :, None] * slope[:, None, :]
        if mode == "exact":
            block += (self.stiffness * (area / self.rest - 1))[:, None, None] * area_hessian(
                area, normal, edges
            )
        return block


def area_hessian(area: NDArray, normal: NDArray, edges: NDArray) -> NDArray[np.float64]:
    """(m, 9, 9) Hessians of the face areas with respect to the corners."""
    cross = cross_matrix(edges.reshape(-1, 3)).reshape(-1, 3, 3, 3)
    plane = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    turn = 0.5 * cross_matrix(normal)
    hessian = np.einsum("miab,mac,mjcd->mibjd", cross, plane, cross) / (4 * area)[:, None, None, None, None]
    for i in range(3):
        hessian[:, i, :, (i + 2) % 3] += turn
        hessian[:, i, :, (i + 1) % 3] -= turn
    return hessian.reshape(-1, 9, 9)
