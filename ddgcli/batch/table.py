"""Tables of batch results: JSON lines or CSV, and the journal that a broken batch resumes from."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from ddgcli.batch.process import TaskRow
from ddgcli.batch.tasks import Task

TABLE_FORMATS = (".jsonl", ".csv")
COLUMNS = tuple(f.name for f in fields(TaskRow))


def table_bytes(path: str, rows: Sequence[TaskRow]) -> bytes:
    """Content of the table at `path`: a JSON object a line, or CSV with a column a parameter and value."""
    ordered = sorted(rows, key=lambda row: row.index)
    if Path(path).suffix.lower() == ".jsonl":
        return "".join(json.dumps(asdict(row), ensure_ascii=False) + "\n" for row in ordered).encode()
    parameters = list(dict.fromkeys(name for row in ordered for name in row.parameters))
    collected = list(dict.fromkeys(name for row in ordered for name in row.collected))
    plain = [name for name in COLUMNS if name not in ("parameters", "collected")]
    out = io.StringIO(newline="")
    writer = csv.writer(out)
    writer.writerow([*plain, *parameters, *collected])
    for row in ordered:
        values: list[Any] = [getattr(row, name) for name in plain]
        values += [row.parameters.get(name, "") for name in parameters]
        writer.writerow(values + [_cell(row.collected.get(name)) for name in collected])
    return out.getvalue().encode()


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (dict, list)) else value


def journal_path(table: str) -> Path:
    """File beside the table that gets a line when a task ends."""
    return Path(f"{table}.part")


def journal_line(task: Task, row: TaskRow) -> str:
    """Line of the journal: the task's command line and its row."""
    return json.dumps({"words": task.words, "row": asdict(row)}, ensure_ascii=False) + "\n"


def read_journal(path: Path, tasks: Sequence[Task], hashes: Mapping[str, str | None]) -> dict[int, TaskRow]:
    """Rows of tasks that are done, by index; torn lines, changed inputs and missing outputs are left out.

    Parameters
    ----------
    hashes : mapping of input to SHA-256
        As the inputs are now.
    """
    if not path.exists():
        return {}
    by_key = {task.key: task for task in tasks}
    rows = {}
    for line in path.read_text("utf-8").splitlines():
        try:
            entry = json.loads(line)
            task = by_key.get("\0".join(entry["words"]))
            row = TaskRow(**entry["row"])
        except (ValueError, TypeError, KeyError):
            continue
        if task is None or row.status != "done" or hashes.get(row.input) != row.sha256:
            continue
        if task.output is None or Path(task.output).exists():
            row.index = task.index
            rows[task.index] = row
    return rows
