"""Normals, dihedral angles and enclosed volume, from positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import angle_of, cone_volume, cross, dot, ratio, unit_vectors

FOLD_TOLERANCE = 1e-7  # radians from pi within which the sign of a fold's angle is rounding
EDGES_PER_BLOCK = 16_384  # edges handled at once: the working arrays stay in the cache


def face_area_vector(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Area vector of each face: its unit normal times its area.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (m, 3) ndarray of float64
        In length^2; counter-clockwise faces have it towards the viewer.

    Examples
    --------
    >>> square = TriangleMesh.from_arrays([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    >>> face_area_vector(square).tolist()
    [[0.0, 0.0, 2.0]]
    """
    # column by column: rows of three cost several times as much
    columns = np.ascontiguousarray(mesh.points.T)
    a, b, c = (columns.take(corner, axis=1) for corner in np.ascontiguousarray(mesh.faces.T))
    return np.ascontiguousarray(0.5 * cross(b - a, c - a).T)


def face_normal(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Unit normal of each face.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (m, 3) ndarray of float64
        Counter-clockwise faces have it towards the viewer; zero where a face has no area.
    """
    return unit_vectors(face_area_vector(mesh))


def enclosed_volume(mesh: TriangleMesh) -> float:
    """Signed volume that a closed surface encloses.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed and consistently oriented; not checked.

    Returns
    -------
    float
        In length^3; positive where the normals are outward.

    Notes
    -----
    Sum of the signed tetrahedra over the faces. Their apex is the centroid of the vertices, so that a distant
    surface loses no digits.
    """
    return float(_cone_volumes(mesh).sum())


def component_volumes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Signed volumes that the components of a closed surface enclose.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed and consistently oriented; not checked.

    Returns
    -------
    (n_components,) ndarray of float64
        In length^3; positive where the normals are outward, 0 of components without faces.
    """
    topology = mesh.topology
    return sum_by_index(topology.face_component, _cone_volumes(mesh), topology.n_components)


def _cone_volumes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m,) signed volumes of the tetrahedra over the faces, their apex the centroid of the vertices."""
    columns = np.ascontiguousarray((mesh.points - mesh.points.mean(axis=0)).T)
    corners = (columns.take(corner, axis=1) for corner in np.ascontiguousarray(mesh.faces.T))
    return cone_volume(*corners)


def folded_edges(dihedral: NDArray) -> NDArray[np.int64]:
    """Edges along which one face lies on the other.

    Parameters
    ----------
    dihedral : (e,) ndarray of float64
        Dihedral angles in radians (`dihedral_angle`).

    Returns
    -------
    (k,) ndarray of int64
        Edges whose angle is 180 degrees up to `FOLD_TOLERANCE`, in ascending order.
    """
    return np.flatnonzero(np.abs(dihedral) > np.pi - FOLD_TOLERANCE)


def dihedral_angle(mesh: TriangleMesh, normal: NDArray | None = None) -> NDArray[np.float64]:
    """Signed angle between the normals of the two faces of each edge.

    Zero on boundary and non-manifold edges. The reference direction is that of the first of the edge's two
    sides. If the second face is oriented against the first, its normal is reversed.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (m, 3) ndarray of float64, optional
        Unit normals to use instead of `face_normal`, which is zero on faces without area.

    Returns
    -------
    (e,) ndarray of float64
        In radians, in [-pi, pi]: zero where flat, positive where convex (with outward normals).

    Examples
    --------
    >>> from ddgcli.mesh.shapes import box
    >>> angle = dihedral_angle(box())
    >>> sorted({float(a) for a in np.degrees(angle).round(9)})
    [0.0, 90.0]
    """
    return dihedral_angle_and_length(mesh, normal)[0]


def dihedral_angle_and_length(
    mesh: TriangleMesh, normal: NDArray | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Dihedral angles and lengths of the edges, in one pass.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (m, 3) ndarray of float64, optional
        As in `dihedral_angle`.

    Returns
    -------
    angle : (e,) ndarray of float64
        `dihedral_angle`, in radians.
    length : (e,) ndarray of float64
    """
    topology, points = mesh.topology, np.ascontiguousarray(mesh.points.T)
    # column by column: gathering rows of three costs several times as much
    normals = np.ascontiguousarray((face_normal(mesh) if normal is None else normal).T)
    angle, edge_length = np.zeros(topology.n_edges), single_edge_length(points, topology)
    for block in edge_blocks(points, topology, normals):
        angle[block.edge], edge_length[block.edge] = block.angle, block.length
    return angle, edge_length


@dataclass(frozen=True, eq=False)
class EdgeBlock:
    """Some edges with two faces: the first side, its twin, and the normals on both sides.

    Parameters
    ----------
    side, twin, edge : (k,) ndarray of int64
        Flat indices of the two sides, and the edge index.
    tail, vector : (3, k) ndarray of float64
        Start and vector of the first side.
    length : (k,) ndarray of float64
    here, beyond : (3, k) ndarray of float64
        Unit normals of the two faces, the second one as if oriented as the first.
    """

    side: NDArray[np.int64]
    twin: NDArray[np.int64]
    edge: NDArray[np.int64]
    tail: NDArray[np.float64]
    vector: NDArray[np.float64]
    length: NDArray[np.float64]
    here: NDArray[np.float64]
    beyond: NDArray[np.float64]

    @cached_property
    def angle(self) -> NDArray[np.float64]:
        """(k,) dihedral angles in radians, positive where convex."""
        sine = ratio(dot(self.vector, cross(self.here, self.beyond)), self.length)
        cosine = dot(self.here, self.beyond)
        cosine[(cosine == 0) & (sine == 0)] = 1.0  # beside a face without area
        return angle_of(sine, cosine)


def edge_blocks(points: NDArray, topology: Topology, normals: NDArray) -> Iterator[EdgeBlock]:
    """Blocks of the edges with two faces, whose arrays stay in the cache.

    Parameters
    ----------
    points : (3, n) ndarray of float64
    topology : Topology
    normals : (3, m) ndarray of float64
        Unit normals of the faces.

    Yields
    ------
    EdgeBlock
    """
    interior, side_edge = topology.interior_sides, topology.side_edge.ravel()
    twins, sign = topology.side_twin.ravel(), topology.side_sign.ravel()
    for begin in range(0, len(interior), EDGES_PER_BLOCK):
        side = interior[begin : begin + EDGES_PER_BLOCK]
        twin = twins.take(side)
        here, beyond = normals.take(side // 3, axis=1), normals.take(twin // 3, axis=1)
        if not topology.is_oriented:
            beyond *= np.where(sign.take(side) == sign.take(twin), -1.0, 1.0)
        tail = points.take(topology.side_tail.take(side), axis=1)
        vector = points.take(topology.side_head.take(side), axis=1)
        vector -= tail
        length = np.sqrt(dot(vector, vector))
        yield EdgeBlock(side, twin, side_edge.take(side), tail, vector, length, here, beyond)


def single_edge_length(points: NDArray, topology: Topology) -> NDArray[np.float64]:
    """Lengths of the edges that have one face, or more than two.

    Parameters
    ----------
    points : (3, n) ndarray of float64
    topology : Topology

    Returns
    -------
    (e,) ndarray of float64
        Zero at edges with two faces.
    """
    length = np.zeros(topology.n_edges)
    others = np.flatnonzero(topology.edge_face_count != 2)
    tail, head = topology.edges[others].T
    vector = points.take(head, axis=1) - points.take(tail, axis=1)
    length[others] = np.sqrt(dot(vector, vector))
    return length


def hinge_bending(
    squared_length: NDArray, angle: NDArray, area: NDArray, euler_characteristic: int, closed: bool
) -> tuple[NDArray[np.float64], float]:
    """Terms |e|^2 theta^2 / (4 (A1 + A2)) of the hinge energy, and the constant to add to their sum.

    Parameters
    ----------
    squared_length, angle, area : (h,) ndarray
        Of the interior edges: squared lengths, dihedral angles, total areas of both faces.
    euler_characteristic : int
    closed : bool

    Returns
    -------
    (h,) ndarray
        Zero where an edge has no area beside it.
    float
        4 pi chi / 3 on a closed surface, else 0. On equilateral triangles the terms sum to
        int H^2 - (2/3) int K, so that the energy approximates int H^2 there, H = (k1 + k2)/2.

    Notes
    -----
    E. Grinspun et al., "Discrete shells", 2003.
    """
    moment = squared_length * angle**2
    terms = np.divide(moment, 4.0 * area, out=np.zeros_like(moment), where=area > 0)
    return terms, hinge_constant(euler_characteristic, closed)


def hinge_constant(euler_characteristic: int, closed: bool) -> float:
    """Constant that makes the sum of the hinge energies of a closed surface approximate int H^2.

    Parameters
    ----------
    euler_characteristic : int
    closed : bool

    Returns
    -------
    float
        (2/3) int K = 4 pi chi / 3 on a closed surface (see `hinge_bending`); 0 on an open one. Without unit.
    """
    return 4.0 * np.pi * euler_characteristic / 3.0 if closed else 0.0
