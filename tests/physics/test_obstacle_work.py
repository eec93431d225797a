"""Work of moving obstacles is that of the forces which the scheme takes."""

import importlib.util

import numpy as np
import pytest

from ddgcli.io.scene_file import parse_scene
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from tests.physics.test_orders_under_driving import BALL, MOVING_PLATE, SCENE
from tests.simulate import shell_run

BELT = """
[[object]]
name = "belt"
role = "obstacle"
plane = { point = [0, 0, -1.9e-3], normal = [0, 0, 1] }
velocity = [0.5, 0, 0]
"""
SQUARE = "grid = { size = [0.1, 0.1], cells = [2, 2] }"
RELATIVE_ERROR = {
    "newmark": 0.02, "implicit-midpoint": 0.02, "verlet": 0.04,  # less with the step: of its landing
    "bdf2": 0.03,
    "implicit-euler": 0.15,  # loses energy itself where the shell lands
}  # fmt: skip


def ends(integrator, step, shape, effects, obstacle, duration=0.05, young=2e5):
    """Scalars of the first and the last frame."""
    text = SCENE.replace("= 0.05", f"= {duration}").replace("density = 0.7", "density = 1")
    text = text.replace("young = 2e3", f"young = {young}")
    text = text.format(step=step, integrator=integrator, shape=shape, effects=effects, floor=obstacle)
    snapshots = shell_run(text)[0]
    return [snapshots[k].observations["s"].scalar for k in (0, -1)]


@pytest.mark.parametrize("integrator", RELATIVE_ERROR)
def test_the_work_of_a_belt_is_the_energy_that_it_gives(integrator):
    """Once up to half off where the shell lands: friction at the ends, with the mean velocity."""
    effects = 'gravity = {}\ncontact = { pairs = [["s", "belt"]], friction = 0.5 }'
    step = 5e-4 if integrator == "verlet" else 5e-3
    start, last = ends(integrator, step, SQUARE, effects, BELT, duration=0.15, young=1e6)
    assert last["momentum"][0] == pytest.approx(0.01 * 0.5, rel=0.02)  # it moves with the belt
    gain = last["energy"] - start["energy"]
    assert last["external_work"] == pytest.approx(gain, rel=RELATIVE_ERROR[integrator])


def test_the_work_of_a_plate_that_strikes_a_shell_is_its_impulse_times_its_speed():
    """Once of forces at the ends of a step, where `implicit-midpoint` takes those of its middle: 3 % off."""
    plate = MOVING_PLATE.replace("[0, 0, -0.5]", "[0, 0, -0.21]").replace("[0, 0, -0.1]", "[0, 0, 1]")
    effects = 'contact = { pairs = [["s", "plate"]] }'
    _, last = ends("implicit-midpoint", 1e-3, BALL, effects, plate)
    assert last["momentum"][2] > 0.1
    assert last["external_work"] == pytest.approx(last["momentum"][2] * 1.0, rel=5e-3)


def test_bdf2_keeps_the_work_of_an_accelerated_floor_that_carries_a_shell_by_friction():
    """Once twice the gain: friction at the mean velocity of a step slid where the shell stuck."""
    lift = """
[[object]]
name = "lift"
role = "obstacle"
plane = { point = [0, 0, -0.8e-3], normal = [0, 0, 1] }
times = [0, 0.1]
positions = [[0, 0, 0], [0.02, 0, 0.01]]
"""
    effects = 'gravity = {}\ncontact = { pairs = [["s", "lift"]], friction = 0.9, gap = 1e-3 }'
    square = SQUARE.replace("[2, 2]", "[1, 1]")
    start, last = ends("bdf2", 4e-3, square, effects, lift, duration=0.1, young=1e5)
    gain = last["energy"] - start["energy"]
    assert gain > 0.95 * 0.01 * 9.81 * 0.01
    assert last["external_work"] == pytest.approx(gain, rel=0.15)


SHAPES = {
    "a plane": "plane = { point = [0, 0, -1e-3], normal = [0, 0, 1] }",
    "a box with edges": "box = { corner = [-0.1, -0.1, -0.101], size = [0.4, 0.4, 0.1] }",
}


@pytest.mark.parametrize("shape", SHAPES)
def test_friction_of_earlier_normal_forces_has_the_velocity_of_the_surface_at_the_end_of_a_step(shape):
    """Once also that of the start: a shell that sticks to an accelerated belt was solved twice a step."""
    sharp = shape != "a plane"
    if sharp and importlib.util.find_spec("ipctk") is None:
        pytest.skip("needs the extra contact")
    obstacle = f"""
[[object]]
name = "belt"
role = "obstacle"
{SHAPES[shape]}
times = [0, 1]
positions = [[0, 0, 0], [0.2, 0.1, 0]]
"""
    effects = 'contact = { pairs = [["s", "belt"]], friction = 0.5, gap = 2e-3, sharp = %s }'
    text = SCENE.format(
        step=0.01, integrator="newmark", shape=SQUARE, effects=effects % str(sharp).lower(), floor=obstacle
    )
    scene = resolve(parse_scene(text), KIND, {})
    contexts = {name: context for name, (context, _) in model.contexts(scene, None).items()}
    system = model.systems(scene, contexts, Account())["s"].at(0.3)
    u = 0.3
    speed = (30 * u**2 - 60 * u**3 + 30 * u**4) * np.array([0.2, 0.1, 0])
    stuck = np.tile(speed, (len(system.mass), 1))
    frozen = system.frozen(system.start, 0.3, since=0.0)
    assert np.abs(system.drag_of(frozen, 0 * stuck)).max() > 1e-3  # the normal forces of the start
    assert np.abs(system.drag_of(frozen, stuck)).max() < 1e-9
