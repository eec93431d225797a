"""Energy balance of an implicit step: reject steps that gain more than 1 % or lose more than 10 %."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.newton import MOVE_TOLERANCE
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import is_dead
from ddgcli.simulation.model import StepRejected

# of the energy at hand: how far the balance may exceed its minimum, and how far a step may drop it
MAX_ENERGY_RISE, MAX_ENERGY_FALL = 0.01, 0.1


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Energy in J of the nonlinear potentials at given positions, and its gradient (n, 3).

    `scale` is the sum of the absolute energies: that of a pressure is negative.
    """

    energy: float
    gradient: NDArray
    scale: float

    @classmethod
    def at(cls, system: System, x: NDArray) -> StoredEnergy:
        energy, scale, gradient = 0.0, 0.0, np.zeros_like(x)
        for potential in system.potentials:
            if not is_dead(potential):
                with system.account.within(potential.name):
                    own_energy = potential.energy(x)
                    energy, scale = energy + own_energy, scale + abs(own_energy)
                    gradient += potential.gradient(x)
        return cls(energy, gradient, scale)


def kinetic(system: System, v: NDArray) -> float:
    """Kinetic energy in J of the free coordinates."""
    v = system.only_free(v)
    return 0.5 * float(system.mass @ np.einsum("ni,ni->n", v, v))


def balanced(
    system: System,
    before: Motion,
    after: Motion,
    start: StoredEnergy,
    end: StoredEnergy,
    work: float,
    dt: float,
    fall: float | None = None,
) -> Motion:
    """The motion after a step, with what it adds to the balance of energy.

    The balance is kinetic and potential energy plus what friction, damping and loads took or gave; only the
    scheme's quadrature moves it. It goes up and down a little where the step resolves the motion; where waves
    faster than the step meet stiff and nonlinear terms it climbs without end [D. Kuhl and M. Crisfield,
    "Energy-conserving and decaying algorithms in non-linear structural dynamics", 1999]; and it drops where a
    step leaps into a barrier.

    Parameters
    ----------
    start, end : StoredEnergy
        At both positions.
    work : float
        Of the forces of these potentials along the step, in J, as the scheme counts it.
    dt : float
    fall : float, optional
        Joules by which the step may drop the balance; default a tenth of the energy at hand.

    Raises
    ------
    StepRejected
        The balance would exceed its minimum by more than a hundredth of the energy at hand, or drop by
        more than `fall`.
    """
    change = end.energy - start.energy + work
    at_hand = max(kinetic(system, before.v) + start.scale, kinetic(system, after.v) + end.scale)
    # what the iteration may leave, as speed; and rounding
    left = float(system.mass.sum()) * (MOVE_TOLERANCE * system.size / dt) ** 2
    least = left + system.rounding.energy(dt) + sum_rounding(at_hand, len(system.mass))
    above = max(0.0, before.balance_excess + change)
    if change > least and above > MAX_ENERGY_RISE * at_hand + least:
        raise StepRejected("energy rises", value=above / at_hand, solved=True)
    if change < -(MAX_ENERGY_FALL * at_hand if fall is None else fall) - least:
        raise StepRejected("energy falls", value=change / at_hand, solved=True)
    return Motion(after.x, after.v, after.a, after.newton, above)
