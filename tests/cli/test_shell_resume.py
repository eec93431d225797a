"""`shell-sim --resume`: what is interrupted or killed ends with the same bits as an unbroken run."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.temporary import temporary_name
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.conftest import ROOT
from tests.physics.test_obstacle_work import RING
from tests.simulate import FALLING_CLOTH
from tests.simulate import scene_file as scene

SAMPLES = ROOT / "sample_meshes"

SCENE = FALLING_CLOTH.replace("[5, 5]", "[3, 3]")
# from a lower start: it touches the floor after half the time
SHORT_SCENE = SCENE.replace("0, 0.02]", "0, 0.0015]").replace("duration = 0.1", "duration = 0.03")


def ddgcli(*words, **kwargs):
    return subprocess.Popen([sys.executable, "-m", "ddgcli", *map(str, words)], **kwargs)


def frames_of(path):
    with Trajectory(str(path)) as run:
        return [(run.times[k], run.points(k), run.vertex(k), {n: v[k] for n, v in run.scalars.items()})
                for k in range(run.n_frames)]  # fmt: skip


def assert_equal_bits(a, b):
    assert len(a) == len(b)
    for (t, x, v, s), (t2, x2, v2, s2) in zip(a, b):
        assert t == t2
        assert np.array_equal(x, x2)
        assert all(np.array_equal(v[n], v2[n]) for n in v)
        assert all(np.array_equal(s[n], s2[n]) for n in s)


@contextmanager
def interrupted_after(monkeypatch, n_frames):
    """A patch: the writer of trajectories is interrupted where it would add one frame more."""
    from ddgcli.io.trajectories import writer as trajectory_writer

    append, written = trajectory_writer.TrajectoryWriter.append, []

    def interrupted(self, trajectory_frame, *rest):
        if len(written) == n_frames:
            raise KeyboardInterrupt
        append(self, trajectory_frame, *rest)
        written.append(trajectory_frame.step)

    with monkeypatch.context() as patch:
        patch.setattr(trajectory_writer.TrajectoryWriter, "append", interrupted)
        yield


@pytest.mark.parametrize(
    ("name", "text"),
    [("SIGINT", "Interrupted: 1 whole frame; continue"), ("SIGTERM", "Ended by SIGTERM; continue")],
)
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_names_the_file_to_continue_from(run, tmp_path, monkeypatch, name, text):
    from ddgcli.io.trajectories import writer as trajectory_writer

    append = trajectory_writer.TrajectoryWriter.append

    def ended(self, trajectory_frame, *rest):
        if self.n_frames == 1:
            signal.raise_signal(getattr(signal, name))
        append(self, trajectory_frame, *rest)

    monkeypatch.setattr(trajectory_writer.TrajectoryWriter, "append", ended)
    out = tmp_path / "r.vtkhdf"
    result = run("shell-sim", scene(tmp_path, text=SHORT_SCENE), "-o", out)
    assert result.exit_code == 128 + getattr(signal, name)
    assert result.stderr == f"{text} with --resume {out}.part\n"


def test_modes_about_an_equilibrium_are_computed_when_a_run_is_resumed(run, summary, tmp_path, monkeypatch):
    """Once the continuation was refused that the interrupted run had named."""
    mesh, out = tmp_path / "sheet.ply", tmp_path / "r.vtkhdf"
    write_mesh(str(mesh), AnnotatedMesh(shapes.grid(3, 3)))
    words = ("shell-sim", mesh, "--material", "rubber", "--pin", "0,3,12", "--modes", "3")
    words += ("--effect", "stretching", "--effect", "bending", "--integrator", "static")
    whole = summary(*words)["results"]["frequencies"]
    with interrupted_after(monkeypatch, 1):
        assert run(*words, "-o", out).exit_code == 130
    result = run(*words, "--integrator", "newmark", "--resume", f"{out}.part")
    assert result.exit_code == 2 and "takes no time steps; leave --resume out" in result.stderr
    resumed = summary(*words, "-o", out, "--resume", f"{out}.part")
    assert resumed["results"]["frequencies"] == whole


PINNED = """pin = {{ vertices = [0], axes = "xz" }}
load = {{ force = [0, 0, 1], vertices = [15] }}
"""


# files of every integrator; without files all are in tests/physics/test_shell_resume_table.py
FILE_INTEGRATORS = [
    pytest.param(name, marks=[] if name in ("newmark", "verlet", "static") else [pytest.mark.slow])
    for name in INTEGRATORS
]


@pytest.mark.parametrize("integrator", FILE_INTEGRATORS)
def test_resumed_run_has_the_same_bits(run, tmp_path, monkeypatch, integrator):
    """Contact with friction, damping, load and pins; an equilibrium, which has one frame to go."""
    text = SHORT_SCENE + PINNED
    n_frames = 2
    if integrator == "static":
        n_frames = 1
        text = text.replace('[0], axes = "xz"', "[0, 3, 12], clamp = true")
    check_resumed_as_whole(run, tmp_path, monkeypatch, scene(tmp_path, integrator, text), n_frames)


PAIRS = """\
format = "ddgcli-scene/1"
[time]
duration = 0.016
step = 2e-3
frame_every = 4e-3
integrator = "{integrator}"
[[object]]
name = "a"
role = "shell"
grid = {{ size = [0.2, 0.2], cells = [2, 2] }}
material = "rubber"
[[object]]
name = "b"
role = "shell"
grid = {{ size = [0.2, 0.2], cells = [2, 2] }}
material = "rubber"
position = [0.03, 0.02, 0.01]
velocity = [0, 0, -1]
[[object]]
name = "o"
role = "obstacle"
box = {{ corner = [-1, -1, -1], size = [2, 2, 0.99] }}
velocity = [0, 0, 0.5]
[effects]
stretching = {{}}
bending = {{}}
contact = {{ pairs = [["a", "b"], ["a", "o"]], self_contact = true, friction = 0.3 }}
"""


@pytest.mark.parametrize("integrator", ["implicit-euler", pytest.param("newmark", marks=pytest.mark.slow)])
def test_resumed_run_of_colliding_shells_has_the_same_bits(run, tmp_path, monkeypatch, integrator):
    pytest.importorskip("ipctk")
    check_resumed_as_whole(run, tmp_path, monkeypatch, scene(tmp_path, integrator, PAIRS), 3)


@pytest.mark.parametrize("more", [
    "tolerance = 1e-4", "beta = 0.3\ngamma = 0.7\nstep = 5e-3", "beta = 0\nstep = 5e-3"
])  # fmt: skip
def test_resumed_adaptive_and_damped_runs_have_the_same_bits(run, tmp_path, monkeypatch, more):
    text = SHORT_SCENE.replace("step = 5e-3", more)
    check_resumed_as_whole(run, tmp_path, monkeypatch, scene(tmp_path, "newmark", text), 2)


def but_for_seconds(result):
    """Results and accuracy of a summary, without what a clock measured."""
    summary = json.loads(result.stdout)
    results = summary["results"]
    del results["seconds_by_part"]
    results["effects"] = {name: entry["evaluations"] for name, entry in results["effects"].items()}
    return results, summary["accuracy"]


def check_resumed_as_whole(run, tmp_path, monkeypatch, path, n_frames):
    whole = tmp_path / "whole.vtkhdf"
    uninterrupted = run("shell-sim", path, "-o", whole, "--json")
    assert uninterrupted.exit_code == 0
    broken = tmp_path / "broken.vtkhdf"
    with interrupted_after(monkeypatch, n_frames):
        result = run("shell-sim", path, "-o", broken)
    assert result.exit_code == 130
    partial_file = tmp_path / "broken.vtkhdf.part"
    assert partial_file.exists() and not broken.exists()
    with Trajectory(str(partial_file)) as partial:
        assert partial.attributes["status"] == "interrupted"
        assert partial.n_frames == n_frames
    again = run("shell-sim", path, "--resume", partial_file, "-q", "--json")
    assert again.exit_code == 0
    assert broken.exists() and not partial_file.exists()
    assert but_for_seconds(uninterrupted) == but_for_seconds(again)
    assert len(frames_of(whole)) > n_frames
    assert_equal_bits(frames_of(whole), frames_of(broken))


def test_resume_without_the_scene_and_with_overrides(run, tmp_path, monkeypatch):
    path = scene(tmp_path)
    whole, broken = tmp_path / "whole.vtkhdf", tmp_path / "broken.vtkhdf"
    assert run("shell-sim", path, "-o", whole, "--steps", 10).exit_code == 0
    with interrupted_after(monkeypatch, 3):
        run("shell-sim", path, "-o", broken, "--steps", 10)
    assert run("shell-sim", "--resume", f"{broken}.part").exit_code == 0
    assert_equal_bits(frames_of(whole), frames_of(broken))
    # a whole run has nothing to go on with, and stays where it is
    assert run("shell-sim", "--resume", whole, "-o", tmp_path / "copy.vtkhdf").exit_code == 0
    assert_equal_bits(frames_of(whole), frames_of(tmp_path / "copy.vtkhdf"))


def test_resume_of_a_changed_scene_is_refused(run, tmp_path, monkeypatch):
    path = scene(tmp_path)
    with interrupted_after(monkeypatch, 4):
        run("shell-sim", path, "-o", tmp_path / "run.vtkhdf")
    path.write_text(path.read_text().replace('material = "rubber"', 'material = "felt"'))
    before = (tmp_path / "run.vtkhdf.part").read_bytes()
    result = run("shell-sim", path, "--resume", tmp_path / "run.vtkhdf.part")
    assert result.exit_code == 2
    assert "the scene differs from that of the run" in result.stderr and "density" in result.stderr
    assert (tmp_path / "run.vtkhdf.part").read_bytes() == before


@pytest.mark.parametrize(
    ("command", "mesh", "other"),
    [("willmore-flow", "torus.ply", "sphere.ply"), ("curve-flow", "trefoil.obj", "ellipse.csv")],
)
def test_a_flow_is_resumed_with_its_options_and_mesh(run, tmp_path, command, mesh, other):
    trajectory = tmp_path / "run.vtkhdf"
    assert run(command, SAMPLES / mesh, "--steps", 2, "-o", trajectory).exit_code == 0
    for words, reason in (
        ((SAMPLES / mesh, "--steps", 3), "the options differ from those of the run (time.steps: 2 -> 3)"),
        ((SAMPLES / other, "--steps", 2), "a mesh file has changed since the run"),
    ):
        result = run(command, *words, "--resume", trajectory)
        assert result.exit_code == 2 and reason in result.stderr and "scene" not in result.stderr


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGKILL])
def test_a_process_that_is_ended_leaves_whole_frames(tmp_path, sign):
    path = scene(tmp_path, text=SCENE.replace("duration = 0.1", "duration = 100"))
    child = ddgcli("shell-sim", path, "-o", tmp_path / "run.vtkhdf", stderr=subprocess.PIPE, text=True)
    partial_file = tmp_path / "run.vtkhdf.part"
    deadline = time.time() + 60
    while not partial_file.exists() and time.time() < deadline:
        time.sleep(0.02)
    time.sleep(0.3)
    child.send_signal(sign)
    _, stderr = child.communicate(timeout=60)
    assert child.returncode == (130 if sign == signal.SIGINT else -signal.SIGKILL)
    if sign == signal.SIGINT:
        assert "--resume" in stderr and "Traceback" not in stderr
    with Trajectory(str(partial_file)) as partial:
        assert partial.n_frames >= 1
        assert np.isfinite(partial.points(partial.n_frames - 1)).all()
    if sign == signal.SIGKILL:  # what it was laying out again goes with the next output
        temporary_name(partial_file)  # removes leftovers
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_a_resumed_run_takes_its_name_and_a_second_resume_names_it(tmp_path, run, summary, monkeypatch):
    path = scene(tmp_path, text=SHORT_SCENE)
    target, partial = tmp_path / "run.vtkhdf", tmp_path / "run.vtkhdf.part"
    with interrupted_after(monkeypatch, 3):
        assert run("shell-sim", path, "-o", target).exit_code == 130
    last = tmp_path / "last.ply"
    report = summary("shell-sim", "--resume", partial, "-o", last)
    assert set(report["outputs"]) == {str(target), str(last)} and target.exists() and not partial.exists()
    refused = run("shell-sim", "--resume", partial, "-o", last)
    assert refused.exit_code == 2 and f"no such file; the run is complete: {target}" in refused.stderr


@pytest.mark.parametrize("n_frames", [2, 3, 6])
def test_a_resumed_run_reports_the_warnings_of_the_whole_run(run, summary, tmp_path, monkeypatch, n_frames):
    """It had those of neither part; its summary named no input."""
    text = RING.format(step=0.01, integrator="implicit-midpoint", interpolation="smooth")
    path, out = tmp_path / "ring.toml", tmp_path / "ring.vtkhdf"
    path.write_text('format = "ddgcli-scene/1"\n' + text.replace("duration = 0.15", "duration = 0.06"))
    whole = summary("shell-sim", path, "-o", out)["warnings"]
    assert ["halved" in whole[0], "composite scheme" in whole[1]] == [True, True] and len(whole) == 2
    with interrupted_after(monkeypatch, n_frames):
        assert run("shell-sim", path, "-o", out).exit_code == 130
    resumed = summary("shell-sim", "--resume", f"{out}.part")
    assert resumed["warnings"] == whole
    assert resumed["input"]["path"] == f"{out}.part"
