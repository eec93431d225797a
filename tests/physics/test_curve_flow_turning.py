"""Elastic flow keeps the turning number, through the nearest cusps and from them."""

import numpy as np
import pytest

from ddgcli.models.curve.setup import CurveFlowOptions, build
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Schedule
from ddgcli.simulation.time_loop import evolve
from tests.physics.test_curve_flow import closed_curve


def limacon(a, n):
    """z = e^is + a e^2is, with a cusp at a = 1/2: one turn below it, two above it."""
    s = 2 * np.pi * np.arange(n) / n
    z = np.exp(1j * s) + a * np.exp(2j * s)
    return closed_curve(np.stack([z.real, z.imag, 0 * s], axis=1))


@pytest.mark.parametrize("a, turns", [(0.499, 1), (0.52, 2)])
def test_limacons_near_the_cusp_end_as_circles_of_their_turning_number(a, turns):
    """Of energy turns^2 4 pi^2 / L. The first step is a million times longer than the tip's own time."""
    _, model = build(limacon(a, 80), CurveFlowOptions(flow="elastic"))
    scalars = [
        s.observations["curve"].scalar for s in evolve({"curve": model}, Schedule(0.05, 30), Account())
    ]
    energy = np.array([values["elastic_energy"] * values["length"] for values in scalars]) / (4 * np.pi**2)
    assert {values["turning_number"] for values in scalars} == {turns}
    assert (np.diff(energy) <= 0).all()
    assert energy[-1] == pytest.approx(turns**2, rel=1e-3)
