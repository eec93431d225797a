"""Directions in the planar frames of faces, and their conversion to and from space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import interpolated
from ddgcli.geometry.unfolding import Unfolding, corner_position
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, unit_vectors


def face_axes(mesh: TriangleMesh, face: NDArray) -> tuple[NDArray, NDArray]:
    """Axes in space of the planar frames of faces: x along side 0, y towards corner 2.

    Parameters
    ----------
    mesh : TriangleMesh
    face : (k,) ndarray of int64

    Returns
    -------
    x, y : (k, 3) ndarray of float64
        Unit vectors, orthogonal; y is zero where a face has no area, x where its side 0 has no length.
    """
    scale = float(mesh.side_length.max(initial=0.0)) or 1.0
    side, back = mesh.side_vector[face, 0] / scale, mesh.side_vector[face, 2] / -scale
    x = unit_vectors(side)
    return x, row_cross(unit_vectors(row_cross(x, back)), x)


def to_face_frame(mesh: SurfaceMesh, face: NDArray, vector: NDArray) -> NDArray[np.float64]:
    """Components of vectors in space in the planar frames of faces.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    face : (k,) ndarray of int64
    vector : (k, 3) ndarray of float64

    Returns
    -------
    (k, 2) ndarray of float64
        In the unit of the vectors, without their normal component.

    Raises
    ------
    ParameterError
        When the mesh has no positions.
    """
    if not isinstance(mesh, TriangleMesh):
        raise ParameterError(
            "a mesh without positions has no directions in space; use 2 numbers in the frame of the face",
            parameter="vector",
        )
    x, y = face_axes(mesh, face)
    return np.stack([row_dot(vector, x), row_dot(vector, y)], axis=1)


def to_space(mesh: TriangleMesh, face: NDArray, planar: NDArray) -> NDArray[np.float64]:
    """Vectors in space from their components in the planar frames of faces.

    Parameters
    ----------
    mesh : TriangleMesh
    face : (k,) ndarray of int64
    planar : (k, 2) ndarray of float64

    Returns
    -------
    (k, 3) ndarray of float64
        In the unit of the components.
    """
    x, y = face_axes(mesh, face)
    return planar[:, :1] * x + planar[:, 1:] * y


def surface_position(mesh: SurfaceMesh, face: NDArray, barycentric: NDArray) -> NDArray[np.float64]:
    """Positions in space of points on faces.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64
        Weights of the corners, which sum to 1.

    Returns
    -------
    (k, 3) ndarray of float64

    Raises
    ------
    ParameterError
        When the mesh has no positions.
    """
    return interpolated(_positions(mesh), mesh.faces[face], barycentric)


def relative_position(mesh: SurfaceMesh, face: NDArray, barycentric: NDArray) -> NDArray[np.float64]:
    """Positions of points on faces from the first corner of the mesh, for differences of positions.

    Far from the origin the rounding of positions exceeds the differences of close points.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64

    Returns
    -------
    (k, 3) ndarray of float64

    Raises
    ------
    ParameterError
        When the mesh has no positions.
    """
    points = _positions(mesh)
    corners = points[mesh.faces[face]] - points[mesh.faces[:1, 0]]
    return np.einsum("ij,ijk->ik", barycentric, corners)


def _positions(mesh: SurfaceMesh) -> NDArray[np.float64]:
    if mesh.points is None:
        raise ParameterError("the mesh has no positions")
    return mesh.points


def planar_difference(
    unfolding: Unfolding, face: NDArray, tail: NDArray, head: NDArray
) -> NDArray[np.float64]:
    """Vectors from one point of a face to another, in the planar frame of the face.

    Parameters
    ----------
    unfolding : Unfolding
    face : (k,) ndarray of int64
    tail, head : (k, 3) ndarray of float64
        Barycentric coordinates of both points.

    Returns
    -------
    (k, 2) ndarray of float64
        In the length unit of the mesh.
    """
    return np.einsum("ij,ijk->ik", head - tail, corner_position(unfolding, face))
