"""Laplacian: eigenvalues by operator and mass, against the limit of refinement of the same polyhedron."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.choice import MASSES, LaplaceOperator, laplace_operator
from ddgcli.errors import ParameterError
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference, relative_to_each
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.truths import Truth

OPERATORS = ("cotan", "intrinsic-delaunay")
EVERYWHERE = ("cotan", "tufted")
NO_LENGTHS = "it knows no lengths: its eigenvalues are those of the graph"


def problem(mesh: TriangleMesh, *, truth: Truth | None = None, asked: Asked = NOTHING) -> Problem:
    """The first eigenvalues (8 by default) of the Laplacian of the surface.

    `asked` may hold `eigen`, `operator`, `mass` and `subdivide`.
    """
    k = asked.get("eigen", min(8, mesh.n_vertices // 2))
    if truth is not None and truth.eigenvalues is None:
        raise ParameterError(f"no eigenvalues are known of the {truth.name}; drop --truth")
    if truth is not None and truth.eigenvalues is not None:
        known = Reference.of_truth(truth.name, truth.eigenvalues(k))
        references = [(0.0, lambda: known)]
    else:
        references = [
            (_work(mesh, k) * 30, lambda: _refined_reference(mesh, k, 2)),
            (_work(mesh, k) * 6, lambda: _refined_reference(mesh, k, 1)),
        ]
    operators = [asked["operator"]] if "operator" in asked else OPERATORS if _sound(mesh) else EVERYWHERE
    if asked.get("operator") == "uniform":
        raise ParameterError(f"--operator uniform: {NO_LENGTHS}; compare {', '.join(OPERATORS)}")
    return Problem(
        candidates=[
            _candidate(mesh, k, operator, kind, level)
            for level in ((0, 1) if "subdivide" not in asked else (asked["subdivide"],))
            for operator in operators
            if level == 0 or operator != "cotan" or "subdivide" in asked
            for kind in MASSES
            if asked.get("mass", kind) == kind
        ],
        references=references,
        error=relative_to_each,
        error_scale="each eigenvalue of the reference (absolute where it is zero)",
        place="eigenvalue",
        query=f"set of {k}",
        left_out=(("uniform", NO_LENGTHS),),
    )


def _work(mesh: TriangleMesh, k: int) -> float:
    return 5e-3 + mesh.n_vertices * (2e-5 + 2e-6 * k)


def _candidate(mesh: TriangleMesh, k: int, operator: str, kind: str, level: int) -> Candidate:
    words = f"--operator {operator} --mass {kind} --eigen {k}"
    return Candidate(
        operator,
        {"mass": kind} | ({"subdivide": level} if level else {}),
        lambda: laplace_operator(midpoint_subdivided(mesh, level), operator, kind),
        lambda made: eigenvalues(made, k),
        words + (f" --subdivide {level}" if level else ""),
        _work(mesh, k) * 4**level,
    )


def eigenvalues(made: LaplaceOperator, k: int) -> NDArray[np.float64]:
    """(k,) smallest eigenvalues of an operator."""
    used = made.used
    return smallest_eigenpairs(made.stiffness[used][:, used], made.mass[used][:, used], k).values


def _refined_reference(mesh: TriangleMesh, k: int, levels: int) -> Reference:
    """Limit over midpoint subdivisions (the same surface) on their intrinsic Delaunay triangulations."""
    operator = "intrinsic-delaunay" if _sound(mesh) else "tufted"
    found = [
        eigenvalues(laplace_operator(midpoint_subdivided(mesh, level), operator, "galerkin"), k)
        for level in range(levels + 1)
    ]
    if levels == 1:
        gap = relative_to_each(found[0], found[1])
        return Reference.as_far_as("one midpoint subdivision", found[1], gap)
    limit, uncertainty = richardson_limit(*found)
    gap = relative_to_each(limit + uncertainty, limit)
    return Reference.as_far_as("Richardson limit of two midpoint subdivisions", limit, gap)


def _sound(mesh: TriangleMesh) -> bool:
    return mesh.topology.is_oriented and not len(mesh.topology.nonmanifold_edges)
