"""`ddgcli check`."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import MeshFileError, OutputError, ParameterError, excerpt


@click.command("check", short_help="Compare a run's summary with a stored one (regression runs).")
@click.argument("expected_path", metavar="EXPECTED.json", type=click.Path())
@click.argument("words", metavar="-- COMMAND ...", nargs=-1, type=click.UNPROCESSED)
@click.option("--rtol", type=options.NONNEGATIVE, help="Relative tolerance.  [default: 1e-6]")
@click.option("--atol", type=options.NONNEGATIVE, help="Absolute tolerance.  [default: 1e-12]")
@click.option(
    "--ignore", multiple=True, metavar="KEY", help="Leave out a dotted name; * matches. Repeatable."
)
@click.option("--update", is_flag=True, help="Store the run's summary in EXPECTED.json.")
@options.common
def command(
    expected_path: str, words: tuple[str, ...], common: CommonOptions, update: bool, **tolerances: Any
) -> None:
    """Run COMMAND and compare its summary with the one in EXPECTED.json.

    --update writes EXPECTED.json; the plain output of COMMAND --json works too. A number may change by
    atol + rtol |expected|; under `accuracy` atol is at least 1e-9, because smaller residuals are rounding.
    Everything else must be equal. Seconds, versions and file names are not compared. The file may contain
    its own tolerances, which options override:

    \b
      "tolerances": {"rtol": 1e-6, "atol": 0, "ignore": ["results.steps"],
                     "keys": {"results.area": {"rtol": 1e-9}}}

    Exit code: 0 nothing changed, 1 values changed (each is listed), 2 the call or the input is wrong.

    \b
    Examples:
      ddgcli check torus.json --update -- curvature torus.ply
      ddgcli check torus.json -- curvature torus.ply
      ddgcli check torus.json                         the command that --update stored
    """
    run = Run("check", common, formats=(".json",), update=update, **tolerances)
    if update and Path(expected_path).suffix.lower() != ".json":
        raise OutputError(f"{expected_path}: a summary is stored as JSON; use a name that ends in .json")
    stored = read_expected(expected_path, may_miss=update)
    run.set_input(expected_path, hashlib.sha256(json.dumps(stored).encode()).hexdigest())
    words = tuple(words) or tuple(stored.get("run", ()))
    summary, exit_code = summary_of(words)
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare

    chosen = {**stored.get("tolerances", {}), **{k: v for k, v in tolerances.items() if v}}
    if update:
        stored_tolerances = {"tolerances": stored["tolerances"]} if "tolerances" in stored else {}
        text = json.dumps(
            {"run": list(words), **stored_tolerances, "summary": summary}, indent=1, ensure_ascii=False
        )
        run.write_bytes(expected_path, text.encode() + b"\n", in_place=True)
        run.finish({"run": list(words), "run_exit_code": exit_code, "stored": True}, {})
        return
    try:
        moved, compared = compare(stored["summary"], summary, Tolerances(**chosen))
    except RecursionError:
        raise MeshFileError(f"{expected_path}: nested too deeply; store it anew with --update") from None
    for path in common.outputs:
        run.write_bytes(path, json.dumps(summary, indent=1, ensure_ascii=False).encode() + b"\n")
    results = {"run": list(words), "run_exit_code": exit_code, "compared": compared, "moved": moved}
    run.finish(results, {}, converged=not moved)


def read_expected(path: str, *, may_miss: bool) -> dict[str, Any]:
    """The stored file as {summary, run, tolerances}; accepts a plain summary too."""
    try:
        stored = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        if may_miss:
            return {}
        raise MeshFileError(f"{path}: no such file; --update writes it") from None
    except (OSError, ValueError, RecursionError) as error:
        raise MeshFileError(
            f"{path}: no stored summary (not JSON: {excerpt(error)}); name the .json that --update wrote"
        ) from None
    if not isinstance(stored, dict) or not ("summary" in stored or "results" in stored):
        raise MeshFileError(f"{path}: holds no summary; store one with --update or COMMAND --json")
    if "summary" not in stored:
        stored = {"summary": stored, "tolerances": stored.get("tolerances", {})}
    problem = _problem(stored)
    if problem:
        raise MeshFileError(f"{path}: {problem}; store it anew with --update")
    return stored


def _problem(stored: dict[str, Any]) -> str | None:
    """The first error in a stored file; None if it is valid."""
    if not isinstance(stored["summary"], dict):
        return "'summary' is not a table"
    run = stored.get("run", [])
    if not isinstance(run, list) or not all(isinstance(word, str) and "\0" not in word for word in run):
        return "'run' is not a list of words"
    tolerances = stored.get("tolerances", {})
    if not isinstance(tolerances, dict):
        return "'tolerances' is not a table"
    for name, value in tolerances.items():
        if name not in TOLERANCES:
            return f"unknown tolerance '{excerpt(name, 40)}' (known: {', '.join(TOLERANCES)})"
        if not TOLERANCES[name](value):
            return f"tolerance '{name}' is {excerpt(json.dumps(value), 40)}"
    return None


def _is_tolerance(value: Any) -> bool:
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value <= sys.float_info.max
    )


def _is_table_of_tolerances(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(stated, dict)
        and set(stated) <= {"rtol", "atol"}
        and all(_is_tolerance(v) for v in stated.values())
        for stated in value.values()
    )


def _is_list_of_names(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)


# keys of `tolerances` in a stored file, and the test of their values
TOLERANCES = {
    "rtol": _is_tolerance, "atol": _is_tolerance, "accuracy_atol": _is_tolerance,
    "keys": _is_table_of_tolerances, "ignore": _is_list_of_names,
}  # fmt: skip


def summary_of(words: tuple[str, ...]) -> tuple[dict[str, Any], int]:
    """Run a command in a separate process; its summary and exit code."""
    words = words[1:] if words[:1] == ("ddgcli",) else words
    if not words:
        raise ParameterError(
            "no command to run; write it after --: ddgcli check EXPECTED.json -- curvature a.ply"
        )
    if next((word for word in words if not word.startswith("-")), "") == "check":
        raise ParameterError("check cannot run itself, which would never end; write another command after --")
    call = [sys.executable, "-m", "ddgcli", *words, *([] if "--json" in words else ["--json"])]
    try:
        done = subprocess.run(call, capture_output=True, encoding="utf-8", errors="replace")
    except (OSError, ValueError) as error:
        raise ParameterError(f"the command cannot be run ({excerpt(error)}); correct its words") from error
    try:
        summary = json.loads(done.stdout) if done.returncode in (0, 1) else None
    except (ValueError, RecursionError):
        summary = None
    if not isinstance(summary, dict):
        last = (done.stderr.strip().splitlines() or ["no summary"])[-1]
        raise ParameterError(
            f"the command ended with exit code {done.returncode}: {last.removeprefix('Error: ')}"
        )
    return summary, done.returncode
