"""Polynomial fits around a few vertices of a surface: in given regions, and in balls."""

from __future__ import annotations

from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.polynomial_fits import (
    QUADRATIC,
    QUARTIC,
    Basis,
    fit_forms,
    principal_of_forms,
)
from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.geometry.faces import Faces


def fits_in_balls(
    faces: Faces, grid: PointGrid, normal: NDArray, few: NDArray, radius: float
) -> PrincipalCurvatures:
    """Principal curvatures of fits in the balls around a few vertices, as `quadric` fits noisy surfaces.

    Parameters
    ----------
    faces : Faces
    grid : PointGrid
        Grid of all points.
    normal : (3, n) ndarray of float64
        Unit normals.
    few : (k,) ndarray of int64
        Centres.
    radius : float

    Returns
    -------
    PrincipalCurvatures
        Curvatures at the k vertices.
    """
    from ddgcli.algorithms.curvature.area_vectors import averaged_normals, star_areas  # imports scipy.sparse

    regions = grid.balls(few, radius)
    averaged = averaged_normals(star_areas(faces), normal[:, few], regions, member_normal=normal)
    return fits_at(faces.points, normal, few, averaged, regions, basis=QUADRATIC)


def fits_at(
    points: NDArray,
    normal: NDArray,
    few: NDArray,
    centre_normal: NDArray,
    regions: Regions,
    penalty: float = 0.0,
    *,
    basis: Basis = QUARTIC,
) -> PrincipalCurvatures:
    """Principal curvatures of fits around a few vertices.

    Parameters
    ----------
    points, normal : (3, n) ndarray of float64
        Positions and unit normals.
    few : (k,) ndarray of int64
        Centres.
    centre_normal : (3, k) ndarray of float64
        Unit normals of the planes over which the heights are fitted.
    regions : Regions
        One for each centre.
    penalty : float
        Penalty of the terms of degree three and four.
    basis : Basis
        Terms of the polynomials.

    Returns
    -------
    PrincipalCurvatures
        Curvatures at the k vertices.
    """
    gradient, hessian = fit_forms(
        points, normal, regions, penalty, points[:, few], centre_normal, basis=basis
    )
    return principal_of_forms(gradient, hessian, centre_normal)
