"""Mesh of some faces of another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh


def submesh(mesh: TriangleMesh, faces: NDArray) -> TriangleMesh:
    """Mesh of some faces, given by their corners in `mesh`, with the vertices of these faces only."""
    vertices, corners = np.unique(faces, return_inverse=True)
    return TriangleMesh.from_arrays(mesh.points[vertices], corners.reshape(-1, 3))
