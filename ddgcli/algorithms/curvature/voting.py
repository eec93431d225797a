"""Curvature from averaged normals: robust to noise and to the stairs of voxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.area_vectors import averaged_normals, region_sums
from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, tangent_frame
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.polynomial_fits import principal_of_forms
from ddgcli.algorithms.curvature.regions import Regions, balls_around, larger
from ddgcli.algorithms.curvature.vertex_balls import vertex_balls
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, ratio

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

MIN_NEIGHBOURS = 15
MIN_DETERMINANT = 1e-12  # of the scatter of a region over its squared trace: below, the points lie on a line


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
        Of the ball, or of that of each vertex; a vertex whose ball holds fewer neighbours than its two rings
        keeps the rings.
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
    regions = neighbourhoods(mesh, faces, normal, MIN_NEIGHBOURS)
    if radius is not None:
        regions = larger(regions, vertex_balls(mesh, radius, jobs=jobs))
    averaged = averaged_normals(faces, normal, regions)
    hessian = _differential(faces.points, averaged, _weights(faces), regions, averaged)
    return principal_of_forms(np.zeros((2, mesh.n_vertices)), hessian, averaged)


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
        Of all vertices.
    radius : float
    max_pairs : float

    Returns
    -------
    PrincipalCurvatures or None
        Of the k vertices; None where the balls around all vertices of these balls would have more than
        `max_pairs` members.
    """
    regions = balls_around(faces.points, few, tree, radius)
    around, place = np.unique(regions.member, return_inverse=True)
    if len(around) * regions.count.mean() > max_pairs:
        return None
    own = balls_around(faces.points, around, tree, radius)
    averaged = averaged_normals(faces, normal[:, around], own)
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
    n = points.shape[1]
    pairs = [(points[i], points[j]) for i in range(3) for j in range(3)]
    pairs += [(normal[i], points[j]) for i in range(3) for j in range(3)]
    columns = [np.ones(n), *points, *normal, *(a * b for a, b in pairs)]
    sums = region_sums(regions, weight * np.stack(columns))
    k = sums.shape[1]
    mean = ratio(sums, np.broadcast_to(sums[0], sums.shape))
    centre, middle = mean[1:4], mean[4:7]
    scatter = mean[7:16].reshape(3, 3, k) - centre[:, None] * centre[None]
    change = mean[16:25].reshape(3, 3, k) - middle[:, None] * centre[None]
    axes = np.stack(tangent_frame(centre_normal))
    c, d = (np.einsum("ain,ijn,bjn->abn", axes, matrix, axes) for matrix in (scatter, change))
    determinant, trace = c[0, 0] * c[1, 1] - c[0, 1] ** 2, c[0, 0] + c[1, 1]
    sound = determinant > MIN_DETERMINANT * trace**2
    inverse = np.stack([np.stack([c[1, 1], -c[0, 1]]), np.stack([-c[0, 1], c[0, 0]])])
    inverse = np.where(sound, ratio(inverse, np.broadcast_to(determinant, inverse.shape)), 0.0)
    change = np.einsum("abn,bcn->acn", d, inverse)
    return -np.stack([change[0, 0], 0.5 * (change[0, 1] + change[1, 0]), change[1, 1]])
