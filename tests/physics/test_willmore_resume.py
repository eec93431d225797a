"""A run that was interrupted and resumed has the bits of the whole run, whatever flow it is."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore import endings
from ddgcli.models.willmore.flow import Flow
from ddgcli.simulation.active_model import packed_ending, unpacked_ending
from ddgcli.simulation.model import Ending
from tests.physics.test_willmore_filling import ball_with_holes
from tests.physics.willmore_runs import bowl, ellipsoid, two_components

CUT_AFTER, STEPS = 3, 6
OFTEN = (
    "newton", "conformal", "circle-angle", "bubble", "catenoid", "mean curvature in time", "two spheres",
    "vesicle", "spontaneous curvature", "region", "fill",
)  # fmt: skip


def marked():
    """An ellipsoid whose upper half is the array `cap`."""
    mesh = ellipsoid(1)
    return AnnotatedMesh(mesh, vertex={"cap": (mesh.points[:, 2] > 0.3).astype(float)})


RUNS = {
    "newton": (ellipsoid(1), ["--flow", "newton"]),
    "newton, area and volume": (ellipsoid(2), ["--flow", "newton", "--fix-area", "--fix-volume"]),
    "conformal": (ellipsoid(1), ["--flow", "conformal"]),
    "circle-angle": (ellipsoid(1), ["--flow", "circle-angle"]),
    "circle-angle in time": (ellipsoid(1), ["--flow", "circle-angle", "--dt", "1e-3"]),
    "bubble": (ellipsoid(1), ["--flow", "mean-curvature", "--fix-volume"]),
    "largest volume": (ellipsoid(1), ["--flow", "mean-curvature", "--fix-area"]),
    "catenoid": (shapes.cylinder(16, 8, 1.0, 1.2), ["--flow", "mean-curvature"]),
    "mean curvature in time": (ellipsoid(1), ["--flow", "mean-curvature", "--dt", "1e-3"]),
    "two spheres": (
        two_components(shapes.icosphere(1), shapes.icosphere(1, 0.1)),
        ["--flow", "mean-curvature", "--dt", "5e-3"],
    ),
    "vesicle": (ellipsoid(2), ["--fix-area", "--fix-volume"]),
    "spontaneous curvature": (ellipsoid(2), ["--spontaneous-curvature", "0.4", "--fix-area", "--fix-volume"]),
    "region": (marked(), ["--region", "cap"]),
    "fill": (ball_with_holes(2, 0.5), ["--fill", "all"]),
    "clamped": (bowl(), []),
    "energy": (ellipsoid(1), ["--energy", "sullivan", "--report-energy", "all"]),
    "semi-implicit": (ellipsoid(1), ["--dt", "1e-3", "--integrator", "semi-implicit"]),
    "subdivided": (ellipsoid(1), ["--subdivide", "1"]),
}


def points_and_times(path):
    """Points and time of each frame."""
    with Trajectory(str(path)) as trajectory:
        shots = [trajectory.read_frame(k) for k in range(trajectory.n_frames)]
    return [(np.array(shot.points), shot.time) for shot in shots]


@pytest.mark.parametrize("name", [n if n in OFTEN else pytest.param(n, marks=pytest.mark.slow) for n in RUNS])
def test_a_resumed_flow_has_the_same_bits(run, tmp_path, monkeypatch, name):
    mesh, words = RUNS[name]
    source = tmp_path / "start.vtu"
    write_mesh(str(source), mesh if isinstance(mesh, AnnotatedMesh) else AnnotatedMesh(mesh))
    words = ["willmore-flow", source, *words, "--steps", STEPS]
    whole, interrupted = tmp_path / "whole.vtkhdf", tmp_path / "interrupted.vtkhdf"
    result = run(*words, "-o", whole)
    assert result.exit_code == 0, result.stderr
    advance, calls = Flow.advance, []

    def cut(self, state, time, dt):
        calls.append(time)
        if len(calls) > CUT_AFTER:
            raise KeyboardInterrupt
        return advance(self, state, time, dt)

    monkeypatch.setattr(Flow, "advance", cut)
    assert run(*words, "-o", interrupted).exit_code == 130
    monkeypatch.setattr(Flow, "advance", advance)
    resumed = run(*words, "--resume", f"{interrupted}.part")
    assert resumed.exit_code == 0, resumed.stderr
    expected, observations = points_and_times(whole), points_and_times(interrupted)
    assert len(expected) == len(observations) > CUT_AFTER
    for (points, time), (again, then) in zip(expected, observations):
        assert np.array_equal(points, again) and time == then
    assert not np.array_equal(expected[CUT_AFTER][0], expected[-1][0])  # steps follow the interrupt


def test_a_checkpoint_holds_the_kind_and_the_text_of_every_ending():
    """The longest fits: an ended run that is resumed fails as it had."""
    fixed = [value for value in vars(endings).values() if isinstance(value, Ending)]
    formatted = [endings.small_gradient(1e-7), endings.immovable("clamped", True), endings.singular(1 / 3)]
    assert len(fixed) > 10
    for ending in [*fixed, *formatted]:
        assert unpacked_ending(packed_ending(ending)) == ending
    assert unpacked_ending(packed_ending(None)) is None
