"""Time, memory and tables for benches: every row stands beside its peer, measured in the same run.

Seconds are CPU seconds of this process and of the children it has waited for, so that what else the machine
does blurs no ratio; with one thread each (OMP_NUM_THREADS=1) they are the seconds of a quiet machine.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ddgcli.tradeoff.measure import peak_mib
from ddgcli.tradeoff.report import machine

__all__ = ["Timing", "cpu_seconds", "interleaved", "machine", "peak_mib", "print_table", "timed"]


def cpu_seconds() -> float:
    """CPU seconds so far of this process and of its finished children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@dataclass(frozen=True)
class Timing:
    """Median and spread of repeated calls, after one warm-up; `kernel`: what the system took (memory)."""

    median: float
    least: float
    most: float
    value: Any = None
    kernel: float = 0.0

    def __str__(self) -> str:
        return f"{self.median:.4g} s ({self.least:.3g}..{self.most:.3g})"


def timed(
    call: Callable[..., Any],
    repeat: int = 5,
    warm_up: bool = True,
    prepare: Callable[[], tuple] = lambda: (),
) -> Timing:
    """Time a call: one warm-up, then `repeat` runs; what `prepare` makes anew for each is not counted."""
    value = call(*prepare()) if warm_up else None
    seconds, kernel = [], []
    for _ in range(repeat):
        given = prepare()
        began, supplied = cpu_seconds(), resource.getrusage(resource.RUSAGE_SELF).ru_stime
        value = call(*given)
        seconds.append(cpu_seconds() - began)
        kernel.append(resource.getrusage(resource.RUSAGE_SELF).ru_stime - supplied)
    return Timing(statistics.median(seconds), min(seconds), max(seconds), value, statistics.median(kernel))


def interleaved(calls: dict[str, Callable[[], Any]], repeat: int = 5) -> dict[str, Timing]:
    """Time several calls in turn, so that a noisy machine disturbs all alike."""
    values = {name: call() for name, call in calls.items()}
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeat):
        for name, call in calls.items():
            began = cpu_seconds()
            call()
            seconds[name].append(cpu_seconds() - began)
    return {n: Timing(statistics.median(s), min(s), max(s), values[n]) for n, s in seconds.items()}


def print_table(title: str, header: list[str], rows: list[list[Any]]) -> None:
    """Print a Markdown table."""
    print(f"\n### {title}\n")
    print("| " + " | ".join(header) + " |")
    print("|" + " --- |" * len(header))
    for row in rows:
        print("| " + " | ".join(f"{c:.4g}" if isinstance(c, float) else str(c) for c in row) + " |")
    print(flush=True)
