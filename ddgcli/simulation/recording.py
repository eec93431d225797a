"""Run models to the end and record their frames."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from time import perf_counter
from typing import Any

import numpy as np

from ddgcli.errors import SolveError
from ddgcli.mesh.fields import TrajectoryFrame, frames_of_equal_change
from ddgcli.progress import ProgressCallback
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_frame
from ddgcli.simulation.model import Arrays, Model, RunFailed, Schedule, rejections
from ddgcli.simulation.outcome import Outcome
from ddgcli.simulation.time_loop import Snapshot, evolve

MAX_PICTURE_FRAMES = 4
MAX_STORED_FRAMES = 40  # of which the picture's are chosen at the end


class Recorder:
    """Collect the scalars of all frames, and a few whole frames for a picture.

    Parameters
    ----------
    outcome : Outcome
        Updated with every frame.
    picture : bool
        Whether frames are kept: at most MAX_STORED_FRAMES at any time, evenly spread over the frames so
        far, because the number of frames of a run that stops early is unknown beforehand. At the end
        those between which the motion changes equally remain.
    """

    def __init__(self, outcome: Outcome, picture: bool) -> None:
        self.outcome, self.picture, self.stride = outcome, picture, 1
        self.rows: list[dict[str, Any]] = []
        self.times: list[float] = []

    def restore(self, trajectory_frames: Iterable[TrajectoryFrame]) -> None:
        """Record the frames of an earlier part of the run."""
        for trajectory_frame in trajectory_frames:
            self._record(trajectory_frame)

    def add(self, trajectory_frame: TrajectoryFrame, snapshot: Snapshot) -> None:
        """Record a frame of this run and the counts of its snapshot."""
        self._record(trajectory_frame)
        outcome = self.outcome
        outcome.steps, outcome.smallest_step = snapshot.steps, snapshot.smallest_step
        outcome.frame_limited_steps = snapshot.frame_limited_steps
        outcome.rejected_steps += rejections(event.kind for event in snapshot.events)
        outcome.ending = snapshot.ending

    def _record(self, trajectory_frame: TrajectoryFrame) -> None:
        outcome = self.outcome
        outcome.last = trajectory_frame
        if self.picture and outcome.n_frames % self.stride == 0:
            outcome.picture_frames.append(trajectory_frame)
            if len(outcome.picture_frames) > MAX_STORED_FRAMES:
                outcome.picture_frames, self.stride = outcome.picture_frames[::2], 2 * self.stride
        outcome.n_frames += 1
        self.times.append(trajectory_frame.time)
        self.rows.append(trajectory_frame.scalar)
        for name, values in trajectory_frame.vertex.items():
            if values.size and values.dtype.kind == "f":
                outcome.largest[name] = max(outcome.largest.get(name, 0.0), float(np.abs(values).max()))

    def finish(self) -> None:
        """Store the scalars as series over the frames; thin the picture's frames, keeping first and last."""
        outcome, names = self.outcome, self.rows[0] if self.rows else {}
        outcome.series = {n: np.array([row.get(n, np.nan) for row in self.rows]) for n in names}
        outcome.times = np.array(self.times)
        trajectory_frames = outcome.picture_frames
        if outcome.last is not None and trajectory_frames and trajectory_frames[-1] is not outcome.last:
            trajectory_frames.append(outcome.last)
        if len(trajectory_frames) > MAX_PICTURE_FRAMES:
            values = [
                next(iter(trajectory_frame.vertex.values()), None) for trajectory_frame in trajectory_frames
            ]
            numbers = frames_of_equal_change(
                [trajectory_frame.points for trajectory_frame in trajectory_frames],
                values,
                MAX_PICTURE_FRAMES,
            )
            outcome.picture_frames = [trajectory_frames[k] for k in numbers]


def run_models(
    models: Mapping[str, Model],
    schedule: Schedule,
    account: Account,
    recorder: Recorder,
    *,
    resume: tuple[int, Arrays] | None = None,
    write_frame: Callable[[TrajectoryFrame, Snapshot], None] | None = None,
    progress: ProgressCallback | None = None,
) -> Outcome:
    """Run models to the end, to a failure or to an interruption from the keyboard.

    Parameters
    ----------
    models, schedule, account, resume, progress
        As in `evolve`.
    recorder : Recorder
        Its outcome is filled and returned; it is complete up to the last frame on any exception too.
    write_frame : callable (frame, snapshot), optional
        Called after each frame; its time is booked as "output".

    Returns
    -------
    Outcome
        A failed step is reported in `status`, `failure` and `last_events`, and is not raised.
    """
    outcome = recorder.outcome
    earlier, began = sum(account.seconds.values()), perf_counter()
    try:
        for snapshot in evolve(models, schedule, account, resume, progress):
            with account.within("output"):
                trajectory_frame = joined_frame(snapshot)
                recorder.add(trajectory_frame, snapshot)
                if write_frame is not None:
                    write_frame(trajectory_frame, snapshot)
        outcome.status = "complete"
    except SolveError as error:
        outcome.failure = str(error)
        outcome.last_events = error.events if isinstance(error, RunFailed) else ()
        outcome.rejected_steps += rejections(event.kind for event in outcome.last_events)
        logging.getLogger("ddgcli").error("%s", error)
    except KeyboardInterrupt:
        outcome.status = "interrupted"
    finally:
        outcome.seconds = earlier + perf_counter() - began
        recorder.finish()
    return outcome
