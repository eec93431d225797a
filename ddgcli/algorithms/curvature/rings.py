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
from ddgcli.mesh.topology import NEXT, Topology

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
    """
    centre = np.arange(topology.n_vertices) if vertices is None else vertices
    faces = topology.faces if vertices is None else _faces_within(topology, vertices, 3)
    mean_degree = 1 + 3 * topology.n_faces / max(topology.n_vertices, 1)
    if len(centre) * mean_degree**2 <= MAX_SORTED_PATHS:
        return _rings_by_sorting(faces, topology.n_vertices, centre, at_least)
    may_grow = topology.referenced_vertex[centre]
    near = adjacency(topology) if vertices is None else _adjacency_of(faces, topology.n_vertices)
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


def _rings_by_sorting(faces: NDArray, n: int, centre: NDArray, at_least: int) -> Regions:
    """`two_rings` from lists of neighbours; pairs of a centre and a member are sorted."""
    tail, head = faces.ravel(), faces[:, NEXT].ravel()
    tail, head = _distinct_pairs(np.concatenate([tail, head]), np.concatenate([head, tail]), n)
    near = list_starts(np.bincount(tail, minlength=n)), head
    is_hub = np.diff(near[0]) > HUB_VALENCE

    def grown(owner: NDArray, member: NDArray) -> tuple[NDArray, NDArray]:
        passes = ~is_hub[member]
        further, reached = expand_lists(owner[passes], member[passes], near)
        return _distinct_pairs(np.concatenate([owner, further]), np.concatenate([member, reached]), n)

    owner = np.arange(len(centre))
    around, neighbour = expand_lists(owner, centre, near)
    owner, member = grown(np.concatenate([owner, around]), np.concatenate([centre, neighbour]))
    count = np.bincount(owner, minlength=len(centre))
    few = (count < at_least + 1) & (near[0][centre + 1] > near[0][centre])
    if few.any():
        grows = few[owner]
        further, reached = grown(owner[grows], member[grows])
        owner, member = np.concatenate([owner[~grows], further]), np.concatenate([member[~grows], reached])
    return Regions(*group_by_key(owner, member, len(centre)))


def _distinct_pairs(first: NDArray, second: NDArray, n: int) -> tuple[NDArray, NDArray]:
    """Pairs in ascending order without repetitions; `second` in 0 .. n-1."""
    key = first * np.int64(n) + second
    key.sort()
    is_new = np.ones(len(key), dtype=bool)
    np.not_equal(key[1:], key[:-1], out=is_new[1:])
    first, second = np.divmod(key[is_new], max(n, 1))
    return first, second


def adjacency(topology: Topology) -> csr_array:
    """(n, n) ones where an edge joins two vertices, and on the diagonal."""
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
