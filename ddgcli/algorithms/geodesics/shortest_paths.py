"""Shortest paths, traced back from their targets along the exact distance."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
from ddgcli.algorithms.geodesics.path_results import describe_paths
from ddgcli.algorithms.geodesics.paths import SurfacePaths, barycentric_in, reversed_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tracing.trace import BOUNDARY_STATUS, Tracer, Traces
from ddgcli.errors import ParameterError, counted
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.unfolding import SurfaceMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.topology import NEXT, PREVIOUS

_log = logging.getLogger("ddgcli")
_NO_PATH = -2
MIN_SEGMENT_LENGTH = 1e-9  # relative to the longest side of its face; shorter segments have no direction
LENGTH_TOLERANCE = 1e-9  # relative difference between the length of a path and the distance


@dataclass(frozen=True, eq=False)
class _Segment:
    """Points from a vertex back to where its straight line begins, without that end.

    `next_vertex` is the vertex at that end, -1 for a source point, or `_NO_PATH` if the line ends before.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    next_vertex: int


def check_targets(mesh: SurfaceMesh, targets: list[int]) -> None:
    """Raise an error for a target vertex that does not exist, or faces that paths cannot cross.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    targets : list of int

    Raises
    ------
    ParameterError, MeshError
    """
    refuse_repeated_vertices(mesh)
    bad = [t for t in targets if not 0 <= t < mesh.n_vertices]
    if bad:
        raise ParameterError(
            f"vertex {bad[0]} does not exist; vertices are 0..{mesh.n_vertices - 1}", parameter="targets"
        )


def shortest_paths(
    mesh: SurfaceMesh,
    exact: ExactDistance,
    sources: Sources,
    targets: list[int],
    join_lifts: Callable[[SurfacePaths], SurfacePaths] | None = None,
) -> Curves:
    """Shortest path from the nearest source to each target vertex.

    The exact distance determines the last straight segment of every shortest path. The tracer follows it
    back, then the segment before it, until the source.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    exact : ExactDistance
        Of these sources on this mesh.
    sources : Sources
    targets : list of int
        Vertices.
    join_lifts : callable, optional
        Joins separately lifted segments to one lift of a path, if the mesh is a cover
        (`OrientedCover.join_lifts`).

    Returns
    -------
    Curves
        From source to target. `accuracy.path_length_residual` is the largest relative difference between the
        length of a path and the distance. Targets that no source reaches, or only across an edge with
        three or more faces, have a path without points and `length` None.
    """
    check_targets(mesh, targets)
    reached = [t for t in targets if np.isfinite(exact.distance[t])]
    segments = _segments(Tracer(mesh), exact, sources, reached)
    backward = [_chain(mesh, exact, sources, segments, t) for t in targets]
    closed = np.zeros(len(targets), dtype=bool)
    start = list_starts([len(f) for f, _ in backward])
    face = np.concatenate([np.zeros(0, dtype=np.int64), *(f for f, _ in backward)])
    barycentric = np.concatenate([np.zeros((0, 3)), *(b for _, b in backward)])
    paths = reversed_paths(mesh, SurfacePaths(face, barycentric, start, closed))
    paths = join_lifts(paths) if join_lifts else paths
    kinds = [{"kind": "shortest", "target": int(t), "source": int(exact.nearest_source[t])} for t in targets]
    entries = describe_paths(mesh, paths, kinds)
    residual = _add_distances(entries, exact, targets)
    converged = residual <= LENGTH_TOLERANCE and all(entry["length"] is not None for entry in entries)
    return Curves(paths, entries, {"path_length_residual": residual}, converged)


def _add_distances(entries: list[dict[str, Any]], exact: ExactDistance, targets: list[int]) -> float:
    """Add the exact distances to the entries of paths; return the largest relative difference to the lengths.

    Warnings name missing paths and a residual above `LENGTH_TOLERANCE`.
    """
    residual, missing = 0.0, []
    for entry, target in zip(entries, targets, strict=True):
        distance = float(exact.distance[target])
        if not np.isfinite(distance):
            entry["length"] = None
            _log.warning(f"no path to vertex {target}: no source lies on its component")
            continue
        if not entry["points"]:
            entry["length"], entry["distance"] = None, distance
            missing.append(target)
            continue
        entry["distance"] = distance
        residual = max(residual, abs(entry["length"] - distance) / (distance or 1.0))
    if missing:
        _log.warning(
            f"no path to {counted(len(missing), 'vertex', 'vertices')} (first: {missing[0]}): the traced "
            "line meets an edge with three or more faces, or a face without width; the distance is valid"
        )
    if residual > LENGTH_TOLERANCE:
        _log.warning(
            f"a path differs from the exact distance by {residual:.3g} of it; see its entry in the results"
        )
    return residual


def _segments(
    tracer: Tracer, exact: ExactDistance, sources: Sources, targets: list[int]
) -> dict[int, _Segment]:
    """Straight segments that end at the targets and at all vertices on their paths."""
    segments: dict[int, _Segment] = {}
    ends = set(targets)
    while ends:
        here = np.array(sorted(v for v in ends if exact.distance[v] > 0), dtype=np.int64)
        inside = here[exact.side[here] < 0]
        for v in inside:
            segments[int(v)] = _segment_in_face(tracer.mesh, exact, sources, int(v))
        traced = here[exact.side[here] >= 0]
        short = _too_short(tracer, exact, traced)
        segments |= {int(v): _segment_of_zero_length(tracer.mesh, exact, int(v)) for v in traced[short]}
        traced = traced[~short]
        if len(traced):
            lines = _trace_back(tracer, exact, traced)
            for i, v in enumerate(traced):
                segments[int(v)] = _cut(tracer.mesh, exact, sources, lines, i, int(v))
        ends = {segments[int(v)].next_vertex for v in here} - set(segments) - {-1, _NO_PATH}
    return segments


def last_segment(
    mesh: SurfaceMesh, exact: ExactDistance, vertex: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Last segments of shortest paths to vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    exact : ExactDistance
    vertex : (k,) ndarray of int64
        With `exact.side` >= 0.

    Returns
    -------
    face : (k,) ndarray of int64
        The face of the segment.
    apex, crossing : (k, 3) ndarray of float64
        Barycentric coordinates of the vertex, and of the point where the path enters the face.
    """
    face, j = np.divmod(exact.side[vertex], 3)
    rows = np.arange(len(vertex))
    apex = np.eye(3)[(j + 2) % 3]
    share = exact.crossing[vertex] / mesh.side_length[face, j]
    crossing = np.zeros((len(vertex), 3))
    crossing[rows, j], crossing[rows, (j + 1) % 3] = 1.0 - share, share
    return face, apex, crossing


def _trace_back(tracer: Tracer, exact: ExactDistance, vertex: NDArray) -> Traces:
    """Trace lines from vertices with `side` >= 0 back along their shortest paths to the origins."""
    face, apex, crossing = last_segment(tracer.mesh, exact, vertex)
    direction = planar_difference(tracer.unfolding, face, apex, crossing)
    origin = exact.origin_vertex[vertex]
    length = exact.distance[vertex] - np.where(origin >= 0, exact.distance[origin], 0.0)
    return tracer.trace(face, apex, direction, np.maximum(length, 0.0), record=True)


def _too_short(tracer: Tracer, exact: ExactDistance, vertex: NDArray) -> NDArray[np.bool_]:
    """(k,) vertices with `side` >= 0 whose last segment has no length, in a face without width."""
    face, apex, crossing = last_segment(tracer.mesh, exact, vertex)
    last = planar_difference(tracer.unfolding, face, apex, crossing)
    width = tracer.mesh.side_length[face].max(axis=1, initial=0.0)
    short: NDArray[np.bool_] = np.hypot(last[:, 0], last[:, 1]) <= MIN_SEGMENT_LENGTH * width
    return short


def _segment_of_zero_length(mesh: SurfaceMesh, exact: ExactDistance, v: int) -> _Segment:
    """Segment of zero length to another vertex at the same position, across a zero side, if there is one."""
    face, j = divmod(int(exact.side[v]), 3)
    near = exact.crossing[v] <= 0.5 * mesh.side_length[face, j]
    end, between = (j, PREVIOUS[j]) if near else (NEXT[j], NEXT[j])
    next_vertex = int(mesh.faces[face, end]) if mesh.side_length[face, between] == 0 else _NO_PATH
    return _Segment(np.array([face]), np.eye(3)[[PREVIOUS[j]]], next_vertex)


def _segment_in_face(mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, v: int) -> _Segment:
    """Segment inside one face: along an edge to the origin vertex, or to a source point."""
    around = np.flatnonzero((mesh.faces == v).any(axis=1))
    origin = int(exact.origin_vertex[v])
    if origin >= 0:
        holding = around[(mesh.faces[around] == origin).any(axis=1)]
        if not len(holding):
            raise ParameterError(f"the path to vertex {v} runs outside the faces; {remedy('folds')}")
        face = holding[:1]
    else:
        index = int(exact.nearest_source[v]) - len(sources.vertex)
        f, b = sources.points.face[[index]], sources.points.barycentric[[index]]
        face = np.array(
            [g for g in around if not np.isnan(barycentric_in(mesh.topology, f, b, np.array([g]))[0, 0])][:1]
        )
    return _Segment(face, (mesh.faces[face] == v).astype(np.float64)[:, :], origin)


def _cut(
    mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, lines: Traces, i: int, v: int
) -> _Segment:
    """Recorded points of line i up to the face that contains the origin."""
    face, barycentric = lines.path(i)
    origin = int(exact.origin_vertex[v])
    at_vertex = np.flatnonzero(barycentric[1:].max(axis=1) >= 1 - 1e-9) + 1
    if len(at_vertex):  # through a vertex: its own shortest path passes a saddle on the right side
        last = at_vertex[0]
        vertex = int(mesh.faces[face[last], np.argmax(barycentric[last])])
        if exact.distance[vertex] < exact.distance[v]:
            return _Segment(face[:last], barycentric[:last], vertex)
    if origin < 0 and int(exact.nearest_source[v]) >= sources.first_curve:  # ends on the edge, by its length
        return _Segment(face, barycentric, origin)
    if origin >= 0:
        holds = (mesh.faces[face[:-1]] == origin).any(axis=1)
    else:
        index = int(exact.nearest_source[v]) - len(sources.vertex)
        f = np.repeat(sources.points.face[index], len(face) - 1)
        b = np.repeat(sources.points.barycentric[[index]], len(face) - 1, axis=0)
        holds = ~np.isnan(barycentric_in(mesh.topology, f, b, face[:-1])[:, 0])
    keep = np.flatnonzero(holds)
    if not len(keep) and lines.status[i] == BOUNDARY_STATUS:
        return _Segment(face[:1], barycentric[:1], _NO_PATH)
    if not len(keep) and origin >= 0:  # the end is at the origin, but across a face without area
        around = np.flatnonzero((mesh.faces == origin).any(axis=1))
        there, weights = np.full(len(around), face[-1]), np.tile(barycentric[-1], (len(around), 1))
        at_origin = barycentric_in(mesh.topology, there, weights, around)
        also = np.flatnonzero(~np.isnan(at_origin[:, 0]))[:1]
        face = np.concatenate([face[:-1], around[also]])
        return _Segment(face, np.concatenate([barycentric[:-1], at_origin[also]]), origin)
    last = keep[0] + 1 if len(keep) else len(face) - 1  # inside one face the straight line is the shortest
    return _Segment(face[:last], barycentric[:last], origin)


def _chain(
    mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, segments: dict[int, _Segment], target: int
) -> tuple[NDArray, NDArray]:
    """Points from the target back to the source, both included."""
    if not np.isfinite(exact.distance[target]):
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    faces, weights, v = [], [], target
    for _ in range(len(segments) + 1):
        if v < 0 or v not in segments:
            break
        faces.append(segments[v].face)
        weights.append(segments[v].barycentric)
        v = segments[v].next_vertex
    if v == _NO_PATH or v in segments:  # or a cycle among vertices at one position
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    if v >= 0:  # a source vertex
        face = faces[-1][-1:] if faces else np.flatnonzero((mesh.faces == v).any(axis=1))[:1]
        end = (mesh.faces[face] == v).astype(np.float64)
        if end.sum() != 1:
            end = np.eye(3)[[np.argmax(end[0])]]
    elif int(exact.nearest_source[target]) >= sources.first_curve:  # the last segment ends on a source edge
        return np.concatenate(faces), np.concatenate(weights)
    else:
        index = int(exact.nearest_source[target]) - len(sources.vertex)
        face = faces[-1][-1:]
        end = barycentric_in(
            mesh.topology, sources.points.face[[index]], sources.points.barycentric[[index]], face
        )
        end = np.nan_to_num(end, nan=1 / 3)
    return np.concatenate([*faces, face]), np.concatenate([*weights, end])
