"""Straight pieces of source curves, which emit straight wavefronts besides those of their vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.vectors import ratio, row_dot, vector_length

MAX_TURN = 0.6  # radians between two edges of one piece


@dataclass(frozen=True, eq=False)
class CurveWavefronts:
    """Starts of wavefronts: first the vertices and points, then the straight pieces of the curves.

    Parameters
    ----------
    source : (s,) ndarray of int64
        Source of each start.
    pieces : (s, 2) ndarray of int64
        Of a vertex of a curve the pieces beside it, of a piece itself twice; -1 for none.
    """

    source: NDArray[np.int64]
    pieces: NDArray[np.int64]

    def common_piece(self, a: NDArray, b: NDArray) -> NDArray[np.int64]:
        """Piece that two starts (k,) have in common; -1 for none, and for one vertex, of a circle."""
        first, second = self.pieces.take(a, axis=0).T
        beside = self.pieces.take(b, axis=0)
        common = np.where((second[:, None] == beside).any(axis=1), second, -1)
        common = np.where((first[:, None] == beside).any(axis=1) & (first >= 0), first, common)
        return np.where((a == b) & (first != a), -1, common)


def curve_wavefronts(mesh: SurfaceMesh, sources: Sources, index: NDArray) -> CurveWavefronts:
    """Wavefronts of sources with curves.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    index : (k,) ndarray of int64
        Sources of the vertices and points that stand for them, of `Sources.at_vertices`.

    Returns
    -------
    CurveWavefronts
    """
    vertex, _ = sources.curve_vertices(mesh)
    ends = np.searchsorted(vertex, mesh.topology.edges[sources.edge])
    incident = np.argsort(ends.ravel(), kind="stable") // 2  # edges, vertex by vertex
    count = np.bincount(ends.ravel(), minlength=len(vertex))
    first = list_starts(count)[:-1]
    beside = np.stack([incident[first], np.where(count > 1, incident[first + (count > 1)], -1)], axis=1)
    passes = np.flatnonzero(count == 2)
    passes = passes[_is_straight(mesh, sources, vertex[passes], beside[passes])]
    n_pieces, piece = connected_labels(beside[passes, 0], beside[passes, 1], len(sources.edge))
    own = len(index) + np.arange(n_pieces)
    pieces = np.full((len(index) + n_pieces, 2), -1)
    k = len(sources.vertex)
    pieces[k : k + len(vertex)] = np.where(beside >= 0, own[piece[beside]], -1)
    pieces[own] = own[:, None]
    curve = np.zeros(n_pieces, dtype=np.int64)
    curve[piece] = sources.curve
    return CurveWavefronts(np.concatenate([index, sources.first_curve + curve]), pieces)


def _is_straight(mesh: SurfaceMesh, sources: Sources, vertex: NDArray, beside: NDArray) -> NDArray[np.bool_]:
    """Whether a curve turns little at vertices between two of its edges."""
    if mesh.points is None:
        return np.zeros(len(vertex), dtype=bool)
    ends, curve = mesh.topology.edges[sources.edge[beside]], sources.curve[beside]
    away = [mesh.points[ends[:, i].sum(axis=1) - vertex] - mesh.points[vertex] for i in (0, 1)]
    cosine = ratio(row_dot(*away), vector_length(away[0]) * vector_length(away[1]))
    return np.asarray((cosine < -np.cos(MAX_TURN)) & (curve[:, 0] == curve[:, 1]))
