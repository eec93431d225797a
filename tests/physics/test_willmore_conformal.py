"""Conformal flow: curvature becomes constant in a few long steps, triangles keep their shapes."""

import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore.conformal import conformal_step, distance_from_rest, log_ratio_change
from ddgcli.models.willmore.constraints import area
from ddgcli.models.willmore.endings import EndingKind
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import CONFORMAL_STOP
from tests.physics.willmore_runs import assert_falls, ellipsoid, energies, run_flow

CONFORMAL = FlowOptions(flow="conformal", stop=CONFORMAL_STOP)


def bumpy_torus(cells):
    ring = shapes.torus(2 * cells, cells, 2.0, 1.0)
    x, _, z = ring.points.T
    return ring.moved(ring.points * (1 + 0.08 * np.sin(2 * x + z))[:, None])


def test_a_step_of_no_length_is_the_identity():
    for mesh in (ellipsoid(2), shapes.torus(16, 8)):
        assert np.abs(conformal_step(mesh, 0.0).points - mesh.points).max() < 1e-6


def test_log_ratio_change_is_zero_of_similarities_and_that_of_a_stretch():
    mesh = shapes.icosphere(1)
    assert log_ratio_change(mesh, mesh.moved(3.0 * mesh.points))["log_ratio_change_max"] < 1e-12
    square = shapes.grid(2, 2)  # horizontal against vertical sides
    stretched = log_ratio_change(square, square.moved(square.points * [2.0, 1.0, 1.0]))
    assert stretched["log_ratio_change_max"] == pytest.approx(np.log(2.0))


def test_an_ellipsoid_is_round_after_a_few_steps_and_its_map_is_nearly_conformal():
    change = []
    for level in (2, 3):
        mesh = ellipsoid(level)
        snapshots, end, _ = run_flow(mesh, CONFORMAL)
        assert len(snapshots) <= 9
        assert energies(snapshots)[-1] == pytest.approx(4 * np.pi, rel=2e-2 / 4 ** (level - 1))
        assert area(end) == pytest.approx(area(mesh), rel=1e-10)
        last = snapshots[-1].scalar
        assert last["log_ratio_change_mean"] < 0.6 * last["log_ratio_change_max"] + 0.02
        change.append(last["log_ratio_change_max"])
        assert np.array_equal(end.faces, mesh.faces)
        assert_falls(snapshots)
    assert change[1] < 0.1 and change[1] < 0.6 * change[0]  # of first order: that of the icosphere's faces


def test_conformal_steps_are_at_most_a_tenth_of_those_in_time():
    """3 against 49, until a hundredth of the start's energy above 4 pi is left.

    The steps in time are of the default length, 0.005 R^4; R is the radius of the sphere of the same area.
    """
    mesh = ellipsoid(3)
    by_steps = energies(run_flow(mesh, CONFORMAL)[0]) / (4 * np.pi) - 1
    steps = int(np.flatnonzero(by_steps < 0.01 * by_steps[0])[0])
    radius = np.sqrt(area(mesh) / (4 * np.pi))
    snapshots, _, _ = run_flow(mesh, FlowOptions(timed=True), step=5e-3 * radius**4, steps=10 * steps)
    in_time = energies(snapshots) / (4 * np.pi) - 1
    assert steps <= 4 and snapshots[-1].scalar["steps"] == 10 * steps
    assert in_time[-1] > 0.01 * in_time[0]


def test_tori_of_revolution_stay_where_the_plain_step_would_tear_them():
    """They are constrained Willmore surfaces: no other torus of their conformal class is lower nearby."""
    ring = shapes.torus(32, 16, 3.0, 1.0)
    moved = conformal_step(ring, 1.0)
    assert log_ratio_change(ring, moved)["log_ratio_change_max"] < 2e-4


@pytest.mark.parametrize("major", [3.0, np.sqrt(2.0)])
def test_a_torus_of_revolution_is_at_rest_whatever_the_degrees_of_its_vertices(major):
    """Of diagonals that alternate, every second vertex has four faces and the others eight."""
    ring = shapes.torus(32, 24, major, 1.0, pattern="alternating")
    snapshots, end, shots = run_flow(ring, CONFORMAL)
    assert shots[-1].ending.kind != EndingKind.UNRESOLVED
    assert distance_from_rest(ring) < 0.005 * energies(snapshots)[0]
    assert np.abs(end.points - ring.points).max() < 0.02


def test_a_bumpy_torus_returns_to_one_of_revolution():
    """The energy of its class: no lower than that of the torus near it, 4 pi^2 / sqrt(3)."""
    snapshots, _, _ = run_flow(bumpy_torus(24), CONFORMAL)
    start, end = energies(snapshots)[[0, -1]]
    truth = 4 * np.pi**2 / np.sqrt(3)
    assert start > 1.1 * truth and end == pytest.approx(truth, rel=0.02)
    assert snapshots[-1].scalar["log_ratio_change_max"] < 0.15
    assert snapshots[-1].scalar["log_ratio_change_mean"] < 0.03
    assert len(snapshots) < 15
    assert_falls(snapshots)


@pytest.mark.parametrize(
    "mesh, words, message",
    [
        (shapes.grid(3, 3), (), "closed"),
        (ellipsoid(1), ("--fix-volume",), "--flow quadratic"),
        (ellipsoid(1), ("--dt", "1e-3"), "--dt"),
        (ellipsoid(1), ("--integrator", "rosenbrock"), "choose conformal"),
    ],
)
def test_what_conformal_flow_cannot_take_is_refused(run, tmp_path, mesh, words, message):
    path = tmp_path / "mesh.ply"
    write_mesh(str(path), AnnotatedMesh(mesh))
    result = run("willmore-flow", path, "--flow", "conformal", *words, "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_the_command_reports_how_conformal_it_was(run, tmp_path):
    path = tmp_path / "mesh.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(2)))
    result = run("willmore-flow", path, "--flow", "conformal", "--steps", 3, "--json")
    accuracy = json.loads(result.stdout)["accuracy"]
    assert result.exit_code == 0
    assert 0 < accuracy["log_ratio_change"]["mean"] < accuracy["log_ratio_change"]["max"] < 0.3
    assert accuracy["energy_increases"] == 0
