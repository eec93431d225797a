"""Smoothing by implicit mean curvature flow."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddgcli.algorithms.laplacian.choice import laplace_operator
from ddgcli.errors import MeshError, ParameterError, SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.triangle_mesh import TriangleMesh

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A surface after some mean curvature flow.

    Parameters
    ----------
    mesh : TriangleMesh
    area : list of float
        Before and after every step.
    residual : float
        Largest relative residual of the steps.
    time : float
        How far the flow got; shorter than asked for where the surface vanished before.
    """

    mesh: TriangleMesh
    area: list[float]
    residual: float
    time: float


def smooth(
    mesh: TriangleMesh,
    time: float,
    *,
    steps: int = 10,
    operator: str | None = None,
    mass: str = "lumped",
    progress: Callable[[int, int], Any] | None = None,
) -> Smoothed:
    """Points after mean curvature flow dx/dt = (Laplacian of x) = -2 H n for `time`, in length squared.

    Backward Euler, (M + dt L) x' = M x, with L and M of the surface at the start of each step; boundary
    vertices stay. A sphere of radius r shrinks as r^2 - 4 t. M. Desbrun et al., "Implicit fairing of
    irregular meshes using diffusion and curvature flow", 1999.
    """
    if time <= 0 or steps < 1:
        raise ParameterError("smoothing needs a time greater than 0 and at least one step")
    dt = time / steps
    area = [float(face_area(mesh.side_length).sum())]
    start, worst, reached = area[0], 0.0, 0.0
    for step in range(steps):
        if progress is not None:
            progress(step, steps)
        try:
            moved, residual = _step(mesh, dt, operator, mass)
        except (SolveError, MeshError):
            break
        if not np.isfinite(moved.points).all():
            break
        mesh, worst, reached = moved, max(worst, residual), reached + dt
        area.append(float(face_area(mesh.side_length).sum()))
        if area[-1] < 1e-9 * start:
            break
    if reached < time * (1 - 1e-9):
        log.warning("the surface shrank to nothing at time %g: take less", reached)
    return Smoothed(mesh, area, worst, reached)


def _step(mesh: TriangleMesh, dt: float, operator: str | None, mass: str) -> tuple[TriangleMesh, float]:
    laplace = laplace_operator(mesh, operator, mass)
    fixed = mesh.topology.boundary_vertex | ~mesh.topology.referenced_vertex
    centre = mesh.points.mean(axis=0)
    points = mesh.points - centre
    problem = Dirichlet(laplace.mass + dt * laplace.stiffness, fixed)
    rhs = laplace.mass @ points
    moved = problem.solve(points[problem.fixed], rhs)
    placed = np.where(fixed[:, None], mesh.points, moved + centre)
    return mesh.moved(placed), problem.residual(moved, rhs)
