"""Boundaries of voxels, recognised by the shapes of their faces and by their creases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh

STEP_ANGLE = np.pi / 12  # dihedral angle from which an edge is a crease of a staircase
# least share of vertices on convex and on concave creases, and of faces of the most frequent shapes, among
# FACE_SHAPES of them: boundaries of voxels have 0.13 to 0.66 and 1, scans and mechanical parts at most 0.65
MIN_STEPPED_SHARE, MIN_SHAPE_SHARE = 0.05, 0.95
FACE_SHAPES, MIN_FACES_OF_A_SHAPE = 128, 4
SHAPE_SAMPLE_SIZE = 5000  # faces whose shapes are compared
NORMAL_RESOLUTION, AREA_RESOLUTION = 0.02, 0.1  # of the components of a normal, and of log2 of an area


def is_staircase(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> bool:
    """Whether a surface is the boundary of voxels, by squares or by marching cubes through their centres.

    Such a surface has convex and concave creases at many vertices, and faces of few shapes (normal and area),
    also where the voxels are turned or no cubes. Mechanical parts have many shapes, and regular grids no
    creases of both signs.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    """
    edges, n_referenced = mesh.topology.edges, int(mesh.topology.referenced_vertex.sum())
    for sign in (1, -1):
        ends = np.zeros(mesh.n_vertices, dtype=bool)
        ends[edges[sign * dihedral > STEP_ANGLE].ravel()] = True
        if ends.sum() < MIN_STEPPED_SHARE * n_referenced:
            return False
    sound = np.flatnonzero(~faces.flat)
    sample = sound[:: max(1, len(sound) // SHAPE_SAMPLE_SIZE)]
    area = faces.area[sample]
    keys = np.rint(
        np.vstack(
            [faces.normal[:, sample] / NORMAL_RESOLUTION, np.log2(area / np.median(area)) / AREA_RESOLUTION]
        )
    )
    count = np.sort(np.unique(keys, axis=1, return_counts=True)[1])[::-1]
    frequent = count[: min(FACE_SHAPES, len(sample) // MIN_FACES_OF_A_SHAPE)]
    return bool(frequent.sum() > MIN_SHAPE_SHARE * len(sample))


def cancellation(mesh: TriangleMesh, faces: Faces, dihedral: NDArray, regions: Regions) -> float:
    """Median over regions of the total signed bending over the total bending: 1 where all creases are convex.

    Noise and stairs have as many concave creases beside convex ones; a crease of a part, a fold or a rounded
    detail has one sign over two rings.

    `dihedral` (e,) are dihedral angles in radians, positive where convex.
    """
    is_member = np.zeros(mesh.n_vertices, dtype=bool)
    is_member[regions.member] = True
    start, end = mesh.topology.edges.T
    near = np.flatnonzero(is_member[start] | is_member[end])
    edges, angle = mesh.topology.edges[near], dihedral[near]
    length = np.sqrt(((faces.points[:, edges[:, 0]] - faces.points[:, edges[:, 1]]) ** 2).sum(axis=0))
    totals = []
    for bending in (length * angle, length * np.abs(angle)):
        at_vertex = sum_by_index(edges.ravel(), np.repeat(bending, 2), mesh.n_vertices)
        totals.append(np.add.reduceat(at_vertex[regions.member], regions.start[:-1]))
    signed, absolute = totals
    return float(np.median(np.divide(np.abs(signed), absolute, out=np.ones_like(signed), where=absolute > 0)))
