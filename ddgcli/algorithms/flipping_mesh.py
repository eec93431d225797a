"""A triangulation that changes by single flips and remembers directions, and edge paths in it."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, sin

import numpy as np

from ddgcli.algorithms.trace import Tracer
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.unfolding import SurfaceMesh


class FlippingMesh:
    """A triangulation that changes by flips, with the direction and length of every halfedge on the input.

    Halfedges 0..3m-1 are the sides; beside each boundary side lies one more, without a face. Lists, not
    arrays: the walk is sequential, and plain numbers are what it reads.

    Attributes
    ----------
    next, twin, tail, fan : list of int
        `next` is -1 outside the surface; `fan` names the fan of corners at the tail.
    length, angle, post : list of float
        Length; corner angle at the tail; direction at the tail, as an angle in its fan (a signpost).
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
        length = mesh.side_length.ravel()
        self.sides = m
        self.next = following.tolist() + [-1] * len(rim)
        self.twin = np.concatenate([twin, rim]).tolist()
        self.tail = np.concatenate([mesh.topology.side_tail, mesh.topology.side_tail[head]]).tolist()
        self.fan = np.concatenate([fans.fan, fans.fan[head]]).tolist()
        self.length = np.concatenate([length, length[rim]]).tolist()
        self.angle = np.concatenate([fans.corner_angle, np.full(len(rim), inf)]).tolist()
        self.post = np.concatenate([fans.angle_before, at_end]).tolist()
        self.flipped: set[int] = set()
        self._journal: list[tuple[int, int, int, int, float, float, float]] = []

    def rewind(self) -> None:
        """Undo all flips."""
        for h, following, tail, fan, length, angle, post in reversed(self._journal):
            self.next[h], self.tail[h], self.fan[h] = following, tail, fan
            self.length[h], self.angle[h], self.post[h] = length, angle, post
        self._journal.clear()
        self.flipped.clear()

    def edge(self, h: int) -> int:
        """The lower of the two halfedges."""
        return min(h, self.twin[h])

    def wedge(self, first: int, last: int) -> tuple[list[int], float]:
        """Halfedges leaving a vertex counter-clockwise from `first` to `last`, and the angle between them.

        The angle is inf where the boundary lies between.
        """
        around, total, h = [first], 0.0, first
        while h != last:
            if self.next[h] < 0:
                return around, inf
            total += self.angle[h]
            h = self.twin[self.next[self.next[h]]]
            around.append(h)
            if h == first:
                raise MeshError(f"halfedges {first} and {last} do not leave the same fan of a vertex")
        return around, total

    def can_flip(self, h: int) -> bool:
        """Two faces, and not the same one."""
        t = self.twin[h]
        return self.next[h] >= 0 and self.next[t] >= 0 and t not in (self.next[h], self.next[self.next[h]])

    def flip(self, h: int) -> None:
        """Turn the edge of h; the two triangles must form a convex quadrilateral."""
        t = self.twin[h]
        h1, t1 = self.next[h], self.next[t]  # b -> c, a -> d
        h2, t2 = self.next[h1], self.next[t1]  # c -> a, d -> b
        for k in (h, t, h1, h2, t1, t2):
            kept = (self.next[k], self.tail[k], self.fan[k], self.length[k], self.angle[k], self.post[k])
            self._journal.append((k, *kept))
        apex = self.length[h2] * cos(self.angle[h]), self.length[h2] * sin(self.angle[h])
        below = self.length[t1] * cos(self.angle[t1]), -self.length[t1] * sin(self.angle[t1])
        self.length[h] = self.length[t] = hypot(apex[0] - below[0], apex[1] - below[1])
        self.tail[h], self.tail[t] = self.tail[t2], self.tail[h2]
        self.fan[h], self.fan[t] = self.fan[t2], self.fan[h2]
        self.next[h], self.next[h2], self.next[t1] = h2, t1, h  # d -> c -> a
        self.next[t], self.next[t2], self.next[h1] = t2, h1, t  # c -> d -> b
        for a, b, c in ((h, h2, t1), (t, t2, h1)):
            self._set_angles(a, b, c)
        self.post[h] = self.post[t2] + self.angle[t2]
        self.post[t] = self.post[h2] + self.angle[h2]
        self.flipped.add(min(h, t))

    def _set_angles(self, a: int, b: int, c: int) -> None:
        """Angles of the triangle of halfedges a, b, c from their lengths."""
        for one, opposite, before in ((a, b, c), (b, c, a), (c, a, b)):
            self.angle[one] = _angle(self.length[one], self.length[before], self.length[opposite])


def _angle(x: float, y: float, opposite: float) -> float:
    """Angle between sides x and y, from three lengths; differences between sorted numbers, after Kahan."""
    large, small = (x, y) if x > y else (y, x)
    gap = large - small
    below = small - (opposite - large) if opposite > large else small + (large - opposite)
    up = max(opposite + gap, 0.0) * max(opposite - gap, 0.0)
    down = (large + (small + opposite)) * max(below, 0.0)
    return 2.0 * atan2(up**0.5, down**0.5)


class EdgeGraph:
    """The edges as a graph, to join way-points: halfedges by their ends, shortest where there are several."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        from scipy.sparse import coo_array

        self.mesh, topology, n = mesh, mesh.topology, mesh.n_vertices
        rim = np.flatnonzero(topology.side_twin.ravel() < 0)
        tail = np.concatenate([topology.side_tail, topology.side_head[rim]])
        head = np.concatenate([topology.side_head, topology.side_tail[rim]])
        length = np.concatenate([mesh.side_length.ravel(), mesh.side_length.ravel()[rim]])
        key = tail * n + head
        order = np.lexsort((length, key))
        key = key[order]
        first = np.concatenate([[True], key[1:] != key[:-1]])
        self.key, self.side = key[first], order[first]
        ends = tail[self.side], head[self.side]
        self.graph = coo_array((length[self.side], ends), shape=(n, n)).tocsr()

    def between(self, a: int, b: int) -> int:
        """Halfedge from a to b (3m + k outside the boundary), or -1."""
        key = a * self.mesh.n_vertices + b
        k = int(np.searchsorted(self.key, key))
        return int(self.side[k]) if k < len(self.key) and self.key[k] == key else -1

    def joined(self, a: int, b: int) -> list[int]:
        """Halfedges of the shortest edge path from a to b."""
        from scipy.sparse.csgraph import dijkstra

        straight = self.between(a, b)
        if straight >= 0:
            return [straight]
        distance, before = dijkstra(self.graph, indices=b, return_predecessors=True)
        if not np.isfinite(distance[a]):
            raise ParameterError(
                f"no edge path leads from vertex {a} to vertex {b}; they lie on different components"
            )
        sides = []
        while a != b:
            sides.append(self.between(a, int(before[a])))
            a = int(before[a])
        return sides


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
