"""Geodesics in the isotopy classes of edge paths and loops, by intrinsic edge flips (FlipOut).

N. Sharp, K. Crane, "You Can Find Geodesic Paths in Triangle Meshes by Just Flipping Edges", 2020: at a vertex
where the path has an angle below pi on one side, flip the edges of that wedge until its outer boundary is
locally shortest, and replace the path by that boundary. Every step shortens the path.
"""

from __future__ import annotations

import logging
from heapq import heappop, heappush
from math import inf, pi

import numpy as np

from ddgcli.algorithms.geodesics.flippable_mesh import EdgeGraph, FlippableMesh, Halfedge, edge_path
from ddgcli.algorithms.geodesics.halfedge_traces import trace_on_input
from ddgcli.algorithms.geodesics.path_results import describe_paths
from ddgcli.algorithms.geodesics.paths import SurfacePaths, joints
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import counted
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import PREVIOUS

_log = logging.getLogger("ddgcli")
STRAIGHT_ANGLE_TOLERANCE = 1e-10  # radians
STRAIGHT_ANGLE = pi - STRAIGHT_ANGLE_TOLERANCE  # larger angles are straight
OFF_PATH = -2  # next node of a node that was replaced
MAX_STEPS = 1_000_000  # joints and flips of one path, after which it is left as it is


class PathStraightener:
    """Path or loop of halfedges in a flippable mesh, which `straighten` shortens.

    The path is a doubly linked list of nodes, one for each halfedge; `after` is OFF_PATH at removed nodes.
    """

    def __init__(self, mesh: FlippableMesh, halfedges: list[Halfedge], closed: bool) -> None:
        self.mesh, self.closed, self.flips = mesh, closed, 0
        self.shortest_loop = inf
        self.is_self_blocked = False  # an edge to flip belongs to the path
        n = len(halfedges)
        self.halfedge = list(halfedges)
        self.before, self.after = list(range(-1, n - 1)), list(range(1, n + 1))
        if n:
            self.before[0], self.after[-1] = (n - 1, 0) if closed else (-1, -1)
        self.first = 0 if n else -1
        self._count(halfedges, 1)
        self.queue: list[tuple[float, int, int, bool]] = []  # angle, both nodes, whether it is on the left
        for i in range(n):
            self._push(i)

    def _count(self, halfedges: list[Halfedge], change: int) -> None:
        """Add to the uses of halfedges, and create their twins."""
        for h in halfedges:
            t = h.twin or self.mesh.twin(h)
            h.uses += change
            t.uses += change

    def _push(self, i: int) -> None:
        """Queue the head of node i if the path has an angle below pi there."""
        if i < 0 or (j := self.after[i]) < 0:
            return
        left, right = self.mesh.turns(self.halfedge[j], self.halfedge[i].twin)
        angle = left if left <= right else right
        if angle < STRAIGHT_ANGLE:
            heappush(self.queue, (angle, i, j, left <= right))

    def straighten(self) -> bool:
        """Shorten until all angles are at least pi; False if that is not possible."""
        blocked: list[int] = []
        steps, queue, following = 0, self.queue, self.after
        while queue and steps < MAX_STEPS and self.flips < MAX_STEPS:
            steps += 1
            _, i, j, on_left = heappop(queue)
            if following[i] != j:
                continue
            if self._shorten(i, on_left):
                for k in blocked:
                    self._push(k)
                blocked, self.is_self_blocked = [], False
            else:
                blocked.append(i)
        return not blocked and not queue

    def _shorten(self, i: int, on_left: bool) -> bool:
        """Replace the path at the head of node i by the boundary of the wedge on one side, the sharper one;
        False if not possible.

        Edges of the path are not flipped, so that the signposts of a queued angle are still those of its
        halfedges.
        """
        mesh, j = self.mesh, self.after[i]
        if j == i:
            return self._open_loop(i, on_left)
        onward, back = self.halfedge[j], self.halfedge[i].twin
        wedge, angle = mesh.wedge(onward, back) if on_left else mesh.wedge(back, onward)
        if (
            angle >= pi - STRAIGHT_ANGLE_TOLERANCE
        ):  # zero on the other side; signposts cannot distinguish it from a full turn
            on_left = not on_left
            wedge, angle = mesh.wedge(onward, back) if on_left else mesh.wedge(back, onward)
            if angle >= STRAIGHT_ANGLE:
                return True
        if not self._flip_out(wedge):
            return False
        rim = [h.next for h in wedge[:-1]]
        through = onward.length + back.length
        if sum([h.length for h in rim]) > through * (1 + 1e-9):  # rounding; prevents an endless loop
            return False
        self._replace(i, [mesh.twin(h) for h in reversed(rim)] if on_left else rim)
        return True

    def _open_loop(self, i: int, on_left: bool) -> bool:
        """Replace a loop of one edge by the two other edges of the triangle on the sharper side.

        False if the previous replacement did not shorten the loop.
        """
        mesh, h = self.mesh, self.halfedge[i]
        if h.length >= self.shortest_loop * (1 - 1e-13):
            return False
        self.shortest_loop = h.length
        if on_left:
            across = h.next
            self._replace(i, [mesh.twin(across.next), mesh.twin(across)])
        else:
            across = h.twin.next
            self._replace(i, [across, across.next])
        return True

    def _flip_out(self, wedge: list[Halfedge]) -> bool:
        """Flip inner edges of the wedge (removed from the list) until its boundary bends outward
        everywhere."""
        mesh, k = self.mesh, 1
        meets_itself = _has_loop(wedge)
        while k < len(wedge) - 1:
            h = wedge[k]
            t = h.twin
            if t.angle + h.next.angle >= STRAIGHT_ANGLE:
                k += 1
                continue
            if h.uses:
                self.is_self_blocked = True
                return False
            if self.flips >= MAX_STEPS or not mesh.flip(h):
                return False
            self.flips += 1
            if meets_itself:  # the flip may also have changed the wedge elsewhere
                wedge[:] = mesh.wedge(wedge[0], wedge[-1])[0]
                meets_itself, k = _has_loop(wedge), 1
            else:
                del wedge[k]
                k = k - 1 or 1
        for h in wedge[1:-1]:
            if h.uses:
                self.is_self_blocked = True
                return False
        return True

    def _replace(self, i: int, halfedges: list[Halfedge]) -> None:
        """Replace node i and the next node by halfedges."""
        before_of, after_of, halfedge = self.before, self.after, self.halfedge
        j = after_of[i]
        before, after = before_of[i], after_of[j]
        for k in (i, j) if i != j else (i,):
            after_of[k] = OFF_PATH
            self._count([halfedge[k]], -1)
        if before == j or i == j:  # the whole loop
            before = after = -1
        first, end = len(halfedge), len(halfedge) + len(halfedges)
        halfedge += halfedges
        before_of += range(first - 1, end - 1)
        after_of += range(first + 1, end + 1)
        self._count(halfedges, 1)
        if not halfedges:
            first, last = after, before
        else:
            last = end - 1
            if before < 0 and after < 0 and self.closed:
                before, after = last, first
            before_of[first], after_of[last] = before, after
        if before >= 0:
            after_of[before] = first
        if after >= 0:
            before_of[after] = last
        if after_of[self.first] == OFF_PATH:
            self.first = first
        if before < end - len(halfedges):
            self._push(before)
        for k in range(end - len(halfedges), end):
            self._push(k)

    def halfedges(self) -> list[Halfedge]:
        """Current halfedges of the path."""
        out, k = [], self.first
        while k >= 0:
            out.append(self.halfedge[k])
            k = self.after[k]
            if k == self.first:
                break
        return out


def _has_loop(wedge: list[Halfedge]) -> bool:
    """True if one of the halfedges, which leave the same fan of a vertex, also ends there."""
    return wedge[0].fan in [h.twin.fan for h in wedge]


class Straightener:
    """Set-up of a mesh for straightening paths, shared by several calls.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    """

    def __init__(self, mesh: SurfaceMesh) -> None:
        self.mesh, self.tracer, self.graph = mesh, Tracer(mesh), EdgeGraph(mesh)
        self.flipping = FlippableMesh(self.tracer)

    def curves(self, waypoints: list[list[int]], closed: list[bool]) -> Curves:
        """Straighten curves as the function `straighten_curves` does."""
        mesh, flipping = self.mesh, self.flipping
        traced_paths, kinds, converged = [], [], True
        for stops, is_closed in zip(waypoints, closed, strict=True):
            sides = edge_path(self.graph, stops, is_closed)
            flipping.rewind()
            halfedges = flipping.halfedges(sides)
            before = flipping.scale * sum(h.length for h in halfedges)
            path = PathStraightener(flipping, halfedges, is_closed)
            finished = path.straighten()
            converged &= finished
            if not finished:
                why = ": it overlaps itself; other way-points may help" if path.is_self_blocked else ""
                _log.warning(f"the path through {stops[:5]} could not be straightened everywhere{why}")
            sharp = self._sharp_between_fans(path.halfedges(), is_closed)
            if sharp:
                converged = False
                vertices = counted(len(sharp), "vertex", "vertices")
                _log.warning(
                    f"the path through {stops[:5]} is not straight where it crosses edges of three or more "
                    f"faces, at {vertices} (first: {sharp[0]}); way-points choose the vertices"
                )
            traced_paths.append(trace_on_input(self.tracer, flipping, path.halfedges(), is_closed))
            kind = {
                "kind": "loop" if is_closed else "straightened",
                "way_points": list(stops),
                "flips": path.flips,
            }
            kinds.append(kind | {"edge_path_length": before})
        paths = SurfacePaths.concatenate(traced_paths)
        joint = joints(mesh, paths)
        angles = np.concatenate([joint.left[joint.accurate], joint.right[joint.accurate]])
        sharpest = float(np.nanmin(angles, initial=np.pi))
        accuracy = {"path_angle_deficit": np.pi - sharpest}
        return Curves(paths, describe_paths(mesh, paths, kinds, joint), accuracy, converged)

    def _sharp_between_fans(self, halfedges: list[Halfedge], closed: bool) -> list[int]:
        """Vertices where a path goes to another fan of faces and would be shorter across the edge they share.

        Such an edge has three or more faces, so that no flip moves the path along it.
        """
        flipping, following = self.flipping, halfedges[1:] + (halfedges[:1] if closed else [])
        sharp = []
        for before, after in zip(halfedges, following):
            back = before.twin
            if back.fan != after.fan:
                arriving, leaving = self._fan_ends(back), self._fan_ends(after)
                turns = [arriving[edge] + leaving[edge] for edge in arriving.keys() & leaving.keys()]
                if min(turns, default=pi) < STRAIGHT_ANGLE:
                    sharp.append(flipping.tail(after))
        return sharp

    def _fan_ends(self, h: Halfedge) -> dict[int, float]:
        """Both edges that bound the open fan of a halfedge, with the angles between them and the halfedge."""
        fans, edge = self.tracer.fans, self.mesh.topology.side_edge
        fan, post = h.fan, h.post
        if not fans.is_open[fan]:
            return {}
        first, last = fans.corner[fans.start[fan]], fans.corner[fans.start[fan + 1] - 1]
        ends = int(edge[first // 3, first % 3]), int(edge[last // 3, PREVIOUS[last % 3]])
        return dict(zip(ends, (post, float(fans.total_angle[fan]) - post)))


def straighten_curves(mesh: SurfaceMesh, waypoints: list[list[int]], closed: list[bool]) -> Curves:
    """Straighten edge paths and closed edge loops through way-points to geodesics of their isotopy class.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    waypoints : list of list of int
        Vertices that define the class; the geodesic passes only the ends of open paths.
    closed : list of bool

    Returns
    -------
    Curves
        Locally shortest, not always shortest. A loop that contracts to a point has no points and length 0.
        `accuracy.path_angle_deficit` is the largest amount by which an angle on either side is below pi.
    """
    return Straightener(mesh).curves(waypoints, closed)
