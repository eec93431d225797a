"""Planes between the viewer and a surface, which would hide it: a picture has their outlines instead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.plane import plane_normal
from ddgcli.mesh.triangle_mesh import TriangleMesh

EDGE_ON = 1e-3  # cosine between a plane's normal and the view: a plane seen along itself hides nothing


def hides(plane: TriangleMesh, points: NDArray, toward_viewer: NDArray) -> bool:
    """Whether a mesh is flat, and points lie on the side of it that the viewer does not see.

    Parameters
    ----------
    plane : TriangleMesh
    points : (n, 3) ndarray of float64
    toward_viewer : (3,) ndarray of float64
        Unit vector.

    Returns
    -------
    bool
    """
    normal = plane_normal(plane.points)
    if normal is None or abs(normal @ toward_viewer) < EDGE_ON:
        return False
    height = np.mean((points - plane.points[0]) @ normal)
    return bool(height * (normal @ toward_viewer) < 0.0)


def boundary_edges(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Ends of the edges of one face.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (k, 2, 3) ndarray of float64
    """
    topology = mesh.topology
    return np.asarray(mesh.points[topology.edges[topology.boundary_edges]])
