"""Effect `stretching`: edge springs, or St Venant-Kirchhoff triangles."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import Mode, Potential, at_last_point
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class Stretching(Section):
    """Resistance to stretch."""

    model: Literal["edges", "edges-area", "stvk"] = "stvk"
    stiffness: quantity("N/m", "Young's modulus times thickness; default from the material", gt=0) | None = (
        None
    )


class EdgeSprings:
    """Energy k a (l/l0 - 1)^2 / 2 of every edge, a the area of the edge's tile, k in N/m.

    On equilateral triangles this is a membrane with Young's modulus times thickness k / 3 and nu = 1/3.
    """

    name = "stretching"

    def __init__(self, edges: NDArray, rest: NDArray, stiffness: NDArray) -> None:
        self.stencil = edges
        self.rest, self.stiffness = rest, stiffness

    def subset(self, rows: NDArray, stencil: NDArray) -> EdgeSprings:
        """Some of the edges, with these numbers of their vertices."""
        return EdgeSprings(stencil, self.rest[rows], self.stiffness[rows])

    def _edge(self, x: NDArray) -> tuple[NDArray, NDArray]:
        vector = x[self.stencil[:, 1]] - x[self.stencil[:, 0]]
        return vector, np.sqrt(np.einsum("ei,ei->e", vector, vector))

    def lengths(self, x: NDArray) -> NDArray[np.float64]:
        """(e,) lengths of the edges."""
        return self._edge(x)[1]

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.sum(self.stiffness * (self._edge(x)[1] / self.rest - 1) ** 2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        force = (self.stiffness / self.rest * (length / self.rest - 1) / length)[:, None] * vector
        return sum_by_index(self.stencil, np.stack([-force, force], axis=1), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        unit = vector / length[:, None]
        k = self.stiffness / self.rest**2
        across = 1 - self.rest / length
        if mode != "exact":
            across = np.maximum(across, 0) if mode == "projected" else np.zeros_like(across)
        outer = unit[:, :, None] * unit[:, None, :]
        block = k[:, None, None] * (outer + across[:, None, None] * (np.eye(3) - outer))
        return np.block([[block, -block], [-block, block]])


class StVK:
    """St Venant-Kirchhoff membrane: energy t (lam/2 tr(E)^2 + mu tr(E^2)) per area, E the Green strain.

    Plane stress: lam t = Y nu / (1 - nu^2), mu t = Y / (2 (1 + nu)) with Y Young's modulus times thickness.

    `rest_metric` (m, 2, 2) is F'F at rest in the frames of `basis`: the identity up to rounding. In a needle
    of aspect 1e8 rounding would leave a strain of 1e-8, enough to move a body at rest.
    """

    name = "stretching"

    def __init__(
        self,
        faces: NDArray,
        basis: NDArray,
        area: NDArray,
        lam: float,
        mu: float,
        rest_metric: NDArray | None = None,
    ) -> None:
        self.stencil, self.basis, self.area = faces, basis, area
        self.lam, self.mu = lam, mu
        self.rest_metric = np.eye(2) if rest_metric is None else rest_metric

    def subset(self, rows: NDArray, stencil: NDArray) -> StVK:
        """Some of the faces, with these numbers of their vertices."""
        rest = self.rest_metric if self.rest_metric.ndim == 2 else self.rest_metric[rows]
        return StVK(stencil, self.basis[rows], self.area[rows], self.lam, self.mu, rest)

    def deformation_gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(m, 3, 2) F, from differences of positions: they do not depend on the origin."""
        corners = x[self.stencil]
        return np.matmul((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1), self.basis[:, 1:])

    def metric(self, x: NDArray) -> NDArray[np.float64]:
        """(m, 2, 2) F'F."""
        f = self.deformation_gradient(x)
        return np.matmul(f.transpose(0, 2, 1), f)

    @at_last_point
    def _stress(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Deformation gradient F (m, 3, 2), Green strain and second Piola-Kirchhoff stress (m, 2, 2)."""
        f = self.deformation_gradient(x)
        strain = 0.5 * (np.matmul(f.transpose(0, 2, 1), f) - self.rest_metric)
        trace = strain[:, 0, 0] + strain[:, 1, 1]
        stress = 2 * self.mu * strain
        stress[:, 0, 0] += self.lam * trace
        stress[:, 1, 1] += self.lam * trace
        return f, strain, stress

    def green_strain(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """(m, 2, 2) Green's strain and second stress (N/m), along the first side of a face and across."""
        return self._stress(x)[1:]

    def energy(self, x: NDArray) -> float:
        _, strain, stress = self._stress(x)
        return 0.5 * float(np.sum(self.area * np.einsum("mab,mab->m", strain, stress)))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        f, _, stress = self._stress(x)
        first = np.matmul(f, self.area[:, None, None] * stress)
        return sum_by_index(self.stencil, np.matmul(self.basis, first.transpose(0, 2, 1)), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        f, _, stress = self._stress(x)
        b = self.basis
        rates, weighted, block = self._buffers
        # rows: derivatives of E11, E22 and 2 E12 in the nine coordinates
        np.multiply(b[:, :, None, 0], f[:, None, :, 0], out=rates[:, 0])
        np.multiply(b[:, :, None, 1], f[:, None, :, 1], out=rates[:, 1])
        np.multiply(b[:, :, None, 0], f[:, None, :, 1], out=rates[:, 2])
        rates[:, 2] += b[:, :, None, 1] * f[:, None, :, 0]
        rate = rates.reshape(-1, 3, 9)
        lam, mu = self.lam, self.mu
        law = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
        np.matmul(self.area[:, None, None] * law, rate, out=weighted)
        np.matmul(rate.transpose(0, 2, 1), weighted, out=block)
        if mode != "material":
            s = self.area[:, None, None] * (stress if mode == "exact" else _positive_part(stress))
            geometric = np.matmul(np.matmul(b, s), b.transpose(0, 2, 1))
            by_axis = block.reshape(-1, 3, 3, 3, 3)
            for axis in range(3):
                by_axis[:, :, axis, :, axis] += geometric
        return block

    @cached_property
    def _buffers(self) -> tuple[NDArray, NDArray, NDArray]:
        """Arrays that every Hessian is written to: fresh memory costs more than the arithmetic."""
        m = len(self.area)
        return np.zeros((m, 3, 3, 3)), np.zeros((m, 3, 9)), np.zeros((m, 9, 9))


def _positive_part(s: NDArray) -> NDArray[np.float64]:
    """Symmetric (m, 2, 2) matrices with their negative eigenvalues put to zero, in closed form."""
    mean = 0.5 * (s[:, 0, 0] + s[:, 1, 1])
    radius = np.hypot(0.5 * (s[:, 0, 0] - s[:, 1, 1]), s[:, 0, 1])
    high, low = np.maximum(mean + radius, 0), np.maximum(mean - radius, 0)
    safe = np.where(radius > 0, radius, 1.0)
    slope = np.where(radius > 0, (high - low) / (2 * safe), 0.0)
    middle = 0.5 * (high + low) - slope * mean
    return middle[:, None, None] * np.eye(2) + slope[:, None, None] * s


def face_basis(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3, 2) gradients of the corner functions in an orthonormal frame of each face, at rest."""
    corners = np.asarray(mesh.points)[mesh.faces]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(e1, axis=1)
    along = np.einsum("mi,mi->m", e1, e2) / length
    height = np.linalg.norm(np.cross(e1, e2), axis=1) / length
    b1 = np.stack([1 / length, -along / (length * height)], axis=1)
    b2 = np.stack([np.zeros_like(height), 1 / height], axis=1)
    return np.stack([-b1 - b2, b1, b2], axis=1)


def build(parameters: Stretching, context: ShellContext) -> list[Potential]:
    shell, mesh = context.shell, context.mesh
    young = float(parameters.stiffness or (shell.young or 0) * (shell.thickness or 0))
    if parameters.model == "edges":
        return [_springs(context, 3 * young)]
    nu = float(shell.poisson or 0)
    if parameters.model == "edges-area":
        return _edges_and_areas(context, young, nu)
    lam, mu = young * nu / (1 - nu**2), young / (2 * (1 + nu))
    membrane = StVK(np.asarray(mesh.faces), face_basis(mesh), context.face_area, lam, mu)
    membrane.rest_metric = membrane.metric(np.asarray(mesh.points))
    return [membrane]


def _edges_and_areas(context: ShellContext, young: float, nu: float) -> list[Potential]:
    """Edge and area springs that together have Young's modulus and Poisson's ratio on equilateral triangles.

    Edge springs alone have equal Lame constants; the area springs add the rest of the first.
    """
    if nu < 1 / 3 - 1e-12:
        raise ValueError(
            f"model edges-area needs poisson = 1/3 or more, found {nu:g}: edge springs alone have 1/3; "
            'write model = "stvk"'
        )
    from ddgcli.models.shell.area_springs import AreaSprings

    lam, mu = young * nu / (1 - nu**2), young / (2 * (1 + nu))
    areas = AreaSprings(np.asarray(context.mesh.faces), context.face_area, max(lam - mu, 0.0))
    return [_springs(context, 8 * mu), areas]


def _springs(context: ShellContext, stiffness: float) -> EdgeSprings:
    topology = context.mesh.topology
    side = topology.side_edge.ravel()
    rest = np.zeros(topology.n_edges)
    rest[side] = context.mesh.side_length.ravel()
    tile = sum_by_index(side, np.repeat(context.face_area / 3, 3), topology.n_edges)
    return EdgeSprings(topology.edges, rest, stiffness * tile)


EFFECT = Effect(
    "stretching", Stretching, build, "edges: one pass over the edges; stvk: one over the faces", ("shell",)
)
