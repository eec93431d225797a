"""Polylines on a surface: lengths, angles on both sides, geodesic curvature."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.lines import Traces
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import unfold, vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.vectors import row_dot

SIDE_TOLERANCE = 1e-12  # barycentric coordinates below this lie on the side or vertex
OTHER_FACE_TOLERANCE = 1e-9  # the same of `barycentric_in`
SEGMENT_TOLERANCE = 1e-13  # shorter segments, relative to the longest side of the mesh, have no direction
MIN_ACCURATE_SEGMENT = 1e-6  # the direction of a segment of length s has an error of about 1e-16 / s


@dataclass(frozen=True, eq=False)
class SurfacePaths:
    """Polylines on a surface, concatenated; consecutive points share a face.

    Parameters
    ----------
    face : (p,) ndarray of int64
        Face in which the segment that leaves the point lies; of the last point of an open path, the face of
        the segment that arrives.
    barycentric : (p, 3) ndarray of float64
    start : (k+1,) ndarray of int64
        Points of path i are start[i]:start[i+1].
    closed : (k,) ndarray of bool
        A closed path continues from its last point to its first, which is not repeated.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    start: NDArray[np.int64]
    closed: NDArray[np.bool_]

    @classmethod
    def of_traces(cls, traces: Traces) -> SurfacePaths:
        """The recorded points of traces."""
        closed = np.zeros(len(traces.path_start) - 1, dtype=bool)
        return cls(traces.path_face, traces.path_barycentric, traces.path_start, closed)

    @classmethod
    def of_points(
        cls, mesh: SurfaceMesh, paths: list[tuple[NDArray, NDArray]], closed: list[bool] | None = None
    ) -> SurfacePaths:
        """Checked paths from the (face, barycentric) of their points."""
        none = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        points = [SurfacePoints.checked(f, b, mesh.n_faces) for f, b in paths]
        checked = [(p.face, p.barycentric) for p in points]
        start = list_starts([len(f) for f, _ in checked])
        return cls(
            np.concatenate([none[0], *(f for f, _ in checked)]),
            np.concatenate([none[1], *(b for _, b in checked)]),
            start,
            np.array(closed if closed is not None else [False] * len(paths), dtype=bool),
        )

    @classmethod
    def concatenate(cls, path_sets: list[SurfacePaths]) -> SurfacePaths:
        """Concatenate several sets of paths."""
        if len(path_sets) == 1:
            return path_sets[0]
        shift = np.cumsum([0, *(len(p.face) for p in path_sets)])
        return cls(
            np.concatenate([np.zeros(0, dtype=np.int64), *(p.face for p in path_sets)]),
            np.concatenate([np.zeros((0, 3)), *(p.barycentric for p in path_sets)]),
            np.concatenate(
                [np.zeros(1, dtype=np.int64), *(p.start[1:] + s for p, s in zip(path_sets, shift))]
            ),
            np.concatenate([np.zeros(0, dtype=bool), *(p.closed for p in path_sets)]),
        )

    def __len__(self) -> int:
        return len(self.closed)

    def path(self, i: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(face, barycentric) of the points of path i."""
        point_range = slice(self.start[i], self.start[i + 1])
        return self.face[point_range], self.barycentric[point_range]

    def following(self) -> NDArray[np.int64]:
        """(p,) next point of the same path; -1 after the last point of an open path."""
        after = np.arange(1, len(self.face) + 1, dtype=np.int64)
        filled = np.diff(self.start) > 0
        last = self.start[1:][filled] - 1
        after[last] = np.where(self.closed[filled], self.start[:-1][filled], -1)
        return after

    def of_point(self) -> NDArray[np.int64]:
        """(p,) path of each point."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))


@dataclass(frozen=True, eq=False)
class Joints:
    """Angles of curves at their points.

    Parameters
    ----------
    left, right : (p,) ndarray of float64
        Surface angle between the arriving and the leaving segment on either side, in radians; nan at the ends
        of open paths, at segments without length, on the side cut off by the boundary, and where the curve
        passes from one fan of faces at a vertex to another.
    total : (p,) ndarray of float64
        Surface angle around the point: 2 pi except at vertices and on the boundary.
    vertex : (p,) ndarray of int64
        Vertex at the point, or -1.
    segment : (p,) ndarray of float64
        Length of the shorter of both segments, relative to the longest side of the mesh; nan at open ends.
    length : (p,) ndarray of float64
        Length of the segment that leaves the point; nan at open ends.
    """

    left: NDArray[np.float64]
    right: NDArray[np.float64]
    total: NDArray[np.float64]
    vertex: NDArray[np.int64]
    segment: NDArray[np.float64]
    length: NDArray[np.float64]

    @property
    def geodesic_curvature(self) -> NDArray[np.float64]:
        """(p,) (2 pi / total) (total / 2 - left), positive where the curve turns left; zero iff straightest.

        Where the boundary cuts off one side: pi minus the angle on the other, with its sign.
        """
        both = 2 * np.pi * (0.5 - self.left / self.total)
        one = np.where(np.isnan(self.left), self.right - np.pi, np.pi - self.left)
        return np.where(np.isnan(self.left) | np.isnan(self.right), one, both)

    @property
    def accurate(self) -> NDArray[np.bool_]:
        """(p,) True where the angles are accurate to about 1e-10; next to tiny segments they are not."""
        return self.segment > MIN_ACCURATE_SEGMENT

    @property
    def angle_defect(self) -> NDArray[np.float64]:
        """(p,) |left - right| / 2; zero for a straightest geodesic."""
        return np.abs(self.left - self.right) / 2


def barycentric_in(
    topology: Topology, face: NDArray, barycentric: NDArray, other: NDArray
) -> NDArray[np.float64]:
    """Barycentric coordinates of surface points in other faces that contain them.

    Parameters
    ----------
    topology : Topology
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64
        The points.
    other : (k,) ndarray of int64
        The other faces.

    Returns
    -------
    (k, 3) ndarray of float64
        nan where the point does not lie in the other face.
    """
    out = np.full((len(face), 3), np.nan)
    out[face == other] = barycentric[face == other]
    # an edge of three faces or more has no twins
    for j, i in product(range(3), range(3)) if len(topology.nonmanifold_edges) else ():
        hit = np.isnan(out[:, 0]) & (topology.side_edge[face, j] == topology.side_edge[other, i])
        hit &= (topology.side_twin[face, j] < 0) & (barycentric[:, PREVIOUS[j]] <= OTHER_FACE_TOLERANCE)
        rows = np.flatnonzero(hit)
        same = topology.faces[face[rows], j] == topology.faces[other[rows], i]
        out[rows] = 0.0
        out[rows, i] = barycentric[rows, np.where(same, j, NEXT[j])]
        out[rows, NEXT[i]] = barycentric[rows, np.where(same, NEXT[j], j)]
    rows = np.flatnonzero(np.isnan(out[:, 0]))
    twin = topology.side_twin[face[rows]]
    shared = (twin // 3 == other[rows, None]) & (barycentric[rows][:, PREVIOUS] <= OTHER_FACE_TOLERANCE)
    j = np.argmax(shared, axis=1)  # the first of them
    crosses = shared[np.arange(len(rows)), j]
    side, j, crossing = twin[crosses, j[crosses]] % 3, j[crosses], rows[crosses]
    out[crossing] = 0.0
    out[crossing, side] = barycentric[crossing, NEXT[j]]
    out[crossing, NEXT[side]] = barycentric[crossing, j]
    rows = rows[~crosses]
    rows = rows[barycentric[rows].max(axis=1, initial=0.0) >= 1 - OTHER_FACE_TOLERANCE]
    vertex = topology.faces[face[rows], np.argmax(barycentric[rows], axis=1)]
    match = topology.faces[other[rows]] == vertex[:, None]
    has_vertex = match.any(axis=1)
    out[rows[has_vertex]] = 0.0
    out[rows[has_vertex], np.argmax(match[has_vertex], axis=1)] = 1.0
    return out


def segment_vectors(mesh: SurfaceMesh, paths: SurfacePaths) -> NDArray[np.float64]:
    """Vector of the segment that leaves each point of paths, in the planar frame of its face.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    paths : SurfacePaths

    Returns
    -------
    (p, 2) ndarray of float64
        A length; nan at open ends.

    Raises
    ------
    ParameterError
        When two consecutive points do not share the face named by the first.
    """
    return _segments(mesh, paths, paths.following())[0]


def _segments(
    mesh: SurfaceMesh, paths: SurfacePaths, after: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(p, 2) segment vectors, and (p, 3) barycentric coordinates of their heads in the faces of their tails.

    nan at open ends. `after` is `paths.following()`.
    """
    here = np.flatnonzero(after >= 0)
    there = after[here]
    target = barycentric_in(mesh.topology, paths.face[there], paths.barycentric[there], paths.face[here])
    bad = np.flatnonzero(np.isnan(target[:, 0]))
    if len(bad):
        i = here[bad[0]]
        raise ParameterError(
            f"path {paths.of_point()[i]} leaves point {i - paths.start[paths.of_point()[i]]} in face "
            f"{paths.face[i]}, which does not contain the next point; give a face that contains both points"
        )
    vector, head = np.full((len(after), 2), np.nan), np.full((len(after), 3), np.nan)
    vector[here] = planar_difference(unfold(mesh), paths.face[here], paths.barycentric[here], target)
    head[here] = target
    return vector, head


def path_lengths(mesh: SurfaceMesh, paths: SurfacePaths) -> NDArray[np.float64]:
    """Lengths of paths, from edge lengths alone.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    paths : SurfacePaths

    Returns
    -------
    (k,) ndarray of float64
    """
    return sums_by_path(paths, np.hypot(*segment_vectors(mesh, paths).T))


def sums_by_path(paths: SurfacePaths, length: NDArray) -> NDArray[np.float64]:
    """Sum the lengths of the segments of each path.

    Parameters
    ----------
    paths : SurfacePaths
    length : (p,) ndarray of float64
        Of the segment from each point to the next; nan, at open ends, counts as 0.

    Returns
    -------
    (k,) ndarray of float64
    """
    return sum_by_index(paths.of_point(), np.where(np.isnan(length), 0.0, length), len(paths))


def joints(mesh: SurfaceMesh, paths: SurfacePaths) -> Joints:
    """Angles on both sides of curves at all their points.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented: left is left seen from outside.
    paths : SurfacePaths

    Returns
    -------
    Joints
    """
    topology, unfolding, fans = mesh.topology, unfold(mesh), vertex_fans(mesh)
    after = paths.following()
    before = np.full(len(after), -1)
    before[after[after >= 0]] = np.flatnonzero(after >= 0)
    at = np.flatnonzero((after >= 0) & (before >= 0))
    face, b = paths.face[at], paths.barycentric[at]
    vector, ahead = _segments(mesh, paths, after)
    segment_length = np.hypot(vector[:, 0], vector[:, 1])
    # angles at each point of the leaving segment, then those of the arriving one, backward
    faces = np.concatenate([face, paths.face[before[at]]])
    in_faces = np.concatenate([b, ahead[before[at]]])
    direction = np.concatenate([vector[at], -vector[before[at]]]) / unfolding.scale
    angle, kinds, corner = _tangent_angles(mesh, faces, in_faces, direction)
    kind = kinds[: len(at)]
    fan, fan_before = fans.fan[corner[: len(at)]], fans.fan[corner[len(at) :]]
    edge_of_boundary = (kind == 2) & (topology.side_twin.ravel()[corner[: len(at)]] < 0)
    total = np.where(kind == 1, fans.total_angle[fan], np.where(edge_of_boundary, np.pi, 2 * np.pi))
    is_open = np.where(kind == 1, fans.is_open[fan], edge_of_boundary)
    with np.errstate(invalid="ignore", divide="ignore"):
        turn = angle[len(at) :] - angle[: len(at)]
        left = np.where(is_open, np.where(turn >= 0, turn, np.nan), turn % total)
        right = np.where(is_open, np.where(turn < 0, -turn, np.nan), total - left)
    segment = np.minimum(segment_length[at], segment_length[before[at]]) / unfolding.scale
    short = segment <= SEGMENT_TOLERANCE
    short |= (kind == 1) & (fan_before != fan)  # from fan to fan
    result = {name: np.full(len(after), np.nan) for name in ("left", "right", "total", "segment")}
    result["left"][at], result["right"][at] = np.where(short, np.nan, left), np.where(short, np.nan, right)
    result["total"][at], result["segment"][at] = total, segment
    vertex = np.where(
        paths.barycentric.max(axis=1, initial=0.0) >= 1 - SIDE_TOLERANCE,
        topology.faces[paths.face, np.argmax(paths.barycentric, axis=1)] if len(paths.face) else -1,
        -1,
    )
    return Joints(vertex=vertex, length=segment_length, **result)


def _tangent_angles(
    mesh: SurfaceMesh, face: NDArray, barycentric: NDArray, direction: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Angles of directions in the tangent plane at points: the fan's at a vertex, the edge's or the face's.

    Also the kind of each point (1: vertex, 2: on an edge, 3: in a face), and the side that leaves the vertex,
    contains the point or is any.
    """
    unfolding, d = unfold(mesh), direction
    kind = (barycentric > SIDE_TOLERANCE).sum(axis=1)
    j = np.where(kind == 1, np.argmax(barycentric, axis=1), NEXT[np.argmin(barycentric, axis=1)])
    side = 3 * face + j
    e = np.where((kind == 3)[:, None], np.array([1.0, 0.0]), unfolding.direction.reshape(-1, 2)[side])
    local = np.arctan2(e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0], row_dot(d, e))
    twin = mesh.topology.side_twin.ravel()[side]
    at_vertex = vertex_fans(mesh).angle_before[side] + np.clip(local, -1e-6, None)
    on_edge = local + np.where((twin >= 0) & (twin < side), np.pi, 0.0)
    return np.where(kind == 1, at_vertex, np.where(kind == 2, on_edge, local)), kind, side


def reversed_paths(mesh: SurfaceMesh, paths: SurfacePaths) -> SurfacePaths:
    """Reverse open paths.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    paths : SurfacePaths

    Returns
    -------
    SurfacePaths

    Raises
    ------
    ParameterError
        When a path is closed.
    """
    if paths.closed.any():
        raise ParameterError("closed paths cannot be reversed; give open paths", parameter="paths")
    order = np.concatenate(
        [np.zeros(0, dtype=np.int64)]
        + [np.arange(b - 1, a - 1, -1) for a, b in zip(paths.start[:-1], paths.start[1:], strict=True)]
    )
    face = paths.face[np.maximum(order - 1, 0)]
    last = paths.start[1:][np.diff(paths.start) > 0] - 1
    face[last] = paths.face[order[last]]
    b = barycentric_in(mesh.topology, paths.face[order], paths.barycentric[order], face)
    return SurfacePaths(face, b, paths.start, paths.closed)
