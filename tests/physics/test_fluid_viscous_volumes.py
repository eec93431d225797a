"""Viscous flow in volumes along walls without slip: steps, order and pressure."""

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.errors import SolveError
from ddgcli.models.fluid import volume_viscosity
from tests.physics.test_fluid_sources import end_of

CHANNEL = [
    {"kind": "inflow", "velocity": ["4*z*(1-z)", 0, 0], "where": "x<1e-6"},
    {"kind": "outflow", "where": "x>1-1e-6"},
    {"kind": "free-slip", "where": "y<1e-6"},
    {"kind": "free-slip", "where": "y>0.5-1e-6"},
    {"kind": "no-slip"},
]
LID = [{"kind": "wall", "velocity": [1, 0, 0], "where": "z>1-1e-6"}, {"kind": "no-slip"}]


def slope_of_pressure(n, dt, nu):
    """Of Poiseuille flow between plates, by the middle half of the channel; exact: -8 nu."""
    box = {"box": {"size": [1, 0.5, 1], "cells": [n, n // 2, n]}}
    effects = {"viscosity": {"nu": nu}, "boundary": CHANNEL, "pressure": {}}
    points, end = end_of(box, effects, dt, 1.0 / nu if nu > 0.5 else 4.0)
    inner = (points[:, 0] > 0.24) & (points[:, 0] < 0.76)
    fit = np.polyfit(points[inner, 0], end.vertex["pressure"][inner], 1)[0]
    middle = (np.abs(points[:, 0] - 0.5) < 1e-9) & (np.abs(points[:, 2] - 0.5) < 1e-9)
    return fit, float(end.vertex["velocity"][middle, 0].mean())


def test_a_steady_channel_does_not_depend_on_the_step():
    """Once its slope of pressure was -15 in steps of 0.2 and -8.6 in steps of 0.0125 (8 cells; exact -8)."""
    (slope, speed), (fine_slope, fine_speed) = (slope_of_pressure(4, dt, 1.0) for dt in (0.2, 0.05))
    assert abs(slope - fine_slope) < 2e-3 * 8 and abs(speed - fine_speed) < 1e-3
    assert abs(slope + 8) < 0.07 * 8 and abs(speed - 1) < 0.1


def test_the_pressure_converges_along_walls_without_slip():
    """Once its error grew with the number of cells, at a fixed step."""
    errors = [abs(slope_of_pressure(n, 0.2, 0.1)[0] + 0.8) for n in (4, 8)]
    assert errors[1] < 0.02 * 0.8 and errors[1] < 0.4 * errors[0]


@pytest.mark.parametrize("nu, duration", [(0.1, 1.2), (1.0, 0.2)])
def test_a_flow_below_a_lid_is_of_second_order_in_time(nu, duration):
    """Once of first order: 13 % in the second case between steps of 0.05 and 0.003."""
    box = {"box": {"size": [1, 1, 1], "cells": [4, 4, 4]}}
    effects = {"viscosity": {"nu": nu}, "boundary": LID}
    ends = []
    for count in (4, 8, 16):
        points, end = end_of(box, effects, duration / count, duration)
        below = points[:, 2] < 1 - 1e-6
        ends.append(end.vertex["velocity"][below])
    changes = [np.linalg.norm(ends[k] - ends[k + 1]) / np.linalg.norm(ends[-1]) for k in (0, 1)]
    assert changes[1] < 0.01 and changes[0] > 3 * changes[1]


def flow_of(nu):
    """Two steps of a stream through a small channel."""
    scene = {
        "time": {"duration": 0.025, "step": 0.0125, "frame_every": 0.025},
        "object": [{"role": "fluid", "box": {"size": [1, 0.5, 1], "cells": [4, 2, 4]}}],
        "effects": {"viscosity": {"nu": nu}, "boundary": CHANNEL},
    }
    return ddg.simulate(scene).finish()


def test_flows_of_very_viscous_fluids_are_that_of_stokes_without_divergence():
    """Once the rounding of the pressure was a divergence of 0.02 at nu = 1e12."""
    ends = [flow_of(nu) for nu in (1e4, 1e8)]
    assert all(end.accuracy["divergence_max"] < 1e-12 for end in ends)
    velocity = [end.vertex["velocity"] for end in ends]
    assert np.abs(velocity[0] - velocity[1]).max() < 1e-3
    with pytest.raises(SolveError, match="leaves no digit of the flow along walls without slip; lessen nu"):
        flow_of(1e14)


def test_a_step_that_is_not_solved_is_reported(monkeypatch):
    monkeypatch.setattr(volume_viscosity, "MAX_ROUNDS", 1)
    with pytest.raises(SolveError, match="viscosity at walls was not solved in 1 rounds"):
        flow_of(1.0)
