"""Willmore flow: energy at a fixed time by step, against a small-step reference."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.evolve.account import Account
from ddgcli.evolve.loop import evolve
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.flow import Stop
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_each

STEPS = (2, 4, 8, 16)
FINE, FINER = 32, 64


def problem(mesh: TriangleMesh, *, duration: float | None = None, **_: Any) -> Problem:
    """Energy after a fixed time, by default a thousandth of the fourth power of the surface's radius."""
    radius = float(np.sqrt(face_area(mesh.side_length).sum() / (4 * np.pi)))
    span = duration or 1e-3 * radius**4
    return Problem(
        candidates=[_candidate(mesh, span, steps) for steps in STEPS],
        references=[(0.0, lambda: _reference(mesh, span))],
        error=relative_to_each,
        error_scale="the energy of the reference",
        place="energy",
        query=f"run of {span:g}",
    )


def _prepared(mesh: TriangleMesh, span: float, steps: int) -> Any:
    wishes = setup.Wishes("sullivan", "quadratic", "clamped", False, False, True, Stop())
    flow, model = setup.build(mesh, wishes)
    return model, setup.schedule(flow, {"step": span / steps, "duration": span, "frame_every": span})


def _energy(prepared: Any) -> NDArray[np.float64]:
    model, schedule = prepared
    last = None
    for snapshot in evolve({"surface": model}, schedule, Account()):
        last = snapshot.observations["surface"].scalar["energy"]
    return np.array([last], dtype=np.float64)


def _candidate(mesh: TriangleMesh, span: float, steps: int) -> Candidate:
    return Candidate(
        "quadratic",
        {"dt": span / steps},
        lambda: _prepared(mesh, span, steps),
        _energy,
        f"--dt {span / steps:g} --duration {span:g}",
        steps * (1e-2 + 1e-5 * mesh.n_faces),
    )


def _reference(mesh: TriangleMesh, span: float) -> Reference:
    fine, finer = (_energy(_prepared(mesh, span, steps)) for steps in (FINE, FINER))
    gap = float(np.abs(finer - fine).max() / np.abs(finer).max())
    return Reference(f"{FINER} steps", finer, gap)
