"""A triangle surface in space: positions over a topology, immutable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError, counted
from ddgcli.mesh.frozen import FrozenArrays, frozen
from ddgcli.mesh.masked import indices, unmasked
from ddgcli.mesh.topology import NEXT, Topology, check_faces
from ddgcli.mesh.vectors import bounding_box, cross, dot, vector_length

FLAT_AREA_TOLERANCE = 1e-12  # twice the area of a flat face, over its longest side squared
MAX_COORDINATE = 1e300  # sums of lengths do not overflow
BLOCK_SIZE = 1 << 14  # faces at a time, so that temporaries stay in cache


def check_points(points: NDArray) -> NDArray[np.float64]:
    """Convert positions to the form that a mesh stores, or raise an error for the first bad one.

    Parameters
    ----------
    points : (n, 3) or (n, 2) ndarray
        Points of a plane get z = 0.

    Returns
    -------
    (n, 3) ndarray of float64

    Raises
    ------
    MeshError
        For another shape, numbers that are not real, or a coordinate that is not finite or above
        `MAX_COORDINATE`.
    """
    if np.asarray(points).dtype.kind not in "biufO":  # numpy would drop imaginary parts
        raise MeshError(f"points must be real numbers, not {np.asarray(points).dtype}")
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise MeshError(f"points must have shape (n, 3), not {points.shape}")
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    if len(points) == 0 or (points.min() >= -MAX_COORDINATE and points.max() <= MAX_COORDINATE):
        return points  # NaN compares False
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        count = counted(len(bad), "such vertex", "such vertices")
        raise MeshError(f"vertex {bad[0]} is not finite ({count}); correct its coordinates")
    bad = np.flatnonzero((np.abs(points) > MAX_COORDINATE).any(axis=1))
    count = counted(len(bad), "such vertex", "such vertices")
    raise MeshError(
        f"vertex {bad[0]} has a coordinate above {MAX_COORDINATE:g} ({count}), and "
        "lengths leave the floating-point range; rescale the coordinates"
    )


def own_points(points: ArrayLike) -> NDArray[np.float64]:
    """Convert positions as `check_points` does, to an array of their own: a mesh makes its points read-only.

    Parameters
    ----------
    points : (n, 3) or (n, 2) array_like

    Returns
    -------
    (n, 3) ndarray of float64
        Shares no memory with the argument.
    """
    array = unmasked(points, "the array of points")
    checked = check_points(array)
    return checked.copy() if np.may_share_memory(checked, array) else checked


class PointMesh(FrozenArrays):
    """Base of meshes with positions of vertices."""

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        raise NotImplementedError

    def moved(self, points: ArrayLike) -> Self:
        """The same connectivity at other positions, without arrays.

        Parameters
        ----------
        points : (n, 2) or (n, 3) array_like of float
            One point for each vertex; copied.

        Returns
        -------
        mesh of the same class

        Raises
        ------
        MeshError
            On a wrong shape, or a point that is not finite.
        """
        own = own_points(points)
        if len(own) != self.n_vertices:
            raise MeshError(
                f"points must have shape ({self.n_vertices}, 3), one for each vertex, not {own.shape}"
            )
        return self.moved_unchecked(own)

    def moved_unchecked(self, points: NDArray) -> Self:
        """`moved` without checks and without a copy: the array becomes read-only."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class TriangleMesh(PointMesh):
    """Triangle mesh in space.

    `from_arrays` checks its arguments; the constructor does not.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        Vertex positions, in the input's length unit; read-only.
    topology : Topology
        Faces, edges and what follows from them; shared, not copied, by every mesh that `moved` returns.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.TriangleMesh.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> mesh.n_vertices, mesh.n_faces, mesh.topology.n_edges, mesh.topology.euler_characteristic
    (4, 2, 5, 1)
    """

    points: NDArray[np.float64]
    topology: Topology

    def __repr__(self) -> str:
        return f"TriangleMesh({self.n_vertices} vertices, {self.n_faces} faces)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))

    @classmethod
    def from_arrays(cls, points: ArrayLike, faces: ArrayLike) -> TriangleMesh:
        """Triangle mesh from arrays.

        Parameters
        ----------
        points : (n, 2) or (n, 3) array_like of float
            In the plane, z is 0.
        faces : (m, 3) array_like of int, or of floats that are whole numbers
            Corners, counter-clockwise seen from outside.

        Returns
        -------
        TriangleMesh

        Raises
        ------
        MeshError
            On a wrong shape, a point that is not finite, or a corner that names no point.
        """
        points = own_points(points)
        return cls(
            points, Topology(check_faces(indices(faces, "the array of faces"), len(points)), len(points))
        )

    def moved_unchecked(self, points: NDArray) -> Self:
        """`moved` without checks and without a copy: the array becomes read-only."""
        return type(self)(points, self.topology)

    @property
    def faces(self) -> NDArray[np.int64]:
        """(m, 3) corners of the faces."""
        return self.topology.faces

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.points)

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return self.topology.n_faces

    @cached_property
    def bounding_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest coordinates (3,) of all points; ValueError without points."""
        return bounding_box(self.points)

    @cached_property
    def side_vector(self) -> NDArray[np.float64]:
        """(m, 3, 3) vector of side j, from corner j to corner j+1."""
        corners = self.points[self.faces]
        return frozen(corners[:, NEXT] - corners)

    @cached_property
    def side_length(self) -> NDArray[np.float64]:
        """(m, 3) length of side j, from corner j to corner j+1.

        Scaled before squaring, so that coordinates near the limits of float64 neither overflow nor vanish.
        """
        points, length = self.points.T.copy(), np.empty((self.n_faces, 3))
        for begin in range(0, self.n_faces, BLOCK_SIZE):
            rows = slice(begin, begin + BLOCK_SIZE)
            corners = points.take(self.faces[rows].T.ravel(), axis=1).reshape(3, 3, -1)
            for j in range(3):
                length[rows, j] = _distance(corners[:, j], corners[:, (j + 1) % 3])
        return frozen(length)

    @cached_property
    def flat_faces(self) -> NDArray[np.int64]:
        """(k,) indices of the faces without area, to 1e-12 of their longest side squared.

        From positions: lengths determine the area of a needle only to 1e-8 of its longest side squared.
        """
        flat = [np.zeros(0, dtype=np.int64)]
        for faces, side in unit_side_blocks(self):
            normal = cross(side[:, 0], side[:, 1])
            has_area = dot(normal, normal) > (FLAT_AREA_TOLERANCE * dot(side, side).max(axis=0)) ** 2
            flat.append(faces.start + np.flatnonzero(~has_area))
        return frozen(np.concatenate(flat))


def unit_side_blocks(mesh: TriangleMesh) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Side vectors of blocks of faces, each face scaled so that products neither overflow nor vanish.

    Parameters
    ----------
    mesh : TriangleMesh

    Yields
    ------
    faces : slice
    side : (3, 3, k) ndarray of float64
        Component, side, face; each face is divided by its largest component.
    """
    points = mesh.points.T.copy()
    for begin in range(0, mesh.n_faces, BLOCK_SIZE):
        faces = slice(begin, begin + BLOCK_SIZE)
        corners = points.take(mesh.faces[faces].T, axis=1)
        side = corners[:, NEXT] - corners
        extent = np.abs(side).max(axis=(0, 1))
        side /= np.where(extent > 0, extent, 1.0)
        yield faces, side


def _distance(tail: NDArray, head: NDArray) -> NDArray[np.float64]:
    """(k,) distance between the columns of two (3, k) arrays."""
    step = head - tail
    with np.errstate(over="ignore"):
        square = step[0] * step[0]
        square += step[1] * step[1]
        square += step[2] * step[2]
    if 1e-200 < square.max(initial=0.0) < 1e300:
        return np.sqrt(square, out=square)
    return vector_length(step.T)
