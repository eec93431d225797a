"""Forces and viscosity of `fluid-sim`: one implicit step, in balance at any step, in any order of effects."""

import numpy as np
import pytest

import ddgcli as ddg

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
    assert one.scalar["kinetic_energy"] > 1e-5
    assert np.array_equal(one.vertex["velocity"], other.vertex["velocity"])
