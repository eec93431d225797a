"""Geodesic distance: solvers, distances with certificates, gradients."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics import distance as distances
from ddgcli.algorithms.geodesics.certificate import symmetry
from ddgcli.algorithms.geodesics.edge_sets import boundary_set, edge_set, joined_curves
from ddgcli.algorithms.geodesics.sources import Sources, check_sources
from ddgcli.choices import DEFAULT_HEAT_TIME
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints, nearest_points
from ddgcli.library.arguments import checked_arguments, real_array, real_number, text, whole_number
from ddgcli.library.mesh_arguments import MeshLike, accepts_arrays, mesh_of_kind
from ddgcli.library.result import Measurement
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "DistanceSolver",
    "HeatSolver",
    "distance_gradient",
    "geodesic_distance",
    "measure_distance",
]

OPTIONS_OF_METHOD = {
    "exact": ("tolerance",),
    "heat": ("operator", "heat_time", "heat_refine"),
    "fast-marching": (),
    "dijkstra": (),
}


class DistanceSolver:
    """Solver of geodesic distance on one mesh; the set-up is computed once for all sources.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
        'exact': distance on the polyhedron. 'heat': two linear systems, factored here. 'fast-marching':
        first order. 'dijkstra': along edges, never too short.
    **options
        'exact': `tolerance` (of each detour at a vertex, in lengths of the edge crossed, 0; they add up, and
        `tolerance_error_estimate` is of the whole error; never too short). 'heat': `operator`
        ('intrinsic-delaunay', 'plain' or 'tufted'), `heat_time` (in squares of the mean edge length
        of each component, 1), `heat_refine` (further rounds of normalising and integrating the gradient, 0).

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

    @checked_arguments
    def __init__(self, mesh: MeshLike, method: str = "exact", **options: Any) -> None:
        self.mesh = mesh_of_kind(mesh, ("surface", "intrinsic"), "a geodesic distance")
        self.method = method
        self._solve = distances.prepare_solver(self.mesh, method, _distance_options(method, options))

    def __repr__(self) -> str:
        return f"DistanceSolver({self.mesh}, {self.method!r})"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a DistanceSolver holds functions and is not pickled; make one from its mesh")

    @checked_arguments
    def distance(
        self,
        sources: int | Sequence[int] | NDArray = (),
        *,
        source_points: ArrayLike | None = None,
        source_edges: ArrayLike | None = None,
        source_boundary: bool = False,
    ) -> NDArray[np.float64]:
        """(n,) distance from every vertex to the nearest source, in length units; inf where none reaches."""
        checked = surface_sources(self.mesh, sources, source_points, source_edges, source_boundary)
        return self._solve(checked).distance

    @checked_arguments
    def measure(
        self,
        sources: int | Sequence[int] | NDArray = (),
        *,
        source_points: ArrayLike | None = None,
        source_edges: ArrayLike | None = None,
        source_boundary: bool = False,
    ) -> Measurement:
        """Distance with nearest sources, results and certificate; see `measure_distance`."""
        checked = surface_sources(self.mesh, sources, source_points, source_edges, source_boundary)
        return _measured(self.mesh, checked, self.method, self._solve)


@checked_arguments
def HeatSolver(
    mesh: MeshLike, *, heat_time: float = DEFAULT_HEAT_TIME, heat_refine: int = 0, operator: str | None = None
) -> DistanceSolver:
    """Solver of geodesic distance by the heat method, factored once for any number of sources.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
    heat_time : float
        Time step in squares of the mean edge length of each component.
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


@checked_arguments
def geodesic_distance(
    mesh: MeshLike,
    sources: int | Sequence[int] | NDArray = (),
    method: str = "exact",
    *,
    source_points: ArrayLike | None = None,
    source_edges: ArrayLike | None = None,
    source_boundary: bool = False,
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
    source_edges : (k, 2) array_like of int, or marks on edges, vertices or faces, optional
        Further sources: all points of these edges ('exact'), or their ends (other methods).
    source_boundary : bool
        The edges of the boundary are sources too.
    **options
        Options of the method; see `DistanceSolver`.

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
    solver = DistanceSolver(mesh, method, **options)
    return solver.distance(
        sources, source_points=source_points, source_edges=source_edges, source_boundary=source_boundary
    )


@checked_arguments
def measure_distance(
    mesh: MeshLike,
    sources: int | Sequence[int] | NDArray = (),
    method: str = "exact",
    *,
    source_points: ArrayLike | None = None,
    source_edges: ArrayLike | None = None,
    source_boundary: bool = False,
    target_points: ArrayLike | None = None,
    certify: bool = False,
    seed: int = 0,
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
    source_edges : (k, 2) array_like of int, or marks on edges, vertices or faces, optional
        Further sources: all points of these edges ('exact'), or their ends (other methods).
    source_boundary : bool
        The edges of the boundary are sources too.
    target_points : (k, 3) array_like of float, optional
        'exact': `results["targets"]` holds the distances of the points of the surface nearest to these.
    certify : bool
        `accuracy` also has the asymmetry and the violations of the triangle inequality of distances between
        some random vertices (which takes further runs).
    seed : int
        Seed of the choice of these vertices.
    **options
        Options of the method; see `DistanceSolver`.

    Returns
    -------
    Measurement
        `vertex` holds `geodesic_distance` (length units, inf where no source reaches) and `nearest_source`
        (index of the source: vertices, points, curves of edges; -1 where none reaches); `results` the
        largest and the mean distance and the work done; `accuracy` the violations of the bounds that every
        distance obeys, and the residuals of the method; `converged` is False where these are too large.

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
    surface = mesh_of_kind(mesh, ("surface", "intrinsic"), "a geodesic distance")
    checked = surface_sources(surface, sources, source_points, source_edges, source_boundary)
    targets = None if target_points is None else _nearest(surface, target_points, "target_points")
    with renamed_parameters(targets="target_points"):
        solve = distances.prepare_solver(surface, method, _distance_options(method, options), targets=targets)
    measured = _measured(surface, checked, method, solve)
    if certify:
        measured.accuracy.update(symmetry(surface, lambda source: solve(source).distance, seed=seed))
    return measured


def _measured(mesh: SurfaceMesh, sources: Sources, method: str, solve: distances.Solver) -> Measurement:
    """Distance with a certificate, by a solver of a method."""
    measured = distances.measure_distance(mesh, sources, method, solver=solve)
    return Measurement(
        mesh,
        vertex=measured.arrays,
        results=measured.results,
        accuracy=measured.accuracy,
        converged=measured.converged,
    )


def _distance_options(method: str, options: dict[str, Any]) -> distances.DistanceOptions:
    """Options of a method, checked."""
    own = OPTIONS_OF_METHOD.get(method, tuple(options))
    checked: dict[str, Any] = {}
    for name, value in options.items():
        if name not in own:
            names = ", ".join(own) or "none"
            raise ParameterError(
                f"is not an option of method {method!r}; its options are {names}", parameter=name
            )
        if name == "operator":
            checked[name] = None if value is None else text(value, name)
            continue
        checked[name] = number = (whole_number if name == "heat_refine" else real_number)(value, name)
        if name == "heat_time" and not 0 < number < np.inf:
            raise ParameterError(f"must be positive, not {value}", parameter=name)
        if not 0 <= number < np.inf:
            raise ParameterError(f"must be 0 or more, not {value}", parameter=name)
    return distances.DistanceOptions(**checked)


def surface_sources(
    mesh: SurfaceMesh,
    sources: int | Sequence[int] | NDArray,
    source_points: ArrayLike | None = None,
    source_edges: ArrayLike | None = None,
    source_boundary: bool = False,
    *,
    name: str = "sources",
) -> Sources:
    """Sources at vertices, at the points of the surface nearest to positions, and on edges; checked.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : int or sequence of int
    source_points : (k, 3) array_like of float, optional
    source_edges : array_like, optional
        See `edge_set`; connected edges are one source.
    source_boundary : bool
        Each loop of the boundary is one source.
    name : str
        Parameter that holds the vertices, for messages.
    """
    sets = []
    if source_edges is not None:
        sets.append(edge_set(mesh, np.asarray(source_edges), parameter="source_edges"))
    if source_boundary:
        refuse_repeated_vertices(mesh)  # which have a boundary of their own
        sets.append(boundary_set(mesh))
    points = None if source_points is None else _nearest(mesh, source_points, "source_points")
    with renamed_parameters(sources=name):
        vertices = vertex_indices(sources, name)
        return check_sources(mesh, Sources.at(vertices, points, *joined_curves(mesh, sets)))


def _nearest(mesh: SurfaceMesh, positions: ArrayLike, name: str) -> SurfacePoints:
    """Points of the surface nearest to the positions of a parameter."""
    array = np.atleast_2d(np.asarray(positions, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise ParameterError("must be finite positions of shape (k, 3)", parameter=name)
    return nearest_points(mesh_of_kind(mesh, ("surface",), name), array)[0]


def vertex_indices(vertices: int | Sequence[int] | NDArray, name: str) -> list[int]:
    """Vertex indices of a parameter as a list; ParameterError for anything but integers."""
    numbers = np.atleast_1d(real_array(vertices, name))
    if numbers.ndim != 1 or (numbers.dtype.kind not in "iu" and len(numbers)):
        raise ParameterError("vertices must be whole numbers, such as [0, 5]", parameter=name)
    return [int(v) for v in numbers]


@accepts_arrays("surface")
def distance_gradient(mesh: TriangleMesh, distance: ArrayLike) -> NDArray[np.float64]:
    """Gradient of a distance on faces.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    distance : (n,) array_like of float
        As `geodesic_distance` returns it: inf where no source reaches.

    Returns
    -------
    (m, 3) ndarray of float64
        Dimensionless, of length about 1; zero where a corner is not reached or a face has no area.

    Raises
    ------
    ParameterError
        When there is not one distance per vertex, or one is NaN.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(4, 4)
    >>> ddg.distance_gradient(square, square.points[:, 0])[0].round(12).tolist()
    [1.0, 0.0, 0.0]
    """
    values = np.asarray(distance, dtype=np.float64)
    if values.shape != (mesh.n_vertices,):
        raise ParameterError(
            f"has shape {values.shape}; it needs one number for each vertex", parameter="distance"
        )
    unknown = np.flatnonzero(np.isnan(values))
    if len(unknown):
        raise ParameterError(
            f"is NaN at vertex {unknown[0]}; write inf where no source reaches", parameter="distance"
        )
    return distances.distance_gradient(mesh, values)
