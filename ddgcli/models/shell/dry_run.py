"""Dry run of a scene of shells: the systems that it would build, and the quantities that set its cost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ddgcli.choices import EXPLICIT_INTEGRATORS
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Potential
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.groups import groups
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.model import Schedule


def cost_facts(scene: Scene, contexts: dict[str, ShellContext]) -> dict[str, Any]:
    """Quantities on which the cost of a step depends.

    Parameters
    ----------
    scene : Scene
    contexts : dict of str to ShellContext

    Returns
    -------
    dict
        `contact` (with another object), `stretching`, `midedge` (bending) and `stiffness_damping`: bool,
        whether the scene has them. `pair_elements`: number of faces among which contact searches for pairs,
        those of shells in contact with themselves, each other or an obstacle with a mesh, and of that mesh.
    """
    effects = [(effect.name, parameters) for effect, parameters, _ in scene.effects]
    searched: set[str] = set()
    for name, parameters in effects:
        if name == "contact":
            names = parameters.self_contact
            searched |= set(contexts) if names is True else set(names or ())
            meshes = set(contexts).union(*(context.obstacles for context in contexts.values()))
            searched |= {name for pair in parameters.pairs if meshes.issuperset(pair) for name in pair}
    faces = {name: context.mesh.n_faces for name, context in contexts.items()}
    for context in contexts.values():
        faces |= {name: len(obstacle.mesh.faces) for name, obstacle in context.obstacles.items()}
    return {
        "contact": any(name == "contact" and bool(p.pairs) for name, p in effects),
        "stretching": any(name == "stretching" for name, _ in effects),
        "midedge": any(name == "bending" and p.model == "midedge" for name, p in effects),
        "stiffness_damping": any(name == "damping" and p.stiffness > 0 for name, p in effects),
        "pair_elements": sum(faces.get(name, 0) for name in searched),
    }


def step_solver(scene: Scene, systems: dict[str, System]) -> str | None:
    """Name of the solver of the linear systems of the steps: an iterative one, or `direct`.

    The run makes the same choice, from the sparsity of the Hessians and the available memory.

    Parameters
    ----------
    scene : Scene
    systems : dict of str to System

    Returns
    -------
    str or None
        None for explicit steps.
    """
    from ddgcli.mechanics.increment import Increment
    from ddgcli.mechanics.objective import Objective

    if scene.time.integrator in EXPLICIT_INTEGRATORS:
        return None
    solvers = [Objective(system).solver(Increment(1.0, system.start)) for system in systems.values()]
    return next((solver.iterative for solver in solvers if solver.iterative), "direct")


def assembled(
    scene: Scene, shells: dict[str, ShellContext], systems: dict[str, System], schedule: Schedule
) -> dict[str, Any]:
    """Sizes, terms and steps of the systems that a scene would build.

    Parameters
    ----------
    scene : Scene
    shells : dict of str to ShellContext
    systems : dict of str to System
    schedule : Schedule

    Returns
    -------
    dict
    """
    description: dict[str, Any] = {
        "integrator": scene.time.integrator,
        "order": INTEGRATORS[scene.time.integrator].order,
        "steps": schedule.steps,
        "frames": schedule.n_frames,
        "step": schedule.dt,
    }
    for group in groups(scene, shells):
        system = systems[group.name]
        terms = _term_texts([*system.potentials, *system.dissipations])
        meshes = [context.mesh for context in group.shells.values()]
        description[group.name] = {
            "vertices": len(system.mass),
            "faces": sum(mesh.n_faces for mesh in meshes),
            "mass": float(system.mass.sum()),
            "free_coordinates": int(system.free.sum()),
            "terms": terms,
        }
    return description


def _term_texts(terms: Iterable[Any]) -> dict[str, str]:
    """Kinds of terms of each effect, with their numbers of elements over all shells."""
    counts: dict[str, dict[str, int]] = {}
    for term in terms:
        kind = type(term.own_term).__name__
        if isinstance(term, Potential) and term.hessian is not None:
            kind += ", elements found in each step"
        of_effect = counts.setdefault(term.name, {})
        of_effect[kind] = of_effect.get(kind, 0) + len(term.stencil)
    return {
        name: "; ".join(f"{kind}, {count} elements" if count else kind for kind, count in of_effect.items())
        for name, of_effect in counts.items()
    }
