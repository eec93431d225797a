"""Exact distances from points inside faces to the vertices near them, where fast marching starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.sources import Sources, no_indices
from ddgcli.errors import SolveError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.ragged import group_by_key, ranges, unique_keys
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

RINGS = 2  # of faces around the face of a point; with one, a hundredth of random points of a disk is inexact
MAX_POINTS = 1000  # more start at the corners of their faces
# of the faces around all points, besides those of the mesh; with more, of many points near a vertex of many
# faces, all start at the corners too
MAX_CORNERS = 200_000


def near_distances(mesh: SurfaceMesh, points: SurfacePoints) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices of two rings of faces around each point, and their distances within these faces.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    points : SurfacePoints

    Returns
    -------
    vertex : (k,) ndarray of int64
    distance : (k,) ndarray of float64
        Of paths on the surface: exact where the shortest one stays in these faces, otherwise longer; inf
        where rounding on faces without area hides all of them.
    point : (k,) ndarray of int64
        Index of the point.

    Notes
    -----
    Nothing for Delta-complexes, whose vertices do not identify their corners, and for more than
    `MAX_POINTS` points or `MAX_CORNERS` corners more than the mesh has.
    """
    from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance

    nothing = no_indices(), np.zeros(0), no_indices()
    if not 0 < len(points) <= MAX_POINTS or mesh.topology.gluing is not None:
        return nothing
    pairs = _faces_around(mesh, points.face)
    if pairs is None:
        return nothing
    point, face = pairs
    copies, faces = np.unique(point[:, None] * mesh.n_vertices + mesh.faces[face], return_inverse=True)
    index, vertex = np.divmod(copies, mesh.n_vertices)
    apart = _copies(mesh, vertex, face, faces.reshape(-1, 3))
    start = np.searchsorted(point * mesh.n_faces + face, np.arange(len(points)) * mesh.n_faces + points.face)
    sources = Sources.at([], SurfacePoints(start, points.barycentric))
    try:
        # a limit, so that vertices that rounding hides stay unreached, without a warning
        distance = exact_distance(apart, sources, limit=float(np.finfo(float).max)).distance
    except SolveError:  # windows without end on faces without area
        return nothing
    return vertex, distance, index


def _faces_around(mesh: SurfaceMesh, face: NDArray) -> tuple[NDArray, NDArray] | None:
    """Pairs (point, face): faces of the rings around the face of each point, sorted; None for too many."""
    n, m = mesh.n_vertices, mesh.n_faces
    start, around = group_by_key(mesh.faces.ravel(), np.repeat(np.arange(m), 3), n)
    point = np.arange(len(face))
    for _ in range(RINGS):
        # each vertex once: its many faces would list it, and then themselves, as many times
        point, vertex = np.divmod(unique_keys((point[:, None] * n + mesh.faces[face]).ravel()), n)
        count = start[vertex + 1] - start[vertex]
        if count.sum() > MAX_CORNERS + 3 * m:
            return None
        point, face = np.divmod(
            unique_keys(np.repeat(point, count) * m + around[ranges(start[vertex], count)[0]]), m
        )
    return point, face


def _copies(mesh: SurfaceMesh, vertex: NDArray, face: NDArray, corners: NDArray) -> SurfaceMesh:
    """Mesh of copies of faces, apart from each other, with copies of these vertices as corners."""
    topology = Topology(corners, len(vertex))
    if isinstance(mesh, TriangleMesh):
        return TriangleMesh(mesh.points[vertex], topology)
    return IntrinsicMesh(topology, mesh.side_length[face])
