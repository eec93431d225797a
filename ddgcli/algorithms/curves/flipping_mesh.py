"""A triangulation that changes by single flips and remembers directions, and edge paths in it."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.straightest.trace import Tracer
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.unfolding import SurfaceMesh


class Local(dict[int, Any]):
    """An array of which single entries change: those that were looked at, as plain numbers."""

    def __init__(self, original: NDArray) -> None:
        self.original = original

    def __missing__(self, k: int) -> Any:
        value = self[k] = self.original.item(k)
        return value


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
        self.next = Local(np.concatenate([following, np.full(len(rim), -1)]))
        self.twin = Local(np.concatenate([twin, rim]))
        self.tail = Local(np.concatenate([mesh.topology.side_tail, mesh.topology.side_tail[head]]))
        self.fan = Local(np.concatenate([fans.fan, fans.fan[head]]))
        self.length = Local(np.concatenate([length, length[rim]]))
        self.angle = Local(np.concatenate([fans.corner_angle, np.full(len(rim), inf)]))
        self.post = Local(np.concatenate([fans.angle_before, at_end]))
        self.flipped: set[int] = set()

    def rewind(self) -> None:
        """Undo all flips."""
        for local in (self.next, self.tail, self.fan, self.length, self.angle, self.post):
            local.clear()
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
        following, tail, fan = self.next, self.tail, self.fan
        length, angle, post = self.length, self.angle, self.post
        t = self.twin[h]
        h1, t1 = following[h], following[t]  # b -> c, a -> d
        h2, t2 = following[h1], following[t1]  # c -> a, d -> b
        above, below = angle[h], angle[t1]
        bc, ca, ad, db = length[h1], length[h2], length[t1], length[t2]
        dc = hypot(ca * cos(above) - ad * cos(below), ca * sin(above) + ad * sin(below))
        length[h] = length[t] = dc
        tail[h], tail[t] = tail[t2], tail[h2]
        fan[h], fan[t] = fan[t2], fan[h2]
        following[h], following[h2], following[t1] = h2, t1, h  # d -> c -> a
        following[t], following[t2], following[h1] = t2, h1, t  # c -> d -> b
        angle[h], angle[h2], angle[t1] = _angles(dc, ca, ad)
        angle[t], angle[t2], angle[h1] = _angles(dc, db, bc)
        post[h] = post[t2] + angle[t2]
        post[t] = post[h2] + angle[h2]
        self.flipped.add(h if h < t else t)


def _angles(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Angles between the sides z and x, x and y, y and z, by half-angle formulas.

    The larger of two sides is taken first from the third, which is exact where it matters (Kahan).
    """
    without_x = (y - x) + z if y > z else (z - x) + y
    without_y = (x - y) + z if x > z else (z - y) + x
    without_z = (x - z) + y if x > y else (y - z) + x
    if without_x <= 0.0 or without_y <= 0.0 or without_z <= 0.0:  # no area
        without_x, without_y, without_z = max(without_x, 0.0), max(without_y, 0.0), max(without_z, 0.0)
    whole = x + y + z
    return (
        2.0 * atan2(sqrt(without_z * without_x), sqrt(whole * without_y)),
        2.0 * atan2(sqrt(without_x * without_y), sqrt(whole * without_z)),
        2.0 * atan2(sqrt(without_y * without_z), sqrt(whole * without_x)),
    )


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
        order = np.argsort(key, kind="stable")
        if (np.diff(key[order]) == 0).any():  # several edges between two vertices
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
