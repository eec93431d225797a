"""Forces and viscosity of `fluid-sim`: one implicit step, in balance at any step, in any order of effects."""

import re

import numpy as np
import pytest

import ddgcli as ddg
from benchmarks.fluids.runs import run_fluid
from ddgcli.models.fluid.time_resolution import MAX_DEVIATION, unresolved_share

FORCE = {"force": {"acceleration": [8, 0, 0]}}
VISCOSITY = {"viscosity": {"nu": 1.0}}
WARM = {
    "buoyancy": {
        "temperature": "cos(3.14159*x)",
        "expansion": 0.1,
        "gravity": [0, -10, 0],
        "diffusivity": 0.1,
    }
}
TURN = {"rotation": {"angular_velocity": [0, 0, 2]}}
CHANNEL = {"grid": {"size": [2, 1], "cells": [8, 8], "periodic": "x"}}
BOX = {"box": {"size": [2, 1, 1], "cells": [3, 3, 3]}}


def end_of(shape, effects, step, duration=1.5):
    time = {"duration": duration, "step": step, "frame_every": duration}
    simulation = ddg.simulate({"time": time, "object": [{"role": "fluid", **shape}], "effects": effects})
    return simulation.mesh.points, list(simulation)[-1]


@pytest.mark.parametrize("step", [0.1, 0.025])
def test_a_force_drives_poiseuille_flow_between_walls_whatever_the_step(step):
    """u = 4 y (1 - y), energy 8/15: the error is the mesh's alone (26 % where they act in turn)."""
    effects = {"harmonic": {}, "boundary": {"kind": "no-slip"}, **FORCE, **VISCOSITY}
    points, end = end_of({"grid": {**CHANNEL["grid"], "cells": [12, 12]}}, effects, step)
    y = points[:, 1]
    inside = (y > 0) & (y < 1)
    u = end.vertex["velocity"][inside, 0]
    assert np.abs(u - 4 * y[inside] * (1 - y[inside])).max() < 0.02
    assert end.scalar["kinetic_energy"] == pytest.approx(8 / 15, rel=0.02)


@pytest.mark.parametrize("pattern", ["right", "alternating"])
def test_a_force_in_balance_with_pressure_makes_no_vorticity_in_the_corners_of_walls(pattern):
    """There it grew by 2/3 a second on any mesh: the corner's cell took the forces of two faces."""
    square = {"grid": {"size": [1, 1], "cells": [6, 6], "pattern": pattern}}
    layers = {"buoyancy": {"temperature": "y", "expansion": 1.0, "gravity": [0, -1, 0]}}
    for effects in (layers, {"force": {"acceleration": ["y", "x + y", "0"]}}):
        _, end = end_of(square, effects, 0.1, 1.0)
        assert np.abs(end.vertex["vorticity"]).max() < 1e-12


@pytest.mark.parametrize(
    ("shape", "effects"),
    [
        (CHANNEL, {"harmonic": {}, "boundary": {"kind": "no-slip"}, **FORCE, **WARM, **TURN, **VISCOSITY}),
        (CHANNEL, {**WARM, **TURN, **VISCOSITY}),
        (CHANNEL, {**FORCE, **WARM, **TURN}),
        (BOX, {"boundary": {"kind": "no-slip"}, **WARM, **VISCOSITY}),
    ],
    ids=("walls", "slip", "inviscid", "volume"),
)
def test_a_run_does_not_depend_on_the_order_of_effects_in_the_scene(shape, effects):
    (_, one), (_, other) = (
        end_of(shape, dict(order), 0.05, 0.2) for order in (effects.items(), reversed(effects.items()))
    )
    assert one.scalar["kinetic_energy"] > 5e-6
    assert np.array_equal(one.vertex["velocity"], other.vertex["velocity"])


@pytest.mark.parametrize("kind", ["hodge", "bochner"])
def test_a_frozen_harmonic_flow_is_a_constant_flux_between_walls_without_slip(kind):
    """Poiseuille's profile 6 U y (1 - y): it came to rest as an evolved one does."""
    flows = {"kind": "frozen", "coefficients": [2**0.5]}  # U = 1 in a channel of area 2
    effects = {"harmonic": flows, "boundary": {"kind": "no-slip"}, "viscosity": {"nu": 1.0, "kind": kind}}
    points, end = end_of({"grid": {**CHANNEL["grid"], "cells": [12, 12]}}, effects, 0.1, 2.0)
    y, u = points[:, 1], end.vertex["velocity"][:, 0]
    inside = (y > 0) & (y < 1)
    sign = np.sign(u.sum())  # that of the basis
    assert np.abs(sign * u - 6 * y * (1 - y))[inside].max() < 0.02 * 1.5


def test_adaptive_steps_follow_sources_and_particles_in_a_steady_flow():
    """The flow has no error; steps that follow it alone added 1.15 times the dye."""
    time = {"duration": 1.0, "frame_every": 1.0, "tolerance": 1e-3}
    cell = {"vorticity": "2*pi*sin(pi*x)*sin(pi*y)"}
    effects = {"initial": cell, "dye": {"source": "sin(50*t)^2"}, "particles": {"points": [[0.5, 0.3, 0]]}}
    square = {"role": "fluid", "name": "f", "grid": {"size": [1, 1], "cells": [8, 8], "pattern": "right"}}
    places = []
    for control in (time, {"duration": 1.0, "frame_every": 1.0, "step": 0.005}):
        *_, end = ddg.simulate({"time": control, "object": [square], "effects": effects})
        assert end.scalar["total_dye"] == pytest.approx(0.5 - np.sin(100) / 200, rel=2e-3)
        places.append(end.scalar["particles_f"])
    assert np.abs(places[0] - places[1]).max() < 0.01


@pytest.mark.parametrize(
    "shape", ["grid = { size = [1, 1], cells = [2, 2] }", "box = { size = [1, 1, 1], cells = [1, 1, 1] }"]
)
@pytest.mark.parametrize(
    "effect, warns",
    [
        ('force = { acceleration = ["sin(1000*t)*y", 0, 0] }', True),  # meets 0.1 s in phase
        ('dye = { source = "1 + sin(1000*t)" }', True),
        ('force = { acceleration = ["sin(20*t)*y", 0, 0] }', False),  # 3.1 steps to a period
        ('force = { acceleration = ["sin(40*t)*y", 0, 0] }', True),  # 1.6 steps
        ('force = { acceleration = ["(t < 0.72)*y", 0, 0] }', False),  # a jump in one step of 20
        ('force = { acceleration = ["y + 0.01*sin(1000*t)", 0, 0] }', False),
    ],
)
def test_expressions_in_t_that_steps_do_not_follow_warn_with_a_step_that_does(shape, effect, warns, caplog):
    """Steps of 0.1 s took sin(1000 t) at single times, without a word."""
    run_fluid(effect, 'duration = 2\nstep = 0.1\nintegrator = "energy"', shape)
    assert ("varies faster in time than steps of 0.1 s" in caplog.text) == warns
    if warns:
        text = re.search("'(.*)' varies", caplog.text)[1]
        step = float(re.search("take steps of (.*) s", caplog.text)[1])
        assert unresolved_share(text, np.ones((1, 3)), step, 2.0) <= MAX_DEVIATION
        assert unresolved_share(text, np.ones((1, 3)), 4 * step, 2.0) > MAX_DEVIATION
