"""Tangential redistribution: vertices slide along the surface towards better triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, tangential

MIN_ANGLE = np.radians(40.0)  # vertices of faces with a smaller angle slide
MAX_SECTOR_SHARE = 0.5  # of the way to the opposite side of the face that a vertex slides into


def redistribute(mesh: TriangleMesh, normal: NDArray, movable: NDArray) -> TriangleMesh | None:
    """Slide vertices along the surface where angles are small.

    Each movable vertex of a face with an angle below MIN_ANGLE moves to the mean of its neighbours in the
    tangent plane, and back onto the surface: the quadratic patch through the corners of the face with the
    vertex normals at the corners. A slide that makes the smallest angle around its vertex smaller is undone.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (n, 3) ndarray
        Unit vertex normals.
    movable : (n,) ndarray of bool

    Returns
    -------
    TriangleMesh or None
        None where no vertex slides.

    Notes
    -----
    The patch is exact for quadratic height functions: with exact normals the surface moves by O(h^3).
    It is that of T. Boubekeur, M. Alexa, "Phong tessellation", 2008, with the factor 1/2.
    """
    before = _star_angle(mesh)
    sliding = movable & (before < MIN_ANGLE)
    if not sliding.any():
        return None
    target = _slid_points(mesh, normal, sliding)
    for _ in range(3):  # a slide undone changes the stars beside it
        points = np.where(sliding[:, None], target, mesh.points)
        worse = sliding & ~(_star_angle(mesh.moved_unchecked(points)) > before)
        if not worse.any():
            break
        sliding &= ~worse
    return mesh.moved_unchecked(np.where(sliding[:, None], target, mesh.points)) if sliding.any() else None


def _star_angle(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n,) smallest angle of the faces at each vertex."""
    smallest = np.full(mesh.n_vertices, np.inf)
    angle = corner_angle(mesh.side_length).min(axis=1)
    np.minimum.at(smallest, mesh.faces.ravel(), np.repeat(angle, 3))
    return smallest


def _slid_points(mesh: TriangleMesh, normal: NDArray, sliding: NDArray) -> NDArray[np.float64]:
    """(n, 3) sliding vertices at the mean of their neighbours, on the quadratic patch of the face there.

    Other vertices beside them move too, to places without a meaning.
    """
    x, n = mesh.points, mesh.n_vertices
    faces = mesh.faces[sliding[mesh.faces].any(axis=1)]
    corner = x[faces]
    ahead, behind = corner[:, NEXT] - corner, corner[:, PREVIOUS] - corner
    count = sum_by_index(faces, np.full(faces.shape, 2.0), n)
    with np.errstate(divide="ignore", invalid="ignore"):
        slide = sum_by_index(faces, ahead + behind, n) / count[:, None]
    slide = tangential(slide, normal)
    # coordinates of the slide in each sector, seen along the vertex normal
    up, shift = normal[faces], slide[faces]
    with np.errstate(divide="ignore", invalid="ignore"):
        span = _triple(up, ahead, behind)
        first, second = _triple(up, shift, behind) / span, _triple(up, ahead, shift) / span
    inside = np.where(span > 0, np.nan_to_num(np.minimum(first, second), nan=-np.inf), -np.inf).ravel()
    vertex, best = _first_of_largest(faces.ravel(), inside, n)
    first, second = first.ravel()[best], second.ravel()[best]
    usable = np.isfinite(inside[best]) & np.isfinite(first + second)
    first, second = np.maximum(first, 0.0), np.maximum(second, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(1.0, MAX_SECTOR_SHARE / (first + second))
    first, second = share * first, share * second
    face, k = best // 3, best % 3
    weight = np.stack([1.0 - first - second, first, second], axis=1)
    vertices = faces[face[:, None], (k[:, None] + np.arange(3)) % 3]
    flat = np.einsum("vk,vkj->vj", weight, x[vertices])
    height = row_dot(flat[:, None] - x[vertices], normal[vertices])
    curved = flat - 0.5 * np.einsum("vk,vk,vkj->vj", weight, height, normal[vertices])
    points = np.array(x)
    points[vertex[usable]] = curved[usable]
    return points


def _first_of_largest(key: NDArray, value: NDArray, n: int) -> tuple[NDArray, NDArray]:
    """The keys below n that occur, and for each the place of its largest value, the first of equal ones."""
    largest = np.full(n, -np.inf)
    np.maximum.at(largest, key, value)
    place = np.flatnonzero(value == largest[key])
    first = np.full(n, len(key))
    np.minimum.at(first, key[place], place)
    occurs = np.flatnonzero(first < len(key))
    return occurs, first[occurs]


def _triple(a: NDArray, b: NDArray, c: NDArray) -> NDArray[np.float64]:
    return row_dot(a, row_cross(b, c))
