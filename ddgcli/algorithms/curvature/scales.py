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

RADIUS_RATIO = 2**0.5
MAX_SCALES = 12
TYPICAL_SHARE = 0.65  # of the vertices, those with the least changes
MAX_GROWTH = 2.0  # of the change of curvature over the least one, behind which wider balls are not tried
MAX_NOISE_RATIO = (
    4.0  # of errors at neighbouring radii: quadratic fits of noise and of voxels have 2.6 to 3.3
)
# distance of curvature to that in much wider balls over its change to the next radius, where noise dominates:
# the changes of independent vertices and of voxels have 1.0 to 1.2
MAX_NOISE_DISTANCE = 1.3
# change to the next radius over the one after it: below this it is not that of noise. A distance of so many
# times the noise there, which is known from the residuals of fits, is bias
MIN_NOISE_FALL, MAX_KNOWN_NOISE = 2.0, 1.5
# mean noise of a quadratic fit times radius^3, over the deviation of the vertices and the root of the area of
# one: on random and regular meshes of spheres, planes and tubes
NOISE_OF_FITS = 3.0
# of the error over a change of the mean of all vertices that has grown, as bias does: twice it where the bias
# doubles once more, as it does not on tubes, in balls wider than these
MIN_SHARED_RATIO = 1.25
MAX_CHANCE = 2.5  # standard errors of the mean change of some vertices
MIN_SIGNIFICANCE = 3.0  # of a squared difference, over that which noise leaves by chance
# of the bias from one radius to the next: quadratic fits of smooth surfaces double it, and averaged normals
# multiply it by 1.3 (rounded boxes) to 1.7 (tori)
QUADRATIC_BIAS_GROWTH, VOTING_BIAS_GROWTH = 2.0, 1.6
MIN_MEAN_SHARE = 0.25  # of the larger principal curvature: what counts as size of the mean curvature
MAX_CHANGE = 5.0  # of a vertex over the median one, in the stated error
# times the median size: more is at rims and spikes; normal noise has more at 4 % of the vertices
MAX_TAIL = 3.0
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
        return _correlation(self.default, self.first_mean)


def measure_scales(
    fits_at_radius: Callable[[float], PrincipalCurvatures | None],
    vertices: NDArray,
    default: NDArray,
    first: float,
    largest: float,
    bias_growth: float,
    *,
    reference: NDArray | None = None,
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
    error = error_of_radii(mean, default, reference, noise=known)
    best = int(np.argmin(error))
    larger = np.maximum(np.abs(fits[best].low), np.abs(fits[best].high))
    least_size = MIN_MEAN_SHARE * float(np.median(larger))
    size = max(float(np.mean(np.abs(mean[best]))), least_size)
    stated_size, max_change = max(_mean_size(mean[best], MAX_TAIL), least_size), MAX_CHANGE
    if stated_size < MIN_SIZE_WITHOUT_RIMS * size:
        # the curvature jumps where rims begin: its bias is proportional to the radius
        stated_size, max_change, bias_growth = size, np.inf, min(bias_growth, RADIUS_RATIO)
    whole_error = _whole_error(mean, default, reference, best, bias_growth, max_change, known)
    # a default region that errs against the curvature, as in long cells, shows no bias of balls
    if hidden_bias is not None and _correlation(default, mean[0]) > 0:
        hidden = hidden_bias(default, fits[best], fits[best + 1], radii[best], bound=max_change)
        whole_error = float(np.hypot(whole_error, hidden))
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
        best_radius=_least_between(np.array(radii), error, best),
        error=relative,
        bending_error=relative * size / max(float(np.median(larger)), size),
        own_error=max(whole_error / stated_size, MIN_ERROR),
        default_error=float(np.hypot(measured / size, relative)),
        default_rms=float(np.sqrt(np.mean(difference**2))) / size,
        mean=mean[best],
        first_mean=mean[0],
        size=size,
        stated_size=stated_size,
        median_share=float(np.median(difference)) / measured if measured > 0 else 1.0,
        kurtosis=_kurtosis(difference),
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
            growth.append(_mean_size(fits[-1].mean - fits[-2].mean))
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
    difference = _mean_size(scales.mean - other.mean[::step], scales.max_change)
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


def error_of_radii(
    mean: NDArray,
    default: NDArray | None = None,
    reference: NDArray | None = None,
    *,
    bound: float = np.inf,
    noise: NDArray | None = None,
) -> NDArray[np.float64]:
    """(r - 1,) error of curvatures (r, k) of k vertices at each radius but the last, by their changes.

    The mean change to the next radius; or, if that is more, the distance to the curvature at a smaller radius
    beyond the noise of that; or the error that all vertices share (`_shared_error`); or the flattening of
    `reference` (k,); or a share of the change from the radius before, at the first one from the default
    region (k,), if there is one and no reference. Where the change to the next radius does not fall as noise
    does, the known `noise` (r,) bounds that of a radius: waves change from each radius to the next, until
    balls hold them whole.

    Notes
    -----
    O. Lepski, "On a problem of adaptive estimation in Gaussian white noise", 1991.
    """
    change = np.array([_mean_size(after - at, bound) for after, at in zip(mean[1:], mean)])
    first = 0.0 if default is None or reference is not None else _mean_size(mean[0] - default, bound)
    before = np.append(first, change[:-1])
    error = np.maximum(change, before / MAX_NOISE_RATIO)
    steady = np.append(change[:-1] < MIN_NOISE_FALL * change[1:], False)
    for j in range(1, len(error)):
        distance = np.array([_mean_size(before - mean[j], bound) for before in mean[:j]])
        error[j] = max(error[j], float((distance - MAX_NOISE_DISTANCE * change[:j]).max()))
        if noise is not None:
            biased = steady[:j] & (distance > MAX_KNOWN_NOISE * noise[:j])
            error[j] = max(error[j], float(distance.max(initial=0.0, where=biased)))
    error = np.maximum(error, _shared_error(mean))
    if reference is None:
        return error
    return np.maximum(error, [flattening(reference, at) for at in mean[:-1]])


def _shared_error(mean: NDArray) -> NDArray[np.float64]:
    """(r - 1,) error at each radius but the last of the mean of all k vertices, in which noise averages.

    The distance to that mean at a smaller radius, beyond the noise of that; or a multiple of the change from
    the radius before, where this is larger than the change before it, as that of noise is not.
    """
    step = np.diff(mean, axis=0)
    drift, chance = step.mean(axis=1), MAX_CHANCE * step.std(axis=1) / mean.shape[1] ** 0.5
    size = np.abs(drift)
    error = np.zeros(len(step))
    for j in range(1, len(step)):
        distance = np.abs((mean[:j] - mean[j]).mean(axis=1))
        error[j] = (distance - MAX_NOISE_DISTANCE * size[:j] - chance[:j]).max()
        if j > 1 and drift[j - 1] * drift[j - 2] > 0 and size[j - 1] >= size[j - 2]:
            error[j] = max(error[j], MIN_SHARED_RATIO * size[j - 1])
    return error


def flattening(reference: NDArray, mean: NDArray) -> float:
    """Mean size of the variation of a reference that curvature in wider balls follows, but not to its height.

    Noise of the reference is independent of the curvature in wider balls, of which it is an average: what the
    regression of their difference on the latter explains, beyond what noise leaves by chance, is its bias.

    Parameters
    ----------
    reference, mean : (k,) ndarray of float64

    Returns
    -------
    float
    """
    variation, rest = mean - mean.mean(), reference - mean
    rest = _without_tails(rest - rest.mean())  # stairs shift the curvature of fits
    square = float(variation @ variation)
    explained = variation * (float(variation @ rest) / square if square > 0 else 0.0)
    size, by_chance = float(explained @ explained), float(np.sum((rest - explained) ** 2)) / len(rest)
    significant = max(0.0, 1 - MIN_SIGNIFICANCE * by_chance / size) if size > 0 else 0.0
    return float(np.abs(explained).mean()) * significant**0.5


def _without_tails(values: NDArray) -> NDArray[np.float64]:
    """Values clipped at a few times their median size."""
    most = MAX_TAIL * float(np.median(np.abs(values)))
    return np.clip(values, -most, most)


def _correlation(one: NDArray, other: NDArray) -> float:
    """Correlation of two values of the same vertices, without tails; 1 where one of them is constant."""
    a, b = (_without_tails(values - values.mean()) for values in (one, other))
    size = float((a @ a) * (b @ b)) ** 0.5
    return float(a @ b) / size if size > 0 else 1.0


def _kurtosis(difference: NDArray) -> float:
    """Mean fourth power over the squared mean square: 3 of normal noise, 1.5 of a wave; 1 of zeros."""
    squared = difference**2
    square = float(squared.mean())
    return float(np.mean((squared / square) ** 2)) if square > 0 else 1.0


def _least_between(radius: NDArray, error: NDArray, best: int) -> float:
    """Radius of the least error by a parabola through logarithms, at most half a step from the best one."""
    if not 0 < best < len(error) - 1 or not error[best] > 0:
        return float(radius[best])
    before, at, after = np.log(error[best - 1 : best + 2])
    bend = before - 2 * at + after
    offset = 0.5 * (before - after) / bend if bend > 0 else 0.0
    return float(radius[best] * RADIUS_RATIO**offset)


def _whole_error(
    mean: NDArray,
    default: NDArray,
    reference: NDArray | None,
    best: int,
    bias_growth: float,
    max_change: float,
    noise: NDArray,
) -> float:
    """Error at the best radius with the whole bias, where the error is part noise, part bias.

    A bias that grows by `bias_growth` from each radius to the next changes by at most the next change over
    that, or is the flattening of the reference: the rest of the error is noise, which changes by its whole
    size.
    """
    error = float(error_of_radii(mean, default, reference, bound=max_change, noise=noise)[best])
    bias = error
    if best + 2 < len(mean):
        bias = _mean_size(mean[best + 2] - mean[best + 1], max_change) / bias_growth
        if reference is not None:
            bias = max(bias, flattening(reference, mean[best]))
        bias = min(error, bias)
    return float(np.hypot(np.sqrt(error * error - bias * bias), bias / (bias_growth - 1)))


def _mean_size(difference: NDArray, bound: float = np.inf) -> float:
    """Mean size, each at most so many times the median one: rims of a body have no curvature to settle on."""
    size = np.abs(difference)
    if bound < np.inf:
        size = np.minimum(size, bound * np.median(size))
    return float(size.mean())


def typical_size(difference: NDArray) -> float:
    """Mean size of differences, the largest left out: creases and boundaries have some at any radius.

    Parameters
    ----------
    difference : (k,) ndarray of float64

    Returns
    -------
    float
    """
    size = np.sort(np.abs(difference))
    return float(size[: max(1, int(TYPICAL_SHARE * len(size)))].mean())
