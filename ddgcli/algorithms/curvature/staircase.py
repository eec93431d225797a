"""Recognition of voxel boundaries (staircases) by the shapes of their faces and by their creases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot

STEP_ANGLE = np.pi / 12  # dihedral angle in radians above which an edge is a crease of a staircase
# Least share of vertices on convex and on concave creases, and least share of faces with one of the
# FACE_SHAPES most frequent shapes. Voxel boundaries have 0.13 to 0.66 and 1, terraces of nearly flat bodies
# 0.027 or more of the vertices; scans and mechanical parts have at most 0.65 of the faces.
MIN_STEPPED_SHARE, MIN_SHAPE_SHARE = 0.02, 0.95
FACE_SHAPES, MIN_FACES_OF_A_SHAPE = 128, 4
SHAPE_SAMPLE_SIZE = 5000  # faces whose shapes are compared
NORMAL_RESOLUTION, AREA_RESOLUTION = 0.02, 0.1  # of the components of a normal, and of log2 of an area
# Least share of sides that are integer combinations of three of them: 0.99 to 1 for voxels. Periodic sheets
# and gears, whose faces have few shapes, too, have 0.3 to 0.67.
MIN_LATTICE_SHARE = 0.9
SIDE_RESOLUTION = 0.05  # difference over the mean length below which two sides count as equal
MIN_SIDES_OF_A_KIND = 3
WHOLE_TOLERANCE = 0.05  # distance of a coefficient from an integer below which it counts as one
MIN_INDEPENDENCE = 0.1  # sine of the angle of a side to the line or plane of those before it


def is_staircase(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> bool:
    """Whether a surface is a voxel boundary, made of squares or by marching cubes through voxel centres.

    Such a surface has convex and concave creases at many vertices, faces of few shapes (normal and area), and
    vertices on a lattice, even if the voxels are rotated or not cubes. Mechanical parts have many shapes, and
    the waves and teeth of periodic surfaces are not on a lattice.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.

    Returns
    -------
    bool
    """
    edges, n_referenced = mesh.topology.edges, int(mesh.topology.referenced_vertex.sum())
    least = MIN_STEPPED_SHARE * n_referenced
    creases = [np.flatnonzero(dihedral > STEP_ANGLE), np.flatnonzero(dihedral < -STEP_ANGLE)]
    if min(2 * len(crease) for crease in creases) < least:  # each crease has two ends
        return False
    for crease in creases:
        ends = np.zeros(mesh.n_vertices, dtype=bool)
        ends[edges[crease].ravel()] = True
        if ends.sum() < least:
            return False
    sample = _sampled_faces(faces)
    area = faces.area[sample]
    keys = np.rint(
        np.vstack(
            [faces.normal[:, sample] / NORMAL_RESOLUTION, np.log2(area / np.median(area)) / AREA_RESOLUTION]
        )
    )
    # one integer per face, because sorting integers is 20 times as fast as sorting columns
    keys = (keys - keys.min(axis=1, keepdims=True)).astype(np.int64)
    shape = np.ravel_multi_index(tuple(keys), tuple(keys.max(axis=1) + 1))
    count = np.sort(np.unique(shape, return_counts=True)[1])[::-1]
    frequent = count[: min(FACE_SHAPES, len(sample) // MIN_FACES_OF_A_SHAPE)]
    if frequent.sum() <= MIN_SHAPE_SHARE * len(sample):
        return False
    return _lattice_share(sampled_sides(faces)) > MIN_LATTICE_SHARE


def sampled_sides(faces: Faces) -> NDArray[np.float64]:
    """Side vectors of a sample of the faces with positive area.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, k) ndarray of float64
    """
    corner = faces.corner[:, _sampled_faces(faces)]
    return (faces.points[:, corner[[1, 2, 0]]] - faces.points[:, corner]).reshape(3, -1)


def _sampled_faces(faces: Faces) -> NDArray[np.int64]:
    sound = np.flatnonzero(~faces.flat)
    return sound[:: max(1, len(sound) // SHAPE_SAMPLE_SIZE)]


def _lattice_share(vectors: NDArray) -> float:
    """Share of vectors (3, k) that are integer combinations of three of them.

    These are the three shortest independent ones among the frequent vectors, which generate a lattice in
    space.
    """
    resolution = SIDE_RESOLUTION * np.sqrt(dot(vectors, vectors).mean())
    # a vector and its opposite count as the same
    vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(vectors.shape[1])])
    _, kind, count = np.unique(np.rint(vectors / resolution), axis=1, return_inverse=True, return_counts=True)
    means = np.stack([sum_by_index(kind.ravel(), column, len(count)) / count for column in vectors])
    frequent = means[:, count >= MIN_SIDES_OF_A_KIND]
    frequent = frequent[:, np.argsort(dot(frequent, frequent), kind="stable")]
    length = np.sqrt(dot(frequent, frequent))
    basis: list[NDArray] = []
    off = length  # distance of each vector to the span of the basis
    while len(basis) < 3:
        independent = np.flatnonzero(off > MIN_INDEPENDENCE * length)
        if len(independent) == 0:
            return 0.0
        basis.append(frequent[:, independent[0]])
        span = np.linalg.qr(np.stack(basis, axis=1))[0]
        rest = frequent - span @ (span.T @ frequent)
        off = np.sqrt(dot(rest, rest))
    coefficients = np.linalg.solve(np.stack(basis, axis=1), vectors)
    return float((np.abs(coefficients - np.rint(coefficients)) < WHOLE_TOLERANCE).all(axis=0).mean())


def cancellation(mesh: TriangleMesh, faces: Faces, dihedral: NDArray, regions: Regions) -> float:
    """Median over regions of the absolute signed bending over the total bending; 1 if all creases are convex.

    In noise and stairs convex and concave creases cancel; a crease of a mechanical part, a fold or a rounded
    detail has one sign over two rings.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray of float64
        Dihedral angles in radians, positive where convex.
    regions : Regions

    Returns
    -------
    float
        In [0, 1].
    """
    is_member = np.zeros(mesh.n_vertices, dtype=bool)
    is_member[regions.member] = True
    end_is_member = is_member.take(mesh.topology.edges.ravel())
    near = np.flatnonzero(end_is_member[::2] | end_is_member[1::2])
    tail, head = np.ascontiguousarray(mesh.topology.edges.take(near, axis=0).T)
    vector = faces.points.take(head, axis=1) - faces.points.take(tail, axis=1)
    bending, n = np.sqrt(dot(vector, vector)) * dihedral.take(near), mesh.n_vertices
    totals = []
    for values in (bending, np.abs(bending)):
        at_vertex = sum_by_index(tail, values, n) + sum_by_index(head, values, n)
        totals.append(np.add.reduceat(at_vertex.take(regions.member), regions.start[:-1]))
    signed, absolute = totals
    return float(np.median(np.divide(np.abs(signed), absolute, out=np.ones_like(signed), where=absolute > 0)))
