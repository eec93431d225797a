"""Schemes of order 2 keep it where loads, pressures and wind change in time, and beside drag."""

import logging
from functools import cache

import numpy as np
import pytest

from tests.simulate import shell_run

SCENE = """
[time]
duration = 0.05
step = {step}
frame_every = 0.05
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
{shape}
young = 2e3
poisson = 0.3
thickness = 3e-3
density = 0.7
{floor}
[effects]
stretching = {{}}
bending = {{}}
{effects}
"""
GRID = "grid = { size = [0.3, 0.2], cells = [3, 2] }"
BALL = "sphere = { center = [0, 0, 0], radius = 0.2, subdivisions = 1 }"
PINS = "pin = { vertices = [0, 1] }\n"
MOVING_PLATE = """
[[object]]
name = "plate"
role = "obstacle"
plane = { point = [0, 0, -0.5], normal = [0, 0, 1] }
velocity = [0, 0, -0.1]
"""
DRIVING = {
    "a load that falls": (GRID, PINS + "load = {traction=[0,0,20], times=[0,0.05], factors=[1,0]}"),
    "a load beside gravity": (
        GRID, PINS + "gravity = {}\nload = {traction=[0,0,20], times=[0,0.05], factors=[1,0]}"
    ),
    "wind in time": (GRID, PINS + 'wind = {velocity=["0","0","3*cos(60*t)"], density=5}'),
    "pressure": (BALL, "pressure = {value=40, times=[0,0.05], factors=[1,-0.5]}"),
    "gas": (BALL, "pressure = {value=40, gas=true, ambient=100, times=[0,0.05], factors=[1,3]}"),
    "a constant moment": (
        GRID, "pin = {vertices=[0,1,2], clamp=true}\nload = {moment=0.01, vertices=[9,10,11]}"
    ),
    "a moment": (
        GRID,
        "pin = {vertices=[0,1,2], clamp=true}\n"
        "load = {moment=0.01, vertices=[9,10,11], times=[0,0.05], factors=[1,0]}",
    ),
}  # fmt: skip


def end(integrator, step, shape, effects, floor=""):
    text = SCENE.format(step=step, integrator=integrator, shape=shape, effects=effects, floor=floor)
    return shell_run(text)[0][-1].observations["s"]


@cache
def truth_of(shape, effects):
    """The end by explicit steps of a fifth of the shortest that are compared."""
    return end("verlet", 5e-5, shape, effects)


@pytest.mark.parametrize("driving", DRIVING)
@pytest.mark.parametrize("integrator", ["bdf2", "newmark", "implicit-midpoint", "avi"])
def test_what_drives_a_shell_does_not_lower_the_order(integrator, driving, caplog):
    """Once `bdf2` took work of changing loads, and of moments, for energy that the step had gained."""
    with caplog.at_level(logging.WARNING):
        truth = truth_of(*DRIVING[driving]).points
        step = 5e-4 if integrator == "bdf2" else 1e-3
        errors = [
            np.abs(end(integrator, h, *DRIVING[driving]).points - truth).max() for h in (step, step / 2)
        ]
    size = np.abs(truth).max()
    assert errors[1] < 2e-4 * size and errors[0] > 3.0 * errors[1]
    assert "energy rises" not in caplog.text


@pytest.mark.parametrize("driving", ["damping = {mass=10}", "wind = {velocity=[0,0,3], density=5}",
                                     PINS + "damping = {stiffness=5e-3}"])  # fmt: skip
def test_asynchronous_steps_keep_their_order_beside_drag(driving):
    effects = "gravity = {}\n" + driving
    truth = truth_of(GRID, effects)
    errors = [
        np.abs(end("avi", h, GRID, effects).vertex["velocity"] - truth.vertex["velocity"]).max()
        for h in (1e-3, 5e-4)
    ]
    assert errors[1] < 2e-4 and 3.0 < errors[0] / errors[1] < 5.0


@pytest.mark.parametrize("integrator", ["bdf2", "newmark", "implicit-midpoint", "implicit-euler"])
def test_a_changing_pressure_beside_a_moving_obstacle_is_not_a_gain(integrator, caplog):
    """Once the energy that a pressure has since it changed counted as work of the obstacle's step."""
    effects = DRIVING["pressure"][1] + '\ncontact = { pairs = [["s", "plate"]] }'
    with caplog.at_level(logging.WARNING):
        beside = end(integrator, 1e-3, BALL, effects, MOVING_PLATE)
        alone = end(integrator, 1e-3, *DRIVING["pressure"])
    assert "energy" not in caplog.text
    assert np.abs(beside.points - alone.points).max() < 1e-9
