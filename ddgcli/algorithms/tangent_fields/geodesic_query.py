"""All results of one geodesic query: distances, curves, and vectors at the vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceResult
from ddgcli.algorithms.geodesics.distance_query import level_lines, query_distance, query_options
from ddgcli.algorithms.geodesics.oriented_cover import OrientedCover
from ddgcli.algorithms.geodesics.query import CurveQuery
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import (
    Curves,
    add_geodesic_curvature,
    concatenate_curves,
    trace_curves,
)
from ddgcli.algorithms.tangent_fields.geodesic_task import GeodesicTask, trace_starts
from ddgcli.algorithms.tangent_fields.vertex_vectors import (
    VertexVectors,
    log_map_vectors,
    merge_vectors,
    transport_vectors,
)
from ddgcli.algorithms.tangent_fields.wave_query import query_waves
from ddgcli.errors import renamed_parameters
from ddgcli.progress import StageProgress, no_stage_progress


@dataclass(frozen=True, eq=False)
class GeodesicResult:
    """Results of a geodesic query.

    Parameters
    ----------
    vertex, face : dict of str to ndarray
        Arrays on vertices and on faces.
    results, accuracy : dict
        For the summary.
    converged : bool
    sources : Sources, optional
    curves : Curves, optional
    matrix : dict of str to ndarray
        Distance matrix with its sources and targets; empty if there is none.
    """

    vertex: dict[str, NDArray]
    face: dict[str, NDArray]
    results: dict[str, Any]
    accuracy: dict[str, Any]
    converged: bool
    sources: Sources | None
    curves: Curves | None
    matrix: dict[str, NDArray]


def solve_geodesic_task(
    task: GeodesicTask, stage_progress: StageProgress = no_stage_progress
) -> GeodesicResult:
    """Compute all results of a geodesic task.

    Parameters
    ----------
    task : GeodesicTask
    stage_progress : callable, optional
        Called with the name of each stage; returns its progress callback.

    Returns
    -------
    GeodesicResult
    """
    mesh, sources, distance_query, curve_query, wave_query = (
        task.mesh, task.sources, task.distance_query, task.curve_query, task.wave_query
    )  # fmt: skip
    distance = curves = None
    vertex: dict[str, NDArray] = {}
    face: dict[str, NDArray] = {}
    results: dict[str, Any] = {}
    accuracy: dict[str, Any] = {}
    converged, isolines = True, []
    if sources is not None:
        measured = query_distance(
            mesh, distance_query, sources,
            directions=curve_query.log_map, regions=wave_query.voronoi, seed=task.seed,
            jobs=wave_query.jobs, stage_progress=stage_progress,
        )  # fmt: skip
        distance, isolines = measured.distance, measured.isolines
        vertex, face, converged = measured.vertex, measured.face, distance.converged
        results, accuracy = distance.results, distance.accuracy
    waves = query_waves(
        mesh, wave_query, sources, distance_query.method, query_options(mesh, distance_query),
        signed_curves=task.signed_curves, region=None if distance is None else distance.region,
        stage_progress=stage_progress,
    )  # fmt: skip
    vertex, face = vertex | waves.vertex, face | waves.face
    if sources is None and distance_query.isolines:
        isolines = [level_lines(mesh, vertex["signed_distance"], distance_query.isolines)]
    results, accuracy = results | waves.results, accuracy | waves.accuracy
    if curve_query.has_curves or isolines:
        curves = query_curves(
            task.cover, curve_query, sources, distance,
            field=task.field, isolines=isolines, seed=task.seed, stage_progress=stage_progress,
        )  # fmt: skip
        results, accuracy = results | {"paths": curves.entries}, accuracy | curves.accuracy
        converged &= curves.converged
    if waves.fan is not None:
        curves = waves.fan if curves is None else concatenate_curves([curves, waves.fan])
        converged &= waves.fan.converged
    if curve_query.has_vectors and sources is not None and distance is not None:
        vectors = query_vectors(task.cover, curve_query, sources, distance, stage_progress)
        vertex, results = vertex | vectors.arrays, results | vectors.results
        accuracy = accuracy | vectors.accuracy
    return GeodesicResult(vertex, face, results, accuracy, converged, sources, curves, waves.matrix)


def query_curves(
    cover: OrientedCover,
    query: CurveQuery,
    sources: Sources | None,
    distance: DistanceResult | None,
    *,
    field: tuple[NDArray, str] | None = None,
    isolines: list[Curves] | None = None,
    seed: int = 0,
    stage_progress: StageProgress = no_stage_progress,
) -> Curves:
    """All curves of a checked query in the order of its parameters, followed by `isolines`."""
    isolines, curve_sets = isolines or [], []
    if query.path_to and sources is not None and distance is not None and distance.exact is not None:
        stage_progress("shortest paths")
        curve_sets.append(paths_to_vertices(cover, sources, distance, list(query.path_to)))
    if query.trace:
        curve_sets.append(_traces(cover, query, stage_progress))
    if query.straighten or query.loop:
        from ddgcli.algorithms.geodesics.flipout import straighten_curves

        stage_progress("straightening")
        closed = [False] * len(query.straighten) + [True] * len(query.loop)
        curve_sets.append(straighten_curves(cover.mesh, [*query.straighten, *query.loop], closed))
    if query.curve:
        from ddgcli.algorithms.geodesics.edge_curves import edge_curves

        curve_sets.append(edge_curves(cover.mesh, list(query.curve)))
    if field is not None:
        curve_sets.append(_integral_curves(cover, query, sources, field, seed, stage_progress))
    lifted = [] if cover.is_one_sided else [cover.lift_curves(curves) for curves in isolines]
    curves = concatenate_curves([*curve_sets, *lifted])
    if query.curve:
        curves = add_geodesic_curvature(cover.mesh, curves)
    if query.darboux:
        from ddgcli.algorithms.geodesics.darboux import add_darboux_frames

        curves = add_darboux_frames(cover.mesh, curves)
    if query.transport:
        from ddgcli.algorithms.tangent_fields.field_curves import add_transport

        curves = add_transport(cover.mesh, curves)
    curves = cover.project(curves)
    return concatenate_curves([curves, *isolines]) if cover.is_one_sided else curves


def paths_to_vertices(
    cover: OrientedCover, sources: Sources, distance: DistanceResult, targets: list[int]
) -> Curves:
    """Shortest paths from sources to vertices, on the oriented cover.

    Parameters
    ----------
    cover : OrientedCover
        With two sides, if there are source points inside faces.
    sources : Sources
        On the base.
    distance : DistanceResult
        From the sources, by the exact method.
    targets : list of int

    Returns
    -------
    Curves
        On the cover.
    """
    from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths

    return shortest_paths(
        cover.mesh,
        cover.lift_exact(distance.exact),  # type: ignore[arg-type]
        cover.lift_sources(sources),
        targets,
        join_lifts=cover.join_lifts,
    )


def _traces(cover: OrientedCover, query: CurveQuery, stage_progress: StageProgress) -> Curves:
    """Straightest geodesics from points on the faces of the base mesh."""
    start, direction, length = trace_starts(cover, query)
    return trace_curves(
        cover.mesh, start.face, start.barycentric, direction, length,
        at_boundary=query.at_boundary, progress=stage_progress("traces"),
    )  # fmt: skip


def _integral_curves(
    cover: OrientedCover,
    query: CurveQuery,
    sources: Sources | None,
    field: tuple[NDArray, str],
    seed: int,
    stage_progress: StageProgress,
) -> Curves:
    """Integral curves from the sources, or from random points."""
    from ddgcli.algorithms.tangent_fields.curve_starts import random_starts, starts_at
    from ddgcli.algorithms.tangent_fields.field_curves import field_curves

    values, place = cover.lift_values(*field)
    if sources is None:
        starts = random_starts(cover.mesh, query.field_seeds or 16, seed)
    else:
        starts = starts_at(cover.mesh, cover.lift_sources(sources))
    names = {"duration": "field_time", "step": "field_step", "tolerance": "field_tolerance"}
    with renamed_parameters(values="field", **names):
        return field_curves(
            cover.mesh, values, starts, query.field_time, order=int(query.field_order),
            step=query.field_step, tolerance=query.field_tolerance,
            progress=stage_progress("integral curves"), place=place,
        )  # fmt: skip


def query_vectors(
    cover: OrientedCover,
    query: CurveQuery,
    sources: Sources,
    distance: DistanceResult,
    stage_progress: StageProgress = no_stage_progress,
) -> VertexVectors:
    """The logarithmic map and the transported vectors of a query.

    Parameters
    ----------
    cover : OrientedCover
        With two sides.
    query : CurveQuery
    sources : Sources
        On the base.
    distance : DistanceResult
        From the sources; the logarithmic map follows its method.
    stage_progress : callable
        As in `solve_geodesic_task`.

    Returns
    -------
    VertexVectors
    """
    sources, vector_sets = cover.lift_sources(sources), []
    if query.log_map:
        arrival = (
            (distance.fast_marching or distance)
            if distance.exact is None
            else cover.lift_exact(distance.exact)
        )
        vector_sets.append(log_map_vectors(cover.mesh, arrival, sources, stage_progress("log map")))
    if query.spread_vector:
        vector_sets.append(transport_vectors(cover.mesh, sources, query.spread_vector))
    return merge_vectors(vector_sets)
