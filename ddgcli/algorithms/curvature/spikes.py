"""Spikes: single vertices far off a surface that is smooth around them."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import area_normals, tangent_frame
from ddgcli.algorithms.curvature.polynomial_fits import local_coordinates
from ddgcli.algorithms.curvature.regions import Regions, listed
from ddgcli.algorithms.curvature.rings import two_rings
from ddgcli.errors import counted
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot

MIN_MEMBERS = 10  # vertices of a region, with the centre, for a quadratic fit to the others
MIN_HEIGHT = 0.05  # height of a spike in edges
MIN_DEVIATIONS = 12  # height of a spike over the deviation of the others from the fit
# candidates: vertices with the largest sums of dihedral angles, since all edges of a spike bend the same way
MAX_CANDIDATES = 200
# Regions with fewer vertices in two rings get a third ring. Two rings around the tip of a cone fit it too
# well.
THREE_RINGS = 1_000


def spikes_among(
    points: NDArray, normal: NDArray, regions: Regions, vertices: NDArray, edge: float
) -> NDArray[np.bool_]:
    """Mark vertices that are far from the fit to the other vertices of their region, with small residuals.

    Parameters
    ----------
    points, normal : (3, n) ndarray
        Positions in length units, and unit normals, of all vertices.
    regions : Regions
        Regions of the k vertices.
    vertices : (k,) ndarray of int
    edge : float
        Mean edge length, in length units.

    Returns
    -------
    (k,) ndarray of bool
    """
    is_spike = np.zeros(len(vertices), dtype=bool)
    large = np.flatnonzero(regions.count >= MIN_MEMBERS)
    if len(large) == 0:
        return is_spike
    region, centre = listed(regions, large), vertices[large]
    owner = np.repeat(np.arange(len(large)), region.count)
    is_other = np.flatnonzero(region.member != centre.take(owner))
    count = np.bincount(owner.take(is_other), minlength=len(large))
    start, member = list_starts(count), region.member.take(is_other)
    # the normal at a spike is wrong, so the mean normal of the others is used
    around = np.add.reduceat(np.take(normal, member, axis=1), start[:-1], axis=1)
    length = np.sqrt(dot(around, around))  # 0 where they cancel, between two coincident sheets
    up = np.where(length > 0, around / np.maximum(length, 1e-300), normal[:, centre])
    vertex_frame = np.concatenate([*tangent_frame(up), up])
    x, y, height = local_coordinates(points, points[:, centre], vertex_frame, start, member)
    for axis in (x, y):
        unit = np.sqrt(np.add.reduceat(axis * axis, start[:-1]) / count)
        axis /= np.repeat(np.maximum(unit, 1e-300), count)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    matrix = np.zeros((len(terms), len(terms), len(large)))
    for k, term in enumerate(terms):
        matrix[k, k:] = matrix[k:, k] = np.add.reduceat(term * terms[k:], start[:-1], axis=1)
        matrix[k, k] += 1e-9 * region.count
    right = np.add.reduceat(terms * height, start[:-1], axis=1)
    solution = np.linalg.solve(matrix.transpose(2, 0, 1), right.T[..., None])[..., 0].T
    residual = height - sum(term * np.repeat(c, count) for term, c in zip(terms, solution))
    squared = np.add.reduceat(residual * residual, start[:-1])
    deviation = np.sqrt(squared / np.maximum(1, region.count - 7))
    off = np.abs(solution[0])
    is_spike[large] = (off > MIN_HEIGHT * edge) & (off > MIN_DEVIATIONS * deviation)
    return is_spike


def warn_of_spikes(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> None:
    """Warn about single vertices far off a smooth surface, which are too few to affect the mean error.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    """
    ends = mesh.topology.edges.T
    bend = np.abs(sum(sum_by_index(end, dihedral, mesh.n_vertices) for end in ends))
    bend[mesh.topology.boundary_vertex] = 0.0
    most = min(MAX_CANDIDATES, mesh.n_vertices)
    sharpest = np.sort(np.argpartition(bend, -most)[-most:])
    rings = two_rings(mesh.topology, THREE_RINGS, sharpest)
    spikes = sharpest[spikes_among(faces.points, area_normals(faces), rings, sharpest, faces.mean_length)]
    if len(spikes):
        logging.getLogger("ddgcli").warning(
            "%s far off the surrounding surface (first: vertex %d), which decides the curvature of the "
            "neighbours; correct this in the mesh",
            counted(len(spikes), "vertex lies", "vertices lie"),
            spikes[0],
        )
