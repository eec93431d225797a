"""`shell-sim` from end to end: what it writes, prints and imports (resuming: test_shell_resume)."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.shapes import grid
from tests.simulate import FALLING_CLOTH as SCENE
from tests.simulate import scene_file as scene


def test_summary_holds_the_contract(summary, tmp_path):
    out = summary("shell-sim", scene(tmp_path), "-o", tmp_path / "run.vtkhdf", "-o", tmp_path / "last.ply")
    results, accuracy = out["results"], out["accuracy"]
    assert set(results["effects"]) == {"stretching", "bending", "gravity", "damping", "contact"}
    for entry in results["effects"].values():
        assert set(entry) == {"seconds", "share", "evaluations"}
    assert results["effects"]["bending"]["evaluations"] > 20
    assert set(results["energies"]) >= {"stretching", "bending", "gravity", "contact", "kinetic"}
    assert set(results["energies"]["bending"]) == {"start", "end"}
    assert results["steps"] >= 20 and results["newton_iterations"] >= 20
    assert len(results["momentum"]) == 3 and len(results["angular_momentum"]) == 3
    assert {"energy_drift", "momentum_drift", "angular_momentum_drift", "max_strain"} <= set(accuracy)
    seconds_by_part = results["seconds_by_part"]
    assert sum(v for k, v in seconds_by_part.items() if k != "total") == pytest.approx(
        seconds_by_part["total"]
    )
    assert 0 <= seconds_by_part["unaccounted"] <= 0.05 * seconds_by_part["total"]
    seconds = out["seconds"]
    assert seconds_by_part["total"] <= seconds["compute"] + seconds["write"]  # of the frames, too
    assert out["outputs"] == [str(tmp_path / "run.vtkhdf"), str(tmp_path / "last.ply")]
    assert out["input"]["vertices"] == 36
    assert not (tmp_path / "run.vtkhdf.part").exists()


def test_trajectory_is_read_by_vtk(summary, tmp_path):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    summary("shell-sim", scene(tmp_path), "-o", tmp_path / "run.vtkhdf")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "run.vtkhdf"))
    reader.UpdateInformation()
    with Trajectory(str(tmp_path / "run.vtkhdf")) as ours:
        assert reader.GetNumberOfSteps() == ours.n_frames == 11
        for k in range(ours.n_frames):
            reader.SetStep(k)
            reader.Update()
            shown = reader.GetOutput()
            assert reader.GetTimeValue() == ours.times[k] == pytest.approx(0.01 * k)
            assert np.array_equal(vtk_to_numpy(shown.GetPoints().GetData()), ours.points(k))
            for name, values in ours.vertex(k).items():
                assert np.array_equal(vtk_to_numpy(shown.GetPointData().GetArray(name)), values)
            triangles = vtk_to_numpy(shown.GetPolys().GetConnectivityArray()).reshape(-1, 3)
            assert np.array_equal(triangles, ours.mesh.faces)
            for name, values in ours.scalars.items():
                field = vtk_to_numpy(shown.GetFieldData().GetArray(name))
                assert np.array_equal(np.ravel(field), np.ravel(values[k])), name
        assert ours.attributes["status"] == "complete"
        assert {"velocity", "strain"} == set(ours.vertex(0))
        assert "energy_bending" in ours.scalars
        assert json.loads(ours.text("scene_resolved"))["scene"]["time"]["gamma"] == 0.5
        assert ours.text("scene_source").startswith("format")


def test_absent_effects_are_not_imported(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        '[time]\nduration = 0.01\nstep = 0.001\nintegrator = "verlet"\n[[object]]\nrole = "shell"\n'
        'grid = { size = [1, 1], cells = [2, 2] }\nmaterial = "felt"\n[effects]\ngravity = {}\n'
    )
    code = (
        "import sys\nfrom ddgcli.cli.main import main\n"
        f"main(['shell-sim', {str(path)!r}, '--json'], standalone_mode=False)\n"
        "print([m for m in sys.modules if m.startswith('ddgcli')], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "ddgcli.models.shell.gravity" in done.stderr
    absent = ["bending", "hinge", "stretching", "contact", "damping", "load", "pin"]
    absent += [
        "handle",
        "pressure",
        "wind",
        "plasticity",
        "key_frames",
        "area_springs",
        "fracture",
        "cracks",
        "epochs",
        "crack_contact",
    ]
    absent = [f"models.shell.{name}" for name in absent]
    absent += [
        "models.fluid",
        "models.willmore",
        "mechanics.newton",
        "mechanics.objective",
        "mechanics.constraints",
        "linalg",
        "plots",
        "io.trajectory",
    ]
    for name in absent:
        assert f"ddgcli.{name}" not in done.stderr, name
    assert set(json.loads(done.stdout)["results"]["effects"]) == {"gravity"}


def test_quick_form_builds_the_same_scene(run, tmp_path):
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    mesh = tmp_path / "sheet.ply"
    write_mesh(str(mesh), AnnotatedMesh(grid(4, 4)))
    quick = run(
        "shell-sim", mesh, "--effect", "stretching", "--effect", "gravity acceleration=[0, 0, -1.5]",
        "--pin", 0, "--pin", 4, "--material", "felt", "--dt", 1e-3, "--steps", 5, "--dry-run", "--json",
    )  # fmt: skip
    assert quick.exit_code == 0, quick.stderr
    built = json.loads(quick.stdout)["scene"]
    path = tmp_path / "same.toml"
    path.write_text(
        '[time]\nstep = 1e-3\nduration = 0.005\n[[object]]\nname = "sheet"\nrole = "shell"\n'
        f'mesh = "{mesh}"\nmaterial = "felt"\n[effects]\nstretching = {{}}\n'
        "gravity = { acceleration = [0, 0, -1.5] }\npin = { vertices = [0, 4] }\n"
    )
    written = json.loads(run("shell-sim", path, "--dry-run", "--json").stdout)["scene"]
    assert built == written
    assert list(tmp_path.glob("*.vtkhdf*")) == []


@pytest.mark.parametrize("effect, word", [
    ("gravty", "gravity"),
    ("gravity acc=[0,0,1]", "acceleration"),
    ("gravity acceleration=[0,0", "TOML"),
    ("gravity 5", "key=value"),
])  # fmt: skip
def test_bad_quick_effects_are_refused(run, tmp_path, effect, word):
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    mesh = tmp_path / "sheet.ply"
    write_mesh(str(mesh), AnnotatedMesh(grid(2, 2)))
    result = run("shell-sim", mesh, "--effect", effect)
    assert result.exit_code == 2
    assert word in result.stderr
    assert result.stderr.count("\n") == 1


def test_effects_and_schema_are_listed(run):
    listing = json.loads(run("shell-sim", "--effects", "--json").stdout)
    assert listing["gravity"]["parameters"]["acceleration"]["unit"] == "m/s^2"
    assert listing["bending"]["parameters"]["stiffness"]["unit"] == "N m"
    assert "friction" in run("shell-sim", "--effects").stdout
    schema = json.loads(run("shell-sim", "--schema").stdout)
    assert "contact" in schema["properties"]["effects"]["properties"]


def test_schema_says_what_the_scene_reader_says(run):
    """Bounds and presets are in the words of JSON Schema; what the reader fills in is not required."""
    schema = json.loads(run("shell-sim", "--schema").stdout)
    time = next(t for t in schema["properties"]["time"]["anyOf"] if "beta" in t["properties"])
    number = time["properties"]["duration"]["anyOf"][0]
    assert number == {"type": "number", "exclusiveMinimum": 0}
    beta = json.dumps(time["properties"]["beta"])
    assert '"minimum": 0' in beta and '"maximum": 0.5' in beta
    shell, obstacle = schema["properties"]["object"]["items"]["anyOf"]
    assert shell["required"] == [] and obstacle["required"] == ["role"]
    assert {"felt", "steel"} <= set(shell["properties"]["material"]["enum"])
    assert not any(f'"{word}":' in json.dumps(schema) for word in ("gt", "ge", "lt", "le"))


def test_divided_and_rejected_steps_stand_in_the_log(run, tmp_path):
    """Step, time, kind, place and value of each; with `stop` the first ends the run, its frames kept."""
    soft = SCENE.replace("friction = 0.5", "stiffness = 600").replace("step = 5e-3", "step = 5e-3\nbeta = 0")
    soft = soft.replace("0.02]", "0.02]\nvelocity = [0, 0, -3]")
    path = scene(tmp_path, text=soft)
    shrunk = run("shell-sim", path, "-o", tmp_path / "shrunk.vtkhdf", "--json", "--duration", 0.02)
    rejected = json.loads(shrunk.stdout)["results"]["rejected_steps"]
    with Trajectory(str(tmp_path / "shrunk.vtkhdf")) as ours:
        rows = ours.log[: ours.log_rows]
        kinds = [row["kind"].decode() for row in rows]
        assert kinds[:2] == ["start", "stability"] and "barrier crossed" in kinds
        assert rejected == len(rows) - 2  # a step that is divided did not fail
        crossed = rows[kinds.index("barrier crossed")]
        assert crossed["place"].startswith(b"vertex") and crossed["value"] < 0
        assert 0 <= crossed["time"] <= 0.02 and b"rejected" in crossed["detail"]
    path.write_text(path.read_text().replace("beta = 0", 'beta = 0\non_failure = "stop"'))
    stopped = run("shell-sim", path, "-o", tmp_path / "stopped.vtkhdf", "--json")
    assert (
        stopped.exit_code == 1
        and "barrier crossed" in json.loads(stopped.stdout)["results"]["stopped_because"]
    )
    assert json.loads(stopped.stdout)["results"]["rejected_steps"] == 1
    partial_file = tmp_path / "stopped.vtkhdf.part"
    for _ in range(2):  # a resumed run fails again, with one message
        with Trajectory(str(partial_file)) as ours:
            assert ours.attributes["status"] == "failed" and ours.n_frames >= 1
            kinds = list(ours.log["kind"])
            assert kinds[-1] == b"barrier crossed" and kinds.count(b"barrier crossed") == 1
            assert ours.log_rows < len(ours.log)  # what broke the run came after its last frame
            assert ours.log["time"][-1] >= ours.times[-1]
        assert (
            run("shell-sim", path, "--resume", partial_file, "-o", partial_file.with_suffix("")).exit_code
            == 1
        )


def test_static_without_equilibrium_ends_with_exit_1(run, tmp_path):
    path = tmp_path / "fall.toml"
    path.write_text(
        '[time]\nintegrator = "static"\n[[object]]\nrole = "shell"\nmaterial = "felt"\n'
        "grid = { size = [1, 1], cells = [2, 2] }\n[effects]\nstretching = {}\nbending = {}\ngravity = {}\n"
    )
    result = run("shell-sim", path, "-o", tmp_path / "fall.vtkhdf", "--json")
    assert result.exit_code == 1, result.stderr
    assert json.loads(result.stdout)["results"]["converged"] is False
    assert (tmp_path / "fall.vtkhdf.part").exists() and not (tmp_path / "fall.vtkhdf").exists()
    assert os.path.getsize(tmp_path / "fall.vtkhdf.part") > 0


SAMPLES = Path(__file__).parents[2] / "sample_scenes"


@pytest.mark.parametrize("name", ["hat", "sheet_on_sphere", "leaf"])
def test_sample_scenes_are_sound_and_start(run, tmp_path, name):
    path = SAMPLES / f"{name}.toml"
    assembled = json.loads(run("shell-sim", path, "--dry-run", "--json").stdout)["assembled"]
    assert assembled["frames"] >= 20
    result = run("shell-sim", path, "--steps", 2, "-o", tmp_path / "run.vtkhdf", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["accuracy"]["max_strain"] < 0.01


def test_an_h5_trajectory_and_a_mesh_on_standard_output_are_written(run, tmp_path):
    result = run(
        "shell-sim",
        scene(tmp_path),
        "--steps",
        2,
        "-o",
        tmp_path / "run.h5",
        "-o",
        "-",
        "--output-format",
        "ply",
    )
    assert result.exit_code == 0, result.stderr
    assert result.stdout_bytes.startswith(b"ply")
    with Trajectory(str(tmp_path / "run.h5")) as ours:
        assert ours.n_frames == 2  # the start and, two steps later, the end


def test_the_mesh_of_a_scene_is_never_overwritten(run, tmp_path):
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    mesh = tmp_path / "sheet.ply"
    write_mesh(str(mesh), AnnotatedMesh(grid(2, 2)))
    before = mesh.read_bytes()
    assert run("shell-sim", mesh, "--effect", "gravity", "--steps", 1, "-o", mesh).exit_code == 2
    assert mesh.read_bytes() == before


def test_steps_that_gain_energy_are_rejected_with_a_warning(summary, run, tmp_path, monkeypatch):
    """Implicit midpoint with steps far longer than the waves of a stiff shell that turns: they are rejected
    with a warning; if they were not, the run itself would fail."""
    from ddgcli.mechanics import energy_balance as balance

    sample = (Path(__file__).parents[2] / "sample_scenes" / "leaf.toml").read_text()
    leaf = tmp_path / "leaf.toml"
    leaf.write_text(sample.replace("cells = [16, 8]", "cells = [8, 4]"))
    guarded = summary("shell-sim", leaf, "--dt", 4e-3, "--duration", 0.04)
    assert guarded["results"]["rejected_steps"] > 0 and guarded["accuracy"]["energy_drift"] < 1e-2
    assert len(guarded["warnings"]) == 1 and "rejected: energy rises" in guarded["warnings"][0]
    short = summary("shell-sim", leaf, "--duration", 0.05)
    assert short["warnings"] == [] and short["accuracy"]["energy_drift"] < 1e-2
    monkeypatch.setattr(balance, "MAX_ENERGY_RISE", np.inf)
    words = ("--dt", 8e-3, "--duration", 0.024, "-o", tmp_path / "leaf.ply", "--json")
    grown = run("shell-sim", leaf, *words)
    results = json.loads(grown.stdout)
    assert grown.exit_code == 1 and results["accuracy"]["energy_drift"] > 0.5
    assert any("energy grew" in warning for warning in results["warnings"])


def test_picture_shows_chosen_frames_and_the_energies_of_all_three(
    default_pictures, run, tmp_path, monkeypatch
):
    from ddgcli.plots import motion

    drawn = []

    def noted(path, shots, series, on, ylabel):
        Path(path).write_bytes(b"a picture")
        drawn.append(([shot.time for shot in shots], {n: len(v) for n, (_, v) in series.items()}, on))

    monkeypatch.setattr(motion, "draw_motion", noted)
    ball = Path(__file__).parents[2] / "sample_meshes" / "sphere.ply"
    for words in (
        ["shell-sim", scene(tmp_path)],
        ["fluid-sim", ball, "--vorticity", "5*z", "--steps", 8, "--dt", 0.02, "--frame-every", 0.02],
        ["willmore-flow", ball, "--dt", 1e-4, "--steps", 8, "--frame-every", 1e-4],
    ):
        path = str(tmp_path / f"{words[0]}.png")
        assert run(*words, "--plot", path).exit_code == 0
        times, series, on = drawn[-1]
        assert 3 <= len(times) <= 4 and times == sorted(set(times))  # at equal changes, each frame once
        assert any("energy" in name for name in series) and min(series.values()) >= 9
        assert (on.limits is None) == (words[0] == "willmore-flow")
    assert drawn[1][2].limits == pytest.approx((-5, 5), rel=0.1)


def test_a_scene_of_obstacles_alone_is_refused(tmp_path, run):
    path = tmp_path / "floor.toml"
    path.write_text('[time]\n[[object]]\nname = "floor"\nrole = "obstacle"\nplane = {}\n')
    result = run("shell-sim", path)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert (
        "line 2: every [[object]] is an obstacle; a scene of shell-sim needs one of role shell"
        in result.stderr
    )


def test_energies_beyond_the_range_of_numbers_end_with_exit_1(tmp_path, run):
    path = tmp_path / "huge.toml"
    path.write_text(
        '[time]\nduration = 0.01\nstep = 0.01\nintegrator = "verlet"\n[[object]]\nname = "ball"\n'
        'role = "shell"\nsphere = { radius = 0.1, subdivisions = 0 }\n'
        "[effects]\npin = { vertices = [0, 1] }\ngravity = { acceleration = [-1e308, 0, -9.81] }\n"
    )
    result = run("shell-sim", path)
    assert result.exit_code == 1
    assert "the energy overflows; use smaller velocities" in result.stderr


@pytest.mark.parametrize("effects, warned", [("", True), ("stretching = {}\n", False)])
def test_edges_that_no_effect_resists_are_warned_of(tmp_path, run, effects, warned):
    path = tmp_path / "fall.toml"
    path.write_text(
        '[time]\nduration = 0.5\n[[object]]\nname = "sheet"\nrole = "shell"\nmaterial = "cotton"\n'
        "grid = { size = [1, 1], cells = [2, 2] }\n[effects]\npin = { vertices = [0, 1] }\n"
        f"gravity = {{ acceleration = [0, 0, -9.81] }}\n{effects}"
    )
    result = run("shell-sim", path)
    assert result.exit_code == 0
    assert ("no effect of the scene resists it; add `stretching`" in result.stderr) is warned


@pytest.mark.parametrize("ratio, warned", [(1.0, False), (4.0, True)])
def test_strains_far_beyond_small_ones_are_warned_of(tmp_path, summary, ratio, warned):
    """A sphere of St Venant-Kirchhoff's law stretches by a/2 + sqrt(a^2/4 + 1), a = p R (1 - nu) / E t."""
    path = tmp_path / "balloon.toml"
    path.write_text(
        '[time]\nintegrator = "static"\n[[object]]\nname = "balloon"\nrole = "shell"\nyoung = 1e6\n'
        "poisson = 0.3\nthickness = 1e-3\ndensity = 1\nsphere = { radius = 0.1, subdivisions = 3 }\n"
        f"[effects]\nstretching = {{}}\npressure = {{ value = {ratio * 1e3 / 0.1 / 0.7} }}\n"
    )
    out = summary("shell-sim", path)
    stretch = ratio / 2 + np.sqrt(ratio**2 / 4 + 1)
    assert out["accuracy"]["max_strain"] == pytest.approx(stretch - 1, rel=0.02)
    assert any("a law of small strains" in warning for warning in out["warnings"]) == warned
