"""Map points between an input and an intrinsic triangulation of it, through the common subdivision.

A piece of the subdivision is a flat triangle inside one face of either triangulation: a point has the same
barycentric coordinates in the piece from both faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.ragged import ranges, repeat_with_place

MAX_PAIRS = 1 << 18  # pairs of a point and a piece of its face handled at once
FLAT_AREA_TOLERANCE = 1e-14  # area of a piece over its longest side squared, below which it is not searched


@dataclass(frozen=True, eq=False)
class _Chart:
    """The pieces of each face of one triangulation.

    Parameters
    ----------
    start : (m + 1,) ndarray of int64
    piece : (t,) ndarray of int64
        Face f contains piece[start[f]:start[f + 1]].
    barycentric : (t, 3, 3) ndarray of float64
        Coordinates in the face of each piece's corners.
    """

    start: NDArray[np.int64]
    piece: NDArray[np.int64]
    barycentric: NDArray[np.float64]


class PointMap:
    """Map of points between an input and its intrinsic triangulation; reusable for many calls.

    Parameters
    ----------
    cut : CommonSubdivision
    """

    def __init__(self, cut: CommonSubdivision) -> None:
        self._n_faces = cut.input.n_faces if cut.lifted else np.inf  # of the first half of a double cover
        self.cut = cut = cut.lifted or cut
        self._input = _chart(cut.input_face, cut.input.n_faces, _in_input_faces(cut))
        self._intrinsic = _chart(cut.intrinsic_face, cut.intrinsic.n_faces, _in_intrinsic_faces(cut))

    def to_intrinsic(self, points: SurfacePoints) -> SurfacePoints:
        """The points with faces and barycentric coordinates of the intrinsic triangulation.

        Parameters
        ----------
        points : SurfacePoints
            Points with faces of the input.

        Raises
        ------
        ParameterError
            For faces out of range, or coordinates that are negative or do not sum to 1.
        """
        return self._below(_mapped_points(points, self._input, self._intrinsic, self.cut.intrinsic_face))

    def to_input(self, points: SurfacePoints) -> SurfacePoints:
        """The points with faces and barycentric coordinates of the input; the inverse of `to_intrinsic`."""
        return self._below(_mapped_points(points, self._intrinsic, self._input, self.cut.input_face))

    def _below(self, points: SurfacePoints) -> SurfacePoints:
        """Points of the surface under those of its double cover, whose second half has reversed faces."""
        back = points.face >= self._n_faces
        if not back.any():
            return points
        barycentric = np.where(back[:, None], points.barycentric[:, ::-1], points.barycentric)
        return SurfacePoints(np.where(back, points.face - int(self._n_faces), points.face), barycentric)


def _chart(face: NDArray, n_faces: int, barycentric: NDArray) -> _Chart:
    piece = np.argsort(face, kind="stable")
    start = np.searchsorted(face[piece], np.arange(n_faces + 1))
    return _Chart(start, piece, barycentric)


def _in_intrinsic_faces(cut: CommonSubdivision) -> NDArray[np.float64]:
    """(t, 3, 3) coordinates of the pieces' corners in their intrinsic faces, by index alone.

    The vertices around a corner do not determine them: a face may have a vertex twice.
    """
    at_corners = np.tile(np.eye(3), (cut.intrinsic.n_faces, 1))
    on_sides = np.zeros((len(cut.half_side), 3))
    half, k = np.arange(len(cut.half_side)), cut.half_side % 3
    on_sides[half, k], on_sides[half, (k + 1) % 3] = 1.0 - cut.half_along, cut.half_along
    return np.concatenate([at_corners, on_sides])[cut.corner]


def _in_input_faces(cut: CommonSubdivision) -> NDArray[np.float64]:
    """(t, 3, 3) coordinates of the pieces' corners in their input faces."""
    vertex, weight = _padded_rows(cut.from_input)
    faces = cut.input.faces[cut.input_face]
    barycentric = np.empty((len(faces), 3, 3))
    for k, at in enumerate(cut.mesh.faces.T):
        same = faces[:, :, None] == vertex[at][:, None, :]
        barycentric[:, k] = np.where(same, weight[at][:, None, :], 0.0).sum(axis=2)
    return barycentric


def _padded_rows(matrix: csr_array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(v, 3) columns and values of rows with at most three entries; -1 and 0 where there are fewer."""
    count = np.diff(matrix.indptr)
    row, place = repeat_with_place(np.arange(len(count)), count)
    column, value = np.full((len(count), 3), -1, dtype=np.int64), np.zeros((len(count), 3))
    column[row, place], value[row, place] = matrix.indices, matrix.data
    return column, value


def _mapped_points(
    points: SurfacePoints, source: _Chart, target: _Chart, target_face: NDArray
) -> SurfacePoints:
    points = SurfacePoints.checked(points.face, points.barycentric, len(source.start) - 1)
    piece = _containing_piece(points, source)
    share = _share(points.barycentric, source.barycentric[piece])
    barycentric = np.einsum("kc,kcd->kd", share, target.barycentric[piece])
    return SurfacePoints(target_face[piece], barycentric / barycentric.sum(axis=1, keepdims=True))


def _containing_piece(points: SurfacePoints, chart: _Chart) -> NDArray[np.int64]:
    """The piece that contains each point: the one with the largest distance from its sides."""
    count = (chart.start[1:] - chart.start[:-1])[points.face]
    block_number = (np.cumsum(count) - count) // MAX_PAIRS
    containing = np.empty(len(points), dtype=np.int64)
    for block in np.split(np.arange(len(points)), np.flatnonzero(block_number[1:] != block_number[:-1]) + 1):
        owner = np.repeat(np.arange(len(block)), count[block])
        place, first = ranges(chart.start[points.face[block]], count[block])
        piece = chart.piece[place]
        depth = _depth(points.barycentric[block][owner], chart.barycentric[piece])
        deepest = np.maximum.reduceat(depth, first) if len(block) else depth
        best = np.flatnonzero(depth == deepest[owner])
        containing[block[owner[best[::-1]]]] = piece[best[::-1]]  # the first of equal ones
    return containing


def _depth(point: NDArray, corner: NDArray) -> NDArray[np.float64]:
    """(k,) least distance of points from the sides of triangles, negative outside; -inf in flat triangles.

    Distances are measured in the plane of the first two barycentric coordinates.
    """
    z, p = corner[..., 0] + 1j * corner[..., 1], point[:, 0] + 1j * point[:, 1]
    side = z[:, [1, 2, 0]] - z
    length = np.abs(side)
    doubled_area = (np.conj(side[:, 0]) * side[:, 1]).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (np.conj(side) * (p[:, None] - z)).imag / length
    flat = doubled_area <= FLAT_AREA_TOLERANCE * length.max(axis=1) ** 2
    return np.where(flat, -np.inf, distance.min(axis=1))


def _share(point: NDArray, corner: NDArray) -> NDArray[np.float64]:
    """(k, 3) coordinates of points in triangles, both given by barycentric coordinates; not negative.

    Relative to the nearest corner, with one step of iterative refinement for thin triangles.
    """
    z, p = corner[..., 0] + 1j * corner[..., 1], point[:, 0] + 1j * point[:, 1]
    share = np.eye(3)[np.abs(z - p[:, None]).argmin(axis=1)]
    for _ in range(2):
        residual = p - (share * z).sum(axis=1)
        e, f = z[:, 1] - z[:, 0], z[:, 2] - z[:, 0]
        doubled_area = (np.conj(e) * f).imag
        at_1, at_2 = (np.conj(residual) * f).imag / doubled_area, (np.conj(e) * residual).imag / doubled_area
        share = share + np.stack([-at_1 - at_2, at_1, at_2], axis=1)
    share = np.maximum(share, 0.0)
    return share / share.sum(axis=1, keepdims=True)
