"""Delaunay triangulations, judged by the Poisson problem that is solved on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay import flip_to_delaunay
from ddgcli.algorithms.refine import refine
from ddgcli.errors import ParameterError
from ddgcli.linalg.constrain import Poisson
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import lumped_mass, stiffness
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_largest
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.truths import Truth

ANGLES = (15.0, 25.0, 30.0)


def problem(mesh: TriangleMesh, *, truth: Truth | None = None, **_) -> Problem:
    """Solution at the input's vertices of a Poisson problem whose load is linear in the position."""
    work = 1e-2 + 1e-5 * mesh.n_vertices
    return Problem(
        candidates=[
            _candidate(mesh, "input as it is", {}, lambda: mesh, work),
            _candidate(mesh, "flips", {}, lambda: flip_to_delaunay(mesh).mesh, 2 * work),
            *(_refined_candidate(mesh, degrees, 10 * work) for degrees in ANGLES),
        ],
        references=[(0.0, lambda: _known(mesh, truth))]
        if truth is not None
        else [(40 * work, lambda: _reference(mesh, 2)), (8 * work, lambda: _reference(mesh, 1))],
        error=relative_to_largest,
        error_scale="the largest value of the reference solution",
        query="Poisson solve",
    )


def _candidate(
    mesh: TriangleMesh, method: str, dials: dict[str, Any], make: Callable[[], Any], work: float
) -> Candidate:
    words = f"--refine {dials['degrees']:g}" if dials else ""
    return Candidate(method, dials, make, lambda m: solution(m, mesh), words, work)


def _refined_candidate(mesh: TriangleMesh, degrees: float, work: float) -> Candidate:
    dials = {"degrees": degrees}
    return _candidate(mesh, "refine", dials, lambda: refine(mesh, degrees).flipped.mesh, work)


def load_function(mesh: TriangleMesh, points: NDArray) -> NDArray[np.float64]:
    """A linear function of the position along the surface's longest direction, of the order of one."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    axis = int((high - low).argmax())
    return (points[:, axis] - 0.5 * (low + high)[axis]) / (high - low)[axis]


def solution(triangulation, mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n,) solution on a triangulation of the surface, at the vertices of the input, of mean zero there."""
    weight = lumped_mass(triangulation)  # the command's default
    load = weight @ load_function(mesh, triangulation.points)
    ones = np.ones(triangulation.n_vertices)
    area = weight @ ones
    load = load - area * (load.sum() / area.sum())
    values = Poisson(stiffness(triangulation), area).solve(load)[: mesh.n_vertices]
    return values - values[mesh.topology.referenced_vertex].mean()


def _known(mesh: TriangleMesh, truth: Truth) -> Reference:
    """The load is an eigenfunction: the solution is the load over the eigenvalue."""
    if truth.linear_eigenvalue is None:
        raise ParameterError(f"no Poisson solution is known on the {truth.name}; drop --truth")
    values = load_function(mesh, mesh.points) / truth.linear_eigenvalue
    values = values - values[mesh.topology.referenced_vertex].mean()
    return Reference(f"known truth: {truth.name}", values, 1e-15, known=True)


def _reference(mesh: TriangleMesh, levels: int) -> Reference:
    meshes = [mesh]
    for _ in range(levels):
        meshes.append(midpoint_subdivided(meshes[-1]))
    found = [solution(flip_to_delaunay(m).mesh, mesh) for m in meshes]
    scale = np.abs(found[-1]).max() or 1.0
    if levels == 1:
        return Reference(
            "one midpoint subdivision", found[1], float(np.abs(found[1] - found[0]).max() / scale)
        )
    limit, uncertainty = richardson_limit(*found)
    return Reference("Richardson limit of two midpoint subdivisions", limit, float(uncertainty.max() / scale))
