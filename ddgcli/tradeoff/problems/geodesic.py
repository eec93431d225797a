"""Geodesic distance: all methods against the exact polyhedral distance or a known truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceOptions, prepare_solver
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    Problem,
    Reference,
    relative_to_largest,
)
from ddgcli.tradeoff.smooth_surface import is_plain_surface, smooth_answer
from ddgcli.tradeoff.truths import Truth

TOLERANCES = (0.3, 0.1, 0.03, 0.01)
MAX_SMOOTH_VERTICES = 100_000  # the smooth surface has four times as many; exact windows of them take 2 GB
METHOD_PARAMETERS = ("tolerance", "operator", "heat_time", "heat_refine")


def problem(
    mesh: TriangleMesh,
    *,
    sources: Sources | None = None,
    truth: Truth | None = None,
    options: CommandOptions = NO_OPTIONS,
) -> Problem:
    """Distance from the sources (vertex 0 by default) to every vertex.

    `options` may contain `method`, its parameters and `subdivide`.
    """
    first_vertex = sources is None
    sources = Sources.at((0,)) if sources is None else sources
    if truth is not None and (truth.distance is None or len(sources) > 1):
        raise ParameterError(
            f"no distance from {len(sources)} sources is known on the {truth.name}; leave it out",
            parameter="truth",
        )
    if truth is not None and truth.distance is not None:
        values = truth.distance(mesh.points, sources.positions(mesh)[0])
        truth_reference = Reference.from_truth(truth.name, values)
        references = [(0.0, lambda: truth_reference)]
    else:
        references = [
            (_work(mesh, "exact", 0.0) * 2, lambda: _exact_reference(mesh, sources)),
            (_work(mesh, "exact", 0.1) * 2, lambda: _approximate_reference(mesh, sources)),
            (_work(mesh, "fast-marching", 0.0) * 2, lambda: _fast_marching_reference(mesh, sources)),
        ]
    source_arguments = {"source": "0"} if first_vertex else {}
    return Problem(
        candidates=[
            _candidate(mesh, sources, source_arguments, method, parameters)
            for method, parameters in _method_parameters(options)
        ],
        references=references,
        error=relative_to_largest,
        error_scale="the largest distance of the reference",
        query="set of sources",
        smooth=_smooth(mesh, sources),
    )


def _method_parameters(options: CommandOptions) -> list[tuple[str, dict[str, Any]]]:
    """Methods and their parameters, cheap ones first; the caller's options replace the defaults."""
    heat: dict[str, Any] = {
        name: options[name] for name in ("operator", "heat_time", "heat_refine") if name in options
    }
    heats: list[dict[str, Any]] = [heat] if heat else [{"operator": "plain"}, {}, {"heat_refine": 3}]
    tolerances = (options["tolerance"],) if "tolerance" in options else (*TOLERANCES, 0.0)
    methods: list[tuple[str, dict[str, Any]]] = [
        ("dijkstra", {}),
        *[("heat", parameters) for parameters in heats],
        ("fast-marching", {}),
        *[("exact", {"tolerance": tolerance}) for tolerance in tolerances],
    ]
    if "subdivide" in options:
        methods = [
            (method, parameters | {"subdivide": options["subdivide"]}) for method, parameters in methods
        ]
    else:
        finer = [("heat", heat | {"subdivide": 1}), ("fast-marching", {"subdivide": 1})]
        methods = methods[:-1] + finer + methods[-1:]
    return [(m, parameters) for m, parameters in methods if options.get("method", m) == m]


def _smooth(mesh: TriangleMesh, sources: Sources) -> tuple[float, Callable[[], NDArray]] | None:
    """Distance on a smooth surface through the vertices, from sources at vertices."""
    few = mesh.n_vertices <= MAX_SMOOTH_VERTICES
    if not few or len(sources.vertex) < len(sources) or not is_plain_surface(mesh):
        return None

    def distance(finer: TriangleMesh) -> NDArray:
        return exact_distance(finer, sources).distance[: mesh.n_vertices]

    return 6 * _work(mesh, "exact", 0.0), lambda: smooth_answer(mesh, distance)


def _exact_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Exact distance; its uncertainty is the difference of two runs with different pruning."""
    tables = window_tables(mesh)
    first = exact_distance(mesh, sources, tables=tables).distance
    second = exact_distance(mesh, sources, tables=tables, dominance_every=3).distance
    disagreement = float(relative_to_largest(second, first).max(initial=0.0))
    return Reference("exact polyhedral distance", first, max(disagreement, 1e-14))


def _approximate_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Exact method with two tolerances: errors are positive, so the smaller distance is nearer."""
    tables = window_tables(mesh)
    coarse, fine = (exact_distance(mesh, sources, tables=tables, tolerance=t).distance for t in (0.3, 0.1))
    gap = relative_to_largest(coarse, np.minimum(coarse, fine))
    name = "exact method with tolerance 0.1 (uncertainty from tolerance 0.3)"
    return Reference.from_agreement(name, np.minimum(coarse, fine), gap)


def _fast_marching_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Fast marching; its uncertainty is the difference from the distance along edges, an upper bound."""
    distance, along_edges = (
        distance_solver(mesh, method, DistanceOptions())(sources) for method in ("fast-marching", "dijkstra")
    )
    gap = relative_to_largest(along_edges, distance)
    name = "fast marching (uncertainty from distances along edges)"
    return Reference.from_agreement(name, distance, gap)


def _work(mesh: TriangleMesh, method: str, tolerance: float) -> float:
    """Estimated seconds of a run; `exact` as on smooth shapes, where it takes the longest."""
    n = mesh.n_vertices
    if method == "exact":
        return 2e-2 + 1.5e-6 * n**1.2 / (1 + 20 * tolerance)
    return {"dijkstra": 4e-6, "fast-marching": 2e-5, "heat": 2e-5}[method] * n + 1e-3


def _candidate(
    mesh: TriangleMesh,
    sources: Sources,
    source_arguments: dict[str, str],
    method: str,
    parameters: dict[str, Any],
) -> Candidate:
    """Method with its parameters; its preparation is the set-up."""
    method_options = {name: value for name, value in parameters.items() if name in METHOD_PARAMETERS}
    level = parameters.get("subdivide", 0)
    nonzero = {name: value for name, value in parameters.items() if value != 0.0}
    arguments = source_arguments | ({"method": method} if method != "exact" else {})
    arguments |= {
        name: f"{value:.12g}" if isinstance(value, float) else str(value) for name, value in nonzero.items()
    }
    options = DistanceOptions(**method_options)

    def setup() -> Callable[[], NDArray]:
        subdivision = MidpointSubdivision.of(mesh, level)
        points = subdivision.points(sources.points.face, sources.points.barycentric)
        solve = distance_solver(subdivision.mesh, method, options)
        return partial(solve, replace(sources, points=SurfacePoints(*points)))

    return Candidate(
        method,
        parameters,
        setup,
        lambda solve: solve()[: mesh.n_vertices],
        arguments,
        _work(mesh, method, options.tolerance) * (4**level if method != "exact" else 8**level),
    )


def distance_solver(
    mesh: TriangleMesh, method: str, options: DistanceOptions
) -> Callable[[Sources], NDArray]:
    """Solver of distances alone: the exact method without the second run that estimates its error."""
    if method == "exact":
        tables = window_tables(mesh)
        return lambda at: exact_distance(mesh, at, tables=tables, tolerance=options.tolerance).distance
    solve = prepare_solver(mesh, method, options)
    return lambda at: solve(at).distance
