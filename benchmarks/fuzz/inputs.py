"""The kinds of inputs that are mutated: valid ones, and how each is read."""

from __future__ import annotations

import contextlib
import io
import json
import random
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz.call_checks import read_call
from benchmarks.fuzz.call_options import random_call
from benchmarks.fuzz.mesh_seeds import mesh_seeds
from benchmarks.fuzz.scenes import fluid_scene, shell_scene
from benchmarks.fuzz.scratch import scratch_folder
from benchmarks.fuzz.seeds import EXPECTED_SUMMARY, EXPRESSIONS, FLUID_SCENES, ROW, SCENES
from ddgcli.errors import DdgError, MeshFileError

SECONDS_FOR_ONE = 20.0  # of processor time, for inputs of some kilobytes
SECONDS_FOR_A_RUN = 60.0  # of some ten steps, each with adaptive halves
MAX_STEPS = 100  # of a scene in a trial
DEFAULT_STEP = 0.01  # of a scene without `step`
FORECAST = ("--json", "--dry-run")
LONGEST_EXCERPT = 500  # characters of a refusal of an expression


@dataclass(frozen=True)
class Kind:
    """Valid inputs of a kind and the function that reads one; both computed on demand.

    Parameters
    ----------
    guarded : bool
        Its reader runs in a process of its own, which a trial of many inputs leaves out: the input that
        stops such a trial is read again as the program reads it.
    random_input : callable, optional
        Makes a valid input from random numbers; else the valid inputs of `seeds` are mutated.
    cpu_seconds : float
        Processor time that an input may take.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    reader: Callable[[], Callable[[bytes], object]]
    guarded: bool = False
    random_input: Callable[[random.Random], bytes] | None = None
    cpu_seconds: float = SECONDS_FOR_ONE

    @contextlib.contextmanager
    def without_guard(self) -> Iterator[None]:
        """Read HDF5 in this process, which is a child itself."""
        if not self.guarded:
            yield
            return
        from ddgcli.io.readers import vtkhdf
        from ddgcli.io.trajectories import layout_check

        modules: tuple[Any, ...] = (vtkhdf, layout_check)
        before = [module.guarded for module in modules]
        for module in modules:
            module.guarded = _unguarded
        try:
            yield
        finally:
            for module, function in zip(modules, before, strict=True):
                module.guarded = function


def _unguarded(module: str, function: str, *args: Any, **bounds: Any) -> Any:
    """The reader in this process; its foreign errors as `guarded` reports them."""
    import importlib

    read = getattr(importlib.import_module(f"ddgcli.io.{module}"), function)
    try:
        return read(*args)
    except MeshFileError:
        raise
    except (Exception, SystemExit) as error:
        raise MeshFileError(f"its reader failed ({type(error).__name__})") from None


def read_mesh_bytes(suffix: str) -> Callable[[bytes], object]:
    """How a mesh file of a format is read."""
    from ddgcli.io.mesh_file import read_mesh

    return _by_path(f"a{suffix}", read_mesh)


def read_array_bytes(suffix: str) -> Callable[[bytes], object]:
    """How a file of numbers for `--field` is read."""
    from ddgcli.io.arrays import read_array

    return _by_path(f"a{suffix}", read_array)


def _by_path(name: str, read_path: Callable[[str], object]) -> Callable[[bytes], object]:
    folder = scratch_folder()
    path = f"{folder}/{name}"

    def read(data: bytes) -> object:
        Path(path).unlink(missing_ok=True)  # HDF5 takes a file that a reader left open for the one it opens
        with open(path, "wb") as file:
            file.write(data)
        return read_path(path)

    return read


def read_expected() -> Callable[[bytes], object]:
    """A stored summary as `check` reads it."""
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare
    from ddgcli.cli.commands.check import read_expected as stored_summary

    def read(path: str) -> object:
        stored = stored_summary(path, may_miss=False)
        return compare(stored["summary"], {"results": {"a": 1}}, Tolerances(**stored.get("tolerances", {})))

    return _by_path("e.json", read)


def read_expression() -> Callable[[bytes], object]:
    """An expression, whose own refusal is ValueError."""
    from ddgcli.scenes.expressions import evaluate

    x = np.linspace(-1, 1, 5)

    def read(data: bytes) -> object:
        try:
            return evaluate(data.decode("utf-8", "replace"), {"x": x, "y": x, "z": x})
        except ValueError as error:
            raise DdgError(str(error)[:LONGEST_EXCERPT]) from None

    return read


def read_table(suffix: str) -> Callable[[bytes], object]:
    """A table of an interrupted batch."""
    from ddgcli.cli.batch.table import completed_rows
    from ddgcli.cli.batch.tasks import Task

    task = Task(0, "a.ply", {"radius": "1"}, None, ("info", "a.ply"))
    return _by_path(f"t{suffix}", lambda path: completed_rows(path, [task], {"a.ply": "0" * 64}, ["area"]))


def _is_long_run(path: str) -> bool:
    """Whether a scene has more steps than a trial can run; that is no fault of the reader."""
    try:
        with open(path, "rb") as file:
            time = tomllib.load(file)["time"]
        return float(time["duration"]) > MAX_STEPS * float(time.get("step", DEFAULT_STEP))
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
        return False  # the command reports it


def _is_predicted_long(forecast: Any) -> bool:
    """Whether a dry run states more seconds than a trial has: that they pass is no escape.

    Without those that this process has spent on earlier trials, which a dry run counts as spent on reading.
    """
    if forecast.exit_code:
        return False  # the run refuses it, too
    prediction = json.loads(forecast.stdout)["results"]
    return float(prediction["seconds_range"][1] - prediction["read_seconds"]) > SECONDS_FOR_A_RUN / 2


def read_by_command(name: str, *words: str, output: str = "") -> Callable[[], Callable[[bytes], object]]:
    """The command line in this process; its refusals become DdgError.

    `output` is a trajectory that the command writes: it is finite, and absent after a refusal.
    """

    def reader() -> Callable[[bytes], object]:
        from click.testing import CliRunner

        from ddgcli.cli.main import main as command_line

        runner = CliRunner()

        def read(path: str) -> object:
            folder = str(Path(path).parent)
            line = [word.format(input=path, folder=folder) for word in words]
            if output:
                Path(folder, output).unlink(missing_ok=True)
            if path.endswith(".toml"):
                if _is_long_run(path) or _is_predicted_long(runner.invoke(command_line, [*line, *FORECAST])):
                    line += ["--dry-run"]
                elif output:
                    line += ["-o", f"{folder}/{output}"]
            result = runner.invoke(command_line, [*line, "--json"])
            lines = result.stderr.strip().replace(folder, "").splitlines()
            message = "\n".join(text for text in lines if not text.startswith("Warning: "))
            if "internal error" in message or result.exit_code not in (0, 1, 2):
                raise RuntimeError(message or repr(result.exception))
            if output:
                _check_trajectory(Path(folder, output), result.exit_code)
            if result.exit_code == 0:
                return result
            raise DdgError(message)

        return _by_path(name, read)

    return reader


def _check_trajectory(path: Path, exit_code: int) -> None:
    """Raise an error where a refused run left a file, or a run wrote a point that is not finite."""
    from ddgcli.io.trajectories.trajectory import Trajectory

    if not path.exists():
        return
    if exit_code == 2:
        raise RuntimeError("exit code 2, but there is an output")
    with Trajectory(str(path)) as trajectory:
        for frame_number in range(trajectory.n_frames):
            if not np.isfinite(trajectory.points(frame_number)).all():
                raise RuntimeError(f"frame {frame_number} is not finite")


def array_seeds(suffix: str) -> list[bytes]:
    """Files of numbers for `--field`."""
    stream = io.BytesIO()
    if suffix == ".npy":
        np.save(stream, np.arange(12.0).reshape(4, 3))
    elif suffix == ".npz":
        np.savez_compressed(stream, f=np.arange(12.0))
    else:
        stream.write(b"1,2,3\n4,5,6\n" if suffix == ".csv" else b"1 2 3\n4 5 6\n")
    return [stream.getvalue()]


def trajectory_seeds() -> list[bytes]:
    """A run of three frames with an obstacle."""
    from click.testing import CliRunner

    from ddgcli.cli.main import main as command_line

    with tempfile.TemporaryDirectory() as folder:
        scene, run = Path(folder) / "s.toml", Path(folder) / "r.vtkhdf"
        scene.write_bytes(SCENES[0])
        done = CliRunner().invoke(command_line, ["shell-sim", str(scene), "-o", str(run)])
        if done.exit_code:
            raise RuntimeError(done.output)
        return [run.read_bytes()]


MESHES = (".ply", ".off", ".obj", ".stl", ".vtk", ".vtu", ".vtp", ".vtkhdf", ".npz", ".csv", ".wkt")
ARRAYS = (".npy", ".npz", ".csv", ".txt")


def kinds() -> dict[str, Kind]:
    """The kinds by name."""
    every = [
        *(Kind(s[1:], partial(mesh_seeds, s), partial(read_mesh_bytes, s), s == ".vtkhdf") for s in MESHES),
        *(Kind(f"array{s}", partial(array_seeds, s), partial(read_array_bytes, s)) for s in ARRAYS),
        Kind("scene", lambda: SCENES, read_by_command("scene.toml", "shell-sim", "{input}"),
             cpu_seconds=SECONDS_FOR_A_RUN),
        Kind("fluid scene", lambda: FLUID_SCENES, read_by_command("scene.toml", "fluid-sim", "{input}"),
             cpu_seconds=SECONDS_FOR_A_RUN),
        Kind("valid shell scene", lambda: SCENES,
             read_by_command("scene.toml", "shell-sim", "{input}", output="run.vtkhdf"),
             guarded=True, random_input=shell_scene, cpu_seconds=SECONDS_FOR_A_RUN),
        Kind("valid fluid scene", lambda: FLUID_SCENES,
             read_by_command("scene.toml", "fluid-sim", "{input}", output="run.vtkhdf"),
             guarded=True, random_input=fluid_scene, cpu_seconds=SECONDS_FOR_A_RUN),
        Kind("valid call", lambda: [], read_call, guarded=True, random_input=random_call,
             cpu_seconds=SECONDS_FOR_A_RUN),
        Kind("trajectory", trajectory_seeds,
             read_by_command("r.vtkhdf", "frames", "{input}", "--at", "0.001", "-o", "{folder}/f.npz"), True),
        Kind("expression", lambda: EXPRESSIONS, read_expression),
        Kind("expected", lambda: [EXPECTED_SUMMARY], read_expected),
        Kind("batch.jsonl", lambda: [json.dumps(ROW).encode()], partial(read_table, ".jsonl")),
        Kind("batch.csv", table_seeds, partial(read_table, ".csv")),
    ]  # fmt: skip
    return {kind.name: kind for kind in every}


def table_seeds() -> list[bytes]:
    """A table as a batch writes it."""
    from ddgcli.cli.batch.process import TaskRow
    from ddgcli.cli.batch.table import table_bytes

    return [table_bytes("t.csv", [TaskRow(**ROW)])]
