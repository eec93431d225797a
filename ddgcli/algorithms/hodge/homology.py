"""Homology of surfaces and solids: Betti numbers, generators, closed cochains (chapters 7 and 8).

Generators of a surface come from a tree-cotree decomposition (Eppstein 2003; Erickson and Whittlesey 2005): a
shortest-path tree of the edges, a spanning tree of the dual edges that avoids it, and the edges in neither.
`tangential` refers to absolute (co)homology, `normal` to the homology relative to the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    dijkstra,
    minimum_spanning_tree,
)

from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology

Boundary = str  # one of FIELD_BOUNDARIES


@dataclass(frozen=True)
class BettiNumbers:
    """Ranks of homology over a field, by degree; `relative` to the boundary."""

    absolute: tuple[int, ...]
    relative: tuple[int, ...]

    def of_boundary(self, boundary: Boundary) -> tuple[int, ...]:
        """Numbers of independent harmonic fields, by degree, under a boundary condition."""
        return self.absolute if boundary == "tangential" else self.relative


def betti_numbers(mesh: SurfaceMesh | TetMesh, modulo_2: bool = False) -> BettiNumbers:
    """Betti numbers, over the rationals or over the integers modulo 2, of a surface or a solid.

    Surfaces are manifold (any orientation, with or without boundary); solids consist of tetrahedra. Those of
    surfaces follow from the components, the closed components and the Euler characteristic; those of solids
    from duality: each boundary surface beyond the first of a component encloses one cavity. Both fields give
    the same numbers except on surfaces that are not orientable, whose homology has torsion 2.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
    modulo_2 : bool
        Over the integers modulo 2 instead of the rationals.

    Returns
    -------
    BettiNumbers
    """
    return _solid_betti(mesh) if isinstance(mesh, TetMesh) else _surface_betti(mesh.topology, modulo_2)


def _surface_betti(topology: Topology, modulo_2: bool) -> BettiNumbers:
    count = topology.n_components
    open_component = np.zeros(count, dtype=bool)
    open_component[topology.vertex_component[topology.edges[topology.boundary_edges, 0]]] = True
    orientable = topology.orientable_component | modulo_2
    closed, euler = int((~open_component).sum()), topology.euler_characteristic
    b2 = int((orientable & ~open_component).sum())
    relative2 = int(orientable.sum())
    return BettiNumbers((count, count + b2 - euler, b2), (closed, closed + relative2 - euler, relative2))


def _solid_betti(mesh: TetMesh) -> BettiNumbers:
    tets = mesh.tetrahedra
    n = mesh.n_vertices
    rows, cols = tets[:, [0, 0, 0]].ravel(), tets[:, 1:].ravel()
    label = connected_labels(rows, cols, n)[1]
    count = int(np.count_nonzero(np.bincount(label[tets[:, 0]])))
    surface = mesh.boundary.topology
    cavities = surface.n_components - count
    euler = (
        int(np.count_nonzero(np.bincount(tets.ravel()))) - len(mesh.edges) + len(mesh.triangles) - len(tets)
    )
    absolute = (count, count + cavities - euler, cavities, 0)
    return BettiNumbers(absolute, absolute[::-1])


@dataclass(frozen=True, eq=False)
class TreeCotree:
    """Edges of a surface split into a tree, a dual tree and the rest: one generator per remaining edge.

    Attributes
    ----------
    generator_edges : (b,) ndarray of int64
    vertex_parent : (n,) ndarray of int64
        The tree; -1 at roots.
    face_parent, face_parent_edge : (m + outer,) ndarray of int64
        The dual tree over faces and, for tangential generators, one outer node for each component with
        boundary.
    edge_face : (e, 2) ndarray of int64
        The dual nodes of each edge; -1 where there is none.
    edge_face_sign : (e, 2) ndarray
        How the face runs along the edge.
    """

    generator_edges: NDArray[np.int64]
    vertex_parent: NDArray[np.int64]
    face_parent: NDArray[np.int64]
    face_parent_edge: NDArray[np.int64]
    edge_face: NDArray[np.int64]
    edge_face_sign: NDArray[np.int64]


def tree_cotree(mesh: SurfaceMesh, boundary: Boundary = "tangential") -> TreeCotree:
    """Tree-cotree decomposition of an oriented manifold surface, with short generators.

    For `normal` the boundary is one point of the tree and no dual edge crosses it.
    """
    topology = mesh.topology
    length = np.zeros(topology.n_edges)
    length[topology.side_edge.ravel()] = mesh.side_length.ravel()
    node = np.arange(topology.n_vertices)
    allowed = np.ones(topology.n_edges, dtype=bool)
    if boundary == "normal" and len(topology.boundary_edges):
        allowed[topology.boundary_edges] = False
        node = _boundary_merged(topology)
    parent, parent_edge, distance = _shortest_tree(node[topology.edges], length, allowed, topology.n_vertices)
    edge_face, sign = _dual_edges(topology, outer=boundary == "tangential")
    in_tree = np.zeros(topology.n_edges, dtype=bool)
    in_tree[parent_edge[parent_edge >= 0]] = True
    loop = distance[node[topology.edges]].sum(axis=1) + length
    usable = allowed & ~in_tree
    face_parent, face_parent_edge = _spanning_forest(edge_face, -loop, usable)
    usable[face_parent_edge[face_parent_edge >= 0]] = False
    return TreeCotree(np.flatnonzero(usable), parent, face_parent, face_parent_edge, edge_face, sign)


def _boundary_merged(topology: Topology) -> NDArray[np.int64]:
    """(n,) vertex indices with the boundary of each component merged into one of its vertices."""
    node = np.arange(topology.n_vertices)
    rim = np.flatnonzero(topology.boundary_vertex)
    component = topology.vertex_component[rim]
    first = np.full(topology.n_components, topology.n_vertices)
    np.minimum.at(first, component, rim)
    node[rim] = first[component]
    return node


def _dual_edges(topology: Topology, outer: bool) -> tuple[NDArray, NDArray]:
    """(e, 2) dual nodes of each edge and the sign with which the face runs along it."""
    edge_face = np.full((topology.n_edges, 2), -1, dtype=np.int64)
    sign = np.zeros((topology.n_edges, 2), dtype=np.int64)
    side_edge, side_sign = topology.side_edge.ravel(), topology.side_sign.ravel()
    column = (side_sign < 0).astype(np.int64)
    twin = topology.side_twin.ravel()
    # on one-sided surfaces both faces may run along the edge the same way
    clash = (twin >= 0) & (side_sign == side_sign[twin])
    column[clash] = np.flatnonzero(clash) > twin[clash]
    edge_face[side_edge, column] = np.arange(len(side_edge)) // 3
    sign[side_edge, column] = side_sign
    if outer:
        rim = topology.boundary_edges
        component = topology.vertex_component[topology.edges[rim, 0]]
        empty = np.where(edge_face[rim, 0] < 0, 0, 1)
        edge_face[rim, empty] = topology.n_faces + component
    return edge_face, sign


def _lightest(ends: NDArray, weight: NDArray, usable: NDArray) -> NDArray[np.int64]:
    """Indices of the usable edges that are lightest between their two (different) nodes."""
    index = np.flatnonzero(usable & (ends[:, 0] != ends[:, 1]) & (ends >= 0).all(axis=1))
    low, high = ends[index].min(axis=1), ends[index].max(axis=1)
    order = np.lexsort((index, weight[index], high, low))
    low, high = low[order], high[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    return index[order[first]]


def _shortest_tree(
    ends: NDArray, length: NDArray, allowed: NDArray, n: int
) -> tuple[NDArray, NDArray, NDArray]:
    """Shortest-path forest from the first node of each component: parents, parent edges, distances."""
    lightest = _lightest(ends, length, allowed)
    a, b = matrix_indices(ends[lightest].T, n)
    # the sparse graph drops edges of length zero
    weight = np.maximum(length[lightest], np.finfo(float).tiny)
    graph = csr_array((weight, (a, b)), shape=(n, n))
    label = connected_labels(a, b, n)[1]
    _, root = np.unique(label, return_index=True)
    distance, predecessor, _ = dijkstra(
        graph, directed=False, indices=root, min_only=True, return_predecessors=True
    )
    parent = np.where(predecessor < 0, -1, predecessor).astype(np.int64)
    return parent, _edges_between(parent, ends, lightest), distance


def _edges_between(parent: NDArray, ends: NDArray, lightest: NDArray) -> NDArray[np.int64]:
    """(n,) the edge of `lightest` between each node and its parent; -1 at roots."""
    n = np.int64(len(parent))
    key = ends[lightest].min(axis=1) * n + ends[lightest].max(axis=1)
    order = np.argsort(key)
    child = np.flatnonzero(parent >= 0)
    tree_key = np.minimum(child, parent[child]) * n + np.maximum(child, parent[child])
    result = np.full(len(parent), -1, dtype=np.int64)
    result[child] = lightest[order[np.searchsorted(key[order], tree_key)]]
    return result


def _spanning_forest(ends: NDArray, weight: NDArray, usable: NDArray) -> tuple[NDArray, NDArray]:
    """Minimum spanning forest, rooted: parents and parent edges of the nodes 0 .. max."""
    n = int(ends.max(initial=-1)) + 1
    lightest = _lightest(ends, weight, usable)
    rank = np.empty(len(lightest))
    rank[np.lexsort((lightest, weight[lightest]))] = np.arange(1, len(lightest) + 1)
    graph = csr_array((rank, tuple(matrix_indices(ends[lightest].T, n))), shape=(n, n))
    tree = minimum_spanning_tree(graph)
    tail, head = tree.nonzero()
    count, label = connected_labels(tail, head, n)
    # the root is an outer node, if there is one: cochains need not balance there
    root = np.full(count, -1, dtype=np.int64)
    np.maximum.at(root, label, np.arange(n))
    # one more node joins all roots: a search for each component would cost their number squared
    rows, columns = np.append(tail, np.full(count, n)), np.append(head, root)
    places = matrix_indices(rows, n + 1), matrix_indices(columns, n + 1)
    joined = csr_array((np.ones(len(rows)), places), shape=(n + 1, n + 1))
    _, before = breadth_first_order(joined, n, directed=False)
    parent = np.where((before[:n] >= 0) & (before[:n] < n), before[:n], -1).astype(np.int64)
    return parent, _edges_between(parent, ends, lightest)


def closed_cochains(mesh: SurfaceMesh, boundary: Boundary = "tangential") -> csr_array:
    """Closed integer 1-forms that span the rational cohomology, one for each class.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    boundary : {'tangential', 'normal'}

    Returns
    -------
    (e, b) csr_array of float
        Integers on the edges that a dual loop crosses, so that the sum around every face is zero. For
        `tangential` dual loops may run through the boundary; for `normal` they may not, and the columns
        vanish on boundary edges. A dual loop that turns the orientation over closes up with a second one
        only: a component without an orientation has one class fewer than generators.
    """
    trees = tree_cotree(mesh, boundary)
    columns: list[tuple[NDArray, NDArray]] = []
    unbalanced: dict[int, tuple[NDArray, NDArray, int]] = {}
    for edge in trees.generator_edges.tolist():
        crossed, value, root, rest = _dual_cochain(trees, edge, mesh.n_faces)
        if rest and root not in unbalanced:
            unbalanced[root] = crossed, value, rest
            continue
        if rest:
            other, its_value, its_rest = unbalanced[root]
            share = -rest // its_rest  # both are 2 or -2
            crossed, value = np.concatenate([crossed, other]), np.concatenate([value, share * its_value])
        columns.append((crossed, value))
    shape = (mesh.topology.n_edges, len(columns))
    if not columns:
        return csr_array(shape)
    rows, values = (np.concatenate([column[k] for column in columns]) for k in (0, 1))
    index = np.repeat(np.arange(len(columns)), [len(crossed) for crossed, _ in columns])
    matrix = csr_array(coo_array((values.astype(float), (rows, index)), shape=shape))
    matrix.eliminate_zeros()
    return matrix


def _dual_cochain(trees: TreeCotree, edge: int, n_faces: int) -> tuple[NDArray, NDArray, int, int]:
    """Values with sum zero around every face except the root, and 1 on `edge`.

    They follow both paths from the edge up the dual tree.

    Returns
    -------
    edges, values : (k,) ndarray of int64
        An edge on both paths occurs twice.
    root : int
        End of the paths.
    rest : int
        Sum around the root; 0 if the root is an outer node.
    """
    edges, values, rest, root = [edge], [1], 0, -1
    for column in (0, 1):
        via, value, node = edge, 1, int(trees.edge_face[edge, column])
        while True:
            inward = value * _sign_at(trees, via, node)
            if trees.face_parent[node] < 0:
                break
            via = int(trees.face_parent_edge[node])
            value = -inward * _sign_at(trees, via, node)
            edges.append(via)
            values.append(value)
            node = int(trees.face_parent[node])
        root = node
        rest += inward if node < n_faces else 0
    return np.array(edges), np.array(values), root, rest


def _sign_at(trees: TreeCotree, edge: int, node: int) -> int:
    """Sign with which the face `node` runs along an edge; that of an outer node is opposite to the face's."""
    column = 0 if trees.edge_face[edge, 0] == node else 1
    return int(trees.edge_face_sign[edge, column] or -trees.edge_face_sign[edge, 1 - column])


def _path_to_root(parent: NDArray, node: int) -> list[int]:
    path = [int(node)]
    while parent[path[-1]] >= 0:
        path.append(int(parent[path[-1]]))
    return path


def generator_loops(mesh: SurfaceMesh) -> list[NDArray[np.int64]]:
    """Closed edge loops that generate the first homology.

    On a closed component that is not orientable one of them, or their sum, has finite order: their number
    exceeds the rational Betti number by one.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Manifold.

    Returns
    -------
    list of (k,) ndarray of int64
        Vertices of each loop in order; the start is not repeated.
    """
    trees = tree_cotree(mesh, "tangential")
    edges = mesh.topology.edges
    return [_tree_loop(trees.vertex_parent, *edges[edge]) for edge in trees.generator_edges]


def loops_with_periods(
    edges: NDArray, length: NDArray, forms: NDArray, n_vertices: int
) -> list[NDArray[np.int64]]:
    """Edge loops on which closed forms have independent periods: short ones first.

    Parameters
    ----------
    edges : (e, 2) ndarray of int64
    length : (e,) ndarray
    forms : (e, b) ndarray
        Closed 1-forms in independent classes.
    n_vertices : int

    Returns
    -------
    list of ndarray
        b loops of vertices in order, start not repeated: a rational basis of the first homology.
    """
    count = forms.shape[1]
    if count == 0:
        return []
    allowed = np.ones(len(edges), dtype=bool)
    parent, parent_edge, distance = _shortest_tree(edges, length, allowed, n_vertices)
    potential = _tree_integral(parent, parent_edge, edges, forms)
    period = forms - (potential[edges[:, 1]] - potential[edges[:, 0]])
    size = np.abs(period).max(axis=1)
    candidates = np.flatnonzero(size > 1e-6 * size.max())
    candidates = candidates[np.argsort(distance[edges[candidates]].sum(axis=1) + length[candidates])]
    generator_edges: list[int] = []
    spanned = np.zeros((count, 0))
    for edge in candidates:
        row = period[edge] / np.linalg.norm(period[edge])
        rest = row - spanned @ (spanned.T @ row)
        if np.linalg.norm(rest) > 1e-6:
            generator_edges.append(int(edge))
            spanned = np.column_stack([spanned, rest / np.linalg.norm(rest)])
        if len(generator_edges) == count:
            break
    return [_tree_loop(parent, *edges[edge]) for edge in generator_edges]


def _tree_integral(
    parent: NDArray, parent_edge: NDArray, edges: NDArray, forms: NDArray
) -> NDArray[np.float64]:
    """(n, b) integral of forms along the tree from its roots, by pointer doubling."""
    total = np.zeros((len(parent), forms.shape[1]))
    child = np.flatnonzero(parent >= 0)
    edge = parent_edge[child]
    sign = np.where(edges[edge, 1] == child, 1.0, -1.0)
    total[child] = sign[:, None] * forms[edge]
    above = np.where(parent < 0, np.arange(len(parent)), parent)
    while (above != above[above]).any():
        total = total + np.where((above != np.arange(len(above)))[:, None], total[above], 0.0)
        above = above[above]
    return total


def _tree_loop(parent: NDArray, tail: int, head: int) -> NDArray[np.int64]:
    """Vertices of the loop that an edge closes with the tree."""
    up_tail, up_head = _path_to_root(parent, tail), _path_to_root(parent, head)
    while len(up_tail) > 1 and len(up_head) > 1 and up_tail[-2] == up_head[-2]:
        up_tail.pop()
        up_head.pop()
    return np.array([*reversed(up_tail), *up_head[:-1]], dtype=np.int64)
