"""A plate between floor and ceiling: no scheme gives it energy, whatever takes the steps that fail."""

import numpy as np
import pytest

from ddgcli.models.shell.report import RunRounding, failure_reason
from ddgcli.simulation.outcome import Outcome
from tests.simulate import scalar, shell_run

PLATE = """
[time]
duration = 0.06
step = 1e-3
frame_every = 1e-3
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.2, 0.2], cells = [2, 2] }}
density = 1
thickness = "1 mm"
young = 1e7
poisson = 0
position = [0, 0, 0.0105]
velocity = [0, 0, -1.4]
[[object]]
name = "floor"
role = "obstacle"
plane = {{ point = [0, 0, 0], normal = [0, 0, 1] }}
[[object]]
name = "ceiling"
role = "obstacle"
plane = {{ point = [0, 0, 0.02], normal = [0, 0, -1] }}
[effects]
gravity = {{}}
stretching = {{}}
bending = {{}}
contact = {{ pairs = [["s", "floor"], ["s", "ceiling"]], gap = "1 mm" }}
"""


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint"])
def test_a_plate_loses_energy_at_every_impact(integrator):
    """Unjudged, the composite steps gave a fourth of the energy at the first impact."""
    run, _, _ = shell_run(PLATE.format(integrator=integrator))
    assert any(event.kind in ("energy falls", "barrier crossed") for shot in run for event in shot.events)
    height = np.array([snapshot.observations["s"].points[:, 2].mean() for snapshot in run])
    turns = np.count_nonzero(np.diff(np.sign(np.diff(height))))
    assert turns >= 3
    energy = np.array(scalar(run, "energy"))
    at_hand = energy[0] - (energy - np.array(scalar(run, "energy_kinetic"))).min()
    assert (energy - np.minimum.accumulate(energy)).max() <= 0.02 * at_hand
    assert energy[-1] > 0.2 * energy[0]


def test_growth_is_measured_by_the_energy_of_the_start():
    """A run that grows reaches heights that are no scale for the growth."""
    kinetic = np.array([0.0, 4.0, 0.0])
    gravity = np.array([1.0, 0.0, 4.0])
    series = {"energy_kinetic": kinetic, "energy_gravity": gravity, "energy": kinetic + gravity}
    grown = Outcome(series=series)
    assert "grew by 3 of the available energy" in failure_reason(
        grown, RunRounding(1e-12, 0.0, 0.0), static=False
    )
    assert failure_reason(grown, RunRounding(10.0, 0.0, 0.0), static=False) == ""
    assert failure_reason(grown, RunRounding(1e-12, 0.0, 0.0), static=True) == ""
