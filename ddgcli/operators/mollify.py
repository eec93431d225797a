"""Intrinsic mollification: lengthen sides of triangles without area, so that angles and cotangents exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.geometry.intrinsic import signed_excess
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.require import no_area_error
from ddgcli.mesh.triangle_mesh import TriangleMesh

FLAT_EXCESS = 4  # in roundings of the perimeter: a triangle with a smaller excess is degenerate
MOLLIFIED_EXCESS = 64  # in roundings of the mean side: excess of a mollified triangle, well above FLAT_EXCESS
MAX_ROUNDS = 1000
SAMPLE_SIZE = 1000  # faces, one of which mostly has an area


@dataclass(frozen=True, eq=False)
class Mollification:
    """Side lengths that satisfy the strict triangle inequality.

    Parameters
    ----------
    length : (m, 3) ndarray
        The input itself if no face is degenerate.
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
        faces = counted(len(self.faces), "degenerate face", "degenerate faces")
        mollified = (
            f"{faces} (first: face {self.faces[0]}) {'was' if len(self.faces) == 1 else 'were'} mollified"
        )
        edges = counted(self.edges, "edge", "edges")
        return f"{mollified}: {edges} lengthened by at most {self.largest_change:.1e} of the mean edge length"


def mollify_lengths(length: NDArray, side_edge: NDArray) -> Mollification:
    """Lengthen sides by the least amount that gives every triangle an area.

    If the sides of a face violate the triangle inequality, or satisfy it only up to rounding, its three edges
    are lengthened by the same amount: by about 1e-14 of its sides for a cap (three corners on a line), so
    that rounding cannot flatten it again; for a needle without width until its angle is the square root of
    the rounding unit, 1e-8, so that lengths and cotangents both keep half of their digits. A neighbour that
    would lose more than half of its own excess is lengthened equally. Meshes without degenerate faces do not
    change.
    After N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020, where every edge is
    lengthened.

    Parameters
    ----------
    length : (m, 3) ndarray of float64 or longdouble
        Side lengths; the result has their precision.
    side_edge : (m, 3) ndarray of int64
        Edge of each side.

    Returns
    -------
    Mollification
        The lengths, the degenerate faces, and how many edges changed by how much.

    Raises
    ------
    MeshError
        When no face has an area.
    """
    unit = float(np.finfo(length.dtype).eps)
    least = _excesses(length)[:, 0]
    flat = np.flatnonzero(_is_flat(length, least))
    if len(flat) == 0:
        return Mollification(length, flat)
    if len(flat) == len(length):
        raise no_area_error(len(length))
    original = np.zeros(side_edge.max() + 1, dtype=length.dtype)
    original[side_edge] = length
    mean = length.mean()
    required = 0.5 * least
    required[flat] = _mollified_excess(length[flat], np.maximum(length[flat].mean(axis=1), unit * mean), unit)
    added = np.zeros_like(least)
    added[flat] = np.maximum(required[flat] - least[flat], 0.0)
    grown = _lengthen(original, side_edge, added, required)
    change = grown - original
    return Mollification(grown[side_edge], flat, int((change > 0).sum()), float(change.max() / mean))


def check_mollifiable(mesh: TriangleMesh | IntrinsicMesh) -> None:
    """Raise the error of `mollify_lengths`, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Raises
    ------
    MeshError
        When no face has an area.
    """
    if all_flat(mesh.side_length):
        raise no_area_error(mesh.n_faces)


def all_flat(length: NDArray) -> bool:
    """Whether no face has an area.

    Parameters
    ----------
    length : (m, 3) ndarray of float64
        Side lengths.

    Returns
    -------
    bool
    """
    return bool(_is_flat(length[:SAMPLE_SIZE]).all() and _is_flat(length).all())


def _is_flat(length: NDArray, least_excess: NDArray | None = None) -> NDArray[np.bool_]:
    """(m,) whether the sides of a face violate the triangle inequality, or satisfy it up to rounding."""
    least = _excesses(length)[:, 0] if least_excess is None else least_excess
    return ~(least > FLAT_EXCESS * float(np.finfo(length.dtype).eps) * length.sum(axis=1))


def mollify_mesh(mesh: TriangleMesh | IntrinsicMesh) -> tuple[TriangleMesh | IntrinsicMesh, Mollification]:
    """Mesh with mollified side lengths, see `mollify_lengths`.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    mesh : TriangleMesh or IntrinsicMesh
        The input itself if no face is degenerate.
    mollification : Mollification

    Raises
    ------
    MeshError
        When no face has an area.
    """
    mollification = mollify_lengths(mesh.side_length, mesh.topology.side_edge)
    if len(mollification.faces) == 0:
        return mesh, mollification
    return IntrinsicMesh(mesh.topology, mollification.length, mesh.points), mollification


def _excesses(length: NDArray) -> NDArray:
    """(m, 3) sum of two sides minus the third, in ascending order."""
    a, b, c = length.T
    excess = [signed_excess(a, b, c), signed_excess(b, c, a), signed_excess(c, a, b)]
    return np.sort(np.stack(excess, axis=1), axis=1)


def _mollified_excess(length: NDArray, size: NDArray, unit: float) -> NDArray:
    """(k,) required least excess of degenerate faces with mean side `size`.

    The product of the two lesser excesses, over the size squared, is about the least angle squared.
    """
    least, middle, _ = np.maximum(_excesses(length), 0.0).T
    narrow = np.sqrt(unit) * size
    added = 2.0 * narrow / (middle / narrow + np.sqrt((middle / narrow) ** 2 + 4.0))
    return np.maximum(MOLLIFIED_EXCESS * unit * size, np.maximum(least, 0.0) + added)


def _lengthen(edge_length: NDArray, side_edge: NDArray, added: NDArray, required: NDArray) -> NDArray:
    """(e,) edge lengths plus the largest amount that one of their faces adds.

    A face whose neighbours leave it less than the required excess takes the largest amount among them, so
    that its three edges grow equally. Amounts only increase, up to the largest initial one; after MAX_ROUNDS
    every face takes that one.
    """
    added, growth = added.copy(), np.zeros_like(edge_length)
    growing, faces = np.flatnonzero(added), np.arange(len(side_edge))
    for _ in range(MAX_ROUNDS + 1):
        np.maximum.at(growth, side_edge[growing].ravel(), np.repeat(added[growing], 3))
        most = growth[side_edge[faces]].max(axis=1)
        least = _excesses((edge_length + growth)[side_edge[faces]])[:, 0]
        is_short = (added[faces] < most) & (least < required[faces])
        growing = faces[is_short]
        if not len(growing):
            return edge_length + growth
        added[growing] = most[is_short]
        may_have_grown = np.zeros(len(edge_length), dtype=bool)
        may_have_grown[side_edge[growing]] = True
        faces = np.flatnonzero(may_have_grown[side_edge].any(axis=1))
    return edge_length + added.max()
