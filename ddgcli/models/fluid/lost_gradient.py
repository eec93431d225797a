"""Warnings of initial velocities that no incompressible flow on the surface has."""

from __future__ import annotations

import logging

log = logging.getLogger("ddgcli")
MAX_LOST_GRADIENT_SHARE = 0.3  # share of the energy; coarse cells leave some of a smooth flow out
MAX_NORMAL_SHARE = 0.5  # of the energy; a third of that of a uniform field on a sphere


def warn_of_lost_gradient(name: str, whole: float, remaining: float) -> None:
    """Report an initial velocity that is largely a gradient, such as a uniform stream in a closed box.

    Parameters
    ----------
    name : str
        Of the fluid.
    whole, remaining : float
        Kinetic energy of the velocity, and of the flow nearest to it.
    """
    if whole - remaining > MAX_LOST_GRADIENT_SHARE * whole:
        _warn_of_share(
            name, 1.0 - remaining / whole,
            "a gradient, which no incompressible flow has; give a velocity without divergence that runs "
            "along the walls",
        )  # fmt: skip


def warn_of_normal_velocity(name: str, whole: float, along: float) -> None:
    """Report an initial velocity that points out of the surface for the most part.

    Parameters
    ----------
    name : str
        Of the fluid.
    whole, along : float
        Kinetic energy of the velocity, and of its part along the surface.
    """
    if whole - along > MAX_NORMAL_SHARE * whole:
        _warn_of_share(
            name, 1.0 - along / whole, "it points out of the surface; give a velocity along the surface"
        )


def _warn_of_share(name: str, share: float, why: str) -> None:
    log.warning(
        "%.3g %% of the energy of the initial velocity of %s is left out: %s", 100.0 * share, name, why
    )
