"""Advice for load steps of equilibria that fail, where a shorter time step is no remedy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ddgcli.errors import counted
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import PlasticMemory
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.scenes.scene import Scene

NO_EQUILIBRIUM = ("wind", "fracture")  # effects that are errors with `static`
NEEDLE_SIDE = 1e-5  # ratio of the shortest side of a face to its longest, below which the face is a needle


def load_advice(system: System, parameters: Any, meshes: Sequence[TriangleMesh]) -> str:
    """Advice for a load step that failed.

    Parameters
    ----------
    system : System
    parameters
        Section [time] with the parameters of the integrator `static`.
    meshes : sequence of TriangleMesh

    Returns
    -------
    str
    """
    from ddgcli.mechanics.rigid_motions import unheld_motions

    unheld = unheld_motions(system)
    if unheld:
        return f"{unheld}: hold it by pins or lessen the loads"
    smaller = "shorten `arc_length`" if parameters.arc_length else "raise `load_steps`"
    if any(isinstance(term, PlasticMemory) for term in system.memories):
        smaller += ", or follow what yields by `integrator=implicit-euler` with damping"
    return "; ".join(filter(None, [f"lessen the loads or {smaller}", needle_advice(meshes)]))


def rest_advice(scene: Scene, system: System, accelerates: bool) -> str:
    """Advice on how to compute the equilibrium of a scene.

    Parameters
    ----------
    scene : Scene
    system : System
    accelerates : bool
        Whether the loads accelerate the shell as a whole.

    Returns
    -------
    str
    """
    from ddgcli.mechanics.rigid_motions import unheld_motions

    names = [effect.name for effect, _, _ in scene.effects if effect.name in NO_EQUILIBRIUM]
    steps = ["hold it by pins"] * (accelerates and bool(unheld_motions(system)))
    steps += [f"leave out {' and '.join(dict.fromkeys(names))}"] * bool(names)
    return " and ".join([*steps, "use `integrator=static`"])


def needle_advice(meshes: Sequence[TriangleMesh]) -> str:
    """Advice on needles of meshes: the first one, and the repair that removes them.

    Parameters
    ----------
    meshes : sequence of TriangleMesh

    Returns
    -------
    str
        "" if there are none.
    """
    for mesh in meshes:
        shortest, longest = mesh.side_length.min(axis=1), mesh.side_length.max(axis=1)
        needles = np.flatnonzero(shortest < NEEDLE_SIDE * longest)
        if len(needles):
            distance = 2.0 * float(shortest[needles].max())
            return (
                f"{counted(len(needles), 'face has', 'faces have')} sides (first: face {needles[0]}) below "
                f"{NEEDLE_SIDE:g} of the longest, where forces are rounding: merge their vertices by "
                f"`repair=weld={distance:.1g} drop_degenerate`"
            )
    return ""
