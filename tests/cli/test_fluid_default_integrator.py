"""`ddgcli fluid-sim` without an integrator: the default depends on the mesh and is in the summary."""

import json
from pathlib import Path

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.io.trajectories.trajectory import Trajectory

BOX = '[[object]]\nname = "box"\nrole = "fluid"\nbox = { size = [1, 1, 1], cells = [2, 2, 2] }\n'
SQUARE = '[[object]]\nname = "sheet"\nrole = "fluid"\ngrid = { size = [1, 1], cells = [2, 2] }\n'
FLOW = '[effects.initial]\nvelocity = ["y-0.5", "0.5-x", 0]\n'
TIME = "[time]\nduration = 0.02\nstep = 0.01\n"


def scene(path, objects, time=TIME):
    path.write_text(time + objects + FLOW)
    return path


@pytest.mark.parametrize(
    "objects, integrator",
    [(SQUARE, "conservative"), (BOX, "energy")],
    ids=("surface", "volume"),
)
def test_the_default_integrator_is_one_that_the_meshes_have(run, summary, tmp_path, objects, integrator):
    path = scene(tmp_path / "s.toml", objects)
    out = summary("fluid-sim", path, "-o", tmp_path / "run.vtkhdf")
    assert out["results"]["integrator"] == integrator
    assert out["results"]["kinetic_energy"] == pytest.approx(out["results"]["kinetic_energy_start"], rel=1e-9)
    planned = summary("fluid-sim", path, "--dry-run")
    assert planned["assembled"]["integrator"] == planned["scene"]["time"]["integrator"] == integrator
    with Trajectory(str(tmp_path / "run.vtkhdf")) as recorded:
        assert json.loads(recorded.text("scene_resolved"))["scene"]["time"]["integrator"] == integrator
    named = summary("fluid-sim", path, "--integrator", integrator)
    assert named["results"]["kinetic_energy"] == out["results"]["kinetic_energy"]
    assert "integrator" in run("fluid-sim", path).stdout


def test_the_quick_form_runs_a_tetrahedral_mesh_with_its_defaults(summary, tmp_path):
    ddg.write_mesh(str(tmp_path / "box.vtu"), ddg.read_mesh("sample_meshes/ball.vtu").mesh)
    out = summary("fluid-sim", tmp_path / "box.vtu", "--flow", "vortex-ring", "--steps", 1)
    assert out["results"]["integrator"] == "energy" and out["accuracy"]["energy_drift"] < 1e-12


def test_a_surface_and_a_volume_in_one_scene_are_refused(run, tmp_path):
    for objects, line in ((BOX + SQUARE, 8), (SQUARE + BOX, 8)):
        result = run("fluid-sim", scene(tmp_path / "s.toml", objects))
        assert result.exit_code == 2 and f"s.toml: line {line}: " in result.stderr
        assert "write a scene for each" in result.stderr


def test_a_key_of_the_default_scheme_names_it(run, tmp_path):
    """`scheme` belongs to `conservative`: a volume does not take another integrator in silence."""
    result = run("fluid-sim", scene(tmp_path / "s.toml", BOX, TIME + 'scheme = "midpoint"\n'))
    assert result.exit_code == 2 and "conservative does not exist in 3-D" in result.stderr


def test_the_library_takes_the_same_default():
    box = {"role": "fluid", "box": {"size": [1, 1, 1], "cells": [2, 2, 2]}}
    document = {"object": [box], "effects": {"initial": {"velocity": ["y-0.5", "0.5-x", 0]}}}
    simulation = ddg.simulate(document, steps=2)
    assert simulation.scene["time"]["integrator"] == "energy"
    assert np.ptp([one.scalar["kinetic_energy"] for one in simulation]) < 1e-12


def test_the_energy_of_a_picture_has_the_unit_of_the_dimension(run, tmp_path, monkeypatch):
    labels = []

    monkeypatch.setattr(
        "ddgcli.cli.simulation.scene_run.draw_run",
        lambda path, outcome, picture, *others: labels.append(picture.energy),
    )
    samples = Path(__file__).parents[2] / "sample_meshes"
    for name in ("ball.vtu", "sphere.ply"):
        words = ("--steps", 1, "--dt", 0.01, "--plot", tmp_path / "a.png")
        assert run("fluid-sim", samples / name, *words).exit_code == 0
    assert [label.split("[")[1] for label in labels] == ["m⁵/s²]", "m⁴/s²]"]
