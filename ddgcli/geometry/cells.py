"""Metric of triangles and tetrahedra: measures, gradients of barycentric coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_cotan, face_area
from ddgcli.mesh.require import no_area_error, refuse_flat_faces
from ddgcli.mesh.require_solid import refuse_flat_cells
from ddgcli.mesh.tet_mesh import FLAT_VOLUME_TOLERANCE, TET_EDGES
from ddgcli.mesh.triangle_mesh import TriangleMesh, unit_side_blocks
from ddgcli.mesh.vectors import cross, dot, vector_length

# local edges of a triangle: its sides in order
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])


@dataclass(frozen=True, eq=False)
class CellMetric:
    """Measures, distances and gradient products of cells, as the Hodge stars need them.

    Attributes
    ----------
    measure : (m,) ndarray
        Area or volume, positive.
    squared_distance : (m, c, c) ndarray
        Squared distance between corners (c = 3 or 4).
    gradient_product : (m, c, c) ndarray
        Dot products of the gradients of the barycentric coordinates, in 1/length^2.
    """

    measure: NDArray[np.float64]
    squared_distance: NDArray[np.float64]
    gradient_product: NDArray[np.float64]

    @cached_property
    def circumcentre(self) -> NDArray[np.float64]:
        """(m, c) barycentric coordinates of the circumcentre; negative where it lies outside."""
        # |x|^2 is reproduced in the mean by sum_j b_j |x_i - x_j|^2 = R^2 + R^2: solved by gradients
        from_first = self.squared_distance[:, 0, 1:]
        weights = 0.5 * np.einsum("mij,mj->mi", self.gradient_product[:, 1:, 1:], from_first)
        return np.concatenate([1.0 - weights.sum(axis=1, keepdims=True), weights], axis=1)

    def dot(self, a: int, b: int, c: int, d: int) -> NDArray[np.float64]:
        """(m,) dot product of the vectors from corner a to b and from corner c to d."""
        s = self.squared_distance
        return 0.5 * (s[:, a, d] + s[:, b, c] - s[:, a, c] - s[:, b, d])


def triangle_metric(side_length: NDArray) -> CellMetric:
    """Metric of triangles from their side lengths.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64
        Side j runs from corner j to corner j+1.

    Returns
    -------
    CellMetric
        Areas, squared side lengths and gradient products: between corners a and b, -cot(third angle)/(2
        area).

    Raises
    ------
    MeshError
        When a face has no area: its gradients are infinite.

    Examples
    --------
    >>> right = triangle_metric(np.array([[1.0, np.sqrt(2.0), 1.0]]))
    >>> right.measure.round(12).tolist()
    [0.5]
    """
    area = face_area(side_length)
    _refuse_flat(np.flatnonzero(~(area > 0)), len(area))
    return _triangles(side_length, area, corner_cotan(side_length))


def embedded_triangle_metric(mesh: TriangleMesh) -> CellMetric:
    """Metric of triangles from their positions.

    Lengths determine areas only to 1e-8 of the squared longest side: flatter caps would have no area.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    CellMetric
        As for `triangle_metric`.

    Raises
    ------
    MeshError
        When a face has no area (`TriangleMesh.flat_faces`).

    Examples
    --------
    >>> cap = TriangleMesh.from_arrays([[0, 0, 0], [2, 0, 0], [1, 1e-9, 0]], [[0, 1, 2]])
    >>> embedded_triangle_metric(cap).measure.tolist()
    [1e-09]
    """
    _refuse_flat(mesh.flat_faces, mesh.n_faces)
    area, cotan = np.empty(mesh.n_faces), np.empty((mesh.n_faces, 3))
    for faces, side in unit_side_blocks(mesh):
        double_area = vector_length(cross(side[:, 0], side[:, 1]).T)
        scale = mesh.side_length[faces].max(axis=1) / np.sqrt(dot(side, side).max(axis=0))
        area[faces] = 0.5 * double_area * scale * scale
        cotan[faces] = (-dot(side, np.roll(side, 1, axis=1)) / double_area).T
    return _triangles(mesh.side_length, area, cotan)


def _refuse_flat(flat: NDArray, n_faces: int) -> None:
    if len(flat) and len(flat) == n_faces:
        raise no_area_error(n_faces)
    refuse_flat_faces(flat, manifold=True)


def _triangles(side_length: NDArray, area: NDArray, cotan: NDArray) -> CellMetric:
    squared = np.zeros((len(area), 3, 3))
    product = np.zeros_like(squared)
    for j, (a, b) in enumerate(TRIANGLE_EDGES):
        opposite = 3 - a - b
        squared[:, a, b] = squared[:, b, a] = side_length[:, j] ** 2
        product[:, a, b] = product[:, b, a] = -cotan[:, opposite] / (2.0 * area)
        product[:, opposite, opposite] = (side_length[:, j] / (2.0 * area)) ** 2
    return CellMetric(area, squared, product)


def tetrahedron_metric(edge_length: NDArray) -> CellMetric:
    """Metric of tetrahedra from their edge lengths.

    Parameters
    ----------
    edge_length : (m, 6) ndarray of float64
        In the order of `TET_EDGES`.

    Returns
    -------
    CellMetric
        Volumes in length^3, squared edge lengths, gradient products (from the inverse Gram matrix).

    Raises
    ------
    MeshError
        When a tetrahedron has no volume, or no tetrahedron has its lengths.

    Examples
    --------
    >>> regular = tetrahedron_metric(np.ones((1, 6)))
    >>> bool(np.isclose(regular.measure[0], np.sqrt(2.0) / 12.0))
    True
    """
    squared = np.zeros((len(edge_length), 4, 4))
    for j, (a, b) in enumerate(TET_EDGES):
        squared[:, a, b] = squared[:, b, a] = edge_length[:, j] ** 2
    gram = 0.5 * (squared[:, 0, 1:, None] + squared[:, 0, None, 1:] - squared[:, 1:, 1:])
    scale = np.maximum(edge_length.max(axis=1), np.finfo(float).tiny)
    determinant = np.linalg.det(gram / scale[:, None, None] ** 2)
    volume = np.sqrt(np.maximum(determinant, 0.0)) / 6.0
    refuse_flat_cells(np.flatnonzero(~(volume > FLAT_VOLUME_TOLERANCE)), len(volume))
    inverse = np.linalg.inv(gram)
    product = np.zeros_like(squared)
    product[:, 1:, 1:] = inverse
    product[:, 0, 1:] = product[:, 1:, 0] = -inverse.sum(axis=1)
    product[:, 0, 0] = inverse.sum(axis=(1, 2))
    return CellMetric(volume * scale**3, squared, product)
