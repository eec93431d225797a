"""Pictures: the nearest face is seen, colours mean values, files are whole, and the same bytes come twice."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ddgcli.errors import ParameterError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots import motion, page
from ddgcli.plots.chart import draw_chart
from ddgcli.plots.colour import colour_bar, colour_scale, is_signed, robust_limits, value_scale
from ddgcli.plots.curve import draw_curves, is_cut
from ddgcli.plots.motion import PlotFrame, sequence_style
from ddgcli.plots.page import cells
from ddgcli.plots.raster import fitted_camera, rasterise, view_axes, visible_runs
from ddgcli.plots.surface import draw_surface


def camera_on(mesh, view="iso", size=(160, 120)):
    return fitted_camera(mesh.points, view_axes(mesh.points, view), *size)


def test_a_square_fills_its_pixels_and_no_others():
    mesh = shapes.grid(3, 3)
    camera = camera_on(mesh, "z", (100, 100))
    pixels = rasterise(camera, mesh.points, mesh.faces)
    inside = 0.94 * 100
    assert len(pixels.pixel) == pytest.approx(inside**2, rel=0.03)
    place = np.einsum("ij,ijk->ik", pixels.barycentric, mesh.points[mesh.faces[pixels.face]])
    assert np.allclose(camera.project(place)[:, 0], pixels.pixel % 100 + 0.5, atol=1e-6)
    assert np.allclose(camera.project(place)[:, 1], pixels.pixel // 100 + 0.5, atol=1e-6)


def test_the_nearer_of_two_parallel_squares_is_drawn():
    below, above = shapes.grid(2, 2), shapes.grid(2, 2)
    points = np.concatenate([below.points, above.points + [0, 0, 1.0]])
    mesh = TriangleMesh.from_arrays(points, np.concatenate([below.faces, above.faces + 9]))
    pixels = rasterise(camera_on(mesh, "z"), mesh.points, mesh.faces)
    assert (pixels.face >= below.n_faces).all()


def test_a_ray_cast_of_a_torus_agrees_with_the_z_buffer():
    mesh = shapes.torus(24, 12)
    camera = camera_on(mesh)
    pixels = rasterise(camera, mesh.points, mesh.faces)
    corners = camera.project(mesh.points)[mesh.faces]
    for k in range(0, len(pixels.pixel), 97):
        x, y = pixels.pixel[k] % 160 + 0.5, pixels.pixel[k] // 160 + 0.5
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        det = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        px, py = x - corners[:, 0, 0], y - corners[:, 0, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = (px * b[:, 1] - py * b[:, 0]) / det, (py * a[:, 0] - px * a[:, 1]) / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1)
            depth = np.where(hit, corners[:, 0, 2] + u * a[:, 2] + v * b[:, 2], np.inf)
        assert pixels.depth.ravel()[pixels.pixel[k]] == pytest.approx(depth.min(), abs=1e-3)


def test_a_curve_behind_the_surface_is_not_drawn():
    mesh = shapes.icosphere(3)
    camera = camera_on(mesh, "z", (200, 200))
    pixels = rasterise(camera, mesh.points, mesh.faces)
    x = np.linspace(-0.8, 0.8, 50)
    for side in (1, -1):
        curve = np.stack([x, 0 * x, side * np.sqrt(1 - x**2)], axis=1)
        drawn = sum(np.ptp(run[:, 0]) for run in visible_runs(camera, pixels, [curve]))
        assert drawn == pytest.approx(1.6 * camera.scale if side > 0 else 0.0, abs=2)


def test_a_curve_of_the_far_side_does_not_show_along_the_outline():
    mesh = shapes.icosphere(5)
    camera = camera_on(mesh, "z", (1400, 1400))
    pixels = rasterise(camera, mesh.points, mesh.faces)
    angle = np.linspace(0, 2 * np.pi, 500)
    for side, least, most in ((1, 0.9, 1.01), (-1, 0.0, 0.02)):
        z = 0.05 * side  # within a pixel of the outline
        circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * np.sqrt(1 - z**2) + [0, 0, z]
        runs = visible_runs(camera, pixels, [circle])
        drawn = sum(np.linalg.norm(np.diff(run, axis=0), axis=1).sum() for run in runs)
        assert least <= drawn / (2 * np.pi * np.sqrt(1 - z**2) * camera.scale) <= most


def test_the_colour_range_ignores_outliers_and_is_symmetric_for_signed_values():
    values = np.linspace(-1, 2, 1001)
    values[:3] = [1e9, -1e9, np.inf]
    low, high, signed = robust_limits(values)
    assert signed and low == -high and 1.9 < high < 2.1
    low, high, signed = robust_limits(np.linspace(1, 2, 101))
    assert not signed and 1 <= low < 1.1 and 1.9 < high <= 2
    low, high, _ = robust_limits(np.full(10, 3.0) + 1e-12 * np.arange(10))
    assert high - low > 0.1


def test_a_constant_looks_constant_whatever_its_error():
    noise = np.linspace(-1e-4, 1e-4, 101)
    for size, values in ((0.0, 1 + noise), (0.0, -300 * (1 + noise)), (1.0, noise), (1.0, noise + 1e-4)):
        low, high, _ = robust_limits(values, size=size)
        assert low <= values.min() and values.max() <= high
        assert np.ptp(values) < 0.01 * (high - low)
    low, high, _ = robust_limits(np.linspace(0.9, 1.0, 101))
    assert (low, high) == pytest.approx((0.902, 0.998)), "a tenth is shown in full"


def test_the_picture_of_a_sphere_s_curvature_has_one_colour(tmp_path):
    """Unshaded hue: of the colours at equal brightness only the shade of the light may differ."""
    from matplotlib.image import imread

    sphere = shapes.icosphere(3)
    wavy = 1 + 1e-4 * np.sin(5 * sphere.points[:, 0])
    draw_surface(str(tmp_path / "a.png"), sphere, wavy, label="H", width=7, height=7, dpi=300 / 7)
    disk = imread(tmp_path / "a.png")[100:200, 80:180, :3].reshape(-1, 3)
    assert np.ptp(disk / disk.sum(axis=1, keepdims=True), axis=0).max() < 0.02
    draw_surface(str(tmp_path / "a.svg"), sphere, wavy, label="H", caption="scheme")
    text = (tmp_path / "a.svg").read_text()
    assert f"scheme; H from {wavy.min():.6g} to {wavy.max():.6g}" in text


def test_pixels_have_the_colour_of_their_values(tmp_path):
    from matplotlib.image import imread

    mesh = shapes.grid(40, 40)
    draw_surface(
        str(tmp_path / "a.png"), mesh, np.sign(mesh.points[:, 0] - 0.5), width=7, height=7, dpi=300 / 7
    )
    picture = imread(tmp_path / "a.png")[:, :, :3]
    left, right = picture[150, 50], picture[150, 210]
    assert left[2] > left[0] + 0.2, "negative is blue"
    assert right[0] > right[2] + 0.2, "positive is red"


@pytest.mark.parametrize("extension", ["png", "svg", "pdf"])
def test_pictures_are_the_same_bytes_twice_and_nothing_else_is_left(tmp_path, extension):
    mesh = shapes.torus(24, 12)
    curve = mesh.points[:24]
    for name in ("a", "b"):
        draw_surface(str(tmp_path / f"{name}.{extension}"), mesh, mesh.points[:, 2], curves=[curve], dpi=50)
        draw_curves(str(tmp_path / f"c{name}.{extension}"), [curve], [curve[:, 0]], closed=True, dpi=50)
        draw_chart(str(tmp_path / f"d{name}.{extension}"), {"x": ([1, 2], [3, np.nan])}, log="xy", dpi=50)
    for kind in ("", "c", "d"):
        first, second = (tmp_path / f"{kind}{name}.{extension}" for name in ("a", "b"))
        assert first.read_bytes() == second.read_bytes()
    assert len(list(tmp_path.iterdir())) == 6


def test_unknown_values_and_odd_meshes_still_give_a_picture(tmp_path):
    sphere = shapes.icosphere(1)
    values = sphere.points[:, 2].copy()
    values[0], values[1] = np.nan, np.inf
    draw_surface(str(tmp_path / "a.png"), sphere, values, dpi=50)
    flat_line = TriangleMesh.from_arrays(np.array([[0, 0, 0], [1, 0, 0], [2.0, 0, 0]]), np.array([[0, 1, 2]]))
    for scale in (1e-200, 1.0, 1e200):
        draw_surface(str(tmp_path / "b.png"), sphere.moved(sphere.points * scale), dpi=50)
        draw_surface(str(tmp_path / "c.png"), flat_line.moved(flat_line.points * scale), dpi=50)
    empty = TriangleMesh.from_arrays(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    draw_surface(str(tmp_path / "d.png"), empty, dpi=50)
    for picture in tmp_path.iterdir():
        assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 500
    assert len(list(tmp_path.iterdir())) == 4


def test_a_long_caption_stays_on_the_page(tmp_path):
    words = [f"word{k}" for k in range(60)]
    draw_chart(str(tmp_path / "a.svg"), {"x": ([1, 2], [3, 4])}, caption=" ".join(words))
    lines = re.findall(r">([^<>]*word[^<>]*)<", (tmp_path / "a.svg").read_text())
    assert len(lines) > 2 and max(map(len, lines)) < 115
    assert " ".join(lines).split() == words


def test_a_threshold_of_a_chart_crosses_it_and_is_in_the_legend(tmp_path):
    bare, marked = tmp_path / "a.svg", tmp_path / "b.svg"
    draw_chart(str(bare), {"x": ([1, 2], [3, 5])})
    draw_chart(str(marked), {"x": ([1, 2], [3, 5])}, threshold=("within 4", 4.0))
    assert "within 4" in marked.read_text() and "within 4" not in bare.read_text()
    dotted = re.findall(
        r'<path d="M ([\d.]+) ([\d.]+) \s*L ([\d.]+) ([\d.]+)[^>]*stroke-dasharray', marked.read_text()
    )
    x, y, end, level = map(float, max(dotted, key=lambda line: float(line[2]) - float(line[0])))
    assert y == level and end - x > 150, "a level line of the width of the chart"


@pytest.mark.parametrize("log", ["", "xy"])
def test_a_bar_reaches_as_far_below_its_point_as_above(tmp_path, log):
    """It ended at the axis of the bare series, which starts just below the lowest point."""
    path, lengths = tmp_path / "a.svg", {"x": [0.15, np.inf, 0.1, 0.19]}
    draw_chart(str(path), {"x": ([1, 2, 3, 4], [0.2, 0.21, 0.3, 0.2])}, bars=lengths, log=log)
    upright = r'd="M ([\d.]+) ([\d.]+) \s*L \1 ([\d.]+) [^>]*stroke: #8c8c8c'
    bars = {float(x): sorted((float(a), float(b))) for x, a, b in re.findall(upright, path.read_text())}
    assert len(bars) == 3, "none of an infinite length"
    first, second, long = (bars[x] for x in sorted(bars))
    if log:  # the longest, of more than a decade, ends with the axis; the others at 0.05, 0.35, 0.2 and 0.4
        decade = (second[1] - second[0]) / np.log10(2)
        assert first[1] - first[0] == pytest.approx(decade * np.log10(7), rel=1e-3)
        assert long[1] - first[1] == pytest.approx(decade * np.log10(1.1), rel=1e-2)
    else:
        assert first[1] - first[0] == pytest.approx(1.5 * (second[1] - second[0]), rel=1e-3)
        assert long[1] > first[1]


@pytest.mark.parametrize("view, up", [("iso", 2), ("x", 2), ("y", 2), ("z", 1)])
def test_what_is_higher_in_space_is_higher_in_the_picture(view, up):
    mesh = shapes.icosphere(1)
    row = camera_on(mesh, view).project(mesh.points)[:, 1]
    assert row[np.argmax(mesh.points[:, up])] < row[np.argmin(mesh.points[:, up])]


def test_labels_of_a_crowded_chart_overlap_neither_each_other_nor_points_and_lines():
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation, Text

    from ddgcli.plots.labels import place_labels

    figure = Figure(figsize=(7, 4.6), dpi=100)
    axes = figure.add_axes((0.1, 0.1, 0.6, 0.8))
    x, y = 10.0 ** np.random.default_rng(0).normal(scale=0.15, size=(2, 40))
    line = np.array([0.5, 1.0, 2.0]), np.array([1.0, 1.0, 0.7])
    axes.loglog(x, y, "o", markersize=5)
    axes.loglog(*line, "-")
    names = [(f"dt={k / 100:g}", a, b) for k, (a, b) in enumerate(zip(x, y))]
    place_labels(axes, names, [(x, y)], [line])
    renderer = FigureCanvasAgg(figure).get_renderer()
    window = axes.get_window_extent(renderer)
    notes = [child for child in axes.get_children() if isinstance(child, Annotation)]
    texts = []
    for note in notes:
        note.update_positions(renderer)
        texts.append(Text.get_window_extent(note, renderer))  # without the line to the point
    assert len(texts) >= 30
    assert not any(a.overlaps(b) for k, a in enumerate(texts) for b in texts[:k])
    ends = axes.transData.transform(np.stack(line, axis=1))
    along = [a + t * (b - a) for a, b in zip(ends[:-1], ends[1:]) for t in np.linspace(0, 1, 200)]
    points = axes.transData.transform(np.stack([x, y], axis=1))
    assert not any(box.contains(*point) for box in texts for point in [*points, *along])
    assert all(window.x0 <= box.x0 and box.x1 <= window.x1 for box in texts)
    leaders = {k: note.arrow_patch for k, note in enumerate(notes) if note.arrow_patch is not None}
    assert leaders
    for k, leader in leaders.items():  # as drawn: they began in the middle of their text, and crossed others
        start, end = leader.get_path().vertices[[0, -1]]
        crossed = [start + t * (end - start) for t in np.linspace(0, 1, 50)]
        others = [*texts[:k], *texts[k + 1 :]]
        assert not any(box.contains(*point) for box in others for point in crossed)


def test_labels_of_a_chart_keep_clear_of_its_bars_and_its_threshold(tmp_path, monkeypatch):
    import ddgcli.plots.chart as chart

    passed = []
    monkeypatch.setattr(chart, "place_labels", lambda axes, texts, points, lines: passed.extend(lines))
    series = {"x": ([1.0, 2.0], [3.0, 5.0])}
    options = {"bars": {"x": [0.0, 2.0]}, "threshold": ("within 4", 4.0), "labels": {"x": ["a", "b"]}}
    draw_chart(str(tmp_path / "a.png"), series, **options, dpi=50)
    bar, threshold = passed[-2:]
    assert list(bar[0]) == [2.0, 2.0] and list(bar[1]) == [3.0, 7.0]
    assert list(threshold[1]) == [4.0, 4.0] and threshold[0][0] < 1.0 < 2.0 < threshold[0][1]


def test_lengths_of_vectors_have_no_sign_and_zeros_begin_at_zero():
    assert [is_signed("vorticity"), is_signed("vorticity", 2), is_signed("strain")] == [True, False, None]
    assert robust_limits(np.zeros(9)) == (0.0, 1.0, False)
    mesh = shapes.grid(2, 2)
    plot_frame = PlotFrame(0.0, mesh, 1.0 + mesh.points[:, 0])
    assert sequence_style([plot_frame], "vorticity", signed=True).limits[0] < -1
    assert sequence_style([plot_frame], "vorticity", signed=False).limits[0] > 0.9


def test_a_strain_of_rounding_looks_constant_in_pictures_motions_and_pages(tmp_path, monkeypatch):
    """A shell at rest showed a pattern of strains from 0 to 9e-16."""
    from ddgcli.plots import array
    from ddgcli.plots.web_page import ViewedObject, page_bytes

    mesh = shapes.grid(4, 4)
    strain = np.linspace(0, 9e-16, mesh.n_vertices)
    monkeypatch.setattr(array, "draw_surface", lambda path, mesh, values, **o: sizes.append(o["value_size"]))
    sizes: list[float] = []
    array.draw_array("", mesh, "strain", strain)
    array.draw_array("", mesh, "strain_tensor", np.tile(strain[:, None], 3))
    page = page_bytes("", [ViewedObject("a", [mesh.points], [mesh.faces], {"strain": [strain]})]).decode()
    shown = json.loads(page.split('json">')[1].split("</script>")[0])["objects"][0]["arrays"][0]
    style = sequence_style([PlotFrame(0.0, mesh, strain)], "strain", value_size=value_scale("strain"))
    ranges = [robust_limits(strain, None, size)[:2] for size in sizes]
    for low, high in [*ranges, style.limits, (shown["low"], shown["high"])]:
        assert high - low == pytest.approx(1e-10) and low <= 0 and high >= 9e-16
    assert robust_limits(1e6 * strain, None, value_scale("strain"))[1] < 1e-9, (
        "small strains keep their range"
    )


def test_arrows_of_frames_are_inside_the_picture(tmp_path, monkeypatch):
    from ddgcli.plots import surface
    from ddgcli.plots.glyphs import ARROW_LENGTH, Arrows

    cameras = []
    monkeypatch.setattr(
        surface, "draw_arrows", lambda axes, camera, visible, arrows: cameras.append((camera, arrows))
    )
    mesh = shapes.torus(12, 8)
    outward = mesh.points / np.linalg.norm(mesh.points, axis=1, keepdims=True)
    draw_surface(str(tmp_path / "a.png"), mesh, arrows=[Arrows(mesh.points, outward, "blue")], dpi=30)
    [(camera, [arrows])] = cameras
    size = max(camera.width, camera.height)
    flat = ARROW_LENGTH * size * (arrows.vectors @ camera.axes.T)[:, :2] * [1.0, -1.0]
    tip = camera.project(arrows.places)[:, :2] + flat
    assert (tip >= 0).all() and (tip <= [camera.width, camera.height]).all()


@pytest.mark.parametrize(
    ("size", "rows"), [((4.0, 1.0, 0.0), [1.0, 1.0]), ((1.0, 4.0, 0.0), [0.5]), ((1.0, 1.0, 0.0), [0.5])]
)
def test_frames_of_a_motion_stand_in_the_columns_that_show_them_largest(tmp_path, monkeypatch, size, rows):
    """Two frames stand side by side, where they are not much wider than high."""
    from ddgcli.plots import motion

    sizes = []
    draw_frame = motion.draw_frame
    monkeypatch.setattr(motion, "draw_frame", lambda *a, **k: (sizes.append(a[3:5]), draw_frame(*a, **k)))
    mesh = shapes.grid(2, 2)
    mesh = mesh.moved(mesh.points * (*size[:2], 1.0))
    plot_frames = [PlotFrame(0.0, mesh), PlotFrame(1.0, mesh.moved(mesh.points * (1.0, 0.9, 1.0)))]
    series = {"energy": ([0, 1], [1, 2])}
    motion.draw_motion(
        str(tmp_path / "a.png"), plot_frames, series, sequence_style(plot_frames), "energy", 6.0, 6.0, dpi=30
    )
    assert sizes == [(6.0 * share, 0.7 * 6.0 / len(rows)) for share in (rows * 2)[:2]]


def test_a_motion_of_spheres_fills_its_pictures():
    """The corners of the bounding box of a sphere would leave a third of a picture empty."""
    sphere = shapes.icosphere(3)
    style = sequence_style([PlotFrame(0.0, sphere), PlotFrame(1.0, sphere.moved(0.9 * sphere.points))])
    axes = view_axes(style.fit)
    assert np.ptp(style.fit @ axes.T, axis=0)[:2] == pytest.approx(
        np.ptp(sphere.points @ axes.T, axis=0)[:2], rel=1e-12
    )


def test_frames_of_a_motion_share_one_colour_bar(tmp_path, monkeypatch):
    from ddgcli.plots import motion, surface

    bars = []
    monkeypatch.setattr(motion, "colour_bar", lambda figure, mappable, *rest: bars.append((mappable, *rest)))
    monkeypatch.setattr(surface, "colour_bar", lambda *a: bars.append("of a frame"))
    mesh = shapes.grid(8, 8)
    plot_frames = [PlotFrame(t, mesh, (1.0 + t) * mesh.points[:, 0]) for t in (0.0, 1.0)]
    style = sequence_style(plot_frames, "strain", limits=(0.0, 1.5))
    series = {"energy": ([0, 1], [1, 2])}
    motion.draw_motion(str(tmp_path / "a.png"), plot_frames, series, style, "energy", 6.0, 6.0, dpi=30)
    [(mappable, label, ends, _)] = bars
    assert (mappable.get_clim(), label, ends) == ((0.0, 1.5), "strain", "max")


@pytest.mark.parametrize(("up", "axes"), [("z", [0, 1, 2]), ("y", [1, 2, 0]), ("x", [2, 0, 1])])
def test_a_motion_in_a_plane_is_seen_along_its_normal_whatever_the_obstacles(up, axes):
    ground, pillar = shapes.grid(4, 4), shapes.box(1, 1, 1, size=(0.1, 0.1, 2.0))
    ground, pillar = (mesh.moved(mesh.points[:, axes]) for mesh in (ground, pillar))
    normal = np.eye(3)[2][axes]
    style = sequence_style([PlotFrame(0.0, ground, obstacles=[pillar])], view={"up": up})
    towards = view_axes(style.fit, style.view["view"], up)[2]
    assert abs(towards @ normal) > 1 - 1e-12
    bent = ground.moved(ground.points + 0.3 * np.outer(np.arange(ground.n_vertices), normal))
    assert sequence_style([PlotFrame(0.0, bent)], view={"up": up}).view["view"] is None


def test_a_long_label_of_the_vertical_axis_stays_on_the_page(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    figures = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (figures.append(self), save(self, *a, **k)))
    label = "kinetic energy over density [m⁴/s²]"
    draw_chart(str(tmp_path / "a.png"), {"energy": ([0, 1], [1, 2])}, ylabel=label, width=9.0, height=2.33)
    extent = figures[0].axes[0].yaxis.label.get_window_extent()
    assert extent.y0 >= 0 and extent.y1 <= 2.33 * 200 and extent.x0 >= 0


@pytest.mark.parametrize(
    ("extents", "columns"),
    [([4.0, 1.0], 1), ([1.0, 1.0], 2), ([[4.0, 1.0], [1.0, 1.0]], 1), ([[4.0, 1.0], [0.1, 1.0]], 2)],
)
def test_two_shapes_stand_in_the_columns_that_show_them_largest(extents, columns):
    """On a page of 4 by 3: the mean logarithm of the sizes decides where the shapes differ."""
    boxes = cells(2, np.array(extents), (0.0, 0.25, 1.0, 0.75), 4 / 3)
    across, down = [(1.0, 0.375), (0.5, 0.75)][columns - 1]
    assert boxes[0] == (0.0, 1.0 - down, across, down)
    assert boxes[1] == ((0.0, 0.25, 1.0, 0.375) if columns == 1 else (0.5, 0.25, 0.5, 0.75))


@pytest.mark.parametrize("same_time", [True, False])
def test_a_curve_is_cut_where_it_passes_behind_one_of_its_own_time_alone(same_time):
    """Once curves of other times cut each other into dashes."""
    x = np.linspace(-50.0, 50.0, 101)
    near, far = np.stack([x, 0 * x, 0 * x], axis=1), np.stack([0 * x, x, 1 + 0 * x], axis=1)
    curve = np.repeat([0, 1], 101)
    cut = is_cut(np.concatenate([near, far]), np.zeros(202) if same_time else curve, curve, 5.0)
    assert not cut[:101].any()
    assert np.array_equal(cut[101:], (np.abs(x) <= 5.0) & same_time)
    assert not is_cut(far, np.zeros(101), np.zeros(101, dtype=int), 5.0).any()  # neighbours along one curve


@pytest.mark.parametrize("pixels", [(200, 200), (300, 1200), (560, 420), (1400, 1050), (4000, 300)])
def test_letters_have_eight_pixels_and_bars_a_bounded_length(pixels):
    size = page.size_in_inches(pixels)
    assert (size["width"] * size["dpi"], size["height"] * size["dpi"]) == pytest.approx(pixels)
    assert page.CAPTION_POINTS / 72 * size["dpi"] >= 8
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size["width"], size["height"]), dpi=size["dpi"])
    colour_bar(figure, colour_scale(-1.0, 2.0, True), "height", "both")
    place = figure.axes[0].get_position()
    assert place.height * size["height"] <= 4.6
    axes = page.picture_axes(figure, coloured=True, caption="a long caption " * 4)
    assert axes.get_position().x1 < place.x0 < 1 - 0.9 / size["width"]


def test_elevations_beyond_the_poles_are_refused(tmp_path):
    ball = shapes.icosphere(1)
    draw_surface(str(tmp_path / "ball.png"), ball, view=(90.0, 10.0), dpi=40)
    for elevation in (95.0, -90.5, float("nan")):
        with pytest.raises(ParameterError, match="beyond 90 degrees"):
            draw_surface(str(tmp_path / "ball.png"), ball, view=(elevation, 10.0))


def test_the_picture_of_modes_shows_the_lowest_that_is_no_rigid_motion(summary, tmp_path, monkeypatch):
    drawn = {}

    def draw(path, mesh, values, **options):
        drawn.update(mesh=mesh, values=values, title=options["title"])
        Path(path).write_bytes(b"")

    monkeypatch.setattr("ddgcli.plots.surface.draw_surface", draw)
    mesh = shapes.grid(3, 3)
    write_mesh(str(tmp_path / "sheet.ply"), AnnotatedMesh(mesh))
    words = ("--effect", "stretching", "--effect", "bending", "--modes", 8)
    outputs = ("-o", tmp_path / "modes.vtu", "--plot", tmp_path / "modes.png")
    report = summary("shell-sim", tmp_path / "sheet.ply", "--material", "rubber", *words, *outputs)
    shape = read_mesh(str(tmp_path / "modes.vtu")).vertex["mode_006"]
    np.testing.assert_allclose(drawn["mesh"].points - mesh.points, 0.1 * shape, atol=1e-12)
    np.testing.assert_allclose(drawn["values"], np.linalg.norm(shape, axis=1))
    assert drawn["title"] == f"mode 6: {report['results']['frequencies'][6]:.4g} Hz"


def test_the_pictured_shape_is_that_of_buckling_before_modes():
    from ddgcli.cli.commands.shell_sim import _shape

    vertex = {f"mode_{k:03d}": k for k in range(3)}
    assert _shape({}, {"strain": 1}) is None
    assert _shape({"frequencies": [0.0, 1e-9, 2.5]}, vertex) == ("mode 2: 2.5 Hz", 2)
    assert _shape({"frequencies": [-3.0, 0.0, 2.5]}, vertex) == ("unstable mode 0: -3 Hz", 0)
    assert _shape({"frequencies": [0.0, 0.0, 0.0]}, vertex) == ("rigid motion 0: 0 Hz", 0)
    both = {"frequencies": [1.0, 2.0, 3.0], "load_factors": [0.5]}
    assert _shape(both, {**vertex, "buckling_000": 9}) == ("buckling at 0.5 times the loads", 9)


@pytest.mark.parametrize(
    "time, title, axis",
    [
        ({"arc_length": 1e-3, "duration": 1.0}, "load factor = -0.25", "load factor"),
        (
            {"arc_length": 1e-3, "duration": 2.0},
            "load factor × duration = -0.25 s",
            "load factor × duration [s]",
        ),
        ({"duration": 1.0}, "t = -0.25 s", "time [s]"),
    ],
)
def test_load_factors_are_not_shown_as_seconds(tmp_path, monkeypatch, time, title, axis):
    from ddgcli.cli.simulation.scene_run import time_label

    titles, axes = [], []
    monkeypatch.setattr(motion, "draw_surface", lambda path, mesh, values, **o: titles.append(o["title"]))
    monkeypatch.setattr(motion, "draw_chart", lambda path, series, **o: axes.append(o["xlabel"]))
    monkeypatch.setattr("matplotlib.image.imread", lambda path: np.ones((4, 4, 3)))
    still = motion.PlotFrame(-0.25, shapes.grid(2, 2))
    style = motion.sequence_style([still], **time_label(SimpleNamespace(time=SimpleNamespace(**time))))
    motion.draw_motion(str(tmp_path / "p.png"), [still], {"energy": ([0.0], [1.0])}, style, "energy")
    assert (titles, axes) == ([title], [axis])


@pytest.mark.parametrize("degrees", [30, -30])
def test_a_plane_in_front_of_a_surface_does_not_hide_it(tmp_path, degrees):
    """Once a press above a shell, or its floor seen from below, was all that a picture showed."""
    from matplotlib.image import imread

    ball, square = shapes.icosphere(2), shapes.grid(4, 4)
    square = square.moved(6 * square.points - [3, 3, 0])
    floor, press = (square.moved(square.points + [0, 0, z]) for z in (-1.2, 1.2))

    def picture(*planes):
        path = tmp_path / "a.png"
        draw_surface(str(path), ball, context=planes, view=(degrees, 20), fit=1.5 * ball.points, dpi=30)
        return imread(path)[..., :3]

    behind, in_front = (floor, press) if degrees > 0 else (press, floor)
    clear = picture()
    shell = (np.abs(clear - 1) > 0.02).any(axis=-1)
    assert shell.mean() > 0.1
    assert np.abs(picture(behind) - clear).max(axis=-1)[~shell].mean() > 0.05  # it is drawn whole
    with_both = picture(behind, in_front)
    assert (np.abs(with_both - clear).max(axis=-1)[shell] > 0.05).mean() < 0.1
    assert np.abs(picture(in_front) - clear).max() > 0.1  # its outline
