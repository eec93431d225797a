"""Advection of circulation: conserved sums, energy and enstrophy, convergence."""

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.models.fluid.circulation import CirculationAdvection
from ddgcli.models.fluid.conservative import StageRates, runge_kutta
from ddgcli.models.fluid.diffusion import VorticityDiffusion
from tests.physics.test_fluid import NONE, SURFACES, flat_torus, some_flow, space_of


@pytest.mark.parametrize("name", SURFACES)
def test_circulation_keeps_the_total_and_is_the_identity_for_no_time(name):
    space = space_of(SURFACES[name])
    omega, c = some_flow(space)
    carry = CirculationAdvection(space)
    same, c_same, *_ = carry.step(omega, c, 0.0, True)
    assert np.abs(same - omega)[space.inside].max() < 1e-10 * np.abs(omega).max()
    assert np.allclose(c_same, c, rtol=0, atol=1e-11)
    after, _, *_ = carry.step(omega, c, 0.1, True)
    assert abs(after.sum() - omega.sum()) < 1e-12 * np.abs(omega).sum()


def needles():
    """A sphere of random points squeezed to a tenth: triangles of every bad kind."""
    mesh = shapes.random_sphere(800)
    return mesh.moved(mesh.points * [1.0, 1.0, 0.1])


@pytest.mark.parametrize("name", [*SURFACES, "needles"])
def test_circulation_raises_neither_energy_nor_enstrophy(name):
    space = space_of(needles() if name == "needles" else SURFACES[name])
    omega, c = some_flow(space)
    carry = CirculationAdvection(space)
    energy, enstrophy = [], []
    for _ in range(20):
        energy.append(space.kinetic_energy(space.stream_function(omega), c))
        enstrophy.append(space.enstrophy(omega))
        omega, c, *_ = carry.step(omega, c, 0.02, True)
    assert (np.diff(energy) <= 1e-12 * energy[0]).all()
    assert (np.diff(enstrophy) <= 1e-12 * enstrophy[0]).all()


def test_circulation_loses_less_on_finer_spheres():
    """What is lost does not grow with the number of steps, as it does where every step interpolates."""
    loss = {}
    for level, dt in ((3, 0.05), (3, 0.0125), (4, 0.025)):
        space = space_of(shapes.icosphere(level))
        omega, c = some_flow(space)
        start = space.kinetic_energy(space.stream_function(omega), c)
        carry = CirculationAdvection(space)
        for _ in range(round(1 / dt)):
            omega, c, *_ = carry.step(omega, c, dt, True)
        loss[level, dt] = 1 - space.kinetic_energy(space.stream_function(omega), c) / start
    assert max(loss[3, 0.0125], loss[3, 0.05]) < 5e-4 and loss[4, 0.025] < 0.3 * loss[3, 0.05]


def tensor_grid(n, seed=0):
    """A square of n x n cells between lines at random places: neighbours differ in width up to 19 times."""
    mesh, random = shapes.grid(n, n), np.random.default_rng(seed)
    lines = [np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 1.9, n))]) for _ in range(2)]
    column, row, _ = np.rint((mesh.points - mesh.points.min(axis=0)) * n / np.ptp(mesh.points[:, 0])).T
    x, y = (line[k.astype(int)] / line[-1] for line, k in zip(lines, (column, row)))
    return mesh.moved(np.stack([x, y, 0 * x], axis=1))


@pytest.mark.parametrize("surface", [tensor_grid(12), SURFACES["irregular sphere"]], ids=["tensor", "sphere"])
def test_energy_that_circulation_loses_does_not_grow_with_the_number_of_steps(surface):
    """The filter that holds the enstrophy took 2 % of the energy in 10 steps, and more in more."""
    space = space_of(surface, harmonic=False)
    x, y, _ = space.mesh.points.T
    start = (np.sin(np.pi * x) * np.sin(np.pi * y) + 0.4 * np.sin(2 * np.pi * x) * np.sin(3 * np.pi * y)) * 3
    start = start * space.mass
    start -= space.mass * (start.sum() / space.mass.sum()) * space.mesh.topology.is_closed
    carry = CirculationAdvection(space)

    def loss(steps):
        omega = start
        for _ in range(steps):
            omega, *_ = carry.step(omega, NONE, 1.0 / steps, False)
        return 1 - space.kinetic_energy(space.stream_function(omega), NONE) / whole

    whole = space.kinetic_energy(space.stream_function(start), NONE)
    few, many = loss(10), loss(40)
    assert -1e-12 < few < 0.01 and -1e-12 < many < 0.01


def periodic_tensor_grid(n, seed=0):
    """As `tensor_grid`, on the flat torus."""
    flat, random = flat_torus(n), np.random.default_rng(seed)
    place = np.rint(np.asarray(flat.points)[:, :2] * n / (2 * np.pi)).astype(int)
    widths = random.uniform(0.1, 1.9, (2, n))
    lines = (
        np.concatenate([np.zeros((2, 1)), np.cumsum(widths, axis=1)], axis=1) / widths.sum(axis=1)[:, None]
    )
    uv = np.stack([lines[0][place[:, 0]], lines[1][place[:, 1]]], axis=1)
    head, tail = flat.faces[:, [1, 2, 0]], flat.faces
    step = uv[head] - uv[tail] - np.rint((place[head] - place[tail]) / n)
    points = np.column_stack([2 * np.pi * uv, np.zeros(len(uv))])
    return IntrinsicMesh(flat.topology, 2 * np.pi * np.linalg.norm(step, axis=2), points)


def test_circulation_on_a_periodic_tensor_grid_keeps_energy_and_tells_its_corrections():
    """It once lost 67 % of the energy here."""
    mesh = periodic_tensor_grid(16)
    space = space_of(mesh, harmonic=False)
    x, y = np.asarray(mesh.points)[:, :2].T
    omega = (2 * np.sin(x) * np.sin(y) + 0.8 * np.sin(2 * x + 1) * np.cos(3 * y)) * space.mass
    omega -= space.mass * omega.sum() / space.mass.sum()
    carry, acted = CirculationAdvection(space), []
    whole = space.kinetic_energy(space.stream_function(omega), NONE)
    enstrophy = space.enstrophy(omega)
    for _ in range(20):
        omega, _, _, _, which = carry.step(omega, NONE, 0.2, False)
        acted.append(which)
    assert abs(1 - space.kinetic_energy(space.stream_function(omega), NONE) / whole) < 0.01
    assert abs(1 - space.enstrophy(omega) / enstrophy) < 0.01
    assert 0 < np.sum(acted, axis=0)[1] <= 20 and np.sum(acted, axis=0)[2] <= 2


@pytest.mark.parametrize("pattern", ["right", "alternating"])
def test_taylor_green_by_circulation_converges_at_second_order(pattern):
    """Second order where step and mesh go down together; settled where the mesh does alone."""

    def error(n, dt, nu=0.05, time=1.0):
        space = space_of(flat_torus(n, pattern=pattern), harmonic=False)
        x, y = space.mesh.points[:, :2].T
        omega = start = 2 * np.sin(x) * np.sin(y) * space.mass
        carry, decay = CirculationAdvection(space), VorticityDiffusion(space, nu)
        for _ in range(round(time / dt)):
            omega, _ = decay.step(omega, NONE, dt / 2)
            omega, *_ = carry.step(omega, NONE, dt, False)
            omega, _ = decay.step(omega, NONE, dt / 2)
        exact = np.exp(-2 * nu * time) * start
        return np.sqrt(space.enstrophy(omega - exact) / space.enstrophy(exact))

    together = [error(n, 1.2 / n) for n in (12, 24, 48)]
    assert (np.log2(np.array(together[:-1]) / together[1:]) > 1.7).all() and together[-1] < 2e-3
    alone = [error(n, 0.05) for n in (12, 48)]
    assert alone[1] < 0.2 * alone[0] < 5e-3


def test_circulation_follows_the_conservative_flow():
    space = space_of(shapes.icosphere(4))
    omega, c = some_flow(space)
    carry = CirculationAdvection(space)
    other = omega
    for _ in range(32):
        omega, c, *_ = carry.step(omega, c, 0.0125, True)
    for _ in range(40):
        other, *_ = runge_kutta(StageRates(space, False), other, NONE, 0.01)
    moved = np.sqrt(space.enstrophy(other - some_flow(space)[0]) / space.enstrophy(other))
    apart = np.sqrt(space.enstrophy(omega - other) / space.enstrophy(other))
    assert moved > 0.2 and apart < 0.01


@pytest.mark.parametrize("integrator", ["conservative", "circulation"])
def test_circulation_round_a_hole_that_the_mesh_does_not_resolve_warns(integrator, caplog):
    """It is constant (Kelvin); what loops lose of it between two boundaries was in `accuracy` alone."""
    square = {"name": "f", "role": "fluid", "grid": {"size": [1, 1], "cells": [24, 24]}}
    ball = {"name": "b", "role": "obstacle", "sphere": {"center": [0.5, 0.5, 0], "radius": 0.15}}
    effects = {"initial": {"vorticity": "20*exp(-150*((x-0.78)^2+(y-0.5)^2))"}, "harmonic": {}}
    time = {"duration": 1.0, "step": 0.05, "integrator": integrator}
    end = ddg.simulate({"time": time, "object": [square, ball], "effects": effects}).finish()
    drift = end.accuracy["circulation_drift"]
    assert (drift > 0.05) == ("the circulation along a boundary loop" in caplog.text)
    assert drift > 0.05 if integrator == "circulation" else drift < 1e-12
