"""Unit normals at vertices: means over the faces around them, as columns (3, n) and as rows (n, 3)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.faces import Faces
from ddgcli.mesh.topology import PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, ratio

# a sum shorter than this share of the longest is tested for cancellation; and the share of the sum of the
# absolute values of its terms below which it is rounding
MIN_TOTAL_SHARE, CANCELLATION_ROUNDING = 1e-9, 1e-12


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
    return np.ascontiguousarray(sphere_normal_columns(_scaled_faces(mesh)).T)


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
    return np.ascontiguousarray(area_normal_columns(_scaled_faces(mesh)).T)


def _scaled_faces(mesh: TriangleMesh) -> Faces:
    """Faces with sides of about one unit: their powers stay in the floating-point range."""
    longest = float(mesh.side_length.max(initial=0.0)) or 1.0
    return Faces.of(mesh, unit=math.ldexp(1.0, math.frexp(longest)[1]))  # a power of two rounds nothing


def sphere_normal_columns(faces: Faces) -> NDArray[np.float64]:
    """Unit normals as for `sphere_normals`, as columns.

    Parameters
    ----------
    faces : Faces
        With sides whose fourth powers are in the floating-point range.

    Returns
    -------
    (3, n) ndarray of float64
        Zero where undefined.

    Notes
    -----
    N. Max, "Weights for computing vertex normals from facet normals", 1999: each corner adds the cross
    product of its two sides divided by the squares of both lengths.
    """
    return _directions(faces.vertex_sums(_weighted_normals)[0], faces, _weighted_normals)


def _weighted_normals(faces: Faces) -> NDArray[np.float64]:
    """(3, 3, m) what each corner adds to the normal of its vertex, component first."""
    squared = faces.squared_length
    weight = np.stack([ratio(1.0, squared[k] * squared[PREVIOUS[k]]) for k in range(3)])
    return weight * faces.doubled[:, None, :]


def area_normal_columns(faces: Faces) -> NDArray[np.float64]:
    """Unit normals as for `area_normals`, as columns.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, n) ndarray of float64
        Zero where undefined.
    """
    return _directions(faces.doubled_star, faces, lambda block: block.on_corners)


def _directions(total: NDArray, faces: Faces, term: Callable[[Faces], NDArray]) -> NDArray[np.float64]:
    """Sums of corner values at unit length; zero where they cancel, as where two cones meet in their tips."""
    length = np.sqrt(dot(total, total))
    few = np.flatnonzero((length > 0) & (length < MIN_TOTAL_SHARE * length.max(initial=0.0)))
    if len(few):
        is_short = np.zeros(faces.n_vertices, dtype=bool)
        is_short[few] = True
        around = Faces(faces.corner[:, is_short[faces.corner].any(axis=0)], faces.points)
        (size,) = around.vertex_sums(lambda block: np.abs(term(block)))
        length[few[length[few] <= CANCELLATION_ROUNDING * size[:, few].max(axis=0)]] = 0.0
    return ratio(total, length)
