"""Integrator `energy`: implicit midpoint rule on the conservative form, energy-preserving and reversible.

The rate of change is (du/dt, w) = - int omega (n x u) . w for all discrete flows w. It vanishes for w = u, so
that the midpoint rule keeps the kinetic energy of any mesh, and, quadratic too, the enstrophy of surfaces.

P. Mullen, K. Crane, D. Pavlov, Y. Tong, M. Desbrun, "Energy-preserving integrators for fluid animation", ACM
Transactions on Graphics, 2009.
"""

from __future__ import annotations

from typing import Any

from ddgcli.models.fluid.conservative import ConservativeTransport
from ddgcli.models.fluid.phases import FluidSetting


def transport(setting: FluidSetting, parameters: Any) -> ConservativeTransport:
    """Transport phase of the integrator in [time]."""
    return ConservativeTransport(setting, "midpoint")
