"""Pairs of a pair mesh that can meet while no vertex has moved far, for many evaluations of a barrier.

One search serves many evaluations, which only measure these pairs. A common translation of all vertices does
not count as a move. The pairs that are near do not depend on where they were searched; the order in which
they are summed does, up to rounding, so that each step begins with a search of its own.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_dot

REACH = 1.0  # of the gap: how far vertices may move from where the pairs were searched
SEARCH_MARGIN = 1.001  # of the distance up to which pairs are searched: rounding


class NearPairs:
    """The pairs nearer than `gap` at any positions within `reach` of some positions, and others.

    Parameters
    ----------
    mesh : ipctk.CollisionMesh
    edges, faces : (e, 2), (m, 3) ndarray
    positions : (n, 3) ndarray
        Finite.
    gap : float
        m.

    Attributes
    ----------
    candidates : ipctk.Candidates
    reach : float
        m.
    """

    def __init__(self, mesh: Any, edges: NDArray, faces: NDArray, positions: NDArray, gap: float) -> None:
        library = importlib.import_module("ipctk")
        self.gap, self.positions, self.reach = gap, positions, REACH * gap
        # two ends come nearer by twice the reach; boxes around both are inflated by half of that distance
        distance = SEARCH_MARGIN * (gap + 2 * self.reach)
        self.candidates = library.Candidates()
        self.candidates.build(mesh, positions, 0.5 * distance, library.LBVH())
        if not len(self.candidates):
            return
        near = self.candidates.compute_per_vertex_safe_distances(mesh, positions, distance) < distance
        if near.any():
            _keep(self.candidates, near[edges].any(axis=1), near[faces].any(axis=1), near)
        else:
            self.candidates.clear()

    def hold(self, *positions: NDArray) -> bool:
        """Whether the pairs are all that come nearer than the gap at these positions and between them."""
        return all(spread(p - self.positions) <= self.reach for p in positions)


def spread(move: NDArray) -> float:
    """Longest displacement of a vertex, apart from a translation of all.

    Parameters
    ----------
    move : (n, 3) ndarray of float64

    Returns
    -------
    float
    """
    rest = move - 0.5 * (move.min(axis=0) + move.max(axis=0))
    return float(np.sqrt(row_dot(rest, rest).max(initial=0.0)))


def _keep(candidates: Any, edge: NDArray, face: NDArray, vertex: NDArray) -> None:
    """Keep the pairs with one of these edges, faces or vertices."""
    edges, faces, vertices = edge.tolist(), face.tolist(), vertex.tolist()
    candidates.ee_candidates = [c for c in candidates.ee_candidates if edges[c.edge0_id] or edges[c.edge1_id]]
    candidates.fv_candidates = [
        c for c in candidates.fv_candidates if faces[c.face_id] or vertices[c.vertex_id]
    ]
