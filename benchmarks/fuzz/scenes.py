"""Random valid scenes: every effect, integrator, shape and obstacle in chance combinations.

The tables hold one function for each effect of the simulator; a test compares their names with the effects
that the package has. A scene may be refused (a combination may be wrong), but in one line.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.fluid.scene import TRANSPORTS
from ddgcli.scenes.materials import MATERIALS

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
SHELL_MESHES = ("cap.ply", "hat.ply", "cube.obj", "saddle.obj", "catenoid.off", "cylinder.ply")
FLUID_MESHES = ("torus.ply", "cap.ply", "cube.obj", "saddle.obj", "bad_torus.ply", "ball.vtu", "cylinder.ply")
EXPLICIT = ("verlet", "symplectic-euler", "explicit-euler", "avi")
BOXES = ([[-9, -9, -9], [9, 9, 9]], [[-9, -9, -9], [0, 9, 9]], [[-9, -9, 0.1], [9, 9, 9]])
Table = dict[str, Any]
Effect = Callable[[Random, "SceneObjects"], "Table | list[Table] | None"]


class SceneObjects:
    """Names of the objects of a scene, and its integrator.

    Parameters
    ----------
    shells, obstacles : sequence of str
    integrator : str
    mesh_obstacles : sequence of str
        Obstacles that are meshes, which explicit integrators do not touch.
    """

    def __init__(
        self, shells: Sequence[str], obstacles: Sequence[str], integrator: str, mesh_obstacles: Sequence[str]
    ) -> None:
        self.shells, self.obstacles, self.integrator = shells, obstacles, integrator
        self.mesh_obstacles, self.is_implicit = mesh_obstacles, integrator not in EXPLICIT

    def one_shell(self, rng: Random) -> Table:
        """`object` of an effect; left out, the effect acts on all."""
        return {"object": rng.choice(self.shells)} if len(self.shells) > 1 or rng.random() < 0.3 else {}


def toml(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def scene_text(time: Table, bodies: Sequence[Table], effects: Table) -> bytes:
    """A scene file."""
    lines = ['format = "ddgcli-scene/1"', "[time]", *(f"{key} = {toml(v)}" for key, v in time.items())]
    for body in bodies:
        lines += ["[[object]]", *(f"{key} = {toml(v)}" for key, v in body.items())]
    lines += ["[effects]", *(f"{key} = {toml(v)}" for key, v in effects.items())]
    return ("\n".join(lines) + "\n").encode()


def sometimes(rng: Random, share: float, **table: Any) -> Table:
    """The table in this share of the scenes, else an empty one."""
    return table if rng.random() < share else {}


# ---------------------------------------------------------------- shells
def _shell_shape(rng: Random) -> Table:
    cells = [rng.choice([1, 2, 4, 6]), rng.choice([1, 2, 4, 5])]
    grid = {"size": [rng.choice([0.1, 0.2, 1.0]), rng.choice([0.1, 0.2, 0.5])], "cells": cells}
    grid |= sometimes(rng, 0.6, pattern=rng.choice(["right", "left", "alternating", "cross", "equilateral"]))
    cylinder = {"start": [0, 0, 0], "end": [0, 0, 0.2], "radius": rng.choice([0.03, 0.1]), "cells": [8, 3]}
    shapes: list[Table] = [
        *[{"grid": grid | sometimes(rng, 0.15, grading=rng.choice([0.5, 1.0]))}] * 3,
        {"sphere": {"center": [0, 0, 0], "radius": 0.1, "subdivisions": rng.choice([0, 1, 2])}},
        {"cylinder": cylinder},
        {
            "box": {
                "corner": [-0.05, -0.05, -0.05],
                "size": [0.1, 0.1, 0.1],
                "cells": [2, 1, rng.choice([1, 3])],
            }
        },
        {"mesh": str(SAMPLES / rng.choice(SHELL_MESHES))},
    ]
    return rng.choice(shapes)


def _shell(rng: Random, number: int) -> Table:
    height = round(0.3 * number + rng.choice([0.06, 0.12, 0.2, 0.3]), 4)
    return {
        "name": f"shell{number}",
        "role": "shell",
        **_shell_shape(rng),
        "material": rng.choice(list(MATERIALS)),
        "position": [rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02), height],
        **sometimes(rng, 0.3, thickness=rng.choice([1e-4, 1e-3, 5e-3])),
        **sometimes(rng, 0.4, rotation={"axis": [1, 0.3, 0], "degrees": rng.choice([10, 45, 90, 180])}),
        **sometimes(rng, 0.3, velocity=[rng.choice([0, 0.5, -1]), 0, rng.choice([0, -1, -5, 2])]),
        **sometimes(rng, 0.15, angular_velocity=[0, rng.choice([1, 10]), 0]),
        **sometimes(rng, 0.05, face_arrays=rng.choice([["stress"], ["strain_tensor", "bending_moment"]])),
        **sometimes(rng, 0.1, scale=rng.choice([0.5, 2.0])),
    }


def _obstacle(rng: Random, number: int) -> Table:
    shape = rng.choice(
        [
            {"plane": {"point": [0, 0, 0], "normal": [0, rng.choice([0, 0.2]), 1]}},
            {"sphere": {"center": [0, 0, -0.1], "radius": 0.1}},
            {"box": {"corner": [-0.5, -0.5, -0.2], "size": [1, 1, 0.2]}},
            {"cylinder": {"start": [-1, 0, -0.1], "end": [1, 0, -0.1], "radius": 0.1}},
            {"mesh": str(SAMPLES / "cube.obj"), "scale": 0.1, "position": [0, 0, -0.12]},
        ]
    )
    moves = sometimes(rng, 0.2, velocity=[0, 0, rng.choice([0.1, 1])]) if "mesh" not in shape else {}
    moves = moves or sometimes(rng, 0.2, times=[0, 0.05], positions=[[0, 0, 0], [0, 0, 0.05]])
    return {"name": f"obstacle{number}", "role": "obstacle", **shape, **moves}


def _selection(rng: Random) -> Table:
    vertices = sorted(rng.sample(range(4), rng.choice([1, 2, 3])))
    return {"vertices": vertices} if rng.random() < 0.6 else {"box": rng.choice(BOXES)}


def _bending(rng: Random, objects: SceneObjects) -> Table:
    model = rng.choice(["hinge", "quadratic", "cubic", "midedge"])
    return {"model": model, **sometimes(rng, 0.3, rest=rng.choice(["input", "flat"]))}


def _load(rng: Random, objects: SceneObjects) -> list[Table]:
    kind = rng.choice(
        [{"force": [0, 0, rng.choice([1e-3, 1.0])]}, {"traction": [0, 0, rng.choice([1, 1e3])]}]
    )
    ramp = sometimes(rng, 0.3, times=[0, 0.01], factors=[0, 1.0])
    return [objects.one_shell(rng) | kind | (_selection(rng) if rng.random() < 0.6 else {}) | ramp]


def _plasticity(rng: Random, objects: SceneObjects) -> Table:
    limits = sometimes(rng, 0.6, yield_strain=rng.choice([1e-3, 0.05]))
    limits |= {} if limits and rng.random() < 0.5 else {"yield_angle": rng.choice([0.01, 0.3])}
    return objects.one_shell(rng) | limits | sometimes(rng, 0.4, hardening=0.1)


def _rigid(rng: Random, objects: SceneObjects) -> Table:
    return objects.one_shell(rng) | sometimes(rng, 0.5, edges=[[0, 1]])


def _attach(rng: Random, objects: SceneObjects) -> list[Table] | None:
    others = [*objects.shells[1:], *objects.obstacles]
    return [{"object": objects.shells[0], "to": rng.choice(others), "vertices": [0, 1]}] if others else None


def _contact(rng: Random, objects: SceneObjects) -> Table | None:
    bodies = (
        objects.obstacles
        if objects.is_implicit
        else [o for o in objects.obstacles if o not in objects.mesh_obstacles]
    )
    pairs = [[a, b] for a in objects.shells for b in bodies if rng.random() < 0.8]
    if objects.is_implicit:
        shells = objects.shells
        pairs += [[a, b] for i, a in enumerate(shells) for b in shells[i + 1 :] if rng.random() < 0.6]
    on_itself = objects.is_implicit and (not pairs or rng.random() < 0.25)
    if not pairs and not on_itself:
        return None
    return {
        "pairs": pairs,
        **({"self_contact": True} if on_itself else {}),
        **sometimes(rng, 0.4, friction=rng.choice([0.1, 0.5, 2.0])),
        **sometimes(rng, 0.3, gap=rng.choice([1e-3, 1e-2])),
    }


SHELL_EFFECTS: dict[str, tuple[float, Effect]] = {
    "stretching": (0.93, lambda rng, objects: {"model": rng.choice(["stvk", "stvk", "edges"])}),
    "bending": (0.85, _bending),
    "gravity": (0.7, lambda rng, objects: {}),
    "load": (0.25, _load),
    "pressure": (0.15, lambda rng, objects: [
        objects.one_shell(rng) | {"value": rng.choice([10, 1e4])} | sometimes(rng, 0.5, gas=True)]),
    "wind": (0.2, lambda rng, objects: objects.one_shell(rng) | {
        "velocity": [rng.choice([5, "3*sin(t)"]), 0, rng.choice([0, "x"])]}),
    "plasticity": (0.12, _plasticity),
    "fracture": (0.12, lambda rng, objects: [
        objects.one_shell(rng) | rng.choice([{"strain": rng.choice([1e-3, 0.05])}, {"angle": 0.05}])]),
    "rigid": (0.06, _rigid),
    "pin": (0.4, lambda rng, objects: [objects.one_shell(rng) | _selection(rng)
        | sometimes(rng, 0.3, axes=rng.choice(["x", "xz", "xyz"])) | sometimes(rng, 0.3, clamp=True)]),
    "handle": (0.15, lambda rng, objects: [objects.one_shell(rng) | {
        "vertices": [0, 1], "times": [0, 0.02],
        "positions": [[0, 0, 0], [0, 0, rng.choice([0.01, -0.02])]]}]),
    "attach": (0.1, _attach),
    "damping": (0.4, lambda rng, objects: {
        "mass": rng.choice([0.1, 1.0, 100.0]),
        # explicit steps are shorter than 2 / (stiffness * frequency^2): ten thousands in a scene of 1e-2
        "stiffness": rng.choice([0, 1e-4, 1e-2] if objects.is_implicit else [0, 1e-6, 1e-4])}),
    "contact": (0.7, _contact),
}  # fmt: skip


def shell_scene(rng: Random) -> bytes:
    """A scene of `shell-sim` with up to three shells and two obstacles, of at most ten steps."""
    integrator = rng.choice(list(INTEGRATORS))
    step = rng.choice([1e-4, 2e-5, 1e-3] if integrator in EXPLICIT else [1e-2, 5e-3, 1e-3, 1e-4])
    time = {"duration": step * rng.choice([1, 3, 10]), "step": step, "integrator": integrator}
    time |= sometimes(rng, 0.3, frame_every=step)
    if integrator == "static":
        time |= sometimes(rng, 0.5, load_steps=rng.choice([1, 3, 6]))
    elif integrator != "avi":
        time |= sometimes(rng, 0.12, tolerance=rng.choice([1e-3, 1e-5]))
    shells = [_shell(rng, k) for k in range(rng.choice([1, 1, 1, 2, 3]))]
    obstacles = [_obstacle(rng, k) for k in range(rng.choice([0, 1, 1, 2]))]
    objects = SceneObjects(
        [shell["name"] for shell in shells],
        [obstacle["name"] for obstacle in obstacles],
        integrator,
        [obstacle["name"] for obstacle in obstacles if "mesh" in obstacle],
    )
    return scene_text(time, [*shells, *obstacles], _effects(rng, SHELL_EFFECTS, objects))


def _effects(rng: Random, table: dict[str, tuple[float, Effect]], objects: SceneObjects) -> Table:
    effects = {name: effect(rng, objects) for name, (share, effect) in table.items() if rng.random() < share}
    return {name: content for name, content in effects.items() if content is not None}


# ---------------------------------------------------------------- fluids
def _domain(rng: Random) -> Table:
    grid = {"size": [rng.choice([1, 3]), 1], "cells": [rng.choice([4, 6, 12]), rng.choice([4, 8])]}
    grid |= sometimes(rng, 0.4, pattern=rng.choice(["right", "alternating", "cross"]))
    domains: list[Table] = [
        *[{"grid": grid | sometimes(rng, 0.4, periodic=rng.choice(["x", "y", "xy"]))}] * 2,
        {"sphere": {"center": [0, 0, 0], "radius": 1.0, "subdivisions": rng.choice([1, 2, 3])}},
        {"box": {"corner": [0, 0, 0], "size": [1, 1, 1], "cells": [rng.choice([2, 4]), 3, 3]}},
        {"cylinder": {"start": [0, 0, 0], "end": [0, 0, 1], "radius": 0.4, "cells": [12, 5]}},
        *[{"mesh": str(SAMPLES / rng.choice(FLUID_MESHES))}] * 2,
    ]
    return rng.choice(domains)


def _fluid_obstacle(rng: Random) -> Table:
    shape = rng.choice(
        [
            {"cylinder": {"start": [0.5, 0.5, -1], "end": [0.5, 0.5, 1], "radius": 0.2}},
            {"sphere": {"center": [0.5, 0.5, 0.5], "radius": 0.25}},
            {"box": {"corner": [0.3, 0.3, -0.5], "size": [0.35, 0.4, 1.0]}},
        ]
    )
    return {"name": "obstacle", "role": "obstacle", **shape}


def _initial(rng: Random, objects: SceneObjects) -> Table:
    flows = ["taylor-vortices", "vortex-pair", "rotation", "taylor-green", "jet", "rossby-haurwitz",
             "shear-layer", "vortex-ring"]  # fmt: skip
    flow = {"flow": rng.choice(flows)} | sometimes(rng, 0.5, strength=rng.choice([0.1, -3.0]))
    vorticity = {"vorticity": rng.choice(["z", "sin(3*x)*y", "x*y*z", "1"])}
    velocity = {"velocity": rng.choice([[1, 0, 0], ["y", "-x", 0]])}
    return rng.choice([vorticity, velocity, flow | sometimes(rng, 0.3, core=0.2)])


def _boundary(rng: Random, objects: SceneObjects) -> list[Table]:
    wall = {"kind": "wall", "velocity": [1, 0, 0]}
    still = {"kind": "no-slip"}
    inflow = {"kind": "inflow", "velocity": [1, 0, 0], "where": "x < 1e-6"}
    outflow = {"kind": "outflow", "where": "x > 1 - 1e-6"}
    conditions: list[list[Table]] = [
        [{"kind": rng.choice(["no-slip", "free-slip"])}],
        [wall],
        [wall | {"where": "y > 0.99"}, still],
        [inflow, outflow],
        [inflow, outflow, still],
        *([[{**still, "obstacle": name}] for name in objects.obstacles]),
    ]
    return rng.choice(conditions)


FLUID_EFFECTS: dict[str, tuple[float, Effect]] = {
    "initial": (0.85, _initial),
    "viscosity": (0.5, lambda rng, objects: {"nu": rng.choice([0, 1e-6, 1e-2, 1, 1e4])}
        | sometimes(rng, 0.5, kind=rng.choice(["hodge", "bochner", "deformation"]))),
    "harmonic": (0.3, lambda rng, objects: rng.choice(
        [{}, {"kind": "frozen"}, {"coefficients": [0.5]}, {"coefficients": [0.5, 0.2]}])),
    "force": (0.2, lambda rng, objects: {
        "acceleration": rng.choice([[0, 0, -9.81], ["sin(y)", "t", 0], ["-y", "x", 0]])}),
    "rotation": (0.12, lambda rng, objects: {"angular_velocity": [0, 0, rng.choice([1.0, -20.0])]}),
    "buoyancy": (0.2, lambda rng, objects: {"temperature": rng.choice(["z", "exp(-x^2)*10", "20"])}
        | sometimes(rng, 0.4, diffusivity=1e-3) | sometimes(rng, 0.2, source="t*x")),
    "pressure": (0.25, lambda rng, objects: {}),
    "dye": (0.2, lambda rng, objects: {"amount": rng.choice(["x>0.5", "1", "z"])}
        | sometimes(rng, 0.2, source="1")),
    "particles": (0.2, lambda rng, objects: rng.choice(
        [{"count": 20}, {"points": [[0.1, 0.1, 0.1], [0.9, 0.9, 0.5]]}])),
    "boundary": (0.4, _boundary),
}  # fmt: skip


def fluid_scene(rng: Random) -> bytes:
    """A scene of `fluid-sim` on a surface or in a volume, with at most one obstacle, of at most ten steps."""
    integrator, step = rng.choice(list(TRANSPORTS)), rng.choice([0.01, 0.05, 0.2, 1.0])
    time = {"duration": step * rng.choice([1, 4, 10]), "step": step, "integrator": integrator}
    time |= sometimes(rng, 0.2, frame_every=step) | sometimes(rng, 0.1, tolerance=1e-3)
    fluid = {"name": "fluid", "role": "fluid", **_domain(rng)}
    fluid |= sometimes(rng, 0.1, rotation={"axis": [1, 0, 0], "degrees": 30})
    obstacles = [_fluid_obstacle(rng)] if rng.random() < 0.25 else []
    objects = SceneObjects(["fluid"], [obstacle["name"] for obstacle in obstacles], integrator, [])
    return scene_text(time, [fluid, *obstacles], _effects(rng, FLUID_EFFECTS, objects))
