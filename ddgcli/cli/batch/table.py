"""Tables of batch results: JSON lines or CSV, and the journal beside them; a batch resumes from both."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from ddgcli.cli.batch.process import TaskRow
from ddgcli.cli.batch.tasks import Task

TABLE_FORMATS = (".jsonl", ".csv")
COLUMNS = tuple(f.name for f in fields(TaskRow))
NUMBER_COLUMNS = ("index", "exit_code", "seconds", "peak_mib")


def table_bytes(path: str, rows: Sequence[TaskRow]) -> bytes:
    """Content of a table of results.

    Parameters
    ----------
    path : str
        Its extension decides: a JSON object per line (.jsonl), else CSV with a column per parameter and
        value.
    rows : sequence of TaskRow

    Returns
    -------
    bytes
    """
    ordered = sorted(rows, key=lambda row: row.index)
    if Path(path).suffix.lower() == ".jsonl":
        return "".join(json.dumps(asdict(row), ensure_ascii=False) + "\n" for row in ordered).encode(
            errors="backslashreplace"
        )
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
    return out.getvalue().encode(errors="backslashreplace")


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (bool, dict, list)) else value


def journal_path(table: str) -> Path:
    """File beside the table that gets a row when a task ends; it is removed when the table is written.

    Parameters
    ----------
    table : str
        Path of the table.

    Returns
    -------
    Path
    """
    return Path(f"{table}.part")


def journal_line(row: TaskRow) -> str:
    """Line of the journal: the row as a JSON object.

    Parameters
    ----------
    row : TaskRow

    Returns
    -------
    str
    """
    return json.dumps(asdict(row), ensure_ascii=False) + "\n"


def completed_rows(
    table: str, tasks: Sequence[Task], hashes: Mapping[str, str | None], collect: Sequence[str]
) -> dict[int, TaskRow]:
    """Rows of tasks that are done, by index, from a table and its journal.

    Left out are torn lines, runs whose input changed, whose output is missing or whose summary was not
    searched for all of `collect`.

    Parameters
    ----------
    table : str
        Path of the table.
    tasks : sequence of Task
    hashes : mapping of input to SHA-256
        As the inputs are now.
    collect : sequence of str
        Dotted names of values of the summaries.

    Returns
    -------
    dict of int to TaskRow
    """
    by_command = {task.command: task for task in tasks}
    journal = journal_path(table)
    rows = {}
    for entry in (*_table_entries(Path(table), collect), *_json_entries(journal)):
        try:
            task = by_command[entry["command"]]
            known = {"index": task.index, "input": task.input, "parameters": task.parameters}
            row = TaskRow(**{**entry, **known})
            row.collected = {name: row.collected[name] for name in collect}
        except (TypeError, KeyError):
            continue
        if row.status != "done" or hashes.get(row.input) != row.sha256:
            continue
        if task.output is None or Path(task.output).exists():
            rows[task.index] = row
    return rows


def _table_entries(path: Path, collect: Sequence[str]) -> list[dict[str, Any]]:
    if path.suffix.lower() == ".jsonl":
        return _json_entries(path)
    if not path.exists():
        return []
    with open(path, encoding="utf-8", errors="replace", newline="") as file:
        lines = list(csv.DictReader(file))
    entries = []
    for line in lines:
        entry: dict[str, Any] = {name: _value(line.get(name) or "") for name in NUMBER_COLUMNS}
        entry |= {name: line.get(name) or None for name in ("input", "command", "output", "status", "sha256")}
        entry["message"] = line.get("message") or ""
        entry["collected"] = {name: _value(line[name] or "") for name in collect if name in line}
        entries.append({**entry, "parameters": {}})
    return entries


def _json_entries(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    entries = []
    for line in path.read_text("utf-8", errors="replace").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        entries += [entry] if isinstance(entry, dict) else []
    return entries


def _value(cell: str) -> Any:
    """The value that is written as this cell."""
    try:
        value = json.loads(cell) if cell else None
    except ValueError:
        return cell
    return value if str(_cell(value)) == cell or not cell else cell
