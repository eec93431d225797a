"""Regions around every vertex: rings of neighbours, and balls connected along the surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ddgcli.errors import ParameterError
from ddgcli.mesh.ragged import expand_lists, list_starts
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

_BALLS_PER_BLOCK = 1024  # vertices whose balls grow together
HUB_VALENCE = 24  # rings do not grow through vertices with more neighbours: their fans would join everything


@dataclass(frozen=True, eq=False)
class Regions:
    """One list of members for each vertex.

    Parameters
    ----------
    start : (n + 1,) ndarray of int64
        The members of vertex v are `member[start[v]:start[v + 1]]`.
    member : (p,) ndarray of int64
        Vertices (rings) or faces (balls).
    """

    start: NDArray[np.int64]
    member: NDArray[np.int64]

    @property
    def count(self) -> NDArray[np.int64]:
        """(n,) number of members of each vertex."""
        return np.diff(self.start)


def adjacency(topology: Topology) -> csr_array:
    """(n, n) ones where an edge joins two vertices, and on the diagonal."""
    tail, head = topology.side_tail, topology.side_head
    n = topology.n_vertices
    ones = np.ones(2 * len(tail), dtype=np.float32)
    rows, cols = np.concatenate([tail, head]), np.concatenate([head, tail])
    matrix = csr_array((ones, (rows.astype(np.int32), cols.astype(np.int32))), shape=(n, n))
    return (matrix + eye_array(n, dtype=np.float32, format="csr")).tocsr()


def two_rings(topology: Topology, at_least: int) -> Regions:
    """Vertices within two edges of each vertex (itself included); within three where two give too few."""
    near = adjacency(topology)
    growing = _without_hubs(near)
    ring = (near @ growing).tocsr()
    few = np.flatnonzero((np.diff(ring.indptr) < at_least + 1) & topology.referenced_vertex)
    if len(few) == 0:
        return Regions(ring.indptr.astype(np.int64), ring.indices)
    wider = (ring[few] @ growing).tocsr()
    return _replaced(ring, few, wider)


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


MAX_BALL_PAIRS = 2e8  # pairs of a vertex and a member of its ball; more would take many minutes


def largest_radius(mesh: TriangleMesh, area: float) -> float:
    """Radius up to which balls around all vertices of a surface of this area are measured."""
    return float(np.sqrt(MAX_BALL_PAIRS * area / np.pi / (float(mesh.n_vertices) * mesh.n_faces)))


def check_radius(mesh: TriangleMesh, area: float, radius: float, unit: float) -> None:
    """Refuse a radius whose balls hold so many faces that the measurement would take many minutes.

    Parameters
    ----------
    area : float
        Of the surface.
    radius : float
    unit : float
        The length unit of `mesh` in units of the input, for the message.

    Raises
    ------
    ParameterError
    """
    share = min(1.0, np.pi * radius * radius / area)
    pairs = float(mesh.n_vertices) * mesh.n_faces * share
    if pairs > MAX_BALL_PAIRS:
        largest = radius * unit * np.sqrt(MAX_BALL_PAIRS / pairs)
        raise ParameterError(
            f"balls of radius {radius * unit:g} would hold {pairs / mesh.n_vertices:.0f} faces each, too "
            f"many for {mesh.n_vertices} vertices; use a radius below {largest:.3g}, or a coarser mesh",
            parameter="radius",
        )


def vertex_balls(mesh: TriangleMesh, radius: float) -> Regions:
    """Vertices within a distance in space of each vertex, connected to it by edges inside that ball."""
    near = adjacency(mesh.topology)
    lists = near.indptr.astype(np.int64), near.indices.astype(np.int64)
    n, counts, members = np.int64(mesh.n_vertices), [], []
    for begin in range(0, mesh.n_vertices, _BALLS_PER_BLOCK):
        end = min(begin + _BALLS_PER_BLOCK, mesh.n_vertices)
        frontier = members_key = np.arange(end - begin) * n + np.arange(begin, end)
        while len(frontier):
            owner, reached = expand_lists(*np.divmod(frontier, n), lists)
            offset = mesh.points[reached] - mesh.points[begin + owner]
            inside = np.einsum("ij,ij->i", offset, offset) <= radius * radius
            frontier, members_key = _new((owner * n + reached)[inside], members_key)
        owner, vertex = np.divmod(members_key, n)
        counts.append(np.bincount(owner, minlength=end - begin))
        members.append(vertex)
    return Regions(list_starts(np.concatenate(counts)), np.concatenate(members))


def _new(keys: NDArray, existing: NDArray) -> tuple[NDArray, NDArray]:
    """Unique keys that are not in `existing`, and the union of both; sorted."""
    keys = np.unique(keys)
    new = keys[~_member(keys, existing)]
    return new, np.sort(np.concatenate([existing, new]), kind="stable")


def _member(keys: NDArray, sorted_keys: NDArray) -> NDArray[np.bool_]:
    place = np.minimum(np.searchsorted(sorted_keys, keys), len(sorted_keys) - 1)
    return sorted_keys[place] == keys


def listed(regions: Regions, vertices: NDArray) -> Regions:
    """The regions of some vertices, in their order."""
    _, member = expand_lists(vertices, vertices, (regions.start, regions.member))
    return Regions(list_starts(regions.count[vertices]), member)


def larger(one: Regions, other: Regions) -> Regions:
    """The region with more members for each vertex."""
    return chosen(one, other, other.count > one.count)


def chosen(one: Regions, other: Regions, takes_other: NDArray[np.bool_]) -> Regions:
    """The region of each vertex from `other` where `takes_other` is True, else from `one`."""
    n = len(one.start) - 1
    both = Regions(
        np.concatenate([one.start, one.start[-1] + other.start[1:]]),
        np.concatenate([one.member, other.member]),
    )
    return listed(both, np.arange(n) + np.where(takes_other, n, 0))
