"""Triangulation with single edge flips and signposts, and shortest edge paths in it."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, inf, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import MeshError, ParameterError
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import ranges, unique_keys

DETOUR_LIMITS = (0.2, 0.6, inf)  # in straight distances: detours of the edge paths to search, in this order


class Halfedge:
    """Directed edge of a triangle in a triangulation that changes by flips.

    Attributes
    ----------
    index : int
        Flat index of the side on the input; beyond the sides for those outside the surface.
    next, twin : Halfedge
        `next` is None outside the surface, `twin` until `FlippableMesh.twin` crosses the edge.
    fan : int
        Fan of corners at the tail.
    length, angle, post : float
        Length in units of `FlippableMesh.scale`; corner angle at the tail; direction at the tail, as an angle
        in its fan (a signpost).
    uses : int
        Number of times that the path to straighten runs along the edge, in either direction.
    is_flipped : bool
        The edge is not one of the input.
    """

    __slots__ = ("angle", "fan", "is_flipped", "length", "next", "index", "post", "twin", "uses")

    index: int
    next: Any
    twin: Any
    fan: int
    length: float
    angle: float
    post: float
    uses: int
    is_flipped: bool


class FlippableMesh:
    """Triangulation that changes by flips, with the direction and length of every halfedge on the input.

    Halfedges 0..3m-1 are the sides; each boundary side has one more, without a face. Flips are sequential,
    and touch a small share of the mesh: halfedges are created where an algorithm comes to their faces.

    Attributes
    ----------
    scale : float
        The longest side, the unit of lengths.
    """

    def __init__(self, tracer: Tracer) -> None:
        self.tracer, self.scale, self.sides = tracer, tracer.unfolding.scale, 3 * tracer.mesh.n_faces
        fans, twin = tracer.fans, tracer.mesh.topology.side_twin.ravel()
        self._rim, self._side_twin = np.flatnonzero(twin < 0), twin.data
        # of each side: twin, fan, length, angle and signpost
        self._columns = [twin, fans.fan, tracer.unfolding.length, fans.corner_angle, fans.angle_before]
        self._views = [column.data for column in self._columns]  # less time than arrays for a few sides
        self._total = np.where(fans.is_open, inf, np.where(fans.total_angle > 0, fans.total_angle, 1.0)).data
        self._vertex_of_fan = fans.vertex.data
        self._halfedges: dict[int, Halfedge] = {}

    def halfedges(self, indices: list[int]) -> list[Halfedge]:
        """Halfedges by their indices, with the faces around their tails."""
        fans, side = self.tracer.fans, np.array(indices, dtype=np.int64)
        outside = side >= self.sides
        side[outside] = self._rim[side[outside] - self.sides]
        fan = fans.fan[side]
        start = fans.start[fan]
        corner = fans.corner[ranges(start, fans.start[fan + 1] - start)[0]]
        side = unique_keys(3 * (corner // 3))
        if self._halfedges:
            side = side[[k not in self._halfedges for k in side.tolist()]]
        side = (side[:, None] + np.arange(3)).ravel()
        self._create(side.tolist(), *(column.take(side).tolist() for column in self._columns))
        return [self._halfedges[k] for k in indices]

    def twin(self, h: Halfedge) -> Halfedge:
        """Opposite halfedge of the same edge."""
        if h.twin is None:
            side = self._side_twin[h.index]
            first = side - side % 3
            end = first + 3
            self._create(range(first, end), *(view[first:end].tolist() for view in self._views))
        return h.twin

    def _create(self, indices: Sequence[int], twins: list[int], *columns: list) -> None:
        """Create the halfedges of faces of the input, and those outside the surface at their sides.

        The indices of the sides of a face follow each other; `columns` are fan, length, angle and post.
        """
        halfedges = [Halfedge() for _ in indices]
        self._halfedges.update(zip(indices, halfedges))
        for h, index, fan, length, angle, post in zip(halfedges, indices, *columns):
            h.index, h.fan, h.length, h.angle, h.post = index, fan, length, angle, post
            h.uses, h.is_flipped = 0, False
        for a, b, c in zip(halfedges[0::3], halfedges[1::3], halfedges[2::3]):
            a.next, b.next, c.next = b, c, a
        for h, t in zip(halfedges, map(self._halfedges.get, twins)):
            h.twin = t
            if t is not None:
                t.twin = h
        for h, index in zip(halfedges, twins):
            if index < 0:
                self._create_outside(h)

    def _create_outside(self, h: Halfedge) -> None:
        """Create the halfedge outside the surface at a boundary side."""
        t = h.twin = Halfedge()
        t.index, t.fan = self.sides + int(np.searchsorted(self._rim, h.index)), h.next.fan
        t.length, t.angle, t.post = h.length, inf, h.next.post + h.next.angle
        t.next, t.twin, t.uses, t.is_flipped = None, h, 0, False
        self._halfedges[t.index] = t

    def rewind(self) -> None:
        """Undo all flips; halfedges of before are not those of the mesh."""
        for h in self._halfedges.values():
            h.next = h.twin = None  # no cycles of references
        self._halfedges.clear()

    def tail(self, h: Halfedge) -> int:
        """Vertex that a halfedge leaves."""
        return self._vertex_of_fan[h.fan]

    def turns(self, first: Halfedge, last: Halfedge) -> tuple[float, float]:
        """Angles counter-clockwise from halfedge `first` to `last` of a vertex and back, by their signposts.

        inf if the boundary lies between, or if the halfedges belong to different fans of the vertex.
        """
        if first.fan != last.fan:
            return inf, inf
        turn, total = last.post - first.post, self._total[first.fan]
        if total == inf:
            return (turn, inf) if turn >= 0.0 else (inf, -turn)
        turn %= total
        return turn, total - turn

    def wedge(self, first: Halfedge, last: Halfedge) -> tuple[list[Halfedge], float]:
        """Halfedges leaving a vertex counter-clockwise from `first` to `last`, and the angle between them.

        The angle is inf if the boundary lies between.
        """
        around, total, h = [first], 0.0, first
        while h is not last:
            on = h.next
            if on is None:
                return around, inf
            total += h.angle
            back = on.next
            h = back.twin or self.twin(back)
            around.append(h)
            if h is first:
                raise MeshError(
                    f"halfedges {first.index} and {last.index} do not leave the same fan of a vertex"
                )
        return around, total

    def flip(self, h: Halfedge) -> bool:
        """Flip the edge of h and return True; False if it does not have two different faces.

        The two triangles must form a convex quadrilateral. The new edge splits the angles at its ends, and
        the angles at the ends of the old edge are merged: the angle sums stay.
        """
        t = h.twin or self.twin(h)
        h1, t1 = h.next, t.next  # b -> c, a -> d
        if h1 is None or t1 is None:
            return False
        h2, t2 = h1.next, t1.next  # c -> a, d -> b
        if t is h1 or t is h2:
            return False
        at_a, at_b, at_c, at_d = h.angle + t1.angle, t.angle + h1.angle, h2.angle, t2.angle
        ca, ad = h2.length, t1.length
        cosine, sine = cos(at_a), sin(at_a)
        d_along, d_off, c_along = ca - ad * cosine, ad * sine, ad - ca * cosine
        h.length = t.length = hypot(d_along, d_off)
        h.fan, t.fan = t2.fan, h2.fan
        h.next, h2.next, t1.next = h2, t1, h  # d -> c -> a
        t.next, t2.next, h1.next = t2, h1, t  # c -> d -> b
        angle_c, angle_d = atan2(d_off, d_along), atan2(ca * sine, c_along)
        angle_c, angle_d = angle_c if angle_c < at_c else at_c, angle_d if angle_d < at_d else at_d
        t1.angle, h1.angle = at_a, at_b
        h2.angle, t.angle = angle_c, at_c - angle_c
        h.angle, t2.angle = angle_d, at_d - angle_d
        h.post = t2.post + t2.angle
        t.post = h2.post + angle_c
        h.is_flipped = t.is_flipped = True
        return True


class EdgeGraph:
    """Graph of the edges for paths between way-points; of several edges between two vertices the shortest.

    Its lengths are in units of the longest side.
    """

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
        # lengths and coordinates in units of the longest side, whose squares are safe
        scale = float(length.max(initial=0.0)) or 1.0
        self.graph = coo_array((length[self.side] / scale, ends), shape=(n, n)).tocsr()
        self._tail = np.repeat(np.arange(n, dtype=self.graph.indices.dtype), np.diff(self.graph.indptr))
        self._columns = None if mesh.points is None else np.ascontiguousarray(mesh.points.T / scale)

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

    def shortest_path(self, a: int, b: int) -> list[int]:
        """Halfedges of the shortest edge path from a to b.

        The search from b measures detours: the cost of an edge is its length less the decrease of the
        straight distance to a, which is never negative. Paths of little detour do not visit the whole mesh.

        P. Hart, N. Nilsson, B. Raphael, "A formal basis for the heuristic determination of minimum cost
        paths", 1968.
        """
        from scipy.sparse.csgraph import dijkstra

        straight = self.between(a, b)
        if straight >= 0:
            return [straight]
        chord, graph = self._chords(a), self.graph
        detour = graph.data + chord.take(graph.indices) - chord.take(self._tail)
        np.maximum(detour, 0.0, out=detour)  # rounding
        graph = type(graph)((detour, graph.indices, graph.indptr), shape=graph.shape)
        for limit in np.multiply(DETOUR_LIMITS, chord[b]) if chord[b] > 0 else (inf,):
            distance, following = dijkstra(graph, indices=b, limit=limit, return_predecessors=True)
            if np.isfinite(distance[a]):
                break
        else:
            raise no_path_error(a, b)
        path = [a]
        while path[-1] != b:
            path.append(int(following[path[-1]]))
        stops = np.array(path)
        return self.side[np.searchsorted(self.key, stops[:-1] * self.mesh.n_vertices + stops[1:])].tolist()


def no_path_error(a: int, b: int) -> ParameterError:
    """Error of two way-points that no edge path joins."""
    return ParameterError(
        f"no edge path leads from vertex {a} to vertex {b}; they lie on different components",
        parameter="waypoints",
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
        raise ParameterError(
            f"vertex {bad[0]} does not exist; vertices are 0..{n - 1}", parameter="waypoints"
        )
    stops = [*waypoints, waypoints[0]] if closed and waypoints else list(waypoints)
    stops = [v for k, v in enumerate(stops) if k == 0 or v != stops[k - 1]]
    if len(stops) < 2:
        raise ParameterError("a path needs two different vertices; give more", parameter="waypoints")
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
