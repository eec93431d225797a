"""Steiner points on boundary edges: cuts of sides, and triangulations without obtuse angles at the boundary.

An obtuse angle opposite a boundary edge gives the edge a negative cotangent, which no flip removes.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.circumcentres import apex_of
from ddgcli.algorithms.delaunay.flips import SideArrays, flip_until_delaunay
from ddgcli.algorithms.delaunay.gluing import around
from ddgcli.algorithms.delaunay.triangulation import ANGLE_TOLERANCE, length_scale, unglue
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.operators.connection import angle_scale

_log = logging.getLogger("ddgcli")
MAX_CUT_ROUNDS = 100  # of cuts and flips; meshes need fewer than ten


def cut_boundary(
    state: SideArrays, side: NDArray, vertex: NDArray, share: NDArray, along: NDArray | float = 0.0
) -> NDArray[np.int64]:
    """Cut boundary sides ij of Delaunay faces (i, j, k) at new vertices v; at most one side of each face.

    Parameters
    ----------
    state : SideArrays
    side : (k,) ndarray of int64
    vertex : (k,) ndarray of int64
        Indices of the new vertices.
    share : (k,) ndarray of float64
        Position on the side, as a share of its length from i.
    along : (k,) ndarray of float64 or float
        Angle of the side vj at v, where directions are tracked.

    Returns
    -------
    (6k,) ndarray of int64
        Sides whose edges may need a flip.
    """
    _, jk, ki = around(side)
    whole, lengths_jk = state.length[side].copy(), state.length[jk].copy()
    to_apex = np.abs(apex_of(state, side) - share) * whole
    old = None if state.direction is None else (state.direction[jk].copy(), state.direction[ki].copy())
    new = state.split_boundary(side, vertex)
    p = 3 * new
    state.length[side], state.length[jk] = share * whole, to_apex
    state.length[p], state.length[p + 1], state.length[p + 2] = (1 - share) * whole, lengths_jk, to_apex
    state.measure(np.concatenate([side // 3, new]))
    if state.twisted is not None:
        state.twisted[p + 1], state.twisted[jk] = state.twisted[jk], False
    if old is not None:
        direction: NDArray = state.direction  # type: ignore[assignment]  # longer than before the cut
        direction[p], direction[p + 1] = along, old[0]
        direction[jk] = along + 2 * np.arctan(state.tangent[p + 1])
        direction[p + 2] = old[1] + 2 * np.arctan(state.tangent[side])
    return np.concatenate([side, jk, ki, p, p + 1, p + 2])


@dataclass(frozen=True, eq=False)
class SplitBoundary:
    """A Delaunay triangulation with no obtuse angle opposite a boundary edge.

    Parameters
    ----------
    mesh : IntrinsicMesh
        The vertices of the input come first; the others lie on its boundary edges.
    turn : (n,) ndarray of complex128
        Rotations of tangent vectors at the vertices of the input from the frames of `mesh` to those of the
        input; 1 without `track_turn`.
    """

    mesh: IntrinsicMesh
    turn: NDArray[np.complex128]


def split_obtuse_boundary(mesh: IntrinsicMesh, *, track_turn: bool = False) -> SplitBoundary:
    """Cut the boundary edges opposite obtuse angles of a Delaunay triangulation, until none is left.

    Parameters
    ----------
    mesh : IntrinsicMesh
        Intrinsic Delaunay triangulation.
    track_turn : bool
        Track the tangent frames of the vertices (oriented, one fan of faces at each vertex).

    Returns
    -------
    SplitBoundary
        With `mesh` itself if no such angle is obtuse.

    Notes
    -----
    An edge is cut at the foot of the altitude; flips follow. Every vertex then sees both parts under acute
    or right angles, so it causes at most one cut of an edge, and also two edges at a sharp corner do not cut
    each other without end. No cotangent weight of the result is negative (up to 1e-9): its Laplacian has a
    maximum principle.
    """
    turn = np.ones(mesh.n_vertices, dtype=np.complex128)
    scale, twin = length_scale(mesh.side_length), mesh.topology.side_twin
    if not (twin < 0).any():
        return SplitBoundary(mesh, turn)
    state = SideArrays.of(mesh.faces, twin, mesh.side_length / scale)
    obtuse = _obtuse_boundary(state)
    if not len(obtuse):
        return SplitBoundary(mesh, turn)
    twisted = mesh.topology.twisted
    state.twisted = None if twisted is None else twisted.ravel().copy()
    fans = vertex_fans(mesh) if track_turn else None
    state.direction = None if fans is None else fans.angle_before.copy()
    n_vertices = mesh.n_vertices
    for _ in range(MAX_CUT_ROUNDS):
        vertex = n_vertices + np.arange(len(obtuse))
        share = np.clip(apex_of(state, obtuse).real, 1e-9, 1 - 1e-9)
        flip_until_delaunay(state, cut_boundary(state, obtuse, vertex, share))
        n_vertices += len(obtuse)
        obtuse = _obtuse_boundary(state)
        if not len(obtuse):
            break
    _log.info(f"{n_vertices - mesh.n_vertices} points cut boundary edges opposite obtuse angles")
    split = unglue(state, mesh, scale, n_new=n_vertices - mesh.n_vertices)
    if fans is not None:
        first = vertex_fans(split)
        angle = np.zeros(n_vertices)
        angle[first.vertex] = state.direction[first.corner[first.start[:-1]]]  # type: ignore[index]
        turn[fans.vertex] = np.exp(1j * angle[fans.vertex] * angle_scale(fans))
    return SplitBoundary(split, turn)


def _obtuse_boundary(state: SideArrays) -> NDArray[np.int64]:
    """Boundary sides opposite obtuse angles; at most one of each face."""
    return np.flatnonzero((state.twin[:-1] < 0) & (state.tangent > 1.0 + ANGLE_TOLERANCE))
