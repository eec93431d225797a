"""Simulators: integrators and steps, against a run with a small step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.scenes.scene import SceneKind, resolve
from ddgcli.scenes.sections import Document
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import NO_OPTIONS, Candidate, CommandOptions, Problem, Reference
from ddgcli.tradeoff.richardson import remaining_error

# steps of the candidates and of the references, in units of the scene's step
STEP_FACTORS = (4.0, 2.0, 1.0, 0.5)
REFERENCE_STEP_FACTORS = (1 / 8, 1 / 2, 2.0)
TOLERANCES = (1e-3, 1e-5)
TIME_OPTIONS = ("steps", "duration", "step", "tolerance", "integrator")
ObservationSeries = Sequence[Mapping[str, Any]]  # observations by object, of each frame
MAX_STEPS = 16  # of the scene's own length: later, chaos dominates the errors


def shell_problem(
    document: Document, read: Callable[[str], Any], *, options: CommandOptions = NO_OPTIONS
) -> Problem:
    """Positions of a shell scene at the end."""
    from ddgcli.models.shell import model
    from ddgcli.models.shell.scene import KIND

    def setup_of(overrides: Mapping[str, Any]) -> Callable[[], Any]:
        def setup() -> Any:
            scene = resolve(document, KIND, overrides)
            account = Account()
            shells = {n: context for n, (context, _) in model.contexts(scene, read).items()}
            return model.build(scene, shells, account), scene.schedule(), account

        return setup

    names = [n for n in KIND.integrators if n != "static"]
    return _problem(document, KIND, setup_of, names, "newmark", options, _displacement, "displacement")


def fluid_problem(
    document: Document,
    read: Callable[[str], Any],
    array: Callable[[str], NDArray],
    *,
    options: CommandOptions = NO_OPTIONS,
) -> Problem:
    """Vorticity of a fluid scene at the end."""
    from ddgcli.models.fluid import model
    from ddgcli.models.fluid.scene import KIND

    def setup_of(overrides: Mapping[str, Any]) -> Callable[[], Any]:
        def setup() -> Any:
            scene = resolve(document, KIND, overrides)
            account = Account()
            fluids = {n: context for n, (context, _) in model.contexts(scene, read, array).items()}
            built = model.build(scene, fluids, account)
            return {n: fluid.model() for n, fluid in built.items()}, scene.schedule(), account

        return setup

    return _problem(
        document, KIND, setup_of, list(KIND.integrators), "conservative", options, _vorticity, "vorticity"
    )


def _displacement(observations: ObservationSeries) -> NDArray[np.float64]:
    first, last = observations[0], observations[-1]
    displacements = [last[name].points - first[name].points for name in first]
    return np.concatenate(displacements)


def _vorticity(observations: ObservationSeries) -> NDArray[np.float64]:
    return np.concatenate([observations[-1][name].vertex["vorticity"] for name in observations[-1]])


def _problem(
    document: Document,
    kind: SceneKind,
    setup_of: Callable[[Mapping[str, Any]], Callable[[], Any]],
    integrators: list[str],
    reference_integrator: str,
    options: CommandOptions,
    answer: Callable[[ObservationSeries], NDArray],
    noun: str,
) -> Problem:
    """Problem of a scene.

    `options` may contain `steps`, `duration`, `step` (the middle of the steps compared), `integrator` and
    `tolerance`.
    """
    time = resolve(document, kind, {name: options[name] for name in TIME_OPTIONS if name in options}).time
    step = options.get("step") or time.step or time.duration / 50
    duration = options["steps"] * step if "steps" in options else options.get("duration")
    span = duration or min(time.duration, MAX_STEPS * step)
    span = max(span, 2 * step)
    counts = sorted({max(1, round(span / (step * factor))) for factor in STEP_FACTORS})
    names = [options["integrator"]] if "integrator" in options else integrators
    tolerances = (options["tolerance"],) if "tolerance" in options else TOLERANCES
    adaptive = names[0] if "integrator" in options else reference_integrator
    steps = span / step

    def solve(state: Any) -> NDArray[np.float64]:
        models, schedule, account = state
        return answer([snapshot.observations for snapshot in evolve(models, schedule, account)])

    def run(integrator: str, parameters: Mapping[str, float]) -> Callable[[], Any]:
        ends = {"duration": span, "frame_every": span}
        return setup_of({"integrator": integrator, **parameters, **ends})

    def candidate(integrator: str, option: str, value: float, work: float) -> Candidate:
        parameters = {{"dt": "step"}.get(option, option): value}
        arguments = {
            "integrator": integrator,
            option: repr(value),
            "duration": repr(span),
            "frame_every": repr(span),
        }
        line = integrator + (" adaptive" if option == "tolerance" else "")
        return Candidate(line, {option: value}, run(integrator, parameters), solve, arguments, work)

    def reference(finest: float) -> Reference:
        coarse, middle, limit = (
            solve(run(reference_integrator, {"step": span / max(1, round(steps / f))})())
            for f in (4 * finest, 2 * finest, finest)
        )
        first, second = _relative(coarse, middle), _relative(middle, limit)
        name = f"{reference_integrator} with {finest:g} of the scene's step"
        name += f", as far as {2 * finest:g} and {4 * finest:g} agree"
        largest = remaining_error(first.max(initial=0.0), second.max(initial=0.0))
        mean = remaining_error(first.mean(), second.mean())
        return Reference(name, limit, largest, mean_uncertainty=mean)

    unit = 1e-2 * steps
    candidates = [
        *(candidate(name, "dt", span / n, unit * n / steps) for n in counts for name in names),
        *(candidate(adaptive, "tolerance", t, 3 * unit * (1e-3 / t) ** (1 / 3)) for t in tolerances),
    ]
    return Problem(
        candidates=candidates,
        references=[(1.75 * unit / finest, partial(reference, finest)) for finest in REFERENCE_STEP_FACTORS],
        error=_relative,
        error_scale=f"the largest {noun} of the reference at t = {span:.6g} s",
        query=f"run of {span:.3g} s",
    )


def _relative(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Length of the difference at each vertex over the largest of the truth."""
    difference, size = answer - truth, truth
    if truth.ndim == 2:
        difference, size = np.linalg.norm(difference, axis=1), np.linalg.norm(truth, axis=1)
    error = np.abs(difference) / (np.abs(size).max(initial=0.0) or 1.0)
    return np.nan_to_num(error, nan=np.inf)
