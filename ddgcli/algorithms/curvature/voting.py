"""Curvature from averaged normals: robust to noise and to the stairs of voxels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.area_vectors import averaged_normals, region_sums, star_areas
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, tangent_frame
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.polynomial_fits import principal_of_forms
from ddgcli.algorithms.curvature.regions import (
    Regions,
    balls_around,
    chunks,
    larger,
    listed,
    regions_of_range,
)
from ddgcli.algorithms.curvature.vertex_balls import vertex_balls
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, ratio

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

MIN_DETERMINANT = 1e-12  # of the scatter of a region over its squared trace: below, the points lie on a line
# of a region's squared extent over its squared distance to the origin, below which moments are taken again
# about its own centre: above, they keep eight digits
MIN_SPREAD = 1e-8
MAX_TIGHT_MEMBERS = 200_000  # whose moments are taken at once


def normal_voting(
    mesh: TriangleMesh,
    faces: Faces,
    normal: NDArray,
    radius: float | NDArray | None = None,
    *,
    jobs: int = 1,
) -> PrincipalCurvatures:
    """Principal curvatures of the change of averaged normals over rings of neighbours or a ball.

    The normal of a vertex is that of the total area vector of its region: it depends on the outline of the
    region alone, so that stairs and noise inside cancel. Its differential is the linear map that fits the
    averaged normals over the same region by least squares, each vertex with its area. On a sphere both steps
    are exact for symmetric regions of any size; the regions of irregular meshes are symmetric in balls of
    many edges only.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
    normal : (3, n) ndarray
        Unit normals, for the choice of rings.
    radius : float or (n,) ndarray, optional
        Radius of the balls, one or for each vertex; a vertex whose ball has fewer neighbours than its two
        rings keeps the rings.
    jobs : int
        Processes that search the balls; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    D. L. Page et al., "Normal vector voting", 2002, and M. Salfer et al., "Reliable estimation of membrane
    curvature", 2020, vote along geodesics; here the regions are balls and the vote a fit.
    """
    rings = regions = neighbourhoods(mesh, faces, normal)
    if radius is not None:
        regions = larger(rings, vertex_balls(mesh, radius, jobs=jobs))
    averaged = averaged_normals(star_areas(faces), normal, regions)
    hessian = _differential(faces.points, averaged, _weights(faces), regions, averaged)
    principal = principal_of_forms(np.zeros((2, mesh.n_vertices)), hessian, averaged)
    return replace(principal, in_rings=radius is not None and regions is rings)


def normal_voting_at(
    faces: Faces, normal: NDArray, few: NDArray, tree: cKDTree, radius: float, max_pairs: float
) -> PrincipalCurvatures | None:
    """Principal curvatures of `normal_voting` at a few vertices, in balls that need not be connected.

    Parameters
    ----------
    faces : Faces
    normal : (3, n) ndarray of float64
        Unit normals.
    few : (k,) ndarray of int64
        Vertices to measure.
    tree : cKDTree
        k-d tree of all vertices.
    radius : float
    max_pairs : float

    Returns
    -------
    PrincipalCurvatures or None
        Curvatures at the k vertices; None if the balls around all vertices of these balls would have more
        than `max_pairs` members.
    """
    regions = balls_around(faces.points, few, tree, radius)
    around, place = np.unique(regions.member, return_inverse=True)
    if len(around) * regions.count.mean() > max_pairs:
        return None
    own = balls_around(faces.points, around, tree, radius)
    averaged = averaged_normals(star_areas(faces), normal[:, around], own)
    local = Regions(regions.start, place.astype(np.int64))
    centre = averaged[:, np.searchsorted(around, few)]
    weight = _weights(faces)[around]
    hessian = _differential(faces.points[:, around], averaged, weight, local, centre)
    return principal_of_forms(np.zeros((2, len(few))), hessian, centre)


def _weights(faces: Faces) -> NDArray[np.float64]:
    return faces.stars(np.sqrt(dot(faces.doubled, faces.doubled))[None])[0]


def _differential(
    points: NDArray, normal: NDArray, weight: NDArray, regions: Regions, centre_normal: NDArray
) -> NDArray[np.float64]:
    """(3, k) second derivatives of heights over the tangent planes: minus the symmetric differential."""
    scatter, change = _centred_moments(points, normal, weight, regions)
    axes = np.stack(tangent_frame(centre_normal))
    c, d = (np.einsum("ain,ijn,bjn->abn", axes, matrix, axes) for matrix in (scatter, change))
    determinant, trace = c[0, 0] * c[1, 1] - c[0, 1] ** 2, c[0, 0] + c[1, 1]
    sound = determinant > MIN_DETERMINANT * trace**2
    inverse = np.stack([np.stack([c[1, 1], -c[0, 1]]), np.stack([-c[0, 1], c[0, 0]])])
    inverse = np.where(sound, ratio(inverse, np.broadcast_to(determinant, inverse.shape)), 0.0)
    change = np.einsum("abn,bcn->acn", d, inverse)
    return -np.stack([change[0, 0], 0.5 * (change[0, 1] + change[1, 0]), change[1, 1]])


def _centred_moments(
    points: NDArray, normal: NDArray, weight: NDArray, regions: Regions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3, 3, k) covariances of the positions of regions, and of their normals with their positions."""
    scatter, change, centre = _moments(region_sums(regions, _moment_columns(points, normal, weight)))
    tight = np.flatnonzero(np.trace(scatter) < MIN_SPREAD * dot(centre, centre))
    # moments about one origin lose the digits of regions that are small beside their distance to it
    few = listed(regions, tight)
    for first, last in chunks(few, MAX_TIGHT_MEMBERS):
        block, place = regions_of_range(few, first, last), tight[first:last]
        member = block.member.astype(np.intp, copy=False)
        offset = points[:, member] - np.repeat(centre[:, place], block.count, axis=1)
        columns = _moment_columns(offset, normal[:, member], weight[member])
        scatter[..., place], change[..., place], _ = _moments(
            np.add.reduceat(columns, block.start[:-1], axis=1)
        )
    return scatter, change


def _moment_columns(points: NDArray, normal: NDArray, weight: NDArray) -> NDArray[np.float64]:
    """(25, n) weighted products whose sums `_moments` takes."""
    pairs = [points[i] * points[j] for i in range(3) for j in range(3)]
    pairs += [normal[i] * points[j] for i in range(3) for j in range(3)]
    return weight * np.stack([np.ones(points.shape[1]), *points, *normal, *pairs])


def _moments(sums: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Two covariances (3, 3, k) and the mean positions (3, k) from sums (25, k) of `_moment_columns`."""
    k = sums.shape[1]
    mean = ratio(sums, np.broadcast_to(sums[0], sums.shape))
    centre, middle = mean[1:4], mean[4:7]
    scatter = mean[7:16].reshape(3, 3, k) - centre[:, None] * centre[None]
    change = mean[16:25].reshape(3, 3, k) - middle[:, None] * centre[None]
    return scatter, change, centre
