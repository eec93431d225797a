"""Static scenes of shells: models, against the solver with another path and finer meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ddgcli.errors import ParameterError
from ddgcli.scenes.scene import resolve
from ddgcli.tradeoff.candidates import (
    Candidate,
    CommandOptions,
    ErrorNorms,
    MeshLimit,
    Problem,
    Reference,
)
from ddgcli.tradeoff.problems.simulator import (
    REFINEMENTS,
    TIME_OPTIONS,
    Simulator,
    other_models,
    relative_lengths,
    truth_models,
)
from ddgcli.tradeoff.richardson import mesh_limit

REFERENCE_WORK = 4.0  # equilibria in all that the reference computes, the scene's own being one


@dataclass(frozen=True)
class _Equilibria:
    """Equilibria of one scene.

    Attributes
    ----------
    simulator : Simulator
    load_steps : int
        Equilibria on the way to the whole load.
    models : tuple of str
        Models that the command line names, as EFFECT=MODEL.
    """

    simulator: Simulator
    load_steps: int
    models: tuple[str, ...]

    def overrides(self, models: Sequence[str]) -> dict[str, Any]:
        return {"integrator": "static", "model": tuple(models)}

    def setup(self, models: Sequence[str], load_steps: int) -> Any:
        """Models, schedule and account of a run with `load_steps` on the way."""
        return self.simulator.setup({**self.overrides(models), "load_steps": load_steps})

    def reference(self, models: Sequence[str]) -> Reference:
        """Equilibrium with twice the load steps; its difference from the scene's own is its uncertainty."""
        own, other = (
            self.simulator.solve(self.setup(models, count))
            for count in (self.load_steps, 2 * self.load_steps)
        )
        name = f"static with {2 * self.load_steps} load steps (uncertainty from {self.load_steps})"
        return Reference.from_agreement(name, other, relative_lengths(own, other))

    def fine_meshes(self, times: int, models: Sequence[str]) -> MeshLimit:
        """Extrapolation of equilibria on meshes that are refined up to `times` times."""
        run = self.overrides(models)
        answers = [self.simulator.finer_answer(run, level) for level in range(times + 1)]
        limit, other = mesh_limit(*answers)
        finest = f"{2**times} times as fine" if times == 1 else f"2 and {2**times} times as fine"
        name = f"meshes {finest}, extrapolated" + (f", with {', '.join(models)}" if models else "")
        return MeshLimit(name, limit, ErrorNorms.of(relative_lengths(other, limit)))

    def candidate(self, effect: str = "", model: str = "") -> Candidate:
        """Row of the table: the scene's models, or another one of an effect."""
        varied = f"{effect}={model}" if effect else ""
        models = (*self.models, varied) if varied else self.models
        return Candidate(
            f"static {model} {effect}".strip(),
            {},
            partial(self.simulator.setup, self.overrides(models)),
            self.simulator.solve,
            {"integrator": "static", **({"model": varied} if varied else {})},
            1.0,
            model=varied,
            model_reference=partial(self.reference, models) if varied else None,
        )


def equilibrium_problem(simulator: Simulator, options: CommandOptions, error_part: str) -> Problem:
    """Problem of the displacement in equilibrium under the whole load.

    The rows are models; their error in time is that of the solver.

    Parameters
    ----------
    simulator : Simulator
    options : mapping
        Of the command, which restrict the rows.
    error_part : str
        Which error decides: in time, of the mesh, or both.

    Returns
    -------
    Problem

    Raises
    ------
    ParameterError
        For steps, which equilibria do not have, and for arc lengths, whose ends depend on the mesh.
    """
    if any(name in options for name in TIME_OPTIONS if name != "integrator"):
        raise ParameterError(
            "the scene looks for equilibria, which have no steps in time: leave out steps, durations and "
            "tolerances, or name another integrator"
        )
    integrator = {"integrator": options["integrator"]} if "integrator" in options else {}
    time: Any = resolve(simulator.document, simulator.kind, integrator).time
    if time.arc_length is not None:
        raise ParameterError(
            "tradeoff compares equilibria under the whole load; take arc_length out of the scene"
        )
    runs = _Equilibria(simulator, time.load_steps, tuple(options.get("model", ())))
    others = other_models(simulator, runs.models)
    varied = [] if error_part == "time" else [(e, m) for e, models in others.items() for m in models]
    truths = dict.fromkeys((truth_models(others, runs.models), runs.models))
    return Problem(
        candidates=[runs.candidate(), *(runs.candidate(effect, model) for effect, model in varied)],
        references=[(REFERENCE_WORK, partial(runs.reference, runs.models))],
        error=relative_lengths,
        error_scale=f"the largest {simulator.noun} of the reference",
        query="equilibrium",
        error_part=error_part,
        mesh_limits=[
            (sum(4.0**k for k in range(times + 1)), partial(runs.fine_meshes, times, models))
            for models in truths
            for times in REFINEMENTS
        ],
    )
