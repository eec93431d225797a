"""Simulations and flows of `import ddgcli`: frames, results at their end, trajectories."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ddgcli as ddg
from tests.library.test_library_functions import RING, ROOT


def last_frame(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    with ddg.read_trajectory(path) as trajectory:
        return trajectory.points(trajectory.n_frames - 1), trajectory.vertex(trajectory.n_frames - 1)


FLOW = """
[[object]]
role = "fluid"
grid = { size = [1, 1], cells = [12, 12], periodic = "xy" }

[effects]
initial = { flow = "taylor-vortices", strength = 1.0, core = 0.1, separation = 0.3 }
"""


@pytest.mark.parametrize("command, name", [("shell-sim", "strain"), ("fluid-sim", "vorticity")])
def test_simulation_is_that_of_the_command(command, name, summary, tmp_path):
    scene = ROOT / "sample_scenes" / "hat.toml"
    if command == "fluid-sim":
        scene = tmp_path / "flow.toml"
        scene.write_text(FLOW)
    summary(command, scene, "--steps", "2", "-o", tmp_path / "run.vtkhdf")
    points, vertex = last_frame(tmp_path / "run.vtkhdf")
    run = ddg.simulate(scene, steps=2)
    *_, last = run
    np.testing.assert_array_equal(last.vertex[name], vertex[name])
    np.testing.assert_array_equal(run.mesh.points if last.points is None else last.points, points)


SHELL = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}


def falling(**options: Any) -> ddg.Simulation:
    return ddg.simulate({"object": [SHELL], "effects": {"gravity": {}}}, **options)


@pytest.mark.parametrize(
    "options, times",
    [
        ({"steps": 2}, [0.0, 0.01, 0.02]),
        ({"duration": 0.04, "step": 0.02}, [0.0, 0.02, 0.04]),
        ({"duration": 0.04, "frame_every": 0.02}, [0.0, 0.02, 0.04]),
        ({"duration": 0.04, "frame_every": 0.02, "tolerance": 1e-3}, [0.0, 0.02, 0.04]),
    ],
)
def test_times_of_frames_follow_the_options(options, times):
    run = falling(**options)
    assert run.n_frames == len(times)
    np.testing.assert_allclose([trajectory_frame.time for trajectory_frame in run], times, rtol=1e-12)


def test_integrator_of_a_simulation_is_used():
    *_, newmark = falling(steps=2)
    *_, euler = falling(steps=2, integrator="implicit-euler")
    assert newmark.points[0, 2] == pytest.approx(-9.81 * 0.02**2 / 2, rel=1e-9)
    assert euler.points[0, 2] == pytest.approx(-9.81 * 0.01**2 * 3, rel=1e-9)


@pytest.mark.parametrize(
    "scene, message",
    [
        ("missing.toml", "missing.toml: no such file"),
        ({}, r"no \[\[object\]\]"),
        ({"object": [SHELL], "effects": {"gravty": {}}}, "did you mean 'gravity'"),
        ({"object": [{**SHELL, "role": "sheet"}]}, "no role 'sheet'"),
        (
            {"object": [{"role": "obstacle", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}]},
            "is an obstacle; a scene of shell-sim needs one of role shell",
        ),
    ],
)
def test_wrong_scenes_are_refused_before_the_first_frame(scene, message):
    with pytest.raises(ddg.errors.SceneError, match=message):
        ddg.simulate(scene)


def mesh_of_shell() -> ddg.TriangleMesh:
    return falling().mesh


def test_trajectory_gives_back_the_frames(tmp_path):
    trajectory_frames = list(falling(steps=3))
    assert ddg.write_trajectory(tmp_path / "fall.vtkhdf", trajectory_frames, mesh_of_shell()) == 4
    with ddg.read_trajectory(tmp_path / "fall.vtkhdf") as trajectory:
        assert repr(trajectory).endswith("fall.vtkhdf', 4 frames)")
        assert "points=float64[" in repr(next(iter(trajectory)))
        for trajectory_frame, state in zip(trajectory_frames, trajectory, strict=True):
            np.testing.assert_array_equal(state.points, trajectory_frame.points)
            assert state.time == trajectory_frame.time


@pytest.mark.parametrize(
    "simulation",
    [
        lambda: ddg.curve_flow(RING, steps=2),
        lambda: ddg.willmore_flow(ddg.torus(32, 16), remesh="mean", steps=2),
        lambda: ddg.willmore_flow(ddg.torus(12, 6), "mean-curvature", steps=2),
    ],
)
def test_trajectories_hold_flows_of_curves_and_of_surfaces_whose_vertices_change(simulation, tmp_path):
    states = list(simulation())
    assert ddg.write_trajectory(tmp_path / "flow.vtkhdf", simulation()) == len(states) == 3
    with ddg.read_trajectory(tmp_path / "flow.vtkhdf") as trajectory:
        for state, stored in zip(states, trajectory, strict=True):
            np.testing.assert_array_equal(stored.points, state.points)
            assert state.faces is None or np.array_equal(stored.faces, state.faces)


def test_willmore_flow_is_that_of_the_command_and_judges_its_end_alike(run, tmp_path, caplog, monkeypatch):
    path = str(ROOT / "sample_meshes" / "torus.ply")
    done = run("willmore-flow", path, "--steps", 3, "-o", tmp_path / "end.npz", "--json")
    flow = ddg.willmore_flow(ddg.read_mesh(path), steps=3)
    states, end = list(flow), flow.finish()
    np.testing.assert_array_equal(states[-1].points, np.load(tmp_path / "end.npz")["points"])
    summary = json.loads(done.stdout)
    assert summary["results"] == json.loads(json.dumps(end.results))
    assert summary["accuracy"] == json.loads(json.dumps(end.accuracy))
    coarse = tmp_path / "coarse.off"
    ddg.write_mesh(coarse, ddg.torus(16, 8))
    command = run("willmore-flow", coarse, "--remesh", "mean", "--steps", 5)
    monkeypatch.setattr(logging.getLogger("ddgcli"), "propagate", True)  # the command has changed it
    end = ddg.willmore_flow(ddg.read_mesh(coarse), remesh="mean", steps=5).finish()
    reason = end.results["stopped_because"]
    noise = 0.1 * np.random.default_rng(0).normal(size=(162, 3))
    ddg.willmore_flow(ddg.icosphere(2).moved(ddg.icosphere(2).points + noise), steps=1).finish()
    assert "noise" in caplog.text  # the command's warnings of the surfaces
    assert command.exit_code == 1 and not end.converged
    assert "too coarse or uneven" in reason and reason in command.stderr and reason in caplog.text


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (("--fill", "all", "--report-energy", "all"), {"fill": "all", "report_energy": "all"}),
        (("--fill", "RIM", "--subdivide", 1), {"fill": "RIM", "subdivide": 1}),
        (("--region", "cap", "--subdivide", 1), {"region": "cap", "subdivide": 1}),
    ],
)
def test_willmore_flow_fills_and_subdivides_as_the_command_does(run, tmp_path, words, options):
    ball = ddg.icosphere(2)
    low = ball.points[ball.faces][..., 2].max(axis=1) < 0.8
    holed = ddg.repair_mesh((ball.points, ball.faces[low]), drop_unused=True).mesh
    path, cap = tmp_path / "a.npz", holed.points[:, 2] < -0.5
    rim = np.flatnonzero(holed.topology.boundary_vertex)[0]
    ddg.write_mesh(path, holed, vertex={"cap": cap.astype(float)})
    words = [rim if word == "RIM" else word for word in words]
    options = {name: {"RIM": rim, "cap": cap}.get(value, value) for name, value in options.items()}
    done = run("willmore-flow", path, *words, "--steps", 3, "-o", tmp_path / "end.npz", "--json")
    end, summary = ddg.willmore_flow(holed, steps=3, **options).finish(), json.loads(done.stdout)
    stored = np.load(tmp_path / "end.npz")
    np.testing.assert_array_equal(end.mesh.points, stored["points"])
    np.testing.assert_array_equal(end.mesh.faces, stored["faces"])
    moved = (end.mesh.points[: len(cap)] != holed.points).any()
    assert end.mesh.n_faces > holed.n_faces and moved == ("region" in options)
    assert summary["results"] == json.loads(json.dumps(end.results))
    assert ("energies" in end.results) == ("report_energy" in options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fill": "hole"}, "fill: 'hole' is not a vertex index"),
        ({"fill": 4, "region": [0]}, "fill: moves the new patch only"),
        ({"report_energy": "cotan"}, "report_energy: 'cotan': write all"),
        ({"subdivide": -1}, "subdivide: must be from 0 to 6, not -1"),
        ({"remesh": "x"}, "remesh: 'x' is not a length"),
    ],
)
def test_wrong_options_of_willmore_flow_are_named(options, message):
    with pytest.raises(ddg.errors.ParameterError, match=message):
        ddg.willmore_flow(ddg.grid(4, 4), **options)


@pytest.mark.parametrize("name", ["leaf", "taylor_vortices"])
def test_a_simulation_has_the_results_of_the_command(name, run, tmp_path):
    scene = ROOT / "sample_scenes" / f"{name}.toml"
    command = "shell-sim" if name == "leaf" else "fluid-sim"
    done = run(command, scene, "--steps", 3, "-o", tmp_path / "end.npz", "--json")
    end, stored = ddg.simulate(scene, steps=3).finish(), np.load(tmp_path / "end.npz")
    summary = json.loads(done.stdout)
    assert summary["accuracy"] == json.loads(json.dumps(end.accuracy))
    shared = set(summary["results"]) - {"effects", "seconds_by_part"}
    assert shared <= set(end.results) and end.converged
    assert all(summary["results"][k] == json.loads(json.dumps(end.results[k], default=list)) for k in shared)
    for array, values in {**end.vertex, **end.face}.items():
        np.testing.assert_array_equal(values, stored[array])


def test_finish_goes_on_from_the_last_frame_and_computes_once():
    simulation = falling(steps=3)
    assert [next(simulation).step for _ in range(2)] == [0, 1]
    end = simulation.finish()
    assert end is simulation.finish() and end.results["frames"] == 4 and list(simulation) == []


def test_a_failed_simulation_has_no_results():
    effects = {"stretching": {}, "gravity": {}}
    simulation = ddg.simulate({"object": [SHELL], "effects": effects}, integrator="static")
    for _ in range(2):
        with pytest.raises(ddg.errors.SolveError, match="no equilibrium"):
            simulation.finish()


def test_modes_of_a_shell():
    strip = {"role": "shell", "grid": {"size": [1, 0.1], "cells": [10, 1]}, "material": "steel"}
    pin = {"vertices": [0, 1, 11, 12]}
    scene = {"object": [strip], "effects": {"stretching": {}, "bending": {"model": "midedge"}, "pin": pin}}
    end = ddg.simulate(scene, modes=2).finish()
    assert len(end.results["frequencies"]) == 2 and end.vertex["mode_001"].shape == (22, 3)
    with pytest.raises(ddg.errors.ParameterError, match="modes: must be 1 or more, not 0"):
        ddg.simulate(scene, modes=0)
    with pytest.raises(ddg.errors.ParameterError, match="modes: is for shells"):
        ddg.simulate(ROOT / "sample_scenes" / "taylor_vortices.toml", modes=2)


def test_a_run_that_breaks_off_leaves_a_part(tmp_path):
    def trajectory_frames():
        yield next(falling(steps=1))
        raise ddg.errors.SolveError("a step failed")

    with pytest.raises(ddg.errors.SolveError):
        ddg.write_trajectory(tmp_path / "run.vtkhdf", trajectory_frames(), mesh_of_shell())
    assert [p.name for p in tmp_path.iterdir()] == ["run.vtkhdf.part"]


def test_results_count_the_steps_that_frames_shorten_and_have_the_totals_of_what_is_carried():
    warm = {"temperature": "2", "gravity": [0, 0, 0]}
    scene = {
        "object": [{"role": "fluid", "name": "a", "grid": {"size": [1, 1], "cells": [6, 6]}}],
        "effects": {"initial": {"flow": "taylor-green"}, "buoyancy": warm, "dye": {"amount": "1"}},
    }
    run = ddg.simulate(scene, duration=0.1, tolerance=1.0)
    list(run)
    results = run.finish().results
    assert 90 < results["frame_limited_steps"] <= results["steps"]  # 50 frames of two half steps
    assert results["total_temperature"] == pytest.approx(2 * results["total_dye"], rel=1e-12)
    run = ddg.simulate(scene, duration=0.1, step=0.01)
    list(run)
    assert "frame_limited_steps" not in run.finish().results
