"""Distance along edges by Dijkstra's algorithm: an upper bound of the geodesic distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.sources import Sources, VertexDistances, check_sources, corner_distance
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class EdgeDistance(VertexDistances):
    """Distances along edges.

    Parameters
    ----------
    predecessor : (n,) ndarray of int64
        Vertex before v on the shortest edge path; -1 at sources and at unreached vertices.
    """

    predecessor: NDArray[np.int64]


def edge_graph(mesh: SurfaceMesh) -> csr_array:
    """Graph of the edges with their lengths.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n, n) csr_array of float64
        Symmetric; of several edges between two vertices the shortest. Edges of length zero are stored
        explicitly, as scipy.sparse.csgraph requires.
    """
    topology = mesh.topology
    n = max(mesh.n_vertices, 1)
    if topology.gluing is None and isinstance(mesh, TriangleMesh):  # one edge at most joins two vertices
        low, high = topology.edges.T
        length = np.zeros(len(low))
        length[topology.side_edge] = mesh.side_length
        use = low != high
        return _graph(low[use], high[use], length[use], n)
    tail, head = topology.side_tail, topology.side_head
    low, high, length = np.minimum(tail, head), np.maximum(tail, head), mesh.side_length.ravel()
    order = np.lexsort((length, low * n + high))
    key = (low * n + high)[order]
    first = order[np.concatenate([[True], key[1:] != key[:-1]])] if len(order) else order
    first = first[low[first] != high[first]]
    return _graph(low[first], high[first], length[first], n)


def _graph(i: NDArray, j: NDArray, length: NDArray, n: int) -> csr_array:
    from scipy.sparse import coo_array

    ends = matrix_indices(np.concatenate([i, j]), n), matrix_indices(np.concatenate([j, i]), n)
    return coo_array((np.tile(length, 2), ends), shape=(n, n)).tocsr()


def edge_distance(
    mesh: SurfaceMesh, sources: Sources | NDArray | list[int] | int, *, graph: csr_array | None = None
) -> EdgeDistance:
    """Shortest distance along edges from each vertex to the nearest source.

    A source inside a face is connected to the corners of the face by straight lines. A source edge is its two
    ends.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources, vertex index or array of vertex indices
    graph : csr_array, optional
        `edge_graph(mesh)`, shared by several calls; or that of another triangulation of the surface, whose
        first vertices are those of the mesh.

    Returns
    -------
    EdgeDistance
        Never below the exact distance.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    sources = check_sources(mesh, sources)
    points = sources.points
    graph = edge_graph(mesh) if graph is None else graph
    n = graph.shape[0]
    if len(points):
        length = mesh.side_length[points.face]
        scale = float(length.max()) or 1.0  # squares of lengths leave the range before lengths do
        reach = scale * corner_distance(length / scale, points.barycentric)
        size = n + len(points)
        rows = np.repeat(n + np.arange(len(points)), 3)
        spokes = coo_array((reach.ravel(), (rows, mesh.faces[points.face].ravel())), shape=(size, size))
        wide = coo_array(graph)
        value = np.concatenate([wide.data, spokes.data])
        row, col = np.concatenate([wide.row, spokes.row]), np.concatenate([wide.col, spokes.col])
        ends = matrix_indices(row, size), matrix_indices(col, size)
        graph = coo_array((value, ends), shape=(size, size)).tocsr()
    of_curves, number_of_curve = sources.curve_vertices(mesh)
    start = np.concatenate([sources.vertex, n + np.arange(len(points)), of_curves])
    numbers = np.concatenate([np.arange(sources.first_curve), number_of_curve])
    unique, first = np.unique(start, return_index=True)
    distance, before, root = dijkstra(graph, indices=unique, return_predecessors=True, min_only=True)
    index = np.full(graph.shape[0] + 1, -1)
    index[unique] = numbers[first]
    n = mesh.n_vertices
    reached = np.isfinite(distance[:n])
    root = np.where(reached, root[:n], -1)
    before = np.where((before[:n] >= 0) & (before[:n] < n), before[:n], -1).astype(np.int64)
    return EdgeDistance(distance[:n], index[root], before)


def downhill_source(mesh: SurfaceMesh, distance: NDArray, sources: Sources) -> NDArray[np.int64]:
    """Source at the end of steepest descent along edges from each vertex.

    Vertices whose descent ends elsewhere (an approximate distance may have other minima) take the nearest
    source along edges.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    distance : (n,) ndarray of float64
    sources : Sources

    Returns
    -------
    (n,) ndarray of int64
        Index of the source; -1 where the distance is inf.
    """
    n = mesh.n_vertices
    reached = np.isfinite(distance)
    if len(sources) == 1:
        return np.where(reached, 0, -1)
    tail, head = mesh.topology.side_tail, mesh.topology.side_head
    a, b = np.concatenate([tail, head]), np.concatenate([head, tail])
    length = np.tile(mesh.side_length.ravel(), 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (distance[a] - distance[b]) / length
    down = np.flatnonzero(slope > 0)
    order = down[np.lexsort((-slope[down], a[down]))]
    vertex, first = np.unique(a[order], return_index=True)
    tree_root = np.arange(n)
    tree_root[vertex] = b[order[first]]
    label = np.full(n, -1, dtype=np.int64)
    for index in range(len(sources) - 1, -1, -1):
        label[sources.corners(mesh, index)] = index
    tree_root[label >= 0] = np.flatnonzero(label >= 0)
    while not np.array_equal(tree_root[tree_root], tree_root):
        tree_root = tree_root[tree_root]
    nearest = label[tree_root]
    missing = reached & (nearest < 0)
    if missing.any():
        nearest[missing] = edge_distance(mesh, sources).nearest_source[missing]
    return np.where(reached, nearest, -1)
