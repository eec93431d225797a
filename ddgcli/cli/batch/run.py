"""Run the tasks of a batch in parallel, in processes of this machine or on a Dask cluster."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from ddgcli.cli.batch.process import TaskLimits, TaskRow, file_hash, run_task
from ddgcli.cli.batch.table import completed_rows, journal_line, journal_path
from ddgcli.cli.batch.tasks import Task
from ddgcli.errors import MissingExtraError, ParameterError, SolveError, excerpt
from ddgcli.waiting import wait_in_steps

CONNECT_SECONDS = 30
MAX_LOST_CONNECTIONS = 3  # one after the other, without a task that ended


def run_batch(
    tasks: Sequence[Task],
    limits: TaskLimits,
    *,
    jobs: int = 1,
    collect: Sequence[str] = (),
    table: str | None = None,
    resume: bool = False,
    cluster: str | None = None,
    progress: Callable[[float, float], Any] = lambda completed, total: None,
) -> list[TaskRow]:
    """Run the tasks of a batch; a task that fails does not stop the others.

    Parameters
    ----------
    tasks : sequence of Task
    limits : TaskLimits
        Limits of each task.
    jobs : int
        Processes in parallel.
    collect : sequence of str
        Dotted names of values of the summaries.
    table : str, optional
        Path of the table; its journal `TABLE.part` gets a line when a task ends.
    resume : bool
        Keep the runs that the table or its journal holds as done; the rest is run.
    cluster : str, optional
        Address of a Dask scheduler whose workers see the same files.
    progress : callable (completed, total)

    Returns
    -------
    list of TaskRow
        In the order of the tasks.
    """
    rows: dict[int, TaskRow] = {}
    journal = journal_path(table) if table is not None else None
    if table is not None and resume:
        hashes = {path: file_hash(path) for path in {task.input for task in tasks}}
        rows = completed_rows(table, tasks, hashes, collect)
    elif journal is not None:
        journal.unlink(missing_ok=True)
    rest = [task for task in tasks if task.index not in rows]
    results = (
        _on_cluster(rest, limits, collect, cluster) if cluster else _local_rows(rest, limits, collect, jobs)
    )
    with contextlib.closing(results):  # whatever ends the loop, running tasks end too
        for task, row in results:
            rows[task.index] = row
            if journal is not None:
                _append(journal, journal_line(row))
            progress(len(rows), len(tasks))
    return [rows[task.index] for task in tasks]


def _append(journal: Path, line: str) -> None:
    """Add a line; one after a torn line begins a new one."""
    incomplete = journal.exists() and not journal.read_bytes().endswith(b"\n") and journal.stat().st_size > 0
    with open(journal, "a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(("\n" if incomplete else "") + line)


def _local_rows(
    tasks: Sequence[Task], limits: TaskLimits, collect: Sequence[str], jobs: int
) -> Generator[tuple[Task, TaskRow], None, None]:
    stop = threading.Event()
    waiting = iter(tasks)
    running: dict[Future[TaskRow], Task] = {}
    with ThreadPoolExecutor(jobs) as pool:
        try:
            while True:
                for task in itertools.islice(waiting, jobs - len(running)):
                    running[pool.submit(run_task, task, limits, collect, stop)] = task
                if not running:
                    return
                wait_in_steps(lambda seconds: wait(running, seconds, FIRST_COMPLETED).done)
                for ended in [future for future in running if future.done()]:
                    yield running.pop(ended), ended.result()
        finally:
            stop.set()  # an interrupted batch leaves no process behind


def _on_cluster(
    tasks: Sequence[Task], limits: TaskLimits, collect: Sequence[str], address: str
) -> Generator[tuple[Task, TaskRow], None, None]:
    """Rows from the workers of a Dask scheduler; after a lost connection the rest is submitted again."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise MissingExtraError("a cluster needs Dask: pip install 'ddgcli[cluster]'") from error
    rest = {task.index: task for task in tasks}
    losses = 0
    while rest:
        with _client(Client, address) as client:
            futures = {
                client.submit(run_task, task, limits, tuple(collect), pure=False): task
                for task in rest.values()
            }
            for future in as_completed(futures):
                task = futures[future]
                if future.status == "cancelled":
                    break
                row = future.result() if future.status == "finished" else _lost_row(task, future.exception())
                del rest[task.index]
                losses = 0
                yield task, row
        losses += 1
        if losses > MAX_LOST_CONNECTIONS:
            raise SolveError(f"the connection to {address} was lost {losses} times; repeat with `resume`")


def _client(make: Callable[..., Any], address: str) -> Any:
    try:
        return make(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"{address!r} cannot be reached ({excerpt(error)}); start a scheduler (dask scheduler) and "
            "workers, and give its address, such as tcp://localhost:8786",
            parameter="cluster",
        ) from error


def _lost_row(task: Task, error: BaseException) -> TaskRow:
    """Row of a task whose worker died, or could not run it."""
    digest = file_hash(task.input)
    return TaskRow(
        task.index, task.input, task.command, task.parameters, task.output, "killed", None, 0.0, None, digest,
        excerpt(error),
    )  # fmt: skip
