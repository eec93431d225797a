"""Rings of neighbours around vertices.

A sparse product finds the rings of a whole mesh. Few rings are found by sorting, which takes less time than
the import of `scipy.sparse`, a third of that of a command on a small mesh.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.ragged import expand_lists, group_by_key, list_starts
from ddgcli.mesh.topology import NEXT, PREVIOUS_OFFSET, Topology

if TYPE_CHECKING:
    from scipy.sparse import csr_array

HUB_VALENCE = 24  # rings do not grow through vertices with more neighbours: their fans would join everything
MAX_SORTED_PATHS = 200_000  # of two edges, up to which sorting is faster than that import and the product


def two_rings(topology: Topology, at_least: int, vertices: NDArray | None = None) -> Regions:
    """Vertices within two edges of each vertex (itself included); within three where two give too few.

    Parameters
    ----------
    topology : Topology
    at_least : int
        Neighbours below which the third ring is added.
    vertices : (k,) ndarray of int, optional
        Whose rings; default all.

    Returns
    -------
    Regions
    """
    centre = np.arange(topology.n_vertices) if vertices is None else vertices
    mean_degree = 1 + 3 * topology.n_faces / max(topology.n_vertices, 1)
    if len(centre) * mean_degree**2 <= MAX_SORTED_PATHS:
        return _rings_by_sorting(topology, centre, at_least)
    may_grow = topology.referenced_vertex[centre]
    if vertices is None:
        return _rings_by_product(adjacency(topology), None, at_least, may_grow)
    near = _adjacency_of(_faces_within(topology, vertices, 3), topology.n_vertices)
    return _rings_by_product(near, vertices, at_least, may_grow)


def _faces_within(topology: Topology, vertices: NDArray, n_rings: int) -> NDArray[np.int64]:
    """Faces that touch the vertices, or their neighbours up to the ring before the last."""
    inside = np.zeros(topology.n_vertices, dtype=bool)
    inside[vertices] = True
    corners = np.ascontiguousarray(topology.faces.T)
    for _ in range(n_rings):
        touching = inside.take(corners[0])
        touching |= inside.take(corners[1])
        touching |= inside.take(corners[2])
        faces = topology.faces[touching]
        inside[faces] = True
    return faces


def _rings_by_sorting(topology: Topology, centre: NDArray, at_least: int) -> Regions:
    """`two_rings` from lists of neighbours; pairs of a centre and a member are sorted."""
    n = topology.n_vertices
    index = np.empty(n, dtype=np.int64)  # of a vertex among those whose neighbours are listed

    def grown(owner: NDArray, member: NDArray, hubs_grow: bool = False) -> tuple[NDArray, NDArray]:
        is_member = np.zeros(n, dtype=bool)
        is_member[member] = True
        members = np.flatnonzero(is_member)
        near = _neighbours(topology, members)
        index[members] = np.arange(len(members))
        grows = hubs_grow | (np.diff(near[0]) <= HUB_VALENCE)
        growing = np.flatnonzero(grows.take(index.take(member)))
        further, reached = expand_lists(owner[growing], index.take(member[growing]), near)
        return _distinct_pairs(np.concatenate([owner, further]), np.concatenate([member, reached]), n)

    owner, member = grown(*grown(np.arange(len(centre)), centre, hubs_grow=True))
    count = np.bincount(owner, minlength=len(centre))
    few = (count < at_least + 1) & topology.referenced_vertex[centre]
    if few.any():
        grows = few[owner]
        further, reached = grown(owner[grows], member[grows])
        owner, member = np.concatenate([owner[~grows], further]), np.concatenate([member[~grows], reached])
    return Regions(*group_by_key(owner, member, len(centre)))


def _neighbours(topology: Topology, vertices: NDArray) -> tuple[NDArray[np.int64], NDArray]:
    """Lists of the neighbours of some vertices, in ascending numbers of the vertices."""
    n = topology.n_vertices
    if len(vertices) < n and topology.first_corner is not None:
        return _neighbours_by_rotation(topology, topology.first_corner, vertices)
    faces = topology.faces if len(vertices) == n else _faces_within(topology, vertices, 1)
    tail, head = faces.ravel(), faces[:, NEXT].ravel()
    tail, head = _distinct_pairs(np.concatenate([tail, head]), np.concatenate([head, tail]), n)
    lists = list_starts(np.bincount(tail, minlength=n)), head
    if len(vertices) == n:
        return lists
    owner, member = expand_lists(np.arange(len(vertices)), vertices, lists)
    return list_starts(np.bincount(owner, minlength=len(vertices))), member


def _neighbours_by_rotation(
    topology: Topology, first_corner: NDArray, vertices: NDArray
) -> tuple[NDArray[np.int64], NDArray]:
    """`_neighbours` of some vertices, each with one fan, from their faces alone."""
    owner = np.flatnonzero(topology.referenced_vertex.take(vertices))
    first = corner = first_corner.take(vertices.take(owner))
    owners, members = [owner[:0]], [owner[:0]]
    while len(corner):
        owners.append(owner)
        members.append(topology.side_head.take(corner))
        after = topology.corner_after(corner)
        last = np.flatnonzero(after < 0)  # at a boundary: the side before it has no twin
        owners.append(owner.take(last))
        before = corner.take(last)
        members.append(topology.side_tail.take(before + PREVIOUS_OFFSET.take(before % 3)))
        goes_on = np.flatnonzero((after >= 0) & (after != first))
        owner, first, corner = owner.take(goes_on), first.take(goes_on), after.take(goes_on)
    return group_by_key(np.concatenate(owners), np.concatenate(members), len(vertices))


def _distinct_pairs(first: NDArray, second: NDArray, n: int) -> tuple[NDArray, NDArray]:
    """Pairs in ascending order without repetitions; `second` in 0 .. n-1."""
    key = first * np.int64(n) + second
    key.sort()
    is_new = np.ones(len(key), dtype=bool)
    np.not_equal(key[1:], key[:-1], out=is_new[1:])
    first, second = np.divmod(key[is_new], max(n, 1))
    return first, second


def adjacency(topology: Topology) -> csr_array:
    """Adjacency matrix of the vertices, with ones on the diagonal.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    (n, n) csr_array of float32
        One where an edge joins two vertices.
    """
    if topology.gluing is not None:  # whose edges may be several between two vertices
        return _adjacency_of(topology.faces, topology.n_vertices)
    from scipy.sparse import csr_array

    n, (low, high) = topology.n_vertices, topology.edges.T
    start = list_starts(np.bincount(low, minlength=n) + 1)
    # row v: v itself, then its higher neighbours, which the edges list in ascending order
    member = np.empty(start[-1], dtype=np.int64)
    is_own = np.zeros(len(member), dtype=bool)
    is_own[start[:-1]] = True
    member[is_own], member[~is_own] = np.arange(n), high
    column, row_start = (matrix_indices(a, n, 2 * len(member)) for a in (member, start))
    upper = csr_array((np.ones(len(member), dtype=np.float32), column, row_start), shape=(n, n))
    return upper.maximum(upper.T.tocsr())


def _adjacency_of(faces: NDArray, n_vertices: int) -> csr_array:
    from scipy.sparse import csr_array, eye_array

    tail, head = faces.ravel(), faces[:, NEXT].ravel()
    ones = np.ones(2 * len(tail), dtype=np.float32)
    rows, cols = np.concatenate([tail, head]), np.concatenate([head, tail])
    place = tuple(matrix_indices(ends, n_vertices, len(ones)) for ends in (rows, cols))
    matrix = csr_array((ones, place), shape=(n_vertices, n_vertices))
    return (matrix + eye_array(n_vertices, dtype=np.float32, format="csr")).tocsr()


def _rings_by_product(near: csr_array, vertices: NDArray | None, at_least: int, may_grow: NDArray) -> Regions:
    """`two_rings` from products of the adjacency matrix."""
    growing = _without_hubs(near)
    ring = ((near if vertices is None else near[vertices]) @ growing).tocsr()
    rows = np.flatnonzero((np.diff(ring.indptr) < at_least + 1) & may_grow)
    if len(rows) == 0:
        return Regions(ring.indptr.astype(np.int64), ring.indices)
    wider = (ring[rows] @ growing).tocsr()
    return _replaced(ring, rows, wider)


def _without_hubs(near: csr_array) -> csr_array:
    """Rows of hubs emptied but for their own diagonal entry: paths may end there, not pass."""
    count = np.diff(near.indptr)
    hub = count > HUB_VALENCE + 1
    if not hub.any():
        return near
    row = np.repeat(np.arange(len(count)), count)
    keep = ~hub[row] | (near.indices == row)
    indptr = list_starts(np.bincount(row[keep], minlength=len(count)))
    return type(near)((near.data[keep], near.indices[keep], indptr), shape=near.shape)


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
