"""What a simulation leaves behind for its summary and its picture, gathered frame by frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mesh.fields import Frame
from ddgcli.simulation.time_loop import Snapshot

PICTURE_FRAMES = 4  # frames in a picture


@dataclass(eq=False)
class Outcome:
    """What a run left behind.

    Parameters
    ----------
    frames : int
    last : Frame
    series : dict of str to (T, ...) ndarray
        Scalars of every frame.
    times : (T,) ndarray
    largest : dict of str to float
        Largest absolute value over the run of every vertex array.
    stopped : str
        Why the model ended the run early, or "".
    failure : str
        Why it broke off, or "".
    doubt : str
        Why what came out is not to be trusted, or "".
    interrupted : bool
    seconds : float
        Of the loop, those before a `--resume` too.
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
    last: Frame | None = None
    series: dict[str, NDArray] = field(default_factory=dict)
    times: NDArray = field(default_factory=lambda: np.zeros(0))
    largest: dict[str, float] = field(default_factory=dict)
    stopped: str = ""
    failure: str = ""
    doubt: str = ""
    interrupted: bool = False
    seconds: float = 0.0
    steps: int = 0
    smallest_step: float = np.inf
    events: int = 0
    kept: list[Frame] = field(default_factory=list)
    mesh: Any = None

    @property
    def end(self) -> Frame:
        """The last frame.

        Raises
        ------
        SolveError
            When there is none: the run broke off before its start was observed.
        """
        if self.last is None:
            raise SolveError(self.failure or "the run broke off before its first frame")
        return self.last


class FrameRecorder:
    """Gathers the scalars of the frames; keeps a few frames for a picture, not all.

    Parameters
    ----------
    outcome : Outcome
        Filled as the frames come.
    picture : bool
        Whether frames are kept: at most 2 PICTURE_FRAMES of them at any time, evenly spread over those so
        far (a run that may stop early does not know their number beforehand).
    """

    def __init__(self, outcome: Outcome, picture: bool) -> None:
        self.outcome, self.picture, self.stride = outcome, picture, 1
        self.rows: list[dict[str, Any]] = []
        self.times: list[float] = []

    def frames(self, frames: Iterable[Frame]) -> None:
        """Frames of an earlier part of the run."""
        for frame in frames:
            self._note(frame)

    def add(self, frame: Frame, snapshot: Snapshot) -> None:
        """A frame of this run."""
        self._note(frame)
        outcome = self.outcome
        outcome.steps, outcome.smallest_step = snapshot.steps, snapshot.smallest_step
        outcome.events += len(snapshot.events)
        outcome.stopped = snapshot.stopped

    def _note(self, frame: Frame) -> None:
        outcome = self.outcome
        outcome.last = frame
        if self.picture and outcome.frames % self.stride == 0:
            outcome.kept.append(frame)
            if len(outcome.kept) > 2 * PICTURE_FRAMES:
                outcome.kept, self.stride = outcome.kept[::2], 2 * self.stride
        outcome.frames += 1
        self.times.append(frame.time)
        self.rows.append(frame.scalar)
        for name, values in frame.vertex.items():
            if values.size and values.dtype.kind == "f":
                outcome.largest[name] = max(outcome.largest.get(name, 0.0), float(np.abs(values).max()))

    def finish(self) -> None:
        """Scalars as series over the frames; the frames of the picture chosen, the first and the last too."""
        outcome, names = self.outcome, self.rows[0] if self.rows else {}
        outcome.series = {n: np.array([row.get(n, np.nan) for row in self.rows]) for n in names}
        outcome.times = np.array(self.times)
        kept = outcome.kept
        if outcome.last is not None and kept and kept[-1] is not outcome.last:
            kept.append(outcome.last)
        if len(kept) > PICTURE_FRAMES:
            outcome.kept = [
                kept[k] for k in np.linspace(0, len(kept) - 1, PICTURE_FRAMES).round().astype(int)
            ]
