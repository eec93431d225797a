"""What the three simulators share: options of time, scenes and resuming, and the run itself."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ddgcli import __version__
from ddgcli.cli import options
from ddgcli.cli.run import Run
from ddgcli.cli.scene_input import (
    describe_input,
    fingerprint,
    mesh_reader,
    print_dry_run,
    print_effects,
    print_schema,
    quick_scene,
    refuse_changed,
    scene_document,
    toml_settings,
)
from ddgcli.errors import ParameterError, SolveError
from ddgcli.evolve.account import Account
from ddgcli.evolve.frames import joined_frame, joined_mesh
from ddgcli.evolve.loop import Model, Schedule, Snapshot, evolve
from ddgcli.mesh.fields import AnnotatedMesh, Frame

__all__ = [
    "Outcome",
    "describe_input",
    "draw",
    "fingerprint",
    "formats",
    "mesh_reader",
    "print_dry_run",
    "print_effects",
    "print_schema",
    "quick_scene",
    "refuse_changed",
    "scene_document",
    "scene_options",
    "shares",
    "simulate",
    "time_options",
    "toml_settings",
]
TRAJECTORIES = (".vtkhdf", ".h5")

_TIME = (
    click.option(
        "--steps", type=click.IntRange(min=1), help="Steps to take; overrides the scene's duration."
    ),
    click.option("--duration", type=options.POSITIVE, help="Length of the run [s]."),
    click.option("--dt", "step", type=options.POSITIVE, help="Time step [s]."),
    click.option("--frame-every", type=options.POSITIVE, help="Time between frames [s]."),
    click.option("--tolerance", type=options.POSITIVE, help="Adaptive steps: largest error of a step."),
    click.option("--integrator", metavar="NAME", help="Time scheme."),
)
_RESUME = click.option(
    "--resume", metavar="RUN.part", type=click.Path(), help="Go on from its last whole frame."
)
_SCENE = (
    click.option("--effect", "effect_lines", multiple=True, metavar="'NAME KEY=VALUE ...'",
                 help="Without a scene file: an effect, its parameters in TOML. Repeatable."),
    click.option("--effects", "list_effects", is_flag=True, help="List the effects and their parameters."),
    click.option("--schema", is_flag=True, help="Print the JSON Schema of scenes, for editors."),
    click.option("--dry-run", is_flag=True, help="Check everything and print what would be assembled."),
)  # fmt: skip


def time_options(command: Callable) -> Callable:
    """--steps, --duration, --dt, ... gathered in one `overrides: dict`; and --resume."""

    def gathered(*args: Any, **kwargs: Any) -> Any:
        names = ("steps", "duration", "step", "frame_every", "tolerance", "integrator")
        overrides = {name: kwargs.pop(name) for name in names}
        if overrides["steps"] and overrides["duration"]:
            raise ParameterError("give either --steps or --duration")
        return command(*args, overrides={k: v for k, v in overrides.items() if v is not None}, **kwargs)

    gathered.__name__, gathered.__doc__ = command.__name__, command.__doc__
    gathered.__click_params__ = getattr(command, "__click_params__", [])  # type: ignore[attr-defined]
    for option in reversed((*_TIME, _RESUME)):
        gathered = option(gathered)
    return gathered


def scene_options(command: Callable) -> Callable:
    """--effect, --effects, --schema, --dry-run."""
    for option in reversed(_SCENE):
        command = option(command)
    return command


# ---------------------------------------------------------------- runs


@dataclass(eq=False)
class Outcome:
    """What a run left behind.

    Parameters
    ----------
    frames : int
    first, last : Frame
    series : dict of str to (T, ...) ndarray
        Scalars of every frame.
    times : (T,) ndarray
    largest_strain : dict of str to float
        Largest absolute value over the run of every vertex array.
    stopped : str
        Why the model ended the run early, or "".
    failure : str
        Why it broke off, or "".
    steps : int
    smallest_step : float
    events : int
        Rejected and shortened steps.
    kept : list of Frame
        A few frames, spread over the run, for a picture.
    mesh : TriangleMesh
        All surfaces as one.
    """

    frames: int = 0
    first: Frame | None = None
    last: Frame | None = None
    series: dict[str, NDArray] = field(default_factory=dict)
    times: NDArray = field(default_factory=lambda: np.zeros(0))
    largest: dict[str, float] = field(default_factory=dict)
    stopped: str = ""
    failure: str = ""
    interrupted: bool = False
    steps: int = 0
    smallest_step: float = np.inf
    events: int = 0
    kept: list[Frame] = field(default_factory=list)
    mesh: Any = None


def formats() -> tuple[str, ...]:
    """Extensions of -o: trajectories, and meshes for the last frame."""
    from ddgcli.io.mesh_file import WRITERS

    return (*TRAJECTORIES, *(suffix for suffix in WRITERS if suffix not in TRAJECTORIES))


def trajectory_outputs(run: Run) -> tuple[list[str], list[str]]:
    """(trajectory paths, mesh paths) among the -o of the run."""
    paths = [p for p in run.common.outputs if Path(p).suffix.lower() in TRAJECTORIES]
    return paths, [p for p in run.common.outputs if p not in paths]


def simulate(
    run: Run,
    models: Mapping[str, Model],
    meshes: list[Any],
    schedule: Schedule,
    account: Account,
    *,
    moving: bool,
    resume: str | None = None,
    attributes: Mapping[str, Any] | None = None,
    texts: Mapping[str, str] | None = None,
    face: Mapping[str, NDArray] | None = None,
) -> Outcome:
    """Run the models to the end: every frame into the trajectory asked for, the last one as a mesh.

    Parameters
    ----------
    run : Run
    models : mapping of str to Model
        In the order of `meshes`.
    meshes : list of TriangleMesh or IntrinsicMesh (with points)
    schedule : Schedule
    account : Account
        The one that the models book to.
    moving : bool
        Whether the surface moves.
    resume : str, optional
        The .part to go on from.
    attributes, texts : mappings
        For the group `ddgcli`.
    face : mapping of str to (m, ...) ndarray
        Constant arrays on faces of the joined mesh.
    """
    mesh, number = joined_mesh(meshes)
    trajectories, mesh_paths = trajectory_outputs(run)
    if len(trajectories) > 1:
        raise ParameterError("one run writes one trajectory; give one .vtkhdf or .h5")
    target = trajectories[0] if trajectories else (resume or "").removesuffix(".part") or None
    cell = {"object_id": number, **(face or {})} if len(meshes) > 1 else dict(face or {})
    outcome = Outcome(mesh=mesh)
    shown = np.linspace(0, schedule.frames - 1, 4).round().astype(int) if run.common.plot else ()
    keep = _Keeper(outcome, set(map(int, shown)))
    start = None
    writer = None
    if target is not None:
        from ddgcli.io.trajectory import Header, Trajectory, TrajectoryWriter

        header = Header(mesh, moving, cell, {**_provenance(run), **(attributes or {})}, dict(texts or {}))
        if resume is not None:
            with Trajectory(resume) as part:
                start = (part.n_frames - 1, part.checkpoint())
                account.restore(part.effects)
                keep.frames(part.frame(k) for k in range(part.n_frames))
            writer = TrajectoryWriter.resume(resume, target, header, schedule.frames)
        else:
            writer = TrajectoryWriter(target, header, schedule.frames)
    elif resume is not None:
        raise ParameterError(f"{resume}: cannot be resumed; its name must end in .part")
    status = "failed"
    try:
        told = run.progress("frames")
        for snapshot in evolve(models, schedule, account, start):
            with account.within("output"):
                frame = joined_frame(snapshot)
                keep.add(frame, snapshot)
                if writer is not None:
                    rows = [(n, c, s) for n, (c, s) in _all_rows(account, models).items()]
                    log = [(e.step, e.time, e.kind, e.place, e.value, e.detail) for e in snapshot.events]
                    writer.append(frame, snapshot.checkpoint, rows, log)
            told(snapshot.frame + 1, schedule.frames)
        status = "complete"
    except SolveError as error:
        outcome.failure = str(error)
        logging.getLogger("ddgcli").warning("%s", error)
    except KeyboardInterrupt:
        status, outcome.interrupted = "interrupted", True
    finally:
        keep.finish()
        if writer is not None:
            with run.timed("write"):
                left = writer.close(status)
            if left is not None:
                run.outputs.append(left)
    if outcome.interrupted:
        where = f"; go on with --resume {run.outputs[-1]}" if writer is not None and run.outputs else ""
        click.echo(f"Interrupted: {outcome.frames} whole frames{where}", err=True)
        click.get_current_context().exit(130)
    _write_last(run, mesh, outcome, cell, mesh_paths)
    return outcome


def _all_rows(account: Account, models: Mapping[str, Model]) -> dict[str, tuple[int, float]]:
    """Every name has a row from the first frame on, so that the file keeps its layout."""
    rows = account.rows()
    for name in ("integrator", "solver", "output"):
        rows.setdefault(name, (0, 0.0))
    return rows


class _Keeper:
    """Gathers the scalars of the frames for the summary; keeps two frames, not all."""

    def __init__(self, outcome: Outcome, shown: set[int]) -> None:
        self.outcome, self.rows, self.times = outcome, [], []  # type: ignore[var-annotated]
        self.shown = shown

    def frames(self, frames: Iterable[Frame]) -> None:
        """Frames of an earlier part of the run."""
        for frame in frames:
            self._note(frame)

    def _note(self, frame: Frame) -> None:
        outcome = self.outcome
        if outcome.first is None:
            outcome.first = frame
        outcome.last = frame
        if outcome.frames in self.shown:
            outcome.kept.append(frame)
        outcome.frames += 1
        self.times.append(frame.time)
        self.rows.append(frame.scalar)
        for name, values in frame.vertex.items():
            if values.size and values.dtype.kind == "f":
                outcome.largest[name] = max(outcome.largest.get(name, 0.0), float(np.abs(values).max()))

    def add(self, frame: Frame, snapshot: Snapshot) -> None:
        self._note(frame)
        outcome = self.outcome
        outcome.steps, outcome.smallest_step = snapshot.steps, snapshot.smallest_step
        outcome.events += len(snapshot.events)
        outcome.stopped = snapshot.stopped

    def finish(self) -> None:
        names = self.rows[0] if self.rows else {}
        self.outcome.series = {n: np.array([row.get(n, np.nan) for row in self.rows]) for n in names}
        self.outcome.times = np.array(self.times)


def _provenance(run: Run) -> dict[str, Any]:
    return {"version": __version__, **{k: v for k, v in run.metadata.items() if k != "version"}}


def _write_last(run: Run, mesh: Any, outcome: Outcome, cell: dict[str, NDArray], paths: list[str]) -> None:
    """The last frame as a mesh, marked as not converged where the run broke off."""
    last = outcome.last
    if last is None:
        return
    shown = mesh if last.points is None else mesh.moved(last.points)
    annotated = AnnotatedMesh(shown, vertex=last.vertex, face=cell)
    for path in paths:
        run.write_file(path, annotated, converged=not outcome.failure)


def draw(run: Run, outcome: Outcome, array: str) -> None:
    """--plot: a few frames coloured by an array, and the chart of energies."""

    def story(path: str) -> None:
        from ddgcli.plots.motion import Shot, draw_motion, stage

        frames = outcome.kept if outcome.last in outcome.kept else [*outcome.kept, outcome.last]
        shots = [
            Shot(f.time, outcome.mesh if f.points is None else outcome.mesh.moved(f.points), f.vertex[array])
            for f in frames
            if f is not None
        ]
        energies = {n: (outcome.times, v) for n, v in outcome.series.items() if n.startswith("energy")}
        draw_motion(path, shots, energies, stage(shots, array), "energy [J]")

    run.plot(story)


def shares(account: Account, effects: list[str]) -> tuple[dict[str, Any], dict[str, float]]:
    """(`results.effects`, seconds of everything): calls, seconds and share of each effect that ran."""
    total = sum(account.seconds.values()) or 1.0
    found = {
        name: {
            "seconds": account.seconds[name],
            "share": account.seconds[name] / total,
            "evaluations": account.calls[name],
        }
        for name in effects
        if account.calls.get(name)
    }
    for name in effects:
        found.setdefault(name, {"seconds": 0.0, "share": 0.0, "evaluations": 0})
    everything = {
        name: account.seconds.get(name, 0.0) for name in (*effects, "solver", "integrator", "output")
    }
    return found, {**everything, "total": sum(account.seconds.values())}
