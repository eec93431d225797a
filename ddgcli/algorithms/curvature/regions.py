"""Regions around every vertex: rings of neighbours, and balls connected along the surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ddgcli.errors import ParameterError
from ddgcli.mesh.ragged import expand_lists, list_starts
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

HUB_VALENCE = 24  # rings do not grow through vertices with more neighbours: their fans would join everything


@dataclass(frozen=True, eq=False)
class Regions:
    """One list of members for each vertex.

    Parameters
    ----------
    start : (n + 1,) ndarray of int64
        The members of vertex v are `member[start[v]:start[v + 1]]`.
    member : (p,) ndarray of int
        Vertices.
    """

    start: NDArray[np.int64]
    member: NDArray[np.integer]

    @property
    def count(self) -> NDArray[np.int64]:
        """(n,) number of members of each vertex."""
        return np.diff(self.start)


def adjacency(topology: Topology) -> csr_array:
    """(n, n) ones where an edge joins two vertices, and on the diagonal."""
    return _adjacency_of(topology.faces, topology.n_vertices)


def _adjacency_of(faces: NDArray, n_vertices: int) -> csr_array:
    tail, head = faces.ravel(), faces[:, NEXT].ravel()
    ones = np.ones(2 * len(tail), dtype=np.float32)
    rows, cols = np.concatenate([tail, head]), np.concatenate([head, tail])
    matrix = csr_array((ones, (rows.astype(np.int32), cols.astype(np.int32))), shape=(n_vertices, n_vertices))
    return (matrix + eye_array(n_vertices, dtype=np.float32, format="csr")).tocsr()


def two_rings(topology: Topology, at_least: int, vertices: NDArray | None = None) -> Regions:
    """Vertices within two edges of each vertex (itself included); within three where two give too few.

    Parameters
    ----------
    topology : Topology
    at_least : int
        Neighbours below which the third ring is added.
    vertices : (k,) ndarray of int, optional
        Whose rings; default all.
    """
    if vertices is None:
        near = adjacency(topology)
        growing = _without_hubs(near)
        ring = (near @ growing).tocsr()
        few = (np.diff(ring.indptr) < at_least + 1) & topology.referenced_vertex
    else:
        near = _adjacency_of(_faces_within(topology, vertices, 3), topology.n_vertices)
        growing = _without_hubs(near)
        ring = (near[vertices] @ growing).tocsr()
        few = (np.diff(ring.indptr) < at_least + 1) & topology.referenced_vertex[vertices]
    rows = np.flatnonzero(few)
    if len(rows) == 0:
        return Regions(ring.indptr.astype(np.int64), ring.indices)
    wider = (ring[rows] @ growing).tocsr()
    return _replaced(ring, rows, wider)


def _faces_within(topology: Topology, vertices: NDArray, n_rings: int) -> NDArray[np.int64]:
    """Faces that touch the vertices, or their neighbours up to the ring before the last."""
    inside = np.zeros(topology.n_vertices, dtype=bool)
    inside[vertices] = True
    for _ in range(n_rings):
        faces = topology.faces[inside[topology.faces].any(axis=1)]
        inside[faces] = True
    return faces


def _without_hubs(near: csr_array) -> csr_array:
    """Rows of hubs emptied but for their own diagonal entry: paths may end there, not pass."""
    count = np.diff(near.indptr)
    hub = count > HUB_VALENCE + 1
    if not hub.any():
        return near
    row = np.repeat(np.arange(len(count)), count)
    keep = ~hub[row] | (near.indices == row)
    indptr = list_starts(np.bincount(row[keep], minlength=len(count)))
    return csr_array((near.data[keep], near.indices[keep], indptr), shape=near.shape)


def _replaced(ring: csr_array, rows: NDArray, wider: csr_array) -> Regions:
    count = np.diff(ring.indptr).astype(np.int64)
    count[rows] = np.diff(wider.indptr)
    start = list_starts(count)
    member = np.zeros(start[-1], dtype=np.int64)
    is_new = np.zeros(len(count), dtype=bool)
    is_new[rows] = True
    replaced = np.repeat(is_new, count)
    member[~replaced] = ring.indices[np.repeat(~is_new, np.diff(ring.indptr))]
    member[replaced] = wider.indices
    return Regions(start, member)


def chunks(regions: Regions, members: int) -> Iterator[tuple[int, int]]:
    """Ranges of vertices that together have about `members` members."""
    n = len(regions.start) - 1
    first = 0
    while first < n:
        last = int(np.searchsorted(regions.start, regions.start[first] + members, side="right")) - 1
        last = min(max(last, first + 1), n)
        yield first, last
        first = last


# pairs of a vertex and a face of its ball; more would take more than about three minutes
MAX_BALL_PAIRS = {"quadric": 5e8, "normal-voting": 1e9, "corrected": 2e8, "normal-cycle": 2e8, "cotan": 2e8}


def largest_radius(mesh: TriangleMesh, area: float, scheme: str) -> float:
    """Radius up to which a scheme measures in balls around all vertices of a surface of this area."""
    return float(np.sqrt(MAX_BALL_PAIRS[scheme] * area / np.pi / (float(mesh.n_vertices) * mesh.n_faces)))


def check_radius(mesh: TriangleMesh, area: float, radius: float, unit: float, scheme: str) -> None:
    """Refuse a radius whose balls hold so many faces that the measurement would take many minutes.

    Parameters
    ----------
    area : float
        Of the surface.
    radius : float
    unit : float
        The length unit of `mesh` in units of the input, for the message.
    scheme : str

    Raises
    ------
    ParameterError
    """
    share = min(1.0, np.pi * radius * radius / area)
    pairs = float(mesh.n_vertices) * mesh.n_faces * share
    if pairs > MAX_BALL_PAIRS[scheme]:
        largest = radius * unit * np.sqrt(MAX_BALL_PAIRS[scheme] / pairs)
        raise ParameterError(
            f"balls of radius {radius * unit:g} would hold {pairs / mesh.n_vertices:.0f} faces each, too "
            f"many for {mesh.n_vertices} vertices; use a radius below {largest:.3g}, or a coarser mesh",
            parameter="radius",
        )


def listed(regions: Regions, vertices: NDArray) -> Regions:
    """The regions of some vertices, in their order."""
    _, member = expand_lists(vertices, vertices, (regions.start, regions.member))
    return Regions(list_starts(regions.count[vertices]), member)


def larger(one: Regions, other: Regions) -> Regions:
    """The region with more members for each vertex."""
    return chosen(one, other, other.count > one.count)


def chosen(one: Regions, other: Regions, takes_other: NDArray[np.bool_]) -> Regions:
    """The region of each vertex from `other` where `takes_other` is True, else from `one`."""
    if takes_other.all():
        return other
    n = len(one.start) - 1
    both = Regions(
        np.concatenate([one.start, one.start[-1] + other.start[1:]]),
        np.concatenate([one.member, other.member]),
    )
    return listed(both, np.arange(n) + np.where(takes_other, n, 0))
