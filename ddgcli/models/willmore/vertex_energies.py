"""Bending energies summed over vertices, with their exact gradients.

Both energies are a function phi(F, N, S) of three quantities at a vertex p: the area gradient F = dArea/dp
(the cotangent formula), the volume gradient N = dVolume/dp (a third of the star's area vectors) and an area
S: a third of the star, or the mixed Voronoi cell. Their gradient is one reverse pass over the faces.

Convention: W = int H^2 dA with H = (k1 + k2) / 2; a round sphere has 4 pi.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import mixed_voronoi_share
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.vectors import row_cross, row_dot, tangential


@dataclass(frozen=True, eq=False)
class FaceSides:
    """What the vertex energies read of the faces at given positions.

    Parameters
    ----------
    opposite : (m, 3, 3) ndarray
        Vector of the side opposite corner k, from corner k+1 to corner k+2.
    normal : (m, 3) ndarray
        Unit normals.
    area : (m,) ndarray
    """

    opposite: NDArray[np.float64]
    normal: NDArray[np.float64]
    area: NDArray[np.float64]

    @classmethod
    def at(cls, points: NDArray, faces: NDArray) -> FaceSides:
        corner = points[faces]
        opposite = corner[:, PREVIOUS] - corner[:, NEXT]
        doubled = row_cross(opposite[:, 0], opposite[:, 1])
        length = np.sqrt(row_dot(doubled, doubled))
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls(opposite, doubled / length[:, None], 0.5 * length)


def area_gradient(faces: FaceSides) -> NDArray[np.float64]:
    """Derivative of a face's area by its corners: half the side opposite, turned inward.

    Parameters
    ----------
    faces : FaceSides

    Returns
    -------
    (m, 3, 3) ndarray of float64
        A length; face, corner, component.
    """
    return 0.5 * row_cross(faces.normal[:, None, :], faces.opposite)


def _area_hessian_times(faces: FaceSides, y: NDArray) -> NDArray[np.float64]:
    """(m, 3, 3) second derivative of the face areas applied to corner vectors y (m, 3, 3)."""
    e, nu = faces.opposite, faces.normal
    de = y[:, PREVIOUS] - y[:, NEXT]
    dn = row_cross(de[:, 0], e[:, 1]) + row_cross(e[:, 0], de[:, 1])
    dn = tangential(dn, nu) / (2.0 * faces.area[:, None])
    return 0.5 * (row_cross(dn[:, None, :], e) + row_cross(nu[:, None, :], de))


def _voronoi_weights(faces: FaceSides) -> tuple[NDArray, NDArray, NDArray]:
    """(m, 3) squared sides opposite the corners, (m, 3) shares if the face is obtuse, (m,) whether it is."""
    squared: NDArray = row_dot(faces.opposite, faces.opposite)
    obtuse = squared > squared[:, NEXT] + squared[:, PREVIOUS]
    return squared, np.where(obtuse, 0.5, 0.25), obtuse.any(axis=1)


def voronoi_cell(faces: FaceSides) -> NDArray[np.float64]:
    """(m, 3) mixed Voronoi area of each corner (Meyer et al. 2003)."""
    opposite = np.einsum("fki,fki->kf", faces.opposite, faces.opposite)
    with np.errstate(divide="ignore", invalid="ignore"):
        cotan = (opposite[NEXT] + opposite[PREVIOUS] - opposite) / (4.0 * faces.area)
        return mixed_voronoi_share(opposite[PREVIOUS], cotan, faces.area).T


def voronoi_gradient(faces: FaceSides, weight: NDArray) -> NDArray[np.float64]:
    """(m, 3, 3) derivative by the corners of the cells' sum with weights (m, 3)."""
    a, share, obtuse = _voronoi_weights(faces)
    b, c = a[:, NEXT], a[:, PREVIOUS]
    w = weight / (32.0 * faces.area[:, None])
    by_area = -(w * (c * (a + b - c) + b * (a + c - b))).sum(axis=1) / faces.area
    by_area = np.where(obtuse, (weight * share).sum(axis=1), by_area)
    # by the squared side opposite each corner: as its own, as the next and as the previous one of another
    by_side = (
        w * (b + c) + (w * (2.0 * c + a - 2.0 * b))[:, PREVIOUS] + (w * (2.0 * b + a - 2.0 * c))[:, NEXT]
    )
    pull = 2.0 * np.where(obtuse[:, None], 0.0, by_side)[:, :, None] * faces.opposite
    return by_area[:, None, None] * area_gradient(faces) + pull[:, NEXT] - pull[:, PREVIOUS]


@dataclass(frozen=True, eq=False)
class VertexEnergy:
    """Sum over counted vertices of |F|^2 / (4 S) (`cotan`) or |F|^2 S / (4 |N|^2) (`sullivan`).

    Parameters
    ----------
    topology : Topology
    sullivan : bool
        Pointwise curvature |F| / |N| (Sullivan's, by the volume gradient) instead of |F| / S.
    counted : (n,) ndarray of bool
        Vertices whose curvature is summed: those with a whole star (not on the boundary).

    Notes
    -----
    J. M. Sullivan, "Curvatures of smooth and discrete surfaces", 2006, for F, N and their quotient.
    `cotan` is |L x|^2 / (4 M), M the mixed Voronoi cell: on a surface inscribed in a sphere without obtuse
    angles x . L x = 2 M exactly, so that a round sphere is at rest but for the tangential part of L x.
    """

    topology: Topology
    sullivan: bool
    counted: NDArray[np.bool_]

    def _variations(self, points: NDArray) -> tuple[FaceSides, NDArray, NDArray, NDArray]:
        corners, n = self.topology.faces, self.topology.n_vertices
        faces = FaceSides.at(points, corners)
        first = sum_by_index(corners, area_gradient(faces), n)
        if not self.sullivan:
            return faces, first, sum_by_index(corners, voronoi_cell(faces), n), np.zeros(0)
        third = np.repeat(faces.area / 3.0, 3).reshape(-1, 3)
        star = sum_by_index(corners, third, n)
        volume = sum_by_index(corners, np.repeat((third[:, 0, None] * faces.normal)[:, None], 3, axis=1), n)
        return faces, first, star, volume

    def vertex_values(self, points: NDArray) -> NDArray[np.float64]:
        """(n,) each vertex's share of the energy."""
        return self._values(*self._variations(points)[1:])

    def _values(self, first: NDArray, star: NDArray, volume: NDArray) -> NDArray[np.float64]:
        with np.errstate(divide="ignore", invalid="ignore"):
            value = 0.25 * row_dot(first, first)
            value = value * star / row_dot(volume, volume) if self.sullivan else value / star
        return np.where(self.counted, value, 0.0)

    def value(self, points: NDArray) -> float:
        """Energy; not finite on a surface with a face without area."""
        return float(self.vertex_values(points).sum())

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        corners, n = self.topology.faces, self.topology.n_vertices
        faces, first, star, volume = self._variations(points)
        value = self._values(first, star, volume)
        safe_star = np.where(self.counted, star, 1.0)
        if self.sullivan:
            squared = np.where(self.counted, row_dot(volume, volume), 1.0)
            by_first = 0.5 * first * (star / squared)[:, None]
            by_star = value / safe_star
            by_volume = -2.0 * volume * (value / squared)[:, None]
        else:
            by_first = 0.5 * first / safe_star[:, None]
            by_star = -value / safe_star
        by_first[~self.counted] = 0.0
        corner = _area_hessian_times(faces, by_first[corners])
        if self.sullivan:
            corner += (by_star[corners].sum(axis=1) / 3.0)[:, None, None] * area_gradient(faces)
            mean = by_volume[corners].sum(axis=1) / 3.0
            corner += 0.5 * row_cross(mean[:, None, :], faces.opposite)
        else:
            corner += voronoi_gradient(faces, by_star[corners])
        return float(value.sum()), sum_by_index(corners, corner, n)
