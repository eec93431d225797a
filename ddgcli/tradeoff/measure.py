"""Run candidates within a budget: median seconds, peak memory, errors against the reference."""

from __future__ import annotations

import logging
import multiprocessing
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from ddgcli.errors import DdgError
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, Row, Table

log = logging.getLogger("ddgcli")

# share of the budget that the reference may take
REFERENCE_SHARE = 0.5


class Purse:
    """The time budget: what is left, and how the guesses of work compare with this machine so far."""

    def __init__(self, budget: float | None) -> None:
        self.budget = budget
        self._began = time.perf_counter()
        self._ratios: dict[str, list[float]] = {}

    def left(self) -> float:
        """Seconds left; infinite without a budget."""
        return float("inf") if self.budget is None else self.budget - (time.perf_counter() - self._began)

    def learn(self, method: str, guess: float, seconds: float) -> None:
        """Remember how a run's seconds compare with its guess."""
        if guess > 0:
            self._ratios.setdefault(method, []).append(seconds / guess)

    def estimate(self, candidate: Candidate) -> float:
        """Seconds that one run of a candidate will take: by its own method's runs so far, else by all."""
        own = self._ratios.get(candidate.method)
        known = own[-2:] if own else [r for ratios in self._ratios.values() for r in ratios]
        return candidate.work * (max(known) if own else statistics.median(known) if known else 1.0)


def run_problem(
    problem: Problem,
    *,
    repeat: int = 5,
    budget: float | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> Table:
    """Measure every candidate that the budget can pay, cheap ones first.

    Parameters
    ----------
    repeat : int
        Timed queries a candidate, after one warm-up; fewer where the budget is short, and told in the row.
    budget : float, optional
        Seconds for everything, the reference included.
    progress : callable, optional
        Told (done, of).

    Returns
    -------
    Table
        Partial, with `interrupted` set, when the user interrupts.
    """
    purse, table = Purse(budget), Table(left_out=list(problem.left_out))
    try:
        table.reference = reference = _reference(problem, purse, table)
        _run_candidates(problem, table, reference, purse, repeat, progress)
    except KeyboardInterrupt:
        table.interrupted = True
    return table


def _run_candidates(
    problem: Problem,
    table: Table,
    reference: Reference,
    purse: Purse,
    repeat: int,
    progress: Callable[[int, int], Any] | None,
) -> None:
    for number, candidate in enumerate(problem.candidates):
        if progress is not None:
            progress(number, len(problem.candidates))
        name = _name(candidate)
        estimate = purse.estimate(candidate)
        if estimate * 1.2 > purse.left():
            table.left_out.append(
                (name, f"estimated {estimate:.3g} s, {max(purse.left(), 0):.3g} s are left")
            )
            continue
        try:
            row = measure(candidate, problem, reference, purse, repeat)
        except DdgError as error:
            table.left_out.append((name, str(error)))
            continue
        table.rows.append(row)
    if progress is not None:
        progress(len(problem.candidates), len(problem.candidates))


def _reference(problem: Problem, purse: Purse, table: Table) -> Reference:
    last = len(problem.references) - 1
    for number, (work, make) in enumerate(problem.references):
        affordable = purse.budget is None or work <= REFERENCE_SHARE * purse.budget
        if affordable or number == last:
            return make()
        table.left_out.append(
            ("a finer reference", f"estimated {work:.3g} s of the {purse.budget:g} s budget")
        )
    raise AssertionError("a problem without reference")


def _name(candidate: Candidate) -> str:
    dials = " ".join(f"{k}={v}" for k, v in candidate.parameters.items())
    return f"{candidate.method} {dials}".strip()


def measure(candidate: Candidate, problem: Problem, reference: Reference, purse: Purse, repeat: int) -> Row:
    """One row: a warm-up that gives the answer, `repeat` timed queries, one run for the peak memory."""
    state, setup_seconds = _timed(candidate.setup)
    answer, first = _timed(lambda: candidate.solve(state))
    purse.learn(candidate.method, candidate.work, setup_seconds + first)
    errors = np.asarray(problem.error(np.asarray(answer), reference.values), dtype=np.float64)
    affordable = purse.left() / max(3 * first, 1e-9)
    repeats = int(max(1, min(repeat, affordable)))
    seconds = [_timed(lambda: candidate.solve(state))[1] for _ in range(repeats)]
    setups = [setup_seconds]
    if setup_seconds > 1e-4 and repeats > 1 and 3 * setup_seconds < purse.left():
        setups += [_timed(candidate.setup)[1] for _ in range(min(2, repeats))]
    affords_memory = 2 * (setup_seconds + first) < purse.left()
    worst = int(errors.argmax()) if len(errors) else 0
    return Row(
        method=candidate.method,
        parameters=dict(candidate.parameters),
        setup_seconds=statistics.median(setups),
        seconds=statistics.median(seconds),
        seconds_spread=(min(seconds), max(seconds)),
        repeats=repeats,
        peak_mib=peak_mib(candidate) if affords_memory else float("nan"),
        max_error=float(errors[worst]) if len(errors) else 0.0,
        max_error_at=worst,
        mean_error=float(errors.mean()) if len(errors) else 0.0,
        options=candidate.options,
    )


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    began = time.perf_counter()
    value = call()
    return value, time.perf_counter() - began


def peak_mib(candidate: Candidate) -> float:
    """Growth of the peak resident memory in a run of set-up and one query, in MiB.

    Measured in a forked child, where factorisations count too; without fork, numpy's allocations alone.
    """
    if sys.platform == "linux":
        return _peak_of_child(lambda: candidate.solve(candidate.setup()))
    tracemalloc.start()
    try:
        candidate.solve(candidate.setup())
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
