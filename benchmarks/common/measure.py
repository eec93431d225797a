"""Time, memory and tables for benches: a row and its peer are measured in the same run.

Seconds are CPU seconds of this process and of the children it has waited for, so that other load on the
machine does not blur the ratios; with one thread (OMP_NUM_THREADS=1) they are the seconds of a quiet machine.
`print_commands` times whole commands as a user starts them: default environment, no thread variables.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ddgcli.cli.threads import THREAD_VARIABLES
from ddgcli.tradeoff.measure import peak_mib
from ddgcli.tradeoff.report import machine

__all__ = [
    "Timing",
    "cpu_seconds",
    "command_seconds",
    "interleaved",
    "machine",
    "peak_mib",
    "print_commands",
    "print_table",
    "python_seconds",
    "sample_path",
    "timed",
]


def cpu_seconds() -> float:
    """CPU seconds so far of this process and of its finished children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@dataclass(frozen=True)
class Timing:
    """Median and range of repeated calls, after one warm-up; `kernel`: seconds in the operating system."""

    median: float
    lowest: float
    highest: float
    value: Any = None
    kernel: float = 0.0

    def __str__(self) -> str:
        return f"{self.median:.4g} s ({self.lowest:.3g}..{self.highest:.3g})"


def timed(
    call: Callable[..., Any],
    repeat: int = 5,
    warm_up: bool = True,
    prepare: Callable[[], tuple] = lambda: (),
) -> Timing:
    """Time a call: one warm-up, then `repeat` runs; `prepare` makes their arguments and is not timed."""
    value = call(*prepare()) if warm_up else None
    seconds, kernel = [], []
    for _ in range(repeat):
        arguments = prepare()
        began, supplied = cpu_seconds(), resource.getrusage(resource.RUSAGE_SELF).ru_stime
        value = call(*arguments)
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


ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class CommandSeconds:
    """CPU seconds of a process, those of the operating system apart, wall-clock seconds and exit code."""

    user: float
    system: float
    wall: float
    exit_code: int

    @property
    def cpu(self) -> float:
        """CPU seconds of the process and of the operating system for it."""
        return self.user + self.system


def command_seconds(*words: str) -> CommandSeconds:
    """Time `python -m ddgcli WORDS` as a user starts it; names of sample files become their paths."""
    return python_seconds("-m", "ddgcli", *map(sample_path, words))


def python_seconds(*words: str) -> CommandSeconds:
    """Run `python WORDS` in an empty folder and time the whole process, start-up included.

    The environment is that of this process without the variables that set a number of threads or forbid
    compiled modules.
    """
    unset = (*THREAD_VARIABLES, "PYTHONDONTWRITEBYTECODE")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment["PYTHONPATH"] = str(ROOT)
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *words],
            cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    return CommandSeconds(usage.ru_utime, usage.ru_stime, wall, process.returncode)


def sample_path(word: str) -> str:
    """Path of the sample file of a name, else the word itself."""
    paths = [ROOT / folder / word for folder in ("sample_meshes", "sample_scenes")]
    return next((str(path) for path in paths if path.is_file()), word)


def print_commands(*calls: str, repeat: int = 3) -> None:
    """Print CPU and wall-clock seconds (medians) of whole commands; a call is the words after `ddgcli`."""
    rows: list[list[Any]] = []
    for call in calls:
        runs = [command_seconds(*call.split()) for _ in range(repeat)]
        cpu, wall = (statistics.median(getattr(run, name) for run in runs) for name in ("cpu", "wall"))
        rows.append([f"`ddgcli {call}`", cpu, wall, max(run.exit_code for run in runs)])
    print_table(
        "Whole commands in the default environment", ["command", "CPU s", "wall s", "exit code"], rows
    )
