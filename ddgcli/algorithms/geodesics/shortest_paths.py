"""Shortest paths, walked back from their targets along the exact distance."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
from ddgcli.algorithms.geodesics.paths import SurfacePaths, describe_paths, reversed_paths, seen_from
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tracing.trace import AT_BOUNDARY, Tracer, Traces
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.unfolding import SurfaceMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.topology import NEXT, PREVIOUS

_log = logging.getLogger("ddgcli")
_LOST = -2
BLUNT = 1e-9  # of the longest side of its face: the last piece of a path gives no direction below
AGREE = 1e-9  # a walked path is right when its length is the distance, to this relative error


@dataclass(frozen=True, eq=False)
class _Piece:
    """Points from a vertex back to where its straight line begins, that end left out.

    It `goes_to` a vertex, or to -1, a source point, or to `_LOST`: the line ended before.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    goes_to: int


def shortest_paths(
    mesh: SurfaceMesh,
    exact: ExactDistance,
    sources: Sources,
    targets: list[int],
    tracer: Tracer | None = None,
    join_lifts: Callable[[SurfacePaths], SurfacePaths] | None = None,
) -> Curves:
    """Shortest path from the nearest source to each target vertex.

    The last straight piece of every shortest path is known from the exact distance; it is walked back with
    the tracer, then the piece before it, until the source.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    exact : ExactDistance
        Of these sources on this mesh.
    targets : list of int
        Vertices.
    join_lifts : callable, optional
        What makes one lift of pieces lifted each by itself, where the mesh is a cover
        (`OrientedCover.join_lifts`).

    Returns
    -------
    Curves
        From source to target. `accuracy.path_length_residual` is the largest relative difference between the
        length of a path and the distance. WindowTargets that no source reaches, or only across an edge of
        three or more faces, have a path without points and `length` None.
    """
    bad = [t for t in targets if not 0 <= t < mesh.n_vertices]
    if bad:
        raise ParameterError(f"target vertex {bad[0]} does not exist; vertices are 0..{mesh.n_vertices - 1}")
    tracer = tracer or Tracer(mesh)
    reached = [t for t in targets if np.isfinite(exact.distance[t])]
    pieces = _pieces(tracer, exact, sources, reached)
    backward = [_chain(mesh, exact, sources, pieces, t) for t in targets]
    closed = np.zeros(len(targets), dtype=bool)
    start = list_starts([len(f) for f, _ in backward])
    face = np.concatenate([np.zeros(0, dtype=np.int64), *(f for f, _ in backward)])
    barycentric = np.concatenate([np.zeros((0, 3)), *(b for _, b in backward)])
    paths = reversed_paths(mesh, SurfacePaths(face, barycentric, start, closed))
    paths = join_lifts(paths) if join_lifts else paths
    kinds = [{"kind": "shortest", "target": int(t), "source": int(exact.nearest_source[t])} for t in targets]
    entries = describe_paths(mesh, paths, kinds)
    residual, lost = 0.0, []
    for entry, target in zip(entries, targets, strict=True):
        distance = float(exact.distance[target])
        if not np.isfinite(distance):
            entry["length"] = None
            _log.warning(f"no path to vertex {target}: no source lies on its component")
            continue
        if not entry["points"]:
            entry["length"], entry["distance"] = None, distance
            lost.append(target)
            continue
        entry["distance"] = distance
        residual = max(residual, abs(entry["length"] - distance) / (distance or 1.0))
    if lost:
        _log.warning(
            f"no path to {len(lost)} vertices (first: {lost[0]}): walked back, it meets an edge of three or "
            "more faces, or a face without width; the distance stands"
        )
    if residual > AGREE:
        _log.warning(f"a path differs from the exact distance by {residual:.3g} of it; look at its entry")
    converged = residual <= AGREE and all(entry["length"] is not None for entry in entries)
    return Curves(paths, entries, {"path_length_residual": residual}, converged)


def _pieces(tracer: Tracer, exact: ExactDistance, sources: Sources, targets: list[int]) -> dict[int, _Piece]:
    """The straight piece that ends at every vertex on the way of the targets."""
    pieces: dict[int, _Piece] = {}
    wanted = set(targets)
    while wanted:
        here = np.array(sorted(v for v in wanted if exact.distance[v] > 0), dtype=np.int64)
        inside = here[exact.side[here] < 0]
        for v in inside:
            pieces[int(v)] = _piece_in_face(tracer.mesh, exact, sources, int(v))
        walked = here[exact.side[here] >= 0]
        blunt = _without_direction(tracer, exact, walked)
        pieces |= {int(v): _step_aside(tracer.mesh, exact, int(v)) for v in walked[blunt]}
        walked = walked[~blunt]
        if len(walked):
            lines = _traced_back(tracer, exact, walked)
            for i, v in enumerate(walked):
                pieces[int(v)] = _cut(tracer.mesh, exact, sources, lines, i, int(v))
        wanted = {pieces[int(v)].goes_to for v in here} - set(pieces) - {-1, _LOST}
    return pieces


def last_piece(
    mesh: SurfaceMesh, exact: ExactDistance, vertex: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Where shortest paths to vertices with `side` >= 0 end: the face, the vertex in it, and where they enter
    it, both in barycentric coordinates."""
    face, j = np.divmod(exact.side[vertex], 3)
    rows = np.arange(len(vertex))
    apex = np.eye(3)[(j + 2) % 3]
    share = exact.crossing[vertex] / mesh.side_length[face, j]
    crossing = np.zeros((len(vertex), 3))
    crossing[rows, j], crossing[rows, (j + 1) % 3] = 1.0 - share, share
    return face, apex, crossing


def _traced_back(tracer: Tracer, exact: ExactDistance, vertex: NDArray) -> Traces:
    """Lines from vertices with `side` >= 0 back along their shortest paths to the origins of those."""
    face, apex, crossing = last_piece(tracer.mesh, exact, vertex)
    direction = planar_difference(tracer.unfolding, face, apex, crossing)
    origin = exact.origin_vertex[vertex]
    length = exact.distance[vertex] - np.where(origin >= 0, exact.distance[origin], 0.0)
    return tracer.trace(face, apex, direction, np.maximum(length, 0.0), record=True)


def _without_direction(tracer: Tracer, exact: ExactDistance, vertex: NDArray) -> NDArray[np.bool_]:
    """(k,) vertices with `side` >= 0 whose last straight piece is entered where they lie: in a face without
    width, so that the piece has no length to take a direction from."""
    face, apex, crossing = last_piece(tracer.mesh, exact, vertex)
    last = planar_difference(tracer.unfolding, face, apex, crossing)
    width = tracer.mesh.side_length[face].max(axis=1, initial=0.0)
    blunt: NDArray[np.bool_] = np.hypot(last[:, 0], last[:, 1]) <= BLUNT * width
    return blunt


def _step_aside(mesh: SurfaceMesh, exact: ExactDistance, v: int) -> _Piece:
    """The piece without length from a vertex to another one at its place, over a zero side; or lost."""
    face, j = divmod(int(exact.side[v]), 3)
    near = exact.crossing[v] <= 0.5 * mesh.side_length[face, j]
    end, between = (j, PREVIOUS[j]) if near else (NEXT[j], NEXT[j])
    goes_to = int(mesh.faces[face, end]) if mesh.side_length[face, between] == 0 else _LOST
    return _Piece(np.array([face]), np.eye(3)[[PREVIOUS[j]]], goes_to)


def _piece_in_face(mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, v: int) -> _Piece:
    """A piece inside one face: along an edge to the origin vertex, or to a source point."""
    around = np.flatnonzero((mesh.faces == v).any(axis=1))
    origin = int(exact.origin_vertex[v])
    if origin >= 0:
        holding = around[(mesh.faces[around] == origin).any(axis=1)]
        if not len(holding):
            raise ParameterError(f"the path to vertex {v} runs outside the faces; mend the mesh around it")
        face = holding[:1]
    else:
        number = int(exact.nearest_source[v]) - len(sources.vertex)
        f, b = sources.points.face[[number]], sources.points.barycentric[[number]]
        face = np.array(
            [g for g in around if not np.isnan(seen_from(mesh.topology, f, b, np.array([g]))[0, 0])][:1]
        )
    return _Piece(face, (mesh.faces[face] == v).astype(np.float64)[:, :], origin)


def _cut(mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, lines: Traces, i: int, v: int) -> _Piece:
    """The recorded points of line i up to the face that holds the origin."""
    face, barycentric = lines.path(i)
    origin = int(exact.origin_vertex[v])
    met = np.flatnonzero(barycentric[1:].max(axis=1) >= 1 - 1e-9) + 1
    if len(met):  # through a vertex: which way a saddle is passed, the shortest path to it knows
        last = met[0]
        vertex = int(mesh.faces[face[last], np.argmax(barycentric[last])])
        if exact.distance[vertex] < exact.distance[v]:
            return _Piece(face[:last], barycentric[:last], vertex)
    if origin >= 0:
        holds = (mesh.faces[face[:-1]] == origin).any(axis=1)
    else:
        number = int(exact.nearest_source[v]) - len(sources.vertex)
        f = np.repeat(sources.points.face[number], len(face) - 1)
        b = np.repeat(sources.points.barycentric[[number]], len(face) - 1, axis=0)
        holds = ~np.isnan(seen_from(mesh.topology, f, b, face[:-1])[:, 0])
    keep = np.flatnonzero(holds)
    if not len(keep) and lines.status[i] == AT_BOUNDARY:
        return _Piece(face[:1], barycentric[:1], _LOST)
    if not len(keep) and origin >= 0:  # there, but across a face without area from those at the origin
        around = np.flatnonzero((mesh.faces == origin).any(axis=1))
        there, weights = np.full(len(around), face[-1]), np.tile(barycentric[-1], (len(around), 1))
        seen = seen_from(mesh.topology, there, weights, around)
        also = np.flatnonzero(~np.isnan(seen[:, 0]))[:1]
        face = np.concatenate([face[:-1], around[also]])
        return _Piece(face, np.concatenate([barycentric[:-1], seen[also]]), origin)
    last = keep[0] + 1 if len(keep) else len(face) - 1  # inside one face the straight way is the shortest
    return _Piece(face[:last], barycentric[:last], origin)


def _chain(
    mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, pieces: dict[int, _Piece], target: int
) -> tuple[NDArray, NDArray]:
    """Points from the target back to the source, both included."""
    if not np.isfinite(exact.distance[target]):
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    faces, weights, v = [], [], target
    for _ in range(len(pieces) + 1):
        if v < 0 or v not in pieces:
            break
        faces.append(pieces[v].face)
        weights.append(pieces[v].barycentric)
        v = pieces[v].goes_to
    if v == _LOST or v in pieces:  # or round and round among vertices at one place
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    if v >= 0:  # a source vertex
        face = faces[-1][-1:] if faces else np.flatnonzero((mesh.faces == v).any(axis=1))[:1]
        end = (mesh.faces[face] == v).astype(np.float64)
        if end.sum() != 1:
            end = np.eye(3)[[np.argmax(end[0])]]
    else:
        number = int(exact.nearest_source[target]) - len(sources.vertex)
        face = faces[-1][-1:]
        end = seen_from(
            mesh.topology, sources.points.face[[number]], sources.points.barycentric[[number]], face
        )
        end = np.nan_to_num(end, nan=1 / 3)
    return np.concatenate([*faces, face]), np.concatenate([*weights, end])
