"""Polylines in the plane and in space: inputs of `curvature`, and every path that leaves the program."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import frozen


@dataclass(frozen=True, eq=False)
class Polyline:
    """One polyline.

    Parameters
    ----------
    points : (n, d) ndarray of float64
        d is 2 or 3; in order along the curve. The first point is not repeated when `closed`.
    closed : bool
    """

    points: NDArray[np.float64]
    closed: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(np.asarray(self.points, dtype=np.float64)))


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Several polylines over one array of points, with arrays on them.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        In order along each path.
    lines : (k, 2) ndarray of int64
        Segments.
    point_arrays : dict of str to ndarray
        Arrays of length n: `path_id`, `face`, `barycentric`, ...
    """

    points: NDArray[np.float64]
    lines: NDArray[np.int64]
    point_arrays: dict[str, NDArray] = field(default_factory=dict)

    @classmethod
    def from_paths(cls, paths: list[NDArray], **arrays: list[NDArray]) -> CurveSet:
        """Paths, each (n_i, 3), put one after the other; `arrays` give one (n_i, ...) array a path each."""
        sizes = [len(p) for p in paths]
        start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        points = np.concatenate(paths) if paths else np.zeros((0, 3))
        lines = [
            np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1) for a, b in zip(start, start[1:])
        ]
        point_arrays = {"path_id": np.repeat(np.arange(len(paths)), sizes)}
        point_arrays |= {name: np.concatenate(parts) for name, parts in arrays.items() if parts}
        return cls(points, np.concatenate(lines) if lines else np.zeros((0, 2), dtype=np.int64), point_arrays)
