"""Run the hard-case catalogue: each command in a subprocess, as a user starts it, with limits.

`python -m benchmarks.hardcases.run [--only FAMILY] [--command NAME] [--missing] [--preloaded]`;
`--quick` runs a few cells and stores nothing. Verdicts go to `results.json` after every case;
`--page` only writes docs/hard-cases.md from it.
Exit 1 where a cell is wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import pkgutil
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ddgcli
from benchmarks.hardcases.catalogue import INTERRUPTED, ROOT, Call, Case, catalogue
from benchmarks.hardcases.judge import WRONG_VERDICT, Outcome, Verdict, judge
from benchmarks.hardcases.meshes import truths_of
from benchmarks.hardcases.page import write_page
from benchmarks.hardcases.stored import Results, store, stored_results
from ddgcli.cli import main as program
from ddgcli.io.trajectories.trajectory import Trajectory

CPU_SECONDS = 120  # of a command and its children
WALL_FACTOR = 40  # on a busy machine the clock runs faster than the processor time
PEAK_MIB = 4096


def _limits(cpu_seconds: int, address_space: bool) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_seconds, cpu_seconds + 5))
    if address_space:  # as a user sets it by `ulimit -v`
        resource.setrlimit(resource.RLIMIT_AS, (PEAK_MIB << 20, PEAK_MIB << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def run_process(
    words: list[str],
    folder: Path,
    action: Callable[[], object] | None = None,
    address_space: bool = False,
    cpu_seconds: int | None = None,
) -> Outcome:
    """Run a process within the limits of processor time, clock and memory.

    Parameters
    ----------
    words : list of str
        The command line.
    folder : Path
        Working folder, where the streams are kept.
    action : callable, optional
        Runs in a fork of this process instead of the command line.
    address_space : bool
        Limit the address space to PEAK_MIB too, so that the program can refuse what does not fit.
    cpu_seconds : int, optional
        Processor time; CPU_SECONDS by default.
    """
    cpu_seconds = cpu_seconds or CPU_SECONDS
    limits = partial(_limits, cpu_seconds, address_space)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    began = time.monotonic()
    with open(folder / "stdout", "w+b") as out, open(folder / "stderr", "w+b") as error:
        if action is not None:
            pid = _fork(action, limits, folder, out.fileno(), error.fileno())
        else:
            child = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=out, stderr=error, cwd=folder, env=environment,
                preexec_fn=limits, start_new_session=True,
            )  # fmt: skip
            pid = child.pid
        status, usage = _wait(pid, began + WALL_FACTOR * cpu_seconds)
        code = os.waitstatus_to_exitcode(status)
        if action is None:
            child.returncode = code  # reaped by wait4
        out.seek(0)
        error.seek(0)
        stdout, stderr = (f.read().decode("utf-8", "replace") for f in (out, error))
    seconds, peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    over = "time" if code in (-signal.SIGXCPU, -signal.SIGKILL) else ""
    over = "memory" if peak > PEAK_MIB else over
    return Outcome(code, stdout, stderr, seconds, peak, over)


def preload() -> None:
    """Import every module of the program, late ones too, so that forked runs need not."""
    for module in pkgutil.walk_packages(ddgcli.__path__, "ddgcli."):
        with contextlib.suppress(ImportError):  # of an extra that is not installed
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    program.start_time()  # forked runs begin when they are called, not at this import


def _fork(
    action: Callable[[], object], limits: Callable[[], None], folder: Path, out: int, error: int
) -> int:
    """Run an action in a forked child with these limits and streams; its process number."""
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()
        limits()
        for source, target in ((os.open(os.devnull, os.O_RDONLY), 0), (out, 1), (error, 2)):
            os.dup2(source, target)
        # not those of the parent, which a test may have replaced
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(k, "w", closefd=False)) for k in (1, 2))
        os.chdir(folder)
        action()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _wait(pid: int, deadline: float) -> tuple[int, resource.struct_rusage]:
    """Wait for one child; its process group is killed at the deadline and above the memory limit."""
    while True:
        ended, status, usage = os.wait4(pid, os.WNOHANG)
        if ended:
            return status, usage
        if time.monotonic() > deadline or _resident_mib(pid) > PEAK_MIB:
            os.killpg(pid, signal.SIGKILL)
            _, status, usage = os.wait4(pid, 0)
            return status, usage
        time.sleep(0.02)


def _resident_mib(pid: int) -> float:
    """Resident memory of a process; 0 where the system does not report it."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * resource.getpagesize() / 2**20


def read_arrays(folder: Path) -> dict[str, NDArray]:
    """Arrays of `output.npz` and of the trajectories in a folder, those that were written."""
    arrays: dict[str, NDArray] = {}
    if (folder / "output.npz").is_file():
        with np.load(folder / "output.npz", allow_pickle=False) as stored:
            arrays |= {name: stored[name] for name in stored.files}
    for path in sorted(folder.glob("*.vtkhdf")):
        with Trajectory(str(path)) as run:
            arrays[f"times of {path.stem}"] = np.asarray(run.times)
            for k in range(run.n_frames):
                by_name = {"points": run.points(k), **run.vertex(k)}
                arrays |= {
                    f"{name} {k} of {path.stem}": np.asarray(values) for name, values in by_name.items()
                }
    return arrays


def prepare(case: Case, folder: Path) -> tuple[Path | None, Any, Any, dict[str, Any]]:
    """Input file, points, faces and truths of a case."""
    expected = dict(case.expected)
    if case.build is None:
        return case.path, None, None, expected
    points, faces = case.build()
    path = folder / "input.npz"
    np.savez(path, points=points, faces=faces)
    counted = {k: v for k, v in asdict(truths_of(points, faces)).items() if v is not None}
    return path, points, faces, counted | expected


def run_call(call: Call, path: Path | None, folder: Path, preloaded: bool = False) -> Outcome:
    """Run one call of the program in a folder of its own."""
    places = {"{input}": str(path), "{output}": str(folder / "output.npz")}
    words = [places.get(word, word).replace("{folder}", str(folder)) for word in call]
    if call[0] in ("check", "batch"):  # the summary is that of the outer command
        words.insert(1, "--json")
    else:
        words.append("--json")
    action = partial(program.main, words, prog_name="python -m ddgcli") if preloaded else None
    return run_process([sys.executable, "-m", "ddgcli", *words], folder, action, address_space=True)


def interrupt_call(call: Call, path: Path | None, folder: Path) -> None:
    """Kill one call of a simulator as soon as its part file exists, at any moment of a step."""
    words = [str(path) if word == "{input}" else word.replace("{folder}", str(folder)) for word in call]
    child = subprocess.Popen(
        [sys.executable, "-m", "ddgcli", *words], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    while child.poll() is None and not list(folder.glob("*.vtkhdf.part")):
        time.sleep(0.005)
    child.kill()
    child.wait()


def run_cell(case: Case, command: str, preloaded: bool = False) -> tuple[Verdict, Outcome]:
    """Verdict on one command of one case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, points, faces, expected = prepare(case, folder)
        *preparing, judged = case.calls[command]
        for call in preparing:
            if call[0] == INTERRUPTED:
                interrupt_call(call[1:], path, folder)
                continue
            outcome = run_call(call, path, folder, preloaded)
            if outcome.exit_code:
                return judge("", outcome), outcome
        outcome = run_call(judged, path, folder, preloaded)
        outcome.arrays = read_arrays(folder)
    return judge(command, outcome, points, faces, expected, case.checks), outcome


def cell_record(verdict: Verdict, outcome: Outcome, preloaded: bool = False) -> dict[str, Any]:
    """What the page needs of one cell; paths of the run are left out."""
    note = verdict.note.replace(f"{ROOT}/", "").replace(f"{ROOT.parent}/", "../")
    note = re.sub(rf"{re.escape(tempfile.gettempdir())}/tmp\w+/", "", note)
    return {
        "kind": verdict.kind,
        "preloaded": preloaded,
        "note": note.removeprefix("input.npz: "),
        "seconds": round(outcome.seconds, 1),
        "peak_mib": round(outcome.peak_mib),
    }


def run_catalogue(
    cases: list[Case],
    commands: list[str],
    results: Results,
    missing: bool = False,
    preloaded: bool = False,
) -> None:
    """Run cells into `results`, one line per cell on standard error.

    Parameters
    ----------
    cases : list of Case
        Rows.
    commands : list of str
        Columns; empty for all.
    results : dict
        Changed in place and stored after every case.
    missing : bool
        Run only the cells that no earlier run has filled.
    preloaded : bool
        Fork instead of starting a new Python (see `run_process`).
    """
    for case in cases:
        row = results.setdefault(case.name, {})
        for command in case.calls:
            if (commands and command not in commands) or (missing and command in row):
                continue
            verdict, outcome = run_cell(case, command, preloaded)
            row[command] = cell_record(verdict, outcome, preloaded)
            print(f"{case.name} | {command}: {verdict.kind} {outcome.seconds:.1f} s {verdict.note}",
                  file=sys.stderr, flush=True)  # fmt: skip
        store(results)


def chosen_cases(only: list[str], quick: bool) -> list[Case]:
    """Cases whose family or name contains one of the words."""
    cases = catalogue()
    if only:
        cases = [case for case in cases if any(word in (case.family + " " + case.name) for word in only)]
    return [case for case in cases if case.quick] if quick else cases


def quick_results() -> Results:
    """Verdicts of the short run, not stored."""
    results: Results = {}
    for case in chosen_cases([], quick=True):
        results[case.name] = {name: cell_record(*run_cell(case, name)) for name in case.quick}
    return results


def main(words: list[str]) -> int:
    """Run what the options choose; 1 where a cell is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", default=[], help="family or case; repeatable")
    parser.add_argument("--command", action="append", default=[], help="column; repeatable")
    parser.add_argument("--missing", action="store_true", help="only cells that no run has filled")
    parser.add_argument("--preloaded", action="store_true", help="fork instead of starting a new Python")
    parser.add_argument("--quick", action="store_true", help="a few cells, not stored")
    parser.add_argument("--page", action="store_true", help="only write the page from the stored results")
    options = parser.parse_args(words)
    if options.quick:
        results = quick_results()
    else:
        results = stored_results()
        if not options.page:
            if options.preloaded:
                preload()
            run_catalogue(
                chosen_cases(options.only, False),
                options.command,
                results,
                options.missing,
                options.preloaded,
            )
        write_page(results)
    wrong = [
        (case, name, cell["note"])
        for case, row in results.items()
        for name, cell in row.items()
        if cell["kind"] == WRONG_VERDICT
    ]
    for case, name, note in wrong:
        print(f"wrong: {case} | {name}: {note}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
