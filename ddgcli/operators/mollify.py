"""Lengths mended where a triangle has no area, so that angles and cotangents exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import signed_excess
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

FLAT = 4  # roundings of the perimeter: an excess below has no shape left
SPARE = 1e4  # roundings of the mean side: the excess of a mended triangle, so that four digits are known
MAX_ROUNDS = 50


@dataclass(frozen=True, eq=False)
class Mollified:
    """Side lengths whose triangles all have an inside.

    Parameters
    ----------
    length : (m, 3) ndarray
        The input itself where nothing had to be mended.
    faces : (k,) ndarray of int64
        Degenerate faces of the input.
    edges : int
        Number of edges that were lengthened.
    largest_change : float
        Largest lengthening, relative to the mean side.
    """

    length: NDArray
    faces: NDArray[np.int64]
    edges: int = 0
    largest_change: float = 0.0

    def __str__(self) -> str:
        return (
            f"{len(self.faces)} degenerate faces (first: face {self.faces[0]}) were mollified: {self.edges} "
            f"edges lengthened by at most {self.largest_change:.1e} of the mean edge length"
        )


def mollified(length: NDArray, side_edge: NDArray) -> Mollified:
    """Lengths grown as little as gives every triangle an inside.

    A face whose sides break the triangle inequality, or hold it with mere rounding to spare, has its three
    edges lengthened by the same amount: a cap (three corners on a line) until four digits of its height are
    known, by about 1e-12 of its sides; a needle without a width until its angle is the square root of a
    rounding, 1e-8, so that lengths and cotangents both keep half of their digits. Neighbours that this would
    cost more than half of their own excess follow. Where nothing is degenerate nothing changes. After
    N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020, who lengthen every edge alike.

    Parameters
    ----------
    length : (m, 3) ndarray of float64 or longdouble
        Side lengths; the result has their precision.
    side_edge : (m, 3) ndarray of int64
        Edge of each side.

    Raises
    ------
    MeshError
        When no face has an inside: there is no surface to speak of.
    """
    unit = float(np.finfo(length.dtype).eps)
    least = _excesses(length)[:, 0]
    flat = np.flatnonzero(~(least > FLAT * unit * length.sum(axis=1)))
    if len(flat) == 0:
        return Mollified(length, flat)
    if len(flat) == len(length):
        raise MeshError(f"none of the {len(length)} faces has an area; check the coordinates")
    original = np.zeros(side_edge.max() + 1, dtype=length.dtype)
    original[side_edge] = length
    mean = length.mean()
    wanted = 0.5 * least
    wanted[flat] = _mended_excess(length[flat], np.maximum(length[flat].mean(axis=1), unit * mean), unit)
    grown = _lengthened(original, side_edge, wanted)
    change = grown - original
    return Mollified(grown[side_edge], flat, int((change > 0).sum()), float(change.max() / mean))


def mollified_mesh(mesh: TriangleMesh | IntrinsicMesh) -> tuple[TriangleMesh | IntrinsicMesh, Mollified]:
    """The mesh with mollified lengths (itself where nothing was degenerate), and what was done."""
    mended = mollified(mesh.side_length, mesh.topology.side_edge)
    if len(mended.faces) == 0:
        return mesh, mended
    return IntrinsicMesh(mesh.topology, mended.length, mesh.points), mended


def _excesses(length: NDArray) -> NDArray:
    """(m, 3) differences between two sides' sum and the third, least first."""
    a, b, c = length.T
    excess = [signed_excess(a, b, c), signed_excess(b, c, a), signed_excess(c, a, b)]
    return np.sort(np.stack(excess, axis=1), axis=1)


def _mended_excess(length: NDArray, size: NDArray, unit: float) -> NDArray:
    """(k,) least excess that flat faces of a mean side `size` are to have.

    The product of the two lesser excesses, over the size squared, is about the least angle squared.
    """
    least, middle, _ = np.maximum(_excesses(length), 0.0).T
    narrow = np.sqrt(unit) * size
    added = 2.0 * narrow / (middle / narrow + np.sqrt((middle / narrow) ** 2 + 4.0))
    return np.maximum(SPARE * unit * size, np.maximum(least, 0.0) + added)


def _lengthened(edge_length: NDArray, side_edge: NDArray, wanted: NDArray) -> NDArray:
    """(e,) edge lengths that give each face the excess wanted, in rounds over the faces still short of it.

    Where the rounds do not end, every edge grows by what the worst face lacks: that always suffices.
    """
    edge_length = edge_length.copy()
    for _ in range(MAX_ROUNDS):
        missing = wanted - _excesses(edge_length[side_edge])[:, 0]
        # a little more than is missing, so that rounding does not ask for another round
        missing[missing > 0] += 0.01 * wanted[missing > 0]
        short = np.flatnonzero(missing > 0)
        if len(short) == 0:
            return edge_length
        more = np.zeros_like(edge_length)
        np.maximum.at(more, side_edge[short].ravel(), np.repeat(missing[short], 3))
        edge_length += more
    missing = wanted - _excesses(edge_length[side_edge])[:, 0]
    return edge_length + max(missing.max() + 0.01 * wanted.max(), 0.0)
