"""Deliberate one-line faults: each must fail its test, or the tests do not cover that line.

`python -m benchmarks.mutants [NAME ...]` copies the tree to a temporary folder, checks there that the test of
a fault passes, applies the fault, and checks that the test fails. NAME selects faults whose path contains it.
Exit code 1 if a fault survives, if its line no longer exists, or if its test fails without the fault. The
faults are in `benchmarks/mutant_list.py`; `make mutants` runs all of them (some minutes; not in CI).
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutant_list import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("ddgcli", "tests", "benchmarks", "sample_meshes", "sample_scenes", "docs")
FILES = ("pyproject.toml", "Makefile", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "mkdocs.yml")
TEST_SECONDS = 600


@dataclass(frozen=True)
class Outcome:
    """Exit code of pytest (0: all tests pass, 1: a test fails) and the first failed test."""

    exit_code: int
    failed: str


def mutated(source: str, mutant: Mutant) -> str:
    """Source with the fault; ValueError if its line is not there exactly once."""
    count = source.count(mutant.line)
    if count != 1:
        raise ValueError(f"{mutant.path}: {count} occurrences of {mutant.line!r}, expected one")
    return source.replace(mutant.line, mutant.fault)


def copy_tree(target: Path) -> None:
    """Copy what the tests need."""
    ignore = shutil.ignore_patterns("__pycache__", "*.png", ".pytest_cache")
    for name in FOLDERS:
        if (ROOT / name).exists():
            shutil.copytree(ROOT / name, target / name, ignore=ignore)
    for name in FILES:
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, target / name)


@contextmanager
def fault_in(tree: Path, mutant: Mutant) -> Iterator[None]:
    """Apply a fault to a tree inside the block."""
    path = tree / mutant.path
    source = path.read_text(encoding="utf-8")
    path.write_text(mutated(source, mutant), encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(source, encoding="utf-8")


def run_test(tree: Path, test: str) -> Outcome:
    """Run one test, `FILE::NAME`, until its first failure."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--timeout=300", test]
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        result = subprocess.run(
            command,
            cwd=tree,
            env=environment,
            capture_output=True,
            text=True,
            timeout=TEST_SECONDS,
        )
    except subprocess.TimeoutExpired:
        return Outcome(1, "no end within the time limit")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", result.stdout, re.M)
    return Outcome(result.returncode, failed.group(1) if failed else "")


def check(tree: Path, mutant: Mutant, without_fault: dict[str, Outcome]) -> tuple[bool, str]:
    """Whether the test of a fault passes without it and fails with it; and the report."""
    if mutant.test not in without_fault:
        without_fault[mutant.test] = run_test(tree, mutant.test)
    outcome = without_fault[mutant.test]
    if outcome.exit_code != 0:
        return False, f"TEST FAILS WITHOUT THE FAULT {outcome.failed} (pytest exit {outcome.exit_code})"
    try:
        with fault_in(tree, mutant):
            outcome = run_test(tree, mutant.test)
    except ValueError as error:
        return False, f"NO SUCH LINE {error}"
    if outcome.exit_code == 0:
        return False, f"SURVIVES {mutant.test}"
    return outcome.exit_code == 1, f"caught by {outcome.failed or f'pytest exit {outcome.exit_code}'}"


def main() -> int:
    """Check the faults; the number of bad ones decides the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="parts of paths (default: all faults)")
    names = parser.parse_args().names
    mutants = [m for m in MUTANTS if not names or any(name in m.path for name in names)]
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        copy_tree(tree)
        without_fault: dict[str, Outcome] = {}
        for mutant in mutants:
            began = time.monotonic()
            good, report = check(tree, mutant, without_fault)
            bad += not good
            seconds = time.monotonic() - began
            label = f"{'ok ' if good else 'BAD'} {mutant.path}: {mutant.fault[:60]}"
            print(f"{label} | {report} ({seconds:.0f} s)", flush=True)
    print(f"{len(mutants)} faults, {len(mutants) - bad} caught")
    return 1 if bad or not mutants else 0


if __name__ == "__main__":
    sys.exit(main())
