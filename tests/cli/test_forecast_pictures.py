"""Predictions of pictures: their pixels, and those that show a surface."""

import pytest

from ddgcli.cli.forecast.kernels import FURTHER_PICTURE, kernels_of
from ddgcli.cli.forecast.mesh_facts import PICTURE_PIXELS, picture_share
from ddgcli.cli.forecast.use import InputSize, Use
from ddgcli.mesh import shapes
from ddgcli.plots.raster import fitted_camera, rasterise, view_axes
from ddgcli.plots.viewpoint import up_axis_of


def test_pictures_are_counted_by_their_pixels_and_those_that_show_a_surface():
    size = InputSize("surface", 1000, frame_count=3, picture_share=0.3)
    _, pixels, covered = kernels_of("info", {}, size, plot=True, pixels=600 * 400)[1:]
    assert pixels == Use("picture pixels", elements=240_000)
    assert covered == Use("picture covered pixels", added=1.0, elements=72_000)
    curve = kernels_of("info", {}, InputSize("curve", 1000), plot=True)
    assert curve[1:] == [Use("picture")]  # lines: their picture was predicted at 2.6 times its memory
    films = kernels_of("frames", {"pictures": True}, size)
    assert [use.times for use in films] == [1.0 + 2 * FURTHER_PICTURE, 3, 3]
    assert not kernels_of("frames", {"pictures": False}, size)


def test_the_share_of_a_picture_that_shows_a_surface_is_that_of_the_picture():
    """Spot, of which a picture shows little, was predicted at 1.56 times its memory."""
    sphere, torus = shapes.icosphere(3), shapes.torus(40, 20)
    for mesh in (sphere, sphere.moved(sphere.points * [1, 0.02, 0.02]), torus, shapes.grid(9, 9)):
        axes = view_axes(mesh.points, None, up_axis_of(mesh))
        camera = fitted_camera(mesh.points, axes, *PICTURE_PIXELS)
        n_pixels = len(rasterise(camera, mesh.points, mesh.faces).pixel)
        share = n_pixels / (camera.width * camera.height)
        assert picture_share(mesh) == pytest.approx(share, rel=0.25, abs=0.01)
