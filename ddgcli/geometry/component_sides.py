"""Mean side lengths and extents of the components of a mesh: a unit of length for each component."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def component_mean_side(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Mean side length of each component.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n_components,) ndarray of float64
        In length units. Where its square is zero or not finite (coincident vertices) the mean over all sides.
    """
    topology, length = mesh.topology, mesh.side_length
    overall = length.mean() if len(length) else 1.0
    if topology.n_components < 2:  # the sum in the order of `mean`, to the last bit
        return np.full(topology.n_components, overall)
    component, n = topology.face_component, topology.n_components
    mean = np.bincount(component, length.mean(axis=1), n) / np.bincount(component, minlength=n)
    with np.errstate(over="ignore"):
        square = mean * mean
    return np.where((square > 0) & np.isfinite(square), mean, overall)


def on_vertices(mesh: SurfaceMesh, values: NDArray) -> NDArray[np.float64]:
    """Values of components on their vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    values : (n_components,) ndarray of float64

    Returns
    -------
    (n,) ndarray of float64
        1 at vertices of no face.
    """
    return np.append(values, 1.0).take(mesh.topology.vertex_component)


def component_extents(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Largest extent of each component along an axis.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (c,) ndarray of float64
    """
    topology = mesh.topology
    vertices = np.flatnonzero(topology.referenced_vertex)
    piece, n = topology.vertex_component[vertices], topology.n_components
    extent = np.zeros(n)
    for coordinate in mesh.points[vertices].T:
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(low, piece, coordinate)
        np.maximum.at(high, piece, coordinate)
        np.maximum(extent, high - low, out=extent)
    return extent
