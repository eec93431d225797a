"""Effect `stretching`: edge springs, or St Venant-Kirchhoff triangles."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import copy
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.pair_blocks import PairBlocks, vertex_pairs, whole_blocks
from ddgcli.mechanics.terms import LinearOperator, Mode, Potential, at_last_point, row_blocks
from ddgcli.mesh.scatter import columns_at, sum_by_index, sum_columns_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, row_cross, row_dot
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.tensor_potential import TensorPotential
from ddgcli.scenes.materials import usable_stiffness
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class Stretching(Section):
    """Resistance to stretch."""

    model: Literal["edges", "edges-area", "stvk"] = "stvk"
    stiffness: quantity("N/m", "Young's modulus times thickness; default from the material", gt=0) | None = (
        None
    )


class EdgeSprings(Potential):
    """Energy k a (l / l0 - 1)^2 / 2 per edge, with a third of the area of its faces, a, and k in N/m.

    On equilateral triangles this is a membrane with Young's modulus times thickness k / 3 and nu = 1/3.
    """

    name = "stretching"

    def __init__(self, edges: NDArray, rest: NDArray, stiffness: NDArray) -> None:
        self.stencil = edges
        self.rest, self.stiffness = rest, stiffness

    def subset(self, rows: NDArray, stencil: NDArray) -> EdgeSprings:
        """Some of the edges, with these vertex indices."""
        return EdgeSprings(stencil, self.rest[rows], self.stiffness[rows])

    @at_last_point
    def _edge(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Vectors (3, e) and lengths (e,)."""
        tail, head = columns_at(x, self.stencil)
        vector = head - tail
        return vector, np.sqrt(dot(vector, vector))

    def lengths(self, x: NDArray) -> NDArray[np.float64]:
        """(e,) lengths of the edges."""
        return self._edge(x)[1]

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.sum(self.stiffness * (self._edge(x)[1] / self.rest - 1) ** 2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        force = (self.stiffness / self.rest * (length / self.rest - 1) / length) * vector
        return sum_columns_by_index(self.stencil, [-force, force], len(x))

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with velocities (n, 3)."""
        vector, length = self._edge(x)
        unit, along = vector / length, self.stiffness / self.rest**2

        def multiply(v: NDArray) -> NDArray[np.float64]:
            tail, head = columns_at(v, self.stencil)
            force = along * dot(unit, head - tail) * unit
            return sum_columns_by_index(self.stencil, [-force, force], len(v))

        return multiply

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return whole_blocks(self.stencil, self.pair_blocks(x, mode))

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        along = self.stiffness / self.rest**2
        across = along * (1 - self.rest / length)
        if mode != "exact":
            across = np.maximum(across, 0) if mode == "projected" else np.zeros_like(across)
        unit = vector / length
        for rows in row_blocks(len(self.stencil)):
            u = unit[:, rows]
            block = self._pairs.values[:, :, 0, rows]
            np.multiply(((across - along)[rows] * u)[:, None], u, out=block)
            for axis in range(3):
                block[axis, axis] -= across[rows]
        return self._pairs.written()

    @cached_property
    def _pairs(self) -> PairBlocks:
        return PairBlocks(self.stencil)


class StVK(TensorPotential):
    """St Venant-Kirchhoff membrane: energy lam/2 tr(E)^2 + mu tr(E^2) per area, E the Green strain.

    In plane stress lam = Y nu / (1 - nu^2) and mu = Y / (2 (1 + nu)), in N/m, with Young's modulus times
    thickness Y.

    `rest_metric` (m, 2, 2) is F'F at rest in the frames of `basis`: the identity up to rounding. With the
    exact identity, a needle of aspect 1e8 would have a strain of 1e-8 at rest, enough to set it in motion.
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
        self.assumed_stress: NDArray[np.float64] | None = None
        self.rest_metric = np.eye(2) if rest_metric is None else rest_metric

    def subset(self, rows: NDArray, stencil: NDArray) -> StVK:
        """Some of the faces, with these vertex indices."""
        rest = self.rest_metric if self.rest_metric.ndim == 2 else self.rest_metric[rows]
        membrane = StVK(stencil, self.basis[rows], self.area[rows], self.lam, self.mu, rest)
        if self.assumed_stress is not None:
            membrane.assumed_stress = self.assumed_stress[:, rows]
        return membrane

    def deformation_gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(m, 3, 2) F."""
        return np.stack(self._columns(x), axis=-1).transpose(1, 0, 2)

    def metric(self, x: NDArray) -> NDArray[np.float64]:
        """(m, 2, 2) F'F."""
        return _matrices(*self._products(*self._columns(x)))

    def _columns(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Columns (3, m) of F, from differences of positions: rounding does not depend on the origin."""
        x0, x1, x2 = columns_at(x, self.stencil)
        first, second = x1 - x0, x2 - x0
        rates = self._rates
        return rates[0, 1] * first + rates[0, 2] * second, rates[1, 1] * first + rates[1, 2] * second

    @staticmethod
    def _products(f: NDArray, g: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        return dot(f, f), dot(g, g), dot(f, g)

    @at_last_point
    def _stress(self, x: NDArray) -> tuple[tuple[NDArray, NDArray], NDArray, NDArray]:
        """Columns of F (3, m); components 11, 22, 12 (3, m) of the Green strain and of the stress.

        The stress is the second Piola-Kirchhoff stress times the thickness.
        """
        f, g = self._columns(x)
        strain = 0.5 * (np.stack(self._products(f, g)) - self._rest)
        return (f, g), strain, self._stress_of(strain)

    def _stress_of(self, strain: NDArray) -> NDArray[np.float64]:
        """Second Piola-Kirchhoff stress of a strain, components 11, 22, 12 (3, m)."""
        stress = 2 * self.mu * strain
        stress[:2] += self.lam * (strain[0] + strain[1])
        return stress

    def green_strain(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """(m, 2, 2) Green strain and second Piola-Kirchhoff stress (N/m).

        The axes are the first side of a face and the direction perpendicular to it.
        """
        _, strain, stress = self._stress(x)
        return _matrices(*strain), _matrices(*stress)

    def linearised(self, x: NDArray, move: NDArray) -> StVK:
        """The membrane whose Hessian uses the stress at x + move, linearised in the move.

        A rotation stretches to second order only, so the linearised stress does not contain that stretch.
        """
        (f, g), strain, _ = self._stress(x)
        df, dg = self._columns(move)
        rate = np.stack([dot(f, df), dot(g, dg), 0.5 * (dot(f, dg) + dot(g, df))])
        membrane = copy.copy(self)
        membrane.assumed_stress = self._stress_of(strain + rate)
        return membrane

    def energy(self, x: NDArray) -> float:
        _, strain, stress = self._stress(x)
        e, s = strain, stress
        return 0.5 * float(np.sum(self.area * (e[0] * s[0] + e[1] * s[1] + 2 * e[2] * s[2])))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        (f, g), _, stress = self._stress(x)
        return self._forces(f, g, stress, len(x))

    def _forces(self, f: NDArray, g: NDArray, stress: NDArray, n: int) -> NDArray[np.float64]:
        """(n, 3) gradient of the energy, from F and the second Piola-Kirchhoff stress."""
        s = self.area * stress
        first, second = s[0] * f + s[2] * g, s[2] * f + s[1] * g
        forces = [b * first + c * second for b, c in zip(*self._rates)]
        return sum_columns_by_index(self.stencil, forces, n)

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with velocities (n, 3)."""
        (f, g), _, _ = self._stress(x)

        def multiply(v: NDArray) -> NDArray[np.float64]:
            df, dg = self._columns(v)
            rate = np.stack([dot(f, df), dot(g, dg), 0.5 * (dot(f, dg) + dot(g, df))])
            return self._forces(f, g, self._stress_of(rate), len(v))

        return multiply

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return whole_blocks(self.stencil, self.pair_blocks(x, mode))

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        (f, g), _, stress = self._stress(x)
        if self.assumed_stress is not None:
            stress = self.assumed_stress
        s = self.area * (stress if mode == "exact" else _positive_part(*stress))
        for rows in row_blocks(len(self.stencil)):
            f1, f2 = f[:, rows], g[:, rows]
            s11, s22, s12 = s[:, rows]
            for k, (i, j) in enumerate(vertex_pairs(3)):
                p, q, r, t = self._moduli[k, :, rows]
                block = self._pairs.values[:, :, k, rows]
                np.multiply(f1[:, None], p * f1 + r * f2, out=block)
                block += f2[:, None] * (q * f2 + t * f1)
                if mode != "material":
                    (bi, ci), (bj, cj) = self._rates[:, i, rows], self._rates[:, j, rows]
                    geometric = bi * (s11 * bj + s12 * cj) + ci * (s12 * bj + s22 * cj)
                    for axis in range(3):
                        block[axis, axis] += geometric
            self._pairs.transpose_descending(rows)
        return self._pairs.written()

    @cached_property
    def _rates(self) -> NDArray[np.float64]:
        """(2, 3, m) derivatives of the hat functions of the corners along both axes."""
        return np.ascontiguousarray(self.basis.transpose(2, 1, 0))

    @property
    def _rest(self) -> NDArray[np.float64]:
        """Components 11, 22, 12 of the metric at rest, (3, m) or (3, 1)."""
        rest = self.rest_metric
        return np.stack([rest[..., 0, 0], rest[..., 1, 1], rest[..., 0, 1]]).reshape(3, -1)

    @cached_property
    def _moduli(self) -> NDArray[np.float64]:
        """(pairs, 4, m) coefficients of f1 f1', f2 f2', f1 f2' and f2 f1' in the blocks of corner pairs."""
        b, c = self._rates
        long, lam, mu = self.lam + 2 * self.mu, self.lam, self.mu
        rows = [
            (
                long * b[i] * b[j] + mu * c[i] * c[j],
                long * c[i] * c[j] + mu * b[i] * b[j],
                lam * b[i] * c[j] + mu * c[i] * b[j],
                lam * c[i] * b[j] + mu * b[i] * c[j],
            )
            for i, j in vertex_pairs(3)
        ]
        return self.area * np.array(rows)

    @cached_property
    def _pairs(self) -> PairBlocks:
        return PairBlocks(self.stencil)


def _matrices(first: NDArray, second: NDArray, mixed: NDArray) -> NDArray[np.float64]:
    """(m, 2, 2) symmetric matrices from their components 11, 22 and 12."""
    return np.stack([first, mixed, mixed, second], axis=-1).reshape(len(first), 2, 2)


def _positive_part(first: NDArray, second: NDArray, mixed: NDArray) -> NDArray[np.float64]:
    """Components 11, 22, 12 of symmetric 2 x 2 matrices, with negative eigenvalues replaced by 0."""
    mean, half = 0.5 * (first + second), 0.5 * (first - second)
    radius = np.hypot(half, mixed)
    high, low = np.maximum(mean + radius, 0), np.maximum(mean - radius, 0)
    safe = np.where(radius > 0, radius, 1.0)
    slope = np.where(radius > 0, (high - low) / (2 * safe), 0.0)
    middle = 0.5 * (high + low)
    return np.stack([middle + slope * half, middle - slope * half, slope * mixed])


def face_basis(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3, 2) gradients of the corners' hat functions, in an orthonormal frame of each face at rest."""
    corners = np.asarray(mesh.points)[mesh.faces]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(e1, axis=1)
    along = row_dot(e1, e2) / length
    height = np.linalg.norm(row_cross(e1, e2), axis=1) / length
    b1 = np.stack([1 / length, -along / (length * height)], axis=1)
    b2 = np.stack([np.zeros_like(height), 1 / height], axis=1)
    return np.stack([-b1 - b2, b1, b2], axis=1)


def build(parameters: Stretching, context: ShellContext) -> list[Potential]:
    shell, mesh = context.shell, context.mesh
    young = usable_stiffness(
        float(parameters.stiffness or (shell.young or 0) * (shell.thickness or 0)),
        "Young's modulus times thickness", "N/m", "`young` or `thickness`",
    )  # fmt: skip
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
    """Edge and area springs that reproduce Young's modulus and Poisson's ratio on equilateral triangles.

    Edge springs alone have equal Lame constants; the area springs add what the first one lacks.
    """
    if nu < 1 / 3 - 1e-12:
        raise ValueError(
            f"model edges-area needs poisson = 1/3 or more, not {nu:g}: edge springs alone have 1/3; "
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
