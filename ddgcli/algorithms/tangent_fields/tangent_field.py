"""Tangent fields of arrays of vectors in space, constant on faces or linear in each face."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import to_face_frame
from ddgcli.mesh.fields import finite_values
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

# (face (k,), barycentric (k, 3)) -> (k, 2) vectors in the planar frames of the faces
TangentField = Callable[[NDArray, NDArray], NDArray]


def checked_field(mesh: TriangleMesh, values: NDArray, place: str = "") -> tuple[NDArray[np.float64], str]:
    """Check a field of vectors, and infer its place.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n, 3) or (m, 3) ndarray
    place : {'vertex', 'face', ''}
        Empty: by the number of vectors, vertices first.

    Returns
    -------
    values : (k, 3) ndarray of float64
    place : {'vertex', 'face'}

    Raises
    ------
    ParameterError
        For another shape or values that are not finite.
    """
    values = np.asarray(values, dtype=np.float64)
    shapes = {"vertex": (mesh.n_vertices, 3), "face": (mesh.n_faces, 3)}
    place = place or ("vertex" if values.shape == shapes["vertex"] else "face")
    if values.shape != shapes.get(place):
        raise ParameterError(
            f"the field has shape {values.shape}; give vectors on vertices ({mesh.n_vertices}, 3) "
            f"or on faces ({mesh.n_faces}, 3)",
            parameter="values",
        )
    return finite_values(values, place, parameter="values", what="the field"), place


def field_of_array(mesh: TriangleMesh, values: NDArray, place: str = "") -> TangentField:
    """Tangent field of an array of vectors in space, constant on faces or linear in each face.

    Vectors are projected to the plane of the face.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n, 3) or (m, 3) ndarray
    place : {'vertex', 'face', ''}
        Empty: by the number of vectors, vertices first.

    Returns
    -------
    callable
        Function of faces (k,) and barycentric coordinates (k, 3) to vectors (k, 2) in the frames of the
        faces.

    Raises
    ------
    ParameterError
        For another shape or values that are not finite.
    """
    values, place = checked_field(mesh, values, place)
    face = np.arange(mesh.n_faces)
    if place == "face":
        flat = to_face_frame(mesh, face, values)
        return lambda face, b: flat[face]
    corner = np.stack([to_face_frame(mesh, face, values[mesh.faces[:, k]]) for k in range(3)], axis=1)
    return lambda face, b: np.einsum("ij,ijk->ik", b, corner[face])


def default_duration(mesh: TriangleMesh, values: NDArray) -> float:
    """Time in which the root mean square speed of a field crosses the bounding box.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (k, 3) ndarray of float64
        Vectors of the field.

    Returns
    -------
    float

    Raises
    ------
    ParameterError
        When the field is zero everywhere.
    """
    speed = float(np.sqrt(np.mean(row_dot(values, values))))
    if not speed > 0:
        raise ParameterError(
            "the field is zero everywhere and has no integral curves; give another field", parameter="values"
        )
    points = mesh.points[mesh.topology.referenced_vertex]
    return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))) / speed
