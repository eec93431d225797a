"""Mends that a caller asks for by name; each returns the mended mesh and what it changed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.triangle_mesh import TriangleMesh


def merged_points(points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unique positions in order of first appearance, and the number in them of each point."""
    points = np.asarray(points, dtype=np.float64) + 0.0  # -0 becomes 0
    if len(points) == 0:
        return points, np.zeros(0, dtype=np.int64)
    order = np.lexsort(points.T)
    ordered = points[order]
    fresh = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.cumsum(fresh) - 1
    first = order[fresh]  # lexsort is stable: the first of its group
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return points[np.sort(first)], rank[group]


def oriented(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """The mesh with consistently oriented faces, and which were turned over (the fewer of each piece).

    Raises
    ------
    MeshError
        The surface is not orientable.
    """
    turn = mesh.topology.face_turn
    if turn is None:
        raise MeshError(
            "the surface is not orientable (a Moebius band is in it); it has no consistent orientation"
        )
    faces = np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)
    return TriangleMesh.from_arrays(mesh.points, faces), turn
