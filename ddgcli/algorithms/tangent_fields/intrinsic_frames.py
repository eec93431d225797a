"""Tangent frames at vertices, carried between a mesh and its intrinsic Delaunay triangulation.

Both count angles at a vertex from the first side of its fan, but the first sides differ. Where an input edge
is still there, it tells the angle between them; elsewhere an intrinsic edge from a vertex that knows its
angle is traced on the input to the vertex that does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay
from ddgcli.algorithms.tracing.trace import REACHED, Tracer
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.operators.connection import angle_scale

_SHORT = 1e-4  # of an edge: traced edges are stopped so far before their head


def frame_turn(mesh: SurfaceMesh, flipped: IntrinsicDelaunay) -> NDArray[np.complex128] | None:
    """(n,) unit numbers that take tangent vectors from the intrinsic frames to those of the mesh.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, one fan a vertex.
    flipped : IntrinsicDelaunay
        Made from it, with its crossings tracked.

    Returns
    -------
    ndarray, or None where some vertex could not be reached
    """
    tracer = Tracer(mesh)
    own, other = tracer.fans, vertex_fans(flipped.mesh)
    offset = np.full(mesh.n_vertices, np.nan)
    offset[own.vertex[own.is_open]] = 0.0  # both begin at the boundary
    offset[~mesh.topology.referenced_vertex] = 0.0
    _from_kept_edges(mesh, flipped, offset, own.angle_before, other.angle_before)
    while (unknown := np.isnan(offset)).any():
        _from_traced_edges(tracer, flipped, offset)
        if unknown.sum() == np.isnan(offset).sum():
            return None
    scale = np.ones(mesh.n_vertices)
    scale[own.vertex] = angle_scale(own)
    return np.exp(1j * offset * scale)


def _from_kept_edges(
    mesh: SurfaceMesh, flipped: IntrinsicDelaunay, offset: NDArray, own_angle: NDArray, other_angle: NDArray
) -> None:
    """Angles at the tails of edges that are edges of the input."""
    n = mesh.n_vertices
    key = mesh.topology.side_tail * n + mesh.topology.side_head
    order = np.argsort(key, kind="stable")
    kept = np.flatnonzero(flipped.crossings.ravel() < 0)  # type: ignore[union-attr]
    wanted = flipped.mesh.topology.side_tail[kept] * n + flipped.mesh.topology.side_head[kept]
    place = np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)
    side = order[place]
    once = (key[side] == wanted) & (np.searchsorted(key[order], wanted, side="right") == place + 1)
    kept, side = kept[once], side[once]
    tail = mesh.topology.side_tail[side]
    fresh = np.isnan(offset[tail])
    offset[tail[fresh]] = own_angle[side[fresh]] - other_angle[kept[fresh]]


def _from_traced_edges(tracer: Tracer, flipped: IntrinsicDelaunay, offset: NDArray) -> None:
    """Angles at unknown heads of edges whose tails are known."""
    mesh, own, other = tracer.mesh, tracer.fans, vertex_fans(flipped.mesh)
    topology = flipped.mesh.topology
    side = np.flatnonzero(
        ~np.isnan(offset[topology.side_tail])
        & np.isnan(offset[topology.side_head])
        & (topology.side_twin.ravel() >= 0)
    )
    tail, head = topology.side_tail[side], topology.side_head[side]
    fan_of = np.full(mesh.n_vertices, -1)
    fan_of[own.vertex] = np.arange(len(own.vertex))
    fan = fan_of[tail]
    total = own.total_angle[fan]
    angle = other.angle_before[side] + offset[tail]
    angle = np.where(own.is_open[fan], np.clip(angle, 0.0, total), angle % total)
    corner = own.locate(fan, angle)
    face, j = np.divmod(corner, 3)
    e = tracer.unfolding.direction[face, j].view(np.complex128)[:, 0]
    direction = e * np.exp(1j * (angle - own.angle_before[corner]))
    length = flipped.mesh.side_length.ravel()[side]
    lines = tracer.trace(face, np.eye(3)[j], direction[:, None].view(np.float64), length * (1 - _SHORT))
    at = np.argmax(mesh.faces[lines.face] == head[:, None], axis=1)
    holds = mesh.faces[lines.face, at] == head
    rest = planar_difference(tracer.unfolding, lines.face, lines.barycentric, np.eye(3)[at])
    gap = np.hypot(rest[:, 0], rest[:, 1]) - length * _SHORT
    came = holds & (lines.status == REACHED) & (np.abs(gap) <= 1e-3 * _SHORT * length)
    here = 3 * lines.face[came] + at[came]
    e = tracer.unfolding.direction[lines.face[came], at[came]].view(np.complex128)[:, 0]
    back = np.angle(-lines.direction[came].view(np.complex128)[:, 0] * e.conj())
    offset[head[came]] = (
        own.angle_before[here] + back - other.angle_before[topology.side_twin.ravel()[side[came]]]
    )
