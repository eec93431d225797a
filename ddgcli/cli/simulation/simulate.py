"""A simulation from start to end: every frame into the trajectory, the last one as a mesh."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import click
from numpy.typing import NDArray

from ddgcli import __version__
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, SolveError
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_frame, joined_mesh
from ddgcli.simulation.outcome import FrameRecorder, Outcome
from ddgcli.simulation.time_loop import Arrays, Event, Model, RunFailed, Schedule, evolve, stop_reason

TRAJECTORIES = (".vtkhdf", ".h5")


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be run, and what the trajectory tells of it.

    Parameters
    ----------
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
    doubt : callable Outcome -> str
        Why a run that came to its end is not to be trusted, or "".
    """

    models: Mapping[str, Model]
    meshes: list[Any]
    schedule: Schedule
    account: Account
    moving: bool
    resume: str | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    face: Mapping[str, NDArray] = field(default_factory=dict)
    doubt: Callable[[Outcome], str] = lambda outcome: ""


def formats() -> tuple[str, ...]:
    """Extensions of -o: trajectories, and meshes for the last frame."""
    from ddgcli.io.mesh_file import WRITERS

    return (*TRAJECTORIES, *(suffix for suffix in WRITERS if suffix not in TRAJECTORIES))


def simulate(run: Run, job: Job) -> Outcome:
    """Run the models to the end, to a failure or to an interruption; what was written is whole each time."""
    mesh, number = joined_mesh(job.meshes)
    cell = {"object_id": number, **job.face} if len(job.meshes) > 1 else dict(job.face)
    outcome = Outcome(mesh=mesh)
    keep = FrameRecorder(outcome, picture=bool(run.common.plot))
    paths = [p for p in run.common.outputs if Path(p).suffix.lower() in TRAJECTORIES]
    writer, start = _opened(run, job, paths, cell, keep)
    status, earlier, began = "failed", sum(job.account.seconds.values()), perf_counter()
    since: tuple[Event, ...] = ()
    try:
        _march(run, job, keep, writer, start)
        status = "complete"
    except SolveError as error:
        outcome.failure = str(error)
        since = error.events if isinstance(error, RunFailed) else ()
        outcome.events += len(since)
        logging.getLogger("ddgcli").warning("%s", error)
    except KeyboardInterrupt:
        status, outcome.interrupted = "interrupted", True
    finally:
        outcome.seconds = earlier + perf_counter() - began
        keep.finish()
        if writer is not None:
            with run.timed("write"):
                left = writer.close(status, _rows(since))
            if left is not None:
                run.outputs.append(left)
    if outcome.interrupted:
        where = f"; go on with --resume {run.outputs[-1]}" if writer is not None and run.outputs else ""
        click.echo(f"Interrupted: {outcome.frames} whole frames{where}", err=True)
        click.get_current_context().exit(130)
    outcome.doubt = job.doubt(outcome)
    _write_last(run, outcome, cell, [p for p in run.common.outputs if p not in paths])
    return outcome


def _opened(
    run: Run, job: Job, paths: list[str], cell: dict[str, NDArray], keep: FrameRecorder
) -> tuple[Any, tuple[int, Arrays] | None]:
    """The trajectory's writer, if one is asked for, and where to go on from."""
    if len(paths) > 1:
        raise ParameterError("one run writes one trajectory; give one .vtkhdf or .h5")
    if job.resume is not None and not paths and not job.resume.endswith(".part"):
        raise ParameterError(f"{job.resume}: cannot be resumed; its name must end in .part")
    target = paths[0] if paths else (job.resume or "").removesuffix(".part")
    if not target:
        return None, None
    from ddgcli.io.trajectories.layout import Header
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.io.trajectories.writer import TrajectoryWriter

    provenance = {"version": __version__, **{k: v for k, v in run.metadata.items() if k != "version"}}
    header = Header(keep.outcome.mesh, job.moving, cell, {**provenance, **job.attributes}, dict(job.texts))
    if job.resume is None:
        return TrajectoryWriter(target, header, job.schedule.frames), None
    with Trajectory(job.resume) as part:
        start = (part.n_frames - 1, part.checkpoint())
        keep.outcome.stopped = stop_reason(start[1])
        job.account.restore(part.effects)
        keep.frames(part.frame(k) for k in range(part.n_frames))
        keep.outcome.events = part.log_rows - 1  # the first row tells of the start
    return TrajectoryWriter.resume(job.resume, target, header, job.schedule.frames), start


def _march(run: Run, job: Job, keep: FrameRecorder, writer: Any, start: tuple[int, Arrays] | None) -> None:
    told = run.progress("frames")
    for snapshot in evolve(job.models, job.schedule, job.account, start, told):
        with job.account.within("output"):
            frame = joined_frame(snapshot)
            keep.add(frame, snapshot)
            if writer is not None:
                log = _rows(snapshot.events)
                writer.append(frame, snapshot.checkpoint, _effect_rows(job.account), log)


def _rows(events: Iterable[Event]) -> list[tuple]:
    return [(e.step, e.time, e.kind, e.place, e.value, e.detail) for e in events]


def _effect_rows(account: Account) -> list[tuple[str, int, float]]:
    """Every name has a row from the first frame on, so that the file keeps its layout."""
    rows = account.rows()
    for name in ("integrator", "solver", "output"):
        rows.setdefault(name, (0, 0.0))
    return [(name, calls, seconds) for name, (calls, seconds) in rows.items()]


def _write_last(run: Run, outcome: Outcome, cell: dict[str, NDArray], paths: list[str]) -> None:
    """The last frame as a mesh, marked as not converged where the run broke off."""
    last = outcome.last
    if last is None:
        return
    shown = outcome.mesh if last.points is None else outcome.mesh.moved(last.points)
    annotated = AnnotatedMesh(shown, vertex=last.vertex, face=cell)
    for path in paths:
        run.write_file(path, annotated, converged=not (outcome.failure or outcome.doubt))


def shares(account: Account, effects: list[str], total: float) -> tuple[dict[str, Any], dict[str, float]]:
    """(`results.effects`, `results.seconds_by_part`): who spent the seconds of the loop."""
    booked = {name: account.seconds.get(name, 0.0) for name in (*effects, "solver", "integrator", "output")}
    ran_first = sorted(effects, key=lambda name: not account.calls.get(name))
    found = {
        name: {
            "seconds": booked[name],
            "share": booked[name] / (total or 1.0),
            "evaluations": account.calls.get(name, 0),
        }
        for name in ran_first
    }
    return found, {**booked, "unaccounted": total - sum(booked.values()), "total": total}
