"""Laplacian: eigenvalues by operator and mass, against the limit of refinements of the same polyhedron."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.laplace_operator import MASSES, LaplaceOperator, laplace_operator
from ddgcli.errors import ParameterError
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    Problem,
    Reference,
    relative_to_each,
)
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.smooth_surface import is_plain_surface, smooth_answer
from ddgcli.tradeoff.truths import Truth

OPERATORS = ("cotan", "intrinsic-delaunay")
OPERATORS_OF_ANY_SURFACE = ("cotan", "tufted")
NO_LENGTHS = "it uses no lengths: its eigenvalues are those of the graph"


def problem(
    mesh: TriangleMesh, *, truth: Truth | None = None, options: CommandOptions = NO_OPTIONS
) -> Problem:
    """The first eigenvalues (8 by default) of the Laplacian of the surface.

    `options` may contain `eigen`, `operator`, `mass` and `subdivide`.
    """
    k = options.get("eigen", min(8, mesh.n_vertices // 2))
    if truth is not None and truth.eigenvalues is None:
        raise ParameterError(f"no eigenvalues are known of the {truth.name}; leave it out", parameter="truth")
    if truth is not None and truth.eigenvalues is not None:
        truth_reference = Reference.from_truth(truth.name, truth.eigenvalues(k))
        references = [(0.0, lambda: truth_reference)]
    else:
        references = [
            (_work(mesh, k) * 30, lambda: _refined_reference(mesh, k, 2)),
            (_work(mesh, k) * 6, lambda: _refined_reference(mesh, k, 1)),
        ]
    operators = (
        [options["operator"]]
        if "operator" in options
        else OPERATORS
        if is_plain_surface(mesh)
        else OPERATORS_OF_ANY_SURFACE
    )
    if options.get("operator") == "uniform":
        raise ParameterError(f"uniform: {NO_LENGTHS}; compare {', '.join(OPERATORS)}", parameter="operator")
    return Problem(
        candidates=[
            _candidate(mesh, k, operator, kind, level)
            for level in ((0, 1) if "subdivide" not in options else (options["subdivide"],))
            for operator in operators
            if level == 0 or operator != "cotan" or "subdivide" in options
            for kind in MASSES
            if options.get("mass", kind) == kind
        ],
        references=references,
        error=relative_to_each,
        error_scale="each eigenvalue of the reference (absolute where it is zero)",
        place="eigenvalue",
        query=f"set of {k}",
        left_out=(("uniform", NO_LENGTHS),),
        smooth=(8 * _work(mesh, k), lambda: smooth_answer(mesh, lambda finer: _spectrum(finer, k)))
        if is_plain_surface(mesh)
        else None,
    )


def _work(mesh: TriangleMesh, k: int) -> float:
    return 5e-3 + mesh.n_vertices * (2e-5 + 2e-6 * k)


def _candidate(mesh: TriangleMesh, k: int, operator: str, kind: str, level: int) -> Candidate:
    arguments = {"operator": operator, "mass": kind, "eigen": str(k)}
    return Candidate(
        operator,
        {"mass": kind} | ({"subdivide": level} if level else {}),
        lambda: laplace_operator(midpoint_subdivided(mesh, level), operator, kind),
        lambda laplacian: eigenvalues(laplacian, k),
        arguments | ({"subdivide": str(level)} if level else {}),
        _work(mesh, k) * 4**level,
    )


def eigenvalues(laplacian: LaplaceOperator, k: int) -> NDArray[np.float64]:
    """(k,) smallest eigenvalues of an operator."""
    vertices = laplacian.referenced_vertices
    return smallest_eigenpairs(
        laplacian.stiffness[vertices][:, vertices], laplacian.mass[vertices][:, vertices], k
    ).values


def _refined_reference(mesh: TriangleMesh, k: int, levels: int) -> Reference:
    """Limit over midpoint subdivisions (the same surface) on their intrinsic Delaunay triangulations."""
    spectra = [_spectrum(midpoint_subdivided(mesh, level), k) for level in range(levels + 1)]
    if levels == 1:
        gap = relative_to_each(spectra[0], spectra[1])
        return Reference.from_agreement("one midpoint subdivision", spectra[1], gap)
    limit, uncertainty = richardson_limit(*spectra)
    gap = relative_to_each(limit + uncertainty, limit)
    return Reference.from_agreement("Richardson limit of two midpoint subdivisions", limit, gap)


def _spectrum(mesh: TriangleMesh, k: int) -> NDArray[np.float64]:
    operator = "intrinsic-delaunay" if is_plain_surface(mesh) else "tufted"
    return eigenvalues(laplace_operator(mesh, operator, "galerkin"), k)
