"""Run a simulation: every frame into the trajectory, the last one as a mesh."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import click
from numpy.typing import NDArray

from ddgcli import __version__
from ddgcli.cli.interrupts import PARTIAL_RUN
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, counted, named_array
from ddgcli.mesh.fields import AnnotatedMesh, TrajectoryFrame
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import moved_rigidly
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_frame, joined_mesh, mesh_of_frame
from ddgcli.simulation.model import Arrays, Event, Model, Schedule, rejections
from ddgcli.simulation.outcome import Outcome
from ddgcli.simulation.recording import Recorder, run_models
from ddgcli.simulation.step_warnings import earlier_warnings
from ddgcli.simulation.time_loop import Snapshot, ending_of, evolve

log = logging.getLogger("ddgcli")
TRAJECTORIES = (".vtkhdf", ".h5")


@dataclass(frozen=True, eq=False)
class Job:
    """Models, schedule, and what the trajectory records about them.

    Parameters
    ----------
    models : mapping of str to Model
        In the order of `meshes`.
    meshes : list of TriangleMesh or IntrinsicMesh (with points)
    schedule : Schedule
    account : Account
        The account of the models.
    moving : bool
        Whether the surface moves.
    resume : str, optional
        The .part to continue.
    attributes, texts : mappings
        For the group `ddgcli`.
    face : mapping of str to (m, ...) ndarray
        Constant arrays on faces of the joined mesh.
    obstacles : mapping of str to TriangleMesh
        Bodies around the moving ones.
    obstacle_poses : callable time -> mapping of str to (12,) ndarray
        Rotation by rows and translation of each moving obstacle from its start.
    failure_reason : callable Outcome -> str
        Reason why a complete run is unreliable, or "".
    final : callable Outcome -> (dict, dict)
        Vertex and face arrays of the last frame, for meshes.
    final_names : sequence of str
        Names that these may have.
    changing_faces, changing_vertices : bool
        Whether the faces change, and the number of vertices.
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
    obstacles: Mapping[str, Any] = field(default_factory=dict)
    obstacle_poses: Callable[[float], Mapping[str, NDArray]] = lambda time: {}
    failure_reason: Callable[[Outcome], str] = lambda outcome: ""
    final: Callable[[Outcome], tuple[dict[str, NDArray], dict[str, NDArray]]] = lambda outcome: ({}, {})
    final_names: Sequence[str] = ()
    changing_faces: bool = False
    changing_vertices: bool = False

    def obstacles_at(self, time: float) -> list[TriangleMesh]:
        """The obstacles where they are at a time."""
        poses = self.obstacle_poses(time)
        return [
            mesh.moved_unchecked(moved_rigidly(mesh.points, poses[name])) if name in poses else mesh
            for name, mesh in self.obstacles.items()
        ]


def formats() -> tuple[str, ...]:
    """Extensions of -o: trajectories, and meshes for the last frame."""
    from ddgcli.io.mesh_file import WRITERS

    return (*TRAJECTORIES, *(suffix for suffix in WRITERS if suffix not in TRAJECTORIES))


def simulate(run: Run, job: Job) -> Outcome:
    """Run the models, write every frame to the trajectory and the last one as a mesh.

    The trajectory holds whole frames only, however the run ends.
    """
    mesh, cell = _joined(job)
    outcome = Outcome(mesh=mesh)
    recorder = Recorder(outcome, picture=bool(run.common.plot))
    paths = _trajectories(run)
    writer, start = _open_trajectory(run, job, paths, cell, recorder)

    def write_frame(trajectory_frame: TrajectoryFrame, snapshot: Snapshot) -> None:
        from ddgcli.io.trajectories.layout_check import OBSTACLE_POSE

        poses = {OBSTACLE_POSE + name: row for name, row in job.obstacle_poses(trajectory_frame.time).items()}
        scalar: dict[str, Any] = {**trajectory_frame.scalar, **poses}
        trajectory_frame = replace(trajectory_frame, scalar=scalar)
        writer.append(
            trajectory_frame, snapshot.checkpoint, _effect_rows(job.account), _rows(snapshot.events)
        )

    try:
        run_models(
            job.models, job.schedule, job.account, recorder, resume=start,
            write_frame=None if writer is None else write_frame, progress=run.progress("frames"),
        )  # fmt: skip
    finally:
        if writer is not None:
            with run.clock.timed("write"):
                partial_file = writer.close(outcome.status, _rows(outcome.last_events), run.staged)
            if partial_file is not None:
                run.outputs.append(partial_file)
                if outcome.status != "complete":
                    click.get_current_context().meta[PARTIAL_RUN] = partial_file
    if outcome.status == "interrupted":
        where = f"; continue with --resume {run.outputs[-1]}" if writer is not None and run.outputs else ""
        n_frames = outcome.n_frames if writer is None else writer.n_frames  # the last one may not be written
        count = counted(n_frames, "whole frame", "whole frames")
        click.echo(f"Interrupted: {count}{where}", err=True)
        click.get_current_context().exit(130)
    outcome.failure_reason = job.failure_reason(outcome)
    outcome.final_vertex, face = job.final(outcome)
    meshes = [p for p in run.common.outputs if p not in paths]
    _write_last(run, outcome, outcome.final_vertex, {**cell, **face}, meshes)
    return outcome


def check_job(run: Run, job: Job) -> None:
    """Raise the errors of `simulate` before its first step: outputs, and names of arrays."""
    paths = _trajectories(run)
    if len(paths) > 1:
        raise ParameterError("one run writes one trajectory; give one .vtkhdf or .h5")
    if job.resume is not None and not paths and not job.resume.endswith(".part"):
        raise ParameterError(f"{job.resume}: cannot be resumed; its name must end in .part")
    _check_array_names(run, job, _joined(job)[1])


def _trajectories(run: Run) -> list[str]:
    """Outputs that hold a trajectory."""
    return [path for path in run.common.outputs if Path(path).suffix.lower() in TRAJECTORIES]


def _joined(job: Job) -> tuple[Any, dict[str, NDArray]]:
    """The union of the meshes, and its constant arrays on faces."""
    mesh, number = joined_mesh(job.meshes)
    return mesh, {"object_id": number, **job.face} if len(job.meshes) > 1 else dict(job.face)


def _open_trajectory(
    run: Run, job: Job, paths: list[str], cell: dict[str, NDArray], recorder: Recorder
) -> tuple[Any, tuple[int, Arrays] | None]:
    """Writer of the trajectory and checkpoint to resume from; None where there is none."""
    target = paths[0] if paths else (job.resume or "").removesuffix(".part")
    if not target:
        return None, None
    from ddgcli.io.trajectories.layout import Header
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.io.trajectories.writer import TrajectoryWriter

    provenance = {"version": __version__, **{k: v for k, v in run.metadata.items() if k != "version"}}
    header = Header(
        recorder.outcome.mesh, job.moving, cell, {**provenance, **job.attributes}, dict(job.texts),
        dict(job.obstacles),
        job.changing_faces,
        job.changing_vertices,
    )  # fmt: skip
    if job.resume is None:
        return TrajectoryWriter(target, header, job.schedule.n_frames), None
    with Trajectory(job.resume) as partial_run:
        start = (partial_run.n_frames - 1, partial_run.checkpoint())
        recorder.outcome.ending = ending_of(start[1])
        job.account.restore(partial_run.effects)
        recorder.restore(_without_poses(partial_run.read_frame(k)) for k in range(partial_run.n_frames))
        rows = partial_run.log[: partial_run.log_rows]
        events = [
            (float(row["time"]), row["kind"].decode(), row["detail"].decode(errors="ignore")) for row in rows
        ]
    recorder.outcome.rejected_steps = rejections(kind for _, kind, _ in events)
    for warning in earlier_warnings(job.models, events, adaptive=job.schedule.tolerance is not None):
        log.warning(warning)
    return TrajectoryWriter.resume(job.resume, target, header, job.schedule.n_frames), start


def _check_array_names(run: Run, job: Job, cell: Mapping[str, NDArray]) -> None:
    """Raise ParameterError for an array of --show or --colors that frames do not have, before the run."""
    shown, coloured = run.common.show, run.common.colors
    if shown is None and coloured is None:
        return
    first = joined_frame(next(evolve(job.models, job.schedule, Account())))
    if shown is not None:
        named_array(first.vertex, shown, parameter="show")
    if coloured is not None and coloured not in job.final_names:
        named_array({**first.face, **cell, **first.vertex}, coloured, parameter="colors")


def _without_poses(trajectory_frame: TrajectoryFrame) -> TrajectoryFrame:
    """A frame of a trajectory as the models computed it: the poses of obstacles were added to the file."""
    from ddgcli.io.trajectories.layout_check import OBSTACLE_POSE

    own = {
        name: value for name, value in trajectory_frame.scalar.items() if not name.startswith(OBSTACLE_POSE)
    }
    return replace(trajectory_frame, scalar=own)


def _rows(events: Iterable[Event]) -> list[tuple]:
    return [(e.step, e.time, e.kind, e.place, e.value, e.detail) for e in events]


def _effect_rows(account: Account) -> list[tuple[str, int, float]]:
    """Rows of every name from the first frame on, so that the file keeps its layout."""
    rows = account.rows()
    for name in ("integrator", "solver", "output"):
        rows.setdefault(name, (0, 0.0))
    return [(name, calls, seconds) for name, (calls, seconds) in rows.items()]


def _write_last(
    run: Run, outcome: Outcome, vertex: dict[str, NDArray], cell: dict[str, NDArray], paths: list[str]
) -> None:
    """Write the last frame as a mesh, marked as not converged if the run failed."""
    last = outcome.last
    if last is None:
        return
    shown = mesh_of_frame(outcome.mesh, last)
    annotated = AnnotatedMesh(shown, vertex={**last.vertex, **vertex}, face={**last.face, **cell})
    for path in paths:
        run.write_file(path, annotated, converged=not (outcome.failure or outcome.failure_reason))
