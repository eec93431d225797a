"""Geodesic distance, level lines, shortest and straightest paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics import distance as distances
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.flipout import straightened_curves
from ddgcli.algorithms.geodesics.isolines import isoline_curves
from ddgcli.algorithms.geodesics.oriented_cover import OrientedCover, oriented_cover
from ddgcli.algorithms.geodesics.paths import curve_set
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths as core_shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources, checked_sources
from ddgcli.algorithms.geodesics.surface_curves import Curves, traced_curves
from ddgcli.algorithms.tangent_fields.field_curves import with_transport
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints, nearest_points
from ddgcli.library.mesh_arguments import MeshLike, accepts_arrays, mesh_of_kind
from ddgcli.library.result import Measurement
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "DistanceSolver",
    "HeatSolver",
    "distance_gradient",
    "geodesic_distance",
    "isolines",
    "measure_distance",
    "shortest_paths",
    "straighten_paths",
    "trace",
]

OPTIONS_OF_METHOD = {
    "exact": ("tolerance",),
    "heat": ("operator", "heat_time", "heat_refine"),
    "fast-marching": (),
    "dijkstra": (),
}


class DistanceSolver:
    """Solver of geodesic distance on one mesh; what does not depend on the sources is done once.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
        'exact': distance on the polyhedron. 'heat': two linear systems, factored here. 'fast-marching':
        first order. 'dijkstra': along edges, never too short.
    **options
        'exact': `tolerance` (slack in edge lengths, 0; errs upwards only). 'heat': `operator`
        ('intrinsic-delaunay', 'plain' or 'tufted'), `heat_time` (in squares of the mean edge length, 1),
        `heat_refine` (further rounds of normalising and integrating the gradient, 0).

    Raises
    ------
    MeshError
        When the mesh has no faces, or cannot have the operator.
    ParameterError
        On an unknown method, or an option that the method does not have.

    References
    ----------
    J. Mitchell, D. Mount, C. Papadimitriou, "The discrete geodesic problem", 1987 (exact).
    K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", 2013.
    R. Kimmel, J. Sethian, "Computing geodesic paths on manifolds", 1998 (fast marching).

    Examples
    --------
    >>> import ddgcli as ddg
    >>> solver = ddg.DistanceSolver(ddg.icosphere(2), "dijkstra")
    >>> [round(float(solver.distance(v).max()), 1) for v in (0, 1)]
    [3.3, 3.3]
    """

    def __init__(self, mesh: MeshLike, method: str = "exact", **options: Any) -> None:
        self.mesh = mesh_of_kind(mesh, ("surface", "intrinsic"), "a geodesic distance")
        self.method = method
        self._solve = distances.prepare(self.mesh, method, _distance_options(method, options))

    def distance(
        self, sources: int | Sequence[int] | NDArray = (), *, source_points: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """(n,) distance from every vertex to the nearest source, in length units; inf where none reaches."""
        return self._solve(_sources(self.mesh, sources, source_points)).distance

    def measure(
        self, sources: int | Sequence[int] | NDArray = (), *, source_points: ArrayLike | None = None
    ) -> Measurement:
        """Distance with nearest sources, results and certificate; see `measure_distance`."""
        measured = distances.measure_distance(
            self.mesh, _sources(self.mesh, sources, source_points), self.method, solver=self._solve
        )
        return Measurement(
            self.mesh, vertex=measured.arrays, results=measured.results, accuracy=measured.accuracy
        )


def HeatSolver(
    mesh: MeshLike, *, heat_time: float = 1.0, heat_refine: int = 0, operator: str | None = None
) -> DistanceSolver:
    """Solver of geodesic distance by the heat method, factored once for any number of sources.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    heat_time : float
        Time step in squares of the mean edge length.
    heat_refine : int
        Further rounds of normalising and integrating the gradient.
    operator : {'intrinsic-delaunay', 'plain', 'tufted'}, optional
        Triangulation that carries the Laplacian; default 'intrinsic-delaunay', 'tufted' where the mesh is
        not an oriented manifold.

    Returns
    -------
    DistanceSolver
        `distance(sources)` and `measure(sources)`.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", 2013.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> solver = ddg.HeatSolver(ddg.icosphere(3))
    >>> round(float(solver.distance([5]).max()), 1)  # half a great circle
    3.1
    """
    return DistanceSolver(mesh, "heat", heat_time=heat_time, heat_refine=heat_refine, operator=operator)


def geodesic_distance(
    mesh: MeshLike,
    sources: int | Sequence[int] | NDArray = (),
    method: str = "exact",
    *,
    source_points: ArrayLike | None = None,
    **options: Any,
) -> NDArray[np.float64]:
    """Distance along the surface from every vertex to the nearest source.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    sources : int or sequence of int
        Source vertices.
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
        See `DistanceSolver`, which saves the set-up when one mesh has many queries.
    source_points : (k, 3) array_like of float, optional
        Further sources: the points of the surface nearest to these positions.
    **options
        Of the method; see `DistanceSolver`.

    Returns
    -------
    (n,) ndarray of float64
        In length units; inf where no source reaches.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    See `DistanceSolver`.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(8, 8)
    >>> d = ddg.geodesic_distance(square, sources=[0])
    >>> round(float(d[-1]), 12)  # the diagonal
    1.414213562373
    """
    return DistanceSolver(mesh, method, **options).distance(sources, source_points=source_points)


def measure_distance(
    mesh: MeshLike,
    sources: int | Sequence[int] | NDArray = (),
    method: str = "exact",
    *,
    source_points: ArrayLike | None = None,
    **options: Any,
) -> Measurement:
    """Geodesic distance with a certificate of its error.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    sources : int or sequence of int
        Source vertices.
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
        See `DistanceSolver`.
    source_points : (k, 3) array_like of float, optional
        Further sources: the points of the surface nearest to these positions.
    **options
        Of the method; see `DistanceSolver`.

    Returns
    -------
    Measurement
        `vertex` holds `geodesic_distance` (length units, inf where no source reaches) and `nearest_source`
        (number of the source, vertices first, -1 where none reaches); `results` the largest and the mean
        distance and the work done; `accuracy` the violations of the bounds that every distance obeys, and
        the residuals of the method.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    See `DistanceSolver`.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> measured = ddg.measure_distance(ddg.icosphere(2), [0, 5])
    >>> sorted(measured.vertex)
    ['geodesic_distance', 'nearest_source']
    """
    return DistanceSolver(mesh, method, **options).measure(sources, source_points=source_points)


def _distance_options(method: str, options: dict[str, Any]) -> distances.DistanceOptions:
    """Options of a method, checked."""
    own = OPTIONS_OF_METHOD.get(method, tuple(options))
    for name, value in options.items():
        if name not in own:
            known = ", ".join(own) or "none"
            raise ParameterError(f"method {method!r} has no option {name!r}; its options: {known}")
        if name == "heat_time" and not (np.isfinite(value) and value > 0):
            raise ParameterError(f"heat_time must be positive, not {value}")
        if name in ("heat_refine", "tolerance") and not (np.isfinite(value) and value >= 0):
            raise ParameterError(f"{name} must not be negative, not {value}")
    return distances.DistanceOptions(**options)


def _sources(
    mesh: SurfaceMesh, sources: int | Sequence[int] | NDArray, source_points: ArrayLike | None
) -> Sources:
    """Sources at vertices and at the points of the surface nearest to positions; checked."""
    vertices = np.atleast_1d(np.asarray(sources, dtype=np.int64 if np.size(sources) == 0 else None))
    if vertices.dtype.kind not in "iu" or vertices.ndim != 1:
        raise ParameterError("sources must be vertex numbers, such as [0, 5]")
    points = None
    if source_points is not None:
        position = np.asarray(source_points, dtype=np.float64).reshape(-1, 3)
        points, _ = nearest_points(mesh_of_kind(mesh, ("surface",), "source_points"), position)
    return checked_sources(mesh, Sources.at(vertices.tolist(), points))


@accepts_arrays("surface")
def distance_gradient(mesh: TriangleMesh, distance: ArrayLike) -> NDArray[np.float64]:
    """Gradient of a distance on faces.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    distance : (n,) array_like of float
        As `geodesic_distance` returns it.

    Returns
    -------
    (m, 3) ndarray of float64
        Without unit, of length about 1; zero where a corner is not reached or a face has no area.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(4, 4)
    >>> ddg.distance_gradient(square, square.points[:, 0])[0].round(12).tolist()
    [1.0, 0.0, 0.0]
    """
    values = np.asarray(distance, dtype=np.float64)
    if values.shape != (mesh.n_vertices,):
        raise ParameterError(f"distance has shape {values.shape}; it needs one number for each vertex")
    return distances.distance_gradient(mesh, values)


@accepts_arrays("surface")
def isolines(mesh: TriangleMesh, values: ArrayLike, count: int = 10) -> Measurement:
    """Level lines of a function on vertices at even levels.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    values : (n,) array_like of float
        Faces with a value that is not finite are left out.
    count : int
        Levels, which cut the range of the values into count + 1 equal parts.

    Returns
    -------
    Measurement
        `mesh` (CurveSet) and `polylines`, higher values on the left; `vertex` holds `level`;
        `results["paths"]` one entry a line (`length`, `closed`, ...).

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(3)
    >>> circles = ddg.isolines(sphere, sphere.points[:, 2], 1)  # the equator
    >>> len(circles.polylines), circles.results["paths"][0]["closed"]
    (1, True)
    """
    function = np.asarray(values, dtype=np.float64)
    if function.shape != (mesh.n_vertices,):
        raise ParameterError(f"values have shape {function.shape}; they need one number for each vertex")
    cover = oriented_cover(mesh)
    if cover.one_sided:
        return curve_measurement(mesh, isoline_curves(mesh, function, count))
    return curve_measurement(mesh, cover.projected(isoline_curves(cover.mesh, function, count)))


@accepts_arrays("surface")
def shortest_paths(
    mesh: TriangleMesh,
    sources: int | Sequence[int] | NDArray,
    targets: int | Sequence[int] | NDArray,
    *,
    source_points: ArrayLike | None = None,
    transport: bool = False,
) -> Measurement:
    """Shortest path from the nearest source to each target vertex, by the exact distance.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    sources, targets : int or sequence of int
        Vertices.
    source_points : (k, 3) array_like of float, optional
        Further sources: the points of the surface nearest to these positions.
    transport : bool
        Also carry a tangent frame along each path: `transport_x`, `transport_y`.

    Returns
    -------
    Measurement
        `mesh` (CurveSet) and `polylines`, from source to target; `vertex` holds `path_id`, `face`,
        `barycentric`; `results["paths"]` one entry a path (`length`, `source`, `target`, angles at vertices);
        `accuracy["path_length_residual"]`, relative. A target that no source reaches has no points and the
        length None.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    J. Mitchell, D. Mount, C. Papadimitriou, "The discrete geodesic problem", 1987.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> paths = ddg.shortest_paths(ddg.grid(8, 8), 0, [80, 8])
    >>> [round(path["length"], 6) for path in paths.results["paths"]]
    [1.414214, 1.0]
    """
    cover, checked = oriented_cover(mesh), _sources(mesh, sources, source_points)
    if len(checked.points):
        cover.need_two_sides("a path from points inside faces")
    curves = core_shortest_paths(
        cover.mesh,
        cover.lifted_exact(exact_distance(mesh, checked)),
        cover.lifted_sources(checked),
        [int(v) for v in np.atleast_1d(targets)],
        continued=cover.continued,
    )
    return _transported(cover, curves, transport)


@accepts_arrays("surface")
def straighten_paths(
    mesh: TriangleMesh, paths: Sequence[Sequence[int]], *, closed: bool = False, transport: bool = False
) -> Measurement:
    """Geodesics in the isotopy classes of edge paths, by intrinsic edge flips.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Orientable.
    paths : sequence of sequence of int
        Vertices that fix each class; a geodesic passes the ends of an open path only.
    closed : bool
        The paths are loops.
    transport : bool
        Also carry a tangent frame along each path, and the `holonomy` of loops.

    Returns
    -------
    Measurement
        As of `shortest_paths`; `accuracy["path_angle_deficit"]` is how far an angle beside a curve falls
        below pi at most. A loop that contracts to a point has no points and length 0.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    N. Sharp, K. Crane, "You can find geodesic paths in triangle meshes by just flipping edges", 2020.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.cylinder(24, 6)
    >>> loop = ddg.straighten_paths(mesh, [range(0, 168, 7)], closed=True)
    >>> round(loop.results["paths"][0]["length"], 2)
    6.27
    """
    cover = oriented_cover(mesh)
    cover.need_two_sides("straightening")
    waypoints = [[int(v) for v in path] for path in paths]
    return _transported(
        cover, straightened_curves(cover.mesh, waypoints, [closed] * len(waypoints)), transport
    )


@accepts_arrays("surface")
def trace(
    mesh: TriangleMesh,
    face: ArrayLike,
    barycentric: ArrayLike,
    direction: ArrayLike,
    length: ArrayLike,
    *,
    at_boundary: Literal["stop", "reflect"] = "stop",
    transport: bool = False,
) -> Measurement:
    """Straightest geodesics from points of faces: the exponential map.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    face : int or (k,) array_like of int
    barycentric : (3,) or (k, 3) array_like of float
        Start points in the faces.
    direction : (3,) or (k, 3) array_like of float
        In space; projected to the plane of the face. Its size does not matter.
    length : float or (k,) array_like of float
        In length units.
    at_boundary : {'stop', 'reflect'}
    transport : bool
        Also carry a tangent frame along each line.

    Returns
    -------
    Measurement
        As of `shortest_paths`; entries hold `status` ('reached', 'boundary' or 'gave up') and
        `end_direction`; `accuracy["trace_angle_defect"]` in radians.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    K. Polthier, M. Schmies, "Straightest geodesics on polyhedral surfaces", 1998.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> line = ddg.trace(ddg.grid(8, 8), 0, [0.2, 0.4, 0.4], [1, 0.3, 0], 0.5)
    >>> line.results["paths"][0]["status"], round(line.results["paths"][0]["length"], 12)
    ('reached', 0.5)
    """
    cover = oriented_cover(mesh)
    barycentric = np.atleast_2d(np.asarray(barycentric, dtype=np.float64))
    points = SurfacePoints.checked(np.atleast_1d(np.asarray(face)), barycentric, mesh.n_faces)
    start = cover.lifted_points(points)
    vectors = np.broadcast_to(np.atleast_2d(np.asarray(direction, dtype=np.float64)), (len(points), 3))
    lengths = np.broadcast_to(np.asarray(length, dtype=np.float64), (len(points),))
    curves = traced_curves(
        cover.mesh, start.face, start.barycentric, vectors, lengths, at_boundary=at_boundary
    )
    return _transported(cover, curves, transport)


def _transported(cover: OrientedCover, curves: Curves, transport: bool) -> Measurement:
    """Curves of the cover as a measurement of the base, with a transported frame where required."""
    moved = with_transport(cover.mesh, curves) if transport else curves
    return curve_measurement(cover.base, cover.projected(moved))


def curve_measurement(mesh: TriangleMesh, curves: Curves) -> Measurement:
    """Curves on a surface as polylines in space with their arrays.

    Parameters
    ----------
    mesh : TriangleMesh
    curves : Curves
    """
    polylines = curve_set(mesh, curves.paths, **curves.arrays)
    return Measurement(
        polylines,
        vertex=dict(polylines.point_arrays),
        results={"paths": curves.entries},
        accuracy=curves.accuracy,
        converged=curves.converged,
    )
