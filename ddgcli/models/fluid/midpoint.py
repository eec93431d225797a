"""Implicit midpoint rule: it keeps quadratic invariants and is its own inverse when time is reversed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

MAX_PICARD_ITERATIONS = 60
PICARD_TOLERANCE = 1e-10  # relative change left by the iteration above which a step is shortened
PICARD_ROUNDING = 1e-15  # relative change at which the iteration ends
ANDERSON_DEPTH = 4


def implicit_midpoint(
    slope: Callable[[NDArray], NDArray[np.float64]], start: NDArray, dt: float, least_scale: float = 0.0
) -> tuple[NDArray[np.float64], float]:
    """State after dt, and the relative change left by the iteration; infinite where it diverges.

    Parameters
    ----------
    slope : callable (k,) -> (k,)
        Rate of change of a state.
    start : (k,) ndarray
    dt : float
    least_scale : float
        What changes are relative to where the state is smaller, as that of a stream without vorticity is.

    Returns
    -------
    state : (k,) ndarray of float64
    residual : float

    Notes
    -----
    Picard iteration with Anderson mixing. It ends at rounding: what it left would act as a drift.
    """
    middle = start
    images: list[NDArray] = []
    residuals: list[NDArray] = []
    scale = max(float(np.abs(start).max(initial=0.0)), least_scale) or 1.0
    change, best, stalled = np.inf, np.inf, 0
    for _ in range(MAX_PICARD_ITERATIONS):
        image = start + 0.5 * dt * slope(middle)
        residual = image - middle
        size = float(np.abs(residual).max(initial=0.0)) / scale
        if not np.isfinite(size) or (size > 10.0 and size > change):
            return start, np.inf
        change = size
        stalled = 0 if change < 0.5 * best else stalled + 1
        best = min(best, change)
        if change < PICARD_ROUNDING or (change < 1e3 * PICARD_ROUNDING and stalled > 1):
            middle = image
            break
        images, residuals = [*images[-ANDERSON_DEPTH:], image], [*residuals[-ANDERSON_DEPTH:], residual]
        middle = _anderson_combination(images, residuals)
    return 2.0 * middle - start, change


def _anderson_combination(images: list[NDArray], residuals: list[NDArray]) -> NDArray[np.float64]:
    """Combination of the images whose residuals' combination is least (D. G. Anderson, 1965)."""
    last = residuals[-1]
    if len(residuals) == 1:
        return images[-1]
    difference = np.stack([last - r for r in residuals[:-1]], axis=1)
    share = np.linalg.lstsq(difference, last, rcond=1e-10)[0]
    return images[-1] - np.stack([images[-1] - i for i in images[:-1]], axis=1) @ share
