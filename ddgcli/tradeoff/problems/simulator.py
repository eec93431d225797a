"""What the problems of scenes share: runs of a simulator, the models of effects, and relative errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.scenes.scene import MODEL_KEYS, SceneKind, resolve
from ddgcli.scenes.sections import Document
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.refinement import refined_scene

TIME_OPTIONS = ("steps", "duration", "step", "tolerance", "integrator")
REFINEMENTS = (2, 1)  # of the meshes of limits
# models of effects; those that converge on any mesh come first: the truth has them, if they are not laws
MODELS = {
    "bending": ("midedge", "hinge", "quadratic", "cubic"),
    "stretching": ("stvk", "edges", "edges-area"),
    "viscosity": ("hodge", "bochner", "deformation"),
}
DEFAULT_MODELS = {"bending": "hinge", "stretching": "stvk", "viscosity": "hodge"}
LAWS = ("viscosity",)  # its kinds are different laws of friction: the truth keeps the scene's own
ObservationSeries = Sequence[Mapping[str, Any]]  # observations by object, of each frame
InputVertices = Mapping[str, NDArray[np.int64]]  # vertices of the input in finer meshes, by object


@dataclass(frozen=True)
class Simulator:
    """How the scenes of one simulator run.

    Attributes
    ----------
    document : Document
    kind : SceneKind
    read, array : callable
        Readers of meshes and arrays.
    contexts : callable
        (scene, read, array) -> context of each object.
    models : callable
        (scene, contexts, account) -> models of the time loop.
    integrators : list of str
    reference_integrator : str
    answer : callable
        Observations, and the vertices of each object to compare (None for all) -> answer.
    noun : str
        What the answer is.
    converges : bool
        Whether answers on finer meshes have a limit.
    """

    document: Document
    kind: SceneKind
    read: Callable[[str], Any]
    array: Callable[[str], NDArray] | None
    contexts: Callable[..., dict[str, Any]]
    models: Callable[..., dict[str, Any]]
    integrators: list[str]
    reference_integrator: str
    answer: Callable[[ObservationSeries, InputVertices | None], NDArray]
    noun: str
    converges: bool = True

    def setup(self, overrides: Mapping[str, Any]) -> Any:
        """Models, schedule and account of a run."""
        scene, account = resolve(self.document, self.kind, overrides), Account()
        contexts = self.contexts(scene, self.read, self.array)
        return self.models(scene, contexts, account), scene.schedule(), account

    def solve(self, state: Any, input_vertices: InputVertices | None = None) -> NDArray[np.float64]:
        """Answer at the end of a run."""
        models, schedule, account = state
        observations = [snapshot.observations for snapshot in evolve(models, schedule, account)]
        return self.answer(observations, input_vertices)

    def finer_answer(self, overrides: Mapping[str, Any], times: int) -> NDArray[np.float64]:
        """Answer on meshes refined `times` times, at the vertices of the input."""
        finer = refined_scene(self.document, self.kind, self.read, self.array, times)
        one = replace(self, document=finer.document, read=finer.read, array=finer.array)
        return one.solve(one.setup(overrides), finer.input_vertices)


def other_models(simulator: Simulator, own_models: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Models that rows vary: those of effects with their default parameters, without the scene's own.

    Parameters
    ----------
    simulator : Simulator
    own_models : sequence of str
        As `effect=model`.

    Returns
    -------
    dict of str to tuple of str
        Models by effect.
    """
    effects = simulator.document.data.get("effects", {})
    names = {text.partition("=")[0] for text in own_models}
    others = {}
    for effect, models in MODELS.items():
        table = effects.get(effect)
        if isinstance(table, dict) and effect not in names and "stiffness" not in table:
            own = table.get(MODEL_KEYS[effect], DEFAULT_MODELS[effect])
            others[effect] = tuple(m for m in models if m != own)
    return others


def truth_models(others: Mapping[str, tuple[str, ...]], own_models: Sequence[str]) -> tuple[str, ...]:
    """Models of the limit of fine meshes: where one of an effect converges on any mesh, that one.

    Parameters
    ----------
    others : mapping of str to tuple of str
        As returned by `other_models`.
    own_models : sequence of str
        As `effect=model`.

    Returns
    -------
    tuple of str
    """
    best = [
        f"{effect}={MODELS[effect][0]}"
        for effect, models in others.items()
        if effect not in LAWS and MODELS[effect][0] in models
    ]
    return (*own_models, *best)


def relative_lengths(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Length of the difference at each vertex, relative to the largest length of the truth.

    Parameters
    ----------
    answer, truth : (n, d) or (n,) ndarray of float64

    Returns
    -------
    (n,) ndarray of float64
        Infinite where an answer is not finite.
    """
    difference, size = answer - truth, truth
    if truth.ndim == 2:
        difference, size = np.linalg.norm(difference, axis=1), np.linalg.norm(truth, axis=1)
    error = np.abs(difference) / (np.abs(size).max(initial=0.0) or 1.0)
    return np.nan_to_num(error, nan=np.inf)
