"""Willmore flow: what it lowers, at a fixed time by step, against a small-step reference."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference, relative_to_each
from ddgcli.tradeoff.richardson import left_to_go

WISHES = ("flow", "energy", "boundary", "fix_area", "fix_volume")
STEPS = (2, 4, 8, 16)
TOLERANCES = (1e-3, 1e-4, 1e-5)
FINEST = (64, 16, 8)  # steps of the references; 1/2, 1/4 and 1/8 of them tell how sure they are


def problem(mesh: TriangleMesh, *, asked: Asked = NOTHING, **_: Any) -> Problem:
    """Energy (of `mean-curvature`, which lowers the area, that) after a fixed time.

    By default a thousandth of the fourth power of the surface's radius, a hundredth of its square.

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
    lowered = "area" if curvature else "energy"
    work = 1e-2 + 1e-5 * mesh.n_faces
    wished = setup.FlowOptions(flow=flow, timed=True, integrator=asked.get("integrator"))
    schemes = (setup.chosen_scheme(wished),) if wished.integrator else setup.schemes_of(flow)
    return Problem(
        candidates=[
            *(_candidate(mesh, kept, span, s, {"step": span / n}, n * work) for n in counts for s in schemes),
            *(
                _candidate(mesh, kept, span, schemes[0], {"tolerance": t}, 4 * t**-0.3 * work)
                for t in tolerances
            ),
        ],
        references=[(1.875 * steps * work, partial(_reference, mesh, kept, span, steps)) for steps in FINEST],
        error=relative_to_each,
        error_scale=f"the {lowered} of the reference at t = {span:.6g}",
        place=lowered,
        query=f"run of {span:.3g}",
    )


def _prepared(mesh: TriangleMesh, kept: Asked, span: float, dial: Asked) -> Any:
    flow, model = setup.build(mesh, setup.FlowOptions(**{"timed": True, **kept}))
    schedule = setup.schedule(flow, {**dial, "duration": span, "frame_every": span})
    return model, schedule, "area" if flow.mean_curvature else "energy"


def _answer(prepared: Any) -> NDArray[np.float64]:
    """What the flow lowers, at the end."""
    model, schedule, name = prepared
    last = None
    for snapshot in evolve({"surface": model}, schedule, Account()):
        last = snapshot.observations["surface"].scalar[name]
        if snapshot.stopped:
            raise SolveError(f"the flow ends at time {snapshot.time:.4g}: {snapshot.stopped}")
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
        _answer,
        f"--integrator {scheme} {option} {value!r} --duration {span!r} --frame-every {span!r}",
        work,
    )


def _reference(mesh: TriangleMesh, kept: Asked, span: float, steps: int) -> Reference:
    counts = [steps // 8, steps // 4, steps // 2, steps]
    runs = [float(_answer(_prepared(mesh, kept, span, {"step": span / n}))[0]) for n in counts]
    order = 1.0 if kept.get("flow") == "mean-curvature" else 2.0
    gap = left_to_go(*(b - a for a, b in itertools.pairwise(runs)), order=order) / abs(runs[-1])
    name = f"{steps} steps, as far as {counts[2]}, {counts[1]} and {counts[0]} agree"
    return Reference(name, np.array(runs[-1:]), gap)
