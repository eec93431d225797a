"""Colours of pixels from their samples, and of animations from a palette."""

import numpy as np
import pytest

from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots import surface
from ddgcli.plots.animation import in_256_colours
from ddgcli.plots.colour import colour_bar, colour_scale
from ddgcli.plots.raster import fitted_camera, rasterise, view_axes
from ddgcli.plots.shading import OUTLINE_LIGHT, SAMPLES, brightness, picture_of_spots, shading_spots


def samples_of(mesh, size=(240, 180), view="iso"):
    camera = fitted_camera(mesh.points, view_axes(mesh.points, view), *size)
    return camera, rasterise(camera, mesh.points, mesh.faces)


@pytest.mark.parametrize("n", [3, 40])
def test_one_colour_for_a_pixel_of_one_face_is_that_of_its_samples(n):
    torus = shapes.torus(3 * n, n)
    camera, visible = samples_of(torus, (241, 181))
    pictures = []
    for every_sample in (False, True):
        spots = shading_spots(visible, every_sample=every_sample)
        light = brightness(camera, torus, spots)[:, None]
        pictures.append(picture_of_spots(visible, spots, light * spots.barycentric).astype(int))
    assert pictures[0].shape == (90, 120, 4)
    change = np.abs(pictures[0] - pictures[1])
    assert change.max() <= 40 and np.quantile(change, 0.999) <= 8  # barycentric coordinates run over faces


def test_a_face_of_one_colour_has_it_whatever_the_spots():
    square = shapes.grid(2, 2)
    _, visible = samples_of(square, (100, 100), "z")
    whole, single = shading_spots(visible), shading_spots(visible, every_sample=True)
    assert len(whole.face) < 0.35 * len(single.face)
    grey = [picture_of_spots(visible, s, np.full((len(s.face), 3), 0.4)) for s in (whole, single)]
    assert np.array_equal(*grey) and np.all(grey[0][10:40, 10:40, :3] == 102)


def test_the_share_of_samples_is_the_grey_of_a_rim():
    square = shapes.grid(2, 2)
    _, visible = samples_of(square, (101, 101), "z")
    spots = shading_spots(visible)
    picture = picture_of_spots(visible, spots, np.zeros((len(spots.face), 3)))[..., 0]
    half = visible.face_image[: 2 * len(picture), : 2 * len(picture)] < 0
    share = half.reshape(len(picture), SAMPLES, -1, SAMPLES).sum(axis=(1, 3)) / SAMPLES**2
    outline = picture < 255 * share - 1  # outlines of the paper
    assert np.all(picture[~outline] == np.rint(255 * share[~outline]))
    assert np.all(picture >= np.floor(255 * share * OUTLINE_LIGHT)) and (share % 1 > 0).any()


def test_the_palette_of_an_animation_has_no_visible_steps():
    """Each of a ramp of 1,000 colours is within three of 255 steps of its own."""
    ramp = np.linspace(0, 255, 1000)
    colours = np.stack([ramp, 255 - ramp, 0.5 * ramp + 60], axis=1).astype(np.uint8)
    pixels = np.broadcast_to(colours, (120, 1000, 3)).copy()
    palette, number = in_256_colours(pixels)
    shown = palette[number].astype(int)
    assert len(np.unique(number)) > 200
    assert np.abs(shown - pixels).max() <= 3


def grey_of_picture(path, mesh, values, view):
    """Median brightness of the pixels of a picture that are not paper."""
    from matplotlib.image import imread

    surface.draw_surface(str(path), mesh, values, limits=(-1, 1), signed=True, bar=False, view=view, dpi=30)
    pixels = imread(path)[..., :3].mean(axis=2)
    return float(np.median(pixels[pixels < 0.999]))


@pytest.mark.parametrize("view", [(90.0, -90.0), (25.0, -60.0), (-25.0, -60.0), (-25.0, 120.0)])
@pytest.mark.parametrize("upside_down", [False, True])
def test_values_of_zero_are_white_from_every_side_and_infinite_ones_are_not(tmp_path, view, upside_down):
    """Both were the same grey on the back of a sheet and on the underside of a tray."""
    square, tray = shapes.grid(4, 4), shapes.icosphere(3)
    turned = TriangleMesh.from_arrays(square.points, square.faces[:, ::-1])
    for mesh in (turned if upside_down else square, tray.moved(tray.points * [1, 1, 0.01])):
        zero = np.zeros(mesh.n_faces)
        assert grey_of_picture(tmp_path / "zero.png", mesh, zero, view) > 0.8
        assert grey_of_picture(tmp_path / "none.png", mesh, zero + np.nan, view) < 0.5


def test_the_edges_of_a_dense_mesh_leave_the_surface_visible(tmp_path):
    """88,000 faces of `delaunay --plot` were black: the edges were as wide as those of a coarse mesh."""
    from matplotlib.image import imread

    look = {"curve_width": 0.35, "curve_halo": 0.0, "curve_aspect": 0.1}
    brightness_of_mesh = []
    for n in (4, 60):
        mesh, path = shapes.grid(n, n), str(tmp_path / "a.png")
        edges = list(mesh.points[mesh.topology.edges])
        surface.draw_surface(path, mesh, curves=edges, width=1.2, height=0.9, **look)
        brightness_of_mesh.append(float(imread(path)[60:120, 90:150, :3].mean()))
    assert brightness_of_mesh[0] > 0.7 and brightness_of_mesh[1] > 0.35


@pytest.mark.parametrize("kind, whole", [(int, True), (float, False)])
def test_the_ticks_of_integers_are_whole_numbers(monkeypatch, tmp_path, kind, whole):
    """Numbers of regions had ticks at 0.25 and 0.5."""
    mesh, ticks = shapes.grid(4, 4), []

    def drawn(figure, *arguments, **options):
        colour_bar(figure, *arguments, **options)
        ticks.extend(figure.axes[-1].yaxis.get_majorticklocs())

    monkeypatch.setattr(surface, "colour_bar", drawn)
    surface.draw_surface(str(tmp_path / "a.png"), mesh, (np.arange(mesh.n_faces) % 2).astype(kind), dpi=20)
    assert {0.0, 1.0} <= {float(tick) for tick in ticks} and all(tick % 1 == 0 for tick in ticks) == whole


@pytest.mark.parametrize(
    "low, high, ends, offset",
    [
        (0, 1, (0, 1), ""), (0, 3e-7, (0, 3), "×10⁻⁷"), (-2e6, 2e6, (-2, 2), "×10⁶"),
        (0.9999, 1.0001, (0.9999, 1.0001), ""), (-1e-300, 1e-300, (-1, 1), "×10⁻³⁰⁰"),
        (-1.5e308, 1.5e308, (-1.5, 1.5), "×10³⁰⁸"), (0, 5e-324, (0, 0.5), "×10⁻³²³"),
    ],
)  # fmt: skip
def test_a_colour_bar_has_the_ends_of_its_values_and_their_power_as_plain_text(low, high, ends, offset):
    """Matplotlib's axes hold no interval below 1e-287: the bar of 1e-300 went to 0.1."""
    from matplotlib.figure import Figure

    figure = Figure()
    colour_bar(figure, colour_scale(low, high, True), "")
    axis = figure.axes[0].yaxis
    assert axis.get_view_interval() == pytest.approx(ends, rel=1e-12)
    texts = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
    assert axis.get_major_formatter().get_offset() == offset and not any("$" in text for text in texts)
