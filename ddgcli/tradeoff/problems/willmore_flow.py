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
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference, relative_to_each

WISHES = ("flow", "energy", "boundary", "fix_area", "fix_volume")
STEPS = (2, 4, 8, 16)
TOLERANCES = (1e-3, 1e-4, 1e-5)
FINE, FINER = 32, 64


def problem(mesh: TriangleMesh, *, asked: Asked = NOTHING, **_: Any) -> Problem:
    """Energy after a fixed time, by default a thousandth of the fourth power of the surface's radius.

    `asked` may hold `duration`, `steps`, `step`, `tolerance`, `flow`, `energy`, `boundary`, `fix_area`,
    `fix_volume`.
    """
    radius = float(np.sqrt(face_area(mesh.side_length).sum() / (4 * np.pi)))
    kept = {name: asked[name] for name in WISHES if name in asked}
    curvature = kept.get("flow") == "mean-curvature"
    span = asked.get("duration") or (1e-2 * radius**2 if curvature else 1e-3 * radius**4)
    if "step" in asked:
        span = asked["step"] * asked["steps"] if "steps" in asked else asked.get("duration", span)
        counts = sorted({max(1, round(span / (asked["step"] * f))) for f in (4.0, 2.0, 1.0, 0.5)})
    else:
        counts = [asked["steps"]] if "steps" in asked else list(STEPS)
    tolerances = (asked["tolerance"],) if "tolerance" in asked else TOLERANCES
    work = 1e-2 + 1e-5 * mesh.n_faces
    return Problem(
        candidates=[
            *(_candidate(mesh, kept, span, {"step": span / n}, n * work) for n in counts),
            *(_candidate(mesh, kept, span, {"tolerance": t}, 4 * t**-0.3 * work) for t in tolerances),
        ],
        references=[
            ((FINE + FINER) * work, lambda: _reference(mesh, kept, span, FINE, FINER)),
            (24 * work, lambda: _reference(mesh, kept, span, 8, 16)),
            (6 * work, lambda: _reference(mesh, kept, span, 2, 4)),
        ],
        error=relative_to_each,
        error_scale=f"the energy of the reference at t = {span:.6g}",
        place="energy",
        query=f"run of {span:.3g}",
    )


def _prepared(mesh: TriangleMesh, kept: Asked, span: float, dial: Asked) -> Any:
    flow, model = setup.build(mesh, setup.Wishes(**{"timed": True, **kept}))
    return model, setup.schedule(flow, {**dial, "duration": span, "frame_every": span})


def _energy(prepared: Any) -> NDArray[np.float64]:
    model, schedule = prepared
    last = None
    for snapshot in evolve({"surface": model}, schedule, Account()):
        last = snapshot.observations["surface"].scalar["energy"]
    return np.array([last], dtype=np.float64)


def _candidate(
    mesh: TriangleMesh, kept: Asked, span: float, dial: dict[str, float], work: float
) -> Candidate:
    name, value = next(iter(dial.items()))
    option = {"step": "--dt", "tolerance": "--tolerance"}[name]
    return Candidate(
        kept.get("flow", "quadratic") + (" adaptive" if name == "tolerance" else ""),
        {option.removeprefix("--"): value},
        lambda: _prepared(mesh, kept, span, dial),
        _energy,
        f"{option} {value!r} --duration {span!r} --frame-every {span!r}",
        work,
    )


def _reference(mesh: TriangleMesh, kept: Asked, span: float, coarse: int, fine: int) -> Reference:
    found, limit = (_energy(_prepared(mesh, kept, span, {"step": span / n})) for n in (coarse, fine))
    gap = float(np.abs(limit - found).max() / np.abs(limit).max())
    return Reference(f"{fine} steps, as far as {coarse} agree", limit, gap)
