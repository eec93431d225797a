"""Edge paths as curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ddgcli.algorithms.geodesics.flippable_mesh import EdgeGraph, edge_path
from ddgcli.algorithms.geodesics.path_results import describe_paths
from ddgcli.algorithms.geodesics.paths import SurfacePaths
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT


def edge_curves(mesh: SurfaceMesh, waypoints: list[list[int]]) -> Curves:
    """Edge paths through vertices, completed by shortest edge paths between vertices that are not neighbours.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    waypoints : list of list of int
        A path is closed if its last vertex is its first.

    Returns
    -------
    Curves
    """
    graph = EdgeGraph(mesh)
    edge_paths: list[SurfacePaths] = []
    kinds: list[dict[str, Any]] = []
    for stops in waypoints:
        closed = len(stops) > 2 and stops[0] == stops[-1]
        edge_paths.append(_along_edges(mesh, edge_path(graph, stops, False), closed))
        kinds.append({"kind": "edge path", "way_points": list(stops)})
    paths = SurfacePaths.concatenate(edge_paths)
    return Curves(paths, describe_paths(mesh, paths, kinds))


def _along_edges(mesh: SurfaceMesh, halfedges: list[int], closed: bool) -> SurfacePaths:
    """Path through the corners at the tails of halfedges; halfedges outside the boundary run against its
    sides."""
    rim = np.flatnonzero(mesh.topology.side_twin.ravel() < 0)
    h = np.array(halfedges)
    outside = h >= 3 * mesh.n_faces
    side = np.where(outside, rim[(h - 3 * mesh.n_faces) * outside] if len(rim) else 0, h)
    face, j = np.divmod(side, 3)
    start, end = np.where(outside, NEXT[j], j), np.where(outside, j, NEXT[j])
    if not closed:
        face, start = np.append(face, face[-1]), np.append(start, end[-1])
    return SurfacePaths(face, np.eye(3)[start], np.array([0, len(face)]), np.array([closed]))
