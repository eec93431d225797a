"""Tangent vectors at vertices: frames, parallel transport along edges, the connection Laplacian.

A tangent vector at a vertex is a complex number: its angle is counted counter-clockwise from the first side
of the vertex's fan, surface angles at interior vertices being multiplied by 2 pi / total angle (on the
boundary they are kept). Everything comes from lengths alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import corner_cotan
from ddgcli.geometry.normals import area_normals
from ddgcli.geometry.unfolding import Fans, vertex_fans
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, tangential, unit_vectors


def angle_scale(fans: Fans) -> NDArray[np.float64]:
    """Factor from surface angles around a vertex to angles in its tangent plane.

    Parameters
    ----------
    fans : Fans

    Returns
    -------
    (c,) ndarray of float64
        2 pi / total angle of closed fans, 1 of open ones.
    """
    total = np.where(fans.total_angle > 0, fans.total_angle, 1.0)
    return np.where(fans.is_open, 1.0, 2 * np.pi / total)


def check_tangent_planes(mesh: SurfaceMesh) -> Fans:
    """Fans of a mesh each of whose vertices has a unique tangent plane.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    Fans

    Raises
    ------
    MeshError
        At vertices that join several fans of faces.
    """
    fans = vertex_fans(mesh)
    count = np.bincount(fans.vertex, minlength=mesh.n_vertices)
    if count.max(initial=0) > 1:
        raise MeshError(
            f"vertex {int(np.argmax(count))} joins {count.max()} fans of faces and has no tangent plane; "
            f"{remedy('several fans', mesh.topology)}"
        )
    return fans


def side_angles(mesh: SurfaceMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions of sides in the tangent planes of both their ends.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    at_tail, at_head : (3m,) ndarray of float64
        Angle of side 3f+j as it leaves its tail, and of the way back as it leaves its head.

    Raises
    ------
    MeshError
        At vertices that join several fans of faces, which have no unique tangent plane.
    """
    fans = check_tangent_planes(mesh)
    scale = angle_scale(fans)[fans.fan]
    at_tail = fans.angle_before * scale
    corner = (3 * np.arange(mesh.n_faces)[:, None] + NEXT).ravel()
    at_head = (fans.angle_before[corner] + fans.corner_angle[corner]) * scale[corner]
    return at_tail, at_head


def edge_transport(mesh: SurfaceMesh) -> NDArray[np.complex128]:
    """(3m,) unit number r that transports a vector along side 3f+j: v_head = r v_tail."""
    at_tail, at_head = side_angles(mesh)
    return np.exp(1j * (at_head + np.pi - at_tail))


def connection_laplacian(mesh: SurfaceMesh) -> csr_array:
    """Connection Laplacian of tangent vectors at vertices: cotangent weights, transport along edges.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, one fan of faces at each vertex.

    Returns
    -------
    (n, n) csr_array of complex128
        Hermitian, for complex tangent vectors in the vertices' frames. Positive semidefinite where the
        cotangent weights are not negative; on a flat surface equal to the scalar stiffness up to the choice
        of frames.

    Raises
    ------
    MeshError
        At vertices that join several fans of faces.

    References
    ----------
    F. Knöppel, K. Crane, U. Pinkall, P. Schröder, "Globally optimal direction fields", 2013.
    N. Sharp, Y. Soliman, K. Crane, "The vector heat method", 2019.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> L = ddg.connection_laplacian(ddg.icosphere(1))
    >>> bool(abs(L - L.conj().T).max() < 1e-12)
    True
    """
    weight = 0.5 * corner_cotan(mesh.side_length)[:, [2, 0, 1]].ravel()
    transport = weight * edge_transport(mesh)
    n = mesh.n_vertices
    i, j = (
        matrix_indices(ends, n, 4 * len(weight))
        for ends in (mesh.topology.side_tail, mesh.topology.side_head)
    )
    rows, cols = np.concatenate([j, i, i, j]), np.concatenate([i, j, i, j])
    values = np.concatenate([-transport, -transport.conj(), weight, weight])
    return coo_array((values, (rows, cols)), shape=(n, n)).tocsr()


def vertex_axes(mesh: TriangleMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axes in space of the tangent frames of the vertices.

    They span the plane orthogonal to the vertex normal (the area-weighted mean of the face normals), rotated
    so that the projected sides have their intrinsic angles in the mean over the sides.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented.

    Returns
    -------
    x, y : (n, 3) ndarray of float64
        Unit vectors; zero at vertices without faces.

    Raises
    ------
    MeshError
        At vertices that join several fans of faces.
    """
    fans = vertex_fans(mesh)
    normal = area_normals(mesh)
    side = mesh.side_vector.reshape(-1, 3)
    first = np.zeros((mesh.n_vertices, 3))
    first[fans.vertex] = side[fans.corner[fans.start[:-1]]]
    x = unit_vectors(tangential(first, normal))
    y = row_cross(normal, x)
    last = mesh.topology.side_twin.ravel() < 0  # sides that end an open fan leave their head only
    at_tail, at_head = side_angles(mesh)
    vertex = np.concatenate([mesh.topology.side_tail, mesh.topology.side_head[last]])
    side, angle = np.concatenate([side, -side[last]]), np.concatenate([at_tail, at_head[last]])
    projected = row_dot(side, x[vertex]) + 1j * row_dot(side, y[vertex])
    size = np.abs(projected)
    turn = projected * np.exp(-1j * angle) / np.where(size > 0, size, 1.0)
    mean = sum_by_index(vertex, turn, mesh.n_vertices)
    mean /= np.where(np.abs(mean) > 0, np.abs(mean), 1.0)
    x, y = mean.real[:, None] * x + mean.imag[:, None] * y, mean.real[:, None] * y - mean.imag[:, None] * x
    return x, y


def to_vertex_frames(mesh: TriangleMesh, vector: NDArray) -> NDArray[np.complex128]:
    """Complex tangent vectors at vertices from vectors in space, projected to the tangent planes.

    Parameters
    ----------
    mesh : TriangleMesh
    vector : (n, 3) ndarray of float64

    Returns
    -------
    (n,) ndarray of complex128
        In the unit of the vectors.
    """
    x, y = vertex_axes(mesh)
    return row_dot(vector, x) + 1j * row_dot(vector, y)


def from_vertex_frames(mesh: TriangleMesh, vector: NDArray) -> NDArray[np.float64]:
    """Vectors in space from complex tangent vectors at vertices.

    Parameters
    ----------
    mesh : TriangleMesh
    vector : (n,) ndarray of complex128

    Returns
    -------
    (n, 3) ndarray of float64
        In the unit of the vectors.
    """
    x, y = vertex_axes(mesh)
    return vector.real[:, None] * x + vector.imag[:, None] * y
