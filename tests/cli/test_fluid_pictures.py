"""Pictures of fluids: arrows of the velocity, particles and their paths."""

import numpy as np
import pytest

from ddgcli.choices import VELOCITY_GLYPHS
from ddgcli.cli.simulation.plot import array_label, glyphs_of_velocity, particle_lines
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.trajectories.paths import particle_paths
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.periodic import Periods
from ddgcli.plots.glyphs import SPACING as GLYPH_SPACING
from ddgcli.plots.glyphs import draw_glyphs
from ddgcli.plots.raster import fitted_camera, rasterise, view_axes
from ddgcli.plots.streamlines import SPACING, streamlines

TIMES = np.array([0.0, 1.0, 2.0, 3.0])
# one particle that moves along x, one that leaves a periodic square on the right and comes in on the left
WALK = np.array([[0.1, 0.2, 0.3, 0.4], [0.8, 0.95, 0.1, 0.25]])
PLACES = np.stack([WALK, 0.5 + 0 * WALK, 0 * WALK], axis=2).transpose(1, 0, 2).reshape(4, -1)


def test_paths_end_where_the_particles_are_and_begin_at_the_start():
    lines = particle_lines(TIMES, {"particles_f": PLACES}, 2.0, shapes.grid(4, 4))
    assert [len(line) for line in lines] == [3, 3]
    assert np.array_equal(lines[0][:, 0], WALK[0, :3]) and np.array_equal(lines[1][:, 0], WALK[1, :3])
    assert particle_lines(TIMES, {"kinetic_energy": TIMES}, 2.0, shapes.grid(4, 4)) == []


def test_paths_on_a_periodic_grid_do_not_cross_the_picture():
    square = shapes.grid(4, 4)
    periods = Periods({"f": np.array([1.0, 1.0, 0.0])}, np.zeros(square.n_faces, dtype=np.int64))
    for shift in (0.0, 1.0, -3.0):  # particles may be any number of periods away
        lines = particle_lines(TIMES, {"particles_f": PLACES + shift * (PLACES > 0)}, 3.0, square, periods)
        assert len(lines[0]) == 4 and np.allclose(lines[1][:, 0], WALK[1, 2:])
        assert all(np.allclose(line[:, 1:], [0.5, 0.0]) for line in lines)


PERIODIC_SCENE = """\
[time]
duration = 0.2
step = 0.1
frame_every = 0.1
[[object]]
name = "still"
role = "fluid"
grid = { size = [1, 1], cells = [4, 4] }
position = [-2, 0, 0]
[[object]]
name = "torus"
role = "fluid"
grid = { size = [2, 1], cells = [8, 6], periodic = "xy" }
scale = 0.5
position = [3, 0, 0]
[effects]
initial = { velocity = [2, "sin(2*pi*x)", 0] }
harmonic = {}
particles = { count = 20 }
"""


@pytest.fixture(scope="module")
def periodic_pictures(run, tmp_path_factory):
    """What `fluid-sim --plot` and `frames --plot` draw of a periodic grid beside another fluid."""
    folder = tmp_path_factory.mktemp("periodic")
    (folder / "s.toml").write_text(PERIODIC_SCENE)
    drawn = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "ddgcli.plots.motion.draw_motion",
            lambda path, plot_frames, series, style, ylabel, **size: (
                drawn.append((plot_frames, ylabel)) or open(path, "wb").close()
            ),
        )
        words = ("-o", folder / "r.vtkhdf", "--plot", folder / "a.png", "--show", "speed")
        for call in (("fluid-sim", folder / "s.toml", *words), ("frames", folder / "r.vtkhdf", *words[2:])):
            result = run(*call)
            assert result.exit_code == 0, result.stderr
    return folder / "r.vtkhdf", drawn


@pytest.mark.parametrize("number", [0, 1])
def test_pictures_of_periodic_grids_show_every_face_within_its_periods(periodic_pictures, number):
    path, drawn = periodic_pictures
    with Trajectory(str(path)) as source:
        mesh, speed, velocity = source.mesh, source.vertex(2)["speed"], source.vertex(2)["velocity"]
    plot_frame = drawn[number][0][-1]
    points = plot_frame.mesh.points
    assert plot_frame.mesh.n_faces == mesh.n_faces == len(plot_frame.arrows.faces)
    assert face_area(plot_frame.mesh.side_length).sum() == pytest.approx(1.0 + 0.5)
    torus = points[:, 0] > 2
    assert np.allclose(points[torus].min(axis=0), [3, 0, 0])
    assert np.allclose(points[torus].max(axis=0), [4, 0.5, 0])
    original = points.copy()
    original[torus] = [3, 0, 0] + np.mod(points[torus] - [3, 0, 0] + 1e-9, [1, 0.5, 1]) - 1e-9
    gap = np.linalg.norm(original[:, None] - mesh.points, axis=2)
    vertex = gap.argmin(axis=1)
    assert gap.min(axis=1).max() < 1e-7 and np.ptp(speed[vertex]) > 0.1
    assert np.array_equal(plot_frame.values, speed[vertex])
    assert np.array_equal(plot_frame.arrows.vectors, velocity[vertex])
    assert np.array_equal(plot_frame.arrows.places, points)


@pytest.mark.parametrize("number", [0, 1])
def test_particles_on_periodic_grids_are_on_the_drawn_faces(periodic_pictures, number):
    for plot_frame in periodic_pictures[1][number][0]:
        on_torus = [path - [3, 0, 0] for path in plot_frame.paths if path[0, 0] > 0]
        places = np.concatenate(on_torus)
        assert len(on_torus) == 20 and len(plot_frame.paths) == 40
        assert (places >= -1e-12).all() and (places <= np.array([1, 0.5, 0]) + 1e-12).all()


def test_trajectories_hold_the_periods_of_their_fluids(periodic_pictures):
    with Trajectory(str(periodic_pictures[0])) as source:
        periods = {name: period.tolist() for name, period in source.periods.of_object.items()}
        assert periods == {"still": [0, 0, 0], "torus": [1, 0.5, 0]}
        across = source.face(0)["wraps"] != 0
        corner = source.mesh.points[source.mesh.faces]
        assert np.array_equal(across, (np.ptp(corner, axis=1) > [0.5, 0.25, 1]).any(axis=1))
        assert np.array_equal(source.periods.of_faces[:, 0] > 0, source.face(0)["object_id"] == 1)


def test_exported_paths_do_not_cross_a_periodic_grid_beside_another_fluid(periodic_pictures):
    with Trajectory(str(periodic_pictures[0])) as source:
        paths = particle_paths(source, range(source.n_frames))
        stored = source.scalars["particles_torus"].reshape(source.n_frames, -1, 3)
    steps = np.abs(np.diff(paths.points[paths.lines], axis=1))[:, 0]
    assert (steps[:, 0] < 0.5).all() and (steps[:, 1] < 0.25).all()
    crossings = (np.abs(np.diff(stored, axis=0)) > [0.5, 0.25, 1]).any(axis=2).sum()
    assert crossings > 0 and len(steps) == 2 * 40 - crossings


def test_charts_of_fluids_have_the_unit_of_their_energy(periodic_pictures):
    labels = [ylabel for _, ylabel in periodic_pictures[1]]
    assert labels == ["kinetic energy over density [m⁴/s²]"] * 2


def test_arrows_stand_on_the_cut_of_a_volume():
    box = shapes.box_tetrahedra(4, 4, 4)
    vectors = np.tile([1.0, 0.0, 0.0], (box.n_vertices, 1))
    arrows = glyphs_of_velocity(box, vectors, "arrows")
    assert arrows.places[arrows.faces][..., 1].min() > 0.2 and len(arrows.vectors) == len(arrows.places)
    assert glyphs_of_velocity(box, None, "arrows") is None
    assert glyphs_of_velocity(box, vectors, "none") is None


@pytest.mark.parametrize("cells", [3, 32, 75])
def test_arrows_on_a_regular_grid_are_at_equal_distances_and_have_the_velocity_there(cells):
    """Whatever the size of its cells: one in each square of the picture, in its centre."""

    class Axes:
        segments = np.zeros((0, 2, 2))

        def add_collection(self, lines):
            self.segments = np.array(lines.get_segments())

    square = shapes.grid(cells, cells)
    camera = fitted_camera(square.points, view_axes(square.points, "z"), 640, 480)
    visible, axes = rasterise(camera, square.points, square.faces), Axes()
    wind = np.stack(
        [1.0 + square.points[:, 1], 0.5 + 0 * square.points[:, 0], 0 * square.points[:, 0]], axis=1
    )
    draw_glyphs(axes, camera, visible, glyphs_of_velocity(square, wind, "arrows"))
    shaft = axes.segments[: len(axes.segments) // 3]
    middle, along = shaft.mean(axis=1), np.diff(shaft, axis=1)[:, 0]
    centres = [np.unique(middle[:, axis].round(6)) for axis in (0, 1)]
    assert len(middle) == len(centres[0]) * len(centres[1]) > 100
    assert all(np.allclose(np.diff(c), 640 * GLYPH_SPACING) for c in centres)
    low, high = (getattr(camera.project(square.points)[:, :2], end)(axis=0) for end in ("min", "max"))
    assert np.abs(np.array([c[0] + c[-1] for c in centres]) - (low + high)).max() < 2.5
    y = (high[1] - middle[:, 1]) / (high[1] - low[1])
    inner = np.hypot(*along.T) < 0.97 * np.hypot(*along.T).max()  # the longest are cut
    assert np.allclose((-along[:, 0] / along[:, 1])[inner], 2.0 * (1.0 + y)[inner], rtol=0.01)


def test_labels_of_colour_bars_of_flows_have_units():
    arrays = ("vorticity", "velocity", "speed", "pressure", "stream_function", "temperature", "dye")
    labels = [array_label(name, arrays) for name in arrays]
    assert labels == [
        "vorticity [1/s]", "velocity [m/s]", "speed [m/s]", "pressure [m²/s²]", "stream_function [m²/s]",
        "temperature [K]", "dye",
    ]  # fmt: skip
    assert array_label("velocity", ("velocity", "strain")) == "velocity"


@pytest.mark.parametrize("what", ["arrows", "streamlines", "paths"])
def test_arrows_and_paths_are_seen(tmp_path, what):
    from matplotlib.image import imread

    from ddgcli.plots.motion import PlotFrame, draw_frame, sequence_style

    square = shapes.grid(8, 8)
    wind = np.tile([1.0, 0.5, 0.0], (square.n_vertices, 1))
    options = {
        "arrows": {"arrows": glyphs_of_velocity(square, wind, "arrows")},
        "streamlines": {"arrows": glyphs_of_velocity(square, wind, "streamlines")},
        "paths": {"paths": [np.array([[0.2, 0.2, 0.0], [0.8, 0.6, 0.0]])]},
    }
    line_pixels = []
    for k, more in enumerate(({}, options[what])):
        plot_frame = PlotFrame(0.0, square, np.zeros(square.n_vertices), **more)
        path = str(tmp_path / f"{k}.png")
        draw_frame(path, plot_frame, sequence_style([plot_frame]), 3.0, 2.25, 100)
        line_pixels.append(int((imread(path)[..., :3].max(axis=2) < 0.3).sum()))
    assert line_pixels[1] > line_pixels[0] + 50


def turning_streamlines(size=400):
    """Streamlines of a turn about the middle of a square, as columns and rows from the middle."""
    square = shapes.grid(16, 16)
    x, y, _ = square.points.T - 0.5
    camera = fitted_camera(square.points, view_axes(square.points, "z"), size, size)
    visible = rasterise(camera, square.points, square.faces)
    lines = streamlines(camera, visible, square.faces, np.stack([-y, x, 0 * x], axis=1))
    return [line - size / 2 for line in lines]


def test_streamlines_of_a_turn_are_circles_about_its_centre():
    lines = turning_streamlines()
    radii = [np.hypot(*line.T) for line in lines]
    assert len(lines) > 8 and max(len(line) for line in lines) > 100
    # a step is a fifth of the spacing, the direction that of a pixel
    assert all(np.ptp(radius) < 0.04 * 400 for radius in radii)
    # counter-clockwise as the flow: rows grow downwards
    turns = [line[:-1, 0] * line[1:, 1] - line[:-1, 1] * line[1:, 0] for line in lines]
    assert all((turn < 0).all() for turn in turns)


def test_streamlines_keep_their_distance():
    lines = turning_streamlines()
    assert len(lines) > 8
    spacing = SPACING * 400
    for k, line in enumerate(lines):
        for other in lines[:k]:
            gap = np.hypot(*(line[:, None] - other[None]).transpose(2, 0, 1)).min()
            assert gap > 0.4 * spacing


def test_the_option_of_glyphs_changes_the_picture(run, tmp_path):
    pictures = []
    scene = '[[object]]\nrole = "fluid"\ngrid = { size = [1, 1], cells = [8, 8] }\n[effects]\n'
    (tmp_path / "s.toml").write_text(scene + 'initial = { vorticity = "x*y" }\n')
    for style in VELOCITY_GLYPHS:
        target = tmp_path / f"{style}.png"
        words = ["--steps", "1", "--dt", "0.1", "--glyphs", style, "--plot", target, "--size", "400x480"]
        assert run("fluid-sim", tmp_path / "s.toml", *words).exit_code == 0
        pictures.append(target.read_bytes())
    assert len(set(pictures)) == len(VELOCITY_GLYPHS)
    refused = run("fluid-sim", tmp_path / "s.toml", "--steps", "1", "--glyphs", "streamlines")
    assert refused.exit_code == 2 and "--plot" in refused.stderr
