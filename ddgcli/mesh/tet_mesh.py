"""Tetrahedral meshes: positions and four corners per cell, immutable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.frozen import frozen
from ddgcli.mesh.masked import indices
from ddgcli.mesh.ragged import repeated_rows
from ddgcli.mesh.triangle_mesh import PointMesh, TriangleMesh, own_points
from ddgcli.mesh.vectors import cone_volume

# faces of a positively oriented tetrahedron, outward; face i is opposite corner i
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
# local edges of a tetrahedron, in order
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
FLAT_VOLUME_TOLERANCE = 1e-8  # of the longest edge cubed; rounding of volumes from edge lengths
# of volumes from positions: cells that rounding may put below the tolerance above count as flat
FLAT_POSITION_TOLERANCE = 2 * FLAT_VOLUME_TOLERANCE


@dataclass(frozen=True, eq=False)
class TetMesh(PointMesh):
    """Tetrahedral mesh.

    `from_arrays` checks its arguments; the constructor does not.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        Vertex positions, in the input's length unit; read-only.
    tetrahedra : (k, 4) ndarray of int64
        Corners of the cells; positively oriented when det(p1-p0, p2-p0, p3-p0) > 0.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> solid = ddg.TetMesh.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    >>> round(float(solid.signed_volume.sum()), 6), solid.boundary.n_faces
    (0.166667, 4)
    """

    points: NDArray[np.float64]
    tetrahedra: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"TetMesh({self.n_vertices} vertices, {len(self.tetrahedra)} tetrahedra)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        object.__setattr__(self, "tetrahedra", frozen(self.tetrahedra))

    @classmethod
    def from_arrays(cls, points: ArrayLike, tetrahedra: ArrayLike) -> TetMesh:
        """Tetrahedral mesh from arrays.

        Parameters
        ----------
        points : (n, 3) array_like of float
        tetrahedra : (k, 4) array_like of int

        Returns
        -------
        TetMesh

        Raises
        ------
        MeshError
            On a wrong shape, a point that is not finite, or a corner that names no point.
        """
        points = own_points(points)
        tetrahedra = indices(tetrahedra, "the array of tetrahedra")
        if tetrahedra.ndim != 2 or tetrahedra.shape[1] != 4:
            raise MeshError(f"tetrahedra must have shape (k, 4), not {tetrahedra.shape}")
        if tetrahedra.dtype.kind not in "iu":
            raise MeshError(f"indices of tetrahedra must be whole numbers, not {tetrahedra.dtype}")
        bad = np.flatnonzero(((tetrahedra < 0) | (tetrahedra >= len(points))).any(axis=1))
        if len(bad):
            raise MeshError(f"tetrahedron {bad[0]} names a vertex outside 0..{len(points) - 1}")
        return cls(points, tetrahedra.astype(np.int64))

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.points)

    def moved_unchecked(self, points: NDArray) -> Self:
        """`moved` without checks and without a copy: the array becomes read-only."""
        return type(self)(points, self.tetrahedra)

    @cached_property
    def signed_volume(self) -> NDArray[np.float64]:
        """(k,) signed volume of each tetrahedron."""
        p = self.points[self.tetrahedra]
        a, b, c = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], p[:, 3] - p[:, 0]
        return frozen(cone_volume(a.T, b.T, c.T))

    @cached_property
    def flat_tetrahedra(self) -> NDArray[np.int64]:
        """(k,) indices of the tetrahedra without volume, to 2e-8 of their longest edge cubed."""
        shape = relative_volume(self.points[self.tetrahedra])
        return frozen(np.flatnonzero(~(np.abs(shape) > FLAT_POSITION_TOLERANCE)))

    @cached_property
    def duplicate_tetrahedra(self) -> NDArray[np.int64]:
        """(k,) indices of the tetrahedra whose four vertices an earlier one has."""
        return frozen(repeated_rows(np.sort(self.tetrahedra, axis=1)))

    @property
    def face_sign(self) -> NDArray[np.int64]:
        """(k, 4) +1 where a side, with its vertices ascending, is oriented outward; sides as `TET_FACES`."""
        sign = parity(self.tetrahedra[:, TET_FACES].reshape(-1, 3)).reshape(-1, 4)
        return sign * np.where(self.signed_volume < 0, -1, 1)[:, None]

    @cached_property
    def folded_triangles(self) -> NDArray[np.int64]:
        """(f,) indices of the faces of two tetrahedra on one side, none of them flat."""
        is_solid = np.ones(len(self.tetrahedra), dtype=bool)
        is_solid[self.flat_tetrahedra] = False
        triangle, n = self.cell_triangle[is_solid].ravel(), len(self.triangles)
        count = np.bincount(triangle, minlength=n)
        sign = np.bincount(triangle, self.face_sign[is_solid].ravel(), minlength=n)
        return frozen(np.flatnonzero((count == 2) & (sign != 0)))

    @property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) edges, lower vertex index first, in sorted order."""
        return self._edges[0]

    @property
    def cell_edge(self) -> NDArray[np.int64]:
        """(k, 6) index of each edge of `TET_EDGES`."""
        return self._edges[1]

    @property
    def triangles(self) -> NDArray[np.int64]:
        """(f, 3) faces of the tetrahedra, vertex indices ascending, in sorted order."""
        return self._triangles[0]

    @property
    def cell_triangle(self) -> NDArray[np.int64]:
        """(k, 4) index of the triangle opposite each corner."""
        return self._triangles[1]

    @cached_property
    def _edges(self) -> tuple[NDArray, NDArray]:
        return _numbered(self.tetrahedra[:, TET_EDGES])

    @cached_property
    def _triangles(self) -> tuple[NDArray, NDArray]:
        return _numbered(self.tetrahedra[:, TET_FACES])

    @cached_property
    def vertex_component(self) -> NDArray[np.int64]:
        """(n,) component of each vertex, by their lowest vertices; -1 for vertices of no tetrahedron."""
        corners = self.tetrahedra
        label = connected_labels(corners[:, :-1], corners[:, 1:], self.n_vertices)[1]
        used = np.unique(label[corners[:, 0]])
        component = np.full(int(label.max(initial=-1)) + 1, -1)
        component[used] = np.arange(len(used))
        return frozen(component[label])

    @cached_property
    def boundary(self) -> TriangleMesh:
        """The boundary surface over the same points, oriented outward; unused vertices stay unreferenced."""
        turned, is_boundary = self._boundary_sides
        tets = np.take_along_axis(self.tetrahedra, turned, axis=1)
        return TriangleMesh.from_arrays(self.points, tets[:, TET_FACES][is_boundary])

    @cached_property
    def boundary_cell(self) -> NDArray[np.int64]:
        """(f,) tetrahedron of each face of `boundary`."""
        return frozen(np.nonzero(self._boundary_sides[1])[0])

    @property
    def _boundary_sides(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """(k, 4) order of the corners that makes volumes positive, and which sides are on the boundary."""
        turned = np.where((self.signed_volume < 0)[:, None], [0, 2, 1, 3], [0, 1, 2, 3])
        triangle = np.take_along_axis(self.cell_triangle, turned, axis=1)
        return turned, np.bincount(triangle.ravel())[triangle] == 1


def relative_volume(corners: NDArray) -> NDArray[np.float64]:
    """Signed volumes of tetrahedra over their longest edges cubed, at any scale.

    Parameters
    ----------
    corners : (m, 4, 3) ndarray of float64

    Returns
    -------
    (m,) ndarray of float64
        At most 0.118 (regular tetrahedra); 0 where all corners are at one place.

    Examples
    --------
    >>> corner = np.array([[0, 0, 0], [1e-200, 0, 0], [0, 1e-200, 0], [0, 0, 1e-200]])
    >>> relative_volume(corner[None]).round(4).tolist()
    [0.0589]
    """
    edge = corners[:, TET_EDGES[:, 1]] - corners[:, TET_EDGES[:, 0]]
    extent = np.abs(edge).max(axis=(1, 2), initial=0.0)
    edge /= np.where(extent > 0, extent, 1.0)[:, None, None]
    longest = np.sqrt((edge**2).sum(axis=2).max(axis=1, initial=0.0))
    a, b, c = edge[:, TET_EDGES[:, 0] == 0].transpose(1, 2, 0)
    return cone_volume(a, b, c) / np.where(longest > 0, longest, 1.0) ** 3


MAX_KEY = 2**63 - 1  # of the vertices of a simplex as one number


def _numbered(corners: NDArray) -> tuple[NDArray, NDArray]:
    """Distinct simplices, sorted, of the (k, s, c) simplices of the cells, and the (k, s) index of each."""
    k, s, c = corners.shape
    rows = np.sort(corners.reshape(-1, c), axis=1)
    base = int(rows.max(initial=0)) + 1
    if base**c > MAX_KEY:
        rows, index = np.unique(rows, axis=0, return_inverse=True)
        return frozen(rows), frozen(index.reshape(k, s))
    place = base ** np.arange(c - 1, -1, -1, dtype=np.int64)
    key, index = np.unique(rows @ place, return_inverse=True)  # sorting numbers is faster than sorting rows
    return frozen(key[:, None] // place % base), frozen(index.reshape(k, s))


def parity(corners: NDArray) -> NDArray[np.int64]:
    """Sign of the permutation that sorts three vertex indices.

    Parameters
    ----------
    corners : (k, 3) ndarray of int64

    Returns
    -------
    (k,) ndarray of int64
        +1 for an even permutation, -1 for an odd one.

    Examples
    --------
    >>> parity(np.array([[0, 1, 2], [1, 0, 2]])).tolist()
    [1, -1]
    """
    a, b, c = corners.T
    return np.where((a < b) ^ (b < c) ^ (a < c), 1, -1)
