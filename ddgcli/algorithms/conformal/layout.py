"""Layout of a flat triangulation with cones in the plane, cut open along seams between the cones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from ddgcli.geometry.intrinsic import half_angle_tangent
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.ragged import group_by_key, unique_keys
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.sides import next_side
from ddgcli.mesh.topology import NEXT, PREVIOUS


@dataclass(frozen=True, eq=False)
class Layout:
    """Corners of a triangulation in the plane.

    Parameters
    ----------
    corner : (m, 3) ndarray of int64
        Index of the plane vertex at each corner; a vertex on a seam has several.
    z : (v,) ndarray of complex128
        Positions of the plane vertices.
    seam : (3m,) ndarray of bool
        Interior sides that the layout is cut along.
    residual : float
        Largest distance between positions of one plane vertex from different faces, relative to the size of
        the layout.
    """

    corner: NDArray[np.int64]
    z: NDArray[np.complex128]
    seam: NDArray[np.bool_]
    residual: float

    def per_vertex(self, faces: NDArray, n: int) -> NDArray[np.complex128] | None:
        """(n,) positions of the vertices where no vertex has two; None otherwise."""
        if self.seam.any():
            return None
        z = np.zeros(n, dtype=np.complex128)
        z[faces] = self.z[self.corner]
        return z


def flat_layout(mesh: IntrinsicMesh, cone: NDArray) -> Layout:
    """Lay faces out one beside the other, and cut along a tree of edges between cones and boundaries.

    Parameters
    ----------
    mesh : IntrinsicMesh
        Connected, with gluing and angle sums of a full turn at interior vertices that are not cones.
    cone : (n,) ndarray of bool

    Returns
    -------
    Layout
    """
    corners, crossed = _developed(mesh)
    seam = _seams(mesh, cone, crossed)
    twin = mesh.topology.side_twin.ravel()
    side = np.flatnonzero((twin >= 0) & ~seam)
    following = next_side(side)
    other = twin[side]
    # the head of a side is the tail of its twin
    count, label = connected_labels(following, other, len(twin))
    flat = corners.ravel()
    weight = np.bincount(label, minlength=count)
    z = (sum_by_index(label, flat.real, count) + 1j * sum_by_index(label, flat.imag, count)) / weight
    size = np.abs(z - z.mean()).max()
    return Layout(label.reshape(-1, 3), z, seam, float(np.abs(flat - z[label]).max() / size))


def _developed(mesh: IntrinsicMesh) -> tuple[NDArray[np.complex128], NDArray[np.bool_]]:
    """(m, 3) corners laid out along a breadth-first tree of faces, and the sides that the tree crosses."""
    twin, m = mesh.topology.side_twin.ravel(), mesh.n_faces
    side = np.flatnonzero(twin >= 0)
    ends = matrix_indices(side // 3, m), matrix_indices(twin[side] // 3, m)
    graph = coo_array((np.ones(len(side)), ends), shape=(m, m)).tocsr()
    root = int(mesh.side_length.sum(axis=1).argmax())
    _, parent = breadth_first_order(graph, root, directed=False)
    entry = np.full(m, -1, dtype=np.int64)  # the side through which the tree enters a face
    tree = side[parent[side // 3] == twin[side] // 3]
    entry[tree // 3] = tree
    depth = _depth(parent, root)
    apex = _apex(mesh.side_length)
    z = np.zeros((m, 3), dtype=np.complex128)
    length = mesh.side_length[root, 0]
    z[root] = 0.0, length, apex[3 * root] * length
    start, faces = group_by_key(depth, np.arange(m), int(depth.max()) + 1)
    flat = z.ravel()
    for level in range(1, len(start) - 1):
        inner = entry[faces[start[level] : start[level + 1]]]
        outer = twin[inner]
        head, tail = flat[outer], flat[next_side(outer)]
        first = 3 * (inner // 3)
        flat[inner], flat[first + NEXT[inner % 3]] = tail, head
        flat[first + PREVIOUS[inner % 3]] = tail + apex[inner] * (head - tail)
    crossed = np.zeros(3 * m, dtype=bool)
    inner = entry[entry >= 0]
    crossed[inner] = crossed[twin[inner]] = True
    return flat.reshape(-1, 3), crossed


def _depth(parent: NDArray, root: int) -> NDArray[np.int64]:
    """Number of edges from the root of a tree, by doubling of the jumps."""
    jump = np.where(np.arange(len(parent)) == root, root, parent)
    depth = (np.arange(len(parent)) != root).astype(np.int64)
    while (jump != root).any():
        depth += depth[jump]
        jump = jump[jump]
    return depth


def _apex(length: NDArray) -> NDArray[np.complex128]:
    """(3m,) the corner opposite each side, in the frame where the side runs from 0 to 1."""
    t = half_angle_tangent(length)
    return ((1 + 1j * t) ** 2 / (1 + t * t) * (length[:, PREVIOUS] / length)).ravel()


def _seams(mesh: IntrinsicMesh, cone: NDArray, crossed: NDArray) -> NDArray[np.bool_]:
    """(3m,) interior sides not crossed by the tree, without branches that end at no cone and no boundary."""
    topology = mesh.topology
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin > np.arange(len(twin))) & ~crossed)
    ends = np.stack([topology.side_tail[side], topology.side_head[side]], axis=1)
    is_seam_end = cone | topology.boundary_vertex
    remaining = np.ones(len(side), dtype=bool)
    degree = np.bincount(ends.ravel(), minlength=mesh.n_vertices)
    # each edge of a forest: xor of the edges at a vertex of degree one is its edge
    last = np.zeros(mesh.n_vertices, dtype=np.int64)
    np.bitwise_xor.at(last, ends.ravel(), np.repeat(np.arange(len(side)), 2))
    leaf = np.flatnonzero((degree == 1) & ~is_seam_end)
    while len(leaf):
        edge = unique_keys(last[leaf])
        edge = edge[remaining[edge]]
        remaining[edge] = False
        np.subtract.at(degree, ends[edge].ravel(), 1)
        np.bitwise_xor.at(last, ends[edge].ravel(), np.repeat(edge, 2))
        end_vertices = unique_keys(ends[edge])
        leaf = end_vertices[(degree[end_vertices] == 1) & ~is_seam_end[end_vertices]]
    seam = np.zeros(len(twin), dtype=bool)
    seam[side[remaining]] = seam[twin[side[remaining]]] = True
    return seam
