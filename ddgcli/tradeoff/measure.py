"""Run candidates within a time budget: median seconds, peak memory, errors against the reference."""

from __future__ import annotations

import logging
import math
import multiprocessing
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from ddgcli.errors import DdgError, SolveError
from ddgcli.memory import peak_by_getrusage, release_freed_memory
from ddgcli.progress import ProgressCallback
from ddgcli.tradeoff.candidates import (
    Candidate,
    MeshLimit,
    Problem,
    Reference,
    Row,
    Table,
    label_of,
)
from ddgcli.tradeoff.time_budget import REFERENCE_SHARE, BudgetExceeded, Clock, TimeBudget
from ddgcli.tradeoff.whole_error import (
    find_mesh_limit,
    find_polyhedron_error,
    whole_error,
)
from ddgcli.waiting import wait_in_steps

log = logging.getLogger("ddgcli")

ESTIMATE_RESERVE = 1.2  # factor of estimated seconds that must be left for a run to start
# while other rows have not run, the first run of a row is stopped after this share of the seconds left or, if
# that is longer and no run of its method was stopped so, after this factor of its estimate
FIRST_RUN_SHARE, MAX_ESTIMATE_RATIO = 0.3, 2.0


def run_problem(
    problem: Problem,
    *,
    repeat: int = 5,
    budget: float | None = None,
    began: float | None = None,
    clock: Clock = time.perf_counter,
    progress: ProgressCallback | None = None,
) -> Table:
    """Measure every candidate that fits the time budget, cheap ones first.

    Parameters
    ----------
    problem : Problem
    repeat : int
        Timed queries a candidate, after one warm-up; fewer if the budget is short (`Row.repeats`).
        With 0 the first query counts and memory is not measured.
    budget : float, optional
        Seconds for everything, the reference included. Runs that are estimated to exceed it do not start;
        runs that exceed it are stopped.
    began : float, optional
        Start of the budget by `time.perf_counter`; now by default.
    clock : callable, optional
        Clock of the rows' seconds; the budget counts wall-clock seconds.
    progress : callable, optional
        Called with (completed, total).

    Returns
    -------
    Table
        Partial, with `interrupted` set, when the user interrupts.

    Raises
    ------
    SolveError
        If no reference fits the budget.
    """
    time_budget, table = TimeBudget(budget, began), Table(left_out=list(problem.left_out))
    steps = len(problem.candidates) + 1  # the reference is the first
    report_progress = (
        (lambda completed: None) if progress is None else (lambda completed: progress(completed, steps))
    )
    try:
        report_progress(0)
        _calibrate(problem, time_budget)
        table.reference = reference = _reference(problem, time_budget, table)
        with _prefix_warnings("finer meshes"):
            find_mesh_limit(problem, time_budget, table)
        _run_candidates(problem, table, reference, time_budget, repeat, clock, report_progress)
        find_polyhedron_error(problem, reference, time_budget, table)
    except KeyboardInterrupt:
        table.interrupted = True
    return table


def _calibrate(problem: Problem, time_budget: TimeBudget) -> None:
    """Time the cheapest candidate, if the choice of a reference depends on predicted seconds."""
    if time_budget.seconds is None or problem.references[0][0] == 0 or not problem.candidates:
        return
    cheapest = problem.candidates[0]
    setup, solve = 0.0, time_budget.seconds  # recorded if the run is stopped
    try:
        seconds = REFERENCE_SHARE * time_budget.seconds_left()
        with time_budget.limit_time(seconds), _prefix_warnings(label_of(cheapest)):
            for _ in range(2):  # the first also includes imports
                state, setup = _timed(cheapest.setup, time.perf_counter)
                solve = _timed(partial(cheapest.solve, state), time.perf_counter)[1]
                if setup + solve > 0.1 * time_budget.seconds_left():
                    break
    except DdgError:  # reported with its row
        return
    except BudgetExceeded:
        pass
    time_budget.record(cheapest.method, cheapest.work, setup, solve)


def _run_candidates(
    problem: Problem,
    table: Table,
    reference: Reference,
    time_budget: TimeBudget,
    repeat: int,
    clock: Clock,
    report_progress: Callable[[int], Any],
) -> None:
    references = {"": reference}
    for number, candidate in enumerate(problem.candidates, 1):
        report_progress(number)
        estimate, seconds_left, began = (
            time_budget.estimate(candidate),
            time_budget.seconds_left(),
            time.perf_counter(),
        )
        if ESTIMATE_RESERVE * estimate > seconds_left:
            with_reserve = f"{ESTIMATE_RESERVE * estimate:.3g} s with a reserve"
            why = f"estimated {with_reserve}, {max(seconds_left, 0):.3g} s are left"
            table.left_out.append((label_of(candidate), why))
            continue
        share = math.inf
        if number < len(problem.candidates):
            share = FIRST_RUN_SHARE * seconds_left
            if not time_budget.was_stopped(candidate.method):
                share = max(share, MAX_ESTIMATE_RATIO * estimate)
        if estimate > share:
            table.left_out.append((label_of(candidate), time_budget.beyond(estimate, share)))
            continue
        try:
            with time_budget.limit_time(seconds_left), _prefix_warnings(label_of(candidate)):
                if candidate.model not in references and candidate.model_reference is not None:
                    references[candidate.model] = candidate.model_reference()
                own = references[candidate.model]
                table.rows.append(
                    measure_candidate(
                        candidate, problem, own, time_budget, repeat, clock, table.mesh_limit, share
                    )
                )
        except DdgError as error:
            table.left_out.append((label_of(candidate), str(error)))
        except BudgetExceeded:
            why = f"stopped after {time.perf_counter() - began:.3g} s, estimated {estimate:.3g} s"
            table.left_out.append((label_of(candidate), why))
    report_progress(len(problem.candidates) + 1)


@contextmanager
def _prefix_warnings(label: str) -> Iterator[None]:
    """Prefix warnings with the label of their row; `record.row_label` holds the label."""

    def prefixed(record: logging.LogRecord) -> bool:
        record.msg, record.args, record.row_label = f"{label}: {record.getMessage()}", (), label
        return True

    log.addFilter(prefixed)
    try:
        yield
    finally:
        log.removeFilter(prefixed)


def _reference(problem: Problem, time_budget: TimeBudget, table: Table) -> Reference:
    """Most accurate reference within its share of the budget.

    Raises
    ------
    DdgError
        If there is none: the error of the last one, or that the budget is too short.
    """
    failure, required_budget = "", 0.0
    for work, compute in problem.references:
        seconds_left = time_budget.seconds_left()
        share = REFERENCE_SHARE * seconds_left
        estimate = (
            time_budget.estimate_like(problem.candidates[0], work) if work and problem.candidates else work
        )
        why = time_budget.beyond(estimate, share)
        if estimate <= share:
            try:
                with time_budget.limit_time(share), _prefix_warnings("reference"):
                    return compute()
            except BudgetExceeded:
                why = f"stopped after {share:.3g} s, {why}"
            except SolveError as error:
                why = failure = str(error)
        if why != failure:  # half as much again as the reference needs, after the seconds so far
            passed = (time_budget.seconds or 0.0) - seconds_left
            required_budget = passed + 1.5 / REFERENCE_SHARE * max(estimate, share)
        table.left_out.append(("a finer reference", why))
    longer = f"; use `budget={math.ceil(required_budget)}` or more" if required_budget else ""
    raise SolveError((failure or f"no reference is affordable: the cheapest was {why}") + longer)


def measure_candidate(
    candidate: Candidate,
    problem: Problem,
    reference: Reference,
    time_budget: TimeBudget,
    repeat: int,
    clock: Clock = time.perf_counter,
    mesh_limit: MeshLimit | None = None,
    warm_up_seconds: float = math.inf,
) -> Row:
    """Measure one row: a warm-up for the answer, `repeat` timed queries, one run for the peak memory.

    Raises
    ------
    SolveError
        If the answer is not finite where the reference is.
    BudgetExceeded
        If the warm-up takes longer than `warm_up_seconds`.
    """
    began = time.perf_counter()
    try:
        with time_budget.limit_time(warm_up_seconds):
            state, cold_setup = _timed(candidate.setup, clock)
            ready = time.perf_counter()
            answer, first = _timed(lambda: candidate.solve(state), clock)
    except BudgetExceeded:
        time_budget.record_stop(candidate.method, candidate.work, time.perf_counter() - began)
        raise
    time_budget.record(candidate.method, candidate.work, ready - began, time.perf_counter() - ready)
    errors = np.asarray(problem.error(np.asarray(answer), reference.values), dtype=np.float64)
    worst = int(errors.argmax()) if len(errors) else 0
    if len(errors) and not np.isfinite(errors[worst]):
        raise SolveError(f"its answer is not finite at {problem.place} {worst}")
    seconds, setups, memory = [first], [cold_setup], False
    if repeat:
        repeats = int(max(1, min(repeat, 0.15 * time_budget.seconds_left() / max(first, 1e-9))))
        seconds = [_timed(lambda: candidate.solve(state), clock)[1] for _ in range(repeats)]
        memory = cold_setup + first < 0.1 * time_budget.seconds_left()
        if 1e-4 < cold_setup < 0.1 * time_budget.seconds_left():  # the first also included imports
            setups = [_timed(candidate.setup, clock)[1] for _ in range(min(3, repeats))]
    step_taken = None if candidate.step_taken is None else candidate.step_taken(state)
    whole = whole_error(problem, np.asarray(answer), errors, reference, mesh_limit)
    return Row(
        method=candidate.method,
        parameters=dict(candidate.parameters),
        setup_seconds=statistics.median(setups),
        seconds=statistics.median(seconds),
        seconds_spread=(min(seconds), max(seconds)),
        repeats=repeat and len(seconds),
        peak_mib=peak_mib(lambda: candidate.solve(candidate.setup())) if memory else float("nan"),
        max_error=whole.error.max,
        max_error_at=whole.worst,
        mean_error=whole.error.mean,
        time_error=whole.time_error,
        mesh_error=whole.mesh_error,
        uncertainty=whole.uncertainty,
        is_reference=whole.is_reference,
        is_other_law=candidate.is_other_law,
        setup_spread=(min(setups), max(setups)),
        step_taken=step_taken,
        deviation=whole.deviation,
        arguments=candidate.arguments,
        program=candidate.program,
    )


def _timed(call: Callable[[], Any], clock: Clock) -> tuple[Any, float]:
    began = clock()
    value = call()
    return value, clock() - began


def peak_mib(call: Callable[[], Any]) -> float:
    """Growth of the peak resident memory during a call, in MiB.

    A forked child measures it, factorisations included; without fork only numpy's allocations count.
    """
    if sys.platform == "linux":
        return _peak_of_forked_child(call)
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def _peak_of_forked_child(call: Callable[[], Any]) -> float:
    if not release_freed_memory():  # a child would reuse freed blocks and its peak would not grow
        log.debug("malloc_trim is missing: peak memory may be reported too low")
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_run_in_child, args=(call, there), daemon=True)
    child.start()
    there.close()
    try:
        wait_in_steps(here.poll)
        return float(here.recv())
    except EOFError:
        return float("nan")
    except BaseException:
        child.kill()
        raise
    finally:
        child.join()


def _run_in_child(call: Callable[[], Any], pipe: Any) -> None:
    logging.getLogger("ddgcli").handlers[:] = [logging.NullHandler()]
    before = peak_by_getrusage()
    call()
    pipe.send((peak_by_getrusage() - before) / 2**20)
