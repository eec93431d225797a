"""Limits of failed steps in a run, and the shorter step that an error message recommends."""

from __future__ import annotations

import math

from ddgcli.errors import SolveError
from ddgcli.simulation.active_model import ActiveModel
from ddgcli.simulation.model import MAX_HALVINGS, Cause, Schedule, StepRejected

# Limit of rejected steps in a run, in total plus per step. Some steps may need many shorter ones, but if all
# do, the run takes hundreds of times as long as its scene and its prediction suggest.
MAX_REJECTED, MAX_REJECTED_PER_STEP = 200, 30
MAX_PARTS = 512  # parts of a failing step, on average over the run
N_PARTS_OBSERVED = 64  # parts of a step after which their number is extrapolated to the whole step


def step_advice(active: ActiveModel, rejected: StepRejected, dt: float, solvable: float) -> str:
    """Advice for continuing after a failed step; shorter steps alone do not make numbers finite.

    Parameters
    ----------
    active : ActiveModel
    rejected : StepRejected
    dt : float
        Step of the run.
    solvable : float
        A length at which the step does not fail.

    Returns
    -------
    str
    """
    if active.model.advice is not None:
        return active.model.advice()
    shorter = f"make the step {_shorter_step(active, dt, solvable)} {active.model.time_unit}"
    infinite = rejected.cause == Cause.NOT_FINITE or math.isinf(rejected.value)
    return f"weaken the forces and velocities, or {shorter}" if infinite else shorter


def _shorter_step(active: ActiveModel, dt: float, at_most: float) -> str:
    """A step of at most this length: the model's usual one, or a fraction of the run's step."""
    usual = active.model.usual_step
    return f"{usual:.3g}" if usual <= at_most else f"{_fraction_of_step(dt, at_most):.6g}"


def largest_solvable(active: ActiveModel, rejected: StepRejected, time: float, dt: float) -> float:
    """Half, quarter, ... of a step that failed, which the scheme can take from here; dt / 2 if none.

    Parameters
    ----------
    active : ActiveModel
    rejected : StepRejected
        Why the step failed; for a stability limit, its value states by how much.
    time, dt : float

    Returns
    -------
    float
    """
    if active.model.advice is not None:  # the model's own advice names no step
        return dt / 2
    if rejected.cause == Cause.STABILITY_LIMIT and 1 < rejected.value < math.inf:
        return dt / rejected.value
    for depth in range(1, MAX_HALVINGS + 1):
        try:
            active.model.advance(active.state, time, dt / 2**depth)
        except (StepRejected, SolveError):
            continue
        return dt / 2**depth
    return dt / 2


def _fraction_of_step(dt: float, at_most: float) -> float:
    """A 1, 2, 5, 10, 20, ... th of a step: frames remain whole numbers of steps."""
    pieces = dt / at_most * (1 - 1e-9)
    power = 10.0 ** math.floor(math.log10(pieces))
    return dt / next(n * power for n in (1, 2, 5, 10) if n * power >= pieces)


def check_rejected(active: ActiveModel, step: int, time: float, dt: float) -> None:
    """End a run after too many failed attempts.

    Parameters
    ----------
    active : ActiveModel
    step : int
    time, dt : float

    Raises
    ------
    SolveError
        With a recommended shorter step.
    """
    if active.n_rejected > MAX_REJECTED + MAX_REJECTED_PER_STEP * step:
        unit, shorter = active.model.time_unit, _shorter_step(active, dt, min(active.smallest, dt / 2))
        raise SolveError(
            f"t = {time:.6g} {unit}, {active.name}: {active.n_rejected} attempts have failed in {step + 1} "
            f"steps of {dt:.3g} {unit}; make the step {shorter} {unit}, "
            f"or weaken the forces and velocities"
        )


def check_parts(active: ActiveModel, schedule: Schedule, step: int, time: float) -> None:
    """End a run early in a step that would take hundreds of parts, unless most steps before took few.

    Parameters
    ----------
    active : ActiveModel
    schedule : Schedule
    step : int
    time : float
        Time up to which parts of the step have been taken.

    Raises
    ------
    SolveError
        Names a shorter step.
    """
    unit, dt, n_parts = active.model.time_unit, schedule.dt, active.n_steps - active.n_before
    if not active.n_rejected or dt > active.model.largest_step or n_parts < N_PARTS_OBSERVED:
        return
    n_extrapolated = n_parts / (time / dt - step)
    if active.n_before + n_extrapolated > MAX_PARTS * (step + 1):
        shorter = _shorter_step(active, dt, active.shortest)
        raise SolveError(
            f"t = {time:.6g} {unit}, {active.name}: a step of {dt:.3g} {unit} takes about "
            f"{n_extrapolated:.0f} shorter ones; make the step {shorter} {unit}"
        )
