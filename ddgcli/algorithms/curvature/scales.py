"""Mean curvature of a few vertices in balls of growing radius, and its error, estimated from the changes.

From one radius to the next, which is longer by the square root of two, the error due to noise falls by a
factor of about three, and the bias doubles. The change between the two is therefore about the error at the
smaller radius, whichever of the two dominates. This needs no model of the noise, which may be stairs, lines
of a scanner, rounded coordinates or spikes. In balls larger than the features of a surface, the curvature
changes little with the radius though its bias is large. Each radius is therefore also compared with all
smaller ones (Lepski's method): a difference that their noise does not explain is bias. Averaged normals
flatten small features most, so their curvature is compared with that of fits in small balls.
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

MAX_SCALES = 12  # number of radii
MAX_GROWTH = 2.0  # change of the curvature over the least change, above which wider balls are not tried
# Growth of the bias from one radius to the next: 2 for quadratic fits of smooth surfaces; 1.3 (rounded boxes)
# to 1.7 (tori) for averaged normals.
QUADRATIC_BIAS_GROWTH, VOTING_BIAS_GROWTH = 2.0, 1.6
# Mean noise of a quadratic fit times radius^3, over the deviation of the vertices and the square root of the
# area per vertex: 2.7 to 3.5 on meshes of spheres, planes and tubes, in balls of three to six edges.
NOISE_OF_FITS = 3.0
# Least size of the mean curvature to which errors are relative, over the larger principal curvature.
MIN_MEAN_SHARE = 0.25
MAX_CHANGE = 5.0  # bound of the change at a vertex over the median change, in stated errors
# Size of the mean curvature with bounded tails over the size without bounds, below which only the rims of a
# surface are curved and the rest is flat; the other surfaces of docs/accuracy have 0.3 or more.
MIN_SIZE_WITHOUT_RIMS = 0.25
ERROR_MARGIN = 1.25  # factor on the error of other fits, beyond which a difference is not due to them
MAX_SURFACE_SHARE = 0.17  # largest share of the surface's area in a ball
# Curvature times radius below which the curvature is rounding, as if each ball contains the whole surface.
MIN_TURNING = 1e-9
MIN_ERROR = 0.01  # least relative error: balls of all radii share some errors, such as the offset of stairs


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
        Typical change of the mean curvature to each radius from the one before (first: the default region).
    best : int
        Index of the radius with the least error.
    best_radius : float
        Radius of the least error by interpolation between that radius and its neighbours.
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
        Mean absolute mean curvature, to which the errors are relative.
    stated_size : float
        The same without the rims of a body, unless the rest is flat: `expected_error`, `own_error` and errors
        in messages are relative to it.
    median_share, kurtosis : float
        Statistics of the difference between the default region and the balls of the best radius: its median
        absolute value over the mean one, and its mean fourth power over the squared mean square.
    max_change : float
        Bound of the change at a vertex over the median change, in `own_error`.
    apart : float
        Difference from the curvature of other fits that their error does not explain (`apart_from`), over
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
        """Mean error at the best radius over `stated_size`: `own_error`, or the distance to other fits."""
        return max(self.own_error, self.apart * self.size / self.stated_size)

    @property
    def fall(self) -> float:
        """First change of the curvature over the second one: larger for noise and stairs than for details."""
        return float(self.change[0] / self.change[1]) if self.change[1] > 0 else np.inf

    @property
    def correlation(self) -> float:
        """Correlation of the curvatures over the default region and in the first balls; 1 if constant."""
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
        Curvatures of the vertices in balls of a radius; None if these contain too many vertices.
    vertices : (k,) ndarray of int
    default : (k,) ndarray
        Their mean curvature over the default region.
    first, largest : float
        Radius of a disk as large as the default region, and the largest radius.
    bias_growth : float
        Growth of the bias of these fits from one radius to the next, above 1.
    reference : (k,) ndarray, optional
        Mean curvature of other fits, which flatten small features less. Without it, `default` must be from
        the same fits, so that its noise bounds that in the first ball.
    other : (k,) ndarray, optional
        Mean curvature of such other fits in balls of their best radius.
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
        None if fewer than two radii could be measured, or the surface is nearly flat in the balls.
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
        Scales of other fits with independent errors. The part of the difference that their error does not
        explain is an error of `scales`, such as features that averaged normals flatten at any radius.
    step : int
        Every `step`-th vertex of `other` is one of `scales`.

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
