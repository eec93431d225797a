"""Polylines in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.frozen import frozen
from ddgcli.mesh.masked import indices
from ddgcli.mesh.plane import plane_normal
from ddgcli.mesh.ragged import list_starts, ranges
from ddgcli.mesh.triangle_mesh import PointMesh, own_points

# tolerance for normals of parallel planes: those of thin curves have errors of about 1e-3
PARALLEL_COSINE = 1.0 - 5e-7


@dataclass(frozen=True, eq=False)
class CurveSet(PointMesh):
    """Polylines over one array of points, with arrays on them.

    `from_arrays` checks its arguments; the constructor does not.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        Positions, in order along each path, in the input's length unit.
    lines : (k, 2) ndarray of int64
        Segments, from tail to head.
    point_arrays : dict of str to ndarray
        Arrays of length n: `path_id`, `face`, `barycentric`, ...

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.CurveSet.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> square.n_vertices, square.planar
    (4, True)
    """

    points: NDArray[np.float64]
    lines: NDArray[np.int64]
    point_arrays: dict[str, NDArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        object.__setattr__(self, "lines", frozen(self.lines))

    def __repr__(self) -> str:
        return f"CurveSet({self.n_vertices} vertices, {len(self.lines)} lines)"

    @classmethod
    def from_arrays(cls, points: ArrayLike, lines: ArrayLike) -> CurveSet:
        """Curves from arrays.

        Parameters
        ----------
        points : (n, 2) or (n, 3) array_like of float
        lines : (k, 2) array_like of int
            Segments, from tail to head.

        Returns
        -------
        CurveSet

        Raises
        ------
        MeshError
            On a wrong shape, a point that is not finite, or a segment that names no point.
        """
        checked, segments = own_points(points), indices(lines, "the array of lines")
        if segments.ndim != 2 or segments.shape[1] != 2 or segments.dtype.kind not in "iu":
            raise MeshError(
                f"lines must be whole numbers of shape (k, 2), not {segments.dtype} of shape {segments.shape}"
            )
        bad = np.flatnonzero(((segments < 0) | (segments >= len(checked))).any(axis=1))
        if len(bad):
            raise MeshError(f"segment {bad[0]} names a point outside 0..{len(checked) - 1}")
        return cls(checked, segments.astype(np.int64))

    @property
    def n_vertices(self) -> int:
        """Number of points."""
        return len(self.points)

    def moved_unchecked(self, points: NDArray) -> Self:
        """`moved` without checks and without a copy: the array becomes read-only."""
        return type(self)(np.asarray(points, dtype=np.float64), self.lines)

    @property
    def planar(self) -> bool:
        """Whether each curve lies in a plane."""
        return all(normal is not None for normal in plane_normals(self))

    @cached_property
    def paths(self) -> tuple[tuple[NDArray[np.int64], bool], ...]:
        """Vertices of each curve in order, and whether it is closed (its first vertex is not repeated).

        Segments keep their direction. Points that no segment uses are left out. Open curves come first, by
        their first vertices; a closed curve begins at its lowest vertex. The arrays are read-only.

        Raises
        ------
        MeshError
            Where three or more segments meet, or two meet head to head or tail to tail.
        """
        tail, head = self.lines.T if len(self.lines) else np.zeros((2, 0), dtype=np.int64)
        for ends, what in ((tail, "leave"), (head, "enter")):
            many = np.flatnonzero(np.bincount(ends, minlength=self.n_vertices) > 1)
            if len(many):
                raise MeshError(
                    f"two segments {what} point {many[0]}; a curve passes a point once: split it there"
                )
        member, start, closed = _chains(tail, head, self.n_vertices)
        member = frozen(member)
        return tuple(
            (member[i:j], flag)
            for i, j, flag in zip(start[:-1].tolist(), start[1:].tolist(), closed.tolist(), strict=True)
        )

    def describe(self) -> dict[str, Any]:
        """Counts for the summary."""
        curves = self.paths
        return {
            "vertices": self.n_vertices,
            "lines": len(self.lines),
            "components": len(curves),
            "closed": bool(curves) and all(closed for _, closed in curves),
        }

    @classmethod
    def from_paths(cls, paths: list[NDArray], **arrays: list[NDArray]) -> CurveSet:
        """Paths, each (n_i, 3), concatenated; each entry of `arrays` has one (n_i, ...) array per path."""
        sizes = [len(p) for p in paths]
        start = list_starts(sizes)
        points = np.concatenate(paths) if paths else np.zeros((0, 3))
        lines = [
            np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1) for a, b in zip(start, start[1:])
        ]
        point_arrays = {"path_id": np.repeat(np.arange(len(paths)), sizes)}
        point_arrays |= {name: np.concatenate(pieces) for name, pieces in arrays.items() if pieces}
        return cls(points, np.concatenate(lines) if lines else np.zeros((0, 2), dtype=np.int64), point_arrays)


def _chains(tail: NDArray, head: NDArray, n: int) -> tuple[NDArray, NDArray, NDArray]:
    """Ragged lists (member, start) of the points of each curve in order, and which curves are closed.

    Each point is the tail of one segment at most, and the head of one. Runs of successive numbers stay
    together; where a run begins in its curve follows by pointer doubling.
    """
    is_used, before = np.zeros(n, dtype=bool), np.full(n, -2)
    is_used[tail] = is_used[head] = True
    before[head] = tail
    begins = before != np.arange(n) - 1
    first = np.flatnonzero(begins)
    length = np.diff(first, append=n)
    is_end, run = before[first] < 0, np.arange(len(first))
    previous = np.where(is_end, run, (np.cumsum(begins) - 1)[before[first].clip(min=0)])
    n_curves, curve = connected_labels(run, previous, len(run))
    root = np.full(n_curves, len(run))
    np.minimum.at(root, curve, run)
    root[curve[is_end]] = run[is_end]
    closed = np.ones(n_curves, dtype=bool)
    closed[curve[is_end]] = False
    previous[root] = root
    place = length[previous]
    place[root] = 0
    while not np.array_equal(further := previous[previous], previous):
        place += place[previous]
        previous = further
    by_curve = np.lexsort((place, root[curve], closed[curve]))
    by_curve = by_curve[is_used[first[by_curve]]]
    begins_curve = np.flatnonzero(place[by_curve] == 0)
    member, start = ranges(first[by_curve], length[by_curve])
    return member, np.append(start[begins_curve], len(member)), closed[curve[by_curve[begins_curve]]]


def plane_normals(curves: CurveSet) -> list[NDArray[np.float64] | None]:
    """Unit normal of the plane of each curve, None in space; parallel planes have the same one.

    Parameters
    ----------
    curves : CurveSet

    Returns
    -------
    list of (3,) ndarray of float64 or None
        Of `plane_normal`; that of a plane parallel to the first one points to the same side.
    """
    normals = [plane_normal(curves.points[path]) for path, _ in curves.paths]
    first = next((normal for normal in normals if normal is not None), None)
    return [
        -normal if normal is not None and first is not None and normal @ first < -PARALLEL_COSINE else normal
        for normal in normals
    ]


def are_parallel(normals: Sequence[NDArray | None]) -> bool:
    """Whether all curves lie in parallel planes, so that their signed areas and turning numbers have a sum.

    Parameters
    ----------
    normals : sequence of (3,) ndarray or None
        As returned by `plane_normals`.

    Returns
    -------
    bool
    """
    planes = [normal for normal in normals if normal is not None]
    return len(planes) == len(normals) and all(normal @ planes[0] > PARALLEL_COSINE for normal in planes)
