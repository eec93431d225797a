"""Trace halfedges of a flipped triangulation on the input mesh, by their signposts."""

from __future__ import annotations

import logging
from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.flippable_mesh import FlippableMesh, Halfedge
from ddgcli.algorithms.geodesics.paths import SurfacePaths, segment_vectors
from ddgcli.algorithms.tracing.crossing import on_side, scalar_crossings
from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT

MAX_CROSSINGS = 100_000  # faces that one halfedge may cross

_log = logging.getLogger("ddgcli")


def trace_on_input(
    tracer: Tracer, flipping: FlippableMesh, halfedges: list[Halfedge], closed: bool
) -> SurfacePaths:
    """Trace a path of halfedges of the flipped triangulation on the input mesh.

    Parameters
    ----------
    tracer : Tracer
        Of the input mesh.
    flipping : FlippableMesh
    halfedges : list of Halfedge
    closed : bool

    Returns
    -------
    SurfacePaths
        One path.
    """
    mesh, fans = tracer.mesh, tracer.fans
    if not halfedges:
        return SurfacePaths(
            np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(2, dtype=np.int64), np.array([closed])
        )
    fan = np.array([h.fan for h in halfedges])
    total = fans.total_angle[fan]
    post = np.array([h.post for h in halfedges])
    turn = np.where(total > 0, total, 1.0)
    post = np.where(fans.is_open[fan], np.clip(post, 0.0, total), post % turn)
    corner = fans.locate(fan, post)
    angle = np.clip(post - fans.angle_before[corner], 0.0, fans.corner_angle[corner])
    faces, weights = [], []
    for h, *start in zip(halfedges, corner.tolist(), angle.tolist(), strict=True):
        face, barycentric = _points_of(tracer, flipping, h, *start)
        faces.append(face)
        weights.append(barycentric)
    if not closed:
        last = faces[-1][-1:]
        faces.append(last)
        weights.append(_corner_of(mesh, last, flipping.tail(halfedges[-1].twin)))
    return SurfacePaths(
        np.concatenate(faces), np.concatenate(weights),
        np.array([0, sum(len(f) for f in faces)], dtype=np.int64), np.array([closed]),
    )  # fmt: skip


def _corner_of(mesh: SurfaceMesh, face: NDArray, vertex: int) -> NDArray[np.float64]:
    return np.eye(3)[np.argmax(mesh.faces[face] == vertex, axis=1)]


def _points_of(
    tracer: Tracer, flipping: FlippableMesh, h: Halfedge, corner: int, angle: float
) -> tuple[NDArray, NDArray]:
    """Points of a halfedge on the input without its head, up to the face that contains the head.

    It leaves its tail in `corner`, at `angle` from the side of that corner.
    """
    mesh, length = tracer.mesh, h.length
    head = flipping.tail(h.twin)
    if not h.is_flipped:  # an edge of the input
        is_side = h.next is not None
        side = h.index if is_side else h.twin.index
        return np.array([side // 3]), np.eye(3)[[side % 3 if is_side else NEXT[side % 3]]]
    for trace in (_points_before_vertices, _points_through_vertices):
        face, barycentric, rest = trace(tracer, corner, angle, length)
        holds = np.flatnonzero((mesh.faces[face] == head).any(axis=1))
        to_head = planar_difference(
            tracer.unfolding, face[holds], barycentric[holds], _corner_of(mesh, face[holds], head)
        )
        miss = np.abs(np.hypot(to_head[:, 0], to_head[:, 1]) / flipping.scale - rest[holds])
        if miss.min(initial=inf) <= 1e-6 * length:
            last = holds[miss <= miss.min() + 1e-9 * length][0]
            return face[: last + 1], barycentric[: last + 1]
    _log.warning(
        f"a straightened edge misses its end vertex {head} on the input mesh; the path has a gap there"
    )
    return face, barycentric


def _points_before_vertices(
    tracer: Tracer, corner: int, angle: float, length: float
) -> tuple[NDArray, NDArray, NDArray]:
    """Points (face, barycentric) of a line from a corner, and the length that is left there.

    It ends in the face in front of the first vertex or boundary. One line costs less in scalar arithmetic.
    """
    unfolding = tracer.unfolding
    start = corner, 0.0, complex(cos(angle), sin(angle)), length, float(unfolding.length[corner])
    states = [start, *scalar_crossings(unfolding.side.view(np.uint8).data, start, MAX_CROSSINGS)]
    side, x, _, rest, width = (np.array(column) for column in zip(*states, strict=True))
    return side // 3, on_side(side, x / width), rest


def _points_through_vertices(
    tracer: Tracer, corner: int, angle: float, length: float
) -> tuple[NDArray, NDArray, NDArray]:
    """`_points_before_vertices`, but the line continues through vertices."""
    unfolding = tracer.unfolding
    face, j = divmod(corner, 3)
    e = complex(*unfolding.direction[face, j]) * complex(cos(angle), sin(angle))
    start = LineStart(
        np.array([face]), np.eye(3)[[j]], np.array([[e.real, e.imag]]), np.array([length * unfolding.scale])
    )
    points = SurfacePaths.of_traces(tracer.trace_checked(start, record=True, max_crossings=MAX_CROSSINGS))
    step = segment_vectors(tracer.mesh, points)[:-1]
    traced = np.cumsum(np.hypot(step[:, 0], step[:, 1])) / unfolding.scale
    return points.face, points.barycentric, length - np.concatenate([[0.0], traced])
