"""Check of residuals: no message, a warning, or a result that has not converged."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

log = logging.getLogger("ddgcli")

WARNING_RESIDUAL = 1e-6  # relative: half of the digits of a good solution are lost
LARGEST_RESIDUAL = 1e-3  # relative: a larger one means that the answer is not a solution


def within_residuals(
    accuracy: Mapping[str, Any],
    names: tuple[str, ...],
    remedy: str | Callable[[], str],
    *,
    warning: float = WARNING_RESIDUAL,
    largest: float = LARGEST_RESIDUAL,
) -> bool:
    """Whether every relative residual is small enough for the results to count as converged.

    Parameters
    ----------
    accuracy : mapping
        Accuracy block of a summary; entries are numbers, sequences of numbers or None.
    names : tuple of str
        Entries to check; missing ones and None are skipped.
    remedy : str or callable
        What the caller can do, for the warning; a function is called for the first one only.
    warning, largest : float
        Residuals above `warning` are reported; above `largest`, or not finite, the answer is False, as
        the warning states.

    Returns
    -------
    bool
    """
    converged = True
    for name in names:
        values = np.atleast_1d(np.asarray(accuracy.get(name, ()), dtype=np.float64))
        if accuracy.get(name) is None or not len(values):
            continue
        worst = float(values.max()) if np.isfinite(values).all() else np.inf
        if worst > warning:
            remedy = remedy if isinstance(remedy, str) else remedy()
            limit = (
                f"{largest:g}, so that the result has not converged" if worst > largest else f"{warning:g}"
            )
            log.warning(f"{name} is {worst:.2g}, above {limit}: {remedy}")
        converged &= worst <= largest
    return converged
