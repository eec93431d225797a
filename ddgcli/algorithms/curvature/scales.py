"""Mean curvature of a few vertices in balls of growing radius: what its changes say about the error.

From one radius to the next, longer by the square root of two, the error of noise falls by a factor of about
three and the bias doubles. So the change between the two is about the error at the smaller one, whichever of
them dominates, and without a model of the noise: stairs, lines of a scanner, rounded coordinates, spikes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.quadric import QUADRATIC_PENALTY, fit_forms, principal_of_forms
from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.mesh.vectors import unit_vectors as unit_rows

RADIUS_RATIO = 2**0.5
MAX_SCALES = 12
TYPICAL_SHARE = 0.65  # of the vertices, by whose changes the radius is chosen
MAX_GROWTH = 3.0  # of the change of curvature over the least one, behind which wider balls are not tried
BIAS_RATIO, NOISE_RATIO = 2.0, 2.8  # least ones of the errors at neighbouring radii, against chance
MIN_MEAN_SHARE = 0.25  # of the larger principal curvature: what counts as size of the mean curvature
MAX_SURFACE_SHARE = 0.17  # of the surface's area that a ball may hold
MIN_ERROR = 0.01  # relative; all balls share some errors, as of the place of a staircase


@dataclass(frozen=True, eq=False)
class Scales:
    """Mean curvature of some vertices over the default region and in balls.

    Parameters
    ----------
    vertices : (k,) ndarray of int
    radius : (r,) ndarray
        Radii of the balls.
    change : (r,) ndarray
        Mean change of the mean curvature from each to the next, the default region before the first.
    best : int
        Of the radius with the least error.
    error, default_error, default_rms : float
        Relative errors of the mean curvature: mean over the vertices in the balls of that radius and over the
        default region, and root mean square over the latter.
    default, first_mean, mean : (k,) ndarray
        Mean curvature over the default region, in the first balls and in those of the best radius.
    size : float
        What the errors are relative to.
    median_share : float
        Median over mean of the difference between the default region and the balls of the best radius.
    """

    vertices: NDArray[np.int64]
    radius: NDArray[np.float64]
    change: NDArray[np.float64]
    best: int
    error: float
    default_error: float
    default_rms: float
    default: NDArray[np.float64]
    first_mean: NDArray[np.float64]
    mean: NDArray[np.float64]
    size: float
    median_share: float


def measure_scales(
    fits_at_radius: Callable[[float], PrincipalCurvatures],
    vertices: NDArray,
    default: NDArray,
    first: float,
    largest: float,
) -> Scales | None:
    """Mean curvature of some vertices in balls whose radii grow by the square root of two.

    Parameters
    ----------
    fits_at_radius : callable
        Curvatures of the vertices in balls of a radius.
    vertices : (k,) ndarray of int
    default : (k,) ndarray
        Their mean curvature over the default region.
    first, largest : float
        Radius of a disk as large as the default region, and the largest radius.
    """
    radii: list[float] = []
    fits: list[PrincipalCurvatures] = []
    change: list[float] = []
    while len(radii) < MAX_SCALES:
        radius = first * RADIUS_RATIO ** (len(radii) + 1)
        if radius > largest and len(radii) > 1:
            break
        fits.append(fits_at_radius(radius))
        radii.append(radius)
        before = default if len(fits) == 1 else fits[-2].mean
        change.append(typical_size(fits[-1].mean - before))
        if len(fits) > 3 and change[-1] > MAX_GROWTH * min(change[1:]):
            break
    steps = np.array(change)
    bias = np.append(steps[2:] / BIAS_RATIO, 0.0)
    error = np.maximum(np.maximum(steps[1:], bias), steps[:-1] / NOISE_RATIO)
    best = int(np.argmin(error))
    larger = np.maximum(np.abs(fits[best].low), np.abs(fits[best].high))
    size = max(float(np.mean(np.abs(fits[best].mean))), MIN_MEAN_SHARE * float(np.median(larger)))
    if not size > 0:
        return None
    # the mean over all vertices, those at creases too, at the best radius for most
    growth = float(np.mean(np.abs(fits[best + 1].mean - fits[best].mean)))
    relative = max(float(error[best]) / size, growth / size, MIN_ERROR)
    difference = np.abs(default - fits[best].mean)
    measured = float(difference.mean())
    return Scales(
        vertices=vertices,
        default=default,
        radius=np.array(radii),
        change=steps,
        best=best,
        error=relative,
        default_error=float(np.hypot(measured / size, relative)),
        default_rms=float(np.sqrt(np.mean(difference**2))) / size,
        mean=fits[best].mean,
        first_mean=fits[0].mean,
        size=size,
        median_share=float(np.median(difference)) / measured if measured > 0 else 1.0,
    )


def typical_size(difference: NDArray) -> float:
    """Mean size, the largest left out: creases and boundaries have differences at any radius."""
    size = np.sort(np.abs(difference))
    return float(size[: max(1, int(TYPICAL_SHARE * len(size)))].mean())


def fits_in_balls(
    points: NDArray, grid: PointGrid, normal: NDArray, few: NDArray, radius: float
) -> PrincipalCurvatures:
    """Principal curvatures of quadratic fits in the balls around a few vertices; `grid` has all points."""
    regions = grid.balls(few, radius)
    start, member = regions.start, regions.member
    # the mean normal of the ball: single normals of noise and of voxels are far off
    around = np.take(normal, member, axis=1)
    same = np.einsum("ij,ij->j", around, np.repeat(normal[:, few], np.diff(start), axis=1)) > 0
    mean = unit_rows(np.add.reduceat(np.where(same, around, 0.0), start[:-1], axis=1).T).T
    return fits_at(points, normal, few, mean, regions, QUADRATIC_PENALTY)


def fits_at(
    points: NDArray, normal: NDArray, few: NDArray, centre_normal: NDArray, regions: Regions, penalty: float
) -> PrincipalCurvatures:
    """Principal curvatures of fits around a few vertices, one region for each."""
    columns = np.concatenate([points[:, few], np.take(points, regions.member, axis=1)], axis=1)
    normals = np.concatenate([centre_normal, np.take(normal, regions.member, axis=1)], axis=1)
    own = Regions(regions.start, len(few) + np.arange(len(regions.member)))
    gradient, hessian = fit_forms(columns, normals, own, penalty)
    k = slice(0, len(few))
    return principal_of_forms(gradient[:, k], hessian[:, k], normals[:, k])
