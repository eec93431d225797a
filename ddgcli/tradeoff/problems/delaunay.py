"""Delaunay triangulations, judged by the Poisson problem that is solved on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay import flip_to_delaunay
from ddgcli.linalg.constrain import Poisson
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import galerkin_mass, stiffness
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_largest
from ddgcli.tradeoff.richardson import richardson_limit


def problem(mesh: TriangleMesh, **_) -> Problem:
    """Solution at the input's vertices of a Poisson problem whose load is linear in the position."""
    work = 1e-2 + 1e-5 * mesh.n_vertices
    return Problem(
        candidates=[
            Candidate("input as it is", {}, lambda: mesh, lambda m: solution(m, mesh), "", work),
            Candidate(
                "flips", {}, lambda: flip_to_delaunay(mesh).mesh, lambda m: solution(m, mesh), "", 2 * work
            ),
        ],
        references=[
            (40 * work, lambda: _reference(mesh, 2)),
            (8 * work, lambda: _reference(mesh, 1)),
        ],
        error=relative_to_largest,
        error_scale="the largest value of the reference solution",
        query="Poisson solve",
    )


def load_function(mesh: TriangleMesh, points: NDArray) -> NDArray[np.float64]:
    """A linear function of the position along the surface's longest direction, of the order of one."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    axis = int((high - low).argmax())
    return (points[:, axis] - 0.5 * (low + high)[axis]) / (high - low)[axis]


def solution(triangulation, mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n,) solution on a triangulation of the surface, at the vertices of the input, of mean zero there."""
    weight = galerkin_mass(triangulation)
    load = weight @ load_function(mesh, triangulation.points)
    ones = np.ones(triangulation.n_vertices)
    area = weight @ ones
    load = load - area * (load.sum() / area.sum())
    values = Poisson(stiffness(triangulation), area).solve(load)[: mesh.n_vertices]
    return values - values[mesh.topology.referenced_vertex].mean()


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
