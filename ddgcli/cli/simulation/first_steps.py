"""Cost of a simulation by its first steps, which a dry run takes where they are short."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from ddgcli.cli.forecast.check_cost import predict_run
from ddgcli.cli.forecast.prediction import MIB, fits, seconds_of_steps, with_measured_steps
from ddgcli.cli.forecast.simulator_kernels import expected_steps
from ddgcli.cli.run import Run
from ddgcli.cli.simulation.simulate import Job, check_job
from ddgcli.errors import SolveError, without_warnings
from ddgcli.memory import resident_memory
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

if TYPE_CHECKING:
    from ddgcli.cli.forecast.prediction import Prediction
    from ddgcli.cli.forecast.use import InputSize

__all__ = ["begin_flow", "with_first_steps"]

TRIAL_SECONDS, TRIAL_SHARE, MIN_TRIAL_STEPS = 0.4, 0.1, 3.0  # of a run, whichever is less
MAX_TRIAL_SECONDS = 2.0  # of first steps that take long
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
    per_step, is_complete = trial
    if not is_complete:
        logging.getLogger("ddgcli").warning(
            "the first steps take long: the run may take far longer than predicted"
        )
    if not per_step or (at_least_table and per_step * steps < by_table):
        return prediction
    peak = max(prediction.peak_mib, resident_memory()[1] / MIB)
    measured = replace(with_measured_steps(prediction, per_step * steps), peak_mib=peak)
    if is_complete:
        return measured
    return replace(measured, seconds_range=(prediction.seconds_range[0], measured.seconds_range[1]))


def _trial(job: Job) -> tuple[float, bool] | None:
    """CPU seconds of a step, and whether the trial ended after its first steps; None where a step fails.

    A complete trial leaves out what the first step prepares. The seconds of one that ended within the first
    steps are 0 if adaptive steps may grow from there.
    """
    samples: list[tuple[float, float]] = []
    began = time.process_time()
    enough = max(MIN_TRIAL_STEPS, TRIAL_SHARE * job.schedule.steps)
    is_complete = True

    def progress(done: float, total: float) -> None:
        nonlocal is_complete
        elapsed = time.process_time() - began
        samples.append((done, elapsed))
        is_complete = elapsed <= MAX_TRIAL_SECONDS or done >= MIN_TRIAL_STEPS - 1
        if not is_complete or done >= enough or (elapsed > TRIAL_SECONDS and done > MIN_TRIAL_STEPS - 1):
            raise _TrialEnd

    try:
        with without_warnings():  # the run itself gives them
            for _ in evolve(job.models, job.schedule, Account(), progress=progress):
                pass
    except (_TrialEnd, SolveError):
        pass
    if not is_complete:
        done, elapsed = samples[-1]
        return (elapsed / done if done >= 1.0 or job.schedule.tolerance is None else 0.0), False
    if len(samples) < 2 or not samples[-1][0] > samples[0][0]:
        return None
    (first, start), (last, end) = samples[0], samples[-1]
    return (end - start) / (last - first), True
