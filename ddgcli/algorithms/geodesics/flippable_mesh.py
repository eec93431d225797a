"""Triangulation with single edge flips and signposts, and shortest edge paths in it."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, sin
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.unfolding import cache_lines
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import ranges
from ddgcli.mesh.sides import next_side

if TYPE_CHECKING:
    from scipy.sparse import csr_array

DETOUR_LIMITS = (1.3, 2.0, inf)  # search an edge path among vertices with at limit this detour, in this order
NEXT, TWIN, FAN, LENGTH, ANGLE, POST = range(6)  # columns of the table of halfedges


class FlippableMesh:
    """Triangulation that changes by flips, with the direction and length of every halfedge on the input.

    Halfedges 0..3m-1 are the sides; each boundary side has one more, without a face. Flips are sequential:
    they read and write scalars through memory views of the columns of a table.

    Attributes
    ----------
    next, twin, fan : memoryview of int64
        `next` is -1 outside the surface; `fan` is the fan of corners at the tail.
    length, angle, post : memoryview of float64
        Length in units of `scale`, the longest side; corner angle at the tail; direction at the tail, as an
        angle in its fan (a signpost).
    """

    def __init__(self, tracer: Tracer) -> None:
        mesh = tracer.mesh
        self.tracer, self.scale, self.sides = tracer, tracer.unfolding.scale, 3 * mesh.n_faces
        twin = mesh.topology.side_twin.ravel()
        self._rim = np.flatnonzero(twin < 0)
        n = self.sides + len(self._rim)
        self._table = cache_lines(n)  # a random halfedge lies in one cache line
        number = self._table.view(np.int64)
        number[: self.sides, TWIN] = twin
        number[self._rim, TWIN] = np.arange(self.sides, n)
        number[self.sides :, TWIN] = self._rim
        self._set(np.arange(n))
        views: list[Any] = [number[:, k].data for k in (NEXT, TWIN, FAN)]
        views += [self._table[:, k].data for k in (LENGTH, ANGLE, POST)]
        self.next, self.twin, self.fan, self.length, self.angle, self.post = views
        total = np.where(tracer.fans.total_angle > 0, tracer.fans.total_angle, 1.0)
        self.total = np.where(tracer.fans.is_open, inf, total).data
        self._vertex_of_fan = tracer.fans.vertex.data
        self.flipped: set[int] = set()
        self._changed: list[int] = []

    def _set(self, h: NDArray) -> None:
        """Set halfedges to those of the input, all but their twins."""
        fans, table, number = self.tracer.fans, self._table, self._table.view(np.int64)
        is_side = h < self.sides
        side = h.copy()
        side[~is_side] = self._rim[h[~is_side] - self.sides]
        following = next_side(side)
        corner = np.where(is_side, side, following)
        width = fans.corner_angle[corner]
        number[h, NEXT] = np.where(is_side, following, -1)
        number[h, FAN] = fans.fan[corner]
        table[h, LENGTH] = self.tracer.unfolding.length[side]
        table[h, ANGLE] = np.where(is_side, width, inf)
        table[h, POST] = fans.angle_before[corner] + np.where(is_side, 0.0, width)

    def rewind(self) -> None:
        """Undo all flips."""
        self._set(np.array(self._changed, dtype=np.int64))
        self.flipped.clear()
        self._changed.clear()

    def edge(self, h: int) -> int:
        """Edge of a halfedge: the lower of its two halfedges."""
        return min(h, self.twin[h])

    def tail(self, h: int) -> int:
        """Vertex that a halfedge leaves."""
        return self._vertex_of_fan[self.fan[h]]

    def turns(self, first: int, last: int) -> tuple[float, float]:
        """Angles counter-clockwise from halfedge `first` to `last` of a vertex and back, by their signposts.

        inf if the boundary lies between, or if the halfedges belong to different fans of the vertex.
        """
        fan = self.fan[first]
        if fan != self.fan[last]:
            return inf, inf
        turn, total = self.post[last] - self.post[first], self.total[fan]
        if total == inf:
            return (turn, inf) if turn >= 0.0 else (inf, -turn)
        turn %= total
        return turn, total - turn

    def wedge(self, first: int, last: int) -> tuple[list[int], float]:
        """Halfedges leaving a vertex counter-clockwise from `first` to `last`, and the angle between them.

        The angle is inf if the boundary lies between.
        """
        following, twin, angle = self.next, self.twin, self.angle
        around, total, h = [first], 0.0, first
        while h != last:
            on = following[h]
            if on < 0:
                return around, inf
            total += angle[h]
            h = twin[following[on]]
            around.append(h)
            if h == first:
                raise MeshError(f"halfedges {first} and {last} do not leave the same fan of a vertex")
        return around, total

    def has_loop(self, halfedges: list[int]) -> bool:
        """True if one of the halfedges, which leave the same fan of a vertex, also ends there."""
        twin, fan = self.twin, self.fan
        return fan[halfedges[0]] in [fan[twin[h]] for h in halfedges]

    def flip(self, h: int) -> bool:
        """Flip the edge of h and return True; False if it has not two different faces.

        The two triangles must form a convex quadrilateral. The new edge splits the angles at its ends, and
        the angles at the ends of the old edge are merged: the angle sums stay.
        """
        following, fan = self.next, self.fan
        length, angle, post = self.length, self.angle, self.post
        t = self.twin[h]
        h1, t1 = following[h], following[t]  # b -> c, a -> d
        if h1 < 0 or t1 < 0:
            return False
        h2, t2 = following[h1], following[t1]  # c -> a, d -> b
        if t in (h1, h2):
            return False
        at_a, at_b, at_c, at_d = angle[h] + angle[t1], angle[t] + angle[h1], angle[h2], angle[t2]
        ca, ad = length[h2], length[t1]
        cosine, sine = cos(at_a), sin(at_a)
        d_along, d_off, c_along = ca - ad * cosine, ad * sine, ad - ca * cosine
        length[h] = length[t] = hypot(d_along, d_off)
        fan[h], fan[t] = fan[t2], fan[h2]
        following[h], following[h2], following[t1] = h2, t1, h  # d -> c -> a
        following[t], following[t2], following[h1] = t2, h1, t  # c -> d -> b
        angle_c, angle_d = atan2(d_off, d_along), atan2(ca * sine, c_along)
        angle_c, angle_d = angle_c if angle_c < at_c else at_c, angle_d if angle_d < at_d else at_d
        angle[t1], angle[h1] = at_a, at_b
        angle[h2], angle[t] = angle_c, at_c - angle_c
        angle[h], angle[t2] = angle_d, at_d - angle_d
        post[h] = post[t2] + angle[t2]
        post[t] = post[h2] + angle_c
        self.flipped.add(h if h < t else t)
        self._changed += (h, t, h1, t1, h2, t2)
        return True


class EdgeGraph:
    """Graph of the edges for paths between way-points; of several edges between two vertices the shortest."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        from scipy.sparse import coo_array

        self.mesh, topology, n = mesh, mesh.topology, mesh.n_vertices
        rim = np.flatnonzero(topology.side_twin.ravel() < 0)
        tail = np.concatenate([topology.side_tail, topology.side_head[rim]])
        head = np.concatenate([topology.side_head, topology.side_tail[rim]])
        length = np.concatenate([mesh.side_length.ravel(), mesh.side_length.ravel()[rim]])
        key = tail * n + head
        order = np.argsort(key, kind="stable")
        if (np.diff(key[order]) == 0).any():  # several edges between two vertices
            order = np.lexsort((length, key))
        key = key[order]
        first = np.concatenate([[True], key[1:] != key[:-1]])
        self.key, self.side = key[first], order[first]
        ends = matrix_indices(tail[self.side], n), matrix_indices(head[self.side], n)
        self.graph = coo_array((length[self.side], ends), shape=(n, n)).tocsr()
        # coordinates in units of the longest side, whose squares are safe
        self._scale = float(length.max(initial=0.0)) or 1.0
        self._columns = None if mesh.points is None else np.ascontiguousarray(mesh.points.T / self._scale)

    def between(self, a: int, b: int) -> int:
        """Halfedge from a to b (3m + k outside the boundary), or -1."""
        key = a * self.mesh.n_vertices + b
        k = int(np.searchsorted(self.key, key))
        return int(self.side[k]) if k < len(self.key) and self.key[k] == key else -1

    def _chords(self, a: int) -> NDArray[np.float64]:
        """(n,) straight distance of each vertex from a, in units of the longest side; 0 without positions."""
        if self._columns is None:
            return np.zeros(self.mesh.n_vertices)
        x, y, z = (column - column[a] for column in self._columns)
        return np.sqrt(x * x + y * y + z * z)

    def _subgraph(self, vertex: NDArray) -> csr_array:
        """The graph on some vertices, in increasing order."""
        from scipy.sparse import csr_array

        n, graph = len(vertex), self.graph
        start = graph.indptr[vertex]
        entry, first = ranges(start, graph.indptr[vertex + 1] - start)
        number = np.full(graph.shape[0], -1, dtype=graph.indices.dtype)
        number[vertex] = np.arange(n)
        head = number[graph.indices[entry]]
        stays = head >= 0
        before = np.zeros(len(head) + 1, dtype=head.dtype)
        np.cumsum(stays, out=before[1:])
        entry = entry[stays]
        return csr_array((graph.data[entry], head[stays], before[np.append(first, len(head))]), shape=(n, n))

    def shortest_path(self, a: int, b: int) -> list[int]:
        """Halfedges of the shortest edge path from a to b.

        The search starts with vertices of small detour, so that paths between near vertices do not visit the
        whole mesh.
        """
        from scipy.sparse.csgraph import dijkstra

        straight = self.between(a, b)
        if straight >= 0:
            return [straight]
        n, from_a, from_b = self.mesh.n_vertices, self._chords(a), self._chords(b)
        way, chord, shortest = from_a + from_b, float(from_a[b]), inf
        for limit in DETOUR_LIMITS:
            limit = min(limit, shortest)
            inside = np.flatnonzero(way <= limit * chord * (1 + 1e-9)) if chord else np.arange(n)
            if 2 * len(inside) > n:  # as much work as the whole
                inside, limit = np.arange(n), inf
            elif np.diff(np.sort(from_a[inside])).max(initial=0.0) > 1 + 1e-9:
                continue  # no edge is as long as the gap between the two parts
            graph = self.graph if limit == inf else self._subgraph(inside)
            start, end = np.searchsorted(inside, [a, b]).tolist()
            distance, before = dijkstra(graph, indices=end, return_predecessors=True)
            if limit == inf or distance[start] <= limit * chord * self._scale:
                break
            shortest = float(distance[start]) / (chord * self._scale) * (1 + 1e-12)  # or less
        if not np.isfinite(distance[start]):
            raise no_path_error(a, b)
        stops = [start]
        while stops[-1] != end:
            stops.append(int(before[stops[-1]]))
        path = inside[stops]
        return self.side[np.searchsorted(self.key, path[:-1] * n + path[1:])].tolist()


def no_path_error(a: int, b: int) -> ParameterError:
    """Error of two way-points that no edge path joins."""
    return ParameterError(
        f"no edge path leads from vertex {a} to vertex {b}; they lie on different components"
    )


def check_waypoints(mesh: SurfaceMesh, waypoints: list[int], closed: bool) -> None:
    """Raise the errors of `edge_path`, without its graph.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    waypoints : list of int
    closed : bool

    Raises
    ------
    ParameterError
    """
    stops = stops_of(waypoints, closed, mesh.n_vertices)
    component, is_used = mesh.topology.vertex_component, mesh.topology.referenced_vertex
    for a, b in zip(stops[:-1], stops[1:], strict=True):
        if component[a] != component[b] or not (is_used[a] and is_used[b]):
            raise no_path_error(a, b)


def stops_of(waypoints: list[int], closed: bool, n: int) -> list[int]:
    """Way-points among n vertices without repetitions, for a loop with the first at the end.

    Raises
    ------
    ParameterError
        When a vertex is out of range, or there are fewer than two vertices.
    """
    bad = [v for v in waypoints if not 0 <= v < n]
    if bad:
        raise ParameterError(f"way-point {bad[0]} does not exist; vertices are 0..{n - 1}")
    stops = [*waypoints, waypoints[0]] if closed and waypoints else list(waypoints)
    stops = [v for k, v in enumerate(stops) if k == 0 or v != stops[k - 1]]
    if len(stops) < 2:
        raise ParameterError("a path needs two different way-points; give more vertices")
    return stops


def edge_path(graph: EdgeGraph, waypoints: list[int], closed: bool) -> list[int]:
    """Halfedges of an edge path through vertices, with shortest edge paths between non-neighbours.

    Parameters
    ----------
    graph : EdgeGraph
    waypoints : list of int
        Vertices in order.
    closed : bool
        Whether the path returns to its first vertex.

    Returns
    -------
    list of int
        Halfedges.

    Raises
    ------
    ParameterError
        When a vertex is out of range, there are fewer than two vertices, or no edge path joins them.
    """
    stops = stops_of(waypoints, closed, graph.mesh.n_vertices)
    return [h for a, b in zip(stops[:-1], stops[1:], strict=True) for h in graph.shortest_path(a, b)]
