"""Work of moving obstacles is that of the forces which the scheme takes."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from ddgcli.geometry.solids import CylinderGap, PlaneGap
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.driving import obstacle_work
from ddgcli.mechanics.system import Motion, System
from ddgcli.models.shell import model
from ddgcli.models.shell.barrier import MovingBarrier
from ddgcli.models.shell.obstacle_motion import PlacedMotion, SteadyMotion
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from tests.physics.test_orders_under_driving import BALL, MOVING_PLATE, SCENE
from tests.simulate import scalar, shell_run

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


class Press:
    """Motion of a plane down to 0.4 of its distance and back, from time 0 to 1."""

    def pose(self, time):
        still = SteadyMotion(np.zeros(3), np.zeros(3), np.zeros(3)).pose(0.0)
        return replace(still, shift=np.array([0, 0, -0.6 * np.sin(np.pi * time) ** 2]))


def system_of(surface, motion):
    """A vertex at the origin near a moving surface, whose barrier has range 1."""
    placed = PlacedMotion(np.eye(3), np.zeros(3), motion)
    barrier = MovingBarrier(surface, placed, 1.0, np.array([2.0]), 0.5, 0.0)
    return System(np.ones(1), [barrier], Account(), np.zeros((1, 3)), size=1.0), barrier


def state(time, x=(0.0, 0.0, 0.0)):
    return Motion(np.array([x]), np.zeros((1, 3)), np.zeros((1, 3)), time=time)


@pytest.mark.parametrize("pushes_at, order", [("end", 1), ("ends", 2), ("middle", 2)])
def test_the_work_of_a_plane_at_a_vertex_at_rest_is_the_change_of_its_barrier(pushes_at, order):
    """Force times travel, not times the velocity of one moment, with the error of its quadrature."""
    system, barrier = system_of(PlaneGap(np.array([0, 0, 0.9]), np.array([0, 0, -1.0])), Press())
    truth = barrier.at(0.3).energy(np.zeros((1, 3))) - barrier.energy(np.zeros((1, 3)))
    errors = []
    for n in (40, 80):
        times = np.linspace(0, 0.3, n + 1)
        steps = zip(times, times[1:])
        errors.append(sum(obstacle_work(system, state(a), state(b), pushes_at) for a, b in steps) - truth)
    assert abs(errors[0]) < 0.1 * truth
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("x, y", [(0.1, 0.1), (0.0, -0.3), (-0.4, 0.2)])
def test_the_work_of_the_forces_at_the_end_is_at_least_what_a_convex_barrier_gains(x, y):
    """So the balance of implicit Euler does not rise, in steps of any length."""
    system, barrier = system_of(PlaneGap(np.array([0, 0, 0.9]), np.array([0, 0, -1.0])), Press())
    for since, until in ((0.0, 0.2), (0.2, 0.3), (0.3, 0.7), (0.6, 0.7)):
        before, after = state(since, (0, 0, x - 0.4)), state(until, (0, 0, y - 0.4))
        gain = barrier.at(until).energy(after.x) - barrier.at(since).energy(before.x)
        force = -barrier.at(until).gradient(after.x)
        assert gain + np.vdot(force, after.x - before.x) <= obstacle_work(system, before, after, "end")


@pytest.mark.parametrize("pushes_at", ["end", "ends", "middle"])
def test_a_wheel_gives_nothing_to_what_slides_on_it_and_moves_what_it_carries(pushes_at):
    axis, center = np.array([0, 0.9, 0]), np.array([0, 0, -1.5])
    wheel = SteadyMotion(center, np.zeros(3), np.array([0, 2.0, 0]))
    system, barrier = system_of(CylinderGap(center - axis, center + axis, 1.0), wheel)
    assert np.abs(barrier.gradient(np.zeros((1, 3)))).max() > 0.1
    assert obstacle_work(system, state(0.0), state(0.1), pushes_at) == pytest.approx(0, abs=1e-15)
    drop = SteadyMotion(center, np.array([0, 0, -1.0]), np.zeros(3))
    system, barrier = system_of(CylinderGap(center - axis, center + axis, 1.0), drop)
    work = obstacle_work(system, state(0.0), state(0.1, (0, 0, -0.1)), pushes_at)
    assert work == pytest.approx(0.1 * barrier.gradient(np.zeros((1, 3)))[0, 2])


RING = """
[time]
duration = 0.15
step = {step}
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
cylinder = {{ start = [0, 0, 0], end = [0, 0.02, 0], radius = 0.03, cells = [16, 1] }}
young = 5e6
poisson = 0.3
thickness = "1 mm"
density = 1
[[object]]
name = "lo"
role = "obstacle"
plane = {{ point = [0, 0, -0.0308], normal = [0, 0, 1] }}
[[object]]
name = "hi"
role = "obstacle"
plane = {{ point = [0, 0, 0.0308], normal = [0, 0, -1] }}
times = [0, 0.3]
positions = [[0, 0, 0], [0, 0, -0.0585]]
interpolation = "{interpolation}"
[effects]
stretching = {{}}
bending = {{}}
contact = {{ pairs = [["s", "lo"], ["s", "hi"]] }}
"""


def pressed_ring(step, integrator="implicit-euler", interpolation="smooth"):
    """(last snapshot, energies less external work) of a ring between a floor and a press."""
    text = RING.format(step=step, integrator=integrator, interpolation=interpolation)
    snapshots = shell_run(text)[0]
    return snapshots[-1], np.array(scalar(snapshots, "energy")) - scalar(snapshots, "external_work")


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_implicit_euler_gains_nothing_beyond_the_work_of_a_press(interpolation):
    """The work was the force times the velocity of the end: short of its travel, and the balance rose."""
    end, balance = pressed_ring(0.01, interpolation=interpolation)
    assert end.smallest_step == 0.01
    assert np.diff(balance).max() <= 1e-12 * np.ptp(balance)


def test_the_balance_of_implicit_euler_under_a_press_converges_in_the_order_of_the_scheme():
    losses = [-pressed_ring(step)[1][-1] for step in (0.01, 0.005)]
    assert losses[0] / losses[1] == pytest.approx(2, abs=0.2)


def test_the_work_of_a_step_that_the_composite_scheme_takes_is_that_of_both_ends():
    """Once by the force at the middle, which only the scheme of the run takes: a fifth off."""
    end, balance = pressed_ring(0.01, "implicit-midpoint")
    assert end.smallest_step < 0.01
    assert (balance - np.minimum.accumulate(balance)).max() < 5e-6
