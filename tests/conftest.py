"""Fixtures: where the shared meshes are, and a runner for commands. No maths here."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from time import process_time
from typing import Any

import pytest
from click.testing import CliRunner, Result

from ddgcli.cli import options
from ddgcli.cli.threads import set_thread_variables

set_thread_variables()  # commands that run in this process get what a user's process gets
# processes that tests start use compiled modules, as a user's do; to compile all modules takes half a second
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# a suite that a shell starts with `&` inherits an ignored interrupt, and so would every command it starts
signal.signal(signal.SIGINT, signal.default_int_handler)
ROOT = Path(__file__).parent.parent
SHARED_MESHES = ROOT.parent / "shared" / "meshes"


@pytest.fixture
def shared_meshes() -> Path:
    """Folder of the shared real meshes; skips where it is missing."""
    if not SHARED_MESHES.is_dir():
        pytest.skip("../shared/meshes is missing: real meshes are not tested here")
    return SHARED_MESHES


def _small_pages(size: tuple[int, int] | None, inches: float | None = None) -> dict[str, Any]:
    return page_size(size or (640, 480), inches)


page_size = options.page_size
PAGE_SIZES = (
    "ddgcli.cli.options.page_size",
    "ddgcli.cli.run.page_size",
    "ddgcli.cli.simulation.plot.page_size",
)


@pytest.fixture(scope="session", autouse=True)
def small_pictures():
    """Pictures without `--size` have a fifth of the usual pixels, which takes two seconds less each."""
    with pytest.MonkeyPatch.context() as patch:
        for name in PAGE_SIZES:
            patch.setattr(name, _small_pages)
        yield


@pytest.fixture
def default_pictures(monkeypatch):
    """Pictures without `--size` have their usual size."""
    for name in PAGE_SIZES:
        monkeypatch.setattr(name, page_size)


@pytest.fixture(scope="session", autouse=True)
def rows_run_once():
    """`tradeoff --repeat 1` runs each row once, without measuring memory: a third of the time."""
    from ddgcli.tradeoff import measure

    original = measure.run_problem

    def run_once(problem, *, repeat=5, **options):
        return original(problem, repeat=0 if repeat == 1 else repeat, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "run_problem", run_once)
        yield original


@pytest.fixture
def rows_run_twice(monkeypatch, rows_run_once):
    """`tradeoff --repeat 1` runs and measures each row as a user's does."""
    monkeypatch.setattr("ddgcli.tradeoff.measure.run_problem", rows_run_once)


@pytest.fixture
def processor_clock(monkeypatch):
    """The account of a run counts processor seconds: none of them are of another program."""
    monkeypatch.setattr("ddgcli.simulation.account.perf_counter", process_time)


@pytest.fixture(scope="session")
def run():
    """Run a command in this process: `run("curvature", path, "--json")` -> click Result."""
    from ddgcli.cli.main import main

    def call(*words: Any, **kwargs: Any) -> Result:
        return CliRunner().invoke(main, [str(w) for w in words], prog_name="ddgcli", **kwargs)

    return call


@pytest.fixture(scope="session")
def summary(run):
    """Run a command with --json and return its parsed summary; fails unless it exits 0 (or `code`)."""

    def call(*words: Any, code: int = 0) -> dict[str, Any]:
        result = run(*words, "--json")
        assert result.exit_code == code, result.output + result.stderr
        return json.loads(result.stdout)

    return call
