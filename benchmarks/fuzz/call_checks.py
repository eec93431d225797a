"""Run a random call in this process and check all that it leaves behind."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from benchmarks.fuzz.call_dry_runs import disagreement, has_dry_run
from benchmarks.fuzz.call_meshes import SURFACE, mesh_arrays, mesh_file
from benchmarks.fuzz.call_options import with_few_steps
from benchmarks.fuzz.call_remedies import place_of, remedies
from benchmarks.fuzz.call_resume import resume_fault
from benchmarks.fuzz.scratch import scratch_folder
from benchmarks.hardcases.checks import (
    CHECKS,
    Evidence,
    check_box_does_not_grow,
    check_willmore,
)
from benchmarks.hardcases.judge import ABSENT_AS_NAN, INFINITE_ARRAYS
from benchmarks.hardcases.meshes import truths_of
from ddgcli.cli.main import main as command_line
from ddgcli.cli.main import start_time
from ddgcli.errors import DdgError

MAX_REMEDIES = 4
MAX_LENGTH = 600  # characters of an error, beside the paths
CALL_SECONDS = 20.0  # of processor time, for one call on a mesh of at most some hundred cells
PICTURE_SECONDS, STEP_SECONDS = 1.5, 1e-3  # of one of many; lines are counted meanwhile
ROUNDING = 1e-7  # of the largest distance, for needles too


class CallError(Exception):
    """A fault of the program: the call, and what is wrong."""


@dataclass(frozen=True)
class CallOutcome:
    """Words, exit code, streams, new files and processor seconds of one call."""

    words: list[str]
    exit_code: int
    stdout: str = ""
    stderr: str = ""
    new_files: list[str] = field(default_factory=list)
    seconds: float = 0.0
    exception: BaseException | None = None
    stdout_bytes: bytes = b""

    @property
    def line(self) -> str:
        """The call as a line for a shell."""
        return shlex.join(self.words)

    @property
    def error(self) -> str:
        """The line of the error, without its beginning."""
        lines = [line for line in self.stderr.splitlines() if line.startswith("Error: ")]
        return lines[0].removeprefix("Error: ") if lines else ""

    @property
    def summary(self) -> dict[str, Any] | None:
        """The summary of --json; None without one."""
        if "--json" not in self.words or self.is_listing or not self.stdout.strip():
            return None
        return json.loads(self.stdout, parse_constant=_reject)

    @property
    def is_listing(self) -> bool:
        """Whether standard output has a list of effects, a schema or a mesh in place of a summary."""
        return not {"--effects", "--schema"}.isdisjoint(self.words) or writes_to_stdout(self.words)


def writes_to_stdout(words: list[str]) -> bool:
    """Whether a call has `-o -`, which excludes --json."""
    return ("-o", "-") in zip(words, words[1:], strict=False)


def call_outcome(words: list[str], folder: Path, stdin: bytes | None = None) -> CallOutcome:
    """Run a call in this process, in this folder."""
    before, start = _file_stamps(folder), time.process_time()
    result = CliRunner().invoke(command_line, words, input=stdin)
    seconds = time.process_time() - start
    files = sorted(name for name, stamp in _file_stamps(folder).items() if before.get(name) != stamp)
    return CallOutcome(
        words,
        result.exit_code,
        result.stdout,
        result.stderr,
        files,
        seconds,
        result.exception,
        result.stdout_bytes,
    )


def _file_stamps(folder: Path) -> dict[str, tuple[int, int]]:
    """Time and number of every file, which change where a file is written again."""
    return {str(p.relative_to(folder)): (p.stat().st_mtime_ns, p.stat().st_ino)
            for p in folder.rglob("*") if p.is_file()}  # fmt: skip


def _reject(name: str) -> None:
    raise ValueError(f"{name} in the summary")


def read_call() -> Callable[[bytes], object]:
    """Runs calls; a refusal becomes DdgError, a fault CallError."""
    folder = scratch_folder() / "call"
    start_time()  # budgets of calls begin when they are made, not at the import of the program

    def read(data: bytes) -> object:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        with contextlib.chdir(folder):
            return run_call(json.loads(data), folder)

    return read


def run_call(call: dict[str, Any], folder: Path) -> CallOutcome:
    """Run the preparing calls and the tested one, apply the remedies of errors, and check every outcome."""
    mesh, name = call["mesh"], f"mesh{call['mesh']['suffix']}"
    content = mesh_file(mesh)
    stdin = content if call.get("stdin") else None
    (folder / name).write_bytes(content)
    np.save(folder / "f.npy", np.linspace(0, 1, len(mesh["points"])))
    np.save(folder / "edges.npy", np.array([[0, 1], [1, 2]]))

    def command_words(words: Iterable[str]) -> list[str]:
        return _with_json([word.replace("{input}", name).replace("{folder}/", "") for word in words])

    def checked_outcome(words: Iterable[str], is_input: bool = True) -> CallOutcome:
        outcome = call_outcome(command_words(words), folder, stdin)
        check_outcome(outcome, mesh, folder, is_input)
        return outcome

    def judged_outcome(words: Iterable[str], is_input: bool = True) -> CallOutcome:
        call_words = command_words(words)
        dry = _dry_run(call_words, folder, stdin) if has_dry_run(call_words, refused=False) else None
        outcome = checked_outcome(words, is_input)
        if dry is None and outcome.exit_code == 2 and has_dry_run(call_words, refused=True):
            dry = _dry_run(call_words, folder, stdin)
        if dry is not None and (fault := disagreement(dry, outcome)):
            raise CallError(fault)
        return outcome

    for words in call["prepare"]:
        preparation = checked_outcome(words)
        if preparation.exit_code == 2:
            raise DdgError(preparation.error)
    words = call["words"]
    outcome = judged_outcome(words)
    place = place_of(Random(json.dumps(words)), words, mesh)
    refusals: list[str] = []
    is_input = True
    for _ in range(MAX_REMEDIES):
        if outcome.exit_code != 2 or words[0] in ("batch", "check"):
            break
        remedy = next(remedies(words, outcome.error, place, name), None)
        if remedy is None:
            break
        refusals.append(outcome.error)
        if remedy.before:
            repair = checked_outcome(remedy.before)
            if repair.exit_code == 2:
                raise CallError(f"{outcome.line}: {outcome.error}: the repair: {repair.error}")
            name = Path(remedy.before[-1]).name
        words, is_input = with_few_steps(remedy.words), is_input and not remedy.before
        outcome = judged_outcome(words, is_input)
        if outcome.exit_code == 2 and _same_refusal(outcome.error, refusals):
            raise CallError(f"{outcome.line}: the remedy {remedy.reason!r} fails; refusals: {refusals}")
    if outcome.exit_code == 2:
        raise DdgError(outcome.error)
    if call.get("interrupt"):
        whole_call = partial(call_outcome, folder=folder)
        fault = resume_fault(outcome, lambda w: whole_call(command_words(w)), folder, call["interrupt"])
        if fault:
            raise CallError(fault)
    return outcome


def _with_json(words: list[str]) -> list[str]:
    """The words with --json at the end, but before `--` of the command that a batch runs."""
    if writes_to_stdout(words):
        return list(words)
    k = words.index("--") if "--" in words else len(words)
    return [*words[:k], "--json", *words[k:]]


def _same_refusal(error: str, refusals: list[str]) -> bool:
    return error.replace("repaired.ply", "") in [text.replace("repaired.ply", "") for text in refusals]


def _dry_run(words: list[str], folder: Path, stdin: bytes | None) -> CallOutcome:
    """The dry run of a call, which writes nothing."""
    outcome = call_outcome([*words, "--dry-run"], folder, stdin)
    if outcome.new_files:
        raise CallError(f"{outcome.line}: a dry run wrote {outcome.new_files}")
    check_form(outcome)
    return outcome


def check_form(outcome: CallOutcome) -> None:
    """Exit code, streams and seconds of any call."""
    line, stderr = outcome.line, outcome.stderr.strip()
    if "internal error" in stderr or "Traceback" in stderr:
        raise CallError(f"{line}: {stderr.splitlines()[-1]}")
    if outcome.exit_code not in (0, 1, 2):
        raise CallError(f"{line}: exit code {outcome.exit_code} {outcome.exception!r}")
    stderr = re.sub(r"[^\n]*\r", "", stderr)  # progress bars
    lines = [line for line in stderr.splitlines() if line.strip() and not line.startswith("Warning: ")]
    if outcome.exit_code == 2 and (len(lines) != 1 or not outcome.error):
        raise CallError(f"{line}: refused in {len(lines)} lines: {lines[:3]}")
    if outcome.exit_code == 1 and not outcome.error and not outcome.stdout.strip():
        raise CallError(f"{line}: exit code 1 without a summary or an error")
    has_summary_there = writes_to_stdout(outcome.words) and outcome.exit_code != 2
    if len(lines) > 1 and not has_summary_there or len(outcome.error) > MAX_LENGTH:
        raise CallError(f"{line}: {len(lines)} lines, {len(outcome.error)} characters: {lines[:2]}")
    if "out of memory" in outcome.error:
        raise CallError(f"{line}: {outcome.error}")
    try:
        summary = outcome.summary
    except ValueError as error:
        raise CallError(f"{line}: no strict JSON: {error}") from None
    results = (summary or {}).get("results", {})
    results = results if isinstance(results, dict) else {}
    limit = CALL_SECONDS + PICTURE_SECONDS * results.get("exported_frames", 0)
    if outcome.seconds > limit + STEP_SECONDS * results.get("steps", 0):
        raise CallError(f"{line}: took {outcome.seconds:.0f} s")
    if outcome.exit_code == 0 and summary is None and not outcome.is_listing:
        raise CallError(f"{line}: no summary")


def check_outcome(outcome: CallOutcome, mesh: dict[str, Any], folder: Path, is_input: bool = True) -> None:
    """Everything that must hold of a call; `is_input`: its mesh is that of the input."""
    check_form(outcome)
    line, summary = outcome.line, outcome.summary
    if outcome.exit_code == 2:
        if outcome.new_files:
            raise CallError(f"{line}: refused, but wrote {outcome.new_files}")
        return
    outputs = {os.path.basename(path) for path in (summary or {}).get("outputs", [])}
    extra = [name for name in outcome.new_files
             if os.path.basename(name) not in outputs and not name.endswith(".part")]  # fmt: skip
    if summary is not None and extra and outcome.words[0] not in ("batch", "check"):
        raise CallError(f"{line}: files that the summary does not list: {extra}")
    if writes_to_stdout(outcome.words) and outcome.exit_code == 0 and "--dry-run" not in outcome.words:
        suffix = outcome.words[-outcome.words[::-1].index("--output-format")]  # the last one holds
        (folder / f"stdout{suffix}").write_bytes(outcome.stdout_bytes)
        for array_name, array in written_arrays(folder / f"stdout{suffix}"):
            check_finite(line, "standard output", array_name, array)
    if summary is None or outcome.exit_code != 0:
        return
    arrays: dict[str, NDArray] = {}
    warnings = " ".join(summary.get("warnings", []))
    for name in outcome.new_files:
        for array_name, array in written_arrays(folder / name):
            if not (array_name.startswith("energy_") and "could not be computed" in warnings):
                check_finite(line, name, array_name, array)
            arrays.setdefault(array_name, array)
    points, cells = mesh_arrays(mesh)
    if is_input and mesh["cells"] == SURFACE:
        for fault, explanations in violations(outcome.words, summary, arrays, points, cells):
            if not any(word.lower() in warnings.lower() for word in explanations):
                raise CallError(f"{line}: {fault}")


def check_finite(line: str, file: str, name: str, array: NDArray) -> None:
    """No NaN and no infinity but where the documentation has them."""
    if array.dtype.kind != "f" or name in ABSENT_AS_NAN:
        return
    if np.isnan(array).any():
        raise CallError(f"{line}: NaN in {name} of {file}")
    if np.isinf(array).any() and not name.startswith((*INFINITE_ARRAYS, "distance")):
        raise CallError(f"{line}: infinity in {name} of {file}")


def written_arrays(path: Path) -> Iterator[tuple[str, NDArray]]:
    """Arrays of a written file of numbers."""
    from ddgcli.io.mesh_file import READERS, read_mesh

    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as archive:
            yield from archive.items()
    elif path.suffix == ".vtkhdf":
        import h5py

        with h5py.File(path) as file:
            group = file["VTKHDF"]
            yield from (
                (name, np.asarray(group[name])) for name in group if isinstance(group[name], h5py.Dataset)
            )
            for place in ("PointData", "CellData", "FieldData"):
                yield from ((name, np.asarray(v)) for name, v in group.get(place, {}).items())
    elif path.suffix in READERS and path.suffix != ".csv":
        try:
            source = read_mesh(str(path))
        except DdgError as error:
            raise CallError(f"{path.name} cannot be read: {error}") from None
        yield "points", np.asarray(getattr(source.mesh, "points", np.zeros(0)))
        for arrays in (source.vertex, source.face, source.edge):
            yield from ((name, np.asarray(array)) for name, array in arrays.items())


# ---------------------------------------------------------------- invariants
def violations(
    words: list[str], summary: dict[str, Any], arrays: dict[str, NDArray], points: NDArray, faces: NDArray
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Violated identities of a run on a surface, each with words one of which a warning may have."""
    name, options = words[0], set(words)
    whole = not {"--subdivide", "--resample", "--dry-run"} & options
    evidence = Evidence(summary, arrays, points, faces, _truths(points, faces) if whole else {})
    if name in SHARED_CHECKS:
        for check in CHECKS[name]:
            yield from check(evidence)
    results = summary.get("results") or {}
    for key in ("area", "length", "energy", "volume_of_offset"):
        value = results.get(key)
        if isinstance(value, int | float) and value < 0:
            yield f"{key} {value}", ()
    if name == "geodesic" and whole:
        yield from _distances(words, summary, arrays, points, faces)
    is_flow = name == "laplacian" and "--smooth" in options and "conformalized" not in options
    if is_flow and whole and "points" in arrays:
        yield from check_box_does_not_grow(evidence)
    if name == "willmore-flow" and (summary.get("accuracy") or {}).get("energy_increases") == 0:
        yield from check_willmore(evidence)


SHARED_CHECKS = ("info", "curvature", "delaunay", "dec", "hodge")


def _truths(points: NDArray, faces: NDArray) -> dict[str, Any]:
    with np.errstate(all="ignore"):
        truths = truths_of(points, faces)
    if not np.isfinite(truths.area):
        return {}
    return {"area": truths.area}


def _distances(
    words: list[str], summary: dict[str, Any], arrays: dict[str, NDArray], points: NDArray, faces: NDArray
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Zero at source vertices, nowhere negative; exact ones no steeper than edges."""
    distance, options = arrays.get("geodesic_distance"), summary.get("options", {})
    if distance is None or len(distance) != len(points):
        return
    sources = [vertex for vertex in options.get("source", []) if 0 <= vertex < len(points)]
    scale = float(np.ptp(points, axis=0).max())
    if (distance < 0).any():
        yield f"distance {distance.min()}", ()
    if any(distance[vertex] > ROUNDING * scale for vertex in sources):
        yield f"distance {max(distance[v] for v in sources)} at a source", ()
    if options.get("method") != "exact" or options.get("tolerance"):
        return
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    a, b = distance[sides[:, 0]], distance[sides[:, 1]]
    length = np.linalg.norm((points[sides[:, 0]] - points[sides[:, 1]]) / (scale or 1.0), axis=1) * scale
    finite = np.isfinite(a) & np.isfinite(b)
    steep = np.abs(a[finite] - b[finite]) - length[finite] - ROUNDING * scale
    if steep.size and steep.max() > 0:
        yield f"distances of neighbours differ by {steep.max():.3g} more than their edge", ("distance",)
    if (np.isfinite(a) != np.isfinite(b)).any():
        yield "an edge joins a reached and an unreached vertex", ("distance", "reach")
