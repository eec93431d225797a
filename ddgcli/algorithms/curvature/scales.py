"""Mean curvature of a few vertices in balls of growing radius: what its changes show about the error.

From one radius to the next, longer by the square root of two, the error of noise falls by a factor of about
three and the bias doubles. So the change between the two is about the error at the smaller one, whichever of
them dominates, and without a model of the noise: stairs, lines of a scanner, rounded coordinates, spikes.
Balls larger than the features of a surface change little with the radius though their bias is large. So each
radius is also compared with all smaller ones, as Lepski's method does: curvature that is farther from theirs
than their noise explains is biased. Averaged normals flatten small features most: their curvature is compared
with that of fits in small balls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.scale_errors import (
    MAX_TAIL,
    RADIUS_RATIO,
    correlation,
    error_of_radii,
    kurtosis,
    least_between,
    mean_size,
    typical_size,
    whole_error,
)

MAX_SCALES = 12
MAX_GROWTH = 2.0  # of the change of curvature over the least one, beyond which wider balls are not tried
# of the bias from one radius to the next: quadratic fits of smooth surfaces double it, and averaged normals
# multiply it by 1.3 (rounded boxes) to 1.7 (tori)
QUADRATIC_BIAS_GROWTH, VOTING_BIAS_GROWTH = 2.0, 1.6
# mean noise of a quadratic fit times radius^3, over the deviation of the vertices and the root of the area of
# one: 2.7 to 3.5 on meshes of spheres, planes and tubes, in balls of three to six edges
NOISE_OF_FITS = 3.0
MIN_MEAN_SHARE = 0.25  # of the larger principal curvature: what counts as size of the mean curvature
MAX_CHANGE = 5.0  # of a vertex over the median one, in the stated error
# of the size with bounded tails over the whole one: less where most of a surface is flat, and its rims are
# what bends (other surfaces of the figures have 0.3 and more)
MIN_SIZE_WITHOUT_RIMS = 0.25
ERROR_MARGIN = 1.25  # of the error of other fits: a difference beyond that is surely not theirs
MAX_SURFACE_SHARE = 0.17  # of the surface's area that a ball may hold
MIN_TURNING = 1e-9  # radians over a ball: curvature below is rounding, as where balls hold the whole surface
MIN_ERROR = 0.01  # relative; all balls share some errors, as of the place of a staircase


class HiddenBias(Protocol):
    """Mean bias of curvature in balls that its changes with the radius do not show."""

    def __call__(
        self,
        default: NDArray,
        at: PrincipalCurvatures,
        after: PrincipalCurvatures,
        radius: float,
        *,
        bound: float,
    ) -> float: ...


@dataclass(frozen=True, eq=False)
class Scales:
    """Mean curvature of some vertices over the default region and in balls.

    Parameters
    ----------
    vertices : (k,) ndarray of int
    radius : (r,) ndarray
        Radii of the balls.
    change : (r,) ndarray
        Typical change of the mean curvature from each to the next, the default region before the first.
    best : int
        Of the radius with the least error.
    best_radius : float
        Where the error is least, between that radius and its neighbours.
    error, default_error, default_rms : float
        Relative errors of the mean curvature: mean over the vertices in the balls of that radius and over the
        default region, and root mean square over the latter.
    bending_error : float
        The first of these over the typical size of the larger principal curvature.
    own_error : float
        The first of these with the whole bias, of which the change to the next radius is a share, and with
        bounded changes at rims; over `stated_size`.
    default, first_mean, mean : (k,) ndarray
        Mean curvature over the default region, in the first balls and in those of the best radius.
    size : float
        What the errors are relative to.
    stated_size : float
        The same without the rims of a body, unless the rest is flat: what `expected_error`, `own_error` and
        errors in messages are relative to.
    median_share, kurtosis : float
        Of the difference between the default region and the balls of the best radius: the median of its size
        over the mean, and the mean fourth power over the squared mean square.
    max_change : float
        Of a vertex over the median one, in `own_error`.
    apart : float
        Difference from the curvature of other fits surely beyond the error of these (`apart_from`), over
        `size`.
    """

    vertices: NDArray[np.int64]
    radius: NDArray[np.float64]
    change: NDArray[np.float64]
    best: int
    best_radius: float
    error: float
    bending_error: float
    default_error: float
    default_rms: float
    own_error: float
    default: NDArray[np.float64]
    first_mean: NDArray[np.float64]
    mean: NDArray[np.float64]
    size: float
    stated_size: float
    median_share: float
    kurtosis: float
    max_change: float = MAX_CHANGE
    apart: float = 0.0

    @property
    def expected_error(self) -> float:
        """Mean error at the best radius over `stated_size`: the own one, or that seen by other fits."""
        return max(self.own_error, self.apart * self.size / self.stated_size)

    @property
    def fall(self) -> float:
        """First change of the curvature over the second one: of noise and of stairs more than of details."""
        return float(self.change[0] / self.change[1]) if self.change[1] > 0 else np.inf

    @property
    def correlation(self) -> float:
        """Correlation of the curvature over the default region with that in the first balls; 1 of none."""
        return correlation(self.default, self.first_mean)


def measure_scales(
    fits_at_radius: Callable[[float], PrincipalCurvatures | None],
    vertices: NDArray,
    default: NDArray,
    first: float,
    largest: float,
    bias_growth: float,
    *,
    reference: NDArray | None = None,
    other: NDArray | None = None,
    hidden_bias: HiddenBias | None = None,
    noise: float = np.inf,
    max_radii: int = MAX_SCALES,
) -> Scales | None:
    """Mean curvature of some vertices in balls whose radii grow by the square root of two.

    Parameters
    ----------
    fits_at_radius : callable
        Curvatures of the vertices in balls of a radius; None where these have too many members.
    vertices : (k,) ndarray of int
    default : (k,) ndarray
        Their mean curvature over the default region.
    first, largest : float
        Radius of a disk as large as the default region, and the largest radius.
    bias_growth : float
        Of the bias of these fits from one radius to the next, above 1.
    reference : (k,) ndarray, optional
        Mean curvature of other fits, which flatten small features less. Without it such fits gave `default`,
        so that their noise there bounds that in the first ball.
    other : (k,) ndarray, optional
        That of such fits in balls of their best radius.
    hidden_bias : callable, optional
        Mean bias that the changes do not show, from `default`, the fits of a radius and of the next one, the
        radius, and the largest bias of a vertex over the median one.
    noise : float
        Standard deviation of the vertices, if those of neighbours are independent, times the root of the area
        per vertex; else inf.
    max_radii : int
        At least two.

    Returns
    -------
    Scales or None
        None where fewer than two radii could be measured, or the surface hardly bends in the balls.
    """
    radii, fits = _fits_of_scales(fits_at_radius, first, largest, max_radii)
    if len(fits) < 2:
        return None
    mean = np.stack([fit.mean for fit in fits])
    known = NOISE_OF_FITS * noise / np.array(radii) ** 3
    error = error_of_radii(mean, default, reference, other=other, noise=known)
    best = int(np.argmin(error))
    larger = np.maximum(np.abs(fits[best].low), np.abs(fits[best].high))
    least_size = MIN_MEAN_SHARE * float(np.median(larger))
    size = max(float(np.mean(np.abs(mean[best]))), least_size)
    stated_size, max_change = max(mean_size(mean[best], MAX_TAIL), least_size), MAX_CHANGE
    if stated_size < MIN_SIZE_WITHOUT_RIMS * size:
        # the curvature jumps where rims begin: its bias is proportional to the radius
        stated_size, max_change, bias_growth = size, np.inf, min(bias_growth, RADIUS_RATIO)
    own_error = whole_error(mean, default, reference, best, bias_growth, max_change, known, other)
    # a default region that errs against the curvature, as in long cells, shows no bias of balls
    if hidden_bias is not None and correlation(default, mean[0]) > 0:
        hidden = hidden_bias(default, fits[best], fits[best + 1], radii[best], bound=max_change)
        own_error = float(np.hypot(own_error, hidden))
    if not size * radii[best] > MIN_TURNING:
        return None
    relative = max(float(error[best]) / size, MIN_ERROR)
    difference = np.abs(default - mean[best])
    measured = float(difference.mean())
    return Scales(
        vertices=vertices,
        default=default,
        radius=np.array(radii),
        change=np.array([typical_size(step) for step in np.diff(mean, axis=0, prepend=default[None])]),
        best=best,
        best_radius=least_between(np.array(radii), error, best),
        error=relative,
        bending_error=relative * size / max(float(np.median(larger)), size),
        own_error=max(own_error / stated_size, MIN_ERROR),
        default_error=float(np.hypot(measured / size, relative)),
        default_rms=float(np.sqrt(np.mean(difference**2))) / size,
        mean=mean[best],
        first_mean=mean[0],
        size=size,
        stated_size=stated_size,
        median_share=float(np.median(difference)) / measured if measured > 0 else 1.0,
        kurtosis=kurtosis(difference),
        max_change=max_change,
    )


def _fits_of_scales(
    fits_at_radius: Callable[[float], PrincipalCurvatures | None],
    first: float,
    largest: float,
    max_radii: int,
) -> tuple[list[float], list[PrincipalCurvatures]]:
    """Radii and fits, until the change from one radius to the next grows."""
    radii: list[float] = []
    fits: list[PrincipalCurvatures] = []
    growth: list[float] = []  # mean change from each radius to the next
    for radius in scale_radii(first, largest, max_radii):
        fit = fits_at_radius(radius)
        if fit is None:
            break
        fits.append(fit)
        radii.append(radius)
        if len(fits) > 1:
            growth.append(mean_size(fits[-1].mean - fits[-2].mean))
        if len(fits) > 3 and growth[-1] > MAX_GROWTH * min(growth):
            break
    return radii, fits


def apart_from(scales: Scales, other: Scales, step: int) -> Scales:
    """The same scales with the error by which they differ from those of other fits.

    Parameters
    ----------
    scales : Scales
    other : Scales
        Of other fits of independent errors. What their own error does not explain of the difference is the
        error of `scales`, such as features that averaged normals flatten at any radius.
    step : int
        From one vertex of `scales` to the next among those of `other`.

    Returns
    -------
    Scales
    """
    difference = mean_size(scales.mean - other.mean[::step], scales.max_change)
    of_other = ERROR_MARGIN * other.expected_error * other.stated_size
    own = float(np.sqrt(max(0.0, difference**2 - of_other**2)))
    return replace(scales, apart=own / scales.size)


def scale_radii(first: float, largest: float, max_radii: int) -> Iterator[float]:
    """Radii that grow by the square root of two: two at least, then up to the largest.

    Parameters
    ----------
    first, largest : float
        Radius before the first one, and the largest.
    max_radii : int

    Returns
    -------
    iterator of float
    """
    for k in range(max_radii):
        radius = first * RADIUS_RATIO ** (k + 1)
        if radius > largest and k > 1:
            return
        yield radius
