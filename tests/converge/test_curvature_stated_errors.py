"""Errors stated about curvature in balls contain what its changes with the radius do not show."""

import re

import numpy as np
import pytest

from benchmarks.common import further_surfaces, known_surfaces, level_sets, mesh_noise
from benchmarks.common.known_surfaces import error_as_stated as mean_error
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, area_normals
from ddgcli.algorithms.curvature.hidden_bias import hidden_bias
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.quadric import quadric
from ddgcli.algorithms.curvature.sampled_fits import fits_in_balls
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.geometry.faces import Faces
from ddgcli.mesh import shapes
from tests.curvature_noise import proposal


def fits_of(mean):
    """Flat fits but for their mean curvature: circles of no overshoot."""
    low, high = np.full(len(mean), -1e-9), 2 * mean + 1e-9
    return PrincipalCurvatures(low, high, *np.zeros((2, 3, len(mean))), np.zeros(len(mean)))


@pytest.mark.parametrize("turning, size", [(0.6, 0.30), (1.0, 0.25)])
def test_the_overshoot_of_quadratics_on_a_cylinder_is_known(turning, size):
    """Clean cylinder of radius 1 in balls of `turning` radians: the truth is 1/2."""
    mesh = shapes.cylinder(90, 60, 1.0, 6.0)
    inner = np.abs(mesh.points[:, 2] - mesh.points[:, 2].mean()) < 1.5
    noisy = mesh.moved(
        mesh.points + 0.05 * mesh.side_length.mean() * np.random.default_rng(0).normal(size=mesh.points.shape)
    )
    mean = measure_curvature(noisy, radius=turning, full=False).vertex["mean_curvature"][inner]
    bias = mean.mean() - 0.5
    fits = fits_of(mean)
    stated = hidden_bias(mean, fits, fits, turning, independent=False)
    # both to the fourth order in the turning; the next one adds up to `size` of the bias
    assert stated == pytest.approx(bias, rel=size)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_default_region_shows_the_bias_of_balls_that_hold_whole_features(noise):
    rng = np.random.default_rng(1)
    truth = 1 + rng.normal(size=400)
    default = truth + noise * rng.normal(size=400)
    at, after = fits_of(1.2 + 0.6 * (truth - 1)), fits_of(1.2 + 0.58 * (truth - 1))
    bias = np.abs(at.mean - truth).mean()
    # of the noise three terms explain at most 3 * 0.3^2 / 400 of a squared bias of 0.2
    assert hidden_bias(default, at, after, 1e-9) == pytest.approx(bias, rel=0.1)


def test_noise_of_the_default_region_is_no_bias_of_the_balls():
    rng = np.random.default_rng(2)
    truth = 1 + rng.normal(size=(200, 100))
    noisy = truth + rng.normal(size=truth.shape)
    after = 0.9 * truth + 0.1 * rng.normal(size=truth.shape)
    biases = np.array([hidden_bias(d, fits_of(a), fits_of(b), 1e-9) for d, a, b in zip(noisy, truth, after)])
    # three terms explain a chi squared of 3 over 100: more than twice its mean in 11 %, more than 16 in 0.1 %
    assert np.mean(biases > 1e-6) < 0.2 and biases.max() < 0.4


def rounded_box():
    body = known_surfaces.BODIES["rounded box"]
    values, place = level_sets.samples(body)
    mesh = mesh_noise.smoothed(3, known_surfaces.grey(values))
    mesh = mesh.moved(level_sets.projected(body, place(mesh.points)))
    return known_surfaces.known(body, mesh_noise.normal_noise(0.03, mesh))


SLIVERS = dict(further_surfaces.noise_cases())["slivers, noise 0.1: oblate"]


@pytest.mark.parametrize("make", [rounded_box, SLIVERS], ids=["rounded box", "slivers"])
def test_errors_at_the_automatic_radius_are_at_most_twice_the_stated_one(make):
    """They were 2.2 and 2.6 times that."""
    if make is rounded_box:
        pytest.importorskip("vtkmodules.vtkFiltersCore")
    known = make()
    result = measure_curvature(known.mesh, radius="auto", full=False)
    error = mean_error(known, result.vertex["mean_curvature"])
    assert error / 2 < result.results["expected_error"] < 2 * error


@pytest.mark.parametrize("name, worst", [("cubes: hills", 0.4), ("slivers, noise 0.1: oblate", 0.17)])
def test_the_scheme_of_the_proposal_is_the_one_that_errs_less(name, worst, caplog):
    """The others err by 58 and 19 %."""
    cases = dict(further_surfaces.voxel_cases()) | dict(further_surfaces.noise_cases())
    known = cases[name]()
    measure_curvature(known.mesh, full=False)
    _, scheme, radius = proposal(caplog.text)
    stated = int(re.search(r"where it is about (\d+) %", caplog.text)[1]) / 100
    error = mean_error(
        known, measure_curvature(known.mesh, scheme, radius, full=False).vertex["mean_curvature"]
    )
    assert error < worst and stated / 2 < error < 2 * stated


def thin_torus(tube):
    """Marching cubes of the voxels in a tube around a circle of radius 26."""
    tilt = np.array([0.2, 0.4, 0.9]) / np.linalg.norm([0.2, 0.4, 0.9])

    def level(x, y, z):
        along = tilt[0] * x + tilt[1] * y + tilt[2] * z
        across = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0.0))
        return np.hypot(across - 26, along) - tube

    return known_surfaces.voxels(level_sets.Body(level, (32, 32, 32)), known_surfaces.binary)


@pytest.mark.parametrize("tube", [4.0, 5.0])
def test_balls_wider_than_a_tube_are_not_proposed(tube, caplog):
    """Fits in balls of 6 and 9 voxels were, with stated errors of 18 and 20 %: they err by 52 and 56 %."""
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    known = thin_torus(tube)
    measure_curvature(known.mesh, full=False)
    _, scheme, radius = proposal(caplog.text)
    stated = int(re.search(r"where it is about (\d+) %", caplog.text)[1]) / 100
    error = mean_error(
        known, measure_curvature(known.mesh, scheme, radius, full=False).vertex["mean_curvature"]
    )
    assert error < 2 * stated < 0.2


@pytest.mark.parametrize("rings", [3.0, 6.0, 9.0])
def test_fits_around_a_few_vertices_are_those_of_the_whole_surface(rings):
    """Those of the sample had other normals: at nine edges their bias was 36 %, that of the surface 54 %."""
    body = level_sets.Body(lambda x, y, z: np.hypot(np.hypot(x, y) - 26, z) - 5, (31, 31, 5))
    mesh = known_surfaces.voxels(body, known_surfaces.cubes).mesh
    faces = Faces.of(mesh)
    normal, radius = area_normals(faces), rings * float(mesh.side_length.mean())
    few = np.arange(0, mesh.n_vertices, 97)
    sampled = fits_in_balls(faces, PointGrid(faces.points), normal, few, radius).mean
    whole = quadric(mesh, faces, normal, radius, noisy=True).mean[few]
    # balls of the sample are not restricted to what is connected
    assert np.median(np.abs(sampled - whole)) < 1e-3 / 5 and np.abs(sampled - whole).mean() < 0.02 / 5
