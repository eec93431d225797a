"""Run a random call in this process and check all that it leaves behind."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz.call_cures import cures, place_of
from benchmarks.fuzz.call_meshes import SURFACE, mesh_arrays, mesh_file
from benchmarks.fuzz.scratch import scratch_folder
from benchmarks.hardcases.checks import (
    CHECKS,
    Evidence,
    check_box_does_not_grow,
    check_willmore,
)
from benchmarks.hardcases.judge import ABSENT_AS_NAN, INFINITE_ARRAYS
from benchmarks.hardcases.meshes import truths_of
from ddgcli.errors import DdgError

MAX_CURES = 4
MAX_LENGTH = 600  # characters of an error, beside the paths
CALL_SECONDS = 20.0  # of processor time, for one call on a mesh of at most some hundred cells
TOO_LARGE = ("GiB of memory", "more than")
ROUNDING = 1e-7  # of the largest distance, for needles too


class CallError(Exception):
    """A fault of the program: the call, and what is wrong."""


class CallOutcome:
    """Exit code, streams, new files and seconds of one call."""

    def __init__(self, words: list[str], folder: Path) -> None:
        from click.testing import CliRunner

        from ddgcli.cli.main import main as command_line

        before = _listing(folder)
        began = time.process_time()
        result = CliRunner().invoke(command_line, words)
        self.seconds = time.process_time() - began
        self.words, self.exit_code = words, result.exit_code
        self.stdout, self.stderr = result.stdout, result.stderr
        self.exception = result.exception
        self.new_files = sorted(name for name, stamp in _listing(folder).items() if before.get(name) != stamp)

    @property
    def error(self) -> str:
        """The line of the error, without its beginning."""
        lines = [line for line in self.stderr.splitlines() if line.startswith("Error: ")]
        return lines[0].removeprefix("Error: ") if lines else ""

    @property
    def summary(self) -> dict[str, Any] | None:
        """The summary of --json; None without one."""
        if "--json" not in self.words or not self.stdout.strip() or {"--effects", "--schema"} & {*self.words}:
            return None
        return json.loads(self.stdout, parse_constant=_reject)


def _listing(folder: Path) -> dict[str, tuple[int, int]]:
    return {str(p.relative_to(folder)): (p.stat().st_mtime_ns, p.stat().st_ino)
            for p in folder.rglob("*") if p.is_file()}  # fmt: skip


def _reject(name: str) -> None:
    raise ValueError(f"{name} in the summary")


def read_call() -> Callable[[bytes], object]:
    """Runs calls; a refusal becomes DdgError, a fault CallError."""

    folder = scratch_folder()

    def read(data: bytes) -> object:
        import shutil

        call = json.loads(data)
        here = folder / "call"
        shutil.rmtree(here, ignore_errors=True)
        here.mkdir()
        before = os.getcwd()
        os.chdir(here)
        try:
            return run_call(call, here)
        finally:
            os.chdir(before)

    return read


def run_call(call: dict[str, Any], folder: Path) -> CallOutcome:
    """Run the preparing calls and the judged one, follow the cures of refusals, and check every outcome."""
    mesh = call["mesh"]
    name = f"mesh{mesh['suffix']}"
    (folder / name).write_bytes(mesh_file(mesh))
    np.save(folder / "f.npy", np.linspace(0, 1, len(mesh["points"])))
    np.save(folder / "edges.npy", np.array([[0, 1], [1, 2]]))
    rng = Random(json.dumps(call["words"]))

    def placed(words: list[str]) -> list[str]:
        return [word.replace("{input}", name).replace("{folder}/", "") for word in words] + ["--json"]

    for words in call["prepare"]:
        prepared = CallOutcome(_with_json(placed(words)), folder)
        check_outcome(prepared, mesh, folder)
        if prepared.exit_code == 2:
            raise DdgError(prepared.error)
    words = call["words"]
    dry = _dry_run(placed(words), folder)
    outcome = CallOutcome(_with_json(placed(words)), folder)
    check_outcome(outcome, mesh, folder)
    _check_dry_run(dry, outcome)
    place = place_of(rng, words, mesh)
    refusals: list[str] = []
    for _ in range(MAX_CURES):
        if outcome.exit_code != 2 or words[0] in ("batch", "check"):
            break
        cure = next(cures(words, outcome.error, place, name), None)
        if cure is None:
            break
        refusals.append(outcome.error)
        if cure.before:
            repaired = CallOutcome(_with_json(placed(list(cure.before))), folder)
            check_outcome(repaired, mesh, folder)
            if repaired.exit_code == 2:
                raise CallError(f"{_shown(outcome.words)}: {outcome.error}: the repair: {repaired.error}")
        words = cure.words
        outcome = CallOutcome(_with_json(placed(words)), folder)
        check_outcome(outcome, mesh, folder, is_input=not cure.before)
        if outcome.exit_code == 2 and _same_refusal(outcome.error, refusals):
            raise CallError(f"{_shown(outcome.words)}: the cure {cure.reason!r} fails; refusals: {refusals}")
    if outcome.exit_code == 2:
        raise DdgError(outcome.error)
    return outcome


def _with_json(words: list[str]) -> list[str]:
    """--json at the end, before `--` of the command that a batch runs."""
    words = words[:-1]
    k = words.index("--") if "--" in words else len(words)
    return [*words[:k], "--json", *words[k:]]


def _same_refusal(error: str, refusals: list[str]) -> bool:
    return error.replace("repaired.ply", "") in [text.replace("repaired.ply", "") for text in refusals]


def _shown(words: list[str]) -> str:
    import shlex

    return shlex.join(words)


def _dry_run(words: list[str], folder: Path) -> CallOutcome | None:
    """The dry run of a call; of some calls only, for it takes as long as a small run."""
    if words[0] in ("batch", "check", "tradeoff", "frames") or Random(" ".join(words)).random() < 0.6:
        return None
    outcome = CallOutcome(_with_json([*words[:-1], "--dry-run", "--json"]), folder)
    if outcome.new_files:
        raise CallError(f"{_shown(outcome.words)}: a dry run wrote {outcome.new_files}")
    check_form(outcome)
    return outcome


def _check_dry_run(dry: CallOutcome | None, outcome: CallOutcome) -> None:
    """A dry run refuses what the run refuses, but for sizes."""
    if dry is None or any(text in dry.error for text in TOO_LARGE):
        return
    if (dry.exit_code == 2) > (outcome.exit_code == 2):
        raise CallError(f"{_shown(dry.words)}: the dry run is refused, the run is not: {dry.error}")
    if (dry.exit_code == 2) < (outcome.exit_code == 2) and os.environ.get("DDGCLI_FUZZ_DRY"):
        raise CallError(f"{_shown(dry.words)}: exit code {dry.exit_code}, the run's 2: {outcome.error}")


def check_form(outcome: CallOutcome) -> None:
    """Exit code, streams and seconds of any call."""
    shown, stderr = _shown(outcome.words), outcome.stderr.strip()
    if "internal error" in stderr or "Traceback" in stderr:
        raise CallError(f"{shown}: {stderr.splitlines()[-1]}")
    if outcome.exit_code not in (0, 1, 2):
        raise CallError(f"{shown}: exit code {outcome.exit_code} {outcome.exception!r}")
    stderr = re.sub(r"[^\n]*\r", "", stderr)  # progress bars
    lines = [line for line in stderr.splitlines() if line.strip() and not line.startswith("Warning: ")]
    if outcome.exit_code == 2 and (len(lines) != 1 or not outcome.error):
        raise CallError(f"{shown}: refused in {len(lines)} lines: {lines[:3]}")
    if outcome.exit_code == 1 and not outcome.error and not outcome.stdout.strip():
        raise CallError(f"{shown}: exit code 1 without a summary or an error")
    if len(lines) > 1 or len(outcome.error) > MAX_LENGTH:
        raise CallError(f"{shown}: {len(lines)} lines, {len(outcome.error)} characters: {lines[:2]}")
    if "out of memory" in outcome.error:
        raise CallError(f"{shown}: {outcome.error}")
    if outcome.seconds > CALL_SECONDS:
        raise CallError(f"{shown}: took {outcome.seconds:.0f} s")
    try:
        summary = outcome.summary
    except ValueError as error:
        raise CallError(f"{shown}: no strict JSON: {error}") from None
    if outcome.exit_code == 0 and summary is None and not {"--effects", "--schema"} & {*outcome.words}:
        raise CallError(f"{shown}: no summary")


def check_outcome(outcome: CallOutcome, mesh: dict[str, Any], folder: Path, is_input: bool = True) -> None:
    """Everything that must hold of a call; `is_input`: its mesh is that of the input."""
    check_form(outcome)
    shown, summary = _shown(outcome.words), outcome.summary
    if outcome.exit_code == 2:
        if outcome.new_files:
            raise CallError(f"{shown}: refused, but wrote {outcome.new_files}")
        return
    listed = {os.path.basename(path) for path in (summary or {}).get("outputs", [])}
    extra = [name for name in outcome.new_files if os.path.basename(name) not in listed]
    extra = [
        name for name in extra if not name.endswith(".part") and outcome.words[0] not in ("batch", "check")
    ]
    if summary is not None and extra:
        raise CallError(f"{shown}: files that the summary does not list: {extra}")
    if summary is None or outcome.exit_code != 0:
        return
    arrays: dict[str, NDArray] = {}
    warnings = " ".join(summary.get("warnings", []))
    for name in outcome.new_files:
        for array_name, array in written_arrays(folder / name):
            if not (array_name.startswith("energy_") and "could not be computed" in warnings):
                check_finite(shown, name, array_name, array)
            arrays.setdefault(array_name, array)
    points, cells = mesh_arrays(mesh)
    if is_input and mesh["cells"] == SURFACE:
        for fault, known in violations(outcome.words, summary, arrays, points, cells):
            if not any(word.lower() in warnings.lower() for word in known):
                raise CallError(f"{shown}: {fault}")


def check_finite(shown: str, file: str, name: str, array: NDArray) -> None:
    """No NaN and no infinity but where the documentation has them."""
    if array.dtype.kind != "f" or name in ABSENT_AS_NAN:
        return
    if np.isnan(array).any():
        raise CallError(f"{shown}: NaN in {name} of {file}")
    if np.isinf(array).any() and not name.startswith((*INFINITE_ARRAYS, "distance")):
        raise CallError(f"{shown}: infinity in {name} of {file}")


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
        for place in (source.vertex, source.face, source.edge):
            yield from ((name, np.asarray(array)) for name, array in place.items())


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
