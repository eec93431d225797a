"""Curvature from local fits: a height polynomial over the neighbours of every vertex.

The polynomial has degree four. Generalised cross-validation chooses one penalty for the terms of degree
three and four of the whole mesh: clean data get the accuracy of a quartic fit, noisy data the stability of a
quadratic one.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.fit_penalty import (
    QUADRATIC_PENALTY,
    cross_validated_penalty,
    sampled_regions,
)
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.polynomial_fits import fit_forms, principal_of_forms
from ddgcli.algorithms.curvature.regions import Regions, larger, listed
from ddgcli.algorithms.curvature.vertex_balls import vertex_balls
from ddgcli.mesh.triangle_mesh import TriangleMesh

_PENALTY_SAMPLE_SIZE = 96  # vertices whose fits choose among the penalties
_MIN_NEIGHBOURS = 15  # below which a third ring is added


def quadric(
    mesh: TriangleMesh,
    faces: Faces,
    normal: NDArray,
    radius: float | NDArray | None = None,
    *,
    noisy: bool = False,
    jobs: int = 1,
) -> PrincipalCurvatures:
    """Principal curvatures of polynomial fits over rings of neighbours (`neighbourhoods`) or a ball.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    normal : (3, n) ndarray
        Approximate unit normals.
    radius : float or (n,) ndarray, optional
        Of the ball, or of that of each vertex; a vertex whose ball holds fewer neighbours than its two rings
        keeps the rings.
    noisy : bool
        Whether noise is averaged in balls: by quadratic fits, over planes normal to the area vectors of the
        balls on the side of each vertex, as single normals are far off and stairs are no noise of single
        vertices.
    jobs : int
        Processes that fit blocks of vertices; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures
    """
    rings = regions = neighbourhoods(mesh, faces, normal, _MIN_NEIGHBOURS)
    if radius is not None:
        regions = larger(rings, vertex_balls(mesh, radius, jobs=jobs))
    columns, member_normal = faces.points, normal
    if noisy and radius is not None:
        from ddgcli.algorithms.curvature.area_vectors import averaged_normals  # imports scipy.sparse

        normal = averaged_normals(faces, normal, regions, member_normal=normal)
        penalty = QUADRATIC_PENALTY
    else:
        penalty = _sampled_penalty(columns, normal, regions)
    logging.getLogger("ddgcli").info("quadric: penalty %g on the terms of degree three and four", penalty)
    gradient, hessian = fit_forms(columns, normal, regions, penalty, jobs=jobs, member_normal=member_normal)
    principal = principal_of_forms(gradient, hessian, normal)
    return replace(principal, in_rings=radius is not None and regions is rings)


def _sampled_penalty(columns: NDArray, normal: NDArray, regions: Regions) -> float:
    """`cross_validated_penalty` of a sample of vertices with small and large neighbourhoods."""
    able = sampled_regions(columns, columns, regions, _PENALTY_SAMPLE_SIZE)
    return cross_validated_penalty(columns, normal, listed(regions, able), able)
