"""Spikes: single vertices far off a surface that is smooth around them."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import area_normals
from ddgcli.algorithms.curvature.regions import Regions, listed
from ddgcli.algorithms.curvature.rings import two_rings
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot

MIN_HEIGHT = 0.05  # edges
MIN_DEVIATIONS = 12  # of a spike's height, in deviations of the others from a fit of degree two
MAX_CANDIDATES = 200  # vertices with the largest sums of dihedral angles, all edges of a spike bend one way
THREE_RINGS = (
    1_000  # neighbours: fewer in two rings take a third one; two rings around the tip of a cone fit it
)


def spikes_among(
    points: NDArray, normal: NDArray, regions: Regions, vertices: NDArray, edge: float
) -> NDArray[np.bool_]:
    """(k,) whether vertices lie far off the fit to the others of their regions, whose residuals are small.

    The vertices of a crease are none: the others of their regions do not lie on a smooth surface either.

    Parameters
    ----------
    points, normal : (3, n) ndarray
        Positions in length units, and unit normals, of all vertices.
    regions : Regions
        Of the k vertices.
    vertices : (k,) ndarray of int
    edge : float
        Mean edge length, in length units.
    """
    is_spike = np.zeros(len(vertices), dtype=bool)
    for size in np.unique(regions.count):
        if size < 10:
            continue
        same = np.flatnonzero(regions.count == size)
        block = listed(regions, same)
        centre = vertices[same]
        member = block.member.reshape(len(same), size)
        others = np.where(member == centre[:, None], np.roll(member, 1, axis=1), member)
        weight = (member != centre[:, None]).astype(np.float64)
        offset = points[:, others] - points[:, centre][:, :, None]
        # the normal of a spike's star is far off: that of the mean of the others is not
        around = (normal[:, others] * weight).sum(axis=2)
        length = np.sqrt(dot(around, around))  # 0 where they cancel, between two coincident sheets
        up = np.where(length > 0, around / np.maximum(length, 1e-300), normal[:, centre])
        height = np.einsum("dks,dk->ks", offset, up)
        flat = offset - height * up[:, :, None]
        first = np.cross(up.T, np.eye(3)[np.abs(up).argmin(axis=0)]).T
        first /= np.sqrt(dot(first, first))
        second = np.cross(up.T, first.T).T
        x, y = (np.einsum("dks,dk->ks", flat, axis) for axis in (first, second))
        unit = [
            np.sqrt((c * c * weight).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True))
            for c in (x, y)
        ]
        x, y = (c / np.maximum(u, 1e-300) for c, u in zip((x, y), unit))
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
        weighted = terms * weight[..., None]
        matrix = weighted.transpose(0, 2, 1) @ terms + 1e-9 * size * np.eye(6)
        solution = np.linalg.solve(matrix, (weighted * height[..., None]).sum(axis=1)[..., None])
        residual = (height - (terms @ solution)[..., 0]) * weight
        deviation = np.sqrt((residual**2).sum(axis=1) / max(1, size - 7))
        off = np.abs(solution[:, 0, 0])
        is_spike[same] = (off > MIN_HEIGHT * edge) & (off > MIN_DEVIATIONS * deviation)
    return is_spike


def warn_of_spikes(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> None:
    """Report single vertices far off a smooth surface, which are too few to matter to the mean error.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    """
    bend = np.abs(sum_by_index(mesh.topology.edges.ravel(), np.repeat(dihedral, 2), mesh.n_vertices))
    bend[mesh.topology.boundary_vertex] = 0.0
    most = min(MAX_CANDIDATES, mesh.n_vertices)
    sharpest = np.sort(np.argpartition(bend, -most)[-most:])
    rings = two_rings(mesh.topology, THREE_RINGS, sharpest)
    spikes = sharpest[spikes_among(faces.points, area_normals(faces), rings, sharpest, faces.mean_length)]
    if len(spikes):
        logging.getLogger("ddgcli").warning(
            "%d vertices lie far off the surface around them (first: vertex %d): the curvature over their "
            "neighbours is theirs; correct them in the mesh",
            len(spikes),
            spikes[0],
        )
