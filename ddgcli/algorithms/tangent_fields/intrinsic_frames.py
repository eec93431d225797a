"""Rotations between the vertex frames of a mesh and of its intrinsic Delaunay triangulation.

Both measure angles at a vertex from the first side of its fan, but the first sides differ. An input edge
that is also an intrinsic edge determines the angle between them. Otherwise an intrinsic edge from a vertex
with known angle is traced on the input to a vertex with unknown angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay
from ddgcli.algorithms.tracing.trace import END_STATUS, Tracer
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.operators.connection import angle_scale

_STOP_FRACTION = 1e-4  # of an edge; traced edges stop this far from their head


def frame_turn(mesh: SurfaceMesh, flipped: IntrinsicDelaunay) -> NDArray[np.complex128] | None:
    """Rotations of tangent vectors at vertices from the intrinsic frames to those of the mesh.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, one fan per vertex.
    flipped : IntrinsicDelaunay
        Intrinsic Delaunay triangulation of `mesh`, with tracked crossings.

    Returns
    -------
    (n,) ndarray of complex128 or None
        Unit complex numbers; None if the angle of a vertex remains unknown.
    """
    tracer = Tracer(mesh)
    own, other = tracer.fans, vertex_fans(flipped.mesh)
    offset = np.full(mesh.n_vertices, np.nan)
    offset[own.vertex[own.is_open]] = 0.0  # both begin at the boundary
    offset[~mesh.topology.referenced_vertex] = 0.0
    _from_unflipped_edges(mesh, flipped, offset, own.angle_before, other.angle_before)
    while (unknown := np.isnan(offset)).any():
        _from_traced_edges(tracer, flipped, offset)
        if unknown.sum() == np.isnan(offset).sum():
            return None
    scale = np.ones(mesh.n_vertices)
    scale[own.vertex] = angle_scale(own)
    return np.exp(1j * offset * scale)


def _from_unflipped_edges(
    mesh: SurfaceMesh, flipped: IntrinsicDelaunay, offset: NDArray, own_angle: NDArray, other_angle: NDArray
) -> None:
    """Set the angles at the tails of edges that are edges of the input."""
    n = mesh.n_vertices
    key = mesh.topology.side_tail * n + mesh.topology.side_head
    order = np.argsort(key, kind="stable")
    unflipped = np.flatnonzero(flipped.crossings.ravel() < 0)  # type: ignore[union-attr]
    unflipped_key = (
        flipped.mesh.topology.side_tail[unflipped] * n + flipped.mesh.topology.side_head[unflipped]
    )
    place = np.minimum(np.searchsorted(key[order], unflipped_key), len(key) - 1)
    side = order[place]
    once = (key[side] == unflipped_key) & (
        np.searchsorted(key[order], unflipped_key, side="right") == place + 1
    )
    unflipped, side = unflipped[once], side[once]
    tail = mesh.topology.side_tail[side]
    fresh = np.isnan(offset[tail])
    offset[tail[fresh]] = own_angle[side[fresh]] - other_angle[unflipped[fresh]]


def _from_traced_edges(tracer: Tracer, flipped: IntrinsicDelaunay, offset: NDArray) -> None:
    """Set the unknown angles at heads of edges whose tails have known angles."""
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
    lines = tracer.trace(
        face, np.eye(3)[j], direction[:, None].view(np.float64), length * (1 - _STOP_FRACTION)
    )
    at = np.argmax(mesh.faces[lines.face] == head[:, None], axis=1)
    holds = mesh.faces[lines.face, at] == head
    rest = planar_difference(tracer.unfolding, lines.face, lines.barycentric, np.eye(3)[at])
    gap = np.hypot(rest[:, 0], rest[:, 1]) - length * _STOP_FRACTION
    arrived = holds & (lines.status == END_STATUS) & (np.abs(gap) <= 1e-3 * _STOP_FRACTION * length)
    here = 3 * lines.face[arrived] + at[arrived]
    e = tracer.unfolding.direction[lines.face[arrived], at[arrived]].view(np.complex128)[:, 0]
    back = np.angle(-lines.direction[arrived].view(np.complex128)[:, 0] * e.conj())
    offset[head[arrived]] = (
        own.angle_before[here] + back - other.angle_before[topology.side_twin.ravel()[side[arrived]]]
    )
