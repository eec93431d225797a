"""Data of the surface of a fluid, for its effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import excerpt
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot, tangential
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.expressions import evaluate


@dataclass(eq=False)
class FluidContext:
    """One fluid's surface.

    Parameters
    ----------
    name : str
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
    vertex, face : dict of str to ndarray
        Arrays of its file.
    period : (3,) ndarray
        Lengths after which a periodic grid repeats; 0 where it does not.
    load : callable
        Read a `.npy` relative to the scene.
    obstacles : dict of str to (n,) ndarray of bool
        Vertices on the boundary that each obstacle cuts.
    division : str
        Into how many components the obstacles divide the fluid, for messages; "" where they do not.
    triangulation : dict
        Facts for the report: what the flow is computed on, and why.
    """

    name: str
    mesh: Any
    vertex: dict[str, NDArray]
    face: dict[str, NDArray]
    period: NDArray[np.float64]
    load: Callable[[str], NDArray]
    obstacles: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    division: str = ""
    triangulation: dict[str, Any] = field(default_factory=dict)

    @property
    def is_volume(self) -> bool:
        return isinstance(self.mesh, TetMesh)

    @property
    def cells(self) -> NDArray[np.int64]:
        """(m, 3 or 4) corners of the faces of a surface, of the tetrahedra of a volume."""
        return self.mesh.tetrahedra if isinstance(self.mesh, TetMesh) else self.mesh.faces

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """(n,) vertices of cells; the others have no part in the flow."""
        marked = np.zeros(self.mesh.n_vertices, dtype=bool)
        marked[self.cells] = True
        return marked

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) positions; those without cells are put at a vertex that has one.

        So no extent contains them, and no expression is evaluated at them.
        """
        points = np.asarray(self.mesh.points)
        return points if self.used.all() else np.where(self.used[:, None], points, points[self.cells[0, 0]])

    def scalar(self, source: str, what: str) -> NDArray[np.float64]:
        """(n,) values of an array of the mesh, a `.npy` file or an expression in x, y, z.

        Raises
        ------
        ValueError
            When it is none of them, has the wrong shape or is not finite.
        """
        n = self.mesh.n_vertices
        if source in self.vertex:
            values = np.asarray(self.vertex[source], dtype=np.float64)
        elif source.endswith(".npy"):
            values = np.asarray(self.load(source), dtype=np.float64)
        elif source in self.face:
            raise ValueError(f"{what} '{excerpt(source)}' is an array on faces; give one number per vertex")
        else:
            try:
                values = evaluate(source, dict(zip("xyz", self.points.T)))
            except ValueError as error:
                names = ", ".join(self.vertex) or "none"
                raise ValueError(
                    f"{what} '{excerpt(source)}' is not a vertex array of the mesh (there: {names}), a .npy "
                    f"file or an expression: {error}"
                ) from error
        if values.shape != (n,):
            raise ValueError(
                f"{what} '{excerpt(source)}' has shape {values.shape}; one number per vertex is ({n},)"
            )
        return _finite(np.where(self.used, values, 0.0), what, source)

    def face_vectors(self, source: str | list[Any]) -> NDArray[np.float64]:
        """(m, 3) velocities of an array (on faces or vertices), a `.npy` or three expressions."""
        if not isinstance(source, str):
            return _finite(_evaluated(source, self.face_points()), "velocity", str(source))
        values = self._vectors(source)
        return values if len(values) == len(self.cells) else values[self.cells].mean(axis=1)

    def vectors_along(
        self, source: str | list[Any], ends: NDArray, shares: NDArray, points: NDArray
    ) -> NDArray[np.float64] | None:
        """(s, g, 3) velocities, of arrays on vertices or expressions, at g points of every side.

        Parameters
        ----------
        source : str or list
            Argument of `face_vectors`.
        ends : (s, 2) ndarray of int64
            Tail and head of every side.
        shares : (g, 2) ndarray of float64
            Of tail and head in the points.
        points : (s, g, 3) ndarray of float64

        Returns
        -------
        (s, g, 3) ndarray of float64, or None
            None for arrays on faces, and where expressions have no finite value.
        """
        if not isinstance(source, str):
            values = _evaluated(source, points.reshape(-1, 3)).reshape(points.shape)
            return values if np.isfinite(values).all() else None
        values = self._vectors(source)
        return None if len(values) == len(self.cells) else np.einsum("gk,skx->sgx", shares, values[ends])

    def _vectors(self, source: str) -> NDArray[np.float64]:
        """(m, 3) or (n, 3) velocities of an array on faces or vertices, or of a `.npy`."""
        n, cells = self.mesh.n_vertices, self.cells
        if source.endswith(".npy"):
            values = np.asarray(self.load(source), dtype=np.float64)
        elif source in self.face or source in self.vertex:
            values = np.asarray(self.face.get(source, self.vertex.get(source)), dtype=np.float64)
        else:
            names = ", ".join([*self.vertex, *self.face]) or "none"
            raise ValueError(
                f"velocity '{excerpt(source)}' is neither an array of the mesh (there: {names}) nor "
                "a .npy file"
            )
        if values.shape not in ((len(cells), 3), (n, 3)):
            raise ValueError(
                f"velocity '{excerpt(source)}' has shape {values.shape}; give three numbers per cell "
                f"({len(cells)}) or a vertex ({n})"
            )
        if len(values) == n:
            values = np.where(self.used[:, None], values, 0.0)
        return _finite(values, "velocity", source)

    def face_points(self) -> NDArray[np.float64]:
        """(m, 3) centres of cells; on a periodic grid within one period."""
        corner = self.points[self.cells]
        apart = corner - corner[:, :1]
        return (corner[:, :1] + self.unwrapped(apart)).mean(axis=1)

    def unwrapped(self, difference: NDArray) -> NDArray[np.float64]:
        """Differences of positions, the shortest where the grid is periodic."""
        period = np.where(self.period > 0, self.period, 1.0)
        return np.where(self.period > 0, difference - period * np.round(difference / period), difference)

    def distance(self, centre: NDArray) -> NDArray[np.float64]:
        """(n,) straight distance of the vertices from a point, the shortest on a periodic grid."""
        return np.linalg.norm(self.unwrapped(self.points - np.asarray(centre)), axis=1)

    def to_frames(self, space: SurfaceSpace, vectors: NDArray) -> NDArray[np.complex128]:
        """(m,) vectors in space (m, 3), projected to the faces, in their planar frames."""
        if isinstance(self.mesh, TriangleMesh):
            from ddgcli.geometry.face_frames import face_axes

            x, y = face_axes(self.mesh, np.arange(self.mesh.n_faces))
        else:
            x, y = self._flat_axes()
        return row_dot(vectors, x) + 1j * row_dot(vectors, y)

    def to_space(self, planar: NDArray) -> NDArray[np.float64]:
        """(m, 3) vectors in space of vectors in the planar frames of faces."""
        if isinstance(self.mesh, TriangleMesh):
            from ddgcli.geometry.face_frames import face_axes

            x, y = face_axes(self.mesh, np.arange(self.mesh.n_faces))
        else:
            x, y = self._flat_axes()
        return planar.real[:, None] * x + planar.imag[:, None] * y

    def _flat_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Axes of the faces' frames in the plane of a periodic grid."""
        corner = self.points[self.mesh.faces]
        first = self.unwrapped(corner[:, 1] - corner[:, 0])
        second = self.unwrapped(corner[:, 2] - corner[:, 0])
        x = first / np.linalg.norm(first, axis=1)[:, None]
        y = tangential(second, x)
        return x, y / np.linalg.norm(y, axis=1)[:, None]

    def nearest_vertex(self, place: NDArray) -> NDArray[np.float64]:
        """Position of the vertex nearest to a point."""
        return self.points[np.argmin(self.distance(place))]


def _evaluated(texts: list[Any], points: NDArray) -> NDArray[np.float64]:
    place = dict(zip("xyz", points.T))
    return np.stack([evaluate(str(text), place) for text in texts], axis=1)


def _finite(values: NDArray, what: str, source: str) -> NDArray[np.float64]:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise ValueError(f"{what} '{excerpt(source)}' is not finite at entry {bad[0][0]}")
    return values
