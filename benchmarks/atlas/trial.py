"""What the atlas measures: a truth, a family, and a problem at every rung of a ladder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_each


@dataclass(frozen=True, eq=False)
class Trial:
    """One rung: its faces, its mesh size (in a ladder of steps: the step), its problem, and peers to it."""

    faces: int
    h: float
    problem: Problem
    peers: Callable[[], Sequence[Candidate]] = list


@dataclass(frozen=True, eq=False)
class Case:
    """A truth, a family of meshes or steps, and the trial at every level."""

    truth: str
    family: str
    trial: Callable[[int], Trial]


def known_truth(
    faces: int, h: float, truth: Any, candidates: Sequence[Candidate], error: Any = relative_to_each
) -> Trial:
    """A trial whose truth is known."""
    values = np.atleast_1d(np.asarray(truth, dtype=np.float64))
    reference = Reference("known truth", values, 0.0, known=True)
    return Trial(faces, h, Problem(candidates, [(0.0, lambda: reference)], error, "the truth"))


def last_frame(prepared: Any) -> Any:
    """The last frame of a run, of its only object."""
    models, schedule, account = prepared
    shown = None
    for snapshot in evolve(models, schedule, account):
        shown = next(iter(snapshot.observations.values()))
    return shown
