"""Errors of curvature in balls of growing radius, estimated from its changes with the radius."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RADIUS_RATIO = 2**0.5
TYPICAL_SHARE = 0.65  # of the vertices, those with the least changes
MAX_NOISE_RATIO = (
    4.0  # of errors at neighbouring radii: quadratic fits of noise and of voxels have 2.6 to 3.3
)
# distance of curvature to that in much wider balls over its change to the next radius, where noise dominates:
# the changes of independent vertices and of voxels have 1.0 to 1.2
MAX_NOISE_DISTANCE = 1.3
# change to the next radius over the one after it: below this it is not that of noise. A distance of so many
# times the noise there, which is known from the residuals of fits, is bias
MIN_NOISE_FALL, MAX_KNOWN_NOISE = 2.0, 1.5
# of the error over a change of the mean of all vertices that has grown, as bias does: twice it where the bias
# doubles once more, as it does not on tubes, in balls wider than these
MIN_SHARED_RATIO = 1.25
MAX_CHANCE = 2.5  # standard errors of the mean change of some vertices
MIN_SIGNIFICANCE = 3.0  # of a squared difference, over that which noise leaves by chance
# of the distance to the curvature of other fits, over the least one at smaller radii: by chance
MAX_DISTANCE_GROWTH = 1.25
# times the median size: more is at rims and spikes; normal noise has more at 4 % of the vertices
MAX_TAIL = 3.0


def error_of_radii(
    mean: NDArray,
    default: NDArray | None = None,
    reference: NDArray | None = None,
    *,
    other: NDArray | None = None,
    bound: float = np.inf,
    noise: NDArray | None = None,
) -> NDArray[np.float64]:
    """Error of curvature at each radius but the last, by its changes.

    The mean change to the next radius; or, if that is more, the distance to the curvature at a smaller radius
    beyond the noise of that; or the error that all vertices share (`_shared_error`); or the flattening of
    `reference` (k,); or a share of the change from the radius before, at the first one from the default
    region (k,), if there is one and no reference. Where the change to the next radius does not fall as noise
    does, the known `noise` (r,) bounds that of a radius: waves change from each radius to the next, until
    balls hold them whole. Averaged normals flatten waves in the smallest balls already: what the distance to
    the curvature of `other` fits (k,) has grown by, in squares and beyond chance, is bias.

    Parameters
    ----------
    mean : (r, k) ndarray of float64
        Curvature of k vertices in balls of r growing radii, in 1/length as all errors.
    default : (k,) ndarray of float64, optional
        That over the default region.
    reference : (k,) ndarray of float64, optional
        That of fits which flatten small features less.
    other : (k,) ndarray of float64, optional
        That of other fits in balls of their best radius.
    bound : float
        Largest change of a vertex over the median one.
    noise : (r,) ndarray of float64, optional
        Mean size of the noise of curvature at each radius; inf if only its changes bound it.

    Returns
    -------
    (r - 1,) ndarray of float64

    Notes
    -----
    O. Lepski, "On a problem of adaptive estimation in Gaussian white noise", 1991.
    """
    change = np.array([mean_size(after - at, bound) for after, at in zip(mean[1:], mean)])
    first = 0.0 if default is None or reference is not None else mean_size(mean[0] - default, bound)
    before = np.append(first, change[:-1])
    error = np.maximum(change, before / MAX_NOISE_RATIO)
    steady = np.append(change[:-1] < MIN_NOISE_FALL * change[1:], False)
    for j in range(1, len(error)):
        distance = np.array([mean_size(before - mean[j], bound) for before in mean[:j]])
        error[j] = max(error[j], float((distance - MAX_NOISE_DISTANCE * change[:j]).max()))
        if noise is not None:
            biased = steady[:j] & (distance > MAX_KNOWN_NOISE * noise[:j])
            error[j] = max(error[j], float(distance.max(initial=0.0, where=biased)))
    error = np.maximum(error, _shared_error(mean))
    if other is not None:
        square = np.array([mean_size(at - other, bound) for at in mean[:-1]]) ** 2
        least = MAX_DISTANCE_GROWTH**2 * np.minimum.accumulate(square)
        error = np.maximum(error, np.sqrt(np.maximum(square - least, 0.0)))
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
    """Values clipped at MAX_TAIL times their median size."""
    most = MAX_TAIL * float(np.median(np.abs(values)))
    return np.clip(values, -most, most)


def correlation(one: NDArray, other: NDArray) -> float:
    """Correlation of two values of the same vertices, without tails.

    Parameters
    ----------
    one, other : (k,) ndarray of float64

    Returns
    -------
    float
        1 if one of them is constant.
    """
    a, b = (_without_tails(values - values.mean()) for values in (one, other))
    size = float((a @ a) * (b @ b)) ** 0.5
    return float(a @ b) / size if size > 0 else 1.0


def kurtosis(difference: NDArray) -> float:
    """Mean fourth power over the squared mean square.

    Parameters
    ----------
    difference : (k,) ndarray of float64

    Returns
    -------
    float
        3 for normal noise, 1.5 for a wave, 1 for zeros.
    """
    squared = difference**2
    square = float(squared.mean())
    return float(np.mean((squared / square) ** 2)) if square > 0 else 1.0


def least_between(radius: NDArray, error: NDArray, best: int) -> float:
    """Radius of the least error by a parabola through logarithms, at most half a step from the best one.

    Parameters
    ----------
    radius, error : (r,) and (r - 1,) ndarray of float64
        Radii that grow by `RADIUS_RATIO`, and the errors at all but the last.
    best : int
        Index of the radius with the least error.

    Returns
    -------
    float
    """
    if not 0 < best < len(error) - 1 or not error[best] > 0:
        return float(radius[best])
    before, at, after = np.log(error[best - 1 : best + 2])
    bend = before - 2 * at + after
    offset = 0.5 * (before - after) / bend if bend > 0 else 0.0
    return float(radius[best] * RADIUS_RATIO**offset)


def whole_error(
    mean: NDArray,
    default: NDArray,
    reference: NDArray | None,
    best: int,
    bias_growth: float,
    max_change: float,
    noise: NDArray,
    other: NDArray | None = None,
) -> float:
    """Error at the best radius with the whole bias, of which the changes show only a part.

    The bias grows by the factor `bias_growth` from each radius to the next. Its share of the error is at most
    the next change over this factor, or the flattening of the reference; the rest of the error is noise,
    which changes by its whole size.

    Parameters
    ----------
    mean : (r, k) ndarray of float64
        Curvature of k vertices at each radius.
    default, reference : (k,) ndarray of float64
        As in `error_of_radii`.
    best : int
        Index of the radius.
    bias_growth : float
    max_change : float
        Largest change of a vertex over the median one.
    noise : (r,) ndarray of float64
    other : (k,) ndarray of float64, optional
        As in `error_of_radii`.

    Returns
    -------
    float
    """
    error = error_of_radii(mean, default, reference, other=other, bound=max_change, noise=noise)[best]
    bias = error
    if best + 2 < len(mean):
        bias = mean_size(mean[best + 2] - mean[best + 1], max_change) / bias_growth
        if reference is not None:
            bias = max(bias, flattening(reference, mean[best]))
        bias = min(error, bias)
    return float(np.hypot(np.sqrt(error * error - bias * bias), bias / (bias_growth - 1)))


def mean_size(difference: NDArray, bound: float = np.inf) -> float:
    """Mean absolute value, each bounded by `bound` times the median: at rims, curvature does not converge.

    Parameters
    ----------
    difference : (k,) ndarray of float64
    bound : float

    Returns
    -------
    float
    """
    size = np.abs(difference)
    if bound < np.inf:
        size = np.minimum(size, bound * np.median(size))
    return float(size.mean())


def typical_size(difference: NDArray) -> float:
    """Mean absolute value without the largest ones, which creases and boundaries cause at any radius.

    Parameters
    ----------
    difference : (k,) ndarray of float64

    Returns
    -------
    float
    """
    size = np.sort(np.abs(difference))
    return float(size[: max(1, int(TYPICAL_SHARE * len(size)))].mean())
