"""Interrupted simulations of random calls: resumed, they end with the frames of the unbroken run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol
from unittest.mock import patch

import numpy as np

from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.io.trajectories.writer import TrajectoryWriter

INTERRUPTED = 130  # exit code
TRAJECTORY, BROKEN = "run.vtkhdf", "broken.vtkhdf"


class Outcome(Protocol):
    """Outcome of a call."""

    @property
    def words(self) -> list[str]:
        """Words of the call."""
        ...

    @property
    def line(self) -> str:
        """The call as a line for a shell."""
        ...

    @property
    def exit_code(self) -> int:
        """Exit code."""
        ...

    @property
    def error(self) -> str:
        """The line of the error, without its beginning."""
        ...


@contextmanager
def interrupted_after(n_frames: int) -> Iterator[None]:
    """The writer of trajectories is interrupted where it would add one frame more."""
    append, written = TrajectoryWriter.append, []

    def interrupted(self: TrajectoryWriter, *arguments: Any) -> None:
        if len(written) == n_frames:
            raise KeyboardInterrupt
        append(self, *arguments)
        written.append(None)

    with patch.object(TrajectoryWriter, "append", interrupted):
        yield


def resume_fault(unbroken: Outcome, run: Callable[[list[str]], Outcome], folder: Path, n_frames: int) -> str:
    """What differs between the trajectory of a run and the same run resumed; "" where nothing does.

    Parameters
    ----------
    unbroken : Outcome
        The run, with a trajectory TRAJECTORY.
    run : callable
        Runs words.
    folder : Path
    n_frames : int
        Frames after which the run is interrupted.
    """
    if TRAJECTORY not in unbroken.words or "--resume" in unbroken.words:
        return ""
    words = [BROKEN if word == TRAJECTORY else word for word in unbroken.words if word != "--json"]
    with interrupted_after(n_frames):
        broken = run(words)
    if broken.exit_code != INTERRUPTED:
        return ""  # it has no more frames
    if not (folder / f"{BROKEN}.part").is_file():
        return f"{broken.line}: interrupted after {n_frames} frames, without a file of them"
    resumed = run([*words, "--resume", f"{BROKEN}.part"])
    if resumed.exit_code != unbroken.exit_code:
        return (
            f"{resumed.line}: exit code {resumed.exit_code}, unbroken {unbroken.exit_code}: {resumed.error}"
        )
    paths = [_written(folder / name) for name in (TRAJECTORY, BROKEN)]
    difference = _difference(*paths)
    return f"{resumed.line}: {difference} after {n_frames} frames" if difference else ""


def _written(path: Path) -> Path:
    """A trajectory, or what a failed run left of it."""
    return path if path.is_file() else path.with_name(f"{path.name}.part")


def _difference(unbroken: Path, resumed: Path) -> str:
    """First bits of the frames that differ."""
    with Trajectory(str(unbroken)) as a, Trajectory(str(resumed)) as b:
        if a.n_frames != b.n_frames:
            return f"{b.n_frames} frames in place of {a.n_frames}"
        for k in range(a.n_frames):
            arrays = [
                {"time": run.times[k], "points": run.points(k), **run.vertex(k),
                 **{name: values[k] for name, values in run.scalars.items()}}
                for run in (a, b)
            ]  # fmt: skip
            for name in arrays[0].keys() | arrays[1].keys():
                if not _equal(*(each.get(name) for each in arrays)):
                    return f"{name} of frame {k} differs"
    return ""


def _equal(a: object, b: object) -> bool:
    return a is not None and b is not None and np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
