"""Candidate pairs for a barrier, reused until some vertex has moved far.

One search serves many evaluations, which only measure the distances of these pairs. A common translation of
all vertices does not count as motion. Which pairs are near does not depend on the positions of the search,
but the order of summation does, and with it rounding: therefore each step starts with a new search.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_dot

REACH = 1.0  # largest move of a vertex since the search, over the gap
SEARCH_MARGIN = 1.001  # factor on the search distance, for rounding


class NearPairs:
    """Superset of the pairs nearer than `gap` at any positions within `reach` of given ones.

    Parameters
    ----------
    mesh : ipctk.CollisionMesh
    edges, faces : (e, 2), (m, 3) ndarray
    positions : (n, 3) ndarray
        Positions at which the pairs are searched; finite.
    gap : float
        In m.

    Attributes
    ----------
    candidates : ipctk.Candidates
    reach : float
        In m.
    """

    def __init__(self, mesh: Any, edges: NDArray, faces: NDArray, positions: NDArray, gap: float) -> None:
        library = importlib.import_module("ipctk")
        self.gap, self.positions, self.reach = gap, positions, REACH * gap
        # two elements can approach by twice the reach; each box is inflated by half of the distance
        distance = SEARCH_MARGIN * (gap + 2 * self.reach)
        self.candidates = library.Candidates()
        self.candidates.build(mesh, positions, 0.5 * distance, library.LBVH())
        if not len(self.candidates):
            return
        near = self.candidates.compute_per_vertex_safe_distances(mesh, positions, distance) < distance
        if near.any():
            _discard_others(self.candidates, near[edges].any(axis=1), near[faces].any(axis=1), near)
        else:
            self.candidates.clear()

    def cover(self, *positions: NDArray) -> bool:
        """Whether the candidates include all pairs within the gap at these positions and between them."""
        return all(largest_relative_move(p - self.positions) <= self.reach for p in positions)


def largest_relative_move(move: NDArray) -> float:
    """Longest displacement of a vertex after removing a common translation of all vertices.

    Parameters
    ----------
    move : (n, 3) ndarray of float64

    Returns
    -------
    float
    """
    rest = move - 0.5 * (move.min(axis=0) + move.max(axis=0))
    return float(np.sqrt(row_dot(rest, rest).max(initial=0.0)))


def _discard_others(candidates: Any, edge: NDArray, face: NDArray, vertex: NDArray) -> None:
    """Discard the candidates that contain none of these edges, faces and vertices."""
    edges, faces, vertices = edge.tolist(), face.tolist(), vertex.tolist()
    candidates.ee_candidates = [c for c in candidates.ee_candidates if edges[c.edge0_id] or edges[c.edge1_id]]
    candidates.fv_candidates = [
        c for c in candidates.fv_candidates if faces[c.face_id] or vertices[c.vertex_id]
    ]
