"""Time budget of a comparison: seconds left, predictions, and the end of runs that exceed it."""

from __future__ import annotations

import signal
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from ddgcli.tradeoff.candidates import Candidate

Clock = Callable[[], float]

# share of the budget that the reference may take
REFERENCE_SHARE = 0.5

MAX_TIMER_SECONDS = 1e8  # about what every system's interval timers take


class BudgetExceeded(BaseException):
    """Raised in a run that exceeds its share of the time budget."""


class TimeBudget:
    """Time budget: seconds left, and seconds of a candidate predicted from the runs so far."""

    def __init__(self, seconds: float | None, began: float | None = None) -> None:
        self.seconds = seconds
        self._began = time.perf_counter() if began is None else began
        self._runs: dict[str, list[tuple[float, float, float]]] = {}  # method: work, set-up, solve
        self._stopped_runs: dict[str, list[tuple[float, float]]] = {}  # method: work, seconds

    def seconds_left(self) -> float:
        """Remaining seconds; infinite without a budget."""
        return float("inf") if self.seconds is None else self.seconds - (time.perf_counter() - self._began)

    def beyond(self, estimate: float, share: float) -> str:
        """Why a run of `estimate` seconds does not begin: its share of the budget is less, or used up."""
        if share <= 0:
            return f"estimated {estimate:.3g} s, after the {self.seconds or 0:g} s budget was used up"
        return f"estimated {estimate:.3g} s, and may take {share:.3g} s of the {self.seconds or 0:g} s budget"

    def record(self, method: str, work: float, setup: float, solve: float) -> None:
        """Store the seconds of a run with its estimated work."""
        if work > 0:
            self._runs.setdefault(method, []).append((work, setup, solve))

    def record_stop(self, method: str, work: float, seconds: float) -> None:
        """Store the seconds after which a run was stopped, with its estimated work."""
        if work > 0:
            self._stopped_runs.setdefault(method, []).append((work, seconds))

    def was_stopped(self, method: str) -> bool:
        """Whether a run of a method was stopped."""
        return method in self._stopped_runs

    def estimate(self, candidate: Candidate) -> float:
        """Predict the seconds of one run from the last runs of its method, else from all runs."""
        own = [
            setup + candidate.work * solve / work
            for work, setup, solve in self._runs.get(candidate.method, [])[-2:]
        ]
        own += [
            candidate.work * seconds / work for work, seconds in self._stopped_runs.get(candidate.method, [])
        ]
        if own:
            return max(own)
        rates = [(setup + solve) / work for runs in self._runs.values() for work, setup, solve in runs]
        return candidate.work * (statistics.median(rates) if rates else 1.0)

    def estimate_like(self, candidate: Candidate, work: float) -> float:
        """Predict the seconds of other work with the set-up of a candidate."""
        return self.estimate(replace(candidate, work=work))

    @contextmanager
    def limit_time(self, seconds: float) -> Iterator[None]:
        """Raise `BudgetExceeded` in the body after some seconds (where the system has interval timers).

        A call into compiled code is not interrupted. What such code makes of the exception, as pydantic does
        in the first use of a scene, counts as `BudgetExceeded` too. A limit within another one ends where the
        sooner of both does.
        """
        here = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
        if self.seconds is None or not here:
            yield
            return
        is_over = False

        def stop(*_: Any) -> None:
            nonlocal is_over
            is_over = True
            raise BudgetExceeded

        outer, _ = signal.getitimer(signal.ITIMER_REAL)
        if outer and outer <= seconds:
            yield
            return
        end = time.perf_counter() + outer
        before = signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, min(max(seconds, 1e-3), MAX_TIMER_SECONDS), 0.1)
        try:
            yield
        except Exception as error:
            if is_over:
                raise BudgetExceeded from error
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
            if outer:
                signal.setitimer(signal.ITIMER_REAL, max(end - time.perf_counter(), 1e-3), 0.1)
