"""Run one task in a process of its own, with limits of time and memory, and measure both."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ddgcli.cli.batch.tasks import Task

POLL_SECONDS = 0.02
MESSAGE_LENGTH = 600  # messages have their remedy at the end
CLOCK_RESOLUTION_SECONDS = 2.0  # of time stamps on the coarsest file systems
PROGRAM = (sys.executable, "-m", "ddgcli")


@dataclass(frozen=True)
class TaskLimits:
    """Bounds of one task.

    Parameters
    ----------
    seconds : float, optional
    mebibytes : float, optional
        Resident memory; watched on Linux.
    """

    seconds: float | None = None
    mebibytes: float | None = None


@dataclass
class TaskRow:
    """Result of one task; its fields are the columns of the table."""

    index: int
    input: str
    command: str
    parameters: dict[str, str]
    output: str | None
    status: str
    exit_code: int | None
    seconds: float
    peak_mib: float | None
    sha256: str | None
    message: str = ""
    collected: dict[str, Any] = field(default_factory=dict)


def run_task(
    task: Task, limits: TaskLimits, collect: Sequence[str] = (), stop: threading.Event | None = None
) -> TaskRow:
    """Run a task in a process of its own and report how it ended.

    Parameters
    ----------
    task : Task
    limits : TaskLimits
        Limits of time and memory.
    collect : sequence of str
        Dotted names of values of the summary, such as `results.area`.
    stop : threading.Event, optional
        Ends the task when set.

    Returns
    -------
    TaskRow
        `status` is `done` (exit code 0), `failed` (another exit code), `timeout`, `memory` or `killed` (by a
        signal, or because `stop` was set).
    """
    task.make_folders()
    command = [*PROGRAM, *task.words, "--json", "--no-progress"]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        began, began_at = time.perf_counter(), time.time()
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True
        )
        reason, peak = _watch(process, limits, began, stop)
        seconds = time.perf_counter() - began
        summary, message = _content(out), _content(err).strip().splitlines()
    code = process.returncode
    is_killed = bool(reason) or code < 0  # Windows has no codes below 0
    if is_killed:
        for path in task.output_files:
            _remove_partial_output(path, began_at)
    status = reason or ("done" if code == 0 else "killed" if is_killed else "failed")
    if status == "failed" and any("out of memory" in line for line in message):
        status = "memory"
    return TaskRow(
        task.index,
        task.input,
        task.command,
        task.parameters,
        task.output,
        status,
        None if is_killed else code,
        round(seconds, 3),
        peak,
        file_hash(task.input),
        message[-1][:MESSAGE_LENGTH] if message else "",
        _collected(summary, collect),
    )


def _watch(
    process: subprocess.Popen, limits: TaskLimits, began: float, stop: threading.Event | None
) -> tuple[str, float | None]:
    """Wait for the end; kill the process at a limit. Reason of a kill, and peak memory in MiB."""
    reason, peak = "", None
    try:
        while process.poll() is None:
            resident, highest = _resident(process.pid)
            peak = highest if highest is not None else peak
            if limits.seconds is not None and time.perf_counter() - began > limits.seconds:
                reason = "timeout"
            elif limits.mebibytes is not None and resident is not None and resident > limits.mebibytes:
                reason = "memory"
            elif stop is not None and stop.is_set():
                reason = "killed"
            if reason:
                break
            time.sleep(POLL_SECONDS)
    finally:
        if process.poll() is None:
            _kill(process)
    return reason, peak


def _kill(process: subprocess.Popen) -> None:
    """End the process and what it started."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def _remove_partial_output(output: Path, began_at: float) -> None:
    """Remove the temporary file beside the output that a killed process could not remove itself.

    Its name is that of `ddgcli.io.temporary.temporary_name`; a process that began earlier keeps its own.
    """
    stem, suffix = re.escape(output.stem), re.escape(output.suffix)
    name = re.compile(rf"\.{stem}-[^-]*-[0-9]+-[a-z0-9_]{{8}}{suffix}")  # host, process, random letters
    for path in output.parent.iterdir():
        with contextlib.suppress(OSError):
            if name.fullmatch(path.name) and path.stat().st_mtime > began_at - CLOCK_RESOLUTION_SECONDS:
                path.unlink()


def _resident(pid: int) -> tuple[float | None, float | None]:
    """Resident memory of a process now and at most, in MiB; None where the system does not report it."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return None, None
    entries = dict(line.split(":", 1) for line in lines if ":" in line)
    now, most = (entries.get(name) for name in ("VmRSS", "VmHWM"))
    return (int(now.split()[0]) / 1024 if now else None, int(most.split()[0]) / 1024 if most else None)


def _content(file: Any) -> str:
    file.seek(0)
    return file.read().decode("utf-8", "replace")


def _collected(summary: str, names: Sequence[str]) -> dict[str, Any]:
    try:
        body = json.loads(summary)
    except ValueError:
        body = {}
    values = {}
    for name in names:
        value: Any = body
        for key in name.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        values[name] = value
    return values


def file_hash(path: str) -> str | None:
    """SHA-256 of a file.

    Parameters
    ----------
    path : str

    Returns
    -------
    str or None
        None where it cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
