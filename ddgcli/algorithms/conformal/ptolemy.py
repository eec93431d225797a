"""Decorated triangulations: edge lengths up to scale factors at the vertices, and Ptolemy flips.

Lengths l_ij and exp((u_i + u_j) / 2) l_ij are discretely conformally equivalent. The flip of ij between
the faces (i, j, k) and (j, i, l) gives l_kl = (l_il l_jk + l_ki l_lj) / l_ij (Ptolemy), which commutes
with the scale factors, and keeps the class (B. Springborn, "Ideal hyperbolic polyhedra and discrete
uniformization", 2020).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.flips import max_flip_rounds
from ddgcli.algorithms.delaunay.gluing import Gluing, around
from ddgcli.algorithms.delaunay.normal_coordinates import flipped_crossings
from ddgcli.errors import SolveError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.topology import Topology

# sum of the cosines of opposite angles below which an edge is flipped; rounding of a tie
COSINE_TOLERANCE = 1e-12


@dataclass(eq=False)
class DecoratedTriangulation(Gluing):
    """Triangulation of a surface up to conformal scale; flips change it in place.

    Parameters
    ----------
    tail, twin
        See `Gluing`.
    length : (3m,) ndarray of float64
        Lengths of the sides without scale factors.
    crossings : (3m,) ndarray of int64
        Normal coordinates of the sides (see `delaunay.normal_coordinates`).
    flipped : (3m,) ndarray of bool
        Sides of edges that a Ptolemy flip made.
    flips : int
    """

    length: NDArray[np.float64]
    crossings: NDArray[np.int64]
    flipped: NDArray[np.bool_]
    flips: int = 0

    @classmethod
    def of(cls, mesh: IntrinsicMesh, crossings: NDArray) -> DecoratedTriangulation:
        """From a glued mesh and its normal coordinates (m, 3)."""
        return cls(
            tail=mesh.faces.ravel().copy(),
            twin=np.append(mesh.topology.side_twin.ravel(), -1),
            length=mesh.side_length.ravel().copy(),
            crossings=crossings.ravel().copy(),
            flipped=np.zeros(3 * mesh.n_faces, dtype=bool),
        )

    @property
    def head(self) -> NDArray[np.int64]:
        """(3m,) vertex at which a side ends."""
        return np.roll(self.tail.reshape(-1, 3), -1, axis=1).ravel()

    def scaled_length(self, u: NDArray) -> NDArray[np.float64]:
        """(3m,) lengths under logarithmic scale factors (n,)."""
        return self.length * np.exp(0.5 * (u[self.tail] + u[self.head]))

    def mesh(self, length: NDArray, n_vertices: int) -> IntrinsicMesh:
        """The triangulation with side lengths (3m,)."""
        topology = Topology(self.tail.reshape(-1, 3), n_vertices, self.twin[:-1].reshape(-1, 3))
        return IntrinsicMesh(topology, length.reshape(-1, 3))


def flip_by_ptolemy(state: DecoratedTriangulation, u: NDArray) -> None:
    """Flip to the Delaunay triangulation of the metric with scale factors u.

    The test, cos(alpha) + cos(beta) >= 0 for opposite angles, is defined by lengths that violate the triangle
    inequality too; of a closed surface no face of the result violates it (Springborn 2020).

    Parameters
    ----------
    state : DecoratedTriangulation
        Flipped in place.
    u : (n,) ndarray of float64
        Logarithmic scale factors.

    Raises
    ------
    SolveError
        More batches of flips than any surface needs.
    """
    length = state.scaled_length(u)
    active = np.flatnonzero(state.twin[:-1] > np.arange(3 * state.n_faces))
    for _ in range(max_flip_rounds(state.n_faces)):
        active, value = _violating(state, length, active)
        if len(active) == 0:
            return
        independent = _independent(state, active, value)
        rim = _flip(state, length, u, active[independent])
        active = unique_keys(np.concatenate([active[~independent], rim]))
    raise SolveError(
        "the Ptolemy flips do not end: the scale factors leave the floating-point range; use other angles or "
        "boundary values"
    )


def _cosine(length: NDArray, side: NDArray) -> NDArray[np.float64]:
    """Cosine opposite a side by the cosine rule; beyond -1..1 where the triangle inequality fails."""
    _, following, preceding = around(side)
    a, b, c = length[side], length[following], length[preceding]
    small, large = np.minimum(b, c), np.maximum(b, c)
    return (small + (large - a) * (large + a) / small) / (2.0 * large)


def _violating(state: DecoratedTriangulation, length: NDArray, side: NDArray) -> tuple[NDArray, NDArray]:
    """Sides, one of each edge, that are not Delaunay, and the sums of cosines."""
    twin = state.twin[side]
    side, twin = side[twin >= 0], twin[twin >= 0]
    side = unique_keys(np.minimum(side, twin))
    twin = state.twin[side]
    total = _cosine(length, side) + _cosine(length, twin)
    bad = (total < -COSINE_TOLERANCE) & (side // 3 != twin // 3)
    return side[bad], total[bad]


def _independent(state: DecoratedTriangulation, side: NDArray, value: NDArray) -> NDArray[np.bool_]:
    """Mask of edges that are the worst of both of their faces."""
    order = np.argsort(-value, kind="stable")
    rank = np.empty(len(side), dtype=np.int64)
    rank[order] = np.arange(len(side))
    best = np.full(state.n_faces, -1, dtype=np.int64)
    one, other = side // 3, state.twin[side] // 3
    np.maximum.at(best, one, rank)
    np.maximum.at(best, other, rank)
    return (best[one] == rank) & (best[other] == rank)


def _flip(state: DecoratedTriangulation, length: NDArray, u: NDArray, side: NDArray) -> NDArray[np.int64]:
    """Flip edges that share no faces; returns the outer sides of their quadrilaterals."""
    here = np.stack([side, state.twin[side]])
    _, after, before = around(here)
    plain = state.length
    diagonal = (plain[after[1]] * plain[after[0]] + plain[before[0]] * plain[before[1]]) / plain[side]
    n, (h1, g1), (h2, g2) = state.crossings, after, before
    crossed = flipped_crossings(n[side], n[h1], n[h2], n[g1], n[g2])
    for array in (plain, length, n, state.flipped):
        array[here] = array[after[::-1]]
    plain[after], n[after], state.flipped[after] = diagonal, crossed, True
    state.flip_sides(here, after, before)
    ends = state.tail[before]  # l and k: the ends of the new edge
    length[after] = diagonal * np.exp(0.5 * (u[ends[0]] + u[ends[1]]))
    state.flips += len(side)
    return np.concatenate([here[0], here[1], before[0], before[1]])
