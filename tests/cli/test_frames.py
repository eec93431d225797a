"""`frames`: one frame as a mesh, pictures, animations, series; and --plot of the simulators."""

import re

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh, frames_of_equal_change

SCENE = """\
[time]
duration = 0.04
step = 0.01
frame_every = 0.01
[[object]]
role = "shell"
grid = { size = [1, 1], cells = [3, 3] }
material = "rubber"
velocity = [0, 0, 2]
angular_velocity = [0, 5, 0]
[effects]
stretching = {}
"""


@pytest.fixture(scope="module")
def trajectory(run, tmp_path_factory):
    """Trajectory of `SCENE`, beside its `scene.toml`."""
    folder = tmp_path_factory.mktemp("trajectory")
    (folder / "scene.toml").write_text(SCENE)
    assert run("shell-sim", folder / "scene.toml", "-o", folder / "run.vtkhdf").exit_code == 0
    return folder / "run.vtkhdf"


def test_one_time_as_a_mesh(summary, trajectory, tmp_path):
    out = summary("frames", trajectory, "--at", 0.021, "-o", tmp_path / "f.ply", "-o", tmp_path / "f.npz")
    assert out["results"]["exported_times"] == [pytest.approx(0.02)]
    assert out["results"]["frames"] == 5
    assert out["accuracy"]["time_mismatch"] == pytest.approx(1e-3)
    with Trajectory(str(trajectory)) as ours:
        assert np.array_equal(read_mesh(str(tmp_path / "f.ply")).mesh.points, ours.points(2))
        with np.load(tmp_path / "f.npz") as arrays:
            assert np.array_equal(arrays["velocity"], ours.vertex(2)["velocity"])


def test_charts_of_shells_have_the_unit_of_their_energy(summary, trajectory, tmp_path, monkeypatch):
    labels = []

    def noted(path, plot_frames, series, style, ylabel, **size):
        labels.append(ylabel)
        open(path, "wb").close()

    monkeypatch.setattr("ddgcli.plots.motion.draw_motion", noted)
    summary("frames", trajectory, "--plot", tmp_path / "a.png")
    assert labels == ["energy [J]"]


def test_all_frames_as_numbered_meshes(summary, trajectory, tmp_path):
    out = summary("frames", trajectory, "-o", tmp_path / "f_{:03d}.vtu")
    assert out["results"]["frames"] == out["results"]["exported_frames"] == 5
    assert out["outputs"] == [str(tmp_path / f"f_00{k}.vtu") for k in range(5)]
    with Trajectory(str(trajectory)) as ours:
        for k in range(5):
            mesh = read_mesh(str(tmp_path / f"f_00{k}.vtu")).mesh
            assert np.array_equal(mesh.points, ours.points(k))
    summary("frames", trajectory, "--every", 2, "-o", tmp_path / "p{}.png")
    assert sorted(p.name for p in tmp_path.glob("p*")) == ["p0.png", "p1.png", "p2.png"]
    assert summary("frames", trajectory)["results"]["exported_frames"] == 0


def test_two_processes_draw_the_same_pictures(summary, run, trajectory, tmp_path):
    options = ("--size", "280x210", "--every", 2)
    for jobs in (1, 2):
        outputs = ("-o", tmp_path / f"p{jobs}_{{}}.png", "-o", tmp_path / f"m{jobs}.gif")
        summary("frames", trajectory, *options, "--jobs", jobs, *outputs)
    for k in range(3):
        assert (tmp_path / f"p1_{k}.png").read_bytes() == (tmp_path / f"p2_{k}.png").read_bytes()
    assert (tmp_path / "m1.gif").read_bytes() == (tmp_path / "m2.gif").read_bytes()
    assert len(list(tmp_path.glob("p*"))) == 6
    refused = run("frames", trajectory, "--jobs", 2, "-o", tmp_path / "f_{}.ply")
    assert refused.exit_code == 2 and "--jobs is for" in refused.stderr


def test_several_frames_for_one_mesh_are_refused_and_the_remedy_works(run, trajectory, tmp_path):
    result = run("frames", trajectory, "-o", tmp_path / "all.ply")
    assert result.exit_code == 2 and "5 are selected" in result.stderr and not list(tmp_path.glob("all*"))
    name = re.search(r"-o (\S+),", result.stderr)[1]
    assert run("frames", trajectory, "-o", tmp_path / name).exit_code == 0
    assert len(list(tmp_path.glob("all_000?.ply"))) == 5
    assert run("frames", trajectory, "--at", 0.04, "-o", tmp_path / "all.ply").exit_code == 0
    assert (tmp_path / "all.ply").read_bytes()[:3] == b"ply"


@pytest.mark.parametrize("name", ["f_{}_{}.ply", "f_{x}.ply", "f_{:s}.ply", "f_{0.real}.ply", "f_{}.gif"])
def test_names_with_a_wrong_frame_number_are_an_error(run, trajectory, tmp_path, name):
    result = run("frames", trajectory, "-o", tmp_path / name)
    assert result.exit_code == 2 and "f_{:04d}.ply" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "name, files",
    [
        ("o{1}/x_{}.ply", ["o{1}/x_0.ply", "o{1}/x_1.ply"]),
        ("{}/x_{:02d}.ply", ["{}/x_00.ply", "{}/x_01.ply"]),
        ("x{{a}}{}.ply", ["x{a}0.ply", "x{a}1.ply"]),
        ("o}/x{{}}.svg", ["o}/x{}_0000.svg", "o}/x{}_0001.svg"]),
        ("o{1}/x.pvd", ["o{1}/x.pvd"]),
    ],
)
def test_braces_of_folders_are_their_own_and_double_ones_in_a_name_stand_for_one(
    summary, trajectory, tmp_path, name, files
):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    summary("frames", trajectory, "--to", 0.01, "-o", tmp_path / name)
    assert sorted(str(p.relative_to(tmp_path)) for p in (tmp_path / name).parent.glob("x*.*")) == files


@pytest.mark.parametrize("name", ["f}.ply", "f_{.ply", "f_{}}.ply", "f{{}}.gif"])
def test_names_with_a_brace_alone_are_an_error(run, trajectory, tmp_path, name):
    result = run("frames", trajectory, "-o", tmp_path / name)
    assert result.exit_code == 2 and "{{ and }} stand for braces" in result.stderr


def test_a_folder_or_a_device_is_no_missing_trajectory(run, tmp_path):
    for path, message in ((tmp_path, "is a folder"), ("/dev/null", "is not a regular file")):
        result = run("frames", path)
        assert result.exit_code == 2 and message in result.stderr and "no such file" not in result.stderr


def test_the_chart_of_a_curve_flow_shows_what_the_flow_lowers(summary, run, tmp_path):
    """Curvature flow lowers the length; its elastic energy rises as circles shrink."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rows = [f"v {np.cos(a)} {np.sin(a)} 0" for a in angle] + [f"l {' '.join(map(str, range(1, 25)))} 1"]
    (tmp_path / "circle.obj").write_text("\n".join(rows))
    summary("curve-flow", tmp_path / "circle.obj", "--steps", 3, "-o", tmp_path / "run.vtkhdf")
    charts = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ddgcli.plots.motion.draw_motion", lambda *arguments, **_: charts.append(arguments))
        run("frames", tmp_path / "run.vtkhdf", "--plot", tmp_path / "a.png")
    ((_, _, series, _, label),) = charts
    assert list(series) == ["length"] and label.startswith("length")
    assert np.all(np.diff(series["length"][1]) < 0)
    result = run("frames", tmp_path / "run.vtkhdf", "--show", "nosuch", "-o", tmp_path / "a.png")
    assert result.exit_code == 2 and ": none\n" not in result.stderr


def test_series_names_every_frame(summary, trajectory, tmp_path):
    summary("frames", trajectory, "-o", tmp_path / "s.pvd", "--every", 2)
    text = (tmp_path / "s.pvd").read_text()
    assert text.count("<DataSet") == 3
    assert sorted(p.name for p in (tmp_path / "s").iterdir()) == [f"frame_0000{k}.vtp" for k in (0, 2, 4)]
    with Trajectory(str(trajectory)) as ours:
        assert np.array_equal(read_mesh(str(tmp_path / "s" / "frame_00002.vtp")).mesh.points, ours.points(2))


def test_a_series_of_tetrahedra_holds_tetrahedra(summary, tmp_path):
    """Once their boundaries alone, with advice for another output."""
    box = shapes.box_tetrahedra(2, 2, 2)
    np.savez(tmp_path / "box.npz", points=box.points, tetrahedra=box.tetrahedra)
    words = ["--flow", "vortex-ring", "--dt", 0.01, "--steps", 1, "-o", tmp_path / "r.vtkhdf"]
    summary("fluid-sim", tmp_path / "box.npz", *words)
    out = summary("frames", tmp_path / "r.vtkhdf", "-o", tmp_path / "s.pvd")
    assert out["warnings"] == []
    read = read_mesh(str(tmp_path / "s" / "frame_00001.vtu"))
    assert np.array_equal(read.mesh.tetrahedra, box.tetrahedra) and "velocity" in read.vertex
    assert "s/frame_00001.vtu" in (tmp_path / "s.pvd").read_text()


def test_pictures_and_animations_are_written(summary, trajectory, tmp_path):
    out = summary("frames", trajectory, "-o", tmp_path / "p.png", "--to", 0.01)
    assert out["outputs"] == [str(tmp_path / f"p_000{k}.png") for k in (0, 1)]
    assert all((tmp_path / f"p_000{k}.png").read_bytes().startswith(b"\x89PNG") for k in (0, 1))
    summary(
        "frames", trajectory, "-o", tmp_path / "m.gif", "--to", 0, "--array", "velocity", "--size", "320x240"
    )
    assert (tmp_path / "m.gif").read_bytes().startswith(b"GIF89a")
    summary("shell-sim", trajectory.with_name("scene.toml"), "--plot", tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 5000


def test_pictures_of_a_shrinking_circle_have_its_size(summary, tmp_path):
    from matplotlib.image import imread

    angle = 2 * np.pi * np.arange(61) / 60
    points = "\n".join(f"{x},{y},0" for x, y in zip(np.cos(angle), np.sin(angle)))
    (tmp_path / "circle.csv").write_text(f"x,y,z\n{points}\n")
    steps = ["--duration", 0.3, "--dt", 1e-3, "--frame-every", 0.3]
    summary("curve-flow", tmp_path / "circle.csv", *steps, "-o", tmp_path / "run.vtkhdf")
    outputs = [word for name in ("f.png", "f.gif") for word in ("-o", tmp_path / name)]
    summary("frames", tmp_path / "run.vtkhdf", "--array", "none", "--size", "400x400", *outputs)
    widths = []
    for k in range(2):
        ink = imread(tmp_path / f"f_{k:04d}.png")[40:, :, :3].min(axis=2) < 0.8  # below the title
        widths.append(np.ptp(np.flatnonzero(ink.any(axis=0))))
    assert widths[1] / widths[0] == pytest.approx(np.sqrt(1 - 2 * 0.3), rel=0.02)
    assert (tmp_path / "f.gif").read_bytes().count(b"\x21\xf9\x04") == 2  # one control block a frame


def test_an_mp4_has_the_frames_the_size_and_the_same_bytes_each_time(summary, trajectory, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    for name in "ab":
        words = ["--every", 2, "--fps", 10, "--size", "640x480", "-o", tmp_path / f"{name}.mp4"]
        assert summary("frames", trajectory, *words)["results"]["exported_frames"] == 3
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    reader = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    facts, pictures = next(reader), list(reader)
    assert facts["source_size"] == (640, 480) and facts["fps"] == 10 and len(pictures) == 3
    first, last = (np.frombuffer(picture, np.uint8).astype(int) for picture in (pictures[0], pictures[-1]))
    assert np.abs(first - last).mean() > 1  # something moved


def test_an_mp4_without_its_package_is_an_error_with_the_install_line(run, trajectory, tmp_path, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == "imageio_ffmpeg" else find(n))
    result = run("frames", trajectory, "-o", tmp_path / "a.mp4")
    assert result.exit_code == 2 and "pip install 'ddgcli[video]'" in result.stderr
    assert not (tmp_path / "a.mp4").exists()


def test_trajectories_hold_their_obstacles_for_series_pictures_and_pages(summary, tmp_path):
    (tmp_path / "scene.toml").write_text(
        SCENE.replace(
            "[effects]",
            """[[object]]
name = "ball"
role = "obstacle"
sphere = { center = [0.5, 0.5, -1.0], radius = 0.5 }
[[object]]
name = "floor"
role = "obstacle"
plane = { point = [0, 0, -2], normal = [0, 0, 1] }
[effects]
contact = { pairs = [["object_0", "ball"], ["object_0", "floor"]] }
""",
        ).replace('role = "shell"', 'name = "object_0"\nrole = "shell"')
    )
    path = tmp_path / "run.vtkhdf"
    summary("shell-sim", tmp_path / "scene.toml", "-o", path)
    with Trajectory(str(path)) as ours:
        bodies = ours.obstacles(2)
        points = ours.points(2)
    assert list(bodies) == ["ball", "floor"]
    radius = np.linalg.norm(bodies["ball"].points - [0.5, 0.5, -1.0], axis=1)
    np.testing.assert_allclose(radius, 0.5, rtol=1e-12)
    floor = bodies["floor"].points
    assert (floor[:, 2] == -2).all()
    assert (floor.min(axis=0)[:2] < points.min(axis=0)[:2]).all()  # wider than the shell
    summary("frames", path, "-o", tmp_path / "s.pvd", "--at", 0)
    assert len(list((tmp_path / "s").iterdir())) == 3
    assert summary("view", path, "-o", tmp_path / "v.html")["results"]["objects"][1:] == ["ball", "floor"]
    pictures = []
    for name, scene in (("with", path), ("without", _without_obstacles(path, tmp_path / "bare.vtkhdf"))):
        summary(
            "frames", scene, "-o", tmp_path / f"{name}.png", "--at", 0, "--view", "20,30", "--size", "400x300"
        )
        pictures.append((tmp_path / f"{name}.png").read_bytes())
    assert pictures[0] != pictures[1]


def test_a_moving_obstacle_is_in_every_frame_where_it_is_then(run, tmp_path):
    moving = """[[object]]
name = "ball"
role = "obstacle"
sphere = { center = [0.5, 0.5, -9.0], radius = 0.5 }
velocity = [0, 0, 10]
[effects]
contact = { pairs = [["sheet", "ball"]] }
"""
    text = SCENE.replace("[effects]", moving).replace('role = "shell"', 'name = "sheet"\nrole = "shell"')
    (tmp_path / "scene.toml").write_text(text)
    path = tmp_path / "run.vtkhdf"
    result = run("shell-sim", tmp_path / "scene.toml", "-o", path)
    assert result.exit_code == 0, result.stderr
    with Trajectory(str(path)) as ours:
        for k, time in enumerate(ours.times):
            ball = ours.obstacles(k)["ball"].points
            radius = np.linalg.norm(ball - [0.5, 0.5, -9.0 + 10 * time], axis=1)
            np.testing.assert_allclose(radius, 0.5, rtol=1e-9)


def _without_obstacles(path, target):
    import shutil

    import h5py

    shutil.copy(path, target)
    with h5py.File(target, "a") as file:
        del file["ddgcli/obstacles"]
    return target


def test_frames_of_equal_change_lie_where_a_motion_happens():
    still, moved = np.zeros((4, 3)), np.ones((4, 3))
    positions = [still] * 40 + [still + k / 10 * moved for k in range(11)] + [moved] * 40
    frame_numbers = frames_of_equal_change(positions, [None] * len(positions), 4)
    assert len(frame_numbers) == 4 and frame_numbers[0] == 0 and frame_numbers[-1] == 90
    assert all(40 < k < 51 for k in frame_numbers[1:-1])
    assert frames_of_equal_change([still] * 90, [None] * 90, 4) == [0, 30, 59, 89]


@pytest.mark.parametrize("words, message", [
    (["--at", 7], "0.04"),
    (["--from", 5], "no frame"),
    (["--at", 0.01, "--from", 0.02], "--from selects from several frames"),
    (["--at", 0.01, "--to", 0.02], "--to selects"),
    (["--at", 0.01, "--every", 2], "--every selects"),
    (["-o", "x.avi"], "unknown format"),
    (["-o", "x.mp4", "--size", "1281x960"], "even numbers"),
    (["--array", "velocty", "-o", "x.png"], "velocity"),
    (["--array", "velocity", "-o", "x.ply"], "--array is for"),
    (["--view", "iso"], "--view is for"),
    (["--fps", 3, "-o", "x.png"], "--fps is for .gif .mp4"),
    (["--fps", 60, "-o", "x.gif"], "--fps: 60: a .gif shows 0.01 to 50 frames per second"),
    (["--fps", 1e-6, "-o", "x.gif"], "--fps: 1e-06: a .gif shows 0.01 to 50"),
    (["--fps", 1e9, "-o", "x.mp4"], "--fps: 1e+09: a .mp4 shows 0.01 to 1000"),
])  # fmt: skip
def test_wrong_options_are_an_error(run, trajectory, tmp_path, words, message):
    words = [tmp_path / w if str(w).startswith("x.") else w for w in words]
    result = run("frames", trajectory, *words)
    assert result.exit_code == 2
    assert message in result.stderr and result.stderr.count("\n") == 1


def test_a_sequence_of_tiny_times_is_selected(summary, tmp_path):
    """Once 1e-12 of slack, more than all times of a run."""
    write_mesh(str(tmp_path / "a.ply"), AnnotatedMesh(shapes.icosphere(1)))
    run_path = tmp_path / "w.vtkhdf"
    summary("willmore-flow", tmp_path / "a.ply", "--dt", 1e-14, "--steps", 4, "-o", run_path)
    out = summary("frames", run_path, "--from", 1e-14, "--to", 3e-14, "-o", tmp_path / "f_{}.ply")
    assert out["results"]["exported_frames"] == 3


def test_a_file_that_is_no_trajectory_is_an_error(run, tmp_path):
    (tmp_path / "a.vtkhdf").write_bytes(b"not hdf")
    result = run("frames", tmp_path / "a.vtkhdf")
    assert result.exit_code == 2 and "not a ddgcli trajectory" in result.stderr
    assert run("frames", tmp_path / "b.vtkhdf").exit_code == 2


@pytest.mark.parametrize("words, unit", [([], "L⁴"), (["--flow", "mean-curvature"], "L²")])
def test_times_of_a_flow_have_the_unit_of_a_length_power(summary, tmp_path, words, unit):
    write_mesh(str(tmp_path / "a.ply"), AnnotatedMesh(shapes.icosphere(1)))
    words = [*words, "--dt", 1e-3, "--steps", 2, "-o", tmp_path / "w.vtkhdf", "--plot", tmp_path / "a.svg"]
    summary("willmore-flow", tmp_path / "a.ply", *words)
    summary("frames", tmp_path / "w.vtkhdf", "--at", 0, "-o", tmp_path / "b.svg")
    assert f"t = 0 {unit}" in (tmp_path / "b.svg").read_text(encoding="utf-8")


def test_paths_of_a_run_without_particles_name_the_command_that_has_them(run, trajectory, tmp_path):
    result = run("frames", trajectory, "--paths", "-o", tmp_path / "paths.vtp")
    assert result.exit_code == 2 and result.stderr.count(str(trajectory)) == 1
    assert "name the effect particles in a scene of fluid-sim" in result.stderr


def test_the_default_colours_are_of_a_quantity():
    """A remeshed flow has the numbers of its vertices as its only array; its picture is plain."""
    from types import SimpleNamespace

    from ddgcli.cli.commands.frames import _array_name

    def default(*names):
        return _array_name(
            SimpleNamespace(vertex=lambda k: dict.fromkeys(names, np.ones(3))), {"array": None}
        )

    assert default("input_vertex") is None and default() is None
    assert default("input_vertex", "strain") == default("strain", "path_id") == "strain"
    assert default("strain", "vorticity") == "vorticity"


@pytest.mark.parametrize(
    "times, selection, message",
    [
        ([0.0, 1.0], {"start": 5.0}, "no frame from 5 on; the run lasts from 0 to 1 s"),
        ([0.0, 1.0], {"start": 0.2, "end": 0.7}, "no frame from 0.2 to 0.7; the run lasts from 0 to 1 s"),
        ([0.0, 0.2, -0.1, 1.0], {"time": -0.3}, "--at -0.3: the run lasts from -0.1 to 1 s"),
    ],
)
def test_a_selection_outside_of_the_run_states_its_times(times, selection, message):
    from types import SimpleNamespace

    from ddgcli.cli.commands.frames import _frame_numbers
    from ddgcli.errors import ParameterError

    source = SimpleNamespace(
        times=np.array(times), n_frames=len(times), frame_at=lambda time: 0, attributes={}
    )
    settings = {"time": None, "start": None, "end": None, "every": 1, **selection}
    with pytest.raises(ParameterError, match=message):
        _frame_numbers(source, settings)
    source.attributes["time_unit"] = "L⁴"
    with pytest.raises(ParameterError, match=message[:-2] + " L⁴"):
        _frame_numbers(source, settings)
    settings = {"time": None, "start": None, "end": None, "every": 1}
    assert _frame_numbers(source, settings) == list(range(len(times)))  # load factors may fall
