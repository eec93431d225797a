"""--view, --show and --size; vectors as arrows, signed colours, creases, up axis and side."""

import re
import struct

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.colour import robust_limits
from ddgcli.plots.glyphs import SPACING, Glyphs, thin_glyphs
from ddgcli.plots.raster import fitted_camera, rasterise, view_axes
from ddgcli.plots.shading import _corner_normals, shading_spots
from ddgcli.plots.surface import _squares
from ddgcli.plots.viewpoint import best_view, up_axis_of


@pytest.fixture
def torus(tmp_path):
    path = tmp_path / "torus.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.torus(16, 8)))
    return path


def pixels(path):
    return struct.unpack(">II", path.read_bytes()[16:24])


@pytest.mark.parametrize("array", ["principal_direction_max", "mean_curvature_normal", "angle_defect"])
def test_every_array_of_curvature_has_a_picture_of_its_own(summary, torus, tmp_path, array):
    words = ("--size", "320x240", "--plot")
    summary("curvature", torus, *words, tmp_path / "plain.png")
    out = summary("curvature", torus, "--show", array, *words, tmp_path / "a.png")
    assert pixels(tmp_path / "a.png") == (320, 240)
    assert out["options"]["show"] == array and out["options"]["size"] == [320, 240]
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "plain.png").read_bytes()


@pytest.mark.parametrize("words", [
    ("curvature",), ("info",), ("hodge",), ("laplacian",), ("geodesic", "--source", "0"), ("delaunay",),
])  # fmt: skip
def test_every_command_turns_and_sizes_its_picture(run, summary, torus, tmp_path, words):
    command, *more = words
    for name, view in (("a", "iso"), ("b", "10,200:y")):
        summary(
            command, torus, *more, "--view", view, "--size", "300x201", "--plot", tmp_path / f"{name}.png"
        )
        assert pixels(tmp_path / f"{name}.png") == (300, 201)
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
    show = [] if command == "delaunay" else [("--show", "potential")]  # which draws edges, and no array
    for option, value in [("--view", "x"), ("--size", "300x300"), *show]:
        result = run(command, torus, *more, option, value)
        assert result.exit_code == 2 and f"{option} is for the picture of --plot" in result.stderr
    if not show:
        return
    result = run(
        command, torus, *more, "--show", "nothing", "--plot", tmp_path / "c.png", "-o", tmp_path / "c.npz"
    )
    assert result.exit_code == 2 and "'nothing'" in result.stderr and not list(tmp_path.glob("c.*"))


def test_pictures_show_paths_level_lines_generators_and_fields(summary, tmp_path):
    mesh = shapes.torus(16, 8)
    across = mesh.points[mesh.faces].mean(axis=1)[:, [1, 0, 2]] * [-1, 1, 0]
    write_mesh(str(tmp_path / "ring.vtu"), AnnotatedMesh(mesh, {}, {"wind": across}))
    calls = [("geodesic", "--source", "0"), ("geodesic", "--source", "0", "--path-to", "70")]
    calls += [("geodesic", "--source", "0", "--isolines", "3"), ("hodge",), ("hodge", "--field", "wind")]
    calls += [("info",), ("delaunay",)]
    pictures = set()
    for number, (command, *words) in enumerate(calls):
        path = tmp_path / f"{number}.png"
        summary(command, tmp_path / "ring.vtu", *words, "--size", "320x240", "--plot", path)
        pictures.add(path.read_bytes())
    assert len(pictures) == len(calls)


@pytest.mark.parametrize("command", ["dec", "view", "batch", "examples", "check"])
def test_commands_that_draw_nothing_have_no_options_of_pictures(run, command):
    assert not {"--plot", "--view", "--show", "--size"} & set(run(command, "--help-all").stdout.split())
    assert re.search("No such option:? '?--plot", run(command, "x", "--plot", "x.png").stderr)


@pytest.mark.parametrize(
    "command, options",
    [("tradeoff", {"--colors", "--view", "--show"}), ("delaunay", {"--colors", "--show"})],
)
def test_commands_have_no_options_that_they_always_refuse(run, command, options):
    shown = set(run(command, "--help-all").stdout.split())
    assert not options & shown and {"--plot", "--size"} <= shown


@pytest.mark.parametrize("value", ["300", "300x", "axb", "10x10", "300x99999", "-300x300"])
def test_sizes_that_are_none_are_refused(run, torus, tmp_path, value):
    result = run("info", torus, "--plot", tmp_path / "a.png", "--size", value)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1


def test_pictures_have_1280_pixels_by_default(default_pictures, summary, torus, tmp_path):
    summary("info", torus, "--plot", tmp_path / "a.png")
    assert pixels(tmp_path / "a.png")[0] >= 1280


def test_glyphs_are_visible_finite_and_one_a_square():
    mesh = shapes.icosphere(4)
    camera = fitted_camera(mesh.points, view_axes(mesh.points, "z"), 800, 600)
    vectors = np.cross(mesh.points, [0.0, 0.0, 1.0])
    vectors[:100] = np.nan
    glyphs = Glyphs(mesh.points, vectors)
    visible = thin_glyphs(camera, rasterise(camera, mesh.points, mesh.faces), glyphs)
    assert 100 < len(visible) < mesh.n_vertices / 2 and np.isfinite(vectors[visible]).all()
    assert mesh.points[visible, 2].min() > -0.2, "none of the far side"
    cell = np.floor(camera.project(mesh.points[visible])[:, :2] / (SPACING * 800))
    assert len(np.unique(cell, axis=0)) == len(visible)


def test_sparse_values_get_a_scale_about_zero():
    """A part whose curvature is on one vertex in a hundred, from -0.78 to 0.54."""
    values = 1e-13 * np.sin(np.arange(2000.0))
    values[::200], values[100::200] = np.linspace(-0.78, -0.4, 10), np.linspace(0.2, 0.54, 10)
    low, high, signed = robust_limits(values)
    assert signed and low == -high and 0.4 < high <= 0.78


def test_creases_are_not_smoothed_over_and_curves_are():
    ridge = TriangleMesh.from_arrays(
        np.array(
            [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, -1], [2, 1, -1]]
        ),  # folds by 45 degrees
        np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]),
    )
    normal = _corner_normals(ridge)
    assert np.allclose(normal[:2], [0, 0, 1]) and np.allclose(normal[2:], np.array([1, 0, 1]) / np.sqrt(2))
    ball = shapes.icosphere(2)
    assert np.abs(_corner_normals(ball) - ball.points[ball.faces]).max() < 0.05


def with_y_up(mesh):
    return mesh.moved(np.roll(mesh.points, -1, axis=1))  # z becomes y


def test_the_up_axis_is_guessed_from_the_base():
    standing = shapes.cylinder(24, 8)
    assert up_axis_of(standing) == "z" and up_axis_of(with_y_up(standing)) == "y"
    assert up_axis_of(shapes.icosphere(3)) == up_axis_of(shapes.torus(24, 12)) == "z"


def test_a_terrain_has_the_axis_of_its_heights_up_also_where_few_points_are_low():
    """Mount St. Helens, which has one valley in the lowest fiftieth, was drawn as a vertical wall."""
    grid = shapes.grid(20, 20)
    x, y = grid.points[:, 0], grid.points[:, 1]
    for heights in (0.05 * np.sin(7 * x) * np.cos(5 * y), np.hypot(x - 0.5, y - 0.5), 0.9 * y):
        hills = grid.moved(np.column_stack([x, y, heights]))
        assert up_axis_of(hills) == "z" and up_axis_of(with_y_up(hills)) == "y"


@pytest.mark.parametrize("up", ["z", "y"])
def test_the_picture_looks_at_the_side_of_the_values(up):
    ball = shapes.icosphere(3)
    for place in np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]):
        interest = np.exp(-10 * ((ball.points - place) ** 2).sum(axis=1))
        towards = view_axes(ball.points, best_view(ball, interest, up), up)[2]
        assert towards @ place > 0.2
    assert best_view(ball, np.ones(ball.n_vertices), up) is None
    assert best_view(shapes.grid(3, 3), np.arange(16.0), up) is None


def test_squares_change_colour_across_the_flat_layout():
    grid = shapes.grid(10, 10)
    camera = fitted_camera(grid.points, view_axes(grid.points, "z"), 240, 240)
    visible = rasterise(camera, grid.points, grid.faces)
    colour = _squares(grid, shading_spots(visible, every_sample=True), grid.points[:, :2])
    is_black = colour[:, 0] < 0.5
    assert 0.45 < is_black.mean() < 0.55
