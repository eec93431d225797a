"""Exact geodesic distance on a polyhedral surface, by batched propagation of windows (chapter 6)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.start import start_wavefront
from ddgcli.algorithms.geodesics.exact.strips import propagate_strips
from ddgcli.algorithms.geodesics.exact.tables import WindowTables, window_tables
from ddgcli.algorithms.geodesics.exact.targets import WindowTargets
from ddgcli.algorithms.geodesics.exact.tolerance import NearestVertices
from ddgcli.algorithms.geodesics.exact.wavefront import Wavefront
from ddgcli.algorithms.geodesics.sources import Sources, VertexDistances, check_sources
from ddgcli.errors import MeshError, ParameterError, SolveError, counted
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.triangle_mesh import TriangleMesh

log = logging.getLogger("ddgcli")

Start = Callable[..., tuple[Wavefront, WindowTargets]]  # by its slack and its bounds
Propagation = tuple[Wavefront, WindowTargets, float]  # with the estimated error of its slack

# Rounds after which a run restarts with a bound on crossings: constant, and per face.
MIN_ROUNDS, ROUNDS_PER_FACE = 1000.0, 0.25
BOUNDED_ROUNDS_PER_FACE = 16.0  # rounds after which the bounded run raises SolveError


@dataclass(frozen=True, eq=False)
class ExactDistance(VertexDistances):
    """Exact distances, and the last segment of the shortest path to each vertex.

    The last straight piece of the shortest path to vertex v unfolds from an origin: a source, or a vertex
    that the path bends around. Where `side[v]` >= 0 it enters the face of that flat side index 3f + j,
    opposite v, at `crossing[v]` from the side's first corner, and is straight back to the origin; where it is
    -1 it runs inside a face of v, from the origin vertex along an edge or from a source point in that face.

    Parameters
    ----------
    origin_vertex : (n,) ndarray of int64
        Vertex at which the last straight piece begins; -1 where it begins at a source point or inside a
        source edge (or nowhere).
    side : (n,) ndarray of int64
    crossing : (n,) ndarray of float64
        In length units; nan where `side` is -1.
    windows, rounds : int
        Number of windows propagated across a face (a bundle counts as one), and of rounds.
    target_distance : (k,) ndarray of float64
        Distances of the targets; inf where no source reaches.
    target_source : (k,) ndarray of int64
        Number of their nearest source; -1 where none reaches.
    departure : (n,) ndarray of float64, or None
        With `directions`: angle at which the shortest path leaves the source, counter-clockwise; around a
        source vertex from the first side of its fan (`vertex_fans`), in a face from side 0. nan at sources
        and where none reaches.
    tolerance_error : float
        Under a tolerance: twice the largest excess over the exact distance among the nearest tenth of the
        vertices (1000 at least), relative to the radius that they fill: an estimate of the largest error over
        the largest distance, on the safe side. 0 if the exact distance was cheaper.
    patched : int
        Vertices reached only by an edge path (0 except on extremely degenerate triangles); upper bounds.
    """

    origin_vertex: NDArray[np.int64]
    side: NDArray[np.int64]
    crossing: NDArray[np.float64]
    windows: int
    rounds: int
    target_distance: NDArray[np.float64]
    target_source: NDArray[np.int64]
    departure: NDArray[np.float64] | None = None
    tolerance_error: float = 0.0
    patched: int = 0


def exact_distance(
    mesh: SurfaceMesh,
    sources: Sources | NDArray | list[int] | int,
    *,
    tolerance: float = 0.0,
    limit: float = np.inf,
    targets: SurfacePoints | None = None,
    tables: WindowTables | None = None,
    dominance_every: int = 10,
    directions: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> ExactDistance:
    """Exact distance along the surface from every vertex to the nearest of `sources`.

    Sources are vertices, points, and edges: the points of an edge reach the surface along lines
    perpendicular to it.

    Any triangle complex is valid: boundaries, saddles, non-manifold edges and vertices (lines continue into
    every other face), faces of mixed orientation, Delta-complexes, degenerate faces.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources, vertex index or array of vertex indices
    tolerance : float
        In lengths of the side crossed; 0 is exact. Otherwise a path may be missed if one that bends at a
        vertex is at most that much longer. It bounds each such detour; they add up along a path, and
        `tolerance_error` estimates the whole error. The result is the length of a real path, never below the
        distance. It is used only without `limit`, and where it saves time (predicted from the nearest tenth
        of the vertices).
    limit : float
        Stop when all distances below it are final; vertices beyond it are inf or upper bounds.
    targets : SurfacePoints, optional
        Points on faces whose distances are also computed.
    tables : WindowTables, optional
        `window_tables(mesh)`, shared by several calls.
    dominance_every : int
        Rounds between prunings; changes the time, not the distances.
    directions : bool
        Also compute `departure`; needs consistently oriented faces.
    progress : callable, optional
        Called with the number of final vertices and of all vertices.

    Returns
    -------
    ExactDistance

    Raises
    ------
    MeshError, ParameterError
        On a bad source or tolerance; on directions where faces run against each other.
    SolveError
        When the windows are too many for the number of vertices and faces.

    Notes
    -----
    A shortest path in space crosses a face at most once, because the straight segment between two of its
    points is the shortest path between them. Windows that have crossed more faces than the mesh has are
    dropped. On needles and flat faces rounding prevents the other filters from dropping them.
    """
    _check_arguments(mesh, tolerance, directions)
    sources = check_sources(mesh, sources)
    if len(sources.edge) and (tolerance > 0 or directions):
        name = "tolerance" if tolerance > 0 else "directions"
        raise ParameterError(
            "needs sources at vertices or points; leave edges out of `sources`", parameter=name
        )
    tables = tables or window_tables(mesh)
    points = SurfacePoints.none() if targets is None else targets
    points = SurfacePoints.checked(points.face, points.barycentric, mesh.n_faces)
    most_windows = 1e6 + 3000.0 * mesh.n_vertices + 60.0 * mesh.n_vertices**1.5
    start = partial(start_wavefront, mesh, sources, points, tables, dominance_every, directions)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # in the units of every component with a source
        largest = limit / tables.scale[_source_vertices(mesh, sources)].min()
        propagate = partial(
            _propagate, mesh, sources=sources, tolerance=tolerance, limit=largest, most_windows=most_windows,
            progress=progress,
        )  # fmt: skip
        wavefront, window_targets, error = _bounded_propagation(mesh, start, propagate)
    patched = _patch_unreached(wavefront, mesh) if np.isinf(limit) else 0
    window_targets.finish(wavefront.distance, wavefront.origin)
    target_scale = tables.scale[mesh.faces[points.face, 0]]
    return _result(wavefront, window_targets, target_scale, directions, error, patched)


def _check_arguments(mesh: SurfaceMesh, tolerance: float, directions: bool) -> None:
    if not 0 <= tolerance < np.inf:
        raise ParameterError(
            f"{tolerance} must be a number of side lengths, 0 or more", parameter="tolerance"
        )
    if directions and not mesh.topology.is_oriented:
        raise MeshError(
            f"neighbouring faces have opposite orientation: directions have no sign; {remedy('orientation')}"
        )


def _bounded_propagation(
    mesh: SurfaceMesh, start: Start, propagate: Callable[[Start], Propagation]
) -> Propagation:
    """Propagate from a start, with a bound on crossings if there are too many windows without it.

    Only a mesh in space has the bound: in an intrinsic face the straight segment may be a detour.
    """
    try:
        return propagate(partial(start, max_rounds=MIN_ROUNDS + ROUNDS_PER_FACE * mesh.n_faces))
    except SolveError:
        if not isinstance(mesh, TriangleMesh):
            raise
    log.info("windows multiply on degenerate faces: restarting with a bound on crossings")
    max_rounds = MIN_ROUNDS + BOUNDED_ROUNDS_PER_FACE * mesh.n_faces
    return propagate(partial(start, max_crossings=mesh.n_faces, max_rounds=max_rounds))


def _propagate(
    mesh: SurfaceMesh,
    start: Start,
    sources: Sources,
    tolerance: float,
    limit: float,
    most_windows: float,
    progress: Callable[[float, float], None] | None,
) -> Propagation:
    """Run a wavefront; return it with its targets and the estimated error of its slack."""
    wavefront, window_targets = start(slack=0.0)
    near = None
    if tolerance > 0 and np.isinf(limit):
        near = NearestVertices.measure(wavefront, most_windows)
        if near.slack_saves_time(tolerance, _reachable(mesh, wavefront)):
            wavefront, window_targets = start(slack=tolerance)
    wavefront.run(limit, most_windows, progress)
    if len(sources.edge):
        side, index = _source_sides(mesh, sources)
        # a shortest path in space crosses a face at most once
        bound = mesh.n_faces if isinstance(mesh, TriangleMesh) else 1000 + 16 * mesh.n_faces
        propagate_strips(
            wavefront, side, index,
            max_crossings=bound, limit=limit, most_windows=most_windows, progress=progress,
        )  # fmt: skip
        wavefront.run(limit, most_windows, progress)
    if near is None or wavefront.slack == 0:
        return wavefront, window_targets, 0.0
    error = near.error_of(wavefront.distance)
    wavefront.windows, wavefront.rounds = wavefront.windows + near.windows, wavefront.rounds + near.rounds
    return wavefront, window_targets, error


def _source_vertices(mesh: SurfaceMesh, sources: Sources) -> NDArray[np.int64]:
    """A vertex of each source, or of its face or edge."""
    in_face, on_edge = mesh.faces[sources.points.face, 0], mesh.topology.edges[sources.edge, 0]
    return np.concatenate([sources.vertex, in_face, on_edge])


def _source_sides(mesh: SurfaceMesh, sources: Sources) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sides on source edges, and the index of the source of each."""
    index = np.full(mesh.topology.n_edges, -1, dtype=np.int64)
    index[sources.edge] = sources.first_curve + sources.curve
    of_side = index[mesh.topology.side_edge.ravel()]
    side = np.flatnonzero(of_side >= 0)
    return side, of_side[side]


def _result(
    wavefront: Wavefront,
    window_targets: WindowTargets,
    target_scale: NDArray,
    directions: bool,
    error: float,
    patched: int,
) -> ExactDistance:
    """Result of a finished wavefront, in the mesh's length unit."""
    scale = wavefront.tables.scale
    origin_vertex = _origin_values(wavefront.origins.vertex, wavefront.origin)
    return ExactDistance(
        distance=wavefront.distance * scale,
        nearest_source=_origin_values(wavefront.origins.source, wavefront.origin),
        origin_vertex=origin_vertex,
        side=np.maximum(wavefront.side, -1),
        crossing=np.where(wavefront.side >= 0, wavefront.crossing * scale, np.nan),
        windows=wavefront.windows,
        rounds=wavefront.rounds,
        target_distance=window_targets.distance * target_scale,
        target_source=_origin_values(wavefront.origins.source, window_targets.origin),
        departure=_beyond_bends(wavefront.departure, origin_vertex) if directions else None,
        tolerance_error=error,
        patched=patched,
    )


def _beyond_bends(departure: NDArray, origin_vertex: NDArray) -> NDArray[np.float64]:
    """Departure angles; beyond a bend, the angle of the path to the bend."""
    while True:
        open_ = (np.isnan(departure) & (origin_vertex >= 0)).nonzero()[0]
        origin_departure = departure[origin_vertex[open_]]
        if np.isnan(origin_departure).all():
            return departure
        departure[open_] = origin_departure


def _reachable(mesh: SurfaceMesh, wavefront: Wavefront) -> int:
    """Number of vertices on the components that a wavefront has reached."""
    component = mesh.topology.vertex_component
    return int(np.isin(component, component[np.isfinite(wavefront.distance)]).sum())


def _origin_values(values: NDArray, origin: NDArray) -> NDArray[np.int64]:
    """Values of the origins; -1 where there is no origin."""
    return np.where(origin >= 0, values[np.maximum(origin, 0)], -1)


def _patch_unreached(wavefront: Wavefront, mesh: SurfaceMesh) -> int:
    """Add edge paths to vertices that rounding left unreached although they are connected; return their
    number."""
    unreached = np.isinf(wavefront.distance) & mesh.topology.referenced_vertex
    if not unreached.any():
        return 0
    component = mesh.topology.vertex_component
    reached = np.zeros(mesh.topology.n_components + 1, dtype=bool)
    reached[component[np.isfinite(wavefront.distance)]] = True
    unreached &= reached[component]
    count = int(unreached.sum())
    if count:
        log.warning(
            f"{counted(count, 'vertex', 'vertices')} among degenerate triangles (first: "
            f"{np.flatnonzero(unreached)[0]}) reached by edge paths only; distances there are upper bounds"
        )
    while unreached.any():
        before = int(unreached.sum())
        a, b = wavefront.tables.ids[:, 0], wavefront.tables.ids[:, 1]
        for tail, head in ((a, b), (b, a)):
            go = unreached[head] & ~unreached[tail] & np.isfinite(wavefront.distance[tail])
            reach = wavefront.distance[tail[go]] + wavefront.tables.shape[go, 0]
            by = None if wavefront.side_turn is None else wavefront.departure[tail[go]]
            wavefront.improve(head[go], reach, wavefront.origin[tail[go]], departure=by)
        unreached &= np.isinf(wavefront.distance)
        if int(unreached.sum()) == before:
            break
    return count
