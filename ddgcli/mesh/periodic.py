"""Periodic grids: faces across their sides, and places within one period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class Periods:
    """Periods of the objects of a joined mesh.

    Parameters
    ----------
    of_object : dict of str to (3,) ndarray
        Lengths after which each object repeats along x, y and z; 0 where it does not.
    object_index : (m,) ndarray of int
        Index of the object of each face, in the order of `of_object`.
    """

    of_object: dict[str, NDArray[np.float64]]
    object_index: NDArray

    @property
    def of_faces(self) -> NDArray[np.float64]:
        """(m, 3) period of the object of each face."""
        return np.stack(list(self.of_object.values()))[self.object_index]

    def within(self, name: str, places: NDArray, mesh: TriangleMesh) -> NDArray[np.float64]:
        """Places moved by whole periods of an object into the rectangle that `unrolled` covers."""
        index = list(self.of_object).index(name)
        low = mesh.points[mesh.faces[self.object_index == index]].min(axis=(0, 1))
        period = self.of_object[name]
        return np.where(period > 0, low + np.mod(places - low, np.where(period > 0, period, 1.0)), places)


def crosses_side(difference: NDArray, period: NDArray) -> NDArray[np.bool_]:
    """Whether differences of near points are longer than half a period, so that a side lies between them.

    Parameters
    ----------
    difference, period : (..., 3) ndarray
        A period of 0 has no side.

    Returns
    -------
    (..., 3) ndarray of bool
        By axis.
    """
    return np.asarray((period > 0) & (np.abs(difference) > 0.5 * period))


def unrolled(mesh: TriangleMesh, period: NDArray) -> tuple[TriangleMesh, NDArray[np.int64]]:
    """The mesh with copies of the vertices that close a periodic grid, one period further.

    Parameters
    ----------
    mesh : TriangleMesh
    period : (m, 3) ndarray
        Period of the object of each face.

    Returns
    -------
    mesh : TriangleMesh
        As many faces, of which none crosses a side; first the vertices of faces, then the copies.
    vertex : (k,) ndarray of int64
        Which vertex each of its vertices is.
    """
    corner, period = mesh.points[mesh.faces], period[:, None]
    is_copy = crosses_side(corner.max(axis=1, keepdims=True) - corner, period)
    key = mesh.faces + mesh.n_vertices * (is_copy @ np.array([1, 2, 4]))
    keys, first, faces = np.unique(key, return_index=True, return_inverse=True)
    points = np.where(is_copy, corner + period, corner).reshape(-1, 3)[first]
    return TriangleMesh.from_arrays(points, faces.reshape(-1, 3)), keys % mesh.n_vertices
