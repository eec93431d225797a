"""Bounds on residuals: past the first a result is reported as doubtful, past the second as not converged."""

from __future__ import annotations

import logging
from collections.abc import Mapping

log = logging.getLogger("ddgcli")

DOUBTFUL_RESIDUAL, FAILED_RESIDUAL = 1e-6, 1e-3


def residuals_hold(
    residuals: Mapping[str, float | None],
    *,
    doubtful: float = DOUBTFUL_RESIDUAL,
    failed: float = FAILED_RESIDUAL,
) -> bool:
    """Whether every relative residual is at most `failed`; warn of each that is above `doubtful`.

    Parameters
    ----------
    residuals : mapping of name to float or None
        None stands for a residual that was not computed. NaN fails.
    """
    hold = True
    for name, residual in residuals.items():
        if residual is None or residual <= doubtful:
            continue
        fails = not residual <= failed
        hold &= not fails
        log.warning(
            "%s is %.2g, above %.0e: %s; look for degenerate faces with `ddgcli info`, "
            "or improve the mesh with `ddgcli delaunay --refine`",
            name,
            residual,
            failed if fails else doubtful,
            "the result is wrong" if fails else "the result has few correct digits",
        )
    return hold
