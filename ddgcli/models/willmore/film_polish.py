"""Closed films on uneven meshes: Newton steps of all vertices to a mean curvature equal at every vertex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.willmore.area_energy import AreaEnergy, volume_gradient
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import EnergyGradient, Preconditioner, second_order_matrix
from ddgcli.models.willmore.energies import Energy
from ddgcli.models.willmore.films import curvature_variation
from ddgcli.models.willmore.trust_region import LEAST_RADIUS, descending_newton_step
from ddgcli.operators.laplacian import lumped_vertex_area

MAX_STEPS = 30
FIRST_RADIUS = 0.01  # of the trust region, relative to the area
METRIC_STEP = 0.3  # of the preconditioner M + t L, for a surface at unit size
LEAST_ANGLE_SHARE = 0.25  # of the smallest angle at the start: below it the mesh has no even minimum


def mean_curvature_spread(mesh: TriangleMesh) -> float:
    """Largest less least H of a closed surface times its radius, H = |dArea| / (2 |dVolume|) at each vertex.

    Where the area is least for its volume, the area's gradient is 2 H times the volume's at every vertex,
    with one H: on any mesh, even or not.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    float
        Without unit.

    Notes
    -----
    J. M. Sullivan, "Curvatures of smooth and discrete surfaces", 2006.
    """
    referenced = mesh.topology.referenced_vertex
    pull = vector_length(AreaEnergy(mesh.topology).value_and_gradient(mesh.points)[1][referenced])
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = 0.5 * pull / vector_length(volume_gradient(mesh)[referenced])
    return float(np.ptp(curvature) * np.sqrt(area(mesh) / (4.0 * np.pi)))


def uneven_rest(at: EnergyGradient, constraints: Constraints, tolerance: float | None) -> bool:
    """Whether a closed film is at rest along its normals, and its curvature not equal at all vertices.

    Parameters
    ----------
    at : EnergyGradient
    constraints : Constraints
    tolerance : float, optional
        Of the curvature times the radius.

    Returns
    -------
    bool
    """
    uneven = has_uneven_curvature(at, constraints, tolerance)
    return uneven and curvature_variation(at, constraints) <= (tolerance or 0.0)


def has_uneven_curvature(at: EnergyGradient, constraints: Constraints, tolerance: float | None) -> bool:
    """Whether the curvature of a closed film is not equal at all vertices, all of which may move.

    Parameters
    ----------
    at, constraints, tolerance
        As in `uneven_rest`.

    Returns
    -------
    bool
    """
    if not (constraints.in_place and constraints.active and tolerance and len(at.free) == at.mesh.n_vertices):
        return False
    return mean_curvature_spread(at.mesh) > tolerance


def polished_film(
    mesh: TriangleMesh, energy: Energy, free: NDArray, constraints: Constraints, spread: float
) -> TriangleMesh | None:
    """The film whose vertices are all in balance, along the surface too; None where the mesh has none near.

    Parameters
    ----------
    mesh : TriangleMesh
        A film at rest along its normals.
    energy : Energy
        What it lowers.
    free : (k,) ndarray of int
    constraints : Constraints
    spread : float
        `mean_curvature_spread` to reach.

    Returns
    -------
    TriangleMesh or None
    """
    relaxed = replace(constraints, in_place=False)
    radius, least = FIRST_RADIUS * area(mesh), LEAST_ANGLE_SHARE * corner_angle(mesh.side_length).min()
    for _ in range(MAX_STEPS):
        if mean_curvature_spread(mesh) <= spread:
            return mesh
        value, gradient = energy.value_and_gradient(mesh.points)
        columns = np.stack([row.ravel() for row in relaxed.gradients(mesh, free)], axis=1)
        share = np.linalg.lstsq(columns, gradient[free].ravel(), rcond=None)[0]
        balance = gradient[free] - np.reshape(columns @ share, (-1, 3))
        at = EnergyGradient(mesh, free, value, balance, lumped_vertex_area(mesh)[free], share[:, None])
        metric = Preconditioner(at, Factor(second_order_matrix(mesh, free, METRIC_STEP)))
        step = descending_newton_step(
            energy, metric, relaxed, radius, LEAST_RADIUS * area(mesh), along_normals=False
        )
        if step is None or step.mesh is mesh or corner_angle(step.mesh.side_length).min() < least:
            return None
        mesh, radius = step.mesh, step.next_length
    return None
