"""One vertex for each fan of faces: surfaces that touch themselves or others become manifold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.repair.steps import RepairedMesh, separated, separated_at
from ddgcli.mesh.topology import PREVIOUS_OFFSET
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, tangential

LEAST_ANGLE = 1e-9  # radians between faces at an edge whose order around it is certain


def split_fans(repaired: RepairedMesh) -> RepairedMesh:
    """Give every fan of faces its own vertices, so that no vertex joins two fans and no edge three faces.

    Where the faces at an edge bound bodies (their orientations alternate around it), the two faces of each
    body stay together, so that closed surfaces that touch stay closed; where a body touches itself so that
    its faces also meet around both ends of the edge, those of each gap. Other edges of three and more faces
    part their faces; one whose faces still meet around both ends by a copy of one end for each of its faces.

    Parameters
    ----------
    repaired : RepairedMesh

    Returns
    -------
    RepairedMesh
    """
    changes = 0
    for of_bodies in (True, False):
        topology = repaired.mesh.topology
        pairs = pairs_of_sides(repaired.mesh, of_bodies)
        repaired = separated(repaired, np.asarray(topology.edge_face_count == 2), pairs)
        changes += repaired.changes
    while len(bad := repaired.mesh.topology.nonmanifold_edges):
        repaired = separated_at(repaired, repaired.mesh.topology.edges[bad, 0])
        changes += repaired.changes
        repaired = separated(repaired, np.asarray(repaired.mesh.topology.edge_face_count == 2))
        changes += repaired.changes
    return RepairedMesh(repaired.mesh, repaired.input_vertex, repaired.input_face, changes)


def pairs_of_sides(mesh: TriangleMesh, of_bodies: bool) -> NDArray[np.int64]:
    """Sides that follow each other around edges of four and more faces, two of each body or of each gap.

    Edges are left out whose faces do not alternate in orientation, lack an area or lie on each other.

    Parameters
    ----------
    mesh : TriangleMesh
    of_bodies : bool
        Pair the faces that have a body between them, else those that have a gap.

    Returns
    -------
    (k, 2) ndarray of int64
        Flat indices of sides.
    """
    topology = mesh.topology
    side_edge = topology.side_edge.ravel()
    side = np.flatnonzero(topology.edge_face_count[side_edge] > 2)
    if len(side) == 0:
        return np.zeros((0, 2), dtype=np.int64)
    side = side[np.argsort(side_edge[side], kind="stable")]
    edge = side_edge[side]
    first = np.flatnonzero(np.diff(edge, prepend=-1))
    count = np.diff(first, append=len(edge))
    angle = _angle_around_edge(mesh, side, np.repeat(first, count))
    order = np.lexsort((angle, edge))
    side, angle, sign = side[order], angle[order], topology.side_sign.ravel()[side[order]]
    last = first + count - 1
    after = np.arange(1, len(side) + 1)
    after[last] = first
    step = angle[after] - angle
    step[last] += 2 * np.pi
    certain = (sign[after] == -sign) & (step > LEAST_ANGLE)  # NaN where a face lacks an area
    is_pair = np.repeat(np.logical_and.reduceat(certain, first), count)
    # normals point out of a body, which lies on the inner side of a face that runs against the edge
    is_pair &= sign < 0 if of_bodies else sign > 0
    return np.column_stack([side[is_pair], side[after[is_pair]]])


def _angle_around_edge(mesh: TriangleMesh, side: NDArray, first: NDArray) -> NDArray[np.float64]:
    """(k,) angles in (-pi, pi] around the edge, from the face at place `first` to the face of each side.

    Positive counterclockwise about the edge's direction; NaN for faces without an area.
    """
    tail, head = mesh.points[mesh.topology.edges[mesh.topology.side_edge.ravel()[side]]].transpose(1, 0, 2)
    apex = mesh.points[mesh.faces.ravel()[side + PREVIOUS_OFFSET[side % 3]]]
    along, across = head - tail, apex - tail
    with np.errstate(invalid="ignore", divide="ignore"):
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = tangential(across, along)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.arctan2(row_dot(across, row_cross(along, across[first])), row_dot(across, across[first]))
