"""Cases of the atlas: a truth, a mesh class, and a problem at every level of the sequence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_each


@dataclass(frozen=True, eq=False)
class Trial:
    """One level: faces, mesh size (for `steps` the step), problem, and peers."""

    faces: int
    h: float
    problem: Problem
    peers: Callable[[], Sequence[Candidate]] = list


@dataclass(frozen=True, eq=False)
class Case:
    """A truth, a mesh class of meshes or steps, and the trial at every level."""

    truth: str
    mesh_class: str
    trial: Callable[[int], Trial]


def known_truth(
    faces: int, h: float, truth: Any, candidates: Sequence[Candidate], error: Any = relative_to_each
) -> Trial:
    """A trial whose truth is known."""
    values = np.atleast_1d(np.asarray(truth, dtype=np.float64))
    reference = Reference("known truth", values, 0.0, is_truth=True)
    return Trial(faces, h, Problem(candidates, [(0.0, lambda: reference)], error, "the truth"))


def last_frame(prepared: Any) -> Any:
    """The last frame of a run, of its only object."""
    models, schedule, account = prepared
    last = None
    for snapshot in evolve(models, schedule, account):
        last = next(iter(snapshot.observations.values()))
    return last
