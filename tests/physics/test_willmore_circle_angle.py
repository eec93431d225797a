"""The circle-angle energy: Moebius invariance, its gradient, the curvature command's number, its flow."""

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.mesh import shapes
from ddgcli.models.willmore.circle_angle_energy import CircleAngleEnergy
from ddgcli.models.willmore.setup import FlowOptions
from tests.physics.willmore_runs import assert_falls, energies, run_flow


def shaken(mesh, size=0.02):
    return mesh.points + size * np.random.default_rng(0).normal(size=mesh.points.shape)


@pytest.mark.parametrize("mesh", [shapes.torus(24, 12), shapes.grid(6, 5)], ids=["closed", "with boundary"])
def test_inversions_and_scales_leave_the_energy(mesh):
    energy, points = CircleAngleEnergy(mesh.topology), shaken(mesh)
    value = energy.value(points)
    about = points - [3.1, 0.2, 0.5]
    assert energy.value(about / (about**2).sum(axis=1)[:, None]) == pytest.approx(value, abs=1e-10)
    assert energy.value(1e6 * points + 1.0) == pytest.approx(value, abs=1e-7) and value > 1


@pytest.mark.parametrize("mesh", [shapes.torus(24, 12), shapes.grid(6, 5)], ids=["closed", "with boundary"])
def test_the_gradient_is_that_of_finite_differences(mesh):
    energy, points = CircleAngleEnergy(mesh.topology), shaken(mesh)
    value, gradient = energy.value_and_gradient(points)
    direction = np.random.default_rng(1).normal(size=points.shape)
    h = 1e-6
    slope = (energy.value(points + h * direction) - energy.value(points - h * direction)) / (2 * h)
    assert slope == pytest.approx(float((gradient * direction).sum()), rel=1e-5)
    assert value == energy.value(points)


def test_the_flow_and_the_curvature_command_mean_the_same_number():
    mesh = shapes.torus(48, 24, 2.0, 1.0)
    value = CircleAngleEnergy(mesh.topology).value(mesh.points)
    assert ddg.curvature(mesh).results["willmore_energies"]["circle-angle"] == pytest.approx(value, rel=1e-12)
    assert value == pytest.approx(4 * np.pi**2 / np.sqrt(3), rel=5e-3)  # edges along curvature lines


@pytest.mark.parametrize("level", range(4))
def test_meshes_inscribed_in_spheres_have_none_and_rounding_is_not_negative(level):
    ball = shapes.icosphere(level)
    energy = CircleAngleEnergy(ball.topology)
    for shift in np.linspace(0, 1, 20):  # each rounds differently
        points = ball.points + shift
        of_surface = ddg.curvature(ball.moved(points)).results["willmore_energies"]["circle-angle"]
        for value in (energy.value(points), energy.value_and_gradient(points)[0], of_surface):
            assert 0 <= value < 1e-9


def test_its_gradient_flow_lowers_it_and_all_energies_are_reported():
    mesh = shapes.torus(24, 12, 2.0, 1.0)
    observations, _, _ = run_flow(mesh, FlowOptions(energy="circle-angle", report_energy="all"), steps=8)
    assert energies(observations)[-1] < 0.95 * energies(observations)[0]
    assert observations[0].scalar["energy_circle-angle"] == pytest.approx(
        energies(observations)[0], rel=1e-12
    )
    assert_falls(observations)
