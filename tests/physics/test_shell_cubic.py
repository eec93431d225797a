"""Cubic shells: exact on isometric moves of a hinge, at rest as drawn, a Hessian linear in the positions."""

import numpy as np
import pytest

from ddgcli.geometry.hinges import hinge_cotans, hinge_frame, hinges
from ddgcli.mesh.shapes import icosphere
from ddgcli.models.shell.bending import QuadraticBending, hinge_measure
from ddgcli.models.shell.cubic import CubicBending

HINGE = np.array([[0.0, 0, 0], [0.2, 1, 0], [-0.7, 0.3, 0], [0.9, 0.6, 0]])


def folded(angle):
    """The hinge with its second face turned about the edge."""
    x, u = HINGE.copy(), HINGE[1] / np.linalg.norm(HINGE[1])
    along = u * (x[3] @ u)
    across = x[3] - along
    x[3] = along + np.cos(angle) * across + np.sin(angle) * np.cross(u, across)
    return x


@pytest.mark.parametrize("rest", [-2.5, -0.4, 0.0, 0.3, 1.4])
def test_energy_of_a_folding_hinge_is_the_sine_of_half_the_change(rest):
    stencil = np.array([[1, 0, 3, 2]])
    bending = CubicBending(folded(rest), stencil, np.array([0.7]))
    for angle in np.linspace(-3, 3, 13):
        x = folded(angle)
        change = hinge_frame(x, stencil).angle - hinge_frame(folded(rest), stencil).angle
        assert bending.energy(x) == pytest.approx(0.7 * 4 * np.sin(0.5 * change[0]) ** 2, abs=1e-13)


def sphere():
    mesh = icosphere(2)
    stencil = hinges(mesh.topology)
    side = np.asarray(mesh.side_vector)
    area = 0.5 * np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1)
    return mesh, stencil, hinge_measure(mesh, stencil, area)


def test_curved_shell_is_at_rest_as_drawn_also_against_stretch():
    mesh, stencil, (weight, _) = sphere()
    bending, x = CubicBending(mesh.points, stencil, weight), np.asarray(mesh.points)
    assert abs(bending.energy(x)) <= 1e-12
    assert np.abs(bending.gradient(x)).max() <= 1e-12 * weight.max()
    assert np.abs(bending.gradient(1.1 * x)).max() > 1e-4 * weight.max()


def test_small_displacements_keep_their_digits():
    """Energy and forces are of second and first order: sums of whole positions cancelled to 1e-8 of them."""
    mesh, stencil, (weight, _) = sphere()
    bending, x = CubicBending(mesh.points, stencil, weight), np.asarray(mesh.points)
    d = 1e-3 * np.random.default_rng(2).normal(size=x.shape)
    energies = [bending.energy(x + size * d) / size**2 for size in (1e-5, 1e-6)]
    forces = [bending.gradient(x + size * d) / size for size in (1e-5, 1e-6)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-6)
    assert np.abs(forces[1] - forces[0]).max() <= 1e-6 * np.abs(forces[0]).max()


def test_hessian_is_linear_in_the_positions():
    mesh, stencil, (weight, _) = sphere()
    bending, x = CubicBending(mesh.points, stencil, weight), np.asarray(mesh.points)
    y = x + 0.3 * np.random.default_rng(0).normal(size=x.shape)
    ends = bending.blocks(x, "exact").copy() + bending.blocks(y, "exact")
    middle = bending.blocks(0.5 * (x + y), "exact")
    assert np.abs(2 * middle - ends).max() <= 1e-13 * np.abs(ends).max()
    assert np.abs(bending.blocks(y, "exact") - bending.blocks(x, "exact")).max() > 1e-3


def test_about_flat_it_is_the_quadratic_energy():
    mesh, stencil, (weight, plain) = sphere()
    cubic = CubicBending(mesh.points, stencil, weight, flat=True)
    quadratic = QuadraticBending(stencil, 2 * plain, hinge_cotans(mesh), mesh.n_vertices)
    x = mesh.points + 0.1 * np.random.default_rng(1).normal(size=mesh.points.shape)
    assert cubic.energy(x) == pytest.approx(quadratic.energy(x), rel=1e-12)
