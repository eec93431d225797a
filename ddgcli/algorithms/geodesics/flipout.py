"""Geodesics in the isotopy classes of edge paths and loops, by intrinsic edge flips (FlipOut).

N. Sharp, K. Crane, "You Can Find Geodesic Paths in Triangle Meshes by Just Flipping Edges", 2020: at a vertex
where the path has an angle below pi on one side, flip the edges of that wedge until its outer boundary is
locally shortest, and replace the path by that boundary. Every step shortens the path.
"""

from __future__ import annotations

import heapq
import logging
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.flippable_mesh import EdgeGraph, FlippableMesh, edge_path
from ddgcli.algorithms.geodesics.paths import SurfacePaths, describe_paths, joints, segment_vectors
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT

_log = logging.getLogger("ddgcli")
STRAIGHT_ANGLE_TOLERANCE = 1e-10  # radians; angles above pi minus this are straight
MAX_STEPS = 1_000_000  # joints and flips of one path, after which it is left as it is


@dataclass(slots=True)
class _Node:
    """One halfedge of the path in a doubly linked list."""

    halfedge: int
    before: int
    after: int
    on_path: bool = True


class PathStraightener:
    """Path or loop of halfedges in a flippable mesh, which `straighten` shortens."""

    def __init__(self, mesh: FlippableMesh, halfedges: list[int], closed: bool) -> None:
        self.mesh, self.closed, self.flips = mesh, closed, 0
        self.shortest_loop = inf
        self.is_self_blocked = False  # an edge to flip belongs to the path
        n = len(halfedges)
        self.nodes = [_Node(h, i - 1, i + 1) for i, h in enumerate(halfedges)]
        if n:
            self.nodes[0].before = n - 1 if closed else -1
            self.nodes[-1].after = 0 if closed else -1
        self.first = 0 if n else -1
        self.uses: dict[int, int] = {}
        for h in halfedges:
            self._use(h, 1)
        self.queue: list[tuple[float, int, int]] = []
        for i in range(n):
            self._push(i)

    def _use(self, h: int, count: int) -> None:
        for side in (h, self.mesh.twin[h]):
            self.uses[side] = self.uses.get(side, 0) + count

    def _ends(self, i: int) -> tuple[int, int]:
        """Halfedges that leave the head of node i: the next one of the path, and the twin of node i."""
        return self.nodes[self.nodes[i].after].halfedge, self.mesh.twin[self.nodes[i].halfedge]

    def _push(self, i: int) -> None:
        if i < 0 or self.nodes[i].after < 0:
            return
        angle = min(self.mesh.turns(*self._ends(i)))
        if angle < pi - STRAIGHT_ANGLE_TOLERANCE:
            heapq.heappush(self.queue, (angle, i, self.nodes[i].after))

    def straighten(self) -> bool:
        """Shorten until all angles are at least pi; False if that is not possible."""
        blocked: list[int] = []
        steps = 0
        while self.queue and max(self.flips, steps) < MAX_STEPS:
            steps += 1
            _, i, j = heapq.heappop(self.queue)
            if not (self.nodes[i].on_path and self.nodes[j].on_path and self.nodes[i].after == j):
                continue
            if self._shorten(i):
                for k in blocked:
                    if self.nodes[k].on_path:
                        self._push(k)
                blocked, self.is_self_blocked = [], False
            else:
                blocked.append(i)
        return not blocked and not self.queue

    def _shorten(self, i: int) -> bool:
        """Replace the path at the head of node i by the boundary of the sharper wedge; False if not
        possible."""
        mesh = self.mesh
        onward, back = self._ends(i)
        left, right = mesh.turns(onward, back)
        if min(left, right) >= pi - STRAIGHT_ANGLE_TOLERANCE:
            return True
        on_left = left <= right
        if self.nodes[i].after == i:
            return self._open_loop(i, on_left)
        wedge, angle = mesh.wedge(onward, back) if on_left else mesh.wedge(back, onward)
        if (
            angle >= pi - STRAIGHT_ANGLE_TOLERANCE
        ):  # zero on the other side; signposts cannot distinguish it from a full turn
            on_left = not on_left
            wedge, angle = mesh.wedge(onward, back) if on_left else mesh.wedge(back, onward)
            if angle >= pi - STRAIGHT_ANGLE_TOLERANCE:
                return True
        if not self._flip_out(wedge):
            return False
        rim = [mesh.next[h] for h in wedge[:-1]]
        through = mesh.length[onward] + mesh.length[back]
        if sum([mesh.length[h] for h in rim]) > through * (1 + 1e-9):  # rounding; prevents an endless loop
            return False
        self._replace(i, [mesh.twin[h] for h in reversed(rim)] if on_left else rim)
        return True

    def _open_loop(self, i: int, on_left: bool) -> bool:
        """Replace a loop of one edge by the two other edges of the triangle on the sharper side.

        False if the previous replacement did not shorten the loop.
        """
        mesh, h = self.mesh, self.nodes[i].halfedge
        if mesh.length[h] >= self.shortest_loop * (1 - 1e-13):
            return False
        self.shortest_loop = mesh.length[h]
        if on_left:
            across = mesh.next[h]
            self._replace(i, [mesh.twin[mesh.next[across]], mesh.twin[across]])
        else:
            across = mesh.next[mesh.twin[h]]
            self._replace(i, [across, mesh.next[across]])
        return True

    def _flip_out(self, wedge: list[int]) -> bool:
        """Flip inner edges of the wedge (removed from the list) until its boundary bends outward
        everywhere."""
        mesh, k = self.mesh, 1
        following, angle, tail = mesh.next, mesh.angle, mesh.tail
        while k < len(wedge) - 1:
            h = wedge[k]
            beyond, before = following[h], following[following[wedge[k - 1]]]
            if angle[before] + angle[beyond] >= pi - STRAIGHT_ANGLE_TOLERANCE:
                k += 1
                continue
            if self.uses.get(h, 0):
                self.is_self_blocked = True
                return False
            if not mesh.can_flip(h) or self.flips >= MAX_STEPS:
                return False
            here, t = tail[h], mesh.twin[h]
            # several corners of the two triangles may be the same vertex
            meets_itself = here in (tail[t], tail[following[beyond]], tail[following[following[t]]])
            mesh.flip(h)
            self.flips += 1
            if meets_itself:  # the flip may also have changed the wedge elsewhere
                wedge[:] = mesh.wedge(wedge[0], wedge[-1])[0]
                k = 1
            else:
                del wedge[k]
                k = max(1, k - 1)
        clear = not any(self.uses.get(h, 0) for h in wedge[1:-1])
        self.is_self_blocked |= not clear
        return clear

    def _replace(self, i: int, halfedges: list[int]) -> None:
        """Replace node i and the next node by halfedges."""
        j = self.nodes[i].after
        before, after = self.nodes[i].before, self.nodes[j].after
        for k in {i, j}:
            self.nodes[k].on_path = False
            self._use(self.nodes[k].halfedge, -1)
        if before == j or i == j:  # the whole loop
            before = after = -1
        new = range(len(self.nodes), len(self.nodes) + len(halfedges))
        for k, h in zip(new, halfedges, strict=True):
            self.nodes.append(_Node(h, k - 1, k + 1))
            self._use(h, 1)
        if new and before < 0 and after < 0 and self.closed:
            before, after = new[-1], new[0]
        first, last = (new[0], new[-1]) if new else (after, before)
        if new:
            self.nodes[first].before, self.nodes[last].after = before, after
        if before >= 0:
            self.nodes[before].after = first
        if after >= 0:
            self.nodes[after].before = last
        if not self.nodes[self.first].on_path:
            self.first = first
        if before not in new:
            self._push(before)
        for k in new:
            self._push(k)

    def halfedges(self) -> list[int]:
        """Current halfedges of the path."""
        out, k = [], self.first
        while k >= 0:
            out.append(self.nodes[k].halfedge)
            k = self.nodes[k].after
            if k == self.first:
                break
        return out


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
            before = flipping.scale * sum(flipping.length[h] for h in sides)
            path = PathStraightener(flipping, sides, is_closed)
            finished = path.straighten()
            converged &= finished
            if not finished:
                why = ": it overlaps itself; other way-points may help" if path.is_self_blocked else ""
                _log.warning(f"the path through {stops[:5]} could not be straightened everywhere{why}")
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


def trace_on_input(
    tracer: Tracer, flipping: FlippableMesh, halfedges: list[int], closed: bool
) -> SurfacePaths:
    """Trace a path of halfedges of the flipped triangulation on the input mesh."""
    mesh, fans = tracer.mesh, tracer.fans
    if not halfedges:
        return SurfacePaths(
            np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(2, dtype=np.int64), np.array([closed])
        )
    fan = np.array([flipping.fan[h] for h in halfedges])
    total = fans.total_angle[fan]
    post = np.array([flipping.post[h] for h in halfedges])
    turn = np.where(total > 0, total, 1.0)
    post = np.where(fans.is_open[fan], np.clip(post, 0.0, total), post % turn)
    corner = fans.locate(fan, post)
    face, j = np.divmod(corner, 3)
    local = post - fans.angle_before[corner]
    e = tracer.unfolding.direction[face, j]
    direction = np.stack(
        [
            e[:, 0] * np.cos(local) - e[:, 1] * np.sin(local),
            e[:, 0] * np.sin(local) + e[:, 1] * np.cos(local),
        ],
        axis=1,
    )
    length = flipping.scale * np.array([flipping.length[h] for h in halfedges])
    lines = tracer.trace_checked(LineStart(face, np.eye(3)[j], direction, length), record=True)
    recorded = SurfacePaths.of_traces(lines)
    step = np.nan_to_num(segment_vectors(mesh, recorded))
    cumulative_length = np.cumsum(np.hypot(step[:, 0], step[:, 1]))
    faces, weights = [], []
    for i, h in enumerate(halfedges):
        f, b = _until_head(tracer, flipping, recorded, cumulative_length, i, h, length[i])
        faces.append(f)
        weights.append(b)
    end = flipping.tail[flipping.twin[halfedges[-1]]]
    if not closed:
        last = faces[-1][-1:]
        faces.append(last)
        weights.append(_corner_of(mesh, last, end))
    return SurfacePaths(
        np.concatenate(faces), np.concatenate(weights),
        np.array([0, sum(len(f) for f in faces)], dtype=np.int64), np.array([closed]),
    )  # fmt: skip


def _corner_of(mesh: SurfaceMesh, face: NDArray, vertex: int) -> NDArray[np.float64]:
    return np.eye(3)[np.argmax(mesh.faces[face] == vertex, axis=1)]


def _until_head(
    tracer: Tracer,
    flipping: FlippableMesh,
    recorded: SurfacePaths,
    cumulative_length: NDArray,
    i: int,
    h: int,
    length: float,
) -> tuple[NDArray, NDArray]:
    """Points of a traced halfedge without its head, up to the face that contains the head."""
    mesh = tracer.mesh
    head = flipping.tail[flipping.twin[h]]
    if flipping.edge(h) not in flipping.flipped:  # an edge of the input
        side = h if h < flipping.sides else flipping.twin[h]
        face = np.array([side // 3])
        j = side % 3 if h < flipping.sides else NEXT[side % 3]
        return face, np.eye(3)[[j]]
    a, b = recorded.start[i], recorded.start[i + 1]
    face, barycentric = recorded.face[a : b - 1], recorded.barycentric[a : b - 1]
    so_far = (
        np.concatenate([[0.0], cumulative_length[a : b - 2] - (cumulative_length[a - 1] if a else 0.0)])
        if b - a > 1
        else np.zeros(0)
    )
    holds = np.flatnonzero((mesh.faces[face] == head).any(axis=1))
    rest = planar_difference(
        tracer.unfolding, face[holds], barycentric[holds], _corner_of(mesh, face[holds], head)
    )
    miss = np.abs(so_far[holds] + np.hypot(rest[:, 0], rest[:, 1]) - length)
    if not len(holds) or miss.min() > 1e-6 * length:
        _log.warning(
            f"a straightened edge misses its end vertex {head} on the input mesh; the path has a gap there"
        )
        return face, barycentric
    last = holds[miss <= miss.min() + 1e-9 * length][0]
    return face[: last + 1], barycentric[: last + 1]
