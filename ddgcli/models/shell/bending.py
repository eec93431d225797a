"""Effect `bending`: hinges, the quadratic energy of isometric bending, or mid-edge directors."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.sparse import coo_array, csr_array

from ddgcli.errors import counted
from ddgcli.geometry.hinges import HingeFrame, angle_slopes, hinge_cotans, hinge_frame, hinges
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mechanics.pair_blocks import PairBlocks, vertex_pairs, whole_blocks
from ddgcli.mechanics.terms import LinearOperator, Mode, Potential, at_last_point, row_blocks
from ddgcli.mesh.scatter import columns_at, sum_columns_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, row_dot
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.hinge import angle_second_derivatives, wrapped
from ddgcli.scenes.materials import usable_stiffness
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

if TYPE_CHECKING:
    from ddgcli.models.shell.midedge import MidedgeBending

# Hinge constant K = D / PLATE_RATIO. The plate of a hinge mesh depends on it (docs/shell-sim.md): a strip
# that is free to relax has B = 4.8 to 5 K on right and alternating grids, 5.4 K on equilateral and 5.6 K on
# irregular triangles, 6.2 to 7 K on crossed ones; bent to a cylinder unrelaxed, 6 K along a grid's axes.
PLATE_RATIO = 5.0
MIN_MIDEDGE_HEIGHT = 2e-8  # height of a face over its longest side: the square root of the rounding unit
FLAT_ANGLE_TOLERANCE = 1e-6  # radians: a mesh whose hinges are flatter counts as flat


class Bending(Section):
    """Resistance to bending."""

    model: Literal["hinge", "quadratic", "cubic", "midedge"] = Field(
        "hinge",
        description="hinge; quadratic: flat rest shape; cubic: curved; midedge: converges on any mesh",
    )
    rest: Literal["input", "flat"] | None = Field(
        None, description="shape without bending moment: the mesh as drawn, or flat; quadratic is always flat"
    )
    stiffness: (
        quantity("N m", "flexural rigidity D; default young thickness^3 / (12 (1 - poisson^2))", gt=0) | None
    ) = None


class HingeBending(Potential):
    """Energy 3 K |e|^2 / (A0 + A1) (angle - rest)^2 per hinge, with rest lengths and areas; K in J.

    E. Grinspun, A. N. Hirani, M. Desbrun, P. Schroeder, "Discrete shells", 2003.
    """

    name = "bending"

    def __init__(self, stencil: NDArray, weight: NDArray, rest: NDArray) -> None:
        self.stencil, self.weight, self.rest = stencil, weight, rest

    def subset(self, rows: NDArray, stencil: NDArray) -> HingeBending:
        """Some of the hinges, with these vertex indices."""
        return HingeBending(stencil, self.weight[rows], self.rest[rows])

    @at_last_point
    def _hinge_frame(self, x: NDArray) -> HingeFrame:
        return hinge_frame(x, self.stencil)

    def energy(self, x: NDArray) -> float:
        bend = wrapped(self._hinge_frame(x).angle - self.rest)
        return float(np.sum(self.weight * bend**2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        f = self._hinge_frame(x)
        moment = 2 * self.weight * wrapped(f.angle - self.rest)
        slopes = [moment * slope for slope in angle_slopes(f)]
        return sum_columns_by_index(self.stencil, slopes, len(x))

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with velocities (n, 3)."""
        slopes = angle_slopes(self._hinge_frame(x))

        def multiply(v: NDArray) -> NDArray[np.float64]:
            rate = sum(dot(slope, column) for slope, column in zip(slopes, columns_at(v, self.stencil)))
            moment = 2 * self.weight * rate
            return sum_columns_by_index(self.stencil, [moment * slope for slope in slopes], len(v))

        return multiply

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return whole_blocks(self.stencil, self.pair_blocks(x, mode))

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        f = self._hinge_frame(x)
        moment = 2 * self.weight * wrapped(f.angle - self.rest)
        for rows in row_blocks(len(self.stencil)):
            piece = f[rows]
            slopes = angle_slopes(piece)
            scaled = [2 * self.weight[rows] * slope for slope in slopes[:3]]
            blocks = self._pairs.values[..., rows]
            for k, (a, b) in enumerate(vertex_pairs(4)):
                np.multiply(scaled[a][:, None], slopes[b], out=blocks[:, :, k])
            if mode == "exact":
                for pair, summand in angle_second_derivatives(piece, moment[rows]):
                    blocks[:, :, vertex_pairs(4).index(pair)] += summand
            self._pairs.transpose_descending(rows)
        return self._pairs.written()

    @cached_property
    def _pairs(self) -> PairBlocks:
        return PairBlocks(self.stencil)


class QuadraticBending(Potential):
    """Energy k/2 sum 3 / (A0 + A1) |sum_i c_i x_i|^2 over the hinges, with a constant Hessian.

    M. Bergou, M. Wardetzky, D. Harmon, D. Zorin, E. Grinspun, "A quadratic bending model for inextensible
    surfaces", 2006; c_i are the cotangent weights of the hinge.
    """

    name = "bending"

    def __init__(self, stencil: NDArray, weight: NDArray, c: NDArray, n: int) -> None:
        self.stencil, self.weight = stencil, weight
        rows, number = np.indices(stencil.shape)[0].ravel(), stencil.ravel()
        self._curvature: csr_array = coo_array((c.ravel(), (rows, number)), shape=(len(stencil), n)).tocsr()
        local = weight[:, None, None] * c[:, :, None] * c[:, None, :]
        corner = matrix_indices(stencil, n, local.size)
        rows, cols = np.repeat(corner, 4, axis=1).ravel(), np.tile(corner, (1, 4)).ravel()
        self.matrix: csr_array = coo_array((local.ravel(), (rows, cols)), shape=(n, n)).tocsr()
        self._local = local

    def energy(self, x: NDArray) -> float:
        # not x . Q x, whose cancellation hides the energy changes of the last moves to an equilibrium
        bend = self._curvature @ (x - x[0])
        return 0.5 * float(self.weight @ row_dot(bend, bend))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return self.matrix @ (x - x[0])

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the Hessian, which is constant, with velocities (n, 3)."""
        return self.gradient

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return whole_blocks(self.stencil, self._pairs.values)

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self._pairs.values

    @cached_property
    def _pairs(self) -> PairBlocks:
        pairs = PairBlocks(self.stencil)
        for k, (a, b) in enumerate(vertex_pairs(4)):
            pairs.values[:, :, k] = np.eye(3)[:, :, None] * self._local[:, a, b]
        return pairs


def hinge_measure(mesh: TriangleMesh, stencil: NDArray, area: NDArray) -> tuple[NDArray, NDArray]:
    """Hinge weights 3 |e|^2 / (A0 + A1) and 3 / (A0 + A1) of the rest shape."""
    topology = mesh.topology
    twin, side = topology.side_twin.ravel(), topology.interior_sides
    side = side[topology.side_tail[side] == topology.side_head[twin[side]]]
    both = area[side // 3] + area[twin[side] // 3]
    return 3 * mesh.side_length.ravel()[side] ** 2 / both, 3 / both


def _require_height(context: ShellContext) -> None:
    """ValueError for faces so thin that rounding makes their three edge rotations linearly dependent."""
    longest = context.mesh.side_length.max(axis=1)
    height = 2 * context.face_area / longest**2
    if (height < MIN_MIDEDGE_HEIGHT).any():
        first = int(np.argmax(height < MIN_MIDEDGE_HEIGHT))
        raise ValueError(
            f"face {first} of {context.shell.name} has a height of {height[first]:.2g} of its longest side, "
            f'and "midedge" takes {MIN_MIDEDGE_HEIGHT:g} or more; write model = "hinge"'
        )


def build(parameters: Bending, context: ShellContext) -> list[Potential]:
    shell, mesh = context.shell, context.mesh
    rigidity = rigidity_of(parameters, context)
    stencil = hinges(mesh.topology)
    n_without_hinge = mesh.topology.n_edges - len(mesh.topology.boundary_edges) - len(stencil)
    if n_without_hinge:
        logging.getLogger("ddgcli").warning(
            "%s no bending in %s: more than two faces, or faces of opposite orientation",
            counted(n_without_hinge, "edge has", "edges have"), shell.name,
        )  # fmt: skip
    if parameters.model == "midedge":
        return [plate_bending(parameters, context)]
    scaled, plain = hinge_measure(mesh, stencil, context.face_area)
    if parameters.model == "hinge":
        flat = parameters.rest == "flat"
        rest = np.zeros(len(stencil)) if flat else hinge_frame(np.asarray(mesh.points), stencil).angle
        return [HingeBending(stencil, rigidity / PLATE_RATIO * scaled, rest)]
    if parameters.model == "cubic":
        from ddgcli.models.shell.cubic import CubicBending

        weight = rigidity / PLATE_RATIO * scaled
        return [CubicBending(np.asarray(mesh.points), stencil, weight, parameters.rest == "flat")]
    if parameters.rest == "input":
        bent = np.abs(hinge_frame(np.asarray(mesh.points), stencil).angle).max(initial=0.0)
        if bent > FLAT_ANGLE_TOLERANCE:
            raise ValueError(
                f"model quadratic is at rest when flat, and the input bends by {bent:.3g} rad; "
                'write rest = "flat", or model = "hinge"'
            )
    return [
        QuadraticBending(stencil, 2 * rigidity / PLATE_RATIO * plain, hinge_cotans(mesh), mesh.n_vertices)
    ]


def plate_bending(parameters: Bending, context: ShellContext) -> MidedgeBending:
    """Mid-edge bending of a shell, whichever bending model its parameters name.

    Parameters
    ----------
    parameters : Bending
    context : ShellContext

    Returns
    -------
    MidedgeBending

    Raises
    ------
    ValueError
        On needles, and where an edge cannot be clamped.
    """
    from ddgcli.models.shell.clamps import clamped_sides
    from ddgcli.models.shell.midedge import MidedgeBending

    _require_height(context)
    flat, poisson = parameters.rest == "flat", float(context.shell.poisson or 0)
    rigidity = rigidity_of(parameters, context)
    return MidedgeBending(context.mesh, rigidity, poisson, flat, clamped_sides(context))


def rigidity_of(parameters: Bending, context: ShellContext) -> float:
    """Flexural rigidity D in N m: that of the section `bending`, else that of the material.

    Parameters
    ----------
    parameters : Bending
    context : ShellContext

    Returns
    -------
    float
    """
    shell = context.shell
    rigidity = parameters.stiffness or plate_rigidity(shell.young, shell.thickness, shell.poisson)
    return usable_stiffness(rigidity, "flexural rigidity", "N m", "`thickness` or `young`")


def plate_rigidity(young: float | None, thickness: float | None, poisson: float | None) -> float:
    """Flexural rigidity of a plate, D = E t^3 / (12 (1 - nu^2)) in N m."""
    e, t, nu = float(young or 0), float(thickness or 0), float(poisson or 0)
    return e * t * t * t / (12 * (1 - nu**2))  # t * t * t overflows to inf; t**3 would raise OverflowError


EFFECT = Effect(
    "bending",
    Bending,
    build,
    "hinge: one pass over the interior edges; quadratic: one sparse product, the matrix constant",
    ("shell",),
)
