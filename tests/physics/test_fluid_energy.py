"""The integrator `energy`: exact kinetic energy, enstrophy and reversibility."""

import numpy as np
import pytest

from benchmarks.fluids.energy import CASES, long_run
from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.mesh import shapes
from ddgcli.models.fluid.conservative import StageRates, midpoint, runge_kutta
from ddgcli.models.fluid.surface_space import SurfaceSpace
from tests.physics.test_fluid_open import channel

SURFACES = {
    "irregular sphere": shapes.random_sphere(200),
    "torus": shapes.torus(16, 8),
    "disk": shapes.grid(8, 8),
}


def start(name):
    mesh = SURFACES[name]
    space = SurfaceSpace(mesh, harmonic_basis(mesh, "normal").forms)
    x, y, z = mesh.points.T
    vorticity = (np.sin(3 * x + 1) * np.cos(2 * z + 1) + y + x * z) * space.mass
    if mesh.topology.is_closed:
        vorticity -= space.mass * vorticity.sum() / space.mass.sum()
    return space, vorticity, np.full(len(space.harmonic), 0.3)


def energy(space, vorticity, coefficients):
    return space.kinetic_energy(space.stream_function(vorticity), coefficients)


@pytest.mark.parametrize("name", SURFACES)
def test_energy_and_enstrophy_stay_to_1e_12_and_time_turns_back(name):
    space, vorticity, coefficients = start(name)
    first = energy(space, vorticity, coefficients), space.enstrophy(vorticity)
    state, drift = (vorticity, coefficients), 0.0
    for _ in range(100):
        *state, change = midpoint(StageRates(space, True), *state, 0.1)
        assert change < 1e-12
        reached = energy(space, *state), space.enstrophy(state[0])
        drift = max(drift, abs(reached[0] / first[0] - 1), abs(reached[1] / first[1] - 1))
    assert drift < 1e-12
    moved = np.abs(state[0] - vorticity).max()
    state = -state[0], -state[1]
    for _ in range(100):
        *state, _ = midpoint(StageRates(space, True), *state, 0.1)
    assert moved > 0.1 * np.abs(vorticity).max()
    # what rounding left grows with the flow, no faster than e^(t/4) here
    assert np.abs(state[0] + vorticity).max() < 1e-9 * np.abs(vorticity).max()


def test_the_explicit_integrator_drifts_where_energy_does_not():
    space, vorticity, coefficients = start("disk")
    first = energy(space, vorticity, coefficients)
    state = vorticity, coefficients
    for _ in range(20):
        *state, _, _ = runge_kutta(StageRates(space, True), *state, 0.4)
    assert abs(energy(space, *state) / first - 1) > 1e-10


def test_the_scene_takes_the_integrator_energy():
    free = 'initial = { vorticity = "sin(3*x)*sin(2*y)" }\n'
    _, explicit = channel(free, 8, 0.8, 0.1, friction="nu = 0")
    _, observed = channel(free, 8, 0.8, 0.1, time='integrator = "energy"', friction="nu = 0")
    series = np.array([o.scalar["kinetic_energy"] for o in observed])
    assert np.ptp(series) < 1e-13 * series[0]
    assert np.abs(observed[-1].vertex["vorticity"] - explicit[-1].vertex["vorticity"]).max() > 1e-8


@pytest.mark.parametrize("name", CASES)
def test_energy_stays_and_time_turns_back_on_every_kind_of_mesh(name):
    _, _, drift, moved, _, return_error, _ = long_run(name, 60, 30)
    assert drift < 1e-13 and return_error < 1e-13 and moved > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_energy_stays_to_1e_12_over_ten_thousand_steps(name):
    _, _, drift, _, _, return_error, _ = long_run(name, 10_000, 1_000)
    assert drift < 1e-12 and return_error < 1e-11
