"""Sums over regions of vertices, and the normals of their total area vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.curvature.regions import Regions, chunks, cosines, regions_of_range
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.vectors import dot, ratio

MEMBERS_PER_BLOCK = 1_000_000
MIN_TOTAL_SHARE = 1e-12  # of the total area vector over the area: below, its direction is rounding


def star_areas(faces: Faces) -> NDArray[np.float64]:
    """Total area vectors of the stars of vertices, and their areas.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (4, n) ndarray of float64
        Twice the vectors and the areas, vertex by vertex in memory.
    """
    return np.asfortranarray(faces.stars(np.vstack([faces.doubled, faces.doubled_area])))


def averaged_normals(
    areas: NDArray, normal: NDArray, regions: Regions, *, member_normal: NDArray | None = None
) -> NDArray[np.float64]:
    """Directions of the total area vectors of regions.

    Parameters
    ----------
    areas : (4, n) ndarray of float64
        Areas of all vertices (`star_areas`).
    normal : (3, k) ndarray of float64
        Unit normals to return where the total is zero, as that of a closed surface.
    regions : Regions
        k regions of vertices.
    member_normal : (3, n) ndarray of float64, optional
        Unit normals of all vertices: only members whose normals are less than a right angle from that of
        their region count. The ball around a vertex of a thin body holds the other side too, whose area
        vectors would cancel those of this side.

    Returns
    -------
    (3, k) ndarray of float64
        Unit vectors.
    """
    sums = np.empty((4, normal.shape[1]))
    for first, last in chunks(regions, MEMBERS_PER_BLOCK):
        block, own = regions_of_range(regions, first, last), slice(first, last)
        if member_normal is not None:
            block = _same_side(member_normal, normal[:, own], block)
        sums[:, own] = region_sums(block, areas)
    total, size = sums[:3], sums[3]
    length = np.sqrt(dot(total, total))
    return np.where(length > MIN_TOTAL_SHARE * size, ratio(total, length), normal)


def _same_side(normal: NDArray, centre_normal: NDArray, regions: Regions) -> Regions:
    """Members whose normals are less than a right angle from that of the centre of their region."""
    count = regions.count
    keep = cosines(centre_normal, normal, count, regions.member.astype(np.intp, copy=False)) > 0
    row = np.repeat(np.arange(len(count), dtype=np.int32), count)[keep]
    return Regions(list_starts(np.bincount(row, minlength=len(count))), regions.member[keep])


def region_sums(regions: Regions, columns: NDArray) -> NDArray[np.float64]:
    """Sums of values at vertices over regions.

    Parameters
    ----------
    regions : Regions
        k regions of vertices.
    columns : (d, n) ndarray of float64

    Returns
    -------
    (d, k) ndarray of float64
    """
    n = columns.shape[1]
    rows, total = np.ascontiguousarray(columns.T), np.zeros((len(regions.start) - 1, len(columns)))
    for first, last in chunks(regions, MEMBERS_PER_BLOCK):
        start = regions.start[first : last + 1]
        member = regions.member[start[0] : start[-1]]
        start = (start - start[0]).astype(member.dtype)
        block = csr_array((np.ones(len(member)), member, start), shape=(last - first, n))
        total[first:last] = block @ rows
    return np.ascontiguousarray(total.T)
