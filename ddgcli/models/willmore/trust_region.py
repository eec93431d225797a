"""Trust-region Newton steps with the full Hessian of an energy, by its products with motions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.willmore.constraints import Constraints
from ddgcli.models.willmore.descent import Preconditioner, moved_along, vertex_normals
from ddgcli.models.willmore.energies import Energy

DIFFERENCE = 1e-5  # of the points, relative to their extent, for a Hessian's product with a motion
MAX_CG_ITERATIONS = 200
FIRST_RADIUS, LEAST_RADIUS = 0.06, 1e-11  # of the trust region, relative to the area
GOOD_AGREEMENT, POOR_AGREEMENT = 0.75, 0.1  # of the energy's fall with the model's


@dataclass(frozen=True, eq=False)
class NewtonMotion:
    """Minimiser of the quadratic model in the trust region.

    Parameters
    ----------
    motion : (k, 3) ndarray
    promised : float
        Fall of the model.
    at_boundary : bool
        The trust region has cut it.
    """

    motion: NDArray[np.float64]
    promised: float
    at_boundary: bool


def hessian_product(energy: Energy, points: NDArray, free: NDArray, motion: NDArray) -> NDArray[np.float64]:
    """(k, 3) Hessian of an energy times a motion of the free vertices: differences of the gradient.

    Parameters
    ----------
    energy : Energy
    points : (n, 3) ndarray
    free : (k,) ndarray of int
    motion : (k, 3) ndarray
    """
    largest = float(np.abs(motion).max())
    if largest == 0.0:
        return np.zeros_like(motion)
    step = DIFFERENCE * float(np.abs(points).max()) / largest
    gradients = []
    for sign in (1.0, -1.0):
        moved = np.array(points)
        moved[free] += sign * step * motion
        gradients.append(energy.value_and_gradient(moved)[1][free])
    return (gradients[0] - gradients[1]) / (2.0 * step)


def newton_motion(
    gradient: NDArray,
    product: Callable[[NDArray], NDArray],
    solve: Callable[[NDArray], NDArray],
    radius: float,
) -> NewtonMotion:
    """Minimise g.d + d.Hd/2 for |d| <= radius, in the norm of a preconditioner, by conjugate gradients.

    Parameters
    ----------
    gradient : (k, 3) ndarray
    product : callable
        Motion -> Hessian times motion.
    solve : callable
        Of the preconditioner, covector -> motion.
    radius : float

    Notes
    -----
    T. Steihaug, "The conjugate gradient method and trust regions in large scale optimization", 1983.
    """
    d, r = np.zeros_like(gradient), np.array(gradient)
    z = solve(r)
    p, rz = -z, float(np.sum(r * z))
    aim = min(0.25, rz**0.25) * math.sqrt(max(rz, 0.0))
    dd, dp, pp, promised = 0.0, 0.0, rz, 0.0
    for _ in range(MAX_CG_ITERATIONS):
        hp = product(p)
        bent = float(np.sum(p * hp))
        alpha = rz / bent if bent > 0.0 else math.inf
        if alpha == math.inf or dd + 2.0 * alpha * dp + alpha**2 * pp >= radius**2:
            tau = (-dp + math.sqrt(max(dp**2 + pp * (radius**2 - dd), 0.0))) / pp
            promised += tau * rz - 0.5 * tau**2 * bent
            return NewtonMotion(d + tau * p, promised, True)
        d, r = d + alpha * p, r + alpha * hp
        promised += 0.5 * alpha * rz
        dd += 2.0 * alpha * dp + alpha**2 * pp
        z = solve(r)
        after = float(np.sum(r * z))
        if math.sqrt(max(after, 0.0)) <= aim:
            break
        beta, rz = after / rz, after
        dp, pp = beta * (dp + alpha * pp), after + beta**2 * pp
        p = -z + beta * p
    return NewtonMotion(d, promised, False)


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


def descending_newton_step(
    energy: Energy, metric: Preconditioner, radius: float, least_radius: float
) -> TrustRegionStep | None:
    """A Newton step, in ever smaller trust regions until the energy falls as the quadratic model says.

    Vertices move along their normals: along the surface minima are those of the mesh, of ever worse faces.

    Parameters
    ----------
    energy : Energy
    metric : Preconditioner
        At the surface, with the gradient there.
    radius, least_radius : float

    Returns
    -------
    TrustRegionStep or None
        None where no step does.
    """
    at = metric.at
    normal = vertex_normals(at.mesh)[at.free]

    def across(covector: NDArray) -> NDArray:
        return row_dot(covector, normal)[:, None] * normal

    while radius >= least_radius:
        newton = newton_motion(
            across(at.gradient),
            lambda v: across(hessian_product(energy, at.mesh.points, at.free, v)),
            lambda covector: across(metric.solve(covector)),
            radius,
        )
        moved = moved_along(metric, newton.motion, 1.0, Constraints())
        after = energy.value(moved.points)
        agreement = (at.energy - after) / newton.promised if newton.promised > 0.0 else 0.0
        if agreement >= POOR_AGREEMENT:
            grows = newton.at_boundary and agreement > GOOD_AGREEMENT
            return TrustRegionStep(moved, after, radius * (2.0 if grows else 1.0))
        radius *= 0.25
    return None
