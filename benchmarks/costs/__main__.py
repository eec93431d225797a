"""What does each kernel of a command cost? Measures the table that `--dry-run` predicts from.

python -m benchmarks.costs [--only WORD ...]      writes ddgcli/cli/forecast/coefficients.py (half an hour)

Each kernel is one command at two or more sizes, each in a process of its own: CPU seconds of the program and
of the operating system, and peak memory after its input is read (as a dry run states them). The costs of
kernels that stand before it in a command are subtracted; what is left is fitted. The probe of the machine's
speed runs before and after each command, which is repeated: the median of the ratios counts, so that the load
of other processes cancels.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
from pathlib import Path

from benchmarks.common.process import ROOT
from benchmarks.costs.measure import fitted, measured_kernel
from benchmarks.costs.tasks import TASKS
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS, Cost
from ddgcli.cli.forecast.prediction import probe

TABLE = ROOT / "ddgcli" / "cli" / "forecast" / "coefficients.py"


def write_table(table: dict[str, Cost], probe_seconds: float) -> None:
    """Write the table into its module."""
    source = TABLE.read_text(encoding="utf-8")
    head = source[: source.index("PROBE_SECONDS =")]
    lines = [
        f"    {json.dumps(name)}: Cost({', '.join(f'{x:.4g}' for x in cost)}),\n"
        for name, cost in table.items()
    ]
    text = (
        head + f"PROBE_SECONDS = {probe_seconds:.4g}  # of `prediction.probe` where the table was measured\n"
    )
    TABLE.write_text(
        text + "\nCOEFFICIENTS: dict[str, Cost] = {\n" + "".join(lines) + "}\n", encoding="utf-8"
    )


def _matches(name: str, word: str) -> bool:
    return name + "=" == word or name.startswith(word)


def main() -> None:
    """Measure the kernels and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="*", help="kernels whose names begin with one of these; NAME=: only it"
    )
    parser.add_argument("--missing", action="store_true", help="only kernels that the table lacks")
    parser.add_argument("--folder", help="keep the inputs here")
    arguments = parser.parse_args()
    table = dict(COEFFICIENTS)
    probe_seconds = statistics.median(probe() for _ in range(5))
    keep_others = arguments.only or arguments.missing  # they stay in the seconds of the earlier run
    if keep_others:
        probe_seconds = PROBE_SECONDS
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.folder or temporary)
        for task in TASKS:
            name = f"{task.kernel} {task.suffix}".strip()
            if arguments.only and not any(_matches(name, word) for word in arguments.only):
                continue
            if arguments.missing and name in table:
                continue
            os.environ["DDGCLI_SOLVER"] = task.solver
            rows = measured_kernel(task, folder, table, probe_seconds)
            table[name] = fitted(rows, task.exponent, task.kernel)
            print(
                name, table[name], [(round(n * 1e5), round(s, 3), round(m)) for n, s, m in rows], flush=True
            )
            write_table(table, probe_seconds)


if __name__ == "__main__":
    main()
