"""Distances between chosen vertices, row by row, in several processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceOptions, Solver, prepare_solver
from ddgcli.algorithms.geodesics.sources import Sources, check_sources
from ddgcli.choices import SYMMETRIC_METHODS
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.progress import ProgressCallback
from ddgcli.workers import are_copies, results_in_order


def distance_matrix(
    mesh: SurfaceMesh,
    sources: NDArray | list[int],
    targets: NDArray | list[int],
    method: str = "exact",
    options: DistanceOptions | None = None,
    *,
    jobs: int = 1,
    progress: ProgressCallback | None = None,
) -> NDArray[np.float64]:
    """Distance from each source to each target vertex.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources, targets : (s,), (t,) array_like of int
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
        With 'exact' and 'dijkstra', which are symmetric, the smaller of the two sets is propagated.
    options : DistanceOptions, optional
    jobs : int
        Number of processes; the result does not depend on it.
    progress : callable, optional
        Called with the number of finished rows and of all rows.

    Returns
    -------
    (s, t) ndarray of float64
        inf between different components.
    """
    first = check_sources(mesh, np.asarray(sources, dtype=np.int64)).vertex
    with renamed_parameters(sources="targets"):
        last = check_sources(mesh, np.asarray(targets, dtype=np.int64), "target").vertex
    if jobs < 1:
        raise ParameterError(f"must be 1 or more, not {jobs}", parameter="jobs")
    if method in SYMMETRIC_METHODS and len(np.unique(last)) < len(np.unique(first)):
        return distance_matrix(mesh, last, first, method, options, jobs=jobs, progress=progress).T.copy()
    options = options or DistanceOptions()
    vertex, row = np.unique(first, return_inverse=True)
    rows = np.empty((len(vertex), len(last)))
    starts = [Sources(np.array([v])) for v in vertex]
    for i, values in enumerate(distance_rows(mesh, starts, method, options, targets=last, jobs=jobs)):
        rows[i] = values
        if progress is not None:
            progress(i + 1, len(vertex))
    return rows[row]


def distance_rows(
    mesh: SurfaceMesh,
    starts: Sequence[Sources],
    method: str,
    options: DistanceOptions,
    *,
    targets: NDArray | None = None,
    jobs: int = 1,
    solver: Solver | None = None,
) -> Iterator[NDArray[np.float64]]:
    """Distances from each of several independent sets of sources, in order; the same bits for any `jobs`.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    starts : sequence of Sources
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    options : DistanceOptions
    targets : (t,) ndarray of int, optional
        Vertices; default all.
    jobs : int
        Number of processes.
    solver : callable, optional
        `prepare_solver(mesh, method, options)`, if there is one already; used by one job, and by processes
        that share the memory of this one.

    Yields
    ------
    (t,) ndarray of float64
        For each element of `starts`.
    """
    jobs = min(jobs, len(starts))
    tasks = ((sources,) for sources in starts)
    modules = (__name__,)
    arguments = mesh, method, options, targets, solver if jobs <= 1 or are_copies(modules) else None
    yield from results_in_order(_row, tasks, jobs, prepare=_prepared, arguments=arguments, modules=modules)


def _prepared(
    mesh: SurfaceMesh,
    method: str,
    options: DistanceOptions,
    targets: NDArray | None,
    solver: Solver | None,
) -> tuple[Solver, NDArray | None]:
    """What all rows of a process share."""
    return solver or prepare_solver(mesh, method, options), targets


def _row(shared: tuple[Solver, NDArray | None], sources: Sources) -> NDArray[np.float64]:
    solver, targets = shared
    distance = solver(sources).distance
    return distance if targets is None else distance[targets]
