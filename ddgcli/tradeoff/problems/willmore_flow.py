"""Willmore flow: energy at a fixed time by step, against a small-step reference."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.evolve.account import Account
from ddgcli.evolve.loop import evolve
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference, relative_to_each
from ddgcli.tradeoff.richardson import left_to_go

WISHES = ("flow", "energy", "boundary", "fix_area", "fix_volume")
STEPS = (2, 4, 8, 16)
TOLERANCES = (1e-3, 1e-4, 1e-5)
FINEST = (64, 16, 4)  # steps of the references; half and a quarter of them tell how sure they are


def problem(mesh: TriangleMesh, *, asked: Asked = NOTHING, **_: Any) -> Problem:
    """Energy after a fixed time, by default a thousandth of the fourth power of the surface's radius.

    `asked` may hold `duration`, `steps`, `step`, `tolerance`, `integrator`, `flow`, `energy`, `boundary`,
    `fix_area`, `fix_volume`.
    """
    radius = float(np.sqrt(face_area(mesh.side_length).sum() / (4 * np.pi)))
    kept = {name: asked[name] for name in WISHES if name in asked}
    flow = kept.get("flow", "quadratic")
    curvature = flow == "mean-curvature"
    span = asked.get("duration") or (1e-2 * radius**2 if curvature else 1e-3 * radius**4)
    if "step" in asked:
        span = asked["step"] * asked["steps"] if "steps" in asked else asked.get("duration", span)
        counts = sorted({max(1, round(span / (asked["step"] * f))) for f in (4.0, 2.0, 1.0, 0.5)})
    else:
        counts = [asked["steps"]] if "steps" in asked else list(STEPS)
    tolerances = (asked["tolerance"],) if "tolerance" in asked else TOLERANCES
    work = 1e-2 + 1e-5 * mesh.n_faces
    wished = setup.Wishes(flow=flow, timed=True, integrator=asked.get("integrator"))
    schemes = (setup.chosen_scheme(wished),) if wished.integrator else setup.schemes_of(flow)
    return Problem(
        candidates=[
            *(_candidate(mesh, kept, span, s, {"step": span / n}, n * work) for n in counts for s in schemes),
            *(
                _candidate(mesh, kept, span, schemes[0], {"tolerance": t}, 4 * t**-0.3 * work)
                for t in tolerances
            ),
        ],
        references=[(1.75 * steps * work, partial(_reference, mesh, kept, span, steps)) for steps in FINEST],
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
    mesh: TriangleMesh, kept: Asked, span: float, scheme: str, dial: dict[str, float], work: float
) -> Candidate:
    name, value = next(iter(dial.items()))
    option = {"step": "--dt", "tolerance": "--tolerance"}[name]
    return Candidate(
        scheme + (" adaptive" if name == "tolerance" else ""),
        {option.removeprefix("--"): value},
        lambda: _prepared(mesh, {**kept, "integrator": scheme}, span, dial),
        _energy,
        f"--integrator {scheme} {option} {value!r} --duration {span!r} --frame-every {span!r}",
        work,
    )


def _reference(mesh: TriangleMesh, kept: Asked, span: float, steps: int) -> Reference:
    runs = [_energy(_prepared(mesh, kept, span, {"step": span / n})) for n in (steps // 4, steps // 2, steps)]
    first, second = (float(np.abs(b - a).max()) for a, b in itertools.pairwise(runs))
    gap = left_to_go(first, second) / float(np.abs(runs[-1]).max())
    return Reference(f"{steps} steps, as far as {steps // 2} and {steps // 4} agree", runs[-1], gap)
