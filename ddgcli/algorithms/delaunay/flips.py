"""Edge flips on a gluing map, in batches of edges that share no face.

The work arrays are flat over sides (number 3f+j, side j from corner j to corner j+1). The cost of a batch is
proportional to its own edges, not to the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.gluing import Gluing, around
from ddgcli.algorithms.delaunay.normal_coordinates import flipped_crossings
from ddgcli.geometry.intrinsic import excess

DELAUNAY_TOLERANCE = 1e-13


@dataclass(eq=False)
class SideArrays(Gluing):
    """Work arrays of a triangulation under flips, which change them in place.

    Parameters
    ----------
    tail, twin
        See `Gluing`.
    length : (3m,) ndarray of float64
    tangent : (3m,) ndarray of float64
        tan(half the angle opposite the side).
    cotan_sum : (m,) ndarray of float64
        Sum of the three cotangents of a face. A flip that restores the Delaunay property lowers the sum over
        its two faces (Musin 1997); that no flip may raise it rules out cycles by rounding.
    crossings : (3m,) ndarray of int64, optional
        Normal coordinate of the side: number of its crossings with input edges; -1 for an input edge.
    mirror : (c,) ndarray of int64, optional
        With `twisted`: `tail` has the vertices of the orientation double cover, and these are their copies on
        the other sheet, which a reversed face has in their place.
    input_side : (3m,) ndarray of int64, optional
        Index of the input side in this place; -1 for a new edge.
    direction : (3m,) ndarray of float64, optional
        Angle of the side at its tail, counter-clockwise from the vertex's reference.
    twisted : (3m,) ndarray of bool, optional
        True at sides that run along their edge as their twin does; without `direction`.
    """

    length: NDArray[np.float64]
    tangent: NDArray[np.float64]
    cotan_sum: NDArray[np.float64]
    crossings: NDArray[np.int64] | None = None
    input_side: NDArray[np.int64] | None = None
    direction: NDArray[np.float64] | None = None
    twisted: NDArray[np.bool_] | None = None
    mirror: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.refused = 0  # flips that rounding forbade
        self.claim = np.empty(len(self.tail) + 1, dtype=np.int64)  # scratch

    @classmethod
    def of(cls, faces: NDArray, twin: NDArray, length: NDArray) -> SideArrays:
        """Work arrays of faces (m, 3), their gluing (m, 3) and side lengths (m, 3)."""
        tangent, cotan_sum = shape_of(*length.T.copy())
        return cls(
            tail=faces.ravel().copy(),
            twin=np.append(twin.ravel(), -1),
            length=length.ravel().copy(),
            tangent=np.stack(tangent, axis=1).ravel(),
            cotan_sum=cotan_sum,
        )

    def grow(self, n_new: int) -> None:
        """Append n_new faces, unglued and without lengths."""
        super().grow(n_new)
        self._lengthen("length", 3 * n_new, np.nan)
        self._lengthen("tangent", 3 * n_new, np.nan)
        self._lengthen("cotan_sum", n_new, np.nan)
        if self.direction is not None:
            self._lengthen("direction", 3 * n_new, np.nan)
        if self.twisted is not None:
            self._lengthen("twisted", 3 * n_new, False)
        self._lengthen("claim", 3 * n_new, 0)

    def straighten(self, side: NDArray) -> None:
        """Reverse the faces beyond twisted sides, so that both sides of these edges run in opposite ways.

        Side 0 of a reversed face keeps its place, sides 1 and 2 change theirs. No two of the faces beside
        and beyond the sides may be the same.
        """
        if self.twisted is None:
            return
        reversed_side = self.twin.take(side[self.twisted.take(side)])
        first = reversed_side - reversed_side % 3
        second, third = first + 1, first + 2
        self._move(np.concatenate([second, third]), np.concatenate([third, second]))
        for array in (self.length, self.tangent, self.crossings, self.input_side, self.twisted):
            if array is not None:
                array[second], array[third] = array.take(third), array.take(second)
        a, b, c = (self.tail.take(k) for k in (first, second, third))
        if self.mirror is not None:
            a, b, c = self.mirror[a], self.mirror[b], self.mirror[c]
        self.tail[first], self.tail[second], self.tail[third] = b, a, c
        sides = np.concatenate([first, second, third])
        partner = self.twin.take(sides)
        np.logical_xor.at(self.twisted, np.concatenate([sides, partner[partner >= 0]]), True)

    def measure(self, face: NDArray) -> None:
        """Angles of faces whose lengths have changed."""
        tangent, cotan_sum = shape_of(*(self.length[3 * face + k] for k in range(3)))
        for k in range(3):
            self.tangent[3 * face + k] = tangent[k]
        self.cotan_sum[face] = cotan_sum


def shape_of(a: NDArray, b: NDArray, c: NDArray) -> tuple[tuple[NDArray, NDArray, NDArray], NDArray]:
    """Half-angle tangents opposite each side, and the cotangents' sum, of triangles with sides a, b, c.

    With x, y, z Kahan's differences (b + c - a and so on) and r twice the inradius, the tangent opposite a is
    r / x. Degenerate triangles get an infinite or undefined cotangent sum.
    """
    x, y, z = excess(a, b, c), excess(b, c, a), excess(c, a, b)
    perimeter = x + y
    perimeter += z
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        r = np.sqrt(x * y * z / perimeter)
        cotan_sum = (a * a + b * b + c * c) / (r * perimeter)
        return (r / x, r / y, r / z), cotan_sum


def _flipped_length(
    tangent: NDArray, after: NDArray, before: NDArray, across: NDArray, beside: NDArray
) -> NDArray:
    """(k,) length of kl; `across` holds il and jk, `beside` ki and lj, the lengths of sides `before`.

    It is seen from the nearer of i and j: (p - q)^2 + 4 p q sin^2(angle / 2), a sum of squares.
    """
    (il, jk), (ki, lj) = across, beside
    near_i = ki + il <= jk + lj
    p, q = np.where(near_i, ki, jk), np.where(near_i, il, lj)
    t0 = tangent.take(np.where(near_i, after[0], before[0]))
    t1 = tangent.take(np.where(near_i, before[1], after[1]))
    squared = (t0 + t1) ** 2 / ((1.0 + t0 * t0) * (1.0 + t1 * t1))
    return np.asarray(np.sqrt((p - q) ** 2 + 4.0 * p * q * squared))


def flip(state: SideArrays, side: NDArray, *, force: bool = False) -> NDArray:
    """Flip the edges of `side`, no two of which share a face; returns the sides that were flipped.

    Edge ij between the faces (i, j, k) and (j, i, l) becomes kl between (i, l, k) and (j, k, l). Side ij then
    holds i->l, its old twin j->k, and the new edge takes the places of jk and il. A flip that does not lower
    the sum of cotangents (a tie, or rounding) is skipped unless forced. The face beyond a twisted side is
    reversed first.
    """
    here = np.stack([side, state.twin.take(side)])  # (2, k): ij, ji; then jk, il and ki, lj
    face, after, before = around(here)
    if state.twisted is not None:
        turned = state.twisted.take(side)
        after[1], before[1] = np.where(turned, before[1], after[1]), np.where(turned, after[1], before[1])
    across, beside = state.length.take(after[::-1]), state.length.take(before)  # il, jk; ki, lj
    kl = _flipped_length(state.tangent, after, before, across, beside)
    tangent, cotan_sum = shape_of(across, kl, beside)  # of (i, l, k) and (j, k, l): opposite il, kl, ki
    if force:
        better = np.isfinite(cotan_sum).all(axis=0)
    else:
        old = state.cotan_sum.take(face)
        better = cotan_sum[0] + cotan_sum[1] < (old[0] + old[1]) * (1.0 - 1e-15)
    if not better.all():
        state.refused += int(len(better) - better.sum())
        here, face, after, before = (a[:, better] for a in (here, face, after, before))
        across, kl, cotan_sum = across[:, better], kl[better], cotan_sum[:, better]
        tangent = tuple(a[:, better] for a in tangent)  # type: ignore[assignment]

    if state.twisted is not None:
        state.straighten(here[0])
        here = np.stack([here[0], state.twin.take(here[0])])
        face, after, before = around(here)
        state.twisted[here], state.twisted[after] = state.twisted.take(after[::-1]), False
    if state.crossings is not None:
        n, (h, g), (h1, g1), (h2, g2) = state.crossings, here, after, before
        new = flipped_crossings(n[h], n[h1], n[h2], n[g1], n[g2])
        n[h], n[g], n[after] = n[g1], n[h1], new
    if state.input_side is not None:
        state.input_side[here] = state.input_side.take(after[::-1])
        state.input_side[after] = -1
    state.length[here], state.length[after] = across, kl
    state.tangent[here], state.tangent[after], state.tangent[before] = tangent
    state.cotan_sum[face] = cotan_sum
    if state.direction is not None:
        # k->l turns from k->i by the angle at k of (i, l, k); at l alike
        turned = state.direction.take(before) + 2.0 * np.arctan(tangent[0])
        state.direction[here] = state.direction.take(after[::-1])
        state.direction[after] = turned[::-1]
    state.flip_sides(here, after, before)
    return here[0]


def max_flip_rounds(n_faces: int) -> int:
    """Bound on batches of independent flips, far above what any surface needs.

    Parameters
    ----------
    n_faces : int

    Returns
    -------
    int
    """
    return 1000 + 10 * n_faces


def flip_until_delaunay(
    state: SideArrays, active: NDArray | None = None, *, max_rounds: int | None = None
) -> tuple[int, int, bool]:
    """Flip edges that are not locally Delaunay until none remains.

    Parameters
    ----------
    state : SideArrays
    active : (k,) ndarray of int64, optional
        Sides whose edges may need a flip; all by default.
    max_rounds : int, optional
        Bound on the batches; `max_flip_rounds` by default.

    Returns
    -------
    flips, rounds : int
        Edges flipped, and batches.
    complete : bool
        False where `max_rounds` ended the flips.

    Notes
    -----
    A batch takes the edges that violate the condition more than the other edges of their two faces.
    """
    if active is None:
        active = np.flatnonzero(state.twin[:-1] > np.arange(3 * state.n_faces))
    if max_rounds is None:
        max_rounds = max_flip_rounds(state.n_faces)
    flips = rounds = 0
    while rounds < max_rounds:
        active, violation = _violating(state, active)
        if len(active) == 0:
            return flips, rounds, True
        independent = _independent(state, active, violation)
        flipped = flip(state, active.take(independent.nonzero()[0]))
        flips += len(flipped)
        rounds += 1
        active = np.concatenate([active.take((~independent).nonzero()[0]), _rim(state, flipped)])
    return flips, rounds, False


def _violating(state: SideArrays, side: NDArray) -> tuple[NDArray, NDArray]:
    """The sides, each edge once, whose opposite angles sum to more than pi, and tan tan of their halves."""
    twin = state.twin.take(side)
    product = state.tangent.take(side)
    product *= state.tangent.take(twin)
    bad = product > 1.0 + DELAUNAY_TOLERANCE
    bad &= twin >= 0
    at = bad.nonzero()[0]
    side, product = np.minimum(side.take(at), twin.take(at)), product.take(at)
    number, claim = np.arange(len(side)), state.claim
    claim[side] = number
    once = (claim.take(side) == number).nonzero()[0]
    return side.take(once), product.take(once)


def _independent(state: SideArrays, side: NDArray, violation: NDArray) -> NDArray[np.bool_]:
    """Mask of edges no two of which share a face: each violates the condition most in both of its faces."""
    order = np.argsort(violation)
    side = side.take(order)
    one, other = side // 3, state.twin.take(side) // 3
    rank = np.arange(len(side))
    claim = state.claim
    # of several claims numpy keeps the last one, that of the worst violation
    claim[np.stack([one, other], axis=1).ravel()] = np.repeat(rank, 2)
    wins = claim.take(one) == rank
    wins &= claim.take(other) == rank
    wins &= one != other
    independent = np.zeros(len(side), dtype=bool)
    independent[order] = wins
    return independent


def _rim(state: SideArrays, flipped: NDArray) -> NDArray:
    """The four outer sides of the quadrilaterals of flipped edges (numbered as `flip` left them)."""
    _, new, h2 = around(flipped)
    _, g2, g = around(state.twin.take(new))
    return np.concatenate([flipped, h2, g, g2])
