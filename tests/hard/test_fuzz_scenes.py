"""Random valid scenes of the fuzz: every effect occurs, scenes run or are refused, faults are detected."""

import json
import time
import tomllib
from random import Random

import numpy as np
import pytest

from benchmarks.fuzz import inputs
from benchmarks.fuzz.scenes import FLUID_EFFECTS, SHELL_EFFECTS, fluid_scene, shell_scene
from ddgcli.models.fluid import scene as fluid
from ddgcli.models.shell import scene as shell


@pytest.mark.parametrize(
    "table, package, make", [(SHELL_EFFECTS, shell, shell_scene), (FLUID_EFFECTS, fluid, fluid_scene)]
)
def test_random_scenes_name_every_effect_that_the_simulator_has(table, package, make):
    assert set(table) == set(package.EFFECTS)
    scenes = [tomllib.loads(make(Random(seed)).decode()) for seed in range(200)]
    assert {effect for scene in scenes for effect in scene["effects"]} == set(table)
    assert make(Random(7)) == make(Random(7)) != make(Random(8))


@pytest.mark.parametrize("name", ["valid shell scene", "valid fluid scene"])
def test_a_random_scene_runs_or_is_refused_in_one_line(name):
    kind = inputs.kinds()[name]
    read = kind.reader()
    accepted = 0
    for seed in range(5):
        try:
            read(kind.random_input(Random(seed)))
            accepted += 1
        except inputs.DdgError as refusal:
            assert str(refusal).startswith("Error: ") and "\n" not in str(refusal)
    assert accepted


BALLOON = b"""[[object]]
name = "balloon"
role = "shell"
sphere = { radius = 0.1, subdivisions = 0 }
material = "rubber"
young = "9223372036854775808 MPa"
[effects]
stretching = {}
pressure = { value = 9223372036854775807, times = [0, 0.3], factors = [0, 1] }
"""


@pytest.mark.parametrize("is_run", [True, False])
def test_a_scene_that_is_predicted_to_take_long_is_a_dry_run(is_run, monkeypatch):
    """A run as long as its dry run states is no escape; seconds of earlier trials are not its own."""
    earlier = time.process_time
    monkeypatch.setattr(time, "process_time", lambda: earlier() + inputs.SECONDS_FOR_A_RUN)
    short = BALLOON.replace(b"9223372036854775808 MPa", b"1 MPa").replace(b"9223372036854775807", b"10")
    text = b"[time]\nduration = 0.01\nstep = 0.01\n" + short if is_run else BALLOON
    summary = json.loads(inputs.kinds()["scene"].reader()(text).stdout)
    assert ("dry_run" in summary) is not is_run


def test_an_output_after_a_refusal_and_a_point_that_is_not_finite_are_escapes(tmp_path, monkeypatch):
    path = tmp_path / "run.vtkhdf"
    inputs._check_trajectory(path, 2)
    path.write_bytes(b"")
    with pytest.raises(RuntimeError, match="there is an output"):
        inputs._check_trajectory(path, 2)

    class Trajectory:
        n_frames = 2

        def __init__(self, path):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def points(self, frame_number):
            return np.full((4, 3), np.nan if frame_number else 0.0)

    monkeypatch.setattr("ddgcli.io.trajectories.trajectory.Trajectory", Trajectory)
    with pytest.raises(RuntimeError, match="frame 1 is not finite"):
        inputs._check_trajectory(path, 0)
