"""A run that continues from a checkpoint has the bits of an uninterrupted one: each effect, each scheme.

Files and kills: tests/cli/test_shell_resume.py.
"""

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.io.mesh_file import MeshInput
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mesh.shapes import icosphere
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import EFFECTS, KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

SCENE = """
[time]
duration = 3e-3
step = 1e-3
frame_every = 1e-3
integrator = "{integrator}"
{steps}
[[object]]
name = "s"
role = "shell"
{shape}
density = 1
thickness = "2 mm"
young = 1e5
poisson = 0.4
{place}
{more}
[effects]
{effects}
"""
SQUARE = "grid = { size = [0.2, 0.2], cells = [2, 2] }"
SPHERE = "sphere = { radius = 0.1, subdivisions = 0 }"
TURNING = "velocity = [0.3, 0.1, -0.2]\nangular_velocity = [20, 10, 30]"
FALLING = "position = [0, 0, 0.0025]\nvelocity = [0.5, 0, -1]"
OTHER = f"""[[object]]
name = "other"
role = "shell"
{SQUARE}
density = 1
thickness = "2 mm"
young = 1e5
poisson = 0.4
position = [0.01, 0.02, 0.0035]
velocity = [0, 0, -0.8]"""
FLOOR = '[[object]]\nname = "o"\nrole = "obstacle"\nplane = {}'
BALL = FLOOR.replace("plane = {}", 'mesh = "ball"\nposition = [0.1, 0.1, -0.084]\nvelocity = [0, 0, 0.3]')
ELASTIC = "stretching = {}\nbending = {}\n"
PINNED = ELASTIC + "pin = { vertices = [0, 1] }\n"
# effect and choice -> (effects, other objects, shape, place)
CASES = {
    "stretching stvk": ("stretching = {}", "", SQUARE, TURNING),
    "stretching edges": ('stretching = { model = "edges" }', "", SQUARE, TURNING),
    "stretching edges-area": ('stretching = { model = "edges-area" }', "", SQUARE, TURNING),
    "bending hinge": (ELASTIC, "", SPHERE, TURNING),
    "bending quadratic": ('stretching = {}\nbending = { model = "quadratic" }', "", SQUARE, TURNING),
    "bending cubic": ('stretching = {}\nbending = { model = "cubic" }', "", SPHERE, TURNING),
    "bending midedge": ('stretching = {}\nbending = { model = "midedge" }', "", SPHERE, TURNING),
    "gravity": (PINNED + "gravity = {}", "", SQUARE, ""),
    "load ramp": (
        PINNED + "load = { traction = [0, 0, 50], times = [0, 0.002, 0.01], factors = [0, 1, 0.5] }",
        "", SQUARE, "",
    ),
    "pin clamp": (
        ELASTIC + "pin = { vertices = [0, 1, 2], clamp = true }",
        "", SQUARE, "velocity = [0, 0, 1]",
    ),
    "damping": (ELASTIC + "damping = { mass = 3, stiffness = 1e-4 }", "", SQUARE, TURNING),
    "wind": (ELASTIC + 'wind = { velocity = ["5 + 100*t", 0, 1] }', "", SQUARE, TURNING),
    "pressure": (PINNED + "pressure = { value = 100 }", "", SPHERE, TURNING),
    "pressure gas": (ELASTIC + "pressure = { value = 100, gas = true }", "", SPHERE, TURNING),
    "handle": (
        PINNED + "handle = { vertices = [6, 7, 8], times = [0, 0.01], "
        "positions = [[0, 0, 0], [0, 0, 0.02]] }", "", SQUARE, "",
    ),
    "contact plane": (
        ELASTIC + 'contact = { pairs = [["s", "o"]], friction = 0.5 }', FLOOR, SQUARE, FALLING,
    ),
    "contact moving mesh": (
        ELASTIC + 'contact = { pairs = [["s", "o"]], friction = 0.5 }', BALL, SQUARE, FALLING,
    ),
    "contact shells": (
        ELASTIC + 'contact = { pairs = [["s", "other"]], self_contact = true, friction = 0.5 }',
        OTHER, SQUARE, "",
    ),
    "attach shell": (
        ELASTIC + 'attach = { object = "s", to = "other", vertices = [0, 3] }', OTHER, SQUARE, "",
    ),
    "attach obstacle": (
        ELASTIC + 'attach = { object = "s", to = "o", vertices = [4] }', BALL, SQUARE, FALLING,
    ),
    "plasticity": (
        PINNED + "gravity = { acceleration = [0, 900, -900] }\n"
        "plasticity = { yield_strain = 1e-4, yield_angle = 1e-3, hardening = 2 }", "", SQUARE, "",
    ),
    "fracture": (ELASTIC + "fracture = { strain = 1e-3 }", "", SQUARE, "angular_velocity = [0, 5, 60]"),
    "fracture self_contact": (
        ELASTIC + "fracture = { strain = 1e-3 }\ncontact = { self_contact = true }",
        "", SQUARE, "angular_velocity = [0, 5, 60]",
    ),
    "rigid": (ELASTIC + "rigid = { edges = [[0, 1], [1, 2]] }", "", SQUARE, TURNING),
}  # fmt: skip
EXPLICIT = {"symplectic-euler", "verlet", "avi"}
REFUSED = {
    "contact moving mesh": EXPLICIT,
    "contact shells": EXPLICIT,
    "fracture": EXPLICIT | {"static"},
    "fracture self_contact": EXPLICIT | {"static"},
    "rigid": set(INTEGRATORS) - {"verlet"},
    "wind": {"static"},
}

# scalars that show that an effect has acted
ACTS = {"contact": {"energy_contact": 0}, "plasticity": {"plastic_work": 0}, "fracture": {"pieces": 1}}


def run(name, integrator, resume=None):
    """Snapshots of a case, from scratch."""
    effects, more, shape, place = CASES[name]
    steps = "load_steps = 3" if integrator == "static" else ""
    text = SCENE.format(integrator=integrator, steps=steps, shape=shape, place=place, more=more,
                        effects=effects)  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    ball = MeshInput(icosphere(0, 0.1), "ball")
    contexts = {n: context for n, (context, _) in model.contexts(scene, lambda file: ball).items()}
    account = Account()
    return list(evolve(model.build(scene, contexts, account), scene.schedule(), account, resume))


def assert_same(snapshots, others):
    assert [s.time for s in snapshots] == [s.time for s in others]
    for snapshot, other in zip(snapshots, others):
        assert set(snapshot.checkpoint) == set(other.checkpoint)
        assert all(np.array_equal(v, other.checkpoint[k]) for k, v in snapshot.checkpoint.items())
        for name, observation in snapshot.observations.items():
            assert np.array_equal(observation.points, other.observations[name].points)
            for key, value in observation.scalar.items():
                assert np.array_equal(value, other.observations[name].scalar[key]), key


SLOW = {("contact shells", "newmark"), ("contact shells", "implicit-midpoint"), ("contact plane", "newmark"),
        ("handle", "implicit-midpoint"), ("contact moving mesh", "newmark")}  # fmt: skip
CELLS = [
    pytest.param(name, integrator, marks=[pytest.mark.slow] * ((name, integrator) in SLOW))
    for name in CASES for integrator in INTEGRATORS
]  # fmt: skip


@pytest.mark.parametrize("name, integrator", CELLS)
def test_resumed_run_has_the_same_bits(name, integrator):
    if {"contact moving mesh", "contact shells", "fracture self_contact"} & {name}:
        pytest.importorskip("ipctk")
    if integrator in REFUSED.get(name, ()):
        with pytest.raises(SceneError):
            run(name, integrator)
        return
    whole = run(name, integrator)
    start, end = (whole[k].observations["s"] for k in (0, -1))
    assert len(whole) == 4
    if integrator != "static":
        assert not np.array_equal(start.points, end.points)
        for key, least in ACTS.get(name.split()[0], {}).items():
            assert max(snapshot.observations["s"].scalar[key] for snapshot in whole) > least
    middle = whole[2]
    checkpoint = {key: value.copy() for key, value in middle.checkpoint.items()}
    assert_same(whole[3:], run(name, integrator, (2, checkpoint)))


def test_every_effect_is_in_the_table():
    assert {name.split()[0] for name in CASES} == set(EFFECTS)
