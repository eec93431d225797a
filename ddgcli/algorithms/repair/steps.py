"""Repair steps: each takes a mesh and returns the changed mesh with maps to it and the number of changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
from scipy.spatial import cKDTree

from ddgcli.geometry.extrinsic import dihedral_angle, folded_edges
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.ragged import repeated_rows
from ddgcli.mesh.repair import faces_to_turn, merged_points, reverse_faces
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A mesh and where its vertices and faces come from.

    Parameters
    ----------
    mesh : TriangleMesh
    input_vertex : (n,) ndarray of int64
        Vertex of the input; -1 for a vertex that the repair added.
    input_face : (m,) ndarray of int64
        Face of the input; -1 for a face that the repair added.
    changes : int
        Vertices or faces that the last step changed.
    """

    mesh: TriangleMesh
    input_vertex: NDArray[np.int64]
    input_face: NDArray[np.int64]
    changes: int = 0

    @classmethod
    def unchanged(cls, mesh: TriangleMesh) -> RepairedMesh:
        """The input itself."""
        return cls(mesh, np.arange(mesh.n_vertices), np.arange(mesh.n_faces))


def _of_faces(repaired: RepairedMesh, face_mask: NDArray[np.bool_]) -> RepairedMesh:
    """Mesh of the faces of an (m,) mask, with all vertices."""
    mesh = TriangleMesh.from_arrays(repaired.mesh.points, repaired.mesh.faces[face_mask])
    return RepairedMesh(mesh, repaired.input_vertex, repaired.input_face[face_mask], int((~face_mask).sum()))


def weld(repaired: RepairedMesh, distance: float = 0.0) -> RepairedMesh:
    """Merge vertices at the same place, or joined by gaps of at most a distance.

    A merged vertex keeps the position of the one with the lowest index.

    Parameters
    ----------
    repaired : RepairedMesh
    distance : float
        In length units.

    Returns
    -------
    RepairedMesh
    """
    points = repaired.mesh.points
    first, group = near_vertices(points, distance)
    mesh = TriangleMesh.from_arrays(points[first], group[repaired.mesh.faces])
    return RepairedMesh(mesh, repaired.input_vertex[first], repaired.input_face, len(points) - len(first))


def near_vertices(points: NDArray, distance: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Groups of points at the same place, or joined by gaps of at most a distance.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    distance : float

    Returns
    -------
    first : (k,) ndarray of int64
        Lowest index of each group, ascending.
    group : (n,) ndarray of int64
    """
    if distance == 0.0:
        _, group = merged_points(points)
    else:
        pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
        label = connected_labels(pairs[:, 0], pairs[:, 1], len(points))[1]
        _, first, group = np.unique(label, return_index=True, return_inverse=True)
        group = np.argsort(np.argsort(first))[group]
    first = np.full(int(group.max(initial=-1)) + 1, len(points))
    np.minimum.at(first, group, np.arange(len(points)))
    return first, group


def drop_degenerate(repaired: RepairedMesh) -> RepairedMesh:
    """Remove faces with a repeated vertex, or with an area below 1e-12 of the longest side squared.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    faces = repaired.mesh.faces
    has_area = (faces != faces[:, NEXT]).all(axis=1)
    has_area[repaired.mesh.flat_faces] = False
    return _of_faces(repaired, has_area)


def drop_duplicates(repaired: RepairedMesh) -> RepairedMesh:
    """Remove faces whose three vertices an earlier face has.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    is_first = np.ones(repaired.mesh.n_faces, dtype=bool)
    is_first[repeated_rows(np.sort(repaired.mesh.faces, axis=1))] = False
    return _of_faces(repaired, is_first)


def drop_unused(repaired: RepairedMesh) -> RepairedMesh:
    """Remove vertices that no face uses.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    referenced = repaired.mesh.topology.referenced_vertex
    index = np.cumsum(referenced) - 1
    mesh = TriangleMesh.from_arrays(repaired.mesh.points[referenced], index[repaired.mesh.faces])
    return RepairedMesh(
        mesh, repaired.input_vertex[referenced], repaired.input_face, int((~referenced).sum())
    )


def keep_largest(repaired: RepairedMesh) -> RepairedMesh:
    """Keep the component with the largest area.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    mesh = repaired.mesh
    if mesh.n_faces == 0:
        return repaired
    area = np.linalg.norm(row_cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1]), axis=1)
    component = mesh.topology.face_component
    return _of_faces(repaired, component == np.bincount(component, weights=area).argmax())


def orient(repaired: RepairedMesh) -> RepairedMesh:
    """Turn over the fewer faces of each piece so that every orientable piece is consistently oriented.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    turn = faces_to_turn(repaired.mesh)
    mesh = reverse_faces(repaired.mesh, turn)
    return RepairedMesh(mesh, repaired.input_vertex, repaired.input_face, int(turn.sum()))


def separated(
    repaired: RepairedMesh, joined: NDArray[np.bool_], pairs: NDArray[np.int64] | None = None
) -> RepairedMesh:
    """The mesh with one vertex for each set of corners that meet across joined edges.

    The first set of a vertex keeps its index; the others follow after all vertices.

    Parameters
    ----------
    repaired : RepairedMesh
    joined : (e,) ndarray of bool
        Edges of two faces to keep.
    pairs : (k, 2) ndarray of int64, optional
        Flat indices of two sides of an edge of more faces, which stay joined.

    Returns
    -------
    RepairedMesh
        `changes` counts the new vertices.
    """
    mesh, topology = repaired.mesh, repaired.mesh.topology
    side = np.flatnonzero((topology.side_twin.ravel() >= 0) & joined[topology.side_edge.ravel()])
    twin = topology.side_twin.ravel()[side]
    if pairs is not None:
        side, twin = np.concatenate([side, pairs[:, 0]]), np.concatenate([twin, pairs[:, 1]])
    head = 3 * (np.arange(3 * mesh.n_faces) // 3) + NEXT[np.arange(3 * mesh.n_faces) % 3]
    opposite = topology.side_tail[side] != topology.side_tail[twin]
    rows = np.concatenate([side, head[side]])
    cols = np.concatenate([np.where(opposite, head[twin], twin), np.where(opposite, twin, head[twin])])
    fan = connected_labels(rows, cols, 3 * mesh.n_faces)[1]
    _, first = np.unique(fan, return_index=True)
    vertex = mesh.faces.ravel()[first]
    order = np.lexsort((first, vertex))
    further = order[1:][vertex[order[1:]] == vertex[order[:-1]]]
    index = vertex.copy()
    index[further] = mesh.n_vertices + np.arange(len(further))
    source = np.concatenate([np.arange(mesh.n_vertices), vertex[further]])
    split = TriangleMesh.from_arrays(mesh.points[source], index[fan].reshape(-1, 3))
    return RepairedMesh(split, repaired.input_vertex[source], repaired.input_face, len(further))


def split_folds(repaired: RepairedMesh) -> RepairedMesh:
    """Separate the faces at edges folded by 180 degrees, so that each sheet has a boundary there.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    folded = folded_edges(dihedral_angle(repaired.mesh))
    repaired = separated(repaired, ~np.isin(np.arange(repaired.mesh.topology.n_edges), folded))
    changes = repaired.changes
    folded = folded_edges(dihedral_angle(repaired.mesh))
    if len(folded):  # edges whose faces also meet around both ends
        repaired = separated_at(repaired, repaired.mesh.topology.edges[folded, 0])
        changes += repaired.changes
    return RepairedMesh(repaired.mesh, repaired.input_vertex, repaired.input_face, changes)


def separated_at(repaired: RepairedMesh, vertices: NDArray[np.int64]) -> RepairedMesh:
    """The mesh with a copy of some vertices for each of their faces.

    Parameters
    ----------
    repaired : RepairedMesh
    vertices : (k,) ndarray of int64

    Returns
    -------
    RepairedMesh
    """
    is_end = np.zeros(repaired.mesh.n_vertices, dtype=bool)
    is_end[vertices] = True
    low, high = repaired.mesh.topology.edges.T
    return separated(repaired, ~(is_end[low] | is_end[high]))


def cut_to_disk(repaired: RepairedMesh) -> RepairedMesh:
    """Cut every component of a manifold surface along short loops of edges so that it becomes a disk.

    The cut graph is the tree-cotree decomposition [D. Eppstein, "Dynamic generators of topologically embedded
    graphs", 2003] without its dead ends. A closed sphere is opened along two edges.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    topology = repaired.mesh.topology
    cut = _cut_graph(repaired.mesh)
    closed = ~np.isin(np.arange(topology.n_components), topology.vertex_component[topology.boundary_vertex])
    uncut = np.bincount(topology.vertex_component[topology.edges[cut, 0]], minlength=topology.n_components)
    for component in np.flatnonzero(closed & (uncut == 0)):
        middle = np.flatnonzero(topology.vertex_component == component)[0]
        spokes = np.flatnonzero((topology.edges == middle).any(axis=1))
        cut[spokes[[0, len(spokes) // 2]]] = True
    opened = separated(repaired, ~cut)
    disk = reverse_faces(opened.mesh, opened.mesh.topology.faces_to_turn)  # pieces that were one-sided
    return RepairedMesh(disk, opened.input_vertex, opened.input_face, opened.changes)


def _cut_graph(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """(e,) edges to cut so that each component becomes a disk; none for closed spheres and disks."""
    topology = mesh.topology
    side = np.flatnonzero(topology.side_twin.ravel() > np.arange(3 * mesh.n_faces))
    twin, edge = topology.side_twin.ravel()[side], topology.side_edge.ravel()[side]
    # a spanning tree of the faces that crosses edges of the paths' forest last, so never
    last = np.argsort(_shortest_forest(mesh)[edge], kind="stable")
    rank = np.empty(len(edge))
    rank[last] = 1.0 + np.arange(len(edge))  # positive: a zero entry is not an edge of a sparse graph
    graph = _lightest_edges(side // 3, twin // 3, rank, mesh.n_faces)
    crossed = np.isin(rank, minimum_spanning_tree(graph).data)
    cut = np.zeros(topology.n_edges, dtype=bool)
    cut[edge[~crossed]] = True
    while True:
        cut_or_boundary = cut.copy()
        cut_or_boundary[topology.boundary_edges] = True
        degree = np.bincount(topology.edges[cut_or_boundary].ravel(), minlength=mesh.n_vertices)
        leaf_edge = cut & (degree[topology.edges] == 1).any(axis=1)
        if not leaf_edge.any():
            return cut
        cut &= ~leaf_edge


def _shortest_forest(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """(e,) edges of shortest paths from the boundary, and from one vertex of each closed component."""
    topology = mesh.topology
    roots = topology.boundary_vertex.copy()
    open_component = topology.vertex_component[roots]
    component, first = np.unique(topology.vertex_component, return_index=True)
    roots[first[(component >= 0) & ~np.isin(component, open_component)]] = True
    low, high = topology.edges.T
    length = np.linalg.norm(mesh.points[high] - mesh.points[low], axis=1) + np.finfo(float).tiny
    graph = _lightest_edges(low, high, length, mesh.n_vertices)
    before = dijkstra(
        graph, directed=False, indices=np.flatnonzero(roots), return_predecessors=True, min_only=True
    )[1]
    return (before[low] == high) | (before[high] == low)


def _lightest_edges(tail: NDArray, head: NDArray, weight: NDArray, n: int) -> csr_array:
    """(n, n) graph with the lightest of several edges between two nodes."""
    low, high = (matrix_indices(end, n) for end in (np.minimum(tail, head), np.maximum(tail, head)))
    order = np.lexsort((weight, high, low))
    low, high, weight = low[order], high[order], weight[order]
    first = np.ones(len(low), dtype=bool)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    return csr_array((weight[first], (low[first], high[first])), shape=(n, n))
