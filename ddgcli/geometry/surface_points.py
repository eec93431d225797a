"""Points on a surface by face and barycentric coordinates, and the nearest such point to a point in space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.frozen import FrozenArrays, frozen
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot

DISTANCE_ROUNDING = 1e-12  # of distances over the size of the mesh


@dataclass(frozen=True, eq=False)
class SurfacePoints(FrozenArrays):
    """Points on the faces of a mesh.

    Parameters
    ----------
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64
        Weights of the face's corners 0, 1, 2; non-negative, summing to 1.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "face", frozen(np.asarray(self.face, dtype=np.int64).reshape(-1)))
        weights = frozen(np.asarray(self.barycentric, dtype=np.float64).reshape(-1, 3))
        object.__setattr__(self, "barycentric", weights)

    def __len__(self) -> int:
        return len(self.face)

    @classmethod
    def none(cls) -> SurfacePoints:
        """No points."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))

    @classmethod
    def checked(cls, face: NDArray, barycentric: NDArray, n_faces: int) -> SurfacePoints:
        """Points with faces in range and weights that are non-negative and sum to 1 (to 1e-6; then rescaled).

        Raises
        ------
        ParameterError
            For the first point that is wrong.
        """
        points = cls(face, barycentric)
        outside = np.flatnonzero((points.face < 0) | (points.face >= n_faces))
        if len(outside):
            raise ParameterError(
                f"face {points.face[outside[0]]} is outside 0..{n_faces - 1}", parameter="face"
            )
        total = points.barycentric.sum(axis=1)
        bad = np.flatnonzero(~((points.barycentric >= -1e-12).all(axis=1) & (np.abs(total - 1) <= 1e-6)))
        if len(bad):
            raise ParameterError(
                f"coordinates {points.barycentric[bad[0]].tolist()} on face {points.face[bad[0]]} "
                "must be non-negative and sum to 1",
                parameter="barycentric",
            )
        weights = np.maximum(points.barycentric, 0.0)
        return cls(points.face, weights / weights.sum(axis=1, keepdims=True))

    def followed_by(self, other: SurfacePoints) -> SurfacePoints:
        """These points, then those of `other`."""
        return SurfacePoints(
            np.concatenate([self.face, other.face]), np.concatenate([self.barycentric, other.barycentric])
        )

    def positions(self, mesh: TriangleMesh) -> NDArray[np.float64]:
        """(k, 3) positions in space."""
        return interpolated(mesh.points, mesh.faces[self.face], self.barycentric)


def interpolated(values: NDArray, corners: NDArray, barycentric: NDArray) -> NDArray[np.float64]:
    """Vectors at points on faces, linear between those at the corners.

    Parameters
    ----------
    values : (n, d) ndarray of float64
        At the vertices.
    corners : (k, 3) ndarray of int64
        Vertices of the face of each point.
    barycentric : (k, 3) ndarray of float64

    Returns
    -------
    (k, d) ndarray of float64
    """
    return np.einsum("kc,kcd->kd", barycentric, values[corners])


def face_centroids(mesh: SurfaceMesh) -> SurfacePoints:
    """Centroid of each face.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    SurfacePoints
    """
    return SurfacePoints(np.arange(mesh.n_faces), np.full((mesh.n_faces, 3), 1 / 3))


def nearest_on_triangle(point: NDArray, corners: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Barycentric coordinates and distance of the nearest point of each triangle to `point`.

    Parameters
    ----------
    point : (3,) ndarray
    corners : (m, 3, 3) ndarray

    Returns
    -------
    barycentric : (m, 3) ndarray of float64
    distance : (m,) ndarray of float64

    Notes
    -----
    The nearest of the foot of the perpendicular (where it falls inside) and of the nearest points of the
    three sides; degenerate triangles are represented by their sides alone.
    """
    side = np.roll(corners, -1, axis=1) - corners
    offset = point - corners
    squared = row_dot(side, side)
    along = row_dot(offset, side)
    t = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0), 0.0, 1.0)
    gap = np.linalg.norm(offset - t[..., None] * side, axis=2)
    best = np.argmin(gap, axis=1)
    row = np.arange(len(corners))
    barycentric = np.zeros((len(corners), 3))
    barycentric[row, best] = 1 - t[row, best]
    barycentric[row, (best + 1) % 3] = t[row, best]
    distance = gap[row, best]
    normal = row_cross(side[:, 0], -side[:, 2])
    area2 = row_dot(normal, normal)
    inner = np.stack([row_dot(row_cross(side[:, j], offset[:, j]), normal) for j in (1, 2, 0)], axis=1)
    inside = (inner >= 0).all(axis=1) & (area2 > 0)
    barycentric[inside] = inner[inside] / inner[inside].sum(axis=1, keepdims=True)
    foot_point = np.einsum("mc,mcd->md", barycentric[inside], corners[inside])
    distance[inside] = np.linalg.norm(point - foot_point, axis=1)
    return barycentric, distance


def nearest_points(mesh: TriangleMesh, positions: NDArray) -> tuple[SurfacePoints, NDArray[np.float64]]:
    """The point of the surface nearest to each position in space.

    Parameters
    ----------
    mesh : TriangleMesh
    positions : (k, 3) ndarray

    Returns
    -------
    points : SurfacePoints
        The one with the lowest index among several nearest faces.
    distance : (k,) ndarray of float64
        From each position to its point.

    Raises
    ------
    MeshError
        When the mesh has no faces.
    """
    positions = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
    if len(positions) == 0:
        return SurfacePoints.none(), np.zeros(0)
    if mesh.n_faces == 0:
        raise MeshError("no triangles; a surface point needs a surface")
    search = _search(mesh)
    faces, weights, distances = zip(*(search(position) for position in positions), strict=True)
    return SurfacePoints(np.array(faces), np.array(weights)), np.array(distances)


def _search(mesh: TriangleMesh) -> Callable[[NDArray], tuple[int, NDArray, float]]:
    """Function that finds the face nearest to a position, its point's coordinates (3,), and the distance.

    It computes the distances of those faces alone that may be nearer than the nearest vertex.
    """
    used = mesh.topology.referenced_vertex
    points, corner = mesh.points[used], (np.cumsum(used) - 1)[mesh.faces.T]
    extent = mesh.side_length.max(axis=1)  # at least the distance of any point of a face from a corner

    def nearest(position: NDArray) -> tuple[int, NDArray, float]:
        relative = points - position
        size = float(np.abs(relative).max()) or 1.0  # squares of lengths neither overflow nor underflow
        relative /= size
        apart = np.sqrt(row_dot(relative, relative))
        gap = np.minimum(np.minimum(apart[corner[0]], apart[corner[1]]), apart[corner[2]])
        near = np.flatnonzero(gap - extent / size <= apart.min() + DISTANCE_ROUNDING)
        barycentric, distance = nearest_on_triangle(np.zeros(3), relative[corner[:, near].T])
        best = int(np.argmin(distance))
        return int(near[best]), barycentric[best], distance[best] * size

    return nearest


def largest_distance(mesh: TriangleMesh, positions: NDArray) -> float:
    """The largest distance of positions in space from their nearest points of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
        With faces.
    positions : (k, 3) ndarray

    Returns
    -------
    float
        0 without positions.
    """
    from scipy.spatial import cKDTree

    # to the nearest vertex
    bound = cKDTree(mesh.points[mesh.topology.referenced_vertex]).query(positions)[0]
    search, largest = _search(mesh), 0.0
    for k in np.argsort(-bound, kind="stable"):
        if not bound[k] > largest:
            break
        largest = max(largest, float(search(positions[k])[2]))
    return largest
