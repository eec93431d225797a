"""Energy balance of an implicit step: reject steps that gain more than 1 % or lose more than 10 %.

Steps of implicit Euler and bdf2 may lose any energy; what they gain is taken from their impulses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.objective import MOVE_TOLERANCE
from ddgcli.mechanics.rounding import sum_rounding
from ddgcli.mechanics.system import Motion, System
from ddgcli.mesh.vectors import row_dot
from ddgcli.simulation.model import Cause, StepRejected

MAX_ENERGY_RISE = 0.01  # balance above its minimum, over the available energy
MAX_ENERGY_FALL = 0.1  # decrease of the balance in a step, over the available energy
# gain over the available energy up to which it is removed by scaling impulses; implicit Euler halves steps
# that gain more
MAX_GAIN_OF_IMPULSES = 1e-3


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Energy in J of the nonlinear potentials at given positions, and its gradient (n, 3).

    Moments, whose energy is only approximate, count as loads.
    `scale` is the sum of the absolute energies, because that of a pressure is negative. `force` is the sum of
    the absolute forces of the potentials on the coordinates, in N.
    """

    energy: float
    gradient: NDArray
    scale: float
    force: float

    @classmethod
    def at(cls, system: System, x: NDArray) -> StoredEnergy:
        energy, scale, force, gradient = 0.0, 0.0, 0.0, np.zeros_like(x)
        for potential in system.potentials:
            if not potential.is_dead and potential.exact_energy:
                with system.account.within(potential.name):
                    own_energy, own_gradient = potential.energy(x), potential.gradient(x)
                    energy, scale = energy + own_energy, scale + abs(own_energy)
                    force += float(np.abs(own_gradient).sum())
                    gradient += own_gradient
        return cls(energy, gradient, scale, force)


def kinetic(system: System, v: NDArray) -> float:
    """Kinetic energy of the free coordinates.

    Parameters
    ----------
    system : System
    v : (n, 3) ndarray of float64
        In m/s.

    Returns
    -------
    float
        In J.
    """
    v = system.only_free(v)
    return 0.5 * float(system.mass @ row_dot(v, v))


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
    """The motion after a step, with its energy balance checked and updated.

    The balance is kinetic and potential energy plus the energy that friction, damping and loads removed or
    added; only the scheme's quadrature changes it. It oscillates slightly if the step resolves the motion. It
    grows without bound if waves faster than the step meet stiff nonlinear terms [D. Kuhl and M. Crisfield,
    "Energy-conserving and decaying algorithms in non-linear structural dynamics", 1999], and it decreases if
    a step enters a barrier too far.

    Parameters
    ----------
    system : System
    before, after : Motion
        At both ends of the step.
    start, end : StoredEnergy
        At both positions.
    work : float
        Of the forces of these potentials along the step, in J, as the scheme counts it.
    dt : float
    fall : float, optional
        Joules by which the step may drop the balance; default a tenth of the available energy.

    Returns
    -------
    Motion
        `after` with the terms of the balance.

    Raises
    ------
    StepRejected
        The balance would exceed its minimum by more than a hundredth of the available energy, or drop by
        more than `fall`.
    """
    if not system.free.any():  # the work of rounded forces along the whole motion is no gain of a free vertex
        return after
    change = end.energy - start.energy + work
    available, least = _scales(system, before, after, start, end, dt)
    above = max(0.0, before.balance_excess + change)
    if change > least and above > MAX_ENERGY_RISE * available + least:
        raise StepRejected("energy rises", value=above / available, solved=True)
    if change < -(MAX_ENERGY_FALL * available if fall is None else fall) - least:
        raise StepRejected("energy falls", value=change / available, solved=True)
    return Motion(after.x, after.v, after.a, after.newton, above)


def _scales(
    system: System, before: Motion, after: Motion, start: StoredEnergy, end: StoredEnergy, dt: float
) -> tuple[float, float]:
    """Available energy in a step, and error due to Newton's method and rounding, in J.

    Raises StepRejected where these are not finite: comparisons with them would accept any step.
    """
    available = max(kinetic(system, before.v) + start.scale, kinetic(system, after.v) + end.scale)
    # the move that Newton's method leaves, as a speed; and rounding, with the forces of the step
    unresolved = float(system.mass.sum()) * (MOVE_TOLERANCE * system.size / dt) ** 2
    at_start = system.rounding
    rounding = replace(at_start, force=max(at_start.force, start.force, end.force))
    least = unresolved + rounding.energy(dt) + sum_rounding(available, len(system.mass))
    if not np.isfinite(least):
        raise StepRejected(Cause.NOT_FINITE, "the tolerance of the energy balance", least)
    return available, least


def without_gain(
    system: System,
    before: Motion,
    after: Motion,
    start: StoredEnergy,
    end: StoredEnergy,
    pushed: float,
    dt: float,
) -> Motion:
    """The motion after a step of implicit Euler, without energy that the potentials did not lose.

    The step evaluates the force at its end. This adds to the energy balance the distance of the potentials
    from their tangent at the end, minus the kinetic energy of the change of velocity. Convex potentials lie
    above their tangent, so they only lose energy. If a shell buckles, or slides off an obstacle by more than
    the range of the barrier in a step, the force at the end does work that was never stored. Then the
    impulses of the nonlinear potentials are scaled by one factor, so that the balance does not change. Forces
    and moments that sum to zero still do: momenta are conserved. A gain that no factor between 0 and 2 can
    remove is left to the next steps.

    Parameters
    ----------
    system : System
    before, after : Motion
        At both ends of the step.
    start, end : StoredEnergy
        At both positions.
    pushed : float
        Joules that moving obstacles add.
    dt : float

    Returns
    -------
    Motion

    Raises
    ------
    StepRejected
        The gain exceeds a thousandth of the available energy: the force is no mean of those along the path.
    """
    if not system.free.any():
        return after
    path, change = after.x - before.x, system.only_free(after.v - before.v)
    force = np.where(system.free, end.gradient, 0.5 * (start.gradient + end.gradient))
    gain = end.energy - start.energy - float(np.vdot(force, path)) - kinetic(system, change) - pushed
    available, least = _scales(system, before, after, start, end, dt)
    above = max(0.0, before.balance_excess + gain)
    if gain > MAX_GAIN_OF_IMPULSES * available + least:
        raise StepRejected("energy rises", value=gain / available, solved=True)
    if not above > least:
        return Motion(after.x, after.v, after.a, after.newton, above)
    return _with_reduced_impulses(system, after, end, above, dt)


def without_excess(system: System, before: Motion, after: Motion, end: StoredEnergy, dt: float) -> Motion:
    """The motion after a balanced step, without an excess above a thousandth of the available kinetic energy.

    The excess is taken from the impulses of the nonlinear potentials. It would otherwise stay at the limit of
    `balanced`, where every small gain rejects a step.

    Parameters
    ----------
    system : System
    before, after : Motion
        At both ends of the step.
    end : StoredEnergy
        At the positions of `after`.
    dt : float
        In s.

    Returns
    -------
    Motion
    """
    available = max(kinetic(system, before.v), kinetic(system, after.v))
    if not after.balance_excess > MAX_GAIN_OF_IMPULSES * available:
        return after
    return _with_reduced_impulses(system, after, end, after.balance_excess, dt)


def _with_reduced_impulses(
    system: System, after: Motion, end: StoredEnergy, above: float, dt: float
) -> Motion:
    """The motion with the impulses of the nonlinear potentials scaled so that `above` joules less remain."""
    impulse = system.only_free(-dt * end.gradient / system.mass[:, None])
    quadratic = kinetic(system, impulse)
    slope = float(system.mass @ row_dot(impulse, system.only_free(after.v)))
    root = np.sqrt(max(0.0, slope**2 - 4 * quadratic * above))
    # the smaller root of quadratic s^2 + slope s + above, or its minimum
    factor = -2 * above / (slope + np.copysign(root, slope)) if root else -0.5 * slope / (quadratic or np.inf)
    factor = float(np.clip(factor, -1.0, 1.0))
    rest = max(0.0, above + factor * (slope + factor * quadratic))
    change = factor * impulse
    return Motion(after.x, after.v + change, after.a + change / dt, after.newton, rest)
