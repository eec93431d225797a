"""Local refinement of triangles by bisection of their longest sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class Bisected:
    """A refined mesh and where its parts come from.

    Parameters
    ----------
    mesh : TriangleMesh
        The old vertices first, then the midpoints of the split edges.
    ends : (k, 2) ndarray of int64
        Old vertices between which each new one lies.
    parent : (m,) ndarray of int64
        Old face of every face.
    """

    mesh: TriangleMesh
    ends: NDArray[np.int64]
    parent: NDArray[np.int64]


def bisected(mesh: TriangleMesh, marked: NDArray) -> Bisected:
    """Bisect the marked faces, and as many others as necessary to keep the mesh conforming.

    Parameters
    ----------
    mesh : TriangleMesh
    marked : (m,) ndarray of bool

    Returns
    -------
    Bisected
        The refined mesh, the vertices whose midpoint is each new vertex, and the input face of each face.

    Notes
    -----
    A face with a split side is first split at its longest side; other split sides divide the halves
    (M. C. Rivara, "Algorithms for refining triangular grids suitable for adaptive and multigrid techniques",
    1984). Angles never fall below half of the smallest; right isosceles triangles stay so.
    """
    topology = mesh.topology
    faces, side_edge = topology.faces, topology.side_edge
    longest = np.argmax(mesh.side_length * (1.0 + 1e-9 * np.arange(3, 0, -1)), axis=1)
    split = np.zeros(topology.n_edges, dtype=bool)
    longest_edge = side_edge[np.arange(len(faces)), longest]
    split[longest_edge[marked]] = True
    while True:
        nonconforming = split[side_edge].any(axis=1) & ~split[longest_edge]
        if not nonconforming.any():
            break
        split[longest_edge[nonconforming]] = True
    index = np.full(topology.n_edges, -1, dtype=np.int64)
    ends = topology.edges[split]
    index[split] = mesh.n_vertices + np.arange(len(ends))
    children, parents = _child_faces(faces, longest, index[side_edge])
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1)])
    return Bisected(TriangleMesh.from_arrays(points, children), ends, parents)


def _child_faces(faces: NDArray, longest: NDArray, middle: NDArray) -> tuple[NDArray, NDArray]:
    """Faces after the split, and their old faces; `middle` (m, 3) has the new vertex of a side or -1."""
    whole = np.flatnonzero((middle < 0).all(axis=1))
    cut = np.flatnonzero((middle >= 0).any(axis=1))
    k = longest[cut]
    a, b, c = faces[cut, k], faces[cut, NEXT[k]], faces[cut, PREVIOUS[k]]
    top, right, left = middle[cut, k], middle[cut, NEXT[k]], middle[cut, PREVIOUS[k]]
    children, parents = [faces[whole]], [whole]
    for first, second, tip, on_far in ((b, c, top, right), (c, a, top, left)):
        split = on_far >= 0
        children.append(np.stack([tip, first, second], axis=1)[~split])
        children.append(np.stack([tip, first, on_far], axis=1)[split])
        children.append(np.stack([tip, on_far, second], axis=1)[split])
        parents += [cut[~split], cut[split], cut[split]]
    return np.concatenate(children), np.concatenate(parents)
