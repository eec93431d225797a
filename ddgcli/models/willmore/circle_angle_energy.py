"""The circle-angle energy: Moebius invariant, by the angles between circumcircles, with exact gradient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.circle_angles import circle_angle, side_product
from ddgcli.geometry.hinges import hinges
from ddgcli.mesh.scatter import columns_at, sum_columns_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.vectors import cross, dot

COCIRCULAR_SINE = 1e-12  # sine of an angle between circles below which the gradient, not defined there, is 0


@dataclass(frozen=True, eq=False)
class CircleAngleEnergy:
    """Half the sum over inner vertices of (sum of the angles between the circumcircles at its edges - 2 pi).

    It approximates int (H^2 - K), is never negative, and zero on convex Delaunay meshes inscribed in spheres.

    Parameters
    ----------
    topology : Topology

    Notes
    -----
    A. Bobenko, P. Schroeder, "Discrete Willmore flow", 2005. The angle at an edge ij of faces ijk, jil is pi
    less the argument of the product of the sides ik, kj, jl, li as imaginary quaternions.
    """

    topology: Topology

    @cached_property
    def _hinges(self) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
        """(h, 4) vertices i, k, j, l of each inner edge, half the count of inner ends, and the constant."""
        t = self.topology
        inner = t.referenced_vertex & ~t.boundary_vertex
        vertices = hinges(t)[:, [0, 2, 1, 3]]
        return vertices, 0.5 * inner[vertices[:, ::2]].sum(axis=1), -np.pi * float(inner.sum())

    def value(self, points: NDArray) -> float:
        """Energy; not finite where neighbours coincide."""
        vertices, weight, constant = self._hinges
        return _energy(weight, circle_angle(*side_product(*_sides(points, vertices)[1])), constant)

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        vertices, weight, constant = self._hinges
        length, sides = _sides(points, vertices)
        real, imaginary = side_product(*sides)
        value = _energy(weight, circle_angle(real, imaginary), constant)
        sine = np.sqrt(dot(imaginary, imaginary))
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = np.where(sine > COCIRCULAR_SINE, imaginary / sine, 0.0)
        # the product has length 1: d(angle) = real d|imaginary| - |imaginary| d(real)
        by_side = _pulled_back(sides, -weight * sine, weight * real * direction)
        by_vector = [(by - dot(by, side) * side) / size for by, side, size in zip(by_side, sides, length)]
        # side k leads from vertex k to the next one
        by_vertex = [by_vector[k - 1] - by_vector[k] for k in range(4)]
        return value, sum_columns_by_index(vertices, by_vertex, self.topology.n_vertices)


def _energy(weight: NDArray, angle: NDArray, constant: float) -> float:
    """Energy, which rounding makes negative where it is zero."""
    return float(np.maximum((weight * angle).sum() + constant, 0.0))


def _sides(points: NDArray, vertices: NDArray) -> tuple[list[NDArray], list[NDArray]]:
    """Lengths (h,) and directions (3, h) of the four sides of the quadrilaterals, in order."""
    corner = columns_at(points, vertices)
    side = [corner[(k + 1) % 4] - corner[k] for k in range(4)]
    length = [np.sqrt(dot(v, v)) for v in side]
    with np.errstate(divide="ignore", invalid="ignore"):
        return length, [v / size for v, size in zip(side, length)]


def _pulled_back(sides: list[NDArray], by_real: NDArray, by_imaginary: NDArray) -> list[NDArray]:
    """Derivatives (3, h) by the four factors of `side_product`, given those by its parts."""
    a, b, c, d = sides
    ab, cd, left, right = dot(a, b), dot(c, d), cross(a, b), cross(c, d)
    by_left = by_real * right + cross(right, by_imaginary) - cd * by_imaginary
    by_right = by_real * left + cross(by_imaginary, left) - ab * by_imaginary
    by_ab = -by_real * cd - dot(by_imaginary, right)
    by_cd = -by_real * ab - dot(by_imaginary, left)
    return [
        cross(b, by_left) + by_ab * b,
        cross(by_left, a) + by_ab * a,
        cross(d, by_right) + by_cd * d,
        cross(by_right, c) + by_cd * c,
    ]
