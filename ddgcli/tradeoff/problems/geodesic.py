"""Geodesic distance: every method against the exact polyhedral distance, or a known truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceOptions, prepare
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import ParameterError
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference, relative_to_largest
from ddgcli.tradeoff.truths import Truth

TOLERANCES = (0.3, 0.1, 0.03, 0.01)
DIALS = ("tolerance", "operator", "heat_time", "heat_refine")


def problem(
    mesh: TriangleMesh, *, sources: Sources | None = None, truth: Truth | None = None, asked: Asked = NOTHING
) -> Problem:
    """Distance from the sources (vertex 0 by default) to every vertex.

    `asked` may hold `method`, its dials and `subdivide`.
    """
    first_vertex = sources is None
    sources = Sources.at((0,)) if sources is None else sources
    if truth is not None and (truth.distance is None or len(sources) > 1):
        raise ParameterError(
            f"no distance from {len(sources)} sources is known on the {truth.name}; drop --truth"
        )
    if truth is not None and truth.distance is not None:
        values = truth.distance(mesh.points, sources.positions(mesh)[0])
        known = Reference.of_truth(truth.name, values)
        references = [(0.0, lambda: known)]
    else:
        references = [
            (_work(mesh, "exact", 0.0) * 2, lambda: _exact_reference(mesh, sources)),
            (_work(mesh, "exact", 0.1) * 2, lambda: _approximate_reference(mesh, sources)),
            (_work(mesh, "fast-marching", 0.0) * 2, lambda: _marched_reference(mesh, sources)),
        ]
    prefix = "--source 0 " if first_vertex else ""
    return Problem(
        candidates=[_candidate(mesh, sources, prefix, method, dials) for method, dials in _dials(asked)],
        references=references,
        error=relative_to_largest,
        error_scale="the largest distance of the reference",
        query="set of sources",
    )


def _dials(asked: Asked) -> list[tuple[str, dict[str, Any]]]:
    """Methods and their dials, cheap ones first; what is asked for stands in place of the ladder."""
    heat: dict[str, Any] = {
        name: asked[name] for name in ("operator", "heat_time", "heat_refine") if name in asked
    }
    heats: list[dict[str, Any]] = [heat] if heat else [{"operator": "plain"}, {}, {"heat_refine": 3}]
    slacks = (asked["tolerance"],) if "tolerance" in asked else (*TOLERANCES, 0.0)
    ladder: list[tuple[str, dict[str, Any]]] = [
        ("dijkstra", {}),
        *[("heat", dials) for dials in heats],
        ("fast-marching", {}),
        *[("exact", {"tolerance": slack}) for slack in slacks],
    ]
    if "subdivide" in asked:
        ladder = [(method, dials | {"subdivide": asked["subdivide"]}) for method, dials in ladder]
    else:
        finer = [("heat", heat | {"subdivide": 1}), ("fast-marching", {"subdivide": 1})]
        ladder = ladder[:-1] + finer + ladder[-1:]
    return [(m, dials) for m, dials in ladder if asked.get("method", m) == m]


def _exact_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Exact distance, twice with different prunes: what the two disagree on is its uncertainty."""
    tables = window_tables(mesh)
    first = exact_distance(mesh, sources, tables=tables).distance
    second = exact_distance(mesh, sources, tables=tables, dominance_every=3).distance
    disagreement = float(relative_to_largest(second, first).max(initial=0.0))
    return Reference("exact polyhedral distance", first, max(disagreement, 1e-14))


def _approximate_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Two slacks: distances err upwards only, so the smaller is nearer; exact where slack costs more."""
    tables = window_tables(mesh)
    coarse, fine = (exact_distance(mesh, sources, tables=tables, tolerance=t).distance for t in (0.3, 0.1))
    gap = relative_to_largest(coarse, np.minimum(coarse, fine))
    name = "exact method with --tolerance 0.1, as far as 0.3 agrees"
    return Reference.as_far_as(name, np.minimum(coarse, fine), gap)


def _marched_reference(mesh: TriangleMesh, sources: Sources) -> Reference:
    """Fast marching; the true distance lies below that along edges, and both err upwards on flat faces."""
    marched, edges = (
        distance_solver(mesh, method, DistanceOptions())(sources) for method in ("fast-marching", "dijkstra")
    )
    gap = relative_to_largest(edges, marched)
    name = "fast marching, as far as distance along edges agrees"
    return Reference.as_far_as(name, marched, gap)


def _work(mesh: TriangleMesh, method: str, tolerance: float) -> float:
    """Guess of the seconds of a run; exact as on smooth shapes, where it takes the longest."""
    n = mesh.n_vertices
    if method == "exact":
        return 2e-2 + 1.5e-6 * n**1.2 / (1 + 20 * tolerance)
    return {"dijkstra": 4e-6, "fast-marching": 2e-5, "heat": 2e-5}[method] * n + 1e-3


def _candidate(
    mesh: TriangleMesh, sources: Sources, prefix: str, method: str, dials: dict[str, Any]
) -> Candidate:
    """A method with its dials; what it prepares is its set-up."""
    chosen = {name: value for name, value in dials.items() if name in DIALS}
    level = dials.get("subdivide", 0)
    given = {name: value for name, value in dials.items() if value != 0.0}
    words = [f"--method {method}"] if method != "exact" else []
    words += [
        f"--{name.replace('_', '-')} {f'{value:.12g}' if isinstance(value, float) else value}"
        for name, value in given.items()
    ]
    options = DistanceOptions(**chosen)

    def setup() -> Callable[[Sources], NDArray]:
        if level and len(sources.points):
            raise ParameterError("its sources lie inside faces, which --subdivide numbers anew")
        return distance_solver(midpoint_subdivided(mesh, level), method, options)

    return Candidate(
        method,
        dials,
        setup,
        lambda solve: solve(sources)[: mesh.n_vertices],
        prefix + " ".join(words),
        _work(mesh, method, options.tolerance) * (4**level if method != "exact" else 8**level),
    )


def distance_solver(
    mesh: TriangleMesh, method: str, options: DistanceOptions
) -> Callable[[Sources], NDArray]:
    """Distances alone: of the exact method without the second run that estimates its error."""
    if method == "exact":
        tables = window_tables(mesh)
        return lambda at: exact_distance(mesh, at, tables=tables, tolerance=options.tolerance).distance
    solve = prepare(mesh, method, options)
    return lambda at: solve(at).distance
