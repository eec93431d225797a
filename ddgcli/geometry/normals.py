"""Unit normals at vertices: means over the faces around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, unit_vectors


def sphere_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Unit normals at vertices, exact where a vertex and its neighbours lie on a sphere.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3) ndarray of float64
        Zero where undefined.

    References
    ----------
    N. Max, "Weights for computing vertex normals from facet normals", 1999.
    """
    scale = float(mesh.side_length.max(initial=0.0)) or 1.0
    # squares stay in the range of numbers
    unit = mesh.moved_unchecked((mesh.points - mesh.points[:1]) / scale)
    squared = unit.side_length**2
    weight = ratio(1.0, squared * squared[:, PREVIOUS])
    star = face_area_vector(unit)[:, None, :] * weight[:, :, None]
    return unit_vectors(sum_by_index(mesh.faces.ravel(), star.reshape(-1, 3), mesh.n_vertices))


def area_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Unit normals at vertices: means of those of the faces, weighted by area.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3) ndarray of float64
        Zero at vertices without faces, and where the mean is zero.

    Examples
    --------
    >>> square = TriangleMesh.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> area_normals(square)[0].tolist()
    [0.0, 0.0, 1.0]
    """
    star = np.repeat(face_area_vector(mesh), 3, axis=0)
    return unit_vectors(sum_by_index(mesh.faces.ravel(), star, mesh.n_vertices))
