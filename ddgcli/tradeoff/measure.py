"""Run candidates within a budget: median seconds, peak memory, errors against the reference."""

from __future__ import annotations

import logging
import math
import multiprocessing
import signal
import statistics
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ddgcli.errors import DdgError, SolveError
from ddgcli.progress import ProgressCallback
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, Row, Table, label_of

log = logging.getLogger("ddgcli")

Clock = Callable[[], float]

# share of the budget that the reference may take
REFERENCE_SHARE = 0.5


class BudgetSpent(BaseException):
    """What runs has used up its share of the budget, against its estimate."""


class Purse:
    """The time budget: what is left, and how the guesses of work compare with this machine so far."""

    def __init__(self, budget: float | None, began: float | None = None) -> None:
        self.budget = budget
        self._began = time.perf_counter() if began is None else began
        self._known: dict[str, list[tuple[float, float, float]]] = {}  # method: guess, set-up, solve

    def left(self) -> float:
        """Seconds left; infinite without a budget."""
        return float("inf") if self.budget is None else self.budget - (time.perf_counter() - self._began)

    def learn(self, method: str, guess: float, setup: float, solve: float) -> None:
        """Remember the seconds of a run beside its guess."""
        if guess > 0:
            self._known.setdefault(method, []).append((guess, setup, solve))

    def estimate(self, candidate: Candidate) -> float:
        """Seconds that one run of a candidate will take: by its own method's runs so far, else by all."""
        own = self._known.get(candidate.method, [])[-2:]
        if own:
            return max(setup + candidate.work * solve / guess for guess, setup, solve in own)
        known = [(setup + solve) / guess for runs in self._known.values() for guess, setup, solve in runs]
        return candidate.work * (statistics.median(known) if known else 1.0)

    def estimate_like(self, candidate: Candidate, work: float) -> float:
        """Seconds of other work, as one run of a candidate tells: its set-up, and solves in proportion."""
        return self.estimate(replace(candidate, work=work))

    @contextmanager
    def stopping_after(self, seconds: float) -> Iterator[None]:
        """Raise `BudgetSpent` in what runs longer than that (where the system has interval timers).

        A long call into compiled code ends first.
        """
        here = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
        if self.budget is None or not here:
            yield
            return
        before = signal.signal(signal.SIGALRM, _spent)
        signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3), 0.1)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def _spent(*_: Any) -> None:
    raise BudgetSpent


def run_problem(
    problem: Problem,
    *,
    repeat: int = 5,
    budget: float | None = None,
    began: float | None = None,
    clock: Clock = time.perf_counter,
    progress: ProgressCallback | None = None,
) -> Table:
    """Measure every candidate that the budget can pay, cheap ones first.

    Parameters
    ----------
    repeat : int
        Timed queries a candidate, after one warm-up; fewer where the budget is short, and told in the row.
        0 for errors alone: the first query counts, memory is not measured.
    budget : float, optional
        Seconds for everything, the reference included. What is estimated to exceed it is not begun; what
        outruns its estimate is stopped.
    began : float, optional
        When the budget began to run, by `time.perf_counter`; by default now.
    clock : callable, optional
        What the seconds of the rows are read from; the budget always speaks of the wall's.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    Table
        Partial, with `interrupted` set, when the user interrupts.

    Raises
    ------
    SolveError
        When the budget pays for no reference.
    """
    purse, table = Purse(budget, began), Table(left_out=list(problem.left_out))
    steps = len(problem.candidates) + 1  # the reference is the first
    report = (lambda done: None) if progress is None else (lambda done: progress(done, steps))
    try:
        report(0)
        _calibrate(problem, purse)
        table.reference = reference = _reference(problem, purse, table)
        _run_candidates(problem, table, reference, purse, repeat, clock, report)
    except KeyboardInterrupt:
        table.interrupted = True
    return table


def _calibrate(problem: Problem, purse: Purse) -> None:
    """Learn from the cheapest candidate how guesses compare with this machine, where the choice needs it."""
    if purse.budget is None or problem.references[0][0] == 0 or not problem.candidates:
        return
    cheapest = problem.candidates[0]
    setup, solve = 0.0, purse.budget  # what is told where it takes too long to end
    try:
        with purse.stopping_after(REFERENCE_SHARE * purse.left()):
            for _ in range(2):  # the first also pays for imports
                state, setup = _timed(cheapest.setup, time.perf_counter)
                solve = _timed(partial(cheapest.solve, state), time.perf_counter)[1]
                if setup + solve > 0.1 * purse.left():
                    break
    except DdgError:  # told when its turn comes
        return
    except BudgetSpent:
        pass
    purse.learn(cheapest.method, cheapest.work, setup, solve)


def _run_candidates(
    problem: Problem,
    table: Table,
    reference: Reference,
    purse: Purse,
    repeat: int,
    clock: Clock,
    report: Callable[[int], Any],
) -> None:
    for number, candidate in enumerate(problem.candidates, 1):
        report(number)
        estimate, left, began = purse.estimate(candidate), purse.left(), time.perf_counter()
        if estimate * 1.2 > left:
            why = f"estimated {estimate:.3g} s, {max(left, 0):.3g} s are left"
            table.left_out.append((label_of(candidate), why))
            continue
        try:
            with purse.stopping_after(left), _speaking_of(label_of(candidate)):
                table.rows.append(measure(candidate, problem, reference, purse, repeat, clock))
        except DdgError as error:
            table.left_out.append((label_of(candidate), str(error)))
        except BudgetSpent:
            why = f"stopped after {time.perf_counter() - began:.3g} s, estimated {estimate:.3g} s"
            table.left_out.append((label_of(candidate), why))
    report(len(problem.candidates) + 1)


@contextmanager
def _speaking_of(label: str) -> Iterator[None]:
    """Warnings inside begin with the row that they are about."""

    def prefixed(record: logging.LogRecord) -> bool:
        record.msg, record.args = f"{label}: {record.getMessage()}", ()
        return True

    log.addFilter(prefixed)
    try:
        yield
    finally:
        log.removeFilter(prefixed)


def _reference(problem: Problem, purse: Purse, table: Table) -> Reference:
    """The most accurate reference that its share of the budget can pay.

    Raises
    ------
    DdgError
        Where there is none: what the last one said, or that the budget is too short.
    """
    failure, needed = "", 0.0
    for work, make in problem.references:
        share = REFERENCE_SHARE * purse.left()
        estimate = purse.estimate_like(problem.candidates[0], work) if work and problem.candidates else work
        why = f"estimated {estimate:.3g} s of the {purse.budget or 0:g} s budget"
        if estimate <= share:
            try:
                with purse.stopping_after(share):
                    return make()
            except BudgetSpent:
                why = f"stopped after {share:.3g} s, {why}"
            except SolveError as error:
                why = failure = str(error)
        needed = 3 * estimate if why != failure else needed
        table.left_out.append(("a finer reference", why))
    longer = f"; give --budget {math.ceil(needed)} or more" if needed else ""
    raise SolveError((failure or f"no reference is affordable: the cheapest was {why}") + longer)


def measure(
    candidate: Candidate,
    problem: Problem,
    reference: Reference,
    purse: Purse,
    repeat: int,
    clock: Clock = time.perf_counter,
) -> Row:
    """One row: a warm-up that gives the answer, `repeat` timed queries, one run for the peak memory.

    Raises
    ------
    SolveError
        When the answer is not finite where the reference is.
    """
    began = time.perf_counter()
    state, cold_setup = _timed(candidate.setup, clock)
    ready = time.perf_counter()
    answer, first = _timed(lambda: candidate.solve(state), clock)
    purse.learn(candidate.method, candidate.work, ready - began, time.perf_counter() - ready)
    errors = np.asarray(problem.error(np.asarray(answer), reference.values), dtype=np.float64)
    worst = int(errors.argmax()) if len(errors) else 0
    if len(errors) and not np.isfinite(errors[worst]):
        raise SolveError(f"its answer is not finite at {problem.place} {worst}")
    seconds, setups, memory = [first], [cold_setup], False
    if repeat:
        repeats = int(max(1, min(repeat, 0.15 * purse.left() / max(first, 1e-9))))
        seconds = [_timed(lambda: candidate.solve(state), clock)[1] for _ in range(repeats)]
        memory = cold_setup + first < 0.1 * purse.left()
        if 1e-4 < cold_setup < 0.1 * purse.left():  # the first also paid for imports
            setups = [_timed(candidate.setup, clock)[1] for _ in range(min(3, repeats))]
    return Row(
        method=candidate.method,
        parameters=dict(candidate.parameters),
        setup_seconds=statistics.median(setups),
        seconds=statistics.median(seconds),
        seconds_spread=(min(seconds), max(seconds)),
        repeats=repeat and len(seconds),
        peak_mib=peak_mib(lambda: candidate.solve(candidate.setup())) if memory else float("nan"),
        max_error=float(errors[worst]) if len(errors) else 0.0,
        max_error_at=worst,
        mean_error=float(errors.mean()) if len(errors) else 0.0,
        options=candidate.options,
        program=candidate.program,
    )


def _timed(call: Callable[[], Any], clock: Clock) -> tuple[Any, float]:
    began = clock()
    value = call()
    return value, clock() - began


def peak_mib(call: Callable[[], Any]) -> float:
    """Growth of the peak resident memory during a call, in MiB.

    Measured in a forked child, where factorisations count too; without fork, numpy's allocations alone.
    """
    if sys.platform == "linux":
        return _peak_of_child(call)
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def _peak_of_child(call: Callable[[], Any]) -> float:
    _give_back_free_memory()
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_child, args=(call, there), daemon=True)
    child.start()
    there.close()
    try:
        return float(here.recv())
    except EOFError:
        return float("nan")
    except BaseException:
        child.kill()
        raise
    finally:
        child.join()


def _give_back_free_memory() -> None:
    """Return what malloc keeps of freed blocks: a child would fill it again unseen."""
    import ctypes

    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    except (OSError, AttributeError):
        log.debug("malloc_trim is not to be had: peak memory may be told too low")


def _child(call: Callable[[], Any], pipe: Any) -> None:
    import resource

    logging.getLogger("ddgcli").handlers[:] = [logging.NullHandler()]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    call()
    pipe.send((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
