"""Write the tables of benches as pages: `python -m benchmarks.pages NAME [WORDS OF THE BENCH ...]`.

The page docs/benchmarks/NAME.md begins with the question of the bench (its docstring), the command that makes
the page, and the date; the tables follow as the bench prints them.
"""

from __future__ import annotations

import ast
import datetime
import os
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "benchmarks"


def page_text(name: str, words: list[str], output: str, date: str) -> str:
    """Markdown page of a bench from what it printed."""
    source = (ROOT / "benchmarks" / "peers" / f"{name}.py").read_text(encoding="utf-8")
    question = (ast.get_docstring(ast.parse(source)) or "").split("\n")[0]
    command = shlex.join(["python", "-m", "benchmarks.pages", name, *words])
    output = output.replace("\n### ", "\n## ").strip()
    return f"# Benchmark: {name}\n\n{question}\n\nMade on {date} by `{command}`; do not edit.\n\n{output}\n"


def main() -> int:
    """Run a bench and write its page."""
    name, *words = sys.argv[1:]
    command = [sys.executable, "-m", f"benchmarks.peers.{name}", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    result = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
    if result.returncode == 0:
        PAGES.mkdir(exist_ok=True)
        date = datetime.date.today().isoformat()
        (PAGES / f"{name}.md").write_text(page_text(name, words, result.stdout, date), encoding="utf-8")
        print(f"docs/benchmarks/{name}.md")
    return result.returncode


if __name__ == "__main__":
    sys.exit(main())
