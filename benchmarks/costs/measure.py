"""Measured seconds and memory of one use of a kernel, and the line fitted through them."""

from __future__ import annotations

import shlex
import statistics
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.process import MeasuredProcess, measured_command
from benchmarks.costs.inputs import make_input
from benchmarks.costs.task import Task
from ddgcli.cli.forecast.coefficients import Cost
from ddgcli.cli.forecast.prediction import fill, probe

REPETITIONS = 3
BEYOND_SHORT_SUMMARY = ("curvature further arrays", "curvature energies")
NOTHING = Cost(0.0, 0.0, 1.0, 0.0, 0.0)  # of a kernel that is measured later


def measure(words: list[str], folder: Path, *, short: bool = False) -> MeasuredProcess:
    """Run `ddgcli WORDS --json`, with `short` without --json."""
    run = measured_command(words if short else [*words, "--json"], folder)
    if run.exit_code == 2:
        raise SystemExit(f"failed: {' '.join(words)}\n{run.error}")
    return run


@cache
def read_facts(path: Path, folder: Path) -> dict[str, float]:
    """MiB and CPU seconds of `info` after it has read a file, and the probe at that time."""
    before = probe()
    facts = dry_run(["info", str(path)], folder)
    return facts | {"probe_seconds": 0.5 * (before + probe())}


def dry_run(words: list[str], folder: Path) -> dict[str, Any]:
    """Prediction of a command."""
    return measure([*words, "--dry-run"], folder).summary["results"]


def measured_kernel(
    task: Task, folder: Path, table: dict[str, Cost], probe_seconds: float
) -> list[tuple[float, float, float]]:
    """Elements (1e5), and the seconds and MiB of one use of the kernel, for every size of the task.

    `probe_seconds` is the probe at the speed of the table.
    """
    facts: dict[str, Any] = {}
    rows, start, start_mib = [], 0.0, 0.0
    for elements in task.sizes:
        path, radius = make_input(folder, task.mesh, elements)
        words = shlex.split(task.words.format(mesh=path, out=folder / "out", radius=radius, wide=3 * radius))
        run_seconds, run_mib, uses = repeated_run(words, folder, probe_seconds, task)
        read = read_facts(path, folder)
        first, facts = not facts, dry_run(words, folder)  # the kernels as the command itself counts them
        if first:  # what its imports cost
            start = facts["read_seconds"] - read["read_seconds"]
            start_mib = facts["read_mib"] - read["read_mib"]
        speed = probe_seconds / read["probe_seconds"]
        seconds = run_seconds - speed * (read["read_seconds"] + start)
        mib = run_mib - read["read_mib"] - start_mib
        kernels = [_as_run(use, uses) if use["kernel"] == task.kernel else use for use in facts["kernels"]]
        rows.append(_rest(task, kernels, read["elements"] / 1e5, seconds, mib, table))
    return rows


def _as_run(use: dict[str, Any], uses: float | None) -> dict[str, Any]:
    """A predicted use of a kernel with the number of uses that the run itself counts."""
    return use if uses is None else {**use, "times": uses, "added": min(use["added"], 1.0) and 1.0}


def repeated_run(
    words: list[str], folder: Path, probe_seconds: float, task: Task
) -> tuple[float, float, float | None]:
    """Seconds at the speed of the table, MiB (medians of repetitions) and uses of the kernel in a command."""
    seconds, mib = [], []
    for _ in range(REPETITIONS):
        before = probe()
        run = measure(words, folder, short=task.short)
        speed = 2.0 * probe_seconds / (before + probe())
        seconds.append((run.seconds + run.system_seconds) * speed)
        mib.append(run.mib)
    uses = (
        run.summary["results"][task.uses] if isinstance(task.uses, str) and task.uses else task.uses or None
    )
    return statistics.median(seconds), statistics.median(mib), uses


def _rest(
    task: Task, uses: list[dict[str, Any]], n: float, seconds: float, mib: float, table: dict[str, Cost]
) -> tuple[float, float, float]:
    """Elements of the kernel, and what other kernels leave of the seconds and MiB, for one use."""
    own = next(use for use in uses if use["kernel"] == task.kernel)
    shared = added = 0.0
    for use in uses:
        if use is own or (task.short and use["kernel"] in BEYOND_SHORT_SUMMARY):
            continue
        cost = table.get(f"{use['kernel']} {task.suffix}".strip(), NOTHING)
        filled = fill(use["kernel"], round(n * 1e5))
        size = use["elements"] / 1e5 if "elements" in use else n
        constant = cost.seconds * (1.0 if use.get("once") else use["times"])
        seconds -= constant + use["times"] * filled * cost.seconds_per_1e5 * size**cost.exponent
        own_mib = cost.mib + filled * cost.mib_per_1e5 * size
        shared, added = max(shared, 0.0 if use["added"] else own_mib), added + use["added"] * own_mib
    mib -= added
    mib = (mib - shared) / own["added"] if own["added"] else mib
    return own["elements"] / 1e5 if "elements" in own else n, max(seconds, 0.0) / own["times"], max(mib, 0.0)


def fitted(rows: list[tuple[float, float, float]], exponent: float, kernel: str = "") -> Cost:
    """Cost from (elements, seconds, MiB) at growing sizes, by relative least squares."""
    n, seconds, mib = (np.array(column) for column in zip(*rows))
    filled = np.array([fill(kernel, round(1e5 * x)) for x in n])
    return Cost(*_line(filled * n**exponent, seconds, 0.02), exponent, *_line(filled * n, mib, 5.0))


def _line(x: np.ndarray, values: np.ndarray, floor: float) -> tuple[float, float]:
    """Intercept and slope, neither negative."""
    weight = 1 / np.maximum(values, floor)
    return _nonnegative(np.stack([weight, x * weight], axis=1), values * weight)


def _nonnegative(matrix: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    x = np.linalg.lstsq(matrix, values, rcond=None)[0]
    if (x < 0).any():  # the better of the two columns alone
        single = [max(0.0, float(c @ values / (c @ c))) for c in matrix.T]
        errors = [float(np.abs(c * a - values).max()) for c, a in zip(matrix.T, single)]
        k = int(np.argmin(errors))
        x = np.zeros(2)
        x[k] = single[k]
    return float(x[0]), float(x[1])
