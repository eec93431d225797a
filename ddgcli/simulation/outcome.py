"""Outcome of a simulation: the data of its summary and its picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.simulation.model import Ending, Event


@dataclass(eq=False)
class Outcome:
    """Outcome of a run.

    Parameters
    ----------
    n_frames : int
        Number of whole frames, with those of the run that was resumed.
    last : TrajectoryFrame
    series : dict of str to (T, ...) ndarray
        Scalars of every frame.
    times : (T,) ndarray
    largest : dict of str to float
        Largest absolute value over the run of every vertex array.
    ending : Ending or None
        Why the model ended the run early.
    status : {'failed', 'complete', 'interrupted'}
    failure : str
        Why the run failed, or "".
    last_events : tuple of Event
        Events of a failed run since its last frame.
    failure_reason : str
        Reason why the result is unreliable, or "".
    seconds : float
        Time of the loop, with that of the run that was resumed.
    steps : int
    smallest_step : float
    frame_limited_steps : int
        Adaptive steps that would have passed the time of a frame, where they end.
    rejected_steps : int
        Steps that failed; those that were only divided at a known limit do not count.
    picture_frames : list of TrajectoryFrame
        A few frames, spread over the run.
    mesh : TriangleMesh
        All surfaces as one.
    final_vertex : dict of str to (n, ...) ndarray
        Vertex arrays that are computed for the last frame alone, such as eigenmodes.
    """

    n_frames: int = 0
    last: TrajectoryFrame | None = None
    series: dict[str, NDArray] = field(default_factory=dict)
    times: NDArray = field(default_factory=lambda: np.zeros(0))
    largest: dict[str, float] = field(default_factory=dict)
    ending: Ending | None = None
    status: str = "failed"
    failure: str = ""
    last_events: tuple[Event, ...] = ()
    failure_reason: str = ""
    seconds: float = 0.0
    steps: int = 0
    smallest_step: float = np.inf
    frame_limited_steps: int = 0
    rejected_steps: int = 0
    picture_frames: list[TrajectoryFrame] = field(default_factory=list)
    mesh: Any = None
    final_vertex: dict[str, NDArray] = field(default_factory=dict)

    @property
    def step_counts(self) -> dict[str, Any]:
        """Fields of the results that count steps; `frame_limited_steps` where frames made some shorter."""
        return {
            "steps": self.steps,
            **({"smallest_step": self.smallest_step} if self.steps else {}),
            **({"frame_limited_steps": self.frame_limited_steps} if self.frame_limited_steps else {}),
            "rejected_steps": self.rejected_steps,
        }

    @property
    def stopped(self) -> str:
        """Text of the ending, or ""."""
        return "" if self.ending is None else self.ending.text

    @property
    def end(self) -> TrajectoryFrame:
        """The last frame.

        Raises
        ------
        SolveError
            There is none: the run failed before its start was observed.
        """
        if self.last is None:
            raise SolveError(self.failure or "the run failed before its first frame")
        return self.last
