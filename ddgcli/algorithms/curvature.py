"""Curvature of triangle surfaces: measures and pointwise values (chapters 1 to 3 of the notes)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.operators.laplacian import SurfaceMesh


def angle_defect(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) integrated Gaussian curvature: 2 pi - sum of angles inside, pi - sum on the boundary, in radians.

    Zero at vertices that no face uses. Chapter 1; sums to 2 pi times the Euler characteristic.
    """
    topology = mesh.topology
    total = np.bincount(
        mesh.faces.ravel(), weights=corner_angle(mesh.side_length).ravel(), minlength=mesh.n_vertices
    )
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    return np.where(topology.referenced_vertex, full - total, 0.0)
