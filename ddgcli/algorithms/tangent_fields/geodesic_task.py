"""A geodesic query on a mesh: its sources, checked with all else that can be wrong before it computes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import check_heat
from ddgcli.algorithms.geodesics.distance_query import each_source_names, query_sources
from ddgcli.algorithms.geodesics.edge_sets import EdgeSet
from ddgcli.algorithms.geodesics.oriented_cover import OrientedCover, oriented_cover
from ddgcli.algorithms.geodesics.query import CurveQuery, DistanceQuery, WaveQuery
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.wave_query import check_waves
from ddgcli.errors import renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class GeodesicTask:
    """Checked queries on one mesh; `GeodesicTask.of` makes them.

    Parameters
    ----------
    mesh : TriangleMesh
    distance_query : DistanceQuery
        A distance is computed if it has sources, or if the other queries need none.
    curve_query : CurveQuery
    wave_query : WaveQuery
    signed_curves : EdgeSet, optional
        Edge set of `wave_query.signed_distance`.
    field : (ndarray, str), optional
        The vectors of `curve_query.field` and their place: 'vertex', 'face', or '' to infer it from the
        length.
    seed : int
        Of random starts and of sampled vertices.
    sources : Sources, optional
        Of the distance; None where none is computed.
    """

    mesh: TriangleMesh
    distance_query: DistanceQuery
    curve_query: CurveQuery
    wave_query: WaveQuery
    sources: Sources | None
    signed_curves: EdgeSet | None = None
    field: tuple[NDArray, str] | None = None
    seed: int = 0

    @classmethod
    def of(
        cls,
        mesh: TriangleMesh,
        distance_query: DistanceQuery,
        curve_query: CurveQuery,
        wave_query: WaveQuery | None = None,
        *,
        source_edges: EdgeSet | None = None,
        signed_curves: EdgeSet | None = None,
        field: tuple[NDArray, str] | None = None,
        seed: int = 0,
    ) -> GeodesicTask:
        """Check queries against a mesh; `source_edges` is the edge set of `distance_query.source_edges`."""
        wave_query, sources = wave_query or WaveQuery(), None
        if distance_query.has_source or not (curve_query.has_curves or wave_query.needs_no_source):
            sources = query_sources(mesh, distance_query, source_edges)
            if "heat" in (distance_query.method, *distance_query.compare):
                check_heat(mesh, distance_query.operator, distance_query.heat_time)
        faces = np.array([face for face, _ in distance_query.target_face], dtype=np.int64)
        weights = np.array([weights for _, weights in distance_query.target_face], dtype=float)
        with renamed_parameters(face="target_face", barycentric="target_face"):
            SurfacePoints.checked(faces, weights.reshape(-1, 3), mesh.n_faces)
        check_waves(mesh, wave_query, sources, distance_query.method, signed_curves)
        task = cls(mesh, distance_query, curve_query, wave_query, sources, signed_curves, field, seed)
        if curve_query.has_curves or curve_query.has_vectors or curve_query.darboux:
            _check_curves(task.cover, curve_query, sources, field)
            if curve_query.has_vectors and sources is not None:
                _check_vectors(task.cover, curve_query, sources, distance_query.method)
        return task

    @cached_property
    def cover(self) -> OrientedCover:
        """Oriented cover of the mesh, on which curves and tangent vectors are computed."""
        return oriented_cover(self.mesh)

    @property
    def vertex_arrays(self) -> list[str]:
        """Names of the vertex arrays of the result."""
        names = []
        if self.sources is not None:
            names += ["geodesic_distance", "nearest_source"]
            names += each_source_names(len(self.sources)) if self.distance_query.each_source else []
        names += ["signed_distance"] if self.signed_curves is not None else []
        names += ["vertex_type"] if self.wave_query.vertex_types else []
        names += ["log_map"] if self.curve_query.log_map else []
        return [*names, *(["transported_vector"] if self.curve_query.spread_vector else [])]

    @property
    def face_arrays(self) -> list[str]:
        """Names of the face arrays of the result."""
        names = ["distance_gradient"] if self.distance_query.gradient else []
        return [*names, *(["region"] if self.wave_query.voronoi else [])]


def _check_curves(
    cover: OrientedCover,
    query: CurveQuery,
    sources: Sources | None,
    field: tuple[NDArray, str] | None,
) -> None:
    """Raise the errors of curves; in the order in which they are computed."""
    if query.path_to and sources is not None:
        from ddgcli.algorithms.geodesics.shortest_paths import check_targets

        if len(sources.points):
            cover.require_two_sides("a path from points inside faces")
        with renamed_parameters(targets="path_to"):
            check_targets(cover.base, list(query.path_to))
    if query.trace:
        from ddgcli.algorithms.tracing.trace import Tracer, check_lengths

        start, direction, length = trace_starts(cover, query)
        with renamed_parameters(direction="trace", length="trace"):
            Tracer(cover.mesh).checked_start(start.face, start.barycentric, direction, length)
            check_lengths(cover.mesh, start.face, length, query.at_boundary)
    if query.straighten or query.loop or query.curve:
        from ddgcli.algorithms.geodesics.flippable_mesh import check_waypoints

        cover.require_two_sides("an edge path" if query.curve else "straightening")
        for name in ("straighten", "curve", "loop"):
            with renamed_parameters(waypoints=name):
                for waypoints in getattr(query, name):
                    check_waypoints(cover.mesh, waypoints, closed=name == "loop")
    if query.straighten or query.loop or field is not None:
        refuse_repeated_vertices(cover.base)
    if field is not None:
        from ddgcli.algorithms.tangent_fields.integral_curves import check_field_step
        from ddgcli.algorithms.tangent_fields.tangent_field import checked_field, default_duration

        with renamed_parameters(values="field", step="field_step"):
            values, _ = checked_field(cover.base, *field)
            duration = query.field_time
            check_field_step(
                query.field_step, default_duration(cover.base, values) if duration is None else duration
            )
    if query.darboux:
        cover.require_two_sides("a Darboux frame")


def trace_starts(cover: OrientedCover, query: CurveQuery) -> tuple[SurfacePoints, NDArray, NDArray]:
    """Starts of the traces of a query on the oriented cover, with their directions and lengths.

    Parameters
    ----------
    cover : OrientedCover
    query : CurveQuery
        With at least one trace.

    Returns
    -------
    start : SurfacePoints
        k points on the cover.
    direction : (k, ...) ndarray
    length : (k,) ndarray
    """
    face, barycentric, direction, length = (np.array(x) for x in zip(*query.trace, strict=True))
    with renamed_parameters(face="trace", barycentric="trace"):
        start = cover.lift_points(SurfacePoints.checked(face, barycentric, cover.base.n_faces))
    return start, direction, length


def _check_vectors(cover: OrientedCover, query: CurveQuery, sources: Sources, method: str) -> None:
    """Raise the errors of the logarithmic map and of transported vectors."""
    cover.require_two_sides("a tangent frame")
    lifted = cover.lift_sources(sources)
    if query.log_map:
        from ddgcli.algorithms.tangent_fields.heat_log_map import require_source_vertex
        from ddgcli.algorithms.tangent_fields.log_map import SourceFrame
        from ddgcli.algorithms.tracing.trace import Tracer

        with renamed_parameters(sources="source"):
            if method == "heat":
                require_source_vertex(lifted)
            SourceFrame(Tracer(cover.mesh), lifted)
    if query.spread_vector or (query.log_map and method == "heat"):
        from ddgcli.algorithms.tangent_fields.vector_heat import check_vector_heat

        check_vector_heat(cover.mesh)
    if query.spread_vector:
        from ddgcli.algorithms.tangent_fields.vertex_vectors import vectors_at_sources

        with renamed_parameters(vectors="spread_vector"):
            vectors_at_sources(cover.mesh, lifted, query.spread_vector)
