"""What fuzzing has tried so far, run by run: `ledger.json`, shown on docs/hard-cases.md."""

from __future__ import annotations

import fcntl
import json
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.fuzz.run import Account

LEDGER = Path(__file__).parent / "ledger.json"
LOCK = Path(tempfile.gettempdir()) / "ddgcli-fuzz-ledger.lock"


def ledger() -> dict[str, dict[str, Any]]:
    """Runs, inputs (`guided` of them by coverage), results, lines, seconds and slowest.

    `seconds_without_escape` are those of the runs since the last one with an escape.
    """
    return json.loads(LEDGER.read_text(encoding="utf-8")) if LEDGER.is_file() else {}


def next_seed(name: str) -> int:
    """A seed that no stored run of a kind had: runs are numbered from 1."""
    return ledger().get(name, {}).get("runs", 0) + 1


def add_to_ledger(name: str, account: Account, guided: bool = False) -> None:
    """Add the counts of one run of a kind; `guided` by the lines that inputs reach.

    Runs that end at the same time wait for each other.
    """
    with LOCK.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _add(name, account, guided)


def _add(name: str, account: Account, guided: bool) -> None:
    every = ledger()
    row = every.setdefault(name, {})
    counts = {"runs": 1, "inputs": account.inputs, "accepted": account.accepted, "refused": account.refused}
    counts["escapes"] = account.inputs - account.accepted - account.refused
    if guided:
        counts["guided"] = account.inputs
    for key, value in counts.items():
        row[key] = row.get(key, 0) + value
    row["cpu_seconds"] = round(row.get("cpu_seconds", 0.0) + account.cpu_seconds, 1)
    earlier = row.get("seconds_without_escape", 0.0)
    row["seconds_without_escape"] = 0.0 if counts["escapes"] else round(earlier + account.cpu_seconds, 1)
    row["slowest"] = max(row.get("slowest", 0.0), round(account.slowest, 2))
    for key in ("lines_of_seeds", "lines"):  # of the latest run that counted them: they belong to its code
        if getattr(account, key):
            row[key] = getattr(account, key)
    whole = LEDGER.with_suffix(".part")
    whole.write_text(json.dumps(every, indent=1) + "\n", encoding="utf-8")
    whole.replace(LEDGER)
