"""`ddgcli check`."""

from __future__ import annotations

import hashlib
import json
import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.forecast.check_cost import dry_run_of
from ddgcli.cli.forecast.use import InputSize
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import MeshFileError, OutputError, ParameterError, excerpt
from ddgcli.waiting import captured_run

if TYPE_CHECKING:
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances

log = logging.getLogger("ddgcli")


class KeyTolerance(click.ParamType):
    """KEY=RTOL or KEY=RTOL,ATOL."""

    name = "key=rtol"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, dict[str, float]]:
        if isinstance(value, tuple):
            return value
        key, equals, numbers = str(value).partition("=")
        numerals = numbers.split(",")
        if not key or not equals or len(numerals) > 2:
            self.fail(f"{value!r} is not KEY=RTOL or KEY=RTOL,ATOL, such as arrays.height=1e-4", param, ctx)
        converted = [options.NONNEGATIVE_NUMBER.convert(numeral, param, ctx) for numeral in numerals]
        return key, dict(zip(("rtol", "atol"), converted, strict=False))


@click.command("check", short_help="Compare a run's summary with a stored one (regression runs).")
@click.argument("expected_path", metavar="[EXPECTED.json]", required=False, type=click.Path(readable=False))
@click.argument("words", metavar="-- COMMAND ...", nargs=-1, type=click.UNPROCESSED)
@click.option(
    "--arrays",
    nargs=2,
    metavar="EXPECTED_MESH ACTUAL_MESH",
    help="Also compare points, cells and arrays of two files; -o DIFF.vtu writes where they differ.",
)
@click.option(
    "--tolerance",
    "stated",
    multiple=True,
    type=KeyTolerance(),
    metavar="KEY=RTOL[,ATOL]",
    help="Tolerances of a dotted name, such as arrays.mean_curvature; * matches. Repeatable.",
)
@click.option("--rtol", type=options.NONNEGATIVE_NUMBER, help="Relative tolerance.  [default: 1e-6]")
@click.option("--atol", type=options.NONNEGATIVE_NUMBER, help="Absolute tolerance.  [default: 1e-12]")
@click.option(
    "--ignore", multiple=True, metavar="KEY", help="Leave out a dotted name; * matches. Repeatable."
)
@click.option("--update", is_flag=True, help="Store the run's summary in EXPECTED.json.")
@options.common_without_pictures
def command(
    expected_path: str | None,
    words: tuple[str, ...],
    arrays: tuple[str, str] | None,
    stated: tuple[tuple[str, dict[str, float]], ...],
    common: CommonOptions,
    update: bool,
    **tolerances: Any,
) -> None:
    """Run COMMAND and compare its summary with the one in EXPECTED.json, and its arrays with a stored mesh.

    --update writes EXPECTED.json; the output of COMMAND --json works too. A number may change by
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
      ddgcli check torus.json --arrays stored.vtu new.vtu -- curvature torus.ply -o new.vtu
      ddgcli check --arrays stored.vtu new.vtu --tolerance arrays.mean_curvature=1e-4 -o difference.vtu
    """
    from ddgcli.io.mesh_file import WRITERS

    run = Run("check", common, formats=(".json", *WRITERS), arrays=arrays, update=update, **tolerances)
    tolerance_options = {name: value for name, value in tolerances.items() if value not in (None, ())}
    diff_paths = [path for path in common.outputs if Path(path).suffix.lower() != ".json"]
    if arrays is None and (expected_path is None or diff_paths):
        need = (
            "-o PATH is for the differences of --arrays" if diff_paths else "name EXPECTED.json, or --arrays"
        )
        raise ParameterError(f"{need}; see ddgcli check --help")
    compares = {**tolerance_options, "arrays": arrays, "tolerance": stated}
    if update and (name := next((name for name in compares if compares[name] not in (None, ())), None)):
        raise ParameterError(
            "is for comparisons, and `update` stores; leave one of them out (EXPECTED.json may contain "
            "tolerances)", parameter=name,
        )  # fmt: skip
    if expected_path is None:
        if words or update:
            raise ParameterError("the command needs EXPECTED.json to compare its summary with; name it first")
        compare_two_files(run, arrays, {**tolerance_options, "keys": dict(stated)}, diff_paths)
    else:
        tolerance_options["keys"] = dict(stated)
        compare_with_stored(run, expected_path, words, arrays, tolerance_options, diff_paths, update=update)


def compare_with_stored(
    run: Run,
    expected_path: str,
    words: tuple[str, ...],
    arrays: tuple[str, str] | None,
    tolerance_options: dict[str, Any],
    diff_paths: list[str],
    *,
    update: bool,
) -> None:
    """Run a command, and compare its summary with the stored one or store it, as the whole run."""
    if update and Path(expected_path).suffix.lower() != ".json":
        raise OutputError(f"{expected_path}: a summary is stored as JSON; use a name that ends in .json")
    stored = read_expected(expected_path, may_miss=update)
    run.set_input(expected_path, hashlib.sha256(json.dumps(stored).encode()).hexdigest())
    words = tuple(words) or tuple(stored.get("run", ()))
    if run.common.dry_run:
        run.end_dry_run(dry_run_of(words[1:] if words[:1] == ("ddgcli",) else words))
    summary, exit_code = summary_of(words)
    if update:
        store(run, expected_path, words, stored, summary)
        run.finish({"run": list(words), "run_exit_code": exit_code, "stored": True}, {})
        return
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare, flat

    own = stored.get("tolerances", {})
    keys = {**own.get("keys", {}), **tolerance_options["keys"]}
    tolerance_options = {**own, **tolerance_options, "keys": keys}
    try:
        limits = Tolerances(**tolerance_options)
        moved, compared = compare(stored["summary"], summary, limits)
    except RecursionError:
        raise MeshFileError(f"{expected_path}: nested too deeply; store it again with --update") from None
    for path in set(run.common.outputs) - set(diff_paths):
        run.write_bytes(path, json_bytes(summary))
    names = [name for name, _ in (*flat(stored["summary"]), *flat(summary))]
    if arrays is not None:
        further, of_arrays = compare_files(run, arrays, tolerance_options, diff_paths)
        moved, compared = [*moved, *further["moved"]], compared + further["compared"]
        names += of_arrays
    warn_of_unmatched(limits, names)
    if not compared:  # such a check would pass whatever the run does
        raise ParameterError("leaves out every value, so that nothing is compared", parameter="ignore")
    results = {"run": list(words), "run_exit_code": exit_code, "compared": compared, "moved": moved}
    run.finish(results, {}, converged=not moved)


def store(
    run: Run, path: str, words: tuple[str, ...], stored: dict[str, Any], summary: dict[str, Any]
) -> None:
    """Write the command and its summary to EXPECTED.json, which keeps its tolerances."""
    tolerances = {"tolerances": stored["tolerances"]} if "tolerances" in stored else {}
    content = {"run": list(words), **tolerances, "summary": summary}
    run.write_bytes(path, json_bytes(content), in_place=True)


def json_bytes(content: dict[str, Any]) -> bytes:
    """A file of JSON, with the characters that have no bytes escaped."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    return text.encode(errors="backslashreplace") + b"\n"


def compare_two_files(
    run: Run, paths: tuple[str, str] | None, tolerances: dict[str, Any], diff_paths: list[str]
) -> None:
    """Compare the arrays of two mesh files without a command, as the whole run."""
    run.set_input((paths or ("",))[0], "")
    run.predict(InputSize("surface", 0))
    run.begin()
    results, names = compare_files(run, paths, tolerances, diff_paths)
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances

    warn_of_unmatched(Tolerances(**tolerances), names)
    run.finish(results, {}, converged=not results["moved"])


def compare_files(
    run: Run, paths: tuple[str, str] | None, tolerances: dict[str, Any], diff_paths: list[str]
) -> tuple[dict[str, Any], list[str]]:
    """Compare the arrays of two mesh files, and write the differences on the expected mesh.

    Results for the summary, and the dotted names of what the files contain.
    """
    from ddgcli.algorithms.inspection.compare_arrays import compare_arrays
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances
    from ddgcli.io.mesh_file import read_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    meshes = []
    for path in paths or ():
        run.add_input(path)
        with run.clock.timed("read"):
            source = read_mesh(path)
        meshes.append(AnnotatedMesh(source.mesh, source.vertex, source.face, source.edge, source.whole))
    expected, actual = meshes
    comparison = compare_arrays(expected, actual, Tolerances(**tolerances))
    if diff_paths and not comparison.difference:
        log.warning("the two meshes have other cells: no difference is written")
        diff_paths = []
    for path in diff_paths:
        difference = AnnotatedMesh(
            expected.mesh, vertex=comparison.difference["vertex"], face=comparison.difference["face"]
        )
        run.write_file(path, difference, converged=not comparison.moved)
    groups = [group for mesh in meshes for group in (mesh.vertex, mesh.face, mesh.edge, mesh.whole)]
    names = ["points", "cells", *(f"arrays.{name}" for group in groups for name in group)]
    return {"compared": comparison.compared, "moved": comparison.moved}, names


def warn_of_unmatched(limits: Tolerances, names: list[str]) -> None:
    """Warn of stated tolerances that are of no compared value, such as of a name with a typing error."""
    if unmatched := limits.unmatched(names):
        log.warning(f"tolerances of {', '.join(unmatched)}: no value has such a name; see the keys of --json")


def read_expected(path: str, *, may_miss: bool) -> dict[str, Any]:
    """The stored file as {summary, run, tolerances}; accepts a plain summary too."""
    try:
        stored = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        if may_miss:
            return {}
        raise MeshFileError(f"{path}: no such file; --update writes it") from None
    except IsADirectoryError:
        raise MeshFileError(f"{path}: is a folder; name the .json that --update wrote") from None
    except (ValueError, RecursionError) as error:
        raise MeshFileError(
            f"{path}: no stored summary (not JSON: {excerpt(error)}); name the .json that --update wrote"
        ) from None
    if not isinstance(stored, dict) or not ("summary" in stored or "results" in stored):
        raise MeshFileError(f"{path}: holds no summary; store one with --update or COMMAND --json")
    if "summary" not in stored:
        stored = {"summary": stored, "tolerances": stored.get("tolerances", {})}
    problem = _problem(stored)
    if problem:
        raise MeshFileError(f"{path}: {problem}; store it again with --update")
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
        process = captured_run(call)
    except (OSError, ValueError) as error:
        raise ParameterError(f"the command cannot be run ({excerpt(error)}); correct its words") from error
    try:
        summary = json.loads(process.stdout) if process.returncode in (0, 1) else None
    except (ValueError, RecursionError):
        summary = None
    if not isinstance(summary, dict):
        last = (process.stderr.strip().splitlines() or ["no summary"])[-1]
        raise ParameterError(
            f"the command ended with exit code {process.returncode}: {last.removeprefix('Error: ')}"
        )
    return summary, process.returncode
