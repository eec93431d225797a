"""Cost of a batch, from the dry runs of some of its tasks."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.check_cost import REMEDIES, dry_run_of
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.cli.batch.tasks import Task

__all__ = ["batch_cost", "dry_runs", "may_not_fit", "refuse_batch", "with_refused_runs"]

MIN_CHECKED_BYTES = 5e6  # size of a file of about 100,000 faces; smaller inputs fit into memory
MAX_PREDICTED_VALUES = 4  # combinations of swept values with dry runs of their own
MAX_DRY_RUNS = 100  # dry runs of a batch, for evenly spaced tasks if there are more
MAX_REFUSED = 3  # dry runs that end in an error, after which the whole batch does
MIN_SIZE_RATIO = 1.3  # ratio of file sizes above which costs are interpolated between two dry runs
_Facts = tuple[int, dict[str, Any]]  # bytes of an input, and the prediction of its dry run
DryRuns = Mapping[tuple[str, ...], dict[str, Any] | ParameterError]  # prediction or error, by command words
COSTS = ("peak_mib", "seconds", "least seconds", "most seconds")


def may_not_fit(tasks: Sequence[Task], jobs: int) -> bool:
    """Whether a batch runs inputs side by side that are large enough for a prediction."""
    return min(jobs, len(tasks)) > 1 and max(map(_bytes, tasks)) >= MIN_CHECKED_BYTES


def dry_runs(tasks: Sequence[Task], jobs: int) -> DryRuns:
    """Predictions (or errors) of the tasks of a batch, of at most `MAX_DRY_RUNS` evenly spaced ones."""
    checked = tasks[:: -(-len(tasks) // MAX_DRY_RUNS) or 1]
    words = [task.words for task in checked]
    with ThreadPoolExecutor(jobs) as pool:
        return dict(zip(words, pool.map(_prediction_or_refusal, words)))


def with_refused_runs(
    cost: dict[str, Any], tasks: Sequence[Task], checked: DryRuns
) -> tuple[dict[str, Any], list[str]]:
    """Results of a dry run, with the runs that end in an error, and the summary lines about these."""
    rows = [
        {"index": task.index, "input": task.input, "message": str(answer)}
        for task in tasks
        if isinstance(answer := checked.get(task.words), ParameterError)
    ]
    results = {
        **cost,
        "runs": len(tasks),
        "checked": len(checked),
        "refused": len(rows),
        "refused_runs": rows,
    }
    of_some = f" of {len(checked)} checked" if len(checked) < len(tasks) else ""
    text = [f"refused      {len(rows)}{of_some}"] if rows else []
    for row in rows:
        path, message = str(row["input"]), str(row["message"])
        text.append(f"refused: {message if message.startswith(path) else f'{path} {message}'}")
    return results, text


def batch_cost(tasks: Sequence[Task], jobs: int, checked: DryRuns | None = None) -> dict[str, Any]:
    """Prediction of a batch: seconds of all tasks, and memory of the `jobs` largest at the same time.

    For each combination of swept values (or some, if there are many), the largest and the smallest input have
    dry runs of their own; costs in between are interpolated by file size. `checked` are dry runs that exist
    already; tasks with an error there cost nothing.
    """
    checked = checked or {}
    n_tasks = len(tasks)
    tasks = [task for task in tasks if not isinstance(checked.get(task.words), ParameterError)]
    if n_tasks and not tasks:
        return {"dry_run": True, "runs": n_tasks}
    if not tasks:
        return {"dry_run": True, "runs": 0, "peak_mib": 0.0, "available_mib": 0.0, "seconds": 0.0}
    groups: dict[tuple[tuple[str, str], ...], list[Task]] = {}
    for task in tasks:
        groups.setdefault(tuple(task.parameters.items()), []).append(task)
    every = -(-len(groups) // MAX_PREDICTED_VALUES)
    costs: list[dict[str, float]] = []
    largest_run: dict[str, Any] = {}
    for number, group in enumerate(groups.values()):
        if number % every == 0:
            low, high = _ends(group, checked)
            largest_run = max(largest_run, high[1], key=lambda facts: facts.get("peak_mib", 0.0))
        costs += [_between(_bytes(task), low, high) for task in group]
    start = time.process_time()
    seconds, least, most = (start + sum(cost[name] for cost in costs) for name in COSTS[1:])
    return {
        "dry_run": True,
        "runs": len(tasks),
        "peak_mib": sum(sorted(cost["peak_mib"] for cost in costs)[-jobs:]),
        "available_mib": largest_run["available_mib"],
        "seconds": seconds,
        "seconds_range": [least, most],
        "largest_run": largest_run,
    }


def refuse_batch(cost: dict[str, Any], jobs: int) -> None:
    """Raise ParameterError for tasks that do not fit into memory at the same time."""
    from ddgcli.cli.forecast.prediction import UNCERTAINTY

    if "peak_mib" in cost and cost["peak_mib"] > (1 + UNCERTAINTY) * cost["available_mib"]:
        required, available = (cost[name] / 1024 for name in ("peak_mib", "available_mib"))
        raise ParameterError(
            f"{min(jobs, cost['runs'])} runs at a time need about {required:.3g} GiB of memory, and "
            f"{available:.3g} GiB are available; {REMEDIES['batch']}"
        )


def _bytes(task: Task) -> int:
    return Path(task.input).stat().st_size if Path(task.input).is_file() else 0


def _ends(group: Sequence[Task], checked: DryRuns) -> tuple[_Facts, _Facts]:
    """File sizes and predictions of the smallest and the largest valid input."""
    ordered = sorted(group, key=_bytes)
    high = _accepted(ordered[::-1], checked)
    if _bytes(ordered[0]) * MIN_SIZE_RATIO > high[0]:
        return high, high
    try:
        return _accepted(ordered, checked), high
    except ParameterError:
        return high, high


def _accepted(tasks: Sequence[Task], checked: DryRuns) -> _Facts:
    """File size and prediction of the first task with a valid input; others fail without stopping a batch."""
    refusal = None
    for task in tasks[:MAX_REFUSED]:
        answer = checked.get(task.words) or _prediction_or_refusal(task.words)
        if not isinstance(answer, ParameterError):
            return _bytes(task), answer
        refusal = refusal or answer
    raise refusal or ParameterError("no runs")


def _prediction_or_refusal(words: Sequence[str]) -> dict[str, Any] | ParameterError:
    try:
        return dry_run_of(words)
    except ParameterError as refusal:
        return refusal


def _between(size: int, low: _Facts, high: _Facts) -> dict[str, float]:
    """Costs of an input, interpolated by its file size."""
    share = (size - low[0]) / (high[0] - low[0]) if high[0] > low[0] else 1.0
    ends = [_costs(facts) for _, facts in (low, high)]
    return {name: max(0.0, a + share * (b - a)) for name, a, b in zip(COSTS, *ends)}


def _costs(facts: dict[str, Any]) -> tuple[float, ...]:
    return facts["peak_mib"], facts["seconds"], *facts.get("seconds_range", 2 * (facts["seconds"],))
