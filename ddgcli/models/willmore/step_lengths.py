"""Lengths of the steps of flows to rest, at unit size."""

from __future__ import annotations

import math

from ddgcli.models.willmore import step_rules as rules
from ddgcli.models.willmore import trust_region


def first_step(kind: str, area: float, of_area: bool) -> float:
    """First step, for a kind of flow; of films short: not to leap over one at rest.

    Parameters
    ----------
    kind : {'descent', 'newton', 'conformal'}
        Lengths of the last two are a trust region's radius, and a share of the curvature.
    area : float
        Size of the surface at the start.
    of_area : bool
        The energy is an area or a volume.

    Returns
    -------
    float
    """
    if kind != "descent":
        return 1.0 if kind == "conformal" else trust_region.FIRST_RADIUS * area
    return (rules.FIRST_AREA_STEP_SHARE if of_area else 1.0) * longest_step(area, of_area)


def longest_step(area: float, of_area: bool) -> float:
    """Longest step of the descent.

    Parameters
    ----------
    area : float
        Size of the surface at the start.
    of_area : bool
        The energy is an area or a volume.

    Returns
    -------
    float
    """
    squared_radius = area / (4.0 * math.pi)
    return rules.MAX_AREA_STEP * squared_radius if of_area else rules.MAX_DESCENT_STEP * squared_radius**2
