"""The bending energy of the Gauss map: how far the vertex normals are from those of a sphere, face by face.

Convention: W = int H^2 dA with H = (k1 + k2) / 2; a round sphere has 4 pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.vectors import row_cross, row_dot, tangential
from ddgcli.models.willmore.vertex_energies import FaceSides, area_gradient

# weight of the S-shape at which, on equilateral triangles, stripes one edge wide (which no vertex normal
# sees) are as stiff as in |L x|^2 / (4 M)
S_SHAPE = np.sqrt(3.0) / 144.0
# slenderness (1 of equilateral faces, 6.5 of one with an angle of 165 degrees) from which the weight falls:
# needles would be so stiff that only tiny steps lower the energy
NEEDLE_SLENDERNESS = 6.5
# a face may lean from a vertex normal as far as in the regular tetrahedron; a corner turned over altogether
# then costs 16 / 9, all corners of a folded face about the bending of the fold
LEAST_COSINE = 1.0 / 3.0


@dataclass(frozen=True, eq=False)
class Normals:
    """Unit vertex normals that are radial on every mesh inscribed in a sphere, and what they are made of.

    Parameters
    ----------
    ahead, behind : (m, 3, 3) ndarray
        Sides from corner k to corners k+1 and k+2, divided by their squared lengths.
    length : (n,) ndarray
        Of the sums of ahead x behind at the vertices; zero where no face is.
    unit : (n, 3) ndarray

    Notes
    -----
    N. Max, "Weights for computing vertex normals from facet normals", 1999. The inversion x / |x|^2 about a
    vertex takes a sphere through it to a plane; the sum is twice the area vector of the neighbours' polygon
    there.
    """

    ahead: NDArray[np.float64]
    behind: NDArray[np.float64]
    length: NDArray[np.float64]
    unit: NDArray[np.float64]

    @classmethod
    def at(cls, sides: NDArray, corners: NDArray, n: int) -> Normals:
        """From the sides opposite the corners (m, 3, 3)."""
        ahead, behind = sides[:, PREVIOUS], -sides[:, NEXT]
        ahead = ahead / row_dot(ahead, ahead)[..., None]
        behind = behind / row_dot(behind, behind)[..., None]
        vector = sum_by_index(corners, row_cross(ahead, behind), n)
        length = np.sqrt(row_dot(vector, vector))
        return cls(ahead, behind, length, vector / length[:, None])

    def pulled_back(self, by_unit: NDArray, corners: NDArray) -> NDArray[np.float64]:
        """(m, 3, 3) derivative by the corners, given the one by the unit normals (n, 3)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            by_vector = tangential(by_unit, self.unit) / self.length[:, None]
        by_vector = by_vector[corners]
        by_ahead = _inverted(self.ahead, row_cross(self.behind, by_vector))
        by_behind = _inverted(self.behind, row_cross(by_vector, self.ahead))
        return _by_corners(by_ahead, by_behind)


def _by_corners(by_ahead: NDArray, by_behind: NDArray) -> NDArray[np.float64]:
    """(m, 3, 3) derivative by the corners, given those by their sides to the next and previous one."""
    return by_ahead[:, PREVIOUS] + by_behind[:, NEXT] - by_ahead - by_behind


def _inverted(q: NDArray, by_q: NDArray) -> NDArray[np.float64]:
    """Derivative by e of a function of q = e / |e|^2."""
    return row_dot(q, q)[..., None] * by_q - 2.0 * row_dot(q, by_q)[..., None] * q


def _skewness(skew: NDArray, squared: NDArray, corner_dot: NDArray) -> NDArray[np.float64]:
    """(m,) sum over the corners of (2 A)^2 |v|^2, v the vector whose products with both sides are `skew`."""
    own = skew**2 * (squared[:, NEXT] + squared[:, PREVIOUS])
    return (own + 2.0 * corner_dot * skew[:, NEXT] * skew[:, PREVIOUS]).sum(axis=1)


def _needle_weight(squared: NDArray, area: NDArray) -> tuple[NDArray, NDArray]:
    """(m,) 1 / (1 + (r / r0)^3) of the slenderness r = sum |e|^2 / (4 sqrt(3) A), and its exponent."""
    cube = (squared.sum(axis=1) / (4.0 * np.sqrt(3.0) * area * NEEDLE_SLENDERNESS)) ** 3
    return 1.0 / (1.0 + cube), -3.0 * cube / (1.0 + cube)


def _s_shape(skew: NDArray, squared: NDArray, corner_dot: NDArray, area: NDArray) -> NDArray[np.float64]:
    """(m,) S-shape of the faces: S_SHAPE * skewness / A^2 * the weight of needles."""
    return S_SHAPE * _skewness(skew, squared, corner_dot) * _needle_weight(squared, area)[0] / area**2


def _s_shape_gradient(
    skew: NDArray, squared: NDArray, corner_dot: NDArray, area: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of `_s_shape` by the skew and squared length of each side (m, 3), and by the area (m,)."""
    needle_weight, exponent = _needle_weight(squared, area)
    weight = (S_SHAPE * needle_weight / area**2)[:, None]
    skewness = _skewness(skew, squared, corner_dot)
    ahead, behind = skew[:, NEXT], skew[:, PREVIOUS]
    own = skew * (squared[:, NEXT] + squared[:, PREVIOUS])
    by_skew = 2.0 * (own + corner_dot[:, NEXT] * behind + corner_dot[:, PREVIOUS] * ahead)
    product = ahead * behind
    by_squared = ahead**2 + behind**2 + product[:, NEXT] + product[:, PREVIOUS] - product
    by_squared += (exponent * skewness / squared.sum(axis=1))[:, None]
    by_area = -(2.0 + exponent) * weight[:, 0] * skewness / area
    return weight * by_skew, weight * by_squared, by_area


@dataclass(frozen=True, eq=False)
class _Terms:
    """What value and gradient share: at sides k (m, 3) and faces (m,)."""

    faces: FaceSides
    normals: Normals
    squared: NDArray  # length of each side
    corner_dot: NDArray  # of the two sides at each corner
    fall: NDArray  # (m, 3, 3) difference of the normals at the ends of each side
    bend: NDArray  # squared length of that
    twice: NDArray  # (m, 3, 3) sum of the normals at the ends of each side
    skew: NDArray  # its product with the side: S-shape
    s_shape: NDArray  # energy of that, of each face
    dirichlet: NDArray
    image: NDArray  # (m, 3) twice the area vector of the normals' triangle
    tilt: NDArray  # (m, 3) by how much the cosine of vertex and face normal falls short of LEAST_COSINE
    value: NDArray


@dataclass(frozen=True, eq=False)
class GaussMapEnergy:
    """Sum over faces of (D - G) / 2 + S, and over corners of max(0, 1/3 - n . nu)^2.

    D is the Dirichlet energy of the vertex normals n, linear on the face (int (k1^2 + k2^2) / 2), G their
    triangle's area along the face's normal nu (int k1 k2). D - G = int (k1 - k2)^2 / 2 is never negative, and
    zero on meshes inscribed in spheres, as is S: there the gradient vanishes, exactly. Added is
    int K, the sum of the inner vertices' angle defects (2 pi chi on closed surfaces). Faces with a boundary
    vertex are left out: the energy is for surfaces that are held there with their slope.

    Parameters
    ----------
    topology : Topology

    Notes
    -----
    S is the S-shape of the cubics that have the vertex normals at the ends of the sides e: with v_k the
    vector in the face whose products with both sides at corner k are the sides' (n_i + n_j) . e,
    S = (sqrt(3) / 36) sum |v_k|^2 / (1 + (r / 6.5)^3), r = sum |e|^2 / (4 sqrt(3) A) the slenderness.
    It is of higher order, and stiffens the patterns that no vertex normal sees. Slender faces stay flexible:
    a flow could crumple a surface there while its energy falls, so flows keep triangles good. The corners'
    term is zero where no face leans more than 70.5 degrees from its vertex normals.
    Without it a mesh on a sphere with some faces folded over would be at rest as well: its vertex normals
    are those of the sphere.
    """

    topology: Topology

    @cached_property
    def _weights(self) -> tuple[NDArray, NDArray, float]:
        """Whether a face counts (m,), the boundary corners (m, 3), and what is constant in int K."""
        t = self.topology
        at_boundary = t.boundary_vertex[t.faces]
        counted = np.where(at_boundary.any(axis=1), 0.0, 1.0)
        inner = int((t.referenced_vertex & ~t.boundary_vertex).sum())
        # the angle defects of the inner vertices: 2 pi each, less pi for a face, its boundary corners back
        return counted, at_boundary, np.pi * (2 * inner - t.n_faces)

    @cached_property
    def _last(self) -> list[tuple[NDArray, _Terms]]:
        """Points of the last evaluation and their terms, which the gradient of an accepted step uses."""
        return []

    def _terms(self, points: NDArray) -> _Terms:
        if self._last and self._last[0][0] is points:
            return self._last[0][1]
        terms = self._evaluate(points)
        # an array that can be written to may hold other values next time
        self._last[:] = [] if points.flags.writeable else [(points, terms)]
        return terms

    def _evaluate(self, points: NDArray) -> _Terms:
        corners, n = self.topology.faces, self.topology.n_vertices
        counted, angled, _ = self._weights
        faces = FaceSides.at(points, corners)
        side = faces.opposite
        with np.errstate(divide="ignore", invalid="ignore"):
            normals = Normals.at(side, corners, n)
            normal = normals.unit[corners]
            fall, twice = normal[:, PREVIOUS] - normal[:, NEXT], normal[:, PREVIOUS] + normal[:, NEXT]
            squared, bend = row_dot(side, side), row_dot(fall, fall)
            corner_dot = 0.5 * (squared[:, NEXT] + squared[:, PREVIOUS] - squared)
            skew = row_dot(twice, side)
            dirichlet = (corner_dot * bend).sum(axis=1) / (8.0 * faces.area)
            image = row_cross(fall[:, 0], fall[:, 1])
            s_shape = _s_shape(skew, squared, corner_dot, faces.area)
            value = counted * (0.5 * dirichlet + s_shape)
            value -= 0.25 * counted * row_dot(image, faces.normal)
            tilt = np.maximum(LEAST_COSINE - row_dot(normal, faces.normal[:, None]), 0.0)
            value += counted * (tilt**2).sum(axis=1)
            value = np.where(counted > 0, value, 0.0)
            if angled.any():
                angle = np.arctan2(2.0 * faces.area[:, None], corner_dot)
                value += np.where(angled, angle, 0.0).sum(axis=1)
        return _Terms(
            faces,
            normals,
            squared,
            corner_dot,
            fall,
            bend,
            twice,
            skew,
            s_shape,
            dirichlet,
            image,
            tilt,
            value,
        )

    def value(self, points: NDArray) -> float:
        """Energy; not finite on a surface with a face without area, or where a vertex has no normal."""
        return float(self._terms(points).value.sum()) + self._weights[2]

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        corners, n = self.topology.faces, self.topology.n_vertices
        counted, angled, constant = self._weights
        t = self._terms(points)
        side, unit, area = t.faces.opposite, t.faces.normal, t.faces.area
        # by the normals' differences and sums along the sides
        share = (counted / area)[:, None]
        by_fall = 0.125 * (share * t.corner_dot)[..., None] * t.fall
        by_fall[:, 0] -= 0.25 * counted[:, None] * row_cross(t.fall[:, 1], unit)
        by_fall[:, 1] -= 0.25 * counted[:, None] * row_cross(unit, t.fall[:, 0])
        by_skew, by_squared, s_by_area = _s_shape_gradient(t.skew, t.squared, t.corner_dot, area)
        by_skew, by_squared = (
            counted[:, None, None] * derivative[..., None] for derivative in (by_skew, by_squared)
        )
        by_twice = by_skew * side
        by_cosine = (-2.0 * counted[:, None] * t.tilt)[..., None]
        by_corner = (by_twice + by_fall)[:, NEXT] + (by_twice - by_fall)[:, PREVIOUS]
        by_unit = sum_by_index(corners, by_corner + by_cosine * unit[:, None], n)
        by_normal = (by_cosine * t.normals.unit[corners]).sum(axis=1) - 0.25 * counted[:, None] * t.image
        # by the sides themselves: lengths and dot products, S-shape, the face's normal
        spread = share * t.bend / 16.0
        by_side = (spread[:, NEXT] + spread[:, PREVIOUS] - spread)[..., None] * side
        by_side += by_skew * t.twice + 2.0 * by_squared * side
        turn = tangential(by_normal, unit) / (2.0 * area)[:, None]
        by_side[:, 0] += row_cross(side[:, 1], turn)
        by_side[:, 1] += row_cross(turn, side[:, 0])
        by_area = counted * (s_by_area - 0.5 * t.dirichlet / area)
        corner = by_area[:, None, None] * area_gradient(t.faces) + by_side[:, NEXT] - by_side[:, PREVIOUS]
        corner += t.normals.pulled_back(by_unit, corners)
        if angled.any():
            by_ahead, by_behind = (
                angled[..., None] * row_cross(q, orientation * unit[:, None])
                for q, orientation in ((t.normals.ahead, 1.0), (t.normals.behind, -1.0))
            )
            corner += _by_corners(by_ahead, by_behind)
        return float(t.value.sum()) + constant, sum_by_index(corners, corner, n)
