"""Remeshing: long edges are split, short ones collapse, edges flip and vertices slide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.ragged import contains
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, unit_vectors, vector_length
from ddgcli.models.willmore.edge_flips import RANK_DIGITS, delaunay_flips, improved, largest_first
from ddgcli.models.willmore.redistribution import redistribute

LONGEST, SHORTEST = 4.0 / 3.0, 4.0 / 5.0  # edges, in target lengths: beyond these they split and collapse
MAX_TURN = np.cos(np.radians(35.0))  # cosine of the angle by which a collapse may turn a face
GOOD_ANGLE = np.radians(25.0)  # a collapse keeps the smallest angle around it, or leaves this
MAX_SWEEPS, MAX_ROUNDS = 6, 12
LEAST_SHARE, MOST_SHARE = 0.5, 2.0  # of the target length, that curvature chooses
LEAST_DEGREE = 4  # of the vertices opposite an edge that collapses


@dataclass(frozen=True, eq=False)
class Remesh:
    """A mesh and which vertices of the input its vertices are.

    Parameters
    ----------
    mesh : TriangleMesh
    origin : (n,) ndarray of int64
        Vertex of the input, -1 where new. What a collapse leaves is one end of the edge, moved.
    """

    mesh: TriangleMesh
    origin: NDArray[np.int64]


Normals = Callable[[TriangleMesh], NDArray]


def remeshed(
    start: Remesh, movable: NDArray[np.bool_], length: float, adaptive: bool, normals: Normals
) -> Remesh | None:
    """The surface with edges near a target length; None where nothing changes.

    Parameters
    ----------
    start : Remesh
    movable : (n,) ndarray of bool
        Of the vertices of `start`; where one of the four vertices of an edge's two faces is not, the edge
        stays, and so do boundaries.
    length : float
        Edges longer than 4/3 of it are split, those shorter than 4/5 collapse.
    adaptive : bool
        The target is shorter where the surface is curved and longer where it is flat, by a factor of two
        at most.
    normals : callable
        TriangleMesh -> (n, 3) unit vertex normals.

    Returns
    -------
    Remesh or None

    Notes
    -----
    M. Botsch, L. Kobbelt, "A remeshing approach to multiresolution modeling", 2004. New and moved vertices
    lie on the quadratic patch of the vertex normals at the edge's ends, O(h^3) from a smooth surface.
    """
    now, fixed = start, ~movable
    for _ in range(MAX_SWEEPS):
        before = now
        for operation in (_split_round, _collapse_round):
            for _ in range(MAX_ROUNDS):
                target = target_length(now.mesh, length, adaptive, normals)
                result = operation(now, fixed, target, normals(now.mesh))
                if result is None:
                    break
                now, fixed = result
        inside = ~fixed & ~now.mesh.topology.boundary_vertex
        topology = delaunay_flips(now.mesh, inside)
        if topology is not None:
            now = Remesh(TriangleMesh(now.mesh.points, topology), now.origin)
        slid = redistribute(now.mesh, normals(now.mesh), inside)
        if slid is not None:
            now = Remesh(slid, now.origin)
        if now is before:
            break
    better = improved(now.mesh, normals, ~fixed & ~now.mesh.topology.boundary_vertex)
    if better is not None:
        now = Remesh(better, now.origin)
    return None if now is start else now


def target_length(mesh: TriangleMesh, length: float, adaptive: bool, normals: Normals) -> NDArray[np.float64]:
    """Target length of the edges at every vertex.

    Parameters
    ----------
    mesh : TriangleMesh
    length : float
        The target where the surface is flat.
    adaptive : bool
        Shorter where it bends.
    normals : callable
        Vertex normals of a mesh.

    Returns
    -------
    (n,) ndarray of float64
    """
    target = np.full(mesh.n_vertices, length)
    if not adaptive:
        return target
    normal, edges = normals(mesh), mesh.topology.edges
    tail, head = edges.T
    turn = vector_length(normal[head] - normal[tail]) / vector_length(mesh.points[head] - mesh.points[tail])
    curvature = np.zeros(mesh.n_vertices)
    np.maximum.at(curvature, edges.ravel(), np.repeat(turn, 2))
    for _ in range(2):  # neighbouring targets differ little
        degree = np.maximum(np.bincount(edges.ravel(), minlength=mesh.n_vertices), 1)
        curvature = (
            0.5 * curvature + 0.5 * sum_by_index(edges, curvature[edges[:, ::-1]], len(degree)) / degree
        )
    referenced = curvature[mesh.topology.referenced_vertex]
    middle = float(np.sqrt(np.mean(referenced**2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(curvature > 0.0, middle / curvature, MOST_SHARE)
    return target * np.clip(share, LEAST_SHARE, MOST_SHARE)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Inner edges ij of the faces ijk and jil whose four vertices are free.

    Parameters
    ----------
    quad : (e, 4) ndarray of int
    face : (e, 2) ndarray of int
    ratio : (e,) ndarray
        Of the length to the target.
    """

    quad: NDArray[np.int64]
    face: NDArray[np.int64]
    ratio: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: TriangleMesh, fixed: NDArray, target: NDArray) -> _Edges:
        topology, flat = mesh.topology, mesh.faces.ravel()
        side = topology.interior_sides
        twin = topology.side_twin.ravel()[side]
        apex = (flat[s - s % 3 + (s + 2) % 3] for s in (side, twin))
        quad = np.stack([topology.side_tail[side], topology.side_head[side], *apex], axis=1)
        blocked = fixed | topology.boundary_vertex
        free = ~blocked[quad].any(axis=1) & (quad[:, 2] != quad[:, 3])
        quad, side, twin = quad[free], side[free], twin[free]
        span = vector_length(mesh.points[quad[:, 1]] - mesh.points[quad[:, 0]])
        aim = 0.5 * (target[quad[:, 0]] + target[quad[:, 1]])
        return cls(quad, np.stack([side // 3, twin // 3], axis=1), np.round(span / aim, RANK_DIGITS))

    def rows(self, rows: NDArray) -> _Edges:
        return _Edges(self.quad[rows], self.face[rows], self.ratio[rows])


def _middle(mesh: TriangleMesh, normal: NDArray, edge: NDArray) -> NDArray[np.float64]:
    """(k, 3) middles of edges (k, 2), on the quadratic patch of the normals at their ends."""
    flat = mesh.points[edge].mean(axis=1)
    height = row_dot(flat[:, None] - mesh.points[edge], normal[edge])
    return flat - 0.25 * np.einsum("ek,ekj->ej", height, normal[edge])


def _split_round(
    now: Remesh, fixed: NDArray, target: NDArray, normal: NDArray
) -> tuple[Remesh, NDArray] | None:
    """Split an independent set of the longest edges; no two have a face in common."""
    mesh, n = now.mesh, now.mesh.n_vertices
    edges = _Edges.of(mesh, fixed, target)
    edges = edges.rows(np.flatnonzero(edges.ratio > LONGEST))
    edges = edges.rows(largest_first(edges.ratio))
    rank = np.arange(len(edges.ratio))
    claim = np.full(mesh.n_faces, len(rank))
    np.minimum.at(claim, edges.face.ravel(), np.repeat(rank, 2))
    edges = edges.rows(np.flatnonzero((claim[edges.face] == rank[:, None]).all(axis=1)))
    if not len(edges.ratio):
        return None
    i, j, k, other = edges.quad.T
    m = n + np.arange(len(i))
    faces = np.array(mesh.faces)
    faces[edges.face[:, 0]], faces[edges.face[:, 1]] = np.stack([i, m, k], 1), np.stack([j, m, other], 1)
    faces = np.concatenate([faces, np.stack([m, j, k], 1), np.stack([m, i, other], 1)])
    points = np.concatenate([mesh.points, _middle(mesh, normal, edges.quad[:, :2])])
    origin = np.concatenate([now.origin, np.full(len(m), -1)])
    split = TriangleMesh(points, Topology(faces, len(points)))
    return Remesh(split, origin), np.concatenate([fixed, np.zeros(len(m), dtype=bool)])


def _collapse_round(
    now: Remesh, fixed: NDArray, target: NDArray, normal: NDArray
) -> tuple[Remesh, NDArray] | None:
    """Collapse an independent set of the shortest edges; no vertex of one is a neighbour of another's."""
    mesh = now.mesh
    edges = _Edges.of(mesh, fixed, target)
    edges = edges.rows(
        np.flatnonzero((edges.ratio < SHORTEST) & _keeps_topology(mesh.topology, edges, fixed))
    )
    edges = edges.rows(largest_first(-edges.ratio))
    for _ in range(MAX_ROUNDS):  # what an edge that must stay has claimed is free again
        if not len(edges.ratio):
            return None
        independent = edges.rows(_independent(mesh.topology, edges.quad))
        good, points = _collapsed(mesh, normal, target, independent)
        if good.any():
            return _joined(now, fixed, independent.quad[good], points[good])
        key = independent.quad[:, 0] * mesh.n_vertices + independent.quad[:, 1]
        own = edges.quad[:, 0] * mesh.n_vertices + edges.quad[:, 1]
        edges = edges.rows(np.flatnonzero(~contains(np.sort(key), own)))
    return None


def _keeps_topology(topology: Topology, edges: _Edges, fixed: NDArray) -> NDArray[np.bool_]:
    """(e,) whether an edge's ends have no common neighbours but the two apexes, and these keep three faces.

    No neighbour of the ends is on the boundary or stays: their faces change.
    """
    n, (tail, head) = topology.n_vertices, topology.edges.T
    ones = np.ones(2 * len(tail))
    rows, columns = np.concatenate([tail, head]), np.concatenate([head, tail])
    neighbours = csr_array((ones, (rows, columns)), shape=(n, n))
    i, j, k, other = edges.quad.T
    common = np.asarray(neighbours[i].multiply(neighbours[j]).sum(axis=1)).ravel()
    degree = np.bincount(topology.edges.ravel(), minlength=n)
    near = neighbours @ (fixed | topology.boundary_vertex).astype(np.float64) > 0
    return (
        (common == 2) & (np.minimum(degree[k], degree[other]) >= LEAST_DEGREE) & ~near[i] & ~near[j]
    )  # fmt: skip


def _independent(topology: Topology, quad: NDArray) -> NDArray[np.int64]:
    """Rows, best first, of edges whose ends are not neighbours of the ends of a better edge."""
    count = len(quad)
    rank = np.arange(count)
    claim = np.full(topology.n_vertices, count)
    np.minimum.at(claim, quad[:, :2].ravel(), np.repeat(rank, 2))
    least, (tail, head) = np.array(claim), topology.edges.T
    np.minimum.at(least, tail, claim[head])
    np.minimum.at(least, head, claim[tail])
    return np.flatnonzero((least[quad[:, :2]] == rank[:, None]).all(axis=1))


def _collapsed(
    mesh: TriangleMesh, normal: NDArray, target: NDArray, edges: _Edges
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """(e,) whether each collapse keeps the surface and its triangles, and the positions (e, 3)."""
    count, (i, j) = len(edges.ratio), edges.quad[:, :2].T
    points = _middle(mesh, normal, edges.quad[:, :2])
    number = np.full(mesh.n_vertices, count)
    number[i] = number[j] = np.arange(count)
    onto = np.arange(mesh.n_vertices)
    onto[j] = i
    moved = np.array(mesh.points)
    moved[i] = points
    faces = onto[mesh.faces]
    owner = number[mesh.faces].min(axis=1)
    dead = np.zeros(mesh.n_faces, dtype=bool)
    dead[edges.face] = True
    star = np.flatnonzero((owner < count) & ~dead)
    before, after = mesh.points[mesh.faces[star]], moved[faces[star]]
    old, new = (row_cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (before, after))
    folds = row_dot(unit_vectors(old), unit_vectors(new)) < MAX_TURN
    sides = vector_length(after[:, [1, 2, 0]] - after)
    aim = target[mesh.faces[star]].mean(axis=1)
    good = np.ones(count, dtype=bool)
    good[owner[star[folds | (sides.max(axis=1) > LONGEST * aim)]]] = False
    least = np.full((2, count), np.inf)
    whole = np.flatnonzero(owner < count)
    np.minimum.at(least[0], owner[whole], corner_angle(mesh.side_length[whole]).min(axis=1))
    np.minimum.at(least[1], owner[star], corner_angle(sides).min(axis=1))
    return good & (least[1] >= np.minimum(least[0], GOOD_ANGLE)), points


def _joined(now: Remesh, fixed: NDArray, quad: NDArray, points: NDArray) -> tuple[Remesh, NDArray[np.bool_]]:
    """The mesh with edges (k, 2) collapsed to points (k, 3), without the vertices at their second ends."""
    mesh, (i, j) = now.mesh, quad[:, :2].T
    onto = np.arange(mesh.n_vertices)
    onto[j] = i
    moved, origin = np.array(mesh.points), np.array(now.origin)
    moved[i], origin[i] = points, np.where(origin[i] >= 0, origin[i], origin[j])
    faces = onto[mesh.faces]
    alive = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    others = np.delete(np.arange(mesh.n_vertices), j)
    number = np.full(mesh.n_vertices, -1)
    number[others] = np.arange(len(others))
    joined = TriangleMesh(moved[others], Topology(number[faces[alive]], len(others)))
    return Remesh(joined, origin[others]), fixed[others]
