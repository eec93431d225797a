"""Neighbourhoods for the fits of `quadric`: two rings of the mesh, or of its Delaunay triangulation.

Rings of sheared cells follow the needles around the body. Needles along the lines of least curvature are
another matter: their rings see less of the bending than round ones. So each vertex takes the rings over
which the normal turns less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.region import Regions, chosen, chunks, two_rings
from ddgcli.mesh.topology import PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot

_FAR = -0.5  # cotangents opposite an edge that sum to less: the edge is far from Delaunay
_MANY = 0.1  # share of such edges from which the Delaunay triangulation is tried
_LESS = 0.7  # its rings are taken where the normal turns by less than this share
_PAIRS = 200_000  # neighbours handled at once


def neighbourhoods(mesh: TriangleMesh, faces: Faces, normal: NDArray, at_least: int) -> Regions:
    """Neighbours of every vertex, itself included, for fits of heights.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (3, n) ndarray
        Approximate unit normals.
    at_least : int
        Neighbours below which a third ring is added.
    """
    rings = two_rings(mesh.topology, at_least)
    if not _sheared(mesh, faces):
        return rings
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    rounder = two_rings(flip_to_delaunay(mesh).mesh.topology, at_least)
    turns_less = _turning(normal, rounder) < _LESS * _turning(normal, rings)
    return chosen(rings, rounder, turns_less)


def _sheared(mesh: TriangleMesh, faces: Faces) -> bool:
    """Whether many edges are far from Delaunay, on a surface whose edges can be flipped."""
    topology = mesh.topology
    opposite = np.zeros(topology.n_edges)
    for side, cotan in zip(topology.side_edge.T, faces.cotan[PREVIOUS]):
        opposite += np.bincount(side, cotan, topology.n_edges)
    far = (opposite < _FAR) & (topology.edge_face_count == 2)
    if far.sum() <= _MANY * topology.n_edges:
        return False
    return topology.is_oriented and not len(topology.nonmanifold_edges) and not faces.flat.any()


def _turning(normal: NDArray, regions: Regions) -> NDArray[np.float64]:
    """(n,) mean of 1 - cos of the angle between normals at the vertex and at its neighbours."""
    turning = np.zeros(normal.shape[1])
    for begin, end in chunks(regions, _PAIRS):
        count = regions.count[begin:end]
        member = regions.member[regions.start[begin] : regions.start[end]]
        apart = np.repeat(normal[:, begin:end], count, axis=1) - np.take(normal, member, axis=1)
        total = np.add.reduceat(0.5 * dot(apart, apart), regions.start[begin:end] - regions.start[begin])
        turning[begin:end] = total / count
    return turning
