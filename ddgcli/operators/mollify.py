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
SPARE = 64  # roundings of the mean side: the excess of a mended triangle, well above FLAT
MAX_ROUNDS = 1000


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
    edges lengthened by the same amount: a cap (three corners on a line) until rounding cannot make it flat
    again, by about 1e-14 of its sides; a needle without a width until its angle is the square root of a
    rounding, 1e-8, so that lengths and cotangents both keep half of their digits. Neighbours that this would
    cost more than half of their own excess are lengthened alike. Where nothing is degenerate nothing changes.
    After N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020, who lengthen every edge.

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
    added = np.zeros_like(least)
    added[flat] = np.maximum(wanted[flat] - least[flat], 0.0)
    grown = _lengthened(original, side_edge, added, wanted)
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


def _lengthened(edge_length: NDArray, side_edge: NDArray, added: NDArray, wanted: NDArray) -> NDArray:
    """(e,) lengths of edges that all grow by the most that is added to one of their faces.

    A face that its neighbours leave with less excess than wanted gets as much as the neighbour that has most:
    then its own three edges grow alike. What is added only ever rises, to amounts given at the beginning; if
    it takes too long, the largest is added to every face.
    """
    added = added.copy()
    for k in range(MAX_ROUNDS + 1):
        growth = np.zeros_like(edge_length)
        given = np.flatnonzero(added)
        np.maximum.at(growth, side_edge[given].ravel(), np.repeat(added[given], 3))
        grown = edge_length + growth
        most = growth[side_edge].max(axis=1)
        short = (added < most) & (_excesses(grown[side_edge])[:, 0] < wanted)
        if not short.any():
            break
        if k < MAX_ROUNDS:
            added[short] = most[short]
        else:
            grown = edge_length + most.max()
    return grown
