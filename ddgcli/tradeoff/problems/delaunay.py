"""Delaunay triangulations, compared by the solution of a Poisson problem on them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.errors import ParameterError, SolveError
from ddgcli.linalg.constrain import Poisson
from ddgcli.mesh.require import require
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import lumped_mass, stiffness
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    Problem,
    Reference,
    relative_to_largest,
)
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.smooth_surface import is_plain_surface, smooth_answer
from ddgcli.tradeoff.truths import Truth

ANGLES = (15.0, 25.0, 30.0)


def problem(
    mesh: TriangleMesh, *, truth: Truth | None = None, options: CommandOptions = NO_OPTIONS
) -> Problem:
    """Solution at the input's vertices of a Poisson problem whose load is linear in the position.

    `options` may contain `refine`, `max_points` and `subdivide`.
    """
    require(mesh, "a comparison of triangulations", faces=True, sized=True)
    work = 1e-2 + 1e-5 * mesh.n_vertices
    max_points = options.get("max_points")
    level = options.get("subdivide")
    angles = (options["refine"],) if "refine" in options else ANGLES
    return Problem(
        candidates=[
            Candidate(
                "input as it is", {}, lambda: mesh, lambda m: solution(m, mesh), {"operator": "cotan"}, work,
                program="laplacian",
            ),
            *(_flipped(mesh, times, work) for times in ((0, 1) if level is None else (level,))),
            *(_refined(mesh, degrees, max_points, level or 0, work) for degrees in angles),
        ],
        references=[(0.0, lambda: _analytic_reference(mesh, truth))]
        if truth is not None
        else [(40 * work, lambda: _reference(mesh, 2)), (8 * work, lambda: _reference(mesh, 1))],
        error=relative_to_largest,
        error_scale="the largest value of the reference solution",
        query="Poisson solve",
        smooth=(10 * work, lambda: smooth_answer(mesh, lambda finer: _delaunay_solution(finer, mesh)))
        if is_plain_surface(mesh)
        else None,
    )  # fmt: skip


def _flipped(mesh: TriangleMesh, times: int, work: float) -> Candidate:
    return Candidate(
        "flips",
        {"subdivide": times} if times else {},
        lambda: flip_to_delaunay(midpoint_subdivided(mesh, times)).mesh,
        lambda m: solution(m, mesh),
        {"subdivide": str(times)} if times else {},
        2 * work * 4**times,
    )


def _refined(
    mesh: TriangleMesh, degrees: float, max_points: int | None, times: int, work: float
) -> Candidate:
    arguments = {"refine": f"{degrees:.12g}"}
    arguments |= {"max_points": str(max_points)} if max_points is not None else {}
    arguments |= {"subdivide": str(times)} if times else {}

    def setup() -> Any:
        refined = refine(midpoint_subdivided(mesh, times), degrees, max_points=max_points)
        if not refined.converged:
            raise SolveError(f"{max_points} Steiner points are not enough for {degrees:g} degrees")
        return refined.triangulation.mesh

    return Candidate(
        "refine",
        {"degrees": degrees} | ({"subdivide": times} if times else {}),
        setup,
        lambda m: solution(m, mesh),
        arguments,
        10 * work * 4**times,
    )


def load_function(mesh: TriangleMesh, points: NDArray) -> NDArray[np.float64]:
    """Linear function of the position along the longest side of the bounding box, of the order of one."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    axis = int((high - low).argmax())
    return (points[:, axis] - 0.5 * (low + high)[axis]) / (high - low)[axis]


def solution(triangulation, mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n,) solution on a triangulation of the surface at the vertices of the input, with mean zero."""
    weight = lumped_mass(triangulation)  # the command's default
    load = weight @ load_function(mesh, triangulation.points)
    ones = np.ones(triangulation.n_vertices)
    area = weight @ ones
    load = load - area * (load.sum() / area.sum())
    values = Poisson(stiffness(triangulation), area).solve(load)[: mesh.n_vertices]
    return values - values[mesh.topology.referenced_vertex].mean()


def _delaunay_solution(finer: TriangleMesh, mesh: TriangleMesh) -> NDArray[np.float64]:
    return solution(flip_to_delaunay(finer).mesh, mesh)


def _analytic_reference(mesh: TriangleMesh, truth: Truth) -> Reference:
    """Analytic solution: the load is an eigenfunction, so the solution is the load over the eigenvalue."""
    if truth.linear_eigenvalue is None:
        raise ParameterError(
            f"no Poisson solution is known on the {truth.name}; leave it out", parameter="truth"
        )
    values = load_function(mesh, mesh.points) / truth.linear_eigenvalue
    values = values - values[mesh.topology.referenced_vertex].mean()
    return Reference.from_truth(truth.name, values)


def _reference(mesh: TriangleMesh, levels: int) -> Reference:
    solutions = [_delaunay_solution(midpoint_subdivided(mesh, level), mesh) for level in range(levels + 1)]
    scale = np.abs(solutions[-1]).max() or 1.0
    if levels == 1:
        return Reference.from_agreement(
            "one midpoint subdivision", solutions[1], np.abs(solutions[1] - solutions[0]) / scale
        )
    limit, gap = richardson_limit(*solutions)
    return Reference.from_agreement("Richardson limit of two midpoint subdivisions", limit, gap / scale)
