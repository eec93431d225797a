"""Simulators: integrators, steps and models, against runs with small steps and on finer meshes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.sections import Document
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    ErrorNorms,
    MeshLimit,
    Problem,
    Reference,
)
from ddgcli.tradeoff.problems.equilibrium import equilibrium_problem
from ddgcli.tradeoff.problems.simulator import (
    LAWS,
    REFINEMENTS,
    TIME_OPTIONS,
    InputVertices,
    ObservationSeries,
    Simulator,
    other_models,
    relative_lengths,
    truth_models,
)
from ddgcli.tradeoff.richardson import mesh_limit, remaining_error

# steps of the candidates and of the references, in units of the scene's step
STEP_FACTORS = (4.0, 2.0, 1.0, 0.5)
REFERENCE_STEP_FACTORS = (1 / 8, 1 / 2, 2.0)
TOLERANCES = (1e-3, 1e-5)
SETTLED_PATTERNS = ("right", "left", "cross")  # of grids beside walls without slip
MAX_STEPS = 16  # of the scene's own length: later, chaos dominates the errors
MESH_STEP_FACTOR = 1 / 2  # step on them, in units of the scene's step


def shell_problem(
    document: Document,
    read: Callable[[str], Any],
    *,
    options: CommandOptions = NO_OPTIONS,
    error_part: str = "both",
) -> Problem:
    """Positions of a shell scene at the end, or in equilibrium where its integrator is `static`.

    Parameters
    ----------
    document : Document
    read : callable
        Reads a mesh file.
    options : mapping
        Of the command, which restrict the rows.
    error_part : str
        Which error decides: in time, of the mesh, or both.

    Returns
    -------
    Problem
    """
    from ddgcli.models.shell import model
    from ddgcli.models.shell.scene import KIND

    def contexts(scene: Any, read: Any, _: Any) -> dict[str, Any]:
        return {name: context for name, (context, _) in model.contexts(scene, read).items()}

    names = [n for n in KIND.integrators if n != "static"]
    simulator = Simulator(
        document, KIND, read, None, contexts, model.build, names, "newmark", _displacement, "displacement"
    )
    integrator = {"integrator": options["integrator"]} if "integrator" in options else {}
    if resolve(document, KIND, integrator).time.integrator == "static":
        return equilibrium_problem(simulator, options, error_part)
    return _problem(simulator, options, error_part)


def fluid_problem(
    document: Document,
    read: Callable[[str], Any],
    array: Callable[[str], NDArray],
    *,
    options: CommandOptions = NO_OPTIONS,
    error_part: str = "both",
) -> Problem:
    """Vorticity of a fluid scene at the end.

    Parameters
    ----------
    document : Document
    read : callable
        Reads a mesh file.
    array : callable
        Reads an array file.
    options : mapping
        Of the command, which restrict the rows.
    error_part : str
        Which error decides: in time, of the mesh, or both.

    Returns
    -------
    Problem
    """
    from ddgcli.models.fluid import model
    from ddgcli.models.fluid.scene import KIND, TRANSPORTS

    def contexts(scene: Any, read: Any, array: Any) -> dict[str, Any]:
        return {name: context for name, (context, _) in model.contexts(scene, read, array).items()}

    def models(scene: Any, fluids: Any, account: Any) -> dict[str, Any]:
        return {name: fluid.model() for name, fluid in model.build(scene, fluids, account).items()}

    fluids = contexts(resolve(document, KIND, {}), read, array).values()
    dimensions = {3 if fluid.is_volume else 2 for fluid in fluids}
    names = [name for name, modules in TRANSPORTS.items() if dimensions <= set(modules)]
    reference = "conservative" if "conservative" in names else "energy"  # the scheme of volumes
    simulator = Simulator(
        document, KIND, read, array, contexts, models, names, reference, _vorticity, "vorticity",
        converges=_wall_vorticity_converges(resolve(document, KIND, {})),
    )  # fmt: skip
    return _problem(simulator, options, error_part)


def _wall_vorticity_converges(scene: Any) -> bool:
    """Whether no wall is without slip, or all fluids are grids on which the vorticity there converges."""
    kinds = [parameters.kind for effect, parameters, _ in scene.effects if effect.name == "boundary"]
    if set(kinds) <= {"free-slip"}:
        return True
    fluids = [section for section in scene.objects if section.role == "fluid"]
    return all(section.grid is not None and section.grid.pattern in SETTLED_PATTERNS for section in fluids)


def _displacement(
    observations: ObservationSeries, input_vertices: InputVertices | None = None
) -> NDArray[np.float64]:
    first, last = observations[0], observations[-1]
    displacements = {name: last[name].points - first[name].points for name in first}
    return np.concatenate([_at(input_vertices, name, values) for name, values in displacements.items()])


def _vorticity(
    observations: ObservationSeries, input_vertices: InputVertices | None = None
) -> NDArray[np.float64]:
    last = observations[-1]
    return np.concatenate([_at(input_vertices, name, last[name].vertex["vorticity"]) for name in last])


def _at(input_vertices: InputVertices | None, name: str, values: NDArray) -> NDArray:
    return values if input_vertices is None else values[input_vertices[name]]


@dataclass(frozen=True)
class _Runs:
    """Runs of one scene over the same time span.

    Attributes
    ----------
    simulator : Simulator
    span : float
        Simulated time of every run, in seconds.
    steps : float
        The span in units of the scene's step.
    models : tuple of str
        Models that the command line names, as EFFECT=MODEL.
    """

    simulator: Simulator
    span: float
    steps: float
    models: tuple[str, ...]

    def overrides(self, integrator: str, models: Sequence[str], **parameters: float) -> dict[str, Any]:
        ends = {"duration": self.span, "frame_every": self.span, "integrator": integrator}
        return {**ends, **parameters, "model": tuple(models)}

    def step(self, factor: float) -> float:
        """Step near `factor` steps of the scene that divides the span."""
        return self.span / max(1, round(self.steps / factor))

    def answer(self, factor: float, models: Sequence[str]) -> NDArray[np.float64]:
        """Answer of the reference integrator with `factor` of the scene's step."""
        integrator = self.simulator.reference_integrator
        run = self.overrides(integrator, models, step=self.step(factor))
        return self.simulator.solve(self.simulator.setup(run))

    def reference(self, finest: float, models: Sequence[str]) -> Reference:
        """Run with `finest` of the scene's step; two with longer steps give its uncertainty."""
        coarse, middle, limit = (self.answer(f, models) for f in (4 * finest, 2 * finest, finest))
        if not limit.any():
            raise ParameterError(
                f"the {self.simulator.noun} is zero throughout, so that no row has an error; give the scene "
                "a motion or a force"
            )
        first, second = relative_lengths(coarse, middle), relative_lengths(middle, limit)
        short, *longer = (f"{self.step(factor):.3g} s" for factor in (finest, 2 * finest, 4 * finest))
        name = f"{self.simulator.reference_integrator} with steps of {short}"
        name += f" (compared with steps of {' and '.join(longer)})"
        largest = remaining_error(first.max(initial=0.0), second.max(initial=0.0))
        mean = remaining_error(first.mean(), second.mean())
        return Reference(name, limit, largest, mean_uncertainty=mean)

    def fine_meshes(self, times: int, models: Sequence[str]) -> MeshLimit:
        """Extrapolation of runs on meshes that are refined up to `times` times."""
        integrator = self.simulator.reference_integrator
        run = self.overrides(integrator, models, step=self.step(MESH_STEP_FACTOR))
        answers = [self.simulator.finer_answer(run, level) for level in range(times + 1)]
        limit, other = mesh_limit(*answers, converges=self.simulator.converges)
        # the error in time of these runs: that of a method of first order, at the least
        in_time = 2.0 * relative_lengths(self.answer(MESH_STEP_FACTOR / 2, models), answers[0])
        finest = f"{2**times} times as fine" if times == 1 else f"2 and {2**times} times as fine"
        name = f"meshes {finest}, extrapolated" + (f", with {', '.join(models)}" if models else "")
        return MeshLimit(name, limit, ErrorNorms.of(relative_lengths(other, limit)) + ErrorNorms.of(in_time))

    def candidate(
        self, integrator: str, option: str, value: float, work: float, effect: str = "", model: str = ""
    ) -> Candidate:
        """Row of the table: an integrator with a step or a tolerance, and the model of an effect."""
        varied = f"{effect}={model}" if effect else ""
        models = (*self.models, varied) if varied else self.models
        run = self.overrides(integrator, models, **{{"dt": "step"}.get(option, option): value})
        suffix = " adaptive" if option == "tolerance" else ""
        return Candidate(
            integrator + suffix + (f" {model} {effect}" if effect else ""),
            {option: value},
            partial(self.simulator.setup, run),
            self.simulator.solve,
            {
                "integrator": integrator,
                option: repr(value),
                "duration": repr(self.span),
                "frame_every": repr(self.span),
                **({"model": varied} if varied else {}),
            },
            work,
            model=varied,
            model_reference=partial(self.reference, 1 / 2, models) if varied else None,
            is_other_law=effect in LAWS,
            step_taken=None if option == "tolerance" else _step_taken,
        )


def _step_taken(state: Any) -> float:
    """Step of the runs of a set-up, halved down to the limits of stability."""
    models, schedule, _ = state
    largest = min((model.largest_step for model in models.values()), default=math.inf)
    halvings = math.ceil(math.log2(schedule.dt / largest)) if schedule.dt > largest else 0
    return float(schedule.dt * 0.5**halvings)


def _problem(simulator: Simulator, options: CommandOptions, error_part: str) -> Problem:
    """Problem of a scene.

    `options` may contain `steps`, `duration`, `step` (the middle of the steps compared), `integrator`,
    `tolerance` and `model`.
    """
    # `steps` are those of `step`, whatever the tolerance of other rows
    time_options = {name: options[name] for name in TIME_OPTIONS if name in options and name != "steps"}
    time = resolve(simulator.document, simulator.kind, time_options).time
    step = options.get("step") or time.step or time.duration / 50
    duration = options["steps"] * step if "steps" in options else options.get("duration")
    span = max(duration or min(time.duration, MAX_STEPS * step), 2 * step)
    runs = _Runs(simulator, span, span / step, tuple(options.get("model", ())))
    steps, unit = runs.steps, 1e-2 * runs.steps
    counts = sorted({max(1, round(span / (step * factor))) for factor in STEP_FACTORS})
    names = [options["integrator"]] if "integrator" in options else simulator.integrators
    base = names[0] if "integrator" in options else simulator.reference_integrator
    tolerances = (options["tolerance"],) if "tolerance" in options else TOLERANCES
    others = other_models(simulator, runs.models)
    varied = [] if error_part == "time" else [(e, m) for e, models in others.items() for m in models]
    candidates = [
        *(runs.candidate(name, "dt", span / n, unit * n / steps) for n in counts for name in names),
        *(runs.candidate(base, "dt", span / round(steps), unit, effect, model) for effect, model in varied),
        *(runs.candidate(base, "tolerance", t, 3 * unit * (1e-3 / t) ** (1 / 3)) for t in tolerances),
    ]
    truths = dict.fromkeys((truth_models(others, runs.models), runs.models))
    return Problem(
        candidates=candidates,
        references=[
            (1.75 * unit / finest, partial(runs.reference, finest, runs.models))
            for finest in REFERENCE_STEP_FACTORS
        ],
        error=relative_lengths,
        error_scale=f"the largest {simulator.noun} of the reference at t = {span:.6g} s",
        query=f"run of {span:.3g} s",
        error_part=error_part,
        mesh_limits=[
            ((sum(4.0**k for k in range(times + 1)) / MESH_STEP_FACTOR + 4.0) * unit,
             partial(runs.fine_meshes, times, models))
            for models in truths
            for times in REFINEMENTS
        ],
    )  # fmt: skip
