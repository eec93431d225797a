"""Generated pages of benches: `python -m benchmarks.pages NAME [WORDS OF THE BENCH ...]`.

NAME is a bench of `benchmarks/peers`, or PACKAGE.NAME. What the bench prints is stored, with its words, the
date and the processor, in benchmarks/results/NAME.json; the page docs/benchmarks/NAME.md follows from that
file alone: the question of the bench (first line of its docstring), the command that repeats it, and its
tables. Without NAME, all pages are rewritten from the stored results. A test compares pages and results.
"""

from __future__ import annotations

import ast
import datetime
import json
import os
import platform
import re
import shlex
import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "benchmarks"
RESULTS = ROOT / "benchmarks" / "results"


@dataclass(frozen=True)
class BenchResult:
    """What a bench printed, and the words, the day and the processor of its run."""

    name: str
    words: list[str]
    date: str
    output: str
    processor: str = ""  # "" of results older than this field

    @property
    def module(self) -> str:
        """Module of the bench."""
        return f"benchmarks.{self.name}" if "." in self.name else f"benchmarks.peers.{self.name}"

    def page(self) -> str:
        """Markdown page."""
        source = (ROOT / (self.module.replace(".", "/") + ".py")).read_text(encoding="utf-8")
        question = (ast.get_docstring(ast.parse(source)) or "").split("\n")[0]
        command = shlex.join(["python", "-m", "benchmarks.pages", self.name, *self.words])
        tables = self.output.replace("\n### ", "\n## ").strip()
        machine = f" with {self.processor}" if self.processor else ""
        return (
            f"# Benchmark: {self.name}\n\n{question}\n\n"
            f"Made on {self.date}{machine} by `{command}`; do not edit.\n\n"
            f"{tables}\n"
        )


def stored() -> list[BenchResult]:
    """Results in `benchmarks/results`."""
    paths = sorted(RESULTS.glob("*.json"))
    return [BenchResult(**json.loads(path.read_text(encoding="utf-8"))) for path in paths]


def processor() -> str:
    """Name of the processor and its widest vector instructions."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    values = dict(line.split(":", 1) for line in lines if ":" in line)
    entries = {key.strip(): value.strip() for key, value in values.items()}
    name = re.sub(r"\((R|TM)\)|\bProcessor\b", "", entries.get("model name", platform.processor()))
    widest = next((word for word in ("avx512f", "avx2") if word in entries.get("flags", "").split()), "")
    return " ".join([*name.split(), *([f"({widest})"] if widest else [])])


def run_bench(name: str, words: list[str]) -> BenchResult | None:
    """Run a bench; None if it fails."""
    result = BenchResult(name, words, datetime.date.today().isoformat(), "", processor())
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", result.module, *words]
    process = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
    return replace(result, output=process.stdout) if process.returncode == 0 else None


def write_page(result: BenchResult) -> Path:
    """Write the page of a result."""
    path = PAGES / f"{result.name}.md"
    path.write_text(result.page(), encoding="utf-8")
    return path


def main() -> int:
    """Run a bench, store its result and write its page; or write all pages."""
    if len(sys.argv) == 1:
        for result in stored():
            print(write_page(result).relative_to(ROOT))
        return 0
    result = run_bench(sys.argv[1], sys.argv[2:])
    if result is None:
        return 1
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(asdict(result), indent=1)
    (RESULTS / f"{result.name}.json").write_text(text + "\n", encoding="utf-8")
    print(write_page(result).relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
