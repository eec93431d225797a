"""Geodesic Voronoi regions of sources, and types of vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.geometry.surface_points import face_centroids
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.progress import ProgressCallback

EUCLIDEAN_VERTEX, SPHERICAL_VERTEX, HYPERBOLIC_VERTEX, BOUNDARY_VERTEX = (
    0,
    1,
    -1,
    2,
)  # values of `vertex_type`
FLAT_ANGLE_TOLERANCE = 1e-9  # radians from 2 pi


def voronoi_regions(
    mesh: SurfaceMesh, sources: Sources, *, progress: ProgressCallback | None = None
) -> NDArray[np.int64]:
    """Source nearest to the centroid of each face, by exact distance.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    progress : callable, optional
        Called with the number of final vertices and of all vertices.

    Returns
    -------
    (m,) ndarray of int64
        Index of the source; -1 where none reaches.
    """
    return exact_distance(mesh, sources, targets=face_centroids(mesh), progress=progress).target_source


def describe_regions(mesh: SurfaceMesh, region: NDArray, n_sources: int) -> list[dict[str, Any]]:
    """Number of faces and area of the region of each source.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    region : (m,) ndarray of int64
        As returned by `voronoi_regions`.
    n_sources : int

    Returns
    -------
    list of dict
        `faces`, and `area` in length^2.
    """
    faces = np.bincount(region[region >= 0], minlength=n_sources)
    area = sum_by_index(
        np.maximum(region, 0), np.where(region >= 0, face_area(mesh.side_length), 0.0), n_sources
    )
    return [{"faces": int(k), "area": float(a)} for k, a in zip(faces, area, strict=True)]


def vertex_types(mesh: SurfaceMesh) -> NDArray[np.int64]:
    """Type of each vertex by its total angle.

    A shortest path never passes a spherical vertex; through a hyperbolic one pass shortest paths that are not
    straightest.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of int64
        1 spherical (below 2 pi), 0 Euclidean, -1 hyperbolic; 2 on the boundary and without faces.
    """
    total = sum_by_index(mesh.faces.ravel(), corner_angle(mesh.side_length).ravel(), mesh.n_vertices)
    kind = np.where(total < 2 * np.pi - FLAT_ANGLE_TOLERANCE, SPHERICAL_VERTEX, EUCLIDEAN_VERTEX)
    kind[total > 2 * np.pi + FLAT_ANGLE_TOLERANCE] = HYPERBOLIC_VERTEX
    kind[mesh.topology.boundary_vertex | ~mesh.topology.referenced_vertex] = BOUNDARY_VERTEX
    return kind
