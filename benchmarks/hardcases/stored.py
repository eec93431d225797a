"""Verdicts of earlier runs: results.json of the program, peer_results.json of the peers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results.json"
PEER_RESULTS = Path(__file__).parent / "peer_results.json"

Results = dict[str, dict[str, dict[str, Any]]]


def stored_results(path: Path = RESULTS) -> Results:
    """Verdicts of earlier runs."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def store(results: Results, path: Path = RESULTS) -> None:
    """Write all verdicts, the old file kept until the new one is whole."""
    whole = path.with_suffix(".part")
    whole.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    whole.replace(path)
