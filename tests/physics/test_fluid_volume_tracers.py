"""Dye in volumes, at corners and along walls: what rests keeps its value, ties of cells do not matter."""

import numpy as np
import pytest

from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.model import FluidModel
from ddgcli.models.fluid.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

SCENE = """[time]
duration = 0.2
step = 0.1
integrator = "{integrator}"
[[object]]
name = "a"
role = "fluid"
box = {{ size = [1, 1, 1], cells = [4, 4, 4] }}
[effects]
initial = {{ velocity = "u" }}
dye = {{ amount = "c" }}
{more}
"""
NO_SLIP = """viscosity = { nu = 0.02 }
boundary = { kind = "no-slip" }"""


def uneven_box(n=3):
    mesh = shapes.box_tetrahedra(n, n, n)
    inside = ((mesh.points > 1e-9) & (mesh.points < 1 - 1e-9)).all(axis=1)
    shift = np.random.default_rng(0).uniform(-0.05, 0.05, mesh.points.shape)
    return mesh.moved_unchecked(mesh.points + inside[:, None] * shift)


def swirl(points):
    x, y, z = np.pi * points.T
    return np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), 0.2 * np.sin(z)], axis=1)


def dye_after(mesh, velocity, amount, more="", integrator="circulation", n_steps=2):
    context = FluidContext("a", mesh, {"u": velocity, "c": amount}, {}, np.zeros(3), lambda path: None)
    scene = resolve(parse_scene(SCENE.format(more=more, integrator=integrator)), KIND, {})
    model = FluidModel(scene, 0, context, Account())
    state = model.start
    for step in range(n_steps):
        state = model.advance(state, 0.1 * step, 0.1)
    return state["dye"], model


@pytest.mark.parametrize("integrator", ["energy", "circulation"])
def test_dye_stays_at_walls_without_slip(integrator):
    mesh = uneven_box()
    amount = np.array(mesh.points[:, 0])
    after, model = dye_after(mesh, swirl(mesh.points), amount, NO_SLIP, integrator)
    on_wall = np.unique(mesh.boundary.faces)
    assert np.abs(after - amount).max() > 0.01
    assert np.abs(after - amount)[on_wall].max() < 1e-13
    mass = model.space.mass
    assert mass @ after == pytest.approx(mass @ amount, rel=1e-13)


@pytest.mark.parametrize("more", ["", NO_SLIP], ids=["free slip", "no slip"])
def test_dye_turns_with_the_volume_at_its_corners_too(more):
    mesh = uneven_box()
    amount, velocity = np.array(mesh.points[:, 0]), np.cross([1, 2, 3], mesh.points - 0.5)
    expected, _ = dye_after(mesh, velocity, amount, more)
    for seed in range(3):
        turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        there = TetMesh.from_arrays(mesh.points @ turn.T, mesh.tetrahedra)
        after, _ = dye_after(there, velocity @ turn.T, amount, more)
        assert np.abs(after - expected).max() < 1e-10
