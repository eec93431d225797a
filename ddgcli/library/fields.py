"""Tangent vector fields: parallel transport, logarithmic map, integral curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics.distance import measure_distance
from ddgcli.algorithms.geodesics.distance_query import query_options
from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover, two_sided_cover
from ddgcli.algorithms.geodesics.query import CurveQuery, DistanceQuery
from ddgcli.algorithms.tangent_fields.curve_starts import random_starts, starts_at
from ddgcli.algorithms.tangent_fields.field_curves import field_curves
from ddgcli.algorithms.tangent_fields.geodesic_query import query_vectors
from ddgcli.algorithms.tangent_fields.vertex_vectors import VertexVectors, transport_vectors
from ddgcli.choices import LOG_MAP_METHODS
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.curves import curve_measurement
from ddgcli.library.distances import surface_sources
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["integral_curves", "logarithmic_map", "parallel_transport"]


@accepts_arrays("surface")
def parallel_transport(
    mesh: TriangleMesh, sources: int | Sequence[int] | NDArray, vectors: ArrayLike
) -> Measurement:
    """Tangent vectors everywhere, parallel to those at source vertices, by the vector heat method.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Orientable.
    sources : int or (k,) sequence of int
        Vertices.
    vectors : (3,) or (k, 3) array_like of float
        One vector at each source, in space; its normal part is dropped.

    Returns
    -------
    Measurement
        `vertex["transported_vector"]` (n, 3), in the unit of the vectors: parallel to the vector of the
        nearest source along the shortest path; `accuracy["transport_residual"]`, relative.

    Raises
    ------
    MeshError
        On a one-sided surface.
    ParameterError
        When there is not one vector per source, a vertex has different ones, or a vector has no tangent part.

    References
    ----------
    N. Sharp, Y. Soliman, K. Crane, "The vector heat method", 2019.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> moved = ddg.parallel_transport(ddg.grid(6, 6), 0, [2, 1, 0])
    >>> bool(abs(moved.vertex["transported_vector"] - [2, 1, 0]).max() < 1e-9)
    True
    """
    cover = two_sided_cover(mesh, "parallel transport")
    at = surface_sources(mesh, sources)
    moved = transport_vectors(cover.mesh, cover.lift_sources(at), np.atleast_2d(vectors))
    return _vertex_measurement(mesh, moved)


@accepts_arrays("surface")
def logarithmic_map(
    mesh: TriangleMesh, source: int, method: Literal["exact", "fast-marching", "heat"] = "exact"
) -> Measurement:
    """Logarithmic map: direction and distance of every vertex as seen from one.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Orientable.
    source : int
        Vertex.
    method : {'exact', 'fast-marching', 'heat'}
        Distance that the map follows; the map by 'heat' is the fastest and the least accurate.

    Returns
    -------
    Measurement
        `vertex["log_map"]` (n, 2): coordinates in the tangent plane of the source, in length units; the size
        is the distance, the angle that of the shortest path from the x axis, scaled by 2 pi / total angle at
        an inner vertex; inf where the source does not reach. `results["log_map_axis"]` is the x axis.
        `accuracy` holds `log_map_miss` (exact) or `log_map_skew` (fast marching, heat); `converged` is that
        of `measure_distance`.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    N. Sharp, Y. Soliman, K. Crane, "The vector heat method", 2019, section 8.2 (definition).

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(6, 6)
    >>> chart = ddg.logarithmic_map(square, 24).vertex["log_map"]
    >>> distance = ddg.geodesic_distance(square, 24)
    >>> bool(abs((chart**2).sum(axis=1) - distance**2).max() < 1e-12)
    True
    """
    if method not in LOG_MAP_METHODS:
        raise ParameterError(f"must be {', '.join(LOG_MAP_METHODS)}, not {method!r}", parameter="method")
    cover = two_sided_cover(mesh, "the logarithmic map")
    at = surface_sources(mesh, source, name="source")
    options = query_options(mesh, DistanceQuery(method=method), directions=True)
    distance = measure_distance(mesh, at, method, options)
    with renamed_parameters(sources="source"):
        vectors = query_vectors(cover, CurveQuery(log_map=True), at, distance)
    return _vertex_measurement(mesh, vectors, converged=distance.converged)


def _vertex_measurement(mesh: TriangleMesh, vectors: VertexVectors, *, converged: bool = True) -> Measurement:
    return Measurement(
        mesh,
        vertex=vectors.arrays,
        results=vectors.results,
        accuracy=vectors.accuracy,
        converged=converged,
    )


@accepts_arrays("surface")
def integral_curves(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    starts: Sequence[int] | NDArray | None = None,
    *,
    count: int = 16,
    duration: float | None = None,
    order: Literal[1, 2, 4] = 4,
    step: float | None = None,
    tolerance: float | None = None,
    seed: int = 0,
) -> Measurement:
    """Integral curves of a tangent vector field, by geodesic Runge-Kutta methods.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    vectors : (n, 3) or (m, 3) array_like of float
        On vertices or on faces, in length per time; normal parts are dropped.
    starts : sequence of int, optional
        Vertices; default `count` random points.
    count : int
        Number of random starts.
    duration : float, optional
        Time to integrate; default that of crossing the bounding box.
    order : {1, 2, 4}
    step : float, optional
        Fixed time step; by default steps adapt.
    tolerance : float, optional
        Error allowed in an adapted step, in length units; default a hundredth of the mean edge length
        of the component.
    seed : int
        Seed of the random starts.

    Returns
    -------
    Measurement
        As for `shortest_paths`; entries hold `time`, `stopped_because` and `error_estimate`;
        `accuracy["field_error_estimate"]` in length units.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    K. Polthier, M. Schmies, "Straightest geodesics on polyhedral surfaces", 1998.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(6, 6)
    >>> curve = ddg.integral_curves(square, [[1, 0, 0]] * square.n_faces, [24], duration=0.25)
    >>> curve.polylines[0][-1].round(6).tolist()
    [0.75, 0.5, 0.0]
    """
    cover = oriented_cover(mesh)
    values, place = cover.lift_values(np.atleast_1d(np.asarray(vectors, dtype=np.float64)))
    if count < 1:
        raise ParameterError(f"must be at least 1, not {count}", parameter="count")
    if starts is None:
        points = random_starts(cover.mesh, count, seed)
    else:
        at = surface_sources(mesh, starts, name="starts")
        points = starts_at(cover.mesh, cover.lift_sources(at))
    with renamed_parameters(values="vectors"):
        curves = field_curves(
            cover.mesh, values, points, duration, order=order, step=step, tolerance=tolerance, place=place
        )
    return curve_measurement(mesh, cover.project(curves))
