"""Wind: terminal speed, Galilean invariance, force on an inclined plate, work, gusts."""

from functools import cache

import numpy as np
import pytest

from ddgcli.models.shell.wind import FaceDrag
from tests.simulate import scalar, shell_run

PLATE = """
[time]
duration = {duration}
step = {step}
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.2, 0.2], cells = [2, 2] }}
density = 0.5
thickness = "1 mm"
young = "10 MPa"
poisson = 0.3
{motion}
[effects]
stretching = {{}}
bending = {{}}
{effects}
"""


def plate_text(effects, integrator="newmark", step=0.01, duration=0.1, motion=""):
    return PLATE.format(effects=effects, integrator=integrator, step=step, duration=duration, motion=motion)


def plate(*words, **options):
    return shell_run(plate_text(*words, **options))[0]


@pytest.mark.parametrize("name", ["newmark", "implicit-midpoint", "implicit-euler"])
def test_terminal_speed_of_a_falling_plate(name):
    """Weight per area = rho c_n v^2 / 2."""
    fall = "gravity = { acceleration = [0, 0, -10] }\nwind = { normal = 1.25, density = 1.6 }"
    run = plate(fall, name, 0.05, 2.5)
    terminal = np.sqrt(2 * 0.5 * 10 / (1.6 * 1.25))
    assert run[-1].observations["s"].vertex["velocity"][:, 2] == pytest.approx(
        np.full(9, -terminal), rel=1e-6
    )


def test_air_that_moves_with_the_plate_has_no_force():
    run = plate("wind = { velocity = [3, 2, 1] }", motion="velocity = [3, 2, 1]")
    assert np.abs(run[-1].observations["s"].vertex["velocity"] - [3, 2, 1]).max() < 1e-12


def test_force_on_an_inclined_plate_has_drag_and_lift():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    drag = FaceDrag(np.array([[0, 1, 2]]), ["3", "0", "-4"], 0.6, 1.3, 0.1)
    force = -drag.frozen(x, 0.1).gradient(np.zeros((3, 3))).sum(axis=0)
    assert force == pytest.approx(0.6 * 0.5 * np.array([0.1 * 3 * 3, 0, -1.3 * 4 * 4]))


@pytest.mark.parametrize("velocity", ['["4", 0, "6"]', '["4*sin(40*t)", 0, "6*cos(20*t)"]'])
def test_energy_is_the_work_of_the_wind_to_second_order(velocity):
    errors = []
    for step in (2e-3, 1e-3):
        run = plate(f"wind = {{ velocity = {velocity} }}", "newmark", step, 0.06)
        work, energy = np.array(scalar(run, "external_work")), np.array(scalar(run, "energy"))
        errors.append(np.abs(energy - energy[0] - work).max() / work.max())
    assert errors[1] / errors[0] == pytest.approx(0.25, rel=0.05)


def test_air_without_density_changes_no_bit():
    runs = [
        plate("gravity = {}\n" + effect, duration=0.05)
        for effect in ("", "wind = { velocity = [5, 0, 1], density = 0 }")
    ]
    assert len(runs[0]) > 1 and not np.array_equal(*(runs[0][k].observations["s"].points for k in (0, -1)))
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.observations["s"].points, b.observations["s"].points)


SECOND = """[[object]]
name = "t"
role = "shell"
grid = { size = [0.2, 0.2], cells = [2, 2] }
material = "rubber"
position = [0, 0, 1]
"""


WIND = "wind = {{ {object}velocity = [0, 0, 5] }}"
YIELD = """plasticity = {{ {object}yield_strain = 1e-3 }}
load = {{ object = "{name}", traction = [0, 0, 1000], vertices = [0] }}
"""


@pytest.mark.parametrize("effect", [WIND, YIELD], ids=["wind", "plasticity"])
def test_effect_without_object_acts_on_every_shell_as_on_that_which_it_names(effect):
    """Each shell moves as in the scene that names it, and not as in the scene that names the other."""

    def end(name, key):
        text = plate_text(effect.format(object=key, name=name), duration=0.03)
        text = text.replace("[effects]", SECOND + "[effects]")
        return shell_run(text)[0][-1].observations[name].points

    for name, other in (("s", "t"), ("t", "s")):
        every = end(name, "")
        assert np.array_equal(every, end(name, f'object = "{name}", '))
        assert not np.array_equal(every, end(name, f'object = "{other}", '))


def test_wind_on_an_equilibrium_is_refused_and_the_remedies_run(run, tmp_path):
    """It has no energy: it changed nothing there, with exit 0."""
    scene, clamp = tmp_path / "plate.toml", "pin = { vertices = [0, 1, 2] }\n"
    wind = "wind = { velocity = [0, 0, 5] }"
    scene.write_text(plate_text(clamp + wind, integrator="static"))
    result = run("shell-sim", scene)
    assert result.exit_code == 2 and "wind: the force of the wind has no energy" in result.stderr
    scene.write_text(plate_text(clamp + "load = { traction = [0, 0, 16] }", integrator="static"))
    assert run("shell-sim", scene).exit_code == 0
    scene.write_text(plate_text(clamp + wind + "\ndamping = { mass = 10 }", integrator="implicit-euler"))
    assert run("shell-sim", scene).exit_code == 0


TUMBLING = """
[time]
integrator = "{integrator}"
step = {step}
duration = 0.16
frame_every = 0.16
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.2, 0.1], cells = [2, 1] }}
density = 0.3
thickness = "2 mm"
young = 1e7
poisson = 0.3
angular_velocity = [2, 5, 1]
[effects]
stretching = {{}}
bending = {{}}
wind = {{ velocity = [1, 0, "sin(20*t)"] }}
"""


@cache
def tumbled(integrator, n_steps):
    run, _, _ = shell_run(TUMBLING.format(integrator=integrator, step=0.16 / n_steps))
    return run[-1].observations["s"].points


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint", "bdf2"])
def test_a_plate_that_tumbles_in_gusts_moves_in_second_order(integrator):
    coarse, fine = (np.abs(tumbled(integrator, n) - tumbled("verlet", 1024)).max() for n in (40, 80))
    assert np.log2(coarse / fine) > 1.7
