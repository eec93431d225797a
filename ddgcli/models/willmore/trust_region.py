"""Trust-region Newton steps with the full Hessian of an energy, by its products with motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.normals import sphere_normals
from ddgcli.linalg.conjugate import trust_region_conjugate_gradients
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_dot
from ddgcli.models.willmore.constraints import Constraints, ConstraintSpan, areas, combined
from ddgcli.models.willmore.descent import Preconditioner, moved_along
from ddgcli.models.willmore.energies import Energy
from ddgcli.models.willmore.state import rounding_scale
from ddgcli.models.willmore.step_rules import ENERGY_ROUNDING, PREDICTED_FALL_TOLERANCE

DIFFERENCE = 1e-5  # of the points, in radii of the sphere of the component's area, for a Hessian's product
MAX_CG_ITERATIONS = 200
FIRST_RADIUS, LEAST_RADIUS = 0.06, 1e-11  # of the trust region, relative to the area
GOOD_AGREEMENT, POOR_AGREEMENT = 0.75, 0.1  # of the energy's fall with the model's


def hessian_product(
    energy: Energy, mesh: TriangleMesh, free: NDArray, motion: NDArray
) -> NDArray[np.float64]:
    """(k, 3) Hessian of an energy times a motion of the free vertices: differences of the gradient.

    No component's gradient depends on another, so that each takes a difference of its own size.

    Parameters
    ----------
    energy : Energy
    mesh : TriangleMesh
    free : (k,) ndarray of int
    motion : (k, 3) ndarray
    """
    component = mesh.topology.vertex_component
    radius, own = np.sqrt(areas(mesh, component) / (4.0 * np.pi)), component[free]
    largest = np.zeros_like(radius)
    np.maximum.at(largest, own, np.abs(motion).max(axis=1))
    step = (DIFFERENCE * ratio(radius, largest))[own][:, None]
    gradients = []
    for sign in (1.0, -1.0):
        moved = np.array(mesh.points)
        moved[free] += sign * step * motion
        gradients.append(energy.value_and_gradient(moved)[1][free])
    return ratio(gradients[0] - gradients[1], 2.0 * step)


@dataclass(frozen=True, eq=False)
class TrustRegionStep:
    """A surface after a Newton step.

    Parameters
    ----------
    mesh : TriangleMesh
    energy : float
    next_length : float
        Radius of the trust region of the next step.
    """

    mesh: TriangleMesh
    energy: float
    next_length: float


@dataclass(frozen=True, eq=False)
class Lagrangian:
    """An energy less the constraints' relative residuals times multipliers.

    Parameters
    ----------
    topology : Topology
    energy : Energy
    constraints : Constraints
    multipliers : (r, c) ndarray
    free : (k,) ndarray of int
        Vertices that move; the gradient is of no meaning at others.
    """

    topology: Topology
    energy: Energy
    constraints: Constraints
    multipliers: NDArray[np.float64]
    free: NDArray[np.int64]

    def value(self, points: NDArray) -> float:
        """Energy less multipliers times residuals."""
        residuals = self.constraints.residuals(TriangleMesh(points, self.topology)).values()
        return self.energy.value(points) - float(np.sum(self.multipliers * np.array(list(residuals))))

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """The same and its exact gradient (n, 3)."""
        gradient = np.array(self.energy.value_and_gradient(points)[1])
        rows = self.constraints.gradients(TriangleMesh(points, self.topology), self.free)
        gradient[self.free] -= combined(self.multipliers, rows, self.constraints.label(self.free))
        return self.value(points), gradient


def tangent_solve(
    metric: Preconditioner, constraints: Constraints, normal: NDArray | None
) -> Callable[[NDArray], NDArray]:
    """Preconditioner among motions along unit normals (k, 3) that keep the constraints to first order.

    Parameters
    ----------
    metric : Preconditioner
    constraints : Constraints
    normal : (k, 3) ndarray, optional
        Without, among all motions.

    Notes
    -----
    B - B C (C' B C)^-1 C' B, with B the metric's solve along the normals and C the constraints' gradients:
    conjugate gradients with it solve the equations of sequential quadratic programming.
    """

    def solve(covector: NDArray) -> NDArray:
        return _along(metric.solve(_along(covector, normal)), normal)

    rows = constraints.gradients(metric.at.mesh, metric.at.free)
    if not rows:
        return solve
    label = constraints.label(metric.at.free)
    span = ConstraintSpan.of(rows, solve, label, constraints.count)

    def solve_tangent(covector: NDArray) -> NDArray:
        return solve(covector) - span.combined(span.dual_shares(covector))

    return solve_tangent


def _along(vector: NDArray, normal: NDArray | None) -> NDArray:
    if normal is None:
        return vector
    return row_dot(vector, normal)[:, None] * normal


def descending_newton_step(
    energy: Energy,
    metric: Preconditioner,
    constraints: Constraints,
    radius: float,
    least_radius: float,
    along_normals: bool = True,
) -> TrustRegionStep | None:
    """A Newton step, in ever smaller trust regions until the energy falls as the quadratic model predicts.

    Vertices move along their normals: along the surface minima are those of the mesh, of ever worse faces.
    Where area or volume is kept, the model is that of the Lagrangian among motions tangent to the
    constraints, and the surface then returns to them.

    Parameters
    ----------
    energy : Energy
    metric : Preconditioner
        At the surface, with the gradient of the Lagrangian there.
    constraints : Constraints
    radius, least_radius : float
    along_normals : bool
        Else vertices also slide; and where rounding hides the fall, a step that changes the energy by
        rounding only is taken.

    Returns
    -------
    TrustRegionStep or None
        None where no step does; the same surface where rounding hides the fall of the model.
    """
    at = metric.at
    normal = sphere_normals(at.mesh)[at.free] if along_normals else None
    solve = tangent_solve(metric, constraints, normal)
    lagrangian = energy
    if constraints.active:
        lagrangian = Lagrangian(at.mesh.topology, energy, constraints, at.multipliers, at.free)
    while radius >= least_radius:
        newton = trust_region_conjugate_gradients(
            _along(at.gradient, normal),
            lambda v: _along(hessian_product(lagrangian, at.mesh, at.free, v), normal),
            solve,
            radius,
            MAX_CG_ITERATIONS,
        )
        try:
            moved = moved_along(metric, newton.x, 1.0, constraints)
        except SolveError:  # too far to return to the constraints
            radius *= 0.25
            continue
        after = energy.value(moved.points)
        agreement = (at.energy - after) / newton.fall if newton.fall > 0.0 else 0.0
        if newton.fall <= PREDICTED_FALL_TOLERANCE * rounding_scale(at.energy) and not after < at.energy:
            near = not along_normals and after - at.energy <= ENERGY_ROUNDING * rounding_scale(at.energy)
            return TrustRegionStep(moved if near else at.mesh, after if near else at.energy, radius)
        if agreement >= POOR_AGREEMENT:
            grows = newton.at_boundary and agreement > GOOD_AGREEMENT
            return TrustRegionStep(moved, after, radius * (2.0 if grows else 1.0))
        radius *= 0.25
    return None
