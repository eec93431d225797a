"""Wavefronts: signed distance, distance matrices, Voronoi regions, the fan of geodesics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics.distance_matrix import distance_matrix as core_distance_matrix
from ddgcli.algorithms.geodesics.edge_sets import edge_set
from ddgcli.algorithms.geodesics.oriented_cover import two_sided_cover
from ddgcli.algorithms.geodesics.voronoi import vertex_types as core_vertex_types
from ddgcli.algorithms.geodesics.voronoi import voronoi_regions
from ddgcli.algorithms.tangent_fields.fan import geodesic_fan as core_geodesic_fan
from ddgcli.algorithms.tangent_fields.signed_distance import signed_distance as core_signed_distance
from ddgcli.library.curves import curve_measurement
from ddgcli.library.distances import surface_sources, vertex_indices
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["distance_matrix", "geodesic_fan", "geodesic_voronoi", "signed_distance", "vertex_types"]


@accepts_arrays("surface")
def signed_distance(mesh: TriangleMesh, curves: ArrayLike, method: str = "auto") -> NDArray[np.float64]:
    """Signed distance along the surface from every vertex to curves of edges.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    curves : (k, 2) array_like of int, or marks on edges, vertices or faces
        Vertex pairs, each an edge of the mesh, with the negative side on their left; or an array as for
        `--signed-distance`.
    method : {'auto', 'exact', 'heat'}
        'exact' needs curves that separate the surface; 'heat' bridges the gaps of broken ones; 'auto' is
        exact where it can be.

    Returns
    -------
    (n,) ndarray of float64
        In length units; negative on the left of the curves, inf where no curve reaches.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    N. Feng, K. Crane, "A heat method for generalized signed distance", 2024.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(2, 2)
    >>> rim = [[0, 3], [3, 6], [6, 7], [7, 8], [8, 5], [5, 2], [2, 1], [1, 0]]  # the square on its left
    >>> round(float(ddg.signed_distance(square, rim)[4]), 12)
    -0.5
    """
    edges = edge_set(mesh, np.asarray(curves), parameter="curves")
    return core_signed_distance(mesh, edges, method).distance


@accepts_arrays("surface")
def distance_matrix(
    mesh: TriangleMesh,
    sources: Sequence[int] | NDArray,
    targets: Sequence[int] | NDArray,
    method: str = "exact",
    *,
    jobs: int = 1,
) -> NDArray[np.float64]:
    """Distances along the surface between chosen vertices.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    sources, targets : sequence of int
        Vertices of the rows and of the columns.
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    jobs : int
        Number of processes; the result does not depend on it.

    Returns
    -------
    (s, t) ndarray of float64
        In length units; inf between different components.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(2, 2)
    >>> ddg.distance_matrix(square, [0, 4], [2, 6]).round(6).tolist()
    [[1.0, 1.0], [0.707107, 0.707107]]
    """
    return core_distance_matrix(
        mesh,
        np.array(vertex_indices(sources, "sources")),
        np.array(vertex_indices(targets, "targets")),
        method,
        jobs=jobs,
    )


@accepts_arrays("surface")
def geodesic_voronoi(mesh: TriangleMesh, sources: int | Sequence[int] | NDArray) -> NDArray[np.int64]:
    """Geodesic Voronoi regions: the source nearest to the centroid of each face, by the exact distance.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    sources : int or sequence of int
        Source vertices.

    Returns
    -------
    (m,) ndarray of int64
        Index of the source; -1 where none reaches.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> region = ddg.geodesic_voronoi(ddg.grid(4, 4), [0, 24])  # opposite corners
    >>> bool((region == 0).sum() == (region == 1).sum())
    True
    """
    return voronoi_regions(mesh, surface_sources(mesh, sources, None))


@accepts_arrays("surface")
def geodesic_fan(
    mesh: TriangleMesh,
    source: int,
    rays: int,
    length: float,
    circles: int = 8,
    *,
    source_point: ArrayLike | None = None,
) -> Measurement:
    """Exponential map of one point as a fan of straightest geodesics, with geodesic circles and caustics.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    source : int
        Source vertex; -1 for `source_point`.
    rays : int
        Number of rays in even directions, 3 or more.
    length : float
        Length of each ray, in length units; rays end at the boundary.
    circles : int
        Number of geodesic circles, at equally spaced radii.
    source_point : (3,) array_like of float, optional
        Start at the point of the surface nearest to this one.

    Returns
    -------
    Measurement
        `mesh` (CurveSet) and `polylines`: rays, circles (polygons through the points of equal length on
        neighbouring rays; several arcs where rays have ended), caustics (through the first points at which
        neighbouring rays cross). `vertex` holds `level` (length from the source) and `caustic` (1 beyond the
        caustic); `results["paths"]` one entry per curve.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    K. Polthier, M. Schmies, "Straightest geodesics on polyhedral surfaces", 1998.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> fan = ddg.geodesic_fan(ddg.icosphere(3), 0, 24, 2.0, circles=2)
    >>> sum(path["kind"] == "geodesic circle" for path in fan.results["paths"])
    2
    """
    vertices = [] if source_point is not None else [source]
    points = None if source_point is None else np.atleast_2d(np.asarray(source_point, dtype=np.float64))
    start = surface_sources(mesh, vertices, points, name="source")
    cover = two_sided_cover(mesh, "the fan")
    fan = core_geodesic_fan(cover.mesh, cover.lift_sources(start), rays, length, circles)
    return curve_measurement(mesh, cover.project(fan))


@accepts_arrays("surface", "intrinsic")
def vertex_types(mesh: SurfaceMesh) -> NDArray[np.int64]:
    """Type of each vertex by its total angle; no shortest path passes through a vertex below 2 pi.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair

    Returns
    -------
    (n,) ndarray of int64
        1 spherical (below 2 pi), 0 Euclidean, -1 hyperbolic; 2 on the boundary and without faces.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> bool((ddg.vertex_types(ddg.icosphere(1)) == 1).all())
    True
    """
    return core_vertex_types(mesh)
