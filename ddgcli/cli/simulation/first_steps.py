"""Predicted cost of a simulation from its first steps, which a dry run takes if they are short."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.check_cost import predict_run
from ddgcli.cli.forecast.prediction import (
    MIB,
    fits,
    seconds_of_equilibria,
    seconds_of_steps,
    with_measured_equilibria,
    with_measured_steps,
)
from ddgcli.cli.forecast.simulator_kernels import expected_steps, mean_iterations
from ddgcli.cli.run import Run
from ddgcli.cli.simulation.simulate import Job, check_job
from ddgcli.errors import SolveError, without_warnings
from ddgcli.memory import resident_memory
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Model
from ddgcli.simulation.time_loop import evolve

if TYPE_CHECKING:
    from ddgcli.cli.forecast.prediction import Prediction
    from ddgcli.cli.forecast.use import InputSize

__all__ = ["begin_flow", "with_first_iterations", "with_first_steps"]

TRIAL_SECONDS, TRIAL_SHARE, MIN_TRIAL_STEPS = 0.4, 0.1, 3.0  # of a run, whichever is less
MAX_TRIAL_SECONDS = 2.0  # of first steps that take long
LATER_ITERATIONS = 10.0  # of the steps of a shell that moves far, which the first ones do not reach
# iterations to rest over those of a trial that does not reach it, and from which share of the table's on
UNFINISHED_FACTOR, UNFINISHED_RANGE, MIN_TRIED_SHARE = 4.0, (0.25, 8.0), 0.05
MAX_STEP_SECONDS = 0.15  # of a step by the table, for a trial


class _TrialEnd(Exception):
    """Ends a trial."""


def begin_flow(run: Run, job: Job, *, bounded: bool) -> None:
    """Check a flow, and end its dry run with what its first steps cost.

    A `bounded` flow, of a stated duration, takes the steps of its schedule; others end at rest.
    """
    check_job(run, job)

    def refine(prediction: Prediction, size: InputSize) -> Prediction:
        if bounded and size.steps is None:
            size = replace(size, steps=job.schedule.steps)
            prediction = predict_run(run, size, earlier=prediction)
        return with_first_steps(prediction, job, steps=size.steps or expected_steps(run.command))

    run.refine_prediction(refine)
    run.begin()


def with_first_steps(
    prediction: Prediction, job: Job, *, steps: int | None = None, at_least_table: bool = False
) -> Prediction:
    """A prediction whose steps cost what the first steps of the run cost.

    Parameters
    ----------
    prediction : Prediction
        By the table. It is returned as it is where its steps are long, or a step fails. Where the trial ends
        within the first steps, which take that long, there is a warning, and the range reaches from the
        table to a run whose steps all take so long. Adaptive steps may grow: of them the trial counts if it
        reached one whole step.
    job : Job
    steps : int, optional
        Expected number; default that of the schedule.
    at_least_table : bool
        The first steps may cost less than later ones: before contact they are a free fall.

    Returns
    -------
    Prediction
    """
    steps = steps or job.schedule.steps
    by_table = seconds_of_steps(prediction)
    if steps <= 2 * MIN_TRIAL_STEPS or not 0.0 < by_table < MAX_STEP_SECONDS * steps or not fits(prediction):
        return prediction
    trial = _trial(job)
    if trial is None:
        return prediction
    per_step, is_complete, is_divided, growth_from = trial
    per_step *= growth_from(steps)
    if not is_complete:
        logging.getLogger("ddgcli").warning(
            "the first steps take long: the run may take far longer than predicted"
        )
    if not per_step or (at_least_table and per_step * steps < by_table):
        return prediction
    peak = max(prediction.peak_mib, resident_memory()[1] / MIB)
    measured = replace(with_measured_steps(prediction, per_step * steps), peak_mib=peak)
    if is_complete and not is_divided:
        return measured
    # later steps may need no division: a load that begins at once yields and shakes only the first ones
    low = min(prediction.seconds_range[0], measured.seconds_range[0])
    return replace(measured, seconds_range=(low, measured.seconds_range[1]))


def with_first_iterations(prediction: Prediction, job: Job) -> Prediction:
    """A prediction of equilibria after a trial: what it took, else a multiple if it did not reach them all.

    A trial of few iterations by the table leaves the seconds as they are.
    """
    if not fits(prediction):
        return prediction
    began = time.process_time()

    def check() -> None:
        if time.process_time() - began > MAX_TRIAL_SECONDS:
            raise _TrialEnd

    is_complete = True
    job.account.check = check
    try:
        with without_warnings():  # the run itself gives them
            for _ in evolve(job.models, job.schedule, Account()):
                pass
    except _TrialEnd:
        is_complete = False
    except SolveError:
        return prediction
    finally:
        job.account.check = None
    seconds = time.process_time() - began
    peak = max(prediction.peak_mib, resident_memory()[1] / MIB)
    measured = replace(prediction, peak_mib=peak)
    if is_complete:
        return with_measured_equilibria(measured, seconds)
    expected = UNFINISHED_FACTOR * seconds
    # of several loads, the trial may have reached only the first
    if job.schedule.steps > 1 or seconds < MIN_TRIED_SHARE * seconds_of_equilibria(prediction):
        return measured
    return with_measured_equilibria(measured, expected, UNFINISHED_RANGE)


def _trial(job: Job) -> tuple[float, bool, bool, Callable[[int], float]] | None:
    """CPU seconds of a step, whether the trial ended after first steps or divided one, and its growth.

    None if a step fails.

    A complete trial leaves out what the first step prepares. The seconds of one that ended within the first
    steps are 0 if adaptive steps may grow from there. The growth is a function of the number of all steps:
    the seconds of their mean over those of the trial.
    """
    samples: list[tuple[float, float, float]] = []
    models, iterations = _counted(job.models)
    began = time.process_time()
    enough = max(MIN_TRIAL_STEPS, TRIAL_SHARE * job.schedule.steps)
    is_complete = True

    def progress(done: float, total: float) -> None:
        nonlocal is_complete
        elapsed = time.process_time() - began
        samples.append((done, elapsed, sum(iterations.values())))
        is_complete = elapsed <= MAX_TRIAL_SECONDS or done >= MIN_TRIAL_STEPS - 1
        if not is_complete or done >= enough or (elapsed > TRIAL_SECONDS and done > MIN_TRIAL_STEPS - 1):
            raise _TrialEnd

    try:
        with without_warnings():  # the run itself gives them
            for _ in evolve(models, job.schedule, Account(), progress=progress):
                pass
    except (_TrialEnd, SolveError):
        pass
    if not is_complete:
        done, elapsed, _ = samples[-1]
        per_step = elapsed / done if done >= 1.0 or job.schedule.tolerance is None else 0.0
        return per_step, False, False, lambda steps: 1.0
    if len(samples) < 2 or not samples[-1][0] > samples[0][0]:
        return None
    (first, start, before), (last, end, after) = samples[0], samples[-1]
    per_model = (after - before) / (last - first) / max(len(iterations), 1)

    def growth_from(steps: int) -> float:
        if per_model == 0.0 or steps <= last:
            return 1.0
        growth = mean_iterations(steps) / mean_iterations(last, first)
        return min(growth, max(1.0, LATER_ITERATIONS / per_model))

    is_divided = job.schedule.tolerance is None and any(done % 1.0 for done, _, _ in samples)
    return (end - start) / (last - first), True, is_divided, growth_from


def _counted(models: Mapping[str, Model[Any]]) -> tuple[dict[str, Model[Any]], dict[str, float]]:
    """Models that count the iterations of those whose steps have a growing number, and these counts."""
    counts: dict[str, float] = {}

    def counted(name: str, model: Model[Any], count: Callable[[Any], float]) -> Model[Any]:
        def advance(state: Any, at: float, dt: float) -> Any:
            after = model.advance(state, at, dt)
            counts[name] += count(after) - count(state)
            return after

        counts[name] = 0.0
        return replace(model, advance=advance)

    return {
        name: model if model.iterations is None else counted(name, model, model.iterations)
        for name, model in models.items()
    }, counts
