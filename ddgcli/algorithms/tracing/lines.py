"""Start points of straightest geodesics, and where the lines end."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

END_STATUS, BOUNDARY_STATUS, FAILURE_STATUS = 0, 1, 2  # values of `Traces.status`


@dataclass(frozen=True, eq=False)
class LineStart:
    """Checked start points, unit directions in the planar frames of their faces, and lengths."""

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]

    def subset(self, first: int, last: int) -> LineStart:
        """Lines first..last-1."""
        rows = slice(first, last)
        return LineStart(self.face[rows], self.barycentric[rows], self.direction[rows], self.length[rows])


@dataclass(frozen=True, eq=False)
class Traces:
    """Ends of k lines, and optionally the points at which they cross sides.

    Parameters
    ----------
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64
        End points.
    direction : (k, 2) ndarray of float64
        Unit direction at the end, in the planar frame of `face` (corner 0 at the origin, corner 1 on +x).
    length : (k,) ndarray of float64
        Traced length; less than the requested length where `status` is not 0.
    status : (k,) ndarray of int8
        0: the line has its full length; 1: it stopped at the boundary; 2: it was abandoned after
        `max_crossings` crossings or at a vertex without angles.
    crossings : (k,) ndarray of int64
        Number of sides and vertices that the line crosses.
    path_start : (k+1,) ndarray of int64
        Points of line i are path_start[i]:path_start[i+1]; none unless recorded.
    path_face, path_barycentric : (p,), (p, 3) ndarray
        Points, in the face that the line enters there (the last point: the face in which the line ends).
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]
    status: NDArray[np.int8]
    crossings: NDArray[np.int64]
    path_start: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    path_face: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    path_barycentric: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    def path(self, i: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(face, barycentric) of the points of line i, including start and end."""
        points = slice(self.path_start[i], self.path_start[i + 1])
        return self.path_face[points], self.path_barycentric[points]

    @classmethod
    def concatenate(cls, batches: list[Traces]) -> Traces:
        """Concatenate several sets of lines."""
        if len(batches) == 1:
            return batches[0]
        shift = np.cumsum([0, *(len(batch.path_face) for batch in batches)])
        start = [batch.path_start[1:] + before for batch, before in zip(batches, shift, strict=False)]
        return cls(
            np.concatenate([batch.face for batch in batches]),
            np.concatenate([batch.barycentric for batch in batches]),
            np.concatenate([batch.direction for batch in batches]),
            np.concatenate([batch.length for batch in batches]),
            np.concatenate([batch.status for batch in batches]),
            np.concatenate([batch.crossings for batch in batches]),
            np.concatenate([np.zeros(1, dtype=np.int64), *start]),
            np.concatenate([batch.path_face for batch in batches]),
            np.concatenate([batch.path_barycentric for batch in batches]),
        )
