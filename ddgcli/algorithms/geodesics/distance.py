"""One door to the distance methods: the same question, the same form of answer."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.sources import Sources, VertexDistances, check_sources
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import SurfaceMesh

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
    from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance

log = logging.getLogger("ddgcli")

# violation of the certificate over the largest edge distance; heat errs by two per cent on sound meshes
WARNING_EXCESS, LARGEST_EXCESS = 0.05, 0.5
LOST_HEAT = 1e-3  # residual of the heat's system, of which nothing is left to take a direction from

METHODS = ("exact", "heat", "fast-marching", "dijkstra")
OPERATORS = ("intrinsic-delaunay", "plain", "tufted")


@dataclass(frozen=True)
class DistanceOptions:
    """What the methods can be told.

    Parameters
    ----------
    tolerance : float
        exact: slack in side lengths, 0 or more.
    operator : {'intrinsic-delaunay', 'plain', 'tufted'}, optional
        heat: the triangulation whose Laplacian is used. Default: intrinsic Delaunay where the mesh is an
        oriented surface, else its tufted cover.
    heat_time : float
        heat: t in squares of the mean side length.
    heat_refine : int
        heat: further rounds of normalising and integrating the gradient.
    directions : bool
        exact: also at what angles paths leave their sources (oriented faces only).
    """

    tolerance: float = 0.0
    operator: str | None = None
    heat_time: float = 1.0
    heat_refine: int = 0
    directions: bool = False


@dataclass(frozen=True, eq=False)
class DistanceResult(VertexDistances):
    """Distances by one method.

    Parameters
    ----------
    results, accuracy : dict
        What the method tells of its work and of its error.
    exact : ExactDistance, optional
        How the shortest paths arrive, where the method knows.
    marched : FastMarchingDistance, optional
        By what stencils the distance was handed on, where it was.
    converged : bool
        False where the certificate or a residual is worse than the stated bounds.
    """

    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    exact: ExactDistance | None = None
    marched: FastMarchingDistance | None = None
    converged: bool = True

    @property
    def arrays(self) -> dict[str, NDArray]:
        """The vertex arrays to write, by their names in files."""
        return {"geodesic_distance": self.distance, "nearest_source": self.nearest_source}


Solver = Callable[[Sources], DistanceResult]


def prepare_solver(
    mesh: SurfaceMesh,
    method: str,
    options: DistanceOptions = DistanceOptions(),
    *,
    targets: SurfacePoints | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Solver:
    """A solver for one mesh and method; what does not depend on the sources is done here, once.

    Parameters
    ----------
    targets : SurfacePoints, optional
        exact: points on faces whose distance goes into `results["targets"]`.
    progress : callable, optional
        exact: told how many vertices of all are final.

    Raises
    ------
    ParameterError
        On an unknown method or option, or targets for a method that does not take them.
    MeshError
        When the mesh has no faces, or the operator cannot be had on it.
    """
    makers = {"heat": _heat, "fast-marching": _fast_marching, "dijkstra": _dijkstra}
    if method not in METHODS:
        raise ParameterError(f"method {method!r} is not one of {', '.join(METHODS)}")
    if mesh.n_faces == 0:
        raise MeshError("no triangles; a distance along the surface needs a surface")
    targets = SurfacePoints.none() if targets is None else targets
    if method == "exact":
        return _exact(mesh, options, targets, progress)
    if len(targets):
        raise ParameterError(f"distance at points inside faces belongs to method exact, not to {method}")
    return makers[method](mesh, options)


def _exact(
    mesh: SurfaceMesh,
    options: DistanceOptions,
    targets: SurfacePoints,
    progress: Callable[[float, float], None] | None,
) -> Solver:
    from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
    from ddgcli.algorithms.geodesics.exact.tables import window_tables

    tables = window_tables(mesh)

    def solve(sources: Sources) -> DistanceResult:
        exact = exact_distance(
            mesh, sources, tolerance=options.tolerance, targets=targets, tables=tables,
            directions=options.directions, progress=progress,
        )  # fmt: skip
        accuracy: dict[str, Any] = {}
        if options.tolerance > 0:
            accuracy["tolerance_error_estimate"] = exact.tolerance_error
        results: dict[str, Any] = {"windows": exact.windows}
        if len(targets):
            results["targets"] = describe_targets(mesh, targets, exact)
        return DistanceResult(exact.distance, exact.nearest_source, results, accuracy, exact)

    return solve


def describe_targets(mesh: SurfaceMesh, targets: SurfacePoints, exact: ExactDistance) -> list[dict[str, Any]]:
    """Each target for the summary: where it is, its distance (None where no source reaches), its source."""
    said = Sources.at([], targets).described(mesh)
    for entry, distance, source in zip(said, exact.target_distance, exact.target_source, strict=True):
        entry["distance"] = float(distance) if np.isfinite(distance) else None
        entry["nearest_source"] = int(source)
    return said


def _heat(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.geodesics.heat import HeatSolver

    operator, base = _heat_mesh(mesh, options.operator)
    solver = HeatSolver(base, time_factor=options.heat_time, refine=options.heat_refine, source_mesh=mesh)

    def solve(sources: Sources) -> DistanceResult:
        heat = solver.distance(sources)
        if not heat.heat_residual <= LOST_HEAT:
            raise ParameterError(
                f"heat of time {solver.time:g} is lost to rounding (residual {heat.heat_residual:.2g}); give "
                "a shorter --heat-time, or take --method exact"
            )
        accuracy = {"heat_residual": heat.heat_residual, "poisson_residual": heat.poisson_residual}
        results = {"operator": operator, "heat_time": solver.time, "heat_stages": heat.stages}
        if heat.cold_faces:
            log.warning(
                f"heat has no direction on {heat.cold_faces} faces; the distance is interpolated there"
            )
        return DistanceResult(heat.distance, downhill_source(mesh, heat.distance, sources), results, accuracy)

    return solve


def _heat_mesh(mesh: SurfaceMesh, operator: str | None) -> tuple[str, SurfaceMesh]:
    """Name of the operator and the triangulation that carries it."""
    if operator is not None and operator not in OPERATORS:
        raise ParameterError(f"operator {operator!r} is not one of {', '.join(OPERATORS)}")
    topology = mesh.topology
    sound = topology.is_oriented and not len(topology.nonmanifold_edges)
    if operator is None:
        operator = "intrinsic-delaunay" if sound else "tufted"
        if not sound:
            log.warning(
                "the mesh has edges of three faces or faces of mixed orientation: "
                "heat runs on its tufted cover"
            )
    if operator == "plain":
        return operator, mesh
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    if operator == "tufted":
        from ddgcli.operators.tufted import tufted_cover

        return operator, flip_to_delaunay(tufted_cover(mesh)).mesh
    return operator, flip_to_delaunay(mesh).mesh


def _fast_marching(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance, fast_marching_stencils

    stencils = fast_marching_stencils(mesh)

    def solve(sources: Sources) -> DistanceResult:
        marched = fast_marching_distance(mesh, sources, stencils=stencils)
        work = {"updates": marched.updates}
        return DistanceResult(marched.distance, marched.nearest_source, work, marched=marched)

    return solve


def _dijkstra(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.geodesics.edge_distance import edge_distance, edge_graph

    graph = edge_graph(mesh)

    def solve(sources: Sources) -> DistanceResult:
        edges = edge_distance(mesh, sources, graph=graph)
        return DistanceResult(edges.distance, edges.nearest_source)

    return solve


def measure_distance(
    mesh: SurfaceMesh,
    sources: Sources,
    method: str = "exact",
    options: DistanceOptions = DistanceOptions(),
    *,
    solver: Solver | None = None,
) -> DistanceResult:
    """Distance from every vertex to the nearest source, with its certificate; unreachable vertices reported.

    Parameters
    ----------
    solver : callable, optional
        `prepare_solver(mesh, method, options)`, to share among calls.

    Raises
    ------
    ParameterError
        On an unknown method or a bad source.
    """
    from ddgcli.algorithms.geodesics.certificate import certificate

    sources = check_sources(mesh, sources)
    solver = solver or prepare_solver(mesh, method, options)
    measured = solver(sources)
    finite = measured.distance[np.isfinite(measured.distance)]
    results = {
        "method": method,
        "max_distance": float(finite.max(initial=0.0)),
        "mean_distance": float(finite.mean()) if len(finite) else 0.0,
        "unreachable": report_unreachable(mesh, measured.distance),
        "sources": sources.described(mesh),
    }
    accuracy = measured.accuracy | certificate(mesh, sources, measured.distance)
    sound = within_residuals(
        accuracy,
        ("certificate_excess",),
        "bounds that every true distance satisfies are violated; use the exact method or repair the mesh",
        warning=WARNING_EXCESS if method in ("heat", "fast-marching") else 0.0,
        largest=LARGEST_EXCESS,
    )
    sound &= within_residuals(
        accuracy, ("heat_residual", "poisson_residual"), "use the exact method or repair the mesh"
    )
    return replace(measured, results=results | measured.results, accuracy=accuracy, converged=sound)


def compare(
    mesh: SurfaceMesh,
    sources: Sources,
    distance: NDArray,
    methods: list[str],
    options: DistanceOptions = DistanceOptions(),
) -> dict[str, dict[str, Any]]:
    """Difference of `distance` to what other methods say, and their seconds.

    Errors are relative to the other method's largest distance; `setup_seconds` is what any number of sources
    pays once.
    """
    table: dict[str, dict[str, Any]] = {}
    for method in methods:
        began = time.perf_counter()
        # against exact, the tolerance must not blur the reference
        solver = prepare_solver(mesh, method, replace(options, tolerance=0.0))
        ready = time.perf_counter()
        other = solver(sources).distance
        done = time.perf_counter()
        both = np.isfinite(distance) & np.isfinite(other)
        error = np.where(both, np.abs(np.where(both, distance, 0.0) - np.where(both, other, 0.0)), 0.0)
        scale = float(other[both].max(initial=0.0)) or 1.0
        table[method] = {
            "max_error": float(error.max(initial=0.0)) / scale,
            "max_error_at": int(np.argmax(error)) if len(error) else None,
            "mean_error": float(error[both].mean()) / scale if both.any() else 0.0,
            "setup_seconds": ready - began,
            "seconds": done - ready,
        }
    return table


def each_source(
    sources: Sources, solver: Solver, progress: Callable[[float, float], None] | None = None
) -> dict[str, NDArray[np.float64]]:
    """One array a source, named geodesic_distance_000 and so on; `progress(done, of)` hears of each."""
    digits = max(3, len(str(len(sources) - 1)))
    arrays = {}
    for i, one in enumerate(sources.each()):
        if progress is not None:
            progress(i, len(sources))
        arrays[f"geodesic_distance_{i:0{digits}d}"] = solver(one).distance
    return arrays


def distance_gradient(mesh: TriangleMesh, distance: NDArray) -> NDArray[np.float64]:
    """(m, 3) gradient of the distance on faces; zero where a corner is not reached or a face has no area."""
    from ddgcli.operators.gradient import gradient

    reached = np.isfinite(distance)
    values = (gradient(mesh) @ np.where(reached, distance, 0.0)).reshape(-1, 3)
    return np.where(reached[mesh.faces].all(axis=1)[:, None], values, 0.0)


def downhill_source(mesh: SurfaceMesh, distance: NDArray, sources: Sources) -> NDArray[np.int64]:
    """(n,) number of the source at the foot of each vertex's steepest way down along edges.

    Vertices whose way ends elsewhere (an approximate distance may have other minima) take the source that is
    nearest along edges; -1 where the distance is inf.
    """
    from ddgcli.algorithms.geodesics.edge_distance import edge_distance

    n = mesh.n_vertices
    reached = np.isfinite(distance)
    if len(sources) == 1:
        return np.where(reached, 0, -1)
    tail, head = mesh.topology.side_tail, mesh.topology.side_head
    a, b = np.concatenate([tail, head]), np.concatenate([head, tail])
    length = np.tile(mesh.side_length.ravel(), 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (distance[a] - distance[b]) / length
    down = np.flatnonzero(slope > 0)
    order = down[np.lexsort((-slope[down], a[down]))]
    vertex, first = np.unique(a[order], return_index=True)
    foot = np.arange(n)
    foot[vertex] = b[order[first]]
    label = np.full(n, -1, dtype=np.int64)
    for number in range(len(sources) - 1, -1, -1):
        label[sources.corners(mesh, number)] = number
    foot[label >= 0] = np.flatnonzero(label >= 0)
    while not np.array_equal(foot[foot], foot):
        foot = foot[foot]
    nearest = label[foot]
    lost = reached & (nearest < 0)
    if lost.any():
        nearest[lost] = edge_distance(mesh, sources).nearest_source[lost]
    return np.where(reached, nearest, -1)


def report_unreachable(mesh: SurfaceMesh, distance: NDArray) -> int:
    """Number of vertices at distance inf; a warning names their components."""
    lost = np.isinf(distance)
    count = int(lost.sum())
    if not count:
        return 0
    component = mesh.topology.vertex_component
    numbers, first, sizes = np.unique(component[lost], return_index=True, return_counts=True)
    first = np.flatnonzero(lost)[first]
    named = numbers >= 0
    for number, vertex, size in list(zip(numbers[named], first[named], sizes[named]))[:5]:
        log.warning(
            f"component {number} ({size} vertices, first: vertex {vertex}) is not reached by any source; "
            "its distance is inf"
        )
    if named.sum() > 5:
        rest = int(sizes[named][5:].sum())
        log.warning(f"{int(named.sum()) - 5} more components ({rest} vertices) are not reached")
    if not named.all():
        log.warning(f"{int(sizes[~named].sum())} vertices belong to no face; their distance is inf")
    return count
