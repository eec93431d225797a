"""A triangulation that changes by single flips and remembers directions, and edge paths in it."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, inf, sin
from struct import Struct
from typing import Any

import numpy as np

from ddgcli.algorithms.straightest.trace import Tracer
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import vector_length

_ROW = Struct("4q3d")  # a halfedge: next, twin, tail, fan, length, angle, post


class Local(dict[int, Any]):
    """An array of which single entries change: those that were looked at, as plain numbers."""

    def __init__(self, load: Callable[[int], None]) -> None:
        self.load = load

    def __missing__(self, k: int) -> Any:
        self.load(k)
        return self[k]


class FlippingMesh:
    """A triangulation that changes by flips, with the direction and length of every halfedge on the input.

    Halfedges 0..3m-1 are the sides; beside each boundary side lies one more, without a face. The walk is
    sequential and stays near the path: it reads plain numbers, and only those near the path are made.

    Attributes
    ----------
    next, twin, tail, fan : Local of int
        `next` is -1 outside the surface; `fan` names the fan of corners at the tail.
    length, angle, post : Local of float
        Length in units of `scale`, the longest side; corner angle at the tail; direction at the tail, as an
        angle in its fan (a signpost).
    """

    def __init__(self, tracer: Tracer) -> None:
        mesh, fans = tracer.mesh, tracer.fans
        m = 3 * mesh.n_faces
        twin = mesh.topology.side_twin.ravel().copy()
        rim = np.flatnonzero(twin < 0)
        twin[rim] = m + np.arange(len(rim))
        side = np.arange(m)
        following = side + np.where(side % 3 == 2, -2, 1)
        head = following[rim]
        at_end = fans.angle_before[head] + fans.corner_angle[head]
        self.scale = tracer.unfolding.scale
        length = mesh.side_length.ravel() / self.scale
        self.sides = m
        total = np.where(fans.total_angle > 0, fans.total_angle, 1.0)
        self.total = np.where(fans.is_open, inf, total).tolist()
        rows = np.empty(m + len(rim), dtype=[(name, "i8") for name in "ntvf"] + [(x, "f8") for x in "lap"])
        rows["n"][:m], rows["n"][m:] = following, -1
        rows["t"][:m], rows["t"][m:] = twin, rim
        rows["v"][:m], rows["v"][m:] = mesh.topology.side_tail, mesh.topology.side_tail[head]
        rows["f"][:m], rows["f"][m:] = fans.fan, fans.fan[head]
        rows["l"][:m], rows["l"][m:] = length, length[rim]
        rows["a"][:m], rows["a"][m:] = fans.corner_angle, inf
        rows["p"][:m], rows["p"][m:] = fans.angle_before, at_end
        self._rows = rows.view(np.uint8).data
        self.next, self.twin, self.tail, self.fan = (Local(self._load) for _ in range(4))
        self.length, self.angle, self.post = (Local(self._load) for _ in range(3))
        self.flipped: set[int] = set()

    def _load(self, h: int) -> None:
        """Take up a halfedge as it is on the input."""
        (
            self.next[h], self.twin[h], self.tail[h], self.fan[h],
            self.length[h], self.angle[h], self.post[h],
        ) = _ROW.unpack_from(self._rows, _ROW.size * h)  # fmt: skip

    def rewind(self) -> None:
        """Undo all flips."""
        for local in (self.next, self.twin, self.tail, self.fan, self.length, self.angle, self.post):
            local.clear()
        self.flipped.clear()

    def edge(self, h: int) -> int:
        """The lower of the two halfedges."""
        return min(h, self.twin[h])

    def turns(self, first: int, last: int) -> tuple[float, float]:
        """Angles counter-clockwise from halfedge `first` to `last` of a vertex and back, by their signposts.

        inf where the boundary lies between, or nothing: the vertex may be all that two fans share.
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

        The angle is inf where the boundary lies between.
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

    def can_flip(self, h: int) -> bool:
        """Two faces, and not the same one."""
        t = self.twin[h]
        return self.next[h] >= 0 and self.next[t] >= 0 and t not in (self.next[h], self.next[self.next[h]])

    def flip(self, h: int) -> None:
        """Turn the edge of h; the two triangles must form a convex quadrilateral.

        The new edge splits the angles where it ends and joins those of the old one: their sums stay.
        """
        following, tail, fan = self.next, self.tail, self.fan
        length, angle, post = self.length, self.angle, self.post
        t = self.twin[h]
        h1, t1 = following[h], following[t]  # b -> c, a -> d
        h2, t2 = following[h1], following[t1]  # c -> a, d -> b
        at_a, at_b, at_c, at_d = angle[h] + angle[t1], angle[t] + angle[h1], angle[h2], angle[t2]
        ca, ad = length[h2], length[t1]
        cosine, sine = cos(at_a), sin(at_a)
        d_along, d_off, c_along = ca - ad * cosine, ad * sine, ad - ca * cosine
        length[h] = length[t] = hypot(d_along, d_off)
        tail[h], tail[t] = tail[t2], tail[h2]
        fan[h], fan[t] = fan[t2], fan[h2]
        following[h], following[h2], following[t1] = h2, t1, h  # d -> c -> a
        following[t], following[t2], following[h1] = t2, h1, t  # c -> d -> b
        angle_c, angle_d = min(atan2(d_off, d_along), at_c), min(atan2(ca * sine, c_along), at_d)
        angle[t1], angle[h1] = at_a, at_b
        angle[h2], angle[t] = angle_c, at_c - angle_c
        angle[h], angle[t2] = angle_d, at_d - angle_d
        post[h] = post[t2] + angle[t2]
        post[t] = post[h2] + angle_c
        self.flipped.add(h if h < t else t)


class EdgeGraph:
    """The edges as a graph, to join way-points: halfedges by their ends, shortest where there are several."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        from scipy.sparse import coo_array

        self.mesh, topology, n = mesh, mesh.topology, mesh.n_vertices
        self.extent = 0.0 if mesh.points is None else float(vector_length(np.ptp(mesh.points, axis=0)))
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
        ends = tail[self.side].astype(np.int32), head[self.side].astype(np.int32)  # as Dijkstra wants them
        self.graph = coo_array((length[self.side], ends), shape=(n, n)).tocsr()

    def between(self, a: int, b: int) -> int:
        """Halfedge from a to b (3m + k outside the boundary), or -1."""
        key = a * self.mesh.n_vertices + b
        k = int(np.searchsorted(self.key, key))
        return int(self.side[k]) if k < len(self.key) and self.key[k] == key else -1

    def limits(self, a: int, b: int) -> list[float]:
        """Lengths up to which to look for an edge path, so that near vertices do not cost the whole mesh."""
        points = self.mesh.points
        if points is None:
            return [inf]
        chord = float(vector_length(points[a] - points[b]))
        return [reach for reach in (1.3 * chord, 2.6 * chord) if reach < 0.5 * self.extent] + [inf]

    def joined(self, a: int, b: int) -> list[int]:
        """Halfedges of the shortest edge path from a to b."""
        from scipy.sparse.csgraph import dijkstra

        straight = self.between(a, b)
        if straight >= 0:
            return [straight]
        for limit in self.limits(a, b):
            distance, before = dijkstra(self.graph, indices=b, return_predecessors=True, limit=limit)
            if np.isfinite(distance[a]):
                break
        else:
            raise ParameterError(
                f"no edge path leads from vertex {a} to vertex {b}; they lie on different components"
            )
        stops = [a]
        while stops[-1] != b:
            stops.append(int(before[stops[-1]]))
        key = np.array(stops[:-1]) * self.mesh.n_vertices + stops[1:]
        return self.side[np.searchsorted(self.key, key)].tolist()


def edge_path(graph: EdgeGraph, waypoints: list[int], closed: bool) -> list[int]:
    """Halfedges of an edge path through vertices; the shortest between those that are not neighbours.

    Raises
    ------
    ParameterError
        On vertices out of range, fewer than two, or without an edge path between them.
    """
    n = graph.mesh.n_vertices
    bad = [v for v in waypoints if not 0 <= v < n]
    if bad:
        raise ParameterError(f"way-point {bad[0]} does not exist; vertices are 0..{n - 1}")
    stops = [*waypoints, waypoints[0]] if closed and waypoints else list(waypoints)
    stops = [v for k, v in enumerate(stops) if k == 0 or v != stops[k - 1]]
    if len(stops) < 2:
        raise ParameterError("a path needs two different way-points; give more vertices")
    return [h for a, b in zip(stops[:-1], stops[1:], strict=True) for h in graph.joined(a, b)]
