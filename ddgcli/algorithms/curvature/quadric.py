"""Curvature from local fits: a height polynomial over the neighbours of every vertex.

The polynomial has degree four. Generalised cross-validation chooses one penalty for the terms of degree
three and four of the whole mesh: clean data get the accuracy of a quartic fit, noisy data the stability of a
quadratic one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.ball_blocks import BALLS_PER_BLOCK, leaves
from ddgcli.algorithms.curvature.fit_penalty import (
    QUADRATIC_PENALTY,
    cross_validated_penalty,
    sampled_regions,
    testable_regions,
)
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, tangent_frame, unit_normals
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.polynomial_fits import fit_forms, principal_of_forms
from ddgcli.algorithms.curvature.regions import Regions, chunks, joined, larger, listed
from ddgcli.algorithms.curvature.vertex_balls import VertexBalls
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import unit_vectors
from ddgcli.workers import results_in_order

_PENALTY_SAMPLE_SIZE = 96  # vertices whose fits choose among the penalties
_PAIRS_PER_TASK = 200_000  # of a process


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
        Faces of the mesh.
    normal : (3, n) ndarray
        Approximate unit normals.
    radius : float or (n,) ndarray, optional
        Radius of the balls, one or for each vertex; a vertex whose ball has fewer neighbours than its two
        rings keeps the rings.
    noisy : bool
        Whether noise is averaged in balls: by quadratic fits, over planes normal to the area vectors of the
        balls on the side of each vertex, as single normals are far off and stairs are not noise of single
        vertices.
    jobs : int
        Processes that fit blocks of vertices; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures
    """
    rings = neighbourhoods(mesh, faces, normal)
    balls = None if radius is None else VertexBalls.of(mesh, radius)
    areas = None
    if noisy and balls is not None:
        from ddgcli.algorithms.curvature.area_vectors import star_areas  # imports scipy.sparse

        areas, penalty = star_areas(faces), QUADRATIC_PENALTY
    else:
        penalty = _sampled_penalty(faces.points, normal, rings, balls)
    logging.getLogger("ddgcli").info("quadric: penalty %g on the terms of degree three and four", penalty)
    principal = _fits_of_all(_Surface(faces.points, normal, penalty, areas, rings, balls), jobs)
    return replace(principal, in_rings=balls is not None and principal.in_rings)


def fitted_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Unit normals at vertices of the polynomials that `quadric` fits over rings of neighbours.

    Means of the normals of faces err by the first power of the side length where the two principal curvatures
    differ, so that slopes of them do not converge on irregular meshes. Those of fits err by the second power
    at least, at boundaries too.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3) ndarray of float64
    """
    scale = float(mesh.side_length.max(initial=0.0)) or 1.0
    # squares stay in the floating-point range
    unit = mesh.moved_unchecked((mesh.points - mesh.points[:1]) / scale)
    faces = Faces.of(unit)
    normal = unit_normals(faces)
    rings = neighbourhoods(unit, faces, normal)
    penalty = _sampled_penalty(faces.points, normal, rings, None)
    (slope_x, slope_y), _ = fit_forms(faces.points, normal, rings, penalty, faces.points, normal)
    first, second = tangent_frame(normal)
    return unit_vectors((normal - slope_x * first - slope_y * second).T)


class _Surface(NamedTuple):
    """Data that all blocks of fits share: `areas` (`star_areas`) if normals are averaged, balls or None."""

    columns: NDArray
    normal: NDArray
    penalty: float
    areas: NDArray | None
    rings: Regions
    balls: VertexBalls | None


class _Fits(NamedTuple):
    """Fits around c vertices: over planes normal to `normal` (3, c)."""

    own: NDArray
    normal: NDArray
    gradient: NDArray
    hessian: NDArray
    in_rings: bool


def _fits_of_all(surface: _Surface, jobs: int) -> PrincipalCurvatures:
    n = surface.columns.shape[1]
    normal, gradient, hessian = np.zeros((3, n)), np.zeros((2, n)), np.zeros((3, n))
    in_rings = True
    tasks = ((blocks,) for blocks in _blocks(surface.rings, surface.balls))
    for fits in results_in_order(_fits, tasks, jobs, prepare=_Surface, arguments=surface):
        own = fits.own
        normal[:, own], gradient[:, own], hessian[:, own] = fits.normal, fits.gradient, fits.hessian
        in_rings = in_rings and fits.in_rings
    return replace(principal_of_forms(gradient, hessian, normal), in_rings=in_rings)


def _blocks(rings: Regions, balls: VertexBalls | None) -> Iterator[list[NDArray]]:
    """Lists of blocks of vertices near each other, with about `_PAIRS_PER_TASK` neighbours in all."""
    if balls is None:
        yield from ([np.arange(begin, end)] for begin, end in chunks(rings, _PAIRS_PER_TASK))
        return
    blocks = leaves(balls.tree)
    n_blocks = max(1, round(_PAIRS_PER_TASK / (BALLS_PER_BLOCK * balls.mean_size())))
    while several := list(islice(blocks, n_blocks)):
        yield several


def _fits(surface: _Surface, blocks: list[NDArray]) -> _Fits:
    own = np.concatenate(blocks)
    regions = rings = listed(surface.rings, own)
    if surface.balls is not None:
        regions = larger(rings, joined([surface.balls.around(block) for block in blocks]))
    centre_normal = surface.normal[:, own]
    if surface.areas is not None:
        from ddgcli.algorithms.curvature.area_vectors import averaged_normals  # imports scipy.sparse

        centre_normal = averaged_normals(surface.areas, centre_normal, regions, member_normal=surface.normal)
    columns = surface.columns
    forms = fit_forms(columns, surface.normal, regions, surface.penalty, columns[:, own], centre_normal)
    return _Fits(own, centre_normal, *forms, regions is rings)


def _sampled_penalty(columns: NDArray, normal: NDArray, rings: Regions, balls: VertexBalls | None) -> float:
    """`cross_validated_penalty` of a sample of vertices with narrow and wide rings."""
    few = sampled_regions(columns, columns, rings, _PENALTY_SAMPLE_SIZE)
    regions = listed(rings, few)
    if balls is not None and len(few):
        regions = larger(regions, joined([balls.around(one) for one in few[:, None]]))
        able = testable_regions(regions)
        few, regions = few[able], listed(regions, able)
    return cross_validated_penalty(columns, normal, regions, few)
