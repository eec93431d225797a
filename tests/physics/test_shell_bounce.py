"""A plate that falls on a floor: no scheme gives it energy, whatever takes the steps that fail."""

import numpy as np
import pytest

from ddgcli.models.shell.report import RunRounding, doubt
from ddgcli.simulation.outcome import Outcome
from tests.simulate import scalar, shell_run

PLATE = """
[time]
duration = 0.22
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
position = [0, 0, 0.011]
[[object]]
name = "floor"
role = "obstacle"
plane = {{ point = [0, 0, 0], normal = [0, 0, 1] }}
[effects]
gravity = {{}}
stretching = {{}}
bending = {{}}
contact = {{ pairs = [["s", "floor"]], gap = "1 mm" }}
"""


def peaks(height, floor=3e-3):
    """Largest heights between the landings."""
    up = np.flatnonzero(np.diff((height > floor).astype(int)))
    return [float(part.max()) for part in np.split(height, up + 1) if part.max() > floor]


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint"])
def test_a_dropped_plate_bounces_lower_each_time(integrator):
    run, _, _ = shell_run(PLATE.format(integrator=integrator))
    details = [event.detail for snapshot in run for event in snapshot.events]
    assert any("taken by the composite scheme" in detail for detail in details)
    found = peaks(np.array([snapshot.observations["s"].points[:, 2].mean() for snapshot in run]))
    assert len(found) >= 3 and all(later < earlier for earlier, later in zip(found, found[1:]))
    energy = np.array(scalar(run, "energy"))
    lowest = (energy - np.array(scalar(run, "energy_kinetic"))).min()
    assert energy.max() - energy[0] <= 0.01 * (energy[0] - lowest)


def test_growth_is_measured_by_the_energy_of_the_start():
    """A run that grows reaches heights that are no scale for the growth."""
    kinetic = np.array([0.0, 4.0, 0.0])
    gravity = np.array([1.0, 0.0, 4.0])
    series = {"energy_kinetic": kinetic, "energy_gravity": gravity, "energy": kinetic + gravity}
    grown = Outcome(series=series)
    assert "grew by 3 of what there is to move" in doubt(grown, RunRounding(1e-12, 0.0, 0.0))
    assert doubt(grown, RunRounding(10.0, 0.0, 0.0)) == ""
