"""Curves on surfaces: level lines, shortest, straightened and straightest paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics.darboux import add_darboux_frames
from ddgcli.algorithms.geodesics.distance import measure_distance
from ddgcli.algorithms.geodesics.distance_query import level_lines
from ddgcli.algorithms.geodesics.edge_curves import edge_curves
from ddgcli.algorithms.geodesics.flipout import straighten_curves
from ddgcli.algorithms.geodesics.oriented_cover import OrientedCover, oriented_cover, two_sided_cover
from ddgcli.algorithms.geodesics.path_results import curve_set
from ddgcli.algorithms.geodesics.surface_curves import Curves, add_geodesic_curvature, trace_curves
from ddgcli.algorithms.tangent_fields.field_curves import add_transport
from ddgcli.algorithms.tangent_fields.geodesic_query import paths_to_vertices
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.library.distances import surface_sources, vertex_indices
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["edge_paths", "isolines", "shortest_paths", "straighten_paths", "trace"]


@accepts_arrays("surface")
def isolines(mesh: TriangleMesh, values: ArrayLike, count: int = 10) -> Measurement:
    """Level lines of a function on vertices at evenly spaced levels.

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
        `results["paths"]` one entry per line (`length`, `closed`, ...).

    Raises
    ------
    ParameterError
        When there is not one value per vertex, or `count` is less than 1.

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
        raise ParameterError(
            f"has shape {function.shape}; it needs one number for each vertex", parameter="values"
        )
    if count < 1:
        raise ParameterError(f"must be at least 1, not {count}", parameter="count")
    return curve_measurement(mesh, level_lines(mesh, function, count))


@accepts_arrays("surface")
def shortest_paths(
    mesh: TriangleMesh,
    sources: int | Sequence[int] | NDArray,
    targets: int | Sequence[int] | NDArray,
    *,
    source_points: ArrayLike | None = None,
    transport: bool = False,
    darboux: bool = False,
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
    darboux : bool
        Also Darboux frames: `darboux_tangent`, `darboux_normal`, `darboux_conormal`, `normal_curvature`,
        `geodesic_torsion`.

    Returns
    -------
    Measurement
        `mesh` (CurveSet) and `polylines`, from source to target; `vertex` holds `path_id`, `face`,
        `barycentric`; `results["paths"]` has one entry per path (`length`, `source`, `target`, angles at
        vertices); `accuracy["path_length_residual"]`, relative. A target that no source reaches has no points
        and the length None.

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
    cover, checked = oriented_cover(mesh), surface_sources(mesh, sources, source_points)
    if len(checked.points):
        cover.require_two_sides("a path from points inside faces")
    distance = measure_distance(mesh, checked)
    curves = paths_to_vertices(cover, checked, distance, vertex_indices(targets, "targets"))
    measured = _with_frames(cover, curves, transport, darboux)
    return replace(measured, converged=measured.converged and distance.converged)


@accepts_arrays("surface")
def straighten_paths(
    mesh: TriangleMesh,
    paths: Sequence[Sequence[int]],
    *,
    closed: bool = False,
    transport: bool = False,
    darboux: bool = False,
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
    darboux : bool
        Also Darboux frames: `darboux_tangent`, `darboux_normal`, `darboux_conormal`, `normal_curvature`,
        `geodesic_torsion`.

    Returns
    -------
    Measurement
        As for `shortest_paths`; `accuracy["path_angle_deficit"]` is how far an angle beside a curve falls
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
    cover = two_sided_cover(mesh, "straightening")
    waypoints = [vertex_indices(path, "paths") for path in paths]
    with renamed_parameters(waypoints="paths"):
        curves = straighten_curves(cover.mesh, waypoints, [closed] * len(waypoints))
    return _with_frames(cover, curves, transport, darboux)


@accepts_arrays("surface")
def edge_paths(
    mesh: TriangleMesh, paths: Sequence[Sequence[int]], *, transport: bool = False, darboux: bool = False
) -> Measurement:
    """Edge paths through vertices as they are, with their geodesic curvature.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Orientable.
    paths : sequence of sequence of int
        Vertices, joined by shortest edge paths where they are not neighbours; a path whose last vertex is
        its first is closed.
    transport : bool
        Also carry a tangent frame along each path, and the `holonomy` of loops.
    darboux : bool
        Also Darboux frames, as for `shortest_paths`.

    Returns
    -------
    Measurement
        As for `shortest_paths`; `vertex` also holds `geodesic_curvature` (radians, integrated at points),
        entries `total_geodesic_curvature`.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(4, 4)
    >>> turn = ddg.edge_paths(square, [[0, 4, 24]]).results["paths"][0]["total_geodesic_curvature"]
    >>> round(abs(turn) / 3.141593, 6)  # a right angle
    0.5
    """
    cover = two_sided_cover(mesh, "an edge path")
    waypoints = [vertex_indices(path, "paths") for path in paths]
    with renamed_parameters(waypoints="paths"):
        curves = edge_curves(cover.mesh, waypoints)
    return _with_frames(cover, add_geodesic_curvature(cover.mesh, curves), transport, darboux)


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
    darboux: bool = False,
) -> Measurement:
    """Straightest geodesics from points of faces: the exponential map.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    face : int or (k,) array_like of int
    barycentric : (3,) or (k, 3) array_like of float
        Start points in the faces.
    direction : (3,) or (k, 3) array_like of float
        In space; projected to the plane of the face. Its length does not matter.
    length : float or (k,) array_like of float
        In length units.
    at_boundary : {'stop', 'reflect'}
    transport : bool
        Also carry a tangent frame along each line.
    darboux : bool
        Also Darboux frames: `darboux_tangent`, `darboux_normal`, `darboux_conormal`, `normal_curvature`,
        `geodesic_torsion`.

    Returns
    -------
    Measurement
        As for `shortest_paths`; entries hold `status` ('reached', 'boundary' or 'gave up') and
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
    if np.size(face) and np.asarray(face).dtype.kind not in "iu":
        raise ParameterError("must be whole numbers, such as 0 or [0, 5]", parameter="face")
    rows = _vectors(barycentric, "barycentric"), _vectors(direction, "direction")
    if np.asarray(length).dtype.kind == "b":
        raise ParameterError("must be a number, not True or False", parameter="length")
    try:
        faces, lengths, weights, vectors = _broadcast(face, length, *rows)
    except (TypeError, ValueError) as error:
        raise ParameterError(
            f"face, length, barycentric and direction do not fit together: {error}", parameter="face"
        ) from error
    cover = oriented_cover(mesh)
    points = SurfacePoints.checked(faces, weights, mesh.n_faces)
    start = cover.lift_points(points)
    curves = trace_curves(
        cover.mesh, start.face, start.barycentric, vectors, lengths, at_boundary=at_boundary
    )
    return _with_frames(cover, curves, transport, darboux)


def _vectors(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Vectors of a parameter as (k, 3)."""
    array = np.asarray(values)
    if array.dtype.kind == "b" or array.ndim not in (1, 2) or array.shape[-1] != 3:
        what = "True or False" if array.dtype.kind == "b" else f"those of shape {array.shape}"
        raise ParameterError(f"must be numbers of shape (3,) or (k, 3), not {what}", parameter=name)
    return np.atleast_2d(array.astype(np.float64))


def _broadcast(face: ArrayLike, length: ArrayLike, *rows: NDArray) -> tuple[NDArray, ...]:
    """Broadcast scalars to (k,) and vectors to (k, 3)."""
    numbers = np.asarray(face), np.asarray(length, dtype=np.float64)
    (k,) = np.broadcast_shapes(*(a.shape for a in numbers), *(a.shape[:1] for a in rows), (1,))
    return *(np.broadcast_to(a, (k,)) for a in numbers), *(np.broadcast_to(a, (k, 3)) for a in rows)


def _with_frames(cover: OrientedCover, curves: Curves, transport: bool, darboux: bool) -> Measurement:
    """Curves of the cover as a measurement of the base, with frames where required."""
    if darboux:
        cover.require_two_sides("a Darboux frame")
        curves = add_darboux_frames(cover.mesh, curves)
    if transport:
        curves = add_transport(cover.mesh, curves)
    return curve_measurement(cover.base, cover.project(curves))


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
