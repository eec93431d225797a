"""Normal cycles and corrected measures in balls about every vertex, edges and faces clipped by the sphere.

The ball about a vertex holds the part of the surface within a distance in space that is connected to the
vertex there: other sheets that happen to pass by do not count.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature_faces import Faces, ratio
from ddgcli.algorithms.curvature_frames import Principal
from ddgcli.algorithms.curvature_region import FaceBalls
from ddgcli.algorithms.curvature_star import corrected_measures, corrected_principal, swapped_principal
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh

_PAIRS = 50_000  # of vertices and faces handled at once


def corrected_in_balls(mesh: TriangleMesh, faces: Faces, normal: NDArray, radius: float) -> Principal:
    """Corrected measures of the faces in the ball, those on its rim by the share of area inside."""
    of_face = corrected_measures(faces, normal)
    measures = np.zeros((len(of_face), mesh.n_vertices))
    for begin, end, owner, face, area, _ in _clipped(mesh, radius):
        share = ratio(area, faces.area[face])
        for k, values in enumerate(of_face):
            measures[k, begin:end] += np.bincount(owner, values[face] * share, end - begin)
    return corrected_principal(measures, normal)


def normal_cycle_in_balls(
    mesh: TriangleMesh, normal: NDArray, defect: NDArray, dihedral: NDArray, radius: float
) -> Principal:
    """Cohen-Steiner and Morvan's tensor of the clipped edges over the clipped area of the ball."""
    side = mesh.side_vector.reshape(-1, 3)
    squared = np.einsum("ij,ij->i", side, side)
    unit = side / np.sqrt(np.where(squared > 0, squared, 1.0))[:, None]
    # every edge is met from both of its faces: half from each
    turn = 0.5 * dihedral[mesh.topology.side_edge.ravel()]
    x, y, z = unit.T
    entries = [turn * e for e in (x * x, y * y, z * z, y * z, z * x, x * y)]
    corner_defect = defect / np.maximum(np.bincount(mesh.faces.ravel(), minlength=mesh.n_vertices), 1)
    n = mesh.n_vertices
    tensor, area, gauss = np.zeros((6, n)), np.zeros(n), np.zeros(n)
    for begin, end, owner, face, clipped, chord in _clipped(mesh, radius):
        area[begin:end] += np.bincount(owner, clipped, end - begin)
        for k, entry in enumerate(entries):
            values = (chord * entry[3 * face[:, None] + np.arange(3)]).sum(axis=1)
            tensor[k, begin:end] += np.bincount(owner, values, end - begin)
        corner = mesh.faces[face]
        offset = mesh.points[corner] - mesh.points[begin + owner][:, None]
        inside = np.einsum("fki,fki->fk", offset, offset) <= radius * radius
        values = (inside * corner_defect[corner]).sum(axis=1)
        gauss[begin:end] += np.bincount(owner, values, end - begin)
    return swapped_principal(ratio(tensor, area), normal, ratio(gauss, area))


Pairs = tuple[int, int, NDArray, NDArray, NDArray, NDArray]


def _clipped(mesh: TriangleMesh, radius: float) -> Iterator[Pairs]:
    """Pairs of vertices and faces that meet the vertex's ball, a range of vertices at a time.

    Yields
    ------
    begin, end : int
        The range.
    owner, face : (k,) ndarray
        Vertex counted from begin, and face.
    area : (k,) ndarray
        Of the face inside the ball.
    chord : (k, 3) ndarray
        Length of each of its sides inside the ball.
    """
    balls = FaceBalls(mesh, radius)
    begin, step = 0, 64
    while begin < mesh.n_vertices:
        end = min(begin + step, mesh.n_vertices)
        owner, face = balls.of(begin, end)
        corner = mesh.points[mesh.faces[face]] - mesh.points[begin + owner][:, None]
        yield begin, end, owner, face, *clip_triangles(corner, radius)
        step = max(1, int((end - begin) * _PAIRS / max(len(face), 1)))
        begin = end


def clip_triangles(corner: NDArray, radius: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Areas of triangles, and lengths of their sides, inside the ball about the origin.

    Parameters
    ----------
    corner : (k, 3, 3) ndarray
        Corner positions relative to the centre of the ball.

    Returns
    -------
    area : (k,) ndarray
    chord : (k, 3) ndarray

    Notes
    -----
    The ball meets the triangle's plane in a disc about the foot of the origin. Its area within the
    triangle is a sum over sides: the triangle from the foot to the part of the side inside the disc, and
    circular sectors to the parts outside, all signed.
    """
    side = corner[:, NEXT] - corner
    normal = np.cross(side[:, 0], side[:, 1])
    size = np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
    height = np.einsum("fi,fi->f", corner[:, 0], normal)
    disc = np.sqrt(np.maximum(radius * radius - height * height, 0.0))[:, None]
    flat = corner - height[:, None, None] * normal[:, None, :]  # about the foot
    length = np.sqrt(np.einsum("fki,fki->fk", side, side))
    unit = side / np.where(length > 0, length, 1.0)[..., None]
    start = np.einsum("fki,fki->fk", flat, unit)  # position of the side's start along its line
    away = np.einsum("fi,fki->fk", normal, np.cross(flat, unit))  # signed distance of the line from the foot
    half = np.sqrt(np.maximum(disc * disc - away * away, 0.0))
    first = np.clip(-half, start, start + length)
    last = np.maximum(np.clip(half, start, start + length), first)
    touched = disc > np.abs(away)
    chord = np.where(touched, last - first, 0.0)
    inner = 0.5 * away * chord

    def angle(position: NDArray) -> NDArray[np.float64]:
        return np.arctan2(position, np.abs(away))

    swept = angle(start + length) - angle(start)
    within = np.where(touched, angle(last) - angle(first), 0.0)
    sector = 0.5 * disc * disc * np.sign(away) * (swept - within)
    area = (inner + sector).sum(axis=1)
    return np.clip(area, 0.0, 0.5 * size[:, 0]), chord
