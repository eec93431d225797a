"""Distances, gradient, level lines and comparisons of one distance query."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics import distance as solvers
from ddgcli.algorithms.geodesics.compare_methods import compare
from ddgcli.algorithms.geodesics.distance_matrix import distance_rows
from ddgcli.algorithms.geodesics.edge_sets import EdgeSet, boundary_set, joined_curves
from ddgcli.algorithms.geodesics.query import DistanceQuery
from ddgcli.algorithms.geodesics.sources import Sources, check_sources
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.choices import DEFAULT_HEAT_TIME
from ddgcli.errors import counted, renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints, nearest_points
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import bounding_box
from ddgcli.progress import ProgressCallback, StageProgress, no_stage_progress

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class DistanceQueryResult:
    """Results of a distance query.

    Parameters
    ----------
    distance : DistanceResult
        Distances of all vertices; its `results`, `accuracy` and `converged` are those of the query.
    vertex, face : dict of str to ndarray
        Arrays on vertices and on faces.
    isolines : list of Curves
    """

    distance: solvers.DistanceResult
    vertex: dict[str, NDArray]
    face: dict[str, NDArray]
    isolines: list[Curves]


def query_sources(mesh: TriangleMesh, query: DistanceQuery, source_edges: EdgeSet | None = None) -> Sources:
    """Sources of a query: vertices, points in space, points on faces, curves of edges, boundary loops.

    Parameters
    ----------
    mesh : TriangleMesh
    query : DistanceQuery
    source_edges : EdgeSet, optional
        Edge set of `query.source_edges`; its connected parts are the curves.

    Returns
    -------
    Sources
        Checked.

    Raises
    ------
    ParameterError, MeshError
    """
    with renamed_parameters(face="source_face", barycentric="source_face"):
        points = surface_points(mesh, query.source_point, query.source_face)
    sets = [source_edges] if source_edges is not None else []
    if query.source_boundary:
        refuse_repeated_vertices(mesh)  # which have a boundary of their own
        sets.append(boundary_set(mesh))
    with renamed_parameters(sources="source"):
        return check_sources(mesh, Sources.at(query.vertices, points, *joined_curves(mesh, sets)))


def query_options(
    mesh: TriangleMesh, query: DistanceQuery, *, directions: bool = False
) -> solvers.DistanceOptions:
    """Options of the distance method of a query.

    Parameters
    ----------
    mesh : TriangleMesh
    query : DistanceQuery
    directions : bool
        Whether directions at the source are needed; computed on oriented meshes only.

    Returns
    -------
    DistanceOptions
    """
    return solvers.DistanceOptions(
        tolerance=query.tolerance or 0.0,
        operator=query.operator,
        heat_time=query.heat_time or DEFAULT_HEAT_TIME,
        heat_refine=query.heat_refine or 0,
        directions=directions and mesh.topology.is_oriented,
    )


def surface_points(
    mesh: TriangleMesh, in_space: Sequence[list[float]], on_faces: Sequence[tuple[int, list[float]]]
) -> SurfacePoints:
    """Surface points nearest to points in space, followed by checked points on faces."""
    near, away = nearest_points(mesh, np.array(in_space, dtype=float).reshape(-1, 3))
    if len(away):
        _warn_of_far_points(mesh, in_space, away)
    face = np.array([f for f, _ in on_faces], dtype=np.int64)
    weights = np.array([w for _, w in on_faces], dtype=float).reshape(-1, 3)
    points = SurfacePoints.checked(face, weights, mesh.n_faces)
    return near.followed_by(points)


def _warn_of_far_points(mesh: TriangleMesh, in_space: Sequence[list[float]], away: NDArray) -> None:
    low, high = bounding_box(mesh.points)
    extent = float((high - low).max())
    far = np.flatnonzero(away > extent)
    if len(far):
        first = ",".join(f"{x:g}" for x in in_space[far[0]])
        log.warning(
            f"{counted(len(far), 'point in space lies', 'points in space lie')} farther from the surface "
            f"than its extent of {extent:.3g} (first: {first}, {away[far[0]]:.3g} away): the nearest point "
            "on it is taken; check the unit"
        )


def query_distance(
    mesh: TriangleMesh,
    query: DistanceQuery,
    sources: Sources,
    *,
    directions: bool = False,
    regions: bool = False,
    seed: int = 0,
    jobs: int = 1,
    stage_progress: StageProgress = no_stage_progress,
) -> DistanceQueryResult:
    """Compute the distances and further results of a query.

    Parameters
    ----------
    mesh : TriangleMesh
    query : DistanceQuery
    sources : Sources
        `query_sources(mesh, query)`.
    directions : bool
        Also compute the directions in which paths leave the source, for a logarithmic map.
    regions : bool
        Also find the source nearest to each face, where the same propagation can (`distance.region`).
    seed : int
        Seed of the vertices that `query.certify` samples.
    jobs : int
        Processes for `query.each_source`; the result does not depend on it.
    stage_progress : callable, optional
        Called with the name of each stage; returns its progress callback.

    Returns
    -------
    DistanceQueryResult
    """
    options = query_options(mesh, query, directions=directions)
    solver = solvers.prepare_solver(
        mesh,
        query.method,
        options,
        targets=surface_points(mesh, query.target_point, query.target_face),
        regions=regions and not (query.tolerance or query.each_source or query.certify),
        progress=stage_progress("exact distance") if query.method == "exact" else None,
    )
    result = solvers.measure_distance(mesh, sources, query.method, solver=solver)
    stage_progress("geodesic")
    vertex, face, accuracy = dict(result.arrays), {}, dict(result.accuracy)
    if query.each_source:
        rows = distance_rows(mesh, list(sources.each()), query.method, options, jobs=jobs, solver=solver)
        vertex |= _each_source(rows, len(sources), stage_progress("each source"))
    if query.gradient:
        face["distance_gradient"] = solvers.distance_gradient(mesh, result.distance)
    isolines = [level_lines(mesh, result.distance, query.isolines)] if query.isolines else []
    if query.compare:
        stage_progress("comparison")
        accuracy["compare"] = compare(mesh, sources, result.distance, list(query.compare), options)
    if query.certify:
        from ddgcli.algorithms.geodesics.certificate import symmetry

        stage_progress("symmetry")
        accuracy |= symmetry(mesh, lambda s: solver(s).distance, seed=seed)
    return DistanceQueryResult(replace(result, accuracy=accuracy), vertex, face, isolines)


def each_source_names(count: int) -> list[str]:
    """Names of the distance arrays of single sources.

    Parameters
    ----------
    count : int

    Returns
    -------
    list of str
    """
    digits = max(3, len(str(count - 1)))
    return [f"geodesic_distance_{i:0{digits}d}" for i in range(count)]


def level_lines(mesh: TriangleMesh, values: NDArray, count: int) -> Curves:
    """Level lines on consistently oriented faces; on a one-sided surface, on its own faces.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n,) ndarray of float64
    count : int
        Number of equidistant levels.

    Returns
    -------
    Curves
    """
    from ddgcli.algorithms.geodesics.isolines import isoline_curves
    from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover

    cover = oriented_cover(mesh)
    if cover.is_one_sided:
        return isoline_curves(mesh, values, count)
    return cover.project(isoline_curves(cover.mesh, values, count))


def _each_source(
    rows: Iterable[NDArray], count: int, progress: ProgressCallback
) -> dict[str, NDArray[np.float64]]:
    """One distance array for each source, named geodesic_distance_000 and so on."""
    arrays = {}
    for i, (name, distance) in enumerate(zip(each_source_names(count), rows, strict=True)):
        arrays[name] = distance
        progress(i + 1, count)
    return arrays
