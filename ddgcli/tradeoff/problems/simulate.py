"""Simulators: integrators and steps, against a small-step reference whose own error its two steps show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.scenes.scene import Document, SceneKind, resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import NOTHING, Asked, Candidate, Problem, Reference
from ddgcli.tradeoff.richardson import left_to_go

# steps of the candidates, in the scene's own step; those of the reference
COARSER = (4.0, 2.0, 1.0, 0.5)
FINEST = (1 / 8, 1 / 2, 2.0)
TOLERANCES = (1e-3, 1e-5)
TIMES = ("steps", "duration", "step", "tolerance", "integrator")
MOST_STEPS = 16  # of the scene's own length: beyond, errors measure chaos more than schemes


def shell_problem(document: Document, read: Callable[[str], Any], *, asked: Asked = NOTHING) -> Problem:
    """Positions of a shell scene at the end."""
    from ddgcli.models.shell import model
    from ddgcli.models.shell.scene import KIND

    def prepared(overrides: Mapping[str, Any]) -> Callable[[], Any]:
        def setup() -> Any:
            scene = resolve(document, KIND, overrides)
            account = Account()
            shells = {n: context for n, (context, _) in model.contexts(scene, read).items()}
            return model.build(scene, shells, account), scene.schedule(), account

        return setup

    names = [n for n in KIND.integrators if n != "static"]
    return _problem(document, KIND, prepared, names, "newmark", asked, _displacement, "displacement")


def fluid_problem(
    document: Document, read: Callable[[str], Any], array: Callable[[str], NDArray], *, asked: Asked = NOTHING
) -> Problem:
    """Vorticity of a fluid scene at the end."""
    from ddgcli.models.fluid import model
    from ddgcli.models.fluid.scene import KIND

    def prepared(overrides: Mapping[str, Any]) -> Callable[[], Any]:
        def setup() -> Any:
            scene = resolve(document, KIND, overrides)
            account = Account()
            fluids = {n: context for n, (context, _) in model.contexts(scene, read, array).items()}
            built = model.build(scene, fluids, account)
            return {n: fluid.model() for n, fluid in built.items()}, scene.schedule(), account

        return setup

    return _problem(
        document, KIND, prepared, list(KIND.integrators), "conservative", asked, _vorticity, "vorticity"
    )


def _displacement(first: Any, last: Any) -> NDArray[np.float64]:
    moved = [last[name].points - first[name].points for name in first]
    return np.concatenate(moved)


def _vorticity(first: Any, last: Any) -> NDArray[np.float64]:
    return np.concatenate([last[name].vertex["vorticity"] for name in last])


def _problem(
    document: Document,
    kind: SceneKind,
    prepared: Callable[[Mapping[str, Any]], Callable[[], Any]],
    integrators: list[str],
    trusted: str,
    asked: Asked,
    answer: Callable[[Any, Any], NDArray],
    noun: str,
) -> Problem:
    """`asked` may hold `steps`, `duration`, `step` (the one that the ladder is built about), `integrator` and
    `tolerance`."""
    time = resolve(document, kind, {name: asked[name] for name in TIMES if name in asked}).time
    step = asked.get("step") or time.step or time.duration / 50
    wanted = asked["steps"] * step if "steps" in asked else asked.get("duration")
    span = wanted or min(time.duration, MOST_STEPS * step)
    span = max(span, 2 * step)
    counts = sorted({max(1, round(span / (step * factor))) for factor in COARSER})
    chosen = [asked["integrator"]] if "integrator" in asked else integrators
    tolerances = (asked["tolerance"],) if "tolerance" in asked else TOLERANCES
    adaptive = chosen[0] if "integrator" in asked else trusted

    steps = span / step

    def solve(models_and_clock: Any) -> NDArray[np.float64]:
        models, schedule, account = models_and_clock
        shown = [snapshot.observations for snapshot in evolve(models, schedule, account)]
        return answer(shown[0], shown[-1])

    def run(integrator: str, dial: Mapping[str, float]) -> Callable[[], Any]:
        ends = {"duration": span, "frame_every": span}
        return prepared({"integrator": integrator, **dial, **ends})

    def candidate(integrator: str, option: str, value: float, work: float) -> Candidate:
        dial = {{"dt": "step"}.get(option, option): value}
        words = f"--integrator {integrator} --{option} {value!r} --duration {span!r} --frame-every {span!r}"
        line = integrator + (" adaptive" if option == "tolerance" else "")
        return Candidate(line, {option: value}, run(integrator, dial), solve, words, work)

    def reference(finest: float) -> Reference:
        coarse, middle, limit = (
            solve(run(trusted, {"step": span / max(1, round(steps / f))})())
            for f in (4 * finest, 2 * finest, finest)
        )
        first, second = _relative(coarse, middle), _relative(middle, limit)
        name = f"{trusted} with {finest:g} of the scene's step"
        name += f", as far as {2 * finest:g} and {4 * finest:g} agree"
        largest = left_to_go(first.max(initial=0.0), second.max(initial=0.0))
        mean = left_to_go(first.mean(), second.mean())
        return Reference(name, limit, largest, mean_uncertainty=mean)

    unit = 1e-2 * steps
    candidates = [
        *(candidate(name, "dt", span / n, unit * n / steps) for n in counts for name in chosen),
        *(candidate(adaptive, "tolerance", t, 3 * unit * (1e-3 / t) ** (1 / 3)) for t in tolerances),
    ]
    return Problem(
        candidates=candidates,
        references=[(1.75 * unit / finest, partial(reference, finest)) for finest in FINEST],
        error=_relative,
        error_scale=f"the largest {noun} of the reference at t = {span:.6g} s",
        query=f"run of {span:.3g} s",
    )


def _relative(found: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Length of the difference at each vertex over the largest of the truth."""
    difference, size = found - truth, truth
    if truth.ndim == 2:
        difference, size = np.linalg.norm(difference, axis=1), np.linalg.norm(truth, axis=1)
    error = np.abs(difference) / (np.abs(size).max(initial=0.0) or 1.0)
    return np.nan_to_num(error, nan=np.inf)
