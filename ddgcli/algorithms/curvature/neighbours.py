"""Neighbourhoods for the fits of `quadric`: two rings of the mesh, or of its Delaunay triangulation.

Two rings of sheared cells extend far along the needles. Where the needles run along lines of least curvature,
such rings contain less bending than round ones. So each vertex takes the rings over which the normal turns
less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions, chunks, select_regions
from ddgcli.algorithms.curvature.rings import two_rings
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot

MIN_NEIGHBOURS = 15  # below which a third ring is added
_NON_DELAUNAY_COTAN_SUM = -0.5  # sum of the cotangents opposite an edge below which it is far from Delaunay
_MIN_NON_DELAUNAY_SHARE = 0.1  # share of such edges above which the Delaunay triangulation is tried
_MAX_TURNING_RATIO = 0.7  # of the normal's turning over Delaunay rings, below which these rings are used
_MAX_PAIRS = 200_000  # neighbours handled at once


def neighbourhoods(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, vertices: NDArray | None = None
) -> Regions:
    """Neighbours of every vertex, itself included, for fits of heights.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    normal : (3, n) ndarray
        Approximate unit normals.
    vertices : (k,) ndarray of int, optional
        Whose neighbours; default all.

    Returns
    -------
    Regions
    """
    rings = two_rings(mesh.topology, MIN_NEIGHBOURS, vertices)
    if not is_sheared(mesh, faces):
        return rings
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    rounder = two_rings(flip_to_delaunay(mesh).mesh.topology, MIN_NEIGHBOURS, vertices)
    centre = normal if vertices is None else normal[:, vertices]
    turns_less = turning(centre, normal, rounder) < _MAX_TURNING_RATIO * turning(centre, normal, rings)
    return select_regions(rings, rounder, turns_less)


def is_sheared(mesh: TriangleMesh, faces: Faces) -> bool:
    """Whether many edges are far from Delaunay, on a surface whose edges can be flipped.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.

    Returns
    -------
    bool
    """
    topology = mesh.topology
    most = _MIN_NON_DELAUNAY_SHARE * topology.n_edges
    half = 0.5 * _NON_DELAUNAY_COTAN_SUM
    is_low = (faces.cotan < half).ravel()  # as one of the two corners opposite such an edge
    if np.count_nonzero(is_low) <= most:
        return False
    corner, face = np.divmod(np.flatnonzero(is_low), mesh.n_faces)
    twin = topology.side_twin.ravel().take(3 * face + NEXT.take(corner))
    two_sided = np.flatnonzero(twin >= 0)
    corner, face, twin = corner.take(two_sided), face.take(two_sided), twin.take(two_sided)
    cotan = faces.cotan.ravel()
    other = cotan.take(PREVIOUS.take(twin % 3) * mesh.n_faces + twin // 3)
    far = cotan.take(corner * mesh.n_faces + face) + other < _NON_DELAUNAY_COTAN_SUM
    if np.where(other < half, 0.5, 1.0)[far].sum() <= most:  # both corners of an edge may be among them
        return False
    return topology.is_oriented and not len(topology.nonmanifold_edges) and not faces.flat.any()


def turning(centre: NDArray, normal: NDArray, regions: Regions) -> NDArray[np.float64]:
    """How far the normal turns between vertices and their neighbours.

    Parameters
    ----------
    centre : (3, k) ndarray of float64
        Unit normals at the k vertices.
    normal : (3, n) ndarray of float64
        Unit normals at all vertices.
    regions : Regions
        Neighbours of the k vertices.

    Returns
    -------
    (k,) ndarray of float64
        Means of 1 - cos of the angles.
    """
    mean = np.zeros(centre.shape[1])
    for begin, end in chunks(regions, _MAX_PAIRS):
        count = regions.count[begin:end]
        member = regions.member[regions.start[begin] : regions.start[end]]
        apart = np.repeat(centre[:, begin:end], count, axis=1) - np.take(normal, member, axis=1)
        total = np.add.reduceat(0.5 * dot(apart, apart), regions.start[begin:end] - regions.start[begin])
        mean[begin:end] = total / count
    return mean
