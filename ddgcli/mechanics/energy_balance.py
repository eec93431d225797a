"""The balance of energy of an implicit step, which the scheme may not lift, nor drop at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.newton import MOVE
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.system import Motion, System
from ddgcli.simulation.time_loop import StepRejected

# of the energy at hand: how far the balance may stand above its lowest, and how far a step may drop it
RISE, FALL = 0.01, 0.1


@dataclass(frozen=True, eq=False)
class Stored:
    """What the potentials that are not linear hold at a place: energy in J and its gradient (n, 3)."""

    energy: float
    gradient: NDArray

    @classmethod
    def at(cls, system: System, x: NDArray) -> Stored:
        energy, gradient = 0.0, np.zeros_like(x)
        for potential in system.potentials:
            if len(potential.stencil):
                with system.account.within(potential.name):
                    energy += potential.energy(x)
                    gradient += potential.gradient(x)
        return cls(energy, system.only_free(gradient))


def kinetic(system: System, v: NDArray) -> float:
    return 0.5 * float(system.mass @ np.einsum("ni,ni->n", v, v))


def balanced(
    system: System,
    before: Motion,
    after: Motion,
    start: Stored,
    end: Stored,
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
    start, end : Stored
        At both positions.
    work : float
        Of the forces of these potentials along the step, in J, as the scheme counts it.
    dt : float
    fall : float, optional
        Joules by which the step may drop the balance; default a tenth of the energy at hand.

    Raises
    ------
    StepRejected
        The balance would stand above its lowest by more than a hundredth of the energy at hand, or drop by
        more than `fall`.
    """
    lifted = end.energy - start.energy + work
    at_hand = max(kinetic(system, before.v) + start.energy, kinetic(system, after.v) + end.energy)
    # what the iteration may leave, as speed; and rounding
    left = float(system.mass.sum()) * (MOVE * system.size / dt) ** 2
    least = left + system.rounding.energy(dt) + sum_rounding(at_hand, len(system.mass))
    above = max(0.0, before.lifted + lifted)
    if lifted > least and above > RISE * at_hand + least:
        raise StepRejected("energy rises", value=above / at_hand, solved=True)
    if lifted < -(FALL * at_hand if fall is None else fall) - least:
        raise StepRejected("energy falls", value=lifted / at_hand, solved=True)
    return Motion(after.x, after.v, after.a, after.newton, above)
