"""Integrators by what they should conserve: drift of energy and momenta against seconds.

The systems are a pendulum, an oscillator of two bodies, and free shells of scenes. The reference is the
value at the start, which the exact motion keeps.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import CONSERVED_QUANTITIES, MECHANICAL_EXAMPLES
from ddgcli.errors import DdgError, ParameterError
from ddgcli.mechanics.integrators import INTEGRATORS, Step
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import FixedCoordinates, Mode, Potential
from ddgcli.mesh.vectors import row_cross
from ddgcli.scenes.scene import Scene, resolve
from ddgcli.scenes.sections import Document
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Model, Observation, Schedule, parts_of_step
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import NO_OPTIONS, Candidate, CommandOptions, Problem, Reference

STEP_FACTORS = (4.0, 2.0, 1.0, 0.5)  # of the candidates, in units of the system's step
N_OBSERVATIONS = 32  # at which the drift is observed
MAX_STEPS = 400  # of a scene's own length
EXPLICIT_INTEGRATORS = ("symplectic-euler", "verlet", "avi")
# estimated seconds of a step, and more for each vertex
EXPLICIT_WORK, IMPLICIT_WORK = (2e-4, 7e-7), (3e-3, 1.5e-5)
NEWMARK = SimpleNamespace(beta=0.25, gamma=0.5)
EXTERNAL_EFFECTS = ("gravity", "pin", "load", "wind", "handle", "damping")  # they change the momenta


@dataclass(eq=False)
class Spring(Potential):
    """Spring between vertices 0 and 1."""

    stiffness: float
    length: float
    name: str = "spring"
    stencil: NDArray[np.int64] = field(default_factory=lambda: np.array([[0, 1]]))  # the ends

    def energy(self, x: NDArray) -> float:
        """Half the stiffness times the squared extension."""
        return 0.5 * self.stiffness * float(np.linalg.norm(x[1] - x[0]) - self.length) ** 2

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(2, 3) gradient."""
        span = x[1] - x[0]
        distance = float(np.linalg.norm(span))
        pull = self.stiffness * (distance - self.length) / distance * span
        return np.stack([-pull, pull])

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        """(1, 6, 6) Hessian."""
        span = x[1] - x[0]
        distance = float(np.linalg.norm(span))
        along = np.outer(span, span) / distance**2
        across = 1.0 - self.length / distance
        across = across if mode == "exact" else max(across, 0.0)
        block = self.stiffness * (along + across * (np.eye(3) - along))
        return np.block([[block, -block], [-block, block]])[None]


@dataclass(eq=False)
class Weight(Potential):
    """Weight of a pendulum of length and weight 1, whose angle is the first coordinate of vertex 1."""

    name: str = "gravity"
    stencil: NDArray[np.int64] = field(default_factory=lambda: np.array([[1]]))

    def energy(self, x: NDArray) -> float:
        """Height above the lowest point."""
        return float(1.0 - np.cos(x[1, 0]))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(2, 3) gradient."""
        gradient = np.zeros((2, 3))
        gradient[1, 0] = np.sin(x[1, 0])
        return gradient

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        """(1, 3, 3) Hessian."""
        value = float(np.cos(x[1, 0]))
        return np.diag([value if mode == "exact" else max(value, 0.0), 0.0, 0.0])[None]


@dataclass(frozen=True, eq=False)
class _Example:
    """A system with its start, its step and the length of its run."""

    terms: Sequence[Any]
    x: NDArray[np.float64]
    v: NDArray[np.float64]
    step: float
    duration: float


def _example(name: str) -> _Example:
    """Pendulum released at 2 rad; two bodies on a spring that turn, swing and drift."""
    if name == "pendulum":
        is_fixed = np.ones((2, 3), dtype=bool)
        is_fixed[1, 0] = False
        x = np.array([[0.0, 0, 0], [2.0, 0, 0]])
        return _Example((Weight(), FixedCoordinates(is_fixed)), x, np.zeros((2, 3)), 0.1, 40.0)
    x = np.array([[-0.65, 0, 0], [0.65, 0, 0]])
    v = np.array([[0.2, -0.4, 0.1], [0.2, 0.4, 0.1]])
    return _Example((Spring(4.0, 1.0),), x, v, 0.1, 30.0)


def example_problem(name: str, quantity: str, *, options: CommandOptions = NO_OPTIONS) -> Problem:
    """Drift of a conserved quantity of the pendulum or the oscillator.

    Parameters
    ----------
    name : {'pendulum', 'oscillator'}
    quantity : {'energy', 'momentum', 'angular-momentum'}
    options : mapping
        `step`, `duration` or `steps`, `integrator`.

    Returns
    -------
    Problem

    Raises
    ------
    ParameterError
        On the momentum of the pendulum, which its pivot changes.
    """
    _check(quantity, options, ("step", "duration", "steps", "integrator"))
    if name not in MECHANICAL_EXAMPLES:
        raise ParameterError(f"{name!r} is not one of {', '.join(MECHANICAL_EXAMPLES)}", parameter="name")
    if name == "pendulum" and quantity != "energy":
        raise ParameterError(
            "the pivot of a pendulum changes its momenta; use `quantity=energy`",
            parameter="quantity",
        )
    example = _example(name)

    def setup(integrator: str, step: float, span: float) -> Any:
        count = max(1, round(span / step))
        schedule = Schedule(span / count, count, max(1, count // N_OBSERVATIONS))
        return {name: _model(example, integrator)}, schedule, Account(), 2.0, float(np.ptp(example.x))

    span = _span(options, example.step, example.duration)
    line = {"conserved": quantity}
    work = partial(_work, len(example.x), math.inf)
    return _problem(setup, quantity, options, example.step, span, line, "tradeoff shell-sim", work)


def scene_problem(
    document: Document, read: Callable[[str], Any], quantity: str, *, options: CommandOptions = NO_OPTIONS
) -> Problem:
    """Drift of a conserved quantity of the shells of a scene, which must be free of what changes it.

    Parameters
    ----------
    document : Document
    read : callable
        Reads a mesh file.
    quantity : {'energy', 'momentum', 'angular-momentum'}
    options : mapping
        Of the command, which restrict the rows.

    Returns
    -------
    Problem

    Raises
    ------
    ParameterError
        For a scene that does not conserve the quantity.
    """
    from ddgcli.models.shell import model
    from ddgcli.models.shell.scene import KIND

    _check(quantity, options)
    time = resolve(document, KIND, {k: options[k] for k in ("step", "duration") if k in options}).time
    step = options.get("step") or time.step or time.duration / 50

    def setup(integrator: str, dt: float, span: float) -> Any:
        every = dt * max(1, round(span / dt) // N_OBSERVATIONS)
        overrides = {"integrator": integrator, "step": dt, "duration": span, "frame_every": every}
        scene, account = resolve(document, KIND, overrides), Account()
        shells = {n: context for n, (context, _) in model.contexts(scene, read).items()}
        mass = float(sum(context.mass.sum() for context in shells.values()))
        size = max(float(np.ptp(context.mesh.points, axis=0).max()) for context in shells.values())
        systems = model.systems(scene, shells, account)
        if cause := _cause_of_change(scene, systems.values(), quantity):
            raise ParameterError(
                f"{cause} changes the {quantity.replace('-', ' ')}; use a scene without it",
                parameter="quantity",
            )
        return model.models(scene, shells, systems), scene.schedule(), account, mass, size

    span = _span(options, step, min(time.duration, MAX_STEPS * step))
    models = setup("newmark", step, span)[0]  # refuses before the work begins
    n_vertices = sum(len(one.start.x) for one in models.values())
    limit = math.inf
    with contextlib.suppress(DdgError):  # of scenes that explicit schemes do not take
        limit = min(one.largest_step for one in setup("verlet", step, span)[0].values())
    return _problem(setup, quantity, options, step, span, {}, "", partial(_work, n_vertices, limit))


def _cause_of_change(scene: Scene, systems: Iterable[System], quantity: str) -> str:
    """What in a scene changes a quantity, or ""."""
    if quantity == "energy":
        return next(filter(None, [_cause_of_work(scene, system) for system in systems]), "")
    obstacles = {section.name for section in scene.objects if section.role == "obstacle"}
    for effect, parameters, _ in scene.effects:
        pairs = effect.pairs(parameters) if effect.pairs is not None else []
        met = [name for pair in pairs for name in pair if name in obstacles]
        if effect.name in EXTERNAL_EFFECTS:
            return f"effect {effect.name}"
        if met:
            return f"effect {effect.name} to obstacle {met[0]!r}"
        if effect.name == "contact" and parameters.friction and quantity == "angular-momentum":
            return "the friction of contact"
    return ""


def _cause_of_work(scene: Scene, system: System) -> str:
    """What takes energy from the motion of a system, or adds to it; "" if nothing does."""
    for dissipation in system.dissipations:
        return "the friction of contact" if dissipation.name == "contact" else f"effect {dissipation.name}"
    for effect in ("plasticity", "fracture"):
        if scene.has_effect(effect):
            return f"effect {effect}"
    if system.prescribed:
        return f"the prescribed motion {system.prescribed[0].name!r}"
    driving = next((term.at(0.0).name for term in system.terms if term.at is not None), "")
    return f"effect {driving}, which depends on time," if driving else ""


def _check(quantity: str, options: CommandOptions, accepted: Sequence[str] = ()) -> None:
    """Raise ParameterError for an unknown quantity, or an option that the problem does not use."""
    for name in options:
        if name == "tolerance" or (accepted and name not in accepted):
            raise ParameterError("changes nothing in this comparison; leave it out", parameter=name)
    if quantity not in CONSERVED_QUANTITIES:
        quantities = ", ".join(CONSERVED_QUANTITIES)
        raise ParameterError(f"{quantity!r} is not one of {quantities}", parameter="quantity")


def _span(options: CommandOptions, step: float, duration: float) -> float:
    if "steps" in options:
        return float(options["steps"] * (options.get("step") or step))
    return float(options.get("duration") or duration)


def _model(example: _Example, name: str) -> Model[Motion]:
    """Model of an example with one integrator."""
    integrator = INTEGRATORS[name]
    system = System(np.ones(2), example.terms, Account(), example.x)
    past = (example.x, example.v, np.zeros(1)) if integrator.multistep else ()
    start = Motion(example.x, example.v, system.acceleration(example.x, example.v, 1.0), past=past)

    def stepped(step: Step, motion: Motion, time: float, dt: float) -> Motion:
        after = step(system, replace(motion, time=time), dt, NEWMARK)
        previous = (motion.x, motion.v, np.array([dt])) if integrator.multistep else ()
        return replace(after, past=previous, time=time + dt)

    rescue = None if integrator.rescue is None else partial(stepped, integrator.rescue)

    def observe(motion: Motion) -> Observation:
        momentum = system.mass[:, None] * motion.v
        kinetic = 0.5 * float(np.sum(momentum * motion.v))
        scalar = {
            "energy": kinetic + sum(system.energies(motion.x).values()), "energy_kinetic": kinetic,
            "momentum": momentum.sum(axis=0), "angular_momentum": row_cross(motion.x, momentum).sum(axis=0),
        }  # fmt: skip
        return Observation(motion.x, {}, scalar)

    return Model(
        start, partial(stepped, integrator.step), observe,
        lambda motion: {"x": motion.x}, lambda arrays: start, rescue=rescue,
    )  # fmt: skip


def _work(n_vertices: int, limit: float, integrator: str, dt: float, count: int) -> float:
    """Estimated seconds of steps, those of explicit schemes divided down to their limit of stability."""
    is_explicit = integrator in EXPLICIT_INTEGRATORS
    each, per_vertex = EXPLICIT_WORK if is_explicit else IMPLICIT_WORK
    return count * (parts_of_step(dt, limit) if is_explicit else 1.0) * (each + per_vertex * n_vertices)


def _problem(
    setup: Callable[[str, float, float], Any],
    quantity: str,
    options: CommandOptions,
    step: float,
    span: float,
    words: Mapping[str, str],
    program: str,
    work: Callable[[str, float, int], float],
) -> Problem:
    """Candidates: every integrator with several steps, cheap ones first; the answer is the largest drift."""
    names = [options["integrator"]] if "integrator" in options else [n for n in INTEGRATORS if n != "static"]
    middle = options.get("step") or step
    counts = sorted({max(1, round(span / (middle * factor))) for factor in STEP_FACTORS})

    def solve(state: Any) -> NDArray[np.float64]:
        models, schedule, account, mass, size = state
        observations = [snapshot.observations for snapshot in evolve(models, schedule, account)]
        return np.array([drift(observations, quantity, mass, size)])

    candidates = []
    for count in counts:
        for name in names:
            dt = span / count
            arguments = {**words, "integrator": name, "dt": repr(dt), "duration": repr(span)}
            prepare = partial(setup, name, dt, span)
            seconds = work(name, dt, count)
            candidates.append(Candidate(name, {"dt": dt}, prepare, solve, arguments, seconds, program))
    truth = Reference.from_truth(f"the {quantity.replace('-', ' ')} at the start", np.zeros(1))
    return Problem(
        candidates=sorted(candidates, key=lambda candidate: candidate.work),
        references=[(0.0, lambda: truth)],
        error=lambda answer, truth: np.nan_to_num(np.abs(answer), nan=np.inf),
        error_scale=SCALES[quantity],
        place="quantity",
        query=f"run of {span:.3g} s",
    )


SCALES = {
    "energy": "the largest kinetic energy of the run",
    "momentum": "the largest momentum that the kinetic energy allows",
    "angular-momentum": "the largest momentum that the kinetic energy allows, times the size of the object",
}


def drift(observations: Sequence[Mapping[str, Any]], quantity: str, mass: float, size: float) -> float:
    """Largest change of a quantity since the start, relative to its scale, over all groups of objects."""
    worst = 0.0
    for name in observations[0]:
        if not observations[0][name].scalar:  # those of its group are at the first of the group
            continue
        scalars = [observation[name].scalar for observation in observations]
        kinetic = max(float(scalar["energy_kinetic"]) for scalar in scalars)
        scale = kinetic if quantity == "energy" else np.sqrt(2.0 * mass * kinetic)
        scale = scale * size if quantity == "angular-momentum" else scale
        values = np.array([np.atleast_1d(scalar[quantity.replace("-", "_")]) for scalar in scalars])
        change = np.linalg.norm(values - values[0], axis=1).max()
        worst = max(worst, float(change / (scale or 1.0)))
    return worst
