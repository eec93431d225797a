"""Edge flips to a Delaunay triangulation in space, where they leave the surface nearly as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, vector_length
from ddgcli.models.willmore.redistribution import redistribute

MAX_TURN = np.cos(np.radians(35.0))  # cosine of the angle by which a flip may turn normals
FLIP_TOLERANCE = 1e-6  # radians by which opposite angles exceed pi before an edge flips
ANGLE_ERROR = 1e-3  # of angles from lengths
RANK_DIGITS = 6  # of lengths and angles by which edges are ranked: others are rounding
SCATTER = 2654435761  # of D. E. Knuth: times consecutive numbers, modulo 2^32, it scatters them
MAX_FLIP_ROUNDS, MAX_IMPROVEMENTS = 10, 30
LEAST_IMPROVEMENT = np.radians(0.1)  # of the smallest angle, for another round of slides


def delaunay_flips(mesh: TriangleMesh, movable: NDArray) -> Topology | None:
    """Flip edges whose opposite angles sum to more than pi.

    An edge is flipped where its two faces, before and after, lean from their mean by 35 degrees at most, and
    all four vertices are movable.

    Parameters
    ----------
    mesh : TriangleMesh
        A manifold.
    movable : (n,) ndarray of bool

    Returns
    -------
    Topology or None
        None where no edge is flipped. Face indices stay; an edge ij of faces ijk, jil becomes kl of ilk, jkl.
    """
    topology, changed = mesh.topology, False
    for _ in range(MAX_FLIP_ROUNDS):
        quad, faces = _flippable(mesh.points, topology, movable)
        if not len(quad):
            break
        i, j, k, other = quad.T
        corners = np.array(topology.faces)
        corners[faces[:, 0]] = np.stack([i, other, k], axis=1)
        corners[faces[:, 1]] = np.stack([j, k, other], axis=1)
        topology, changed = Topology(corners, topology.n_vertices), True
    return topology if changed else None


def _flippable(points: NDArray, topology: Topology, movable: NDArray) -> tuple[NDArray, NDArray]:
    """(k, 4) vertices i, j, k, l and (k, 2) faces of edges to flip, no two with a face in common."""
    side = topology.interior_sides
    twin = topology.side_twin.ravel()[side]
    flat = topology.faces.ravel()
    apex = (s - s % 3 + (s + 2) % 3 for s in (side, twin))
    quad = np.stack([topology.side_tail[side], topology.side_head[side], *(flat[a] for a in apex)], axis=1)
    faces = np.stack([side // 3, twin // 3], axis=1)
    edges = np.flatnonzero(_may_exceed(points, topology, side, twin) & movable[quad].all(axis=1))
    excess = _opposite_angles(points, quad[edges]) - np.pi
    keep = np.flatnonzero(excess > FLIP_TOLERANCE)
    keep = keep[_keeps_surface(points[quad[edges[keep]]])]
    edges, excess = edges[keep], excess[keep]
    low, high = np.sort(quad[edges, 2:], axis=1).T
    is_new = (low != high) & (edge_indices(topology.edges, quad[edges, 2:]) < 0)
    worst = np.flatnonzero(is_new)
    worst = worst[largest_first(excess[worst])]
    edges, key = edges[worst], (low * topology.n_vertices + high)[worst]
    rank = np.arange(len(edges))
    claim = np.full(topology.n_faces, len(edges))
    np.minimum.at(claim, faces[edges].ravel(), np.repeat(rank, 2))
    first = np.zeros(len(edges), dtype=bool)
    first[np.unique(key, return_index=True)[1]] = True
    edges = edges[first & (claim[faces[edges]] == rank[:, None]).all(axis=1)]
    return quad[edges], faces[edges]


def largest_first(values: NDArray) -> NDArray[np.int64]:
    """Order of decreasing values, in which rounding decides nothing.

    Values with the same first digits are in an order that looks random: along a row of equal edges the choice
    of an independent set by their indices would be one end of it.

    Parameters
    ----------
    values : (k,) ndarray
        Of size 1.

    Returns
    -------
    (k,) ndarray of int64
    """
    scattered = np.arange(len(values)) * SCATTER % 2**32
    return np.lexsort((scattered, -np.round(values, RANK_DIGITS)))


def _may_exceed(points: NDArray, topology: Topology, side: NDArray, twin: NDArray) -> NDArray[np.bool_]:
    """(k,) whether the angles opposite a side and its twin may sum to pi and more, by lengths alone."""
    angle = corner_angle(TriangleMesh(points, topology).side_length).ravel()
    total = angle[side - side % 3 + (side + 2) % 3] + angle[twin - twin % 3 + (twin + 2) % 3]
    return ~(total < np.pi - ANGLE_ERROR)


def _opposite_angles(points: NDArray, quad: NDArray) -> NDArray[np.float64]:
    """(k,) sum of the angles at the apexes k and l."""
    total = np.zeros(len(quad))
    for apex in (2, 3):
        one, other = (points[quad[:, end]] - points[quad[:, apex]] for end in (0, 1))
        total += np.arctan2(vector_length(row_cross(one, other)), row_dot(one, other))
    return total


def _keeps_surface(corner: NDArray) -> NDArray[np.bool_]:
    """(k,) whether the faces before and after a flip lean little from the quadrilateral (k, 4, 3)."""
    i, j, k, other = np.moveaxis(corner, 1, 0)
    vectors = [row_cross(j - i, k - i), row_cross(other - i, j - i)]
    mean = vectors[0] + vectors[1]
    vectors += [row_cross(other - i, k - i), row_cross(k - j, other - j)]
    size = vector_length(mean)
    least = [row_dot(v, mean) - MAX_TURN * vector_length(v) * size for v in vectors]
    return (np.min(least, axis=0) >= 0.0) & (size > 0.0)


def improved(
    mesh: TriangleMesh, normals: Callable[[TriangleMesh], NDArray], movable: NDArray
) -> TriangleMesh | None:
    """Flip edges and slide vertices in turn, until neither makes the smallest angle larger.

    Parameters
    ----------
    mesh : TriangleMesh
    normals : callable
        TriangleMesh -> (n, 3) unit vertex normals.
    movable : (n,) ndarray of bool

    Returns
    -------
    TriangleMesh or None
        None where nothing changes.
    """
    start, smallest = mesh, -np.inf
    for _ in range(MAX_IMPROVEMENTS):
        topology = delaunay_flips(mesh, movable)
        mesh = mesh if topology is None else TriangleMesh(mesh.points, topology)
        slid = redistribute(mesh, normals(mesh), movable)
        mesh = mesh if slid is None else slid
        angle = corner_angle(mesh.side_length).min()
        if slid is None or (topology is None and angle < smallest + LEAST_IMPROVEMENT):
            break
        smallest = angle
    return None if mesh is start else mesh
