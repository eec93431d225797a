"""Laplacian: eigenvalues by operator and mass, against the limit of refinement of the same polyhedron."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay import flip_to_delaunay
from ddgcli.errors import ParameterError
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import galerkin_mass, lumped_mass, stiffness, voronoi_mass
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_each
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.truths import Truth

OPERATORS = ("cotan", "intrinsic-delaunay")
MASSES = {"lumped": lumped_mass, "voronoi": voronoi_mass, "galerkin": galerkin_mass}


def problem(mesh: TriangleMesh, *, eigen: int | None = None, truth: Truth | None = None, **_) -> Problem:
    """The first eigenvalues (8 by default) of the Laplacian of the surface."""
    k = min(eigen or 8, mesh.n_vertices // 2)
    if truth is not None and truth.eigenvalues is None:
        raise ParameterError(f"no eigenvalues are known of the {truth.name}; drop --truth")
    if truth is not None and truth.eigenvalues is not None:
        known = Reference(f"known truth: {truth.name}", truth.eigenvalues(k), 1e-15, known=True)
        references = [(0.0, lambda: known)]
    else:
        references = [
            (_work(mesh, k) * 30, lambda: _refined_reference(mesh, k, 2)),
            (_work(mesh, k) * 6, lambda: _refined_reference(mesh, k, 1)),
        ]
    return Problem(
        candidates=[_candidate(mesh, k, op, kind) for op in OPERATORS for kind in MASSES],
        references=references,
        error=relative_to_each,
        error_scale="each eigenvalue of the reference (absolute where it is zero)",
        place="eigenvalue",
        left_out=(("uniform", "it knows no lengths: its eigenvalues are those of the graph"),),
    )


def _work(mesh: TriangleMesh, k: int) -> float:
    return 5e-3 + mesh.n_vertices * (2e-5 + 2e-6 * k)


def _candidate(mesh: TriangleMesh, k: int, operator: str, kind: str) -> Candidate:
    return Candidate(
        operator,
        {"mass": kind},
        lambda: flip_to_delaunay(mesh).mesh if operator == "intrinsic-delaunay" else mesh,
        lambda surface: eigenvalues(surface, kind, k),
        f"--operator {operator} --mass {kind} --eigen {k}",
        _work(mesh, k),
    )


def eigenvalues(surface, kind: str, k: int) -> NDArray[np.float64]:
    """(k,) smallest eigenvalues on a triangulation as it is."""
    return smallest_eigenpairs(stiffness(surface), MASSES[kind](surface), k).values


def _refined_reference(mesh: TriangleMesh, k: int, levels: int) -> Reference:
    """Limit over midpoint subdivisions (the same surface) on their intrinsic Delaunay triangulations."""
    meshes = [mesh]
    for _ in range(levels):
        meshes.append(midpoint_subdivided(meshes[-1]))
    found = [eigenvalues(flip_to_delaunay(m).mesh, "galerkin", k) for m in meshes]
    if levels == 1:
        return Reference("one midpoint subdivision", found[1], _gap(found[1] - found[0], found[1]))
    limit, uncertainty = richardson_limit(*found)
    return Reference("Richardson limit of two midpoint subdivisions", limit, _gap(uncertainty, limit))


def _gap(difference: NDArray, values: NDArray) -> float:
    return float((np.abs(difference) / np.where(values == 0, 1.0, np.abs(values))).max(initial=0.0))
