"""The circle-angle energy: Moebius invariant, by the angles between circumcircles, with exact gradient."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.vectors import row_cross, row_dot, vector_length

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
        side = t.interior_sides
        twin = t.side_twin.ravel()[side]
        k, other = (t.faces.ravel()[s - s % 3 + (s + 2) % 3] for s in (side, twin))
        inner = t.referenced_vertex & ~t.boundary_vertex
        vertices = np.stack([t.side_tail[side], k, t.side_head[side], other], axis=1)
        return vertices, 0.5 * inner[vertices[:, ::2]].sum(axis=1), -np.pi * float(inner.sum())

    def value(self, points: NDArray) -> float:
        """Energy; not finite where neighbours coincide."""
        vertices, weight, constant = self._hinges
        sides = _sides(points, vertices)[1]
        real, imaginary = _product(sides)
        return _energy(weight, np.arctan2(vector_length(imaginary), real), constant)

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        vertices, weight, constant = self._hinges
        length, sides = _sides(points, vertices)
        real, imaginary = _product(sides)
        sine = vector_length(imaginary)
        value = _energy(weight, np.arctan2(sine, real), constant)
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = np.where(sine[:, None] > COCIRCULAR_SINE, imaginary / sine[:, None], 0.0)
        # the product has length 1: d(angle) = real d|imaginary| - |imaginary| d(real)
        by_side = _pulled_back(sides, -weight * sine, (weight * real)[:, None] * direction)
        along = np.einsum("hki,hki->hk", by_side, sides)[..., None] * sides
        by_vector = (by_side - along) / length[..., None]
        # side k leads from vertex k to the next one
        by_vertex = np.roll(by_vector, 1, axis=1) - by_vector
        return value, sum_by_index(vertices, by_vertex, self.topology.n_vertices)


def _energy(weight: NDArray, angle: NDArray, constant: float) -> float:
    """Energy, which rounding makes negative where it is zero."""
    return float(np.maximum((weight * angle).sum() + constant, 0.0))


def _sides(points: NDArray, vertices: NDArray) -> tuple[NDArray, NDArray]:
    """(h, 4) lengths and (h, 4, 3) directions of the sides of the quadrilaterals, in order."""
    corner = points[vertices]
    side = np.roll(corner, -1, axis=1) - corner
    length = np.sqrt(np.einsum("hki,hki->hk", side, side))
    with np.errstate(divide="ignore", invalid="ignore"):
        return length, side / length[..., None]


def _product(sides: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real (h,) and imaginary (h, 3) part of the product of four imaginary quaternions (h, 4, 3)."""
    a, b, c, d = np.moveaxis(sides, 1, 0)
    ab, cd, left, right = row_dot(a, b), row_dot(c, d), row_cross(a, b), row_cross(c, d)
    imaginary = row_cross(left, right) - ab[:, None] * right - cd[:, None] * left
    return row_dot(left, right) - ab * cd, imaginary


def _pulled_back(sides: NDArray, by_real: NDArray, by_imaginary: NDArray) -> NDArray[np.float64]:
    """(h, 4, 3) derivative by the four factors, given those by the parts of the product."""
    a, b, c, d = np.moveaxis(sides, 1, 0)
    ab, cd, left, right = row_dot(a, b), row_dot(c, d), row_cross(a, b), row_cross(c, d)
    by_left = by_real[:, None] * right + row_cross(right, by_imaginary) - cd[:, None] * by_imaginary
    by_right = by_real[:, None] * left + row_cross(by_imaginary, left) - ab[:, None] * by_imaginary
    by_ab = (-by_real * cd - row_dot(by_imaginary, right))[:, None]
    by_cd = (-by_real * ab - row_dot(by_imaginary, left))[:, None]
    derivatives = (
        row_cross(b, by_left) + by_ab * b,
        row_cross(by_left, a) + by_ab * a,
        row_cross(d, by_right) + by_cd * d,
        row_cross(by_right, c) + by_cd * c,
    )
    return np.stack(derivatives, axis=1)
