"""Points, edges and values of a mesh on the mesh with every face split in four at its edge midpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import MAX_SUBDIVISIONS
from ddgcli.errors import ParameterError
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh

MAX_SUBDIVIDED_FACES = 20_000_000


@dataclass(frozen=True, eq=False)
class MidpointSubdivision:
    """Maps from a mesh to its subdivision, which is the same surface; `MidpointSubdivision.of` makes them.

    Parameters
    ----------
    mesh : TriangleMesh
        The subdivided mesh.
    n_vertices, n_faces : int
        Counts of the input.
    edges : tuple of (e, 2) ndarray of int64
        Edges before each split.
    """

    mesh: TriangleMesh
    n_vertices: int
    n_faces: int
    edges: tuple[NDArray[np.int64], ...]

    @classmethod
    def of(cls, mesh: TriangleMesh, times: int) -> MidpointSubdivision:
        """Split every face in four `times` times, as `midpoint_subdivided` does.

        Parameters
        ----------
        mesh : TriangleMesh
        times : int

        Returns
        -------
        MidpointSubdivision

        Raises
        ------
        ParameterError
            For less than 0 or more than MAX_SUBDIVISIONS times, or too many faces.
        """
        if not 0 <= times <= MAX_SUBDIVISIONS:
            raise ParameterError(f"must be from 0 to {MAX_SUBDIVISIONS}, not {times}", parameter="times")
        n_faces = mesh.n_faces * 4**times
        if n_faces > MAX_SUBDIVIDED_FACES:
            raise ParameterError(
                f"{times} would make {n_faces:,} faces, more than {MAX_SUBDIVIDED_FACES:,}; use a smaller "
                "number",
                parameter="times",
            )
        n_vertices, n_faces, edges = mesh.n_vertices, mesh.n_faces, []
        for _ in range(times):
            edges.append(mesh.topology.edges)
            mesh = midpoint_subdivided(mesh)
        return cls(mesh, n_vertices, n_faces, tuple(edges))

    def points(self, face: NDArray, barycentric: NDArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Faces and barycentric coordinates of the same points on the subdivided mesh.

        Parameters
        ----------
        face : (k,) ndarray of int64
        barycentric : (k, 3) ndarray of float64

        Returns
        -------
        face : (k,) ndarray of int64
        barycentric : (k, 3) ndarray of float64
        """
        face, barycentric = np.asarray(face, dtype=np.int64), np.asarray(barycentric, dtype=np.float64)
        n_faces, row = self.n_faces, np.arange(len(face))
        for _ in self.edges:
            corner = np.argmax(barycentric, axis=1)
            at_corner = barycentric[row, corner] >= 0.5
            # pieces 0, 1, 2 begin with that corner of the face; piece 3 is the triangle of the midpoints
            own = 2.0 * barycentric[row[:, None], (corner[:, None] + np.arange(3)) % 3] - [1.0, 0.0, 0.0]
            middle = 1.0 - 2.0 * barycentric[:, [2, 0, 1]]
            barycentric = np.where(at_corner[:, None], own, middle)
            face = face + n_faces * np.where(at_corner, corner, 3)
            n_faces *= 4
        return face, barycentric

    def edge_pieces(self, pairs: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The pieces of edges of the input.

        Parameters
        ----------
        pairs : (k, 2) ndarray of int64
            Ends of edges of the input.

        Returns
        -------
        pairs : (k', 2) ndarray of int64
            Ends of edges of the subdivided mesh, in the direction of the edges of the input.
        row : (k',) ndarray of int64
            Row of `pairs` that each is a piece of.
        """
        n, row = self.n_vertices, np.arange(len(pairs))
        for edges in self.edges:
            middle = n + edge_indices(edges, pairs)
            halves = np.stack([pairs[:, 0], middle, middle, pairs[:, 1]], axis=1)
            pairs, row, n = halves.reshape(-1, 2), np.repeat(row, 2), n + len(edges)
        return np.asarray(pairs, dtype=np.int64), row

    def vertex_values(self, values: NDArray) -> NDArray:
        """Values at the vertices of the subdivided mesh of a function that is linear in each input face."""
        for edges in self.edges:
            values = np.concatenate([values, values[edges].mean(axis=1)])
        return values

    def vertex_mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Vertices where a function does not vanish that is linear in each face and nonzero at `mask`."""
        for edges in self.edges:
            mask = np.concatenate([mask, mask[edges].any(axis=1)])
        return mask

    def face_values(self, values: NDArray) -> NDArray:
        """Values of faces of the input on their pieces."""
        return np.concatenate(4 ** len(self.edges) * [values])
