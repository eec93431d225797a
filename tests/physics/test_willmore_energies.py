"""Bending energies: values on known surfaces, exact gradients, invariances."""

import numpy as np
import pytest

from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.mesh import shapes
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.energies import ENERGIES

ELLIPSOID_112 = 15.4516066443
TORUS_2 = 4 * np.pi**2 / np.sqrt(3)
SMOOTH = ("sullivan", "cotan")


def rough(seed=0):
    """A closed surface without symmetry."""
    mesh = shapes.icosphere(2)
    noise = 0.04 * np.random.default_rng(seed).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points * [1.0, 1.3, 1.9] + noise)


def rough_sheet():
    mesh = shapes.grid(7, 6)
    return mesh.moved(mesh.points + 0.03 * np.random.default_rng(3).normal(size=mesh.points.shape))


@pytest.mark.parametrize("name", ENERGIES)
@pytest.mark.parametrize("mesh", [rough(), rough_sheet()], ids=["closed", "sheet"])
def test_gradient_matches_differences(name, mesh):
    energy = ENERGIES[name].build(mesh.topology)
    value, gradient = energy.value_and_gradient(mesh.points)
    assert value == pytest.approx(energy.value(mesh.points), rel=1e-14)
    rng, h = np.random.default_rng(1), 1e-5
    for _ in range(3):
        d = rng.normal(size=mesh.points.shape)
        steps = [energy.value(mesh.points + k * h * d) for k in (-2, -1, 1, 2)]
        slope = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)
        assert np.sum(gradient * d) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize(
    "stretch, truth", [((1, 1, 1), 4 * np.pi), ((1, 1, 2), ELLIPSOID_112)], ids=["sphere", "ellipsoid"]
)
def test_second_order(name, stretch, truth):
    error = []
    for level in (3, 4, 5):
        mesh = shapes.icosphere(level)
        error.append(abs(ENERGIES[name].build(mesh.topology).value(mesh.points * stretch) / truth - 1))
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert error[-1] < 1e-3 and (np.abs(rates - 2) < 0.1).all()


def test_sullivan_and_cotan_bracket_the_torus():
    mesh = shapes.torus(96, 48, 2, 1)
    above, below = (ENERGIES[name].build(mesh.topology).value(mesh.points) for name in SMOOTH)
    assert below < TORUS_2 < above and above - below < 0.006 * TORUS_2


def test_hinge_counts_int_h_squared_on_equilateral_triangles():
    mesh = shapes.icosphere(4)
    assert ENERGIES["hinge"].build(mesh.topology).value(mesh.points) == pytest.approx(4 * np.pi, rel=0.01)


@pytest.mark.parametrize("name", ENERGIES)
@pytest.mark.parametrize("scale", [1e-8, 1e8])
def test_invariant_under_similarity_and_relabelling(name, scale):
    mesh = rough()
    rng = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    order = rng.permutation(mesh.n_vertices)
    moved = (scale * (mesh.points @ rotation.T))[np.argsort(order)]
    faces = order[mesh.faces][rng.permutation(mesh.n_faces)]
    renamed = type(mesh).from_arrays(moved, faces)
    expected = ENERGIES[name].build(mesh.topology).value(mesh.points)
    assert ENERGIES[name].build(renamed.topology).value(renamed.points) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", SMOOTH)
def test_flat_sheet_has_no_energy(name):
    mesh = shapes.grid(8, 5, 2.0, 1.0)
    assert ENERGIES[name].build(mesh.topology).value(mesh.points) < 1e-25


def test_constraint_gradients():
    mesh = rough()
    kept = Constraints(area(mesh), enclosed_volume(mesh))
    rows = kept._gradients(mesh, np.arange(mesh.n_vertices))
    d, h = np.random.default_rng(2).normal(size=mesh.points.shape), 1e-5
    ahead, behind = (kept.residuals(mesh.moved(mesh.points + s * h * d)) for s in (1, -1))
    for row, name in zip(rows, ("area", "volume")):
        assert np.sum(row * d) == pytest.approx((ahead[name] - behind[name]) / (2 * h), rel=1e-7)
