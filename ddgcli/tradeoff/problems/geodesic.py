"""Geodesic distance: every method against the exact polyhedral distance, or a known truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from ddgcli.algorithms.geodesic import DistanceOptions, prepare
from ddgcli.algorithms.geodesic_exact import exact_distance
from ddgcli.algorithms.geodesic_sources import Sources
from ddgcli.algorithms.window_tables import window_tables
from ddgcli.errors import ParameterError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_largest
from ddgcli.tradeoff.truths import Truth

TOLERANCES = (0.3, 0.1, 0.03, 0.01)


def problem(mesh: TriangleMesh, *, source: tuple[int, ...] = (), truth: Truth | None = None, **_) -> Problem:
    """Distance from the sources (vertex 0 by default) to every vertex."""
    sources = source or (0,)
    if truth is not None and (truth.distance is None or len(sources) > 1):
        raise ParameterError(
            f"no distance from {len(sources)} sources is known on the {truth.name}; drop --truth"
        )
    if truth is not None and truth.distance is not None:
        values = truth.distance(mesh.points, mesh.points[sources[0]])
        known = Reference(f"known truth: {truth.name}", values, 1e-15, known=True)
        references = [(0.0, lambda: known)]
    else:
        references = [(_work(mesh, "exact", 0.0) * 2, lambda: _exact_reference(mesh, sources))]
    return Problem(
        candidates=_candidates(mesh, sources),
        references=references,
        error=relative_to_largest,
        error_scale="the largest distance of the reference",
        query="set of sources",
    )


def _exact_reference(mesh: TriangleMesh, sources: tuple[int, ...]) -> Reference:
    """Exact distance, twice with different prunes: what the two disagree on is its uncertainty."""
    tables = window_tables(mesh)
    first = exact_distance(mesh, list(sources), tables=tables).distance
    second = exact_distance(mesh, list(sources), tables=tables, dominance_every=1).distance
    disagreement = float(relative_to_largest(second, first).max(initial=0.0))
    return Reference("exact polyhedral distance", first, max(disagreement, 1e-14))


def _work(mesh: TriangleMesh, method: str, tolerance: float) -> float:
    """Guess of the seconds of a run; windows grow as n^1.5 on smooth convex shapes."""
    n = mesh.n_vertices
    if method == "exact":
        return 2e-2 + 6e-7 * n**1.5 / (1 + 20 * tolerance)
    return {"dijkstra": 4e-6, "fast-marching": 2e-5, "heat": 2e-5}[method] * n + 1e-3


def _candidates(mesh: TriangleMesh, sources: tuple[int, ...]) -> list[Candidate]:
    heat = (
        _candidate(mesh, sources, "heat", "heat", operator="plain"),
        _candidate(mesh, sources, "heat", "heat"),
        _candidate(mesh, sources, "heat", "heat", heat_refine=3),
    )
    return [
        _candidate(mesh, sources, "dijkstra", "dijkstra"),
        *heat,
        _candidate(mesh, sources, "fast-marching", "fast-marching"),
        *(_candidate(mesh, sources, "exact", "exact", tolerance=tolerance) for tolerance in TOLERANCES),
        _candidate(mesh, sources, "exact", "exact"),
    ]


def _candidate(
    mesh: TriangleMesh, sources: tuple[int, ...], line: str, method: str, **dials: Any
) -> Candidate:
    """A method with dials of `DistanceOptions`; what it prepares is its set-up."""
    words = [f"--source {s}" for s in sources] + ([f"--method {method}"] if method != "exact" else [])
    words += [f"--{name.replace('_', '-')} {value:g}" if isinstance(value, float) else
              f"--{name.replace('_', '-')} {value}" for name, value in dials.items()]  # fmt: skip
    options = DistanceOptions(**dials)
    at = Sources.at(sources)
    return Candidate(
        line,
        dials or ({"tolerance": 0.0} if method == "exact" else {}),
        lambda: distance_solver(mesh, method, options),
        lambda solve: solve(at),
        " ".join(words),
        _work(mesh, method, options.tolerance),
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
