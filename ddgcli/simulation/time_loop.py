"""Time loop: advance independent models in lockstep from frame to frame.

The loop contains neither physics nor files. It keeps the clock (times are `k * dt`, never a running sum), the
shortened and the adaptive steps, and the log of failed steps (`Event`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddgcli.errors import ParameterError, SolveError
from ddgcli.progress import ProgressCallback
from ddgcli.simulation.account import Account
from ddgcli.simulation.active_model import ActiveModel, unpacked_ending
from ddgcli.simulation.failed_steps import check_parts, check_rejected, largest_solvable, step_advice
from ddgcli.simulation.model import (
    MAX_HALVINGS,
    MAX_STEP_COUNT,
    Arrays,
    Ending,
    Event,
    Model,
    Observation,
    RunFailed,
    Schedule,
    StepRejected,
)
from ddgcli.simulation.step_warnings import BY_COMPOSITE_SCHEME, halved, rescued

log = logging.getLogger("ddgcli")
RECOVERY_FACTOR = 8.0  # of the shortest part of a step, what the next one tries first
ROUNDING = 2.0**-52  # relative error of a step below which states do not differ
CUT_SHARE = 0.99  # of the step to try, below which a step is cut short
FIRST_DOUBLING = 16  # accepted steps before a step of twice the length is tried


def ending_of(checkpoint: Arrays) -> Ending | None:
    """Why the run had ended at a checkpoint; None if it had not.

    Parameters
    ----------
    checkpoint : dict of "model/array" to ndarray
        Checkpoint of a Snapshot.

    Returns
    -------
    Ending or None
    """
    return _common_ending([unpacked_ending(v) for k, v in checkpoint.items() if k.endswith("/stopped")])


def _common_ending(endings: list[Ending | None]) -> Ending | None:
    """The first of the models' endings; None unless all have ended."""
    return endings[0] if endings and all(endings) else None


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One frame of a run and what is needed to continue from it.

    Parameters
    ----------
    frame_number, step : int
    time : float
    observations : dict of str to Observation
        By object: a model, or the parts of a model that has several.
    checkpoint : dict of "model/array" to ndarray
    events : tuple of Event
        Since the frame before.
    steps : int
        Steps taken so far, the maximum over the models.
    smallest_step : float
        Since the start; inf before the first.
    frame_limited_steps : int
        Adaptive steps so far that would have passed the time of a frame, the most over the models.
    ending : Ending or None
        Why the run ends here.
    """

    frame_number: int
    step: int
    time: float
    observations: dict[str, Observation]
    checkpoint: Arrays
    events: tuple[Event, ...]
    steps: int
    smallest_step: float
    frame_limited_steps: int = 0
    ending: Ending | None = None

    @property
    def stopped(self) -> str:
        """Text of the ending, or ""."""
        return "" if self.ending is None else self.ending.text


def evolve(
    models: Mapping[str, Model],
    schedule: Schedule,
    account: Account,
    resume: tuple[int, Arrays] | None = None,
    progress: ProgressCallback | None = None,
) -> Iterator[Snapshot]:
    """Yield a snapshot at the start, after every `schedule.every` steps and at the end.

    Parameters
    ----------
    models : mapping of str to Model
        Independent of one another: leaving one out changes no bit of the others.
    schedule : Schedule
    account : Account
        Books "integrator" for each advance and "output" for each observation; models book inside.
    resume : (frame, checkpoint), optional
        Continue after that frame, which is not yielded again. Nothing is yielded if the run had ended there.
    progress : callable, optional
        Called with (steps done, all steps) after every step, and after parts of divided steps.

    Yields
    ------
    Snapshot

    Raises
    ------
    RunFailed
        A step failed for good; the snapshots before it are valid.
    """
    active_models = [
        ActiveModel(name, model, model.start, schedule.first_dt or schedule.dt)
        for name, model in models.items()
    ]
    events: list[Event] = []
    frame_number = 0
    if resume is None:
        yield _snapshot(active_models, schedule, 0, 0, events, account)
    else:
        frame_number, checkpoint = resume
        for active in active_models:
            active.restore(_arrays_of(checkpoint, active.name))
        if ending_of(checkpoint) is not None:
            return
    last_frame = schedule.n_frames - 1
    for active in active_models:
        active.reached = schedule.step_of_frame(frame_number)
        if progress is not None:
            active.report_progress = lambda: progress(
                sum(m.reached for m in active_models) / len(active_models), schedule.steps
            )
    while frame_number < last_frame:
        first, last = schedule.step_of_frame(frame_number), schedule.step_of_frame(frame_number + 1)
        for active in active_models:
            try:
                with account.within("integrator"), np.errstate(all="ignore"):
                    reached = _advance_to(active, schedule, first, last, events)
            except SolveError as error:
                raise RunFailed(str(error), tuple(events)) from error
            last = min(last, reached) if len(active_models) == 1 else last
        frame_number += 1
        try:
            snapshot = _snapshot(active_models, schedule, frame_number, last, events, account)
        except SolveError as error:
            raise RunFailed(str(error), tuple(events)) from error
        events = []
        yield snapshot
        if snapshot.ending is not None:
            return


def _arrays_of(checkpoint: Arrays, name: str) -> Arrays:
    return {k.split("/", 1)[1]: v for k, v in checkpoint.items() if k.split("/", 1)[0] == name}


def _snapshot(
    active_models: list[ActiveModel],
    schedule: Schedule,
    frame_number: int,
    step: int,
    events: list[Event],
    account: Account,
) -> Snapshot:
    with account.within("output"):
        observations: dict[str, Observation] = {}
        for active in active_models:
            observation = active.model.observe(active.state)
            observations |= observation if isinstance(observation, dict) else {active.name: observation}
        checkpoint = {f"{m.name}/{key}": value for m in active_models for key, value in m.pack().items()}
        clocks = [
            active.model.clock(active.state) for active in active_models if active.model.clock is not None
        ]
        return Snapshot(
            frame_number,
            step,
            max(clocks) if clocks else step * schedule.dt,
            observations,
            checkpoint,
            tuple(events),
            max((active.n_steps for active in active_models), default=0),
            min((active.smallest for active in active_models), default=math.inf),
            max((active.n_frame_limited for active in active_models), default=0),
            _common_ending([active.ending for active in active_models]),
        )


def _advance_to(active: ActiveModel, schedule: Schedule, first: int, last: int, events: list[Event]) -> int:
    """Advance one model from step `first` to step `last`; return the step that it reached."""
    if active.ending is not None:
        return last
    if schedule.tolerance is not None:
        _advance_adaptively(active, schedule, first, last, events)
        return last
    for step in range(first, last):
        active.allowed, active.shortest = RECOVERY_FACTOR * active.next_dt, math.inf
        active.n_before = active.n_steps
        active.state = _step_or_halves(active, schedule, step, step * schedule.dt, schedule.dt, 0, events)
        active.next_dt = active.shortest
        if active.model.stop is not None:
            active.ending = active.model.stop(active.state)
            if active.ending is not None:
                events.append(Event(step + 1, (step + 1) * schedule.dt, "stop", detail=active.ending.text))
                return step + 1
    return last


def _step_or_halves(
    active: ActiveModel,
    schedule: Schedule,
    step: int,
    time: float,
    dt: float,
    depth: int,
    events: list[Event],
) -> Any:
    """State after `dt`: in one step, or in halves where that fails or would be unstable.

    What failed is tried again after some shorter parts, and the next step begins with a multiple of them.
    """
    model = active.model
    if dt > model.largest_step:
        if depth >= MAX_HALVINGS:
            raise _unstable(active, 2**MAX_HALVINGS, "the step; shorten it, or")
        if not active.divided:
            active.divided = True
            detail = f"{active.name}: dt above the stability limit {model.largest_step:.3g} s is divided"
            events.append(Event(step, time, "stability", active.name, model.largest_step, detail))
            log.warning(detail)
        return _two_halves(active, schedule, step, time, dt, depth, events)
    if dt > active.allowed:
        return _two_halves(active, schedule, step, time, dt, depth, events)
    try:
        state = _advanced(active, schedule, active.state, step, time, dt, events)
    except StepRejected as rejected:
        detail = _logged(active, rejected, step, time, dt, events)
        active.n_rejected += 1
        check_rejected(active, step, time, schedule.dt)
        if schedule.on_failure == "stop" or depth >= rejected.halvings:
            advice = step_advice(active, rejected, schedule.dt, largest_solvable(active, rejected, time, dt))
            raise SolveError(f"t = {time:.6g} {active.model.time_unit}, {detail}; {advice}") from rejected
        log_event = log.info if active.divided else log.warning
        log_event(halved(time, active.model.time_unit, detail))
        active.divided, active.allowed = True, 0.75 * dt
        return _two_halves(active, schedule, step, time, dt, depth, events)
    active.reached = (time + dt) / schedule.dt
    active.report_progress()
    active.n_steps += 1
    active.smallest = min(active.smallest, dt)
    active.shortest = min(active.shortest, dt)
    active.allowed *= active.model.growth
    check_parts(active, schedule, step, time + dt)
    return state


def _unstable(active: ActiveModel, n_parts: float, step: str) -> SolveError:
    """Error of a stability limit that divides a step into too many parts."""
    limit = f"{active.name}: the stability limit, {active.model.largest_step:.3g} s"
    return SolveError(f"{limit}, is over {n_parts:,.0f} times shorter than {step} take an implicit scheme")


def _logged(
    active: ActiveModel, rejected: StepRejected, step: int, time: float, dt: float, events: list[Event]
) -> str:
    """Add a failed step to the events; return its description."""
    detail = f"{active.name}: step of {dt:.3g} {active.model.time_unit} rejected: {rejected}"
    events.append(Event(step, time, rejected.cause, rejected.place, rejected.value, detail))
    return detail


def _advanced(
    active: ActiveModel,
    schedule: Schedule,
    state: Any,
    step: int,
    time: float,
    dt: float,
    events: list[Event],
) -> Any:
    """The state one step later, by the scheme or its fallback; StepRejected if both fail."""
    model = active.model
    try:
        return model.advance(state, time, dt)
    except StepRejected as rejected:
        if model.rescue is None or schedule.on_failure == "stop" or not rejected.solved:
            raise
        cause = rejected
    try:
        later = model.rescue(state, time, dt)
    except StepRejected:
        raise cause from None
    detail = f"{active.name}: step of {dt:.3g} s rejected: {cause}{BY_COMPOSITE_SCHEME}"
    events.append(Event(step, time, cause.cause, cause.place, cause.value, detail))
    log_event = log.info if active.rescue_reported else log.warning
    log_event(rescued(time, "s", detail))
    active.rescue_reported = True
    return later


def _two_halves(
    active: ActiveModel,
    schedule: Schedule,
    step: int,
    time: float,
    dt: float,
    depth: int,
    events: list[Event],
) -> Any:
    active.state = _step_or_halves(active, schedule, step, time, dt / 2, depth + 1, events)
    return _step_or_halves(active, schedule, step, time + dt / 2, dt / 2, depth + 1, events)


class _Doubling:
    """Tries a step of twice the length from time to time, and again immediately after a success.

    An error that does not fall with the step, as that of interpolation, would otherwise keep steps as short
    as they once had to be: just below the tolerance, it lets them grow by a thousandth.
    """

    def __init__(self) -> None:
        self.count, self.interval = 0, FIRST_DOUBLING  # of steps since the last trial, and before the next
        self.base = 0.0  # the accepted step that a trial doubles; 0 between trials

    def after(self, dt: float) -> float:
        """Step to try after one of `dt` was accepted; 0 for none."""
        if self.base:  # the trial succeeded
            self.count, self.interval = FIRST_DOUBLING, FIRST_DOUBLING
        self.count += 1
        self.base = dt if self.count > self.interval else 0.0
        return 2.0 * self.base

    def failed(self) -> float:
        """Step that was accepted before a rejected trial; 0 where the rejected step was not a trial."""
        base, self.base = self.base, 0.0
        if base:
            self.count, self.interval = 0, 4 * self.interval
        return base


def _check_tolerance(active: ActiveModel, tolerance: float, time: float) -> None:
    """End a run whose tolerance rounding exceeds: steps would end where differences round to zero."""
    if active.model.least_tolerance is None:
        return
    least = active.model.least_tolerance(active.state)
    if tolerance < least:
        raise SolveError(
            f"t = {time:.6g} {active.model.time_unit}, {active.name}: rounding alone makes an error of "
            f"{least:.2g} in any step; give a tolerance above that instead of {tolerance:g}, or a step"
        )


def _doubled_step(
    active: ActiveModel, schedule: Schedule, first: int, time: float, dt: float, events: list[Event]
) -> tuple[Any, float]:
    """The state after two half steps, and its distance from the state after the whole one."""
    distance = active.model.distance
    if distance is None:
        raise ParameterError("this model has no error measure: give a step", parameter="tolerance")
    whole = _advanced(active, schedule, active.state, first, time, dt, events)
    half = _advanced(active, schedule, active.state, first, time, dt / 2, events)
    state = _advanced(active, schedule, half, first, time + dt / 2, dt / 2, events)
    return state, max(distance(whole, state), ROUNDING)


def _constant_error(active: ActiveModel, time: float, error: float, tolerance: float) -> SolveError:
    """The error of steps whose error does not fall with their length."""
    return SolveError(
        f"t = {time:.6g} {active.model.time_unit}, {active.name}: the error of a step stays at "
        f"{error:.2g} however short the step; give a step instead of the tolerance {tolerance:g}"
    )


def _advance_adaptively(
    active: ActiveModel, schedule: Schedule, first: int, last: int, events: list[Event]
) -> None:
    """Step doubling: accept two half steps where they differ from the whole one by at most the tolerance."""
    model, tolerance = active.model, schedule.tolerance or 1.0
    time, end = first * schedule.dt, last * schedule.dt
    if schedule.steps * schedule.dt > MAX_STEP_COUNT * model.largest_step:
        raise _unstable(active, MAX_STEP_COUNT, "the run;")
    shortest = (end - time) * 0.5**40
    doubling = _Doubling()
    while time < end:
        longest = min(active.next_dt, model.largest_step)
        pieces = max(1, math.ceil((end - time) / longest - 1e-9))
        dt = (end - time) / pieces
        try:
            state, error = _doubled_step(active, schedule, first, time, dt, events)
        except StepRejected as rejected:
            detail = _logged(active, rejected, first, time, dt, events)
            if schedule.on_failure == "stop" or dt < shortest:
                advice = step_advice(
                    active, rejected, schedule.dt, largest_solvable(active, rejected, time, dt)
                )
                raise SolveError(f"t = {time:.6g} {active.model.time_unit}, {detail}; {advice}") from rejected
            active.next_dt = doubling.failed() or dt / 4
            continue
        growth = 0.9 * (tolerance / error) ** (1 / (model.order + 1))
        if growth < 1 and dt < shortest:
            # also after an accepted step, since the next ones would get shorter and shorter
            raise _constant_error(active, time, error, tolerance)
        if error > tolerance:
            _check_tolerance(active, tolerance, time)
            detail = f"step of {dt:.3g} {active.model.time_unit} too long"
            events.append(Event(first, time, "tolerance", active.name, error, detail))
            active.next_dt = doubling.failed() or dt * max(0.2, min(growth, 0.9))
            continue
        active.state = state
        active.reached = (time + dt) / schedule.dt
        active.report_progress()
        active.n_steps += 2
        active.n_frame_limited += 2 * (pieces == 1 and dt < CUT_SHARE * longest)
        active.smallest = min(active.smallest, dt / 2)
        time = end if pieces == 1 else time + dt
        grown = dt * max(0.2, min(growth, 2.0))
        cut_short = dt < CUT_SHARE * active.next_dt
        active.next_dt = max(active.next_dt, grown) if cut_short and growth >= 1 else grown
        active.next_dt = max(active.next_dt, doubling.after(dt))
        if model.stop is not None:
            active.ending = model.stop(active.state)
            if active.ending is not None:
                events.append(Event(first, time, "stop", detail=active.ending.text))
                return
