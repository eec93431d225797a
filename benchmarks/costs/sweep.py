"""How near are the predictions of --dry-run to the seconds and the memory of random calls?

python -m benchmarks.costs.sweep [COUNT] [--meshes FOLDER] [--seed N] [--rows FILE]

Calls of every command on generated meshes, the samples and the meshes of a folder: CPU seconds of the program
and of the operating system, and peak memory, predicted over measured. A call outside of 0.5 to 1.5 runs twice
more, and the median counts. Calls that compute for less than 0.3 s have no ratio of seconds. With --rows,
those of an earlier run count too; they are predicted again.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import statistics
import sys
import tempfile
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.common.measure import print_table
from benchmarks.common.process import measured_command
from benchmarks.costs.calls import meshes, random_call

LOW, HIGH = 0.5, 1.5
MIN_SECONDS = 0.3  # that a run computes after it has read its input
MAX_SECONDS, MAX_MIB = 60.0, 6000.0  # predicted, of a call that runs
FILE = re.compile(r"[\w.-]*[A-Za-z][\w.-]*\.(npz|obj|ply|vtu|vtp|vtkhdf|png|html)|out")
Row = dict[str, Any]


def predicted(words: list[str], folder: Path) -> Row | None:
    """Prediction of a call; None where it is refused."""
    dry = measured_command([*words, "--dry-run", "--json"], folder)
    if dry.exit_code:
        return None
    facts = dry.summary["results"]
    return {
        "predicted_seconds": facts["seconds"], "range": facts["seconds_range"],
        "predicted_mib": facts["peak_mib"], "read_seconds": facts["read_seconds"],
        "assumes": "; ".join(row["assumes"] for row in facts["kernels"] if "assumes" in row),
    }  # fmt: skip


def with_ratios(row: Row) -> Row:
    """A row with predicted over measured seconds and MiB."""
    return row | {
        "ratio": row["predicted_seconds"] / row["seconds"],
        "mib_ratio": row["predicted_mib"] / row["mib"],
    }


def measured(words: list[str], folder: Path) -> Row | None:
    """Prediction and measurement of a call; None where it is refused, fails or is long."""
    row = predicted(words, folder)
    if row is None or row["predicted_seconds"] > MAX_SECONDS or row["predicted_mib"] > MAX_MIB:
        return None
    run = measured_command(words, folder)
    if run.exit_code:
        return None
    return with_ratios({**row, "seconds": run.seconds + run.system_seconds, "mib": run.mib})


def is_timed(row: Row) -> bool:
    """Whether a run computes long enough for a ratio of its seconds."""
    return row["seconds"] - row["read_seconds"] > MIN_SECONDS


def is_outside(row: Row) -> bool:
    """Whether the seconds or the memory of a call are not predicted within a half."""
    return (is_timed(row) and not LOW <= row["ratio"] <= HIGH) or not LOW <= row["mib_ratio"] <= HIGH


def repeated(words: list[str], folder: Path) -> Row | None:
    """A call, and three times where it is outside: the one with the median of the ratios."""
    row = measured(words, folder)
    if row is None or not is_outside(row):
        return row
    rows = [row, *filter(None, (measured(words, folder) for _ in range(2)))]
    return sorted(rows, key=lambda row: row["ratio"])[len(rows) // 2]


def sweep(count: int, seed: int, folder: Path, further: Path | None, rows_file: Path | None) -> list[Row]:
    """Rows of `count` calls that ran."""
    rng, rows = Random(seed), _earlier(rows_file, folder)
    every = meshes(folder, further) if len(rows) < count else []
    calls = {row["call"] for row in rows}
    while len(rows) < count:
        _, words = random_call(rng, every, folder / "out")
        call = shlex.join(words).replace(f"{folder}/", "")
        if call in calls:
            continue
        calls.add(call)
        row = repeated(words, folder)
        if row is None:
            continue
        rows.append({"call": call, "command": words[0], **row})
        print(f"{row['ratio']:.2f} {row['mib_ratio']:.2f} {call}", file=sys.stderr, flush=True)
        if rows_file:
            with rows_file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(rows[-1]) + "\n")
    return rows


def _earlier(rows_file: Path | None, folder: Path) -> list[Row]:
    """Rows of a file, with predictions of this version."""
    if rows_file is None or not rows_file.exists():
        return []
    rows = [json.loads(line) for line in rows_file.read_text(encoding="utf-8").splitlines()]
    rows = list({row["call"]: row for row in rows}.values())  # the last one of each call
    again = [predicted(_in_folder(row["call"], folder), folder) for row in rows]
    return [with_ratios({**row, **new}) for row, new in zip(rows, again) if new is not None]


def _in_folder(call: str, folder: Path) -> list[str]:
    """Words of a call, with the files that it names in a folder."""
    return [str(folder / word) if FILE.fullmatch(word) else word for word in shlex.split(call)]


def _quantiles(values: list[float]) -> list[str]:
    if not values:
        return ["-", "-", "-"]
    ordered = sorted(values)
    ends = [ordered[round(q * (len(ordered) - 1))] for q in (0.05, 0.95)]
    return [f"{x:.2f}" for x in (statistics.median(ordered), *ends)]


def print_rows(rows: list[Row]) -> None:
    """Table by command, and the calls outside."""
    table = []
    for command in [*sorted({row["command"] for row in rows}), "all"]:
        own = [row for row in rows if command in (row["command"], "all")]
        timed = [row["ratio"] for row in own if is_timed(row)]
        mib = [row["mib_ratio"] for row in own]
        outside = [sum(not LOW <= x <= HIGH for x in values) for values in (timed, mib)]
        table.append(
            [command, len(own), len(timed), *_quantiles(timed), outside[0], *_quantiles(mib), outside[1]]
        )
    names = ["calls", "timed", "median s", "5 %", "95 %", "outside", "median MiB", "5 %", "95 %", "outside"]
    print_table("Predicted over measured", ["command", *names], table)
    outside_rows = [
        [row["call"], f"{row['ratio']:.2f}", f"{row['mib_ratio']:.2f}", f"{row['seconds']:.2f}",
         f"{row['range'][0]:.2g} to {row['range'][1]:.2g}" if row["assumes"] else "-"]
        for row in rows if is_outside(row)
    ]  # fmt: skip
    print_table(
        "Calls outside of 0.5 to 1.5", ["call", "s", "MiB", "measured s", "predicted range"], outside_rows
    )


def main() -> None:
    """Measure random calls and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--meshes", type=Path, help="a folder of further meshes")
    parser.add_argument("--folder", type=Path, help="keep the inputs here")
    parser.add_argument("--rows", type=Path, help="append every row to this file")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        print_rows(sweep(arguments.count, arguments.seed, folder, arguments.meshes, arguments.rows))


if __name__ == "__main__":
    main()
