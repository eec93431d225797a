"""Common interface of the distance solvers."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.edge_distance import downhill_source, edge_graph
from ddgcli.algorithms.geodesics.sources import Sources, VertexDistances, check_sources
from ddgcli.choices import DEFAULT_HEAT_TIME, DISTANCE_METHODS, HEAT_OPERATORS
from ddgcli.errors import MeshError, ParameterError, counted, renamed_parameters
from ddgcli.geometry.remedies import weld_advice
from ddgcli.geometry.surface_points import SurfacePoints, face_centroids
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.mollify import all_flat, check_mollifiable

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
    from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance

log = logging.getLogger("ddgcli")

MAX_HEAT_RESIDUAL = 1e-3  # above it, the heat's gradient has no usable direction


@dataclass(frozen=True)
class DistanceOptions:
    """Options of the distance methods.

    Parameters
    ----------
    tolerance : float
        exact: tolerance of each detour, see `exact_distance`; 0 is exact.
    operator : {'intrinsic-delaunay', 'plain', 'tufted'}, optional
        heat: the triangulation that carries the Laplacian. Default: intrinsic Delaunay on an oriented
        surface, otherwise its tufted cover.
    heat_time : float
        heat: diffusion time in units of the squared mean side length of each component.
    heat_refine : int
        heat: number of additional rounds of normalising and integrating the gradient.
    directions : bool
        exact: also compute the angles at which paths leave their sources (oriented faces only).
    """

    tolerance: float = 0.0
    operator: str | None = None
    heat_time: float = DEFAULT_HEAT_TIME
    heat_refine: int = 0
    directions: bool = False


@dataclass(frozen=True, eq=False)
class DistanceResult(VertexDistances):
    """Distances of all vertices by one method.

    Parameters
    ----------
    results, accuracy : dict
        For the summary: counts of the work, and error estimates.
    exact : ExactDistance, optional
        Result of the exact method: how the shortest paths arrive.
    fast_marching : FastMarchingDistance, optional
        Result of fast marching, with its stencils.
    converged : bool
        False if the certificate, an estimate of the error or a residual exceeds its bound.
    region : (m,) ndarray of int64, optional
        Source nearest to the centroid of each face, -1 where none reaches.
    estimate : callable, optional
        Computes the estimate of the largest error, which the certificate limits; only stated errors need it.
    edge_graph : callable, optional
        Computes the edges that bound the distance from above; default: those of the mesh.
    """

    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    exact: ExactDistance | None = None
    fast_marching: FastMarchingDistance | None = None
    converged: bool = True
    region: NDArray[np.int64] | None = None
    estimate: Callable[[], float] | None = None
    edge_graph: Callable[[], csr_array] | None = None

    @property
    def arrays(self) -> dict[str, NDArray]:
        """Vertex arrays by their names in files."""
        return {"geodesic_distance": self.distance, "nearest_source": self.nearest_source}


Solver = Callable[[Sources], DistanceResult]


def prepare_solver(
    mesh: SurfaceMesh,
    method: str,
    options: DistanceOptions = DistanceOptions(),
    *,
    targets: SurfacePoints | None = None,
    regions: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Solver:
    """Prepare a solver for one mesh and method, with everything that does not depend on the sources.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    options : DistanceOptions
    targets : SurfacePoints, optional
        exact: points on faces whose distances go into `results["targets"]`.
    regions : bool
        exact: also find the source nearest to the centroid of each face.
    progress : callable, optional
        exact: called with the number of final vertices and of all vertices.

    Returns
    -------
    callable
        Function from `Sources` to a `DistanceResult`.

    Raises
    ------
    ParameterError
        On an unknown method or operator, or on targets with another method than exact.
    MeshError
        When the mesh has no faces, or the operator does not exist on it.
    """
    makers = {"heat": _heat, "fast-marching": _fast_marching, "dijkstra": _dijkstra}
    if method not in DISTANCE_METHODS:
        raise ParameterError(f"{method!r} is not one of {', '.join(DISTANCE_METHODS)}", parameter="method")
    if mesh.n_faces == 0:
        raise MeshError("no triangles; a distance along the surface needs a surface")
    targets = SurfacePoints.none() if targets is None else targets
    if method == "exact":
        return _exact(mesh, options, targets, progress, regions=regions)
    if len(targets):
        raise ParameterError(f"points inside faces need `method=exact`, not {method}", parameter="targets")
    return makers[method](mesh, options)


def _from_curve_vertices(mesh: SurfaceMesh, solve: Solver, solve_curves: Solver) -> Solver:
    """A solver that replaces source edges by their vertices, for `solve_curves`."""

    def solve_at_vertices(sources: Sources) -> DistanceResult:
        if not len(sources.edge):
            return solve(sources)
        at_vertices, number = sources.at_vertices(mesh)
        result = solve_curves(at_vertices)
        nearest = result.nearest_source
        return replace(result, nearest_source=np.where(nearest >= 0, number[nearest], -1))

    return solve_at_vertices


def _exact(
    mesh: SurfaceMesh,
    options: DistanceOptions,
    targets: SurfacePoints,
    progress: Callable[[float, float], None] | None,
    *,
    regions: bool,
) -> Solver:
    from ddgcli.algorithms.geodesics.certificate import excess_over_straight_lines
    from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
    from ddgcli.algorithms.geodesics.exact.tables import window_tables

    tables, n_targets = window_tables(mesh), len(targets)
    points = targets.followed_by(face_centroids(mesh)) if regions else targets

    def solve(sources: Sources) -> DistanceResult:
        exact = exact_distance(
            mesh, sources, tolerance=options.tolerance, targets=points, tables=tables,
            directions=options.directions, progress=progress,
        )  # fmt: skip
        accuracy: dict[str, Any] = {}
        if options.tolerance > 0:
            estimate = exact.tolerance_error
            if estimate > 0:
                estimate = min(estimate, excess_over_straight_lines(mesh, sources, exact.distance))
            accuracy["tolerance_error_estimate"] = estimate
        results: dict[str, Any] = {"windows": exact.windows}
        if n_targets:
            results["targets"] = describe_targets(mesh, targets, exact)
        region = exact.target_source[n_targets:] if regions else None
        return DistanceResult(exact.distance, exact.nearest_source, results, accuracy, exact, region=region)

    return solve


def describe_targets(mesh: SurfaceMesh, targets: SurfacePoints, exact: ExactDistance) -> list[dict[str, Any]]:
    """Summary entries of the targets: position, distance (None if no source reaches it), nearest source."""
    entries = Sources.at([], targets).describe(mesh)
    for entry, distance, source in zip(entries, exact.target_distance, exact.target_source):
        entry["distance"] = float(distance) if np.isfinite(distance) else None
        entry["nearest_source"] = int(source)
    return entries


def _heat(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.delaunay.triangulation import negative_cotan_edges
    from ddgcli.algorithms.geodesics.certificate import gradient_error
    from ddgcli.algorithms.geodesics.heat import HeatSolver
    from ddgcli.choices import ITERATIVE_SOLVERS

    operator, base = _heat_mesh(mesh, options.operator)
    with renamed_parameters(time_factor="heat_time", refine="heat_refine"):
        solver = HeatSolver(base, time_factor=options.heat_time, refine=options.heat_refine, source_mesh=mesh)
    edges = cache(partial(edge_graph, base))

    def solve(sources: Sources, *, circular: bool = True) -> DistanceResult:
        heat = solver.distance(sources)
        if not heat.heat_residual <= MAX_HEAT_RESIDUAL:
            raise ParameterError(
                f"the heat after {options.heat_time:g} is lost to rounding (residual "
                f"{heat.heat_residual:.2g}); give a shorter `heat_time`, or use another method",
                parameter="heat_time",
            )
        accuracy: dict[str, Any] = {
            "heat_residual": heat.heat_residual,
            "poisson_residual": heat.poisson_residual,
        }
        if solver.solver in ITERATIVE_SOLVERS:
            accuracy["heat_solver"] = solver.solver
        results = {"operator": operator, "heat_time": solver.time_at(sources), "heat_stages": heat.n_stages}
        if heat.nonpositive_vertices and negative_cotan_edges(base):
            best = _heat_operator(mesh, None)
            better = "`method=exact`" if operator == best else f"`operator={best}`"
            log.warning(
                f"the heat is not positive at {counted(heat.nonpositive_vertices, 'vertex', 'vertices')}, "
                f"for faces with obtuse angles: distances are wrong around them; use {better}"
            )
        if heat.cold_faces:
            faces = counted(heat.cold_faces, "face", "faces")
            log.warning(f"the heat has no gradient on {faces}; the distance is interpolated there")
        estimate = partial(gradient_error, base, heat.extended, circular=circular)
        nearest = downhill_source(mesh, heat.distance, sources)
        return DistanceResult(heat.distance, nearest, results, accuracy, estimate=estimate, edge_graph=edges)

    return _from_curve_vertices(mesh, solve, partial(solve, circular=False))


def _heat_operator(mesh: SurfaceMesh, operator: str | None) -> str:
    """Name of the operator of the heat method; by default the one that the mesh has."""
    if operator is not None and operator not in HEAT_OPERATORS:
        raise ParameterError(f"{operator!r} is not one of {', '.join(HEAT_OPERATORS)}", parameter="operator")
    topology = mesh.topology
    is_surface = topology.is_oriented and not len(topology.nonmanifold_edges)
    return operator or ("intrinsic-delaunay" if is_surface else "tufted")


def _heat_mesh(mesh: SurfaceMesh, operator: str | None) -> tuple[str, SurfaceMesh]:
    """Name of the operator and its triangulation."""
    name = _heat_operator(mesh, operator)
    if operator is None and name == "tufted":
        log.warning(
            "the mesh has edges of three faces or faces of mixed orientation: "
            "the heat method uses its tufted cover"
        )
    if name == "plain":
        return name, mesh
    from ddgcli.algorithms.delaunay.boundary_splits import split_obtuse_boundary
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    if name == "tufted":
        from ddgcli.operators.tufted import tufted_cover

        return name, flip_to_delaunay(tufted_cover(mesh)).mesh
    return name, split_obtuse_boundary(flip_to_delaunay(mesh).mesh).mesh


def check_heat(mesh: SurfaceMesh, operator: str | None, heat_time: float | None = None) -> None:
    """Raise the errors of the heat method that need no flips and no solves.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    operator : str or None
        As in `DistanceOptions`.
    heat_time : float, optional
        As in `DistanceOptions`.

    Raises
    ------
    MeshError
    """
    from ddgcli.algorithms.delaunay.triangulation import glue
    from ddgcli.algorithms.geodesics.heat import diffusion_time
    from ddgcli.mesh.require import refuse_repeated_vertices

    name = _heat_operator(mesh, operator)
    if name == "intrinsic-delaunay":
        glue(mesh)
    elif name == "tufted":
        refuse_repeated_vertices(mesh)
    with renamed_parameters(factor="heat_time"):
        diffusion_time(mesh, DEFAULT_HEAT_TIME if heat_time is None else heat_time)
    if all_flat(mesh.side_length):
        check_mollifiable(_heat_mesh(mesh, operator)[1])


def _fast_marching(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance, fast_marching_stencils

    stencils = fast_marching_stencils(mesh)

    def solve(sources: Sources) -> DistanceResult:
        result = fast_marching_distance(mesh, sources, stencils=stencils)
        work = {"updates": result.updates}
        return DistanceResult(result.distance, result.nearest_source, work, fast_marching=result)

    return solve


def _dijkstra(mesh: SurfaceMesh, options: DistanceOptions) -> Solver:
    from ddgcli.algorithms.geodesics.edge_distance import edge_distance

    graph = edge_graph(mesh)

    def solve(sources: Sources) -> DistanceResult:
        edges = edge_distance(mesh, sources, graph=graph)
        return DistanceResult(edges.distance, edges.nearest_source)

    return _from_curve_vertices(mesh, solve, solve)


def measure_distance(
    mesh: SurfaceMesh,
    sources: Sources,
    method: str = "exact",
    options: DistanceOptions = DistanceOptions(),
    *,
    solver: Solver | None = None,
) -> DistanceResult:
    """Distance from every vertex to the nearest source, with its certificate.

    A warning names the components that no source reaches.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    options : DistanceOptions
    solver : callable, optional
        `prepare_solver(mesh, method, options)`, shared by several calls.

    Returns
    -------
    DistanceResult

    Raises
    ------
    ParameterError
        On an unknown method or a bad source.
    """
    from ddgcli.algorithms.geodesics.certificate import certificate
    from ddgcli.algorithms.geodesics.convergence import has_converged

    sources = check_sources(mesh, sources)
    solver = solver or prepare_solver(mesh, method, options)
    result = solver(sources)
    finite = result.distance[np.isfinite(result.distance)]
    results = {
        "method": method,
        "max_distance": float(finite.max(initial=0.0)),
        "mean_distance": float(finite.mean()) if len(finite) else 0.0,
        "unreachable": report_unreachable(mesh, result.distance),
        "sources": sources.describe(mesh),
    }
    accuracy = result.accuracy | certificate(
        mesh,
        sources,
        result.distance,
        estimate=None if result.estimate is None else result.estimate(),
        graph=None if result.edge_graph is None else result.edge_graph(),
    )
    converged = has_converged(mesh, method, accuracy)
    return replace(
        result, results=results | result.results, accuracy=accuracy, converged=converged, estimate=None
    )


def distance_gradient(mesh: TriangleMesh, distance: NDArray) -> NDArray[np.float64]:
    """Gradient of a distance on faces.

    Parameters
    ----------
    mesh : TriangleMesh
    distance : (n,) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of float64
        Without unit; zero where a corner is unreached or a face has no area.
    """
    from ddgcli.operators.gradient import gradient

    reached = np.isfinite(distance)
    values = (gradient(mesh) @ np.where(reached, distance, 0.0)).reshape(-1, 3)
    return np.where(reached[mesh.faces].all(axis=1)[:, None], values, 0.0)


def report_unreachable(mesh: SurfaceMesh, distance: NDArray) -> int:
    """Count the vertices at distance inf, and name their component, or the first of several, in a warning."""
    unreached = np.isinf(distance)
    count = int(unreached.sum())
    if not count:
        return 0
    component = mesh.topology.vertex_component
    numbers, first, sizes = np.unique(component[unreached], return_index=True, return_counts=True)
    first = np.flatnonzero(unreached)[first]
    named = numbers >= 0
    if named.sum() == 1:
        vertices = counted(sizes[named][0], "vertex", "vertices")
        log.warning(
            f"component {numbers[named][0]} ({vertices}, first: vertex {first[named][0]}) is "
            f"not reached by any source; its distance is inf{weld_advice(mesh, unreached)}"
        )
    elif named.any():
        log.warning(
            f"{named.sum()} components ({sizes[named].sum()} vertices; first: component {numbers[named][0]}, "
            f"vertex {first[named][0]}) are not reached by any source; their distance is inf"
            f"{weld_advice(mesh, unreached)}"
        )
    if not named.all():
        words = counted(int(sizes[~named].sum()), "vertex belongs", "vertices belong")
        log.warning(f"{words} to no face; the distance there is inf")
    return count
