"""Bending energies: values on known surfaces, exact gradients, invariances."""

import numpy as np
import pytest

from benchmarks.common.mesh_classes import SPHERES, ellipsoids
from benchmarks.common.submesh import submesh
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh import shapes
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.gauss_map_energy import GaussMapEnergy

# int H^2 of half axes 1, 1, 2: with w = 4 - 3 t^2, t the cosine of the parameter along the meridian, it is
# 4 pi int_0^1 w^(-1/2) (1 + 1/w)^2 dt, and the three powers of w integrate to pi / sqrt(27), 1/4 and 1/8
ELLIPSOID_112 = 4 * np.pi * (np.pi / np.sqrt(27) + 2 / 4 + 1 / 8)
TORUS_2 = 4 * np.pi**2 / np.sqrt(3)
VERTEX = ("sullivan", "cotan")
SMOOTH = ("gauss-map", *VERTEX)


def rough(seed=0):
    """A closed surface without symmetry."""
    mesh = shapes.icosphere(2)
    noise = 0.04 * np.random.default_rng(seed).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points * [1.0, 1.3, 1.9] + noise)


def rough_grid():
    mesh = shapes.grid(7, 6)
    return mesh.moved(mesh.points + 0.03 * np.random.default_rng(3).normal(size=mesh.points.shape))


@pytest.mark.parametrize("name", ENERGIES)
@pytest.mark.parametrize("mesh", [rough(), rough_grid()], ids=["closed", "open"])
def test_gradient_matches_differences(name, mesh):
    energy = ENERGIES[name].of(mesh)
    value, gradient = energy.value_and_gradient(mesh.points)
    assert value == pytest.approx(energy.value(mesh.points), rel=1e-14)
    rng, h = np.random.default_rng(1), 1e-5
    for _ in range(3):
        d = rng.normal(size=mesh.points.shape)
        steps = [energy.value(mesh.points + k * h * d) for k in (-2, -1, 1, 2)]
        slope = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)
        assert np.sum(gradient * d) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("name", VERTEX)
@pytest.mark.parametrize(
    "stretch, truth", [((1, 1, 1), 4 * np.pi), ((1, 1, 2), ELLIPSOID_112)], ids=["sphere", "ellipsoid"]
)
def test_energies_converge_at_second_order(name, stretch, truth):
    error = []
    for level in (3, 4, 5):
        mesh = shapes.icosphere(level)
        error.append(abs(ENERGIES[name].of(mesh).value(mesh.points * stretch) / truth - 1))
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert error[-1] < 1e-3 and (np.abs(rates - 2) < 0.1).all()


@pytest.mark.parametrize("name", VERTEX)
def test_a_catenoid_has_no_energy(name):
    """r = c cosh(z / c) is minimal; squares of a curvature of second order fall at fourth order."""
    value = []
    for n in (12, 24, 48):
        tube = shapes.cylinder(2 * n, n, 1.0, 1.2)
        x, y, z = tube.points.T
        swell = 0.8 * np.cosh((z - z.mean()) / 0.8) / np.hypot(x, y)
        value.append(ENERGIES[name].of(tube).value(np.stack([swell * x, swell * y, z], axis=1)))
    rates = np.log2(np.array(value[:-1]) / value[1:])
    assert 0 < value[-1] < 2e-6 and (np.abs(rates - 4) < 0.1).all()


@pytest.mark.parametrize("name", ["cotan", "gauss-map"])
def test_a_cap_of_a_sphere_has_its_area_as_energy(name):
    """Over the square of side 1, without the cells at the rim: of first order, from below."""
    t, weight = np.polynomial.legendre.leggauss(40)
    u, v = np.meshgrid(t / 2, t / 2)
    truth = (np.outer(weight, weight) / 4 / np.sqrt(1 - u**2 - v**2)).sum()
    error = []
    for n in (8, 16, 32):
        grid = shapes.grid(n, n, pattern="alternating")
        x, y = (grid.points[:, :2] - 0.5).T
        cap = np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=1)
        error.append(1 - ENERGIES[name].of(grid).value(cap) / truth)
    assert 0 < error[-1] < 0.07 and error[0] / error[1] > 1.85 and error[1] / error[2] > 1.85


@pytest.mark.parametrize("aspect", [np.sqrt(2), 3.0, 5.0])
def test_tori_have_the_energy_of_their_aspect(aspect):
    """pi^2 c^2 / sqrt(c^2 - 1), at second order by each energy that stands for int H^2."""
    truth = np.pi**2 * aspect**2 / np.sqrt(aspect**2 - 1)
    coarse, fine = (shapes.torus(2 * n, n, aspect, 1.0) for n in (24, 48))
    for name, most in (("gauss-map", 3e-4), ("sullivan", 4e-3), ("cotan", 3e-3)):
        one, other = (abs(ENERGIES[name].of(mesh).value(mesh.points) / truth - 1) for mesh in (coarse, fine))
        assert other < most and np.log2(one / other) == pytest.approx(2.0, abs=0.15), name


def test_sullivan_and_cotan_bracket_the_torus():
    mesh = shapes.torus(96, 48, 2, 1)
    above, below = (ENERGIES[name].of(mesh).value(mesh.points) for name in VERTEX)
    assert below < TORUS_2 < above and above - below < 0.006 * TORUS_2


def test_hinge_counts_int_h_squared_on_equilateral_triangles():
    mesh = shapes.icosphere(4)
    assert ENERGIES["hinge"].of(mesh).value(mesh.points) == pytest.approx(4 * np.pi, rel=0.01)


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
    expected = ENERGIES[name].of(mesh).value(mesh.points)
    assert ENERGIES[name].of(renamed).value(renamed.points) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", SMOOTH)
def test_flat_mesh_has_no_energy(name):
    mesh = shapes.grid(8, 5, 2.0, 1.0)
    value = ENERGIES[name].of(mesh).value(mesh.points)
    # int K of an open surface is a difference of multiples of pi
    assert abs(value) < (1e-12 if name == "gauss-map" else 1e-25)


GAUSS_MAP = GaussMapEnergy


@pytest.mark.parametrize("pattern", ["right", "alternating"])
def test_gauss_map_is_of_second_order_on_the_torus(pattern):
    error = []
    for n in (24, 48, 96):
        mesh = shapes.torus(2 * n, n, 2.0, 1.0, pattern=pattern)
        error.append(abs(GAUSS_MAP(mesh.topology).value(mesh.points) / TORUS_2 - 1))
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert error[-1] < 2e-4 and (np.abs(rates - 2) < 0.1).all()


@pytest.mark.parametrize("family", SPHERES)
def test_every_inscribed_mesh_has_4_pi_and_no_gradient(family):
    mesh = SPHERES[family](0)
    value, gradient = GAUSS_MAP(mesh.topology).value_and_gradient(mesh.points)
    assert value == pytest.approx(4 * np.pi, rel=1e-12)
    # of the size that a move of the vertices by the same share of the radius would bring
    bumpy = mesh.points * (1 + 1e-2 * np.cos(3 * mesh.points[:, :1]))
    _, moved = GAUSS_MAP(mesh.topology).value_and_gradient(bumpy)
    assert np.abs(gradient).max() < 1e-9 * np.abs(moved).max()


def folded_sphere():
    """Inscribed; the edge most enclosed at one end is turned over, so that one face faces inward."""
    mesh = shapes.random_sphere(200)
    angle, twin = corner_angle(mesh.side_length), mesh.topology.side_twin.reshape(-1, 3)
    enclosed = angle + angle[twin // 3, (twin % 3 + 1) % 3]
    face, k = np.unravel_index(enclosed.argmax(), enclosed.shape)
    other, j = divmod(twin[face, k], 3)
    faces = np.array(mesh.faces)
    (a, b, c), d = np.roll(faces[face], -k), faces[other, (j + 2) % 3]
    faces[face], faces[other] = (a, d, c), (b, c, d)
    return type(mesh).from_arrays(mesh.points, faces)


def test_a_sphere_with_a_folded_face_is_not_at_rest():
    """Its vertex normals are those of the sphere, and so are all terms but that of the leaning faces."""
    mesh = folded_sphere()
    assert folded_faces(mesh) == 1 and (np.sum(sphere_normals(mesh) * mesh.points, axis=1) > 0.999).all()
    value, gradient = GAUSS_MAP(mesh.topology).value_and_gradient(mesh.points)
    assert value > 1.1 * 4 * np.pi and np.abs(gradient).max() > 1


def test_gradient_matches_differences_where_faces_are_folded():
    """Near the sphere the other terms are small, and cannot hide an error of that of the folds."""
    mesh = folded_sphere()
    points = mesh.points + 0.01 * np.random.default_rng(4).normal(size=mesh.points.shape)
    energy = GAUSS_MAP(mesh.topology)
    gradient = energy.value_and_gradient(points)[1]
    for seed in range(5):
        d, h = np.random.default_rng(seed).normal(size=points.shape), 1e-6
        slope = (energy.value(points + h * d) - energy.value(points - h * d)) / (2 * h)
        assert np.sum(gradient * d) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_irregular_caps_of_spheres_are_at_rest():
    """Held at its rim, slope and all, an irregular cap is at rest."""
    ball = shapes.random_sphere(400)
    faces = ball.faces[(ball.points[ball.faces][..., 2] > 0).all(axis=1)]
    cap = submesh(ball, faces)
    value, gradient = GAUSS_MAP(cap.topology).value_and_gradient(cap.points)
    is_fixed = np.array(cap.topology.boundary_vertex)
    assert np.abs(gradient[is_fixed]).max() > 1e-3
    is_fixed[cap.faces[is_fixed[cap.faces].any(axis=1)]] = True
    assert np.abs(gradient[~is_fixed]).max() < 1e-11
    assert value == pytest.approx(area(cap), rel=0.12)


def test_gauss_map_is_least_on_spheres():
    """Genus 0: never below 4 pi, however rough the mesh."""
    mesh = shapes.icosphere(2)
    for seed, size in enumerate((1e-3, 1e-2, 0.1, 1.0)):
        noise = size * np.random.default_rng(seed).normal(size=mesh.points.shape)
        assert GAUSS_MAP(mesh.topology).value(mesh.points + noise) > 4 * np.pi


@pytest.mark.parametrize("family, within", [("irregular", 0.02), ("stretched", 0.07), ("refined", 0.006)])
def test_gauss_map_on_uneven_triangles(family, within):
    mesh = ellipsoids((1.0, 1.0, 2.0))[family](2)
    error = {n: abs(ENERGIES[n].of(mesh).value(mesh.points) / ELLIPSOID_112 - 1) for n in SMOOTH}
    assert error["gauss-map"] < within
    assert error["gauss-map"] < 0.85 * min(error["cotan"], error["sullivan"])


def test_stripes_that_no_normal_sees_are_as_stiff_as_in_cotan():
    grid = shapes.grid(24, 24)
    x, y = grid.points[:, :2].T
    equilateral = np.stack([x - 0.5 * y, np.sqrt(0.75) * y, 0 * x], axis=1)
    corners = equilateral[grid.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.ptp(sides) < 1e-12
    topology = grid.topology
    flat = GAUSS_MAP(topology).value(equilateral)
    row = np.rint(24 * y).astype(int)
    striped = np.where((row > 3) & (row < 21) & (topology.boundary_vertex == 0), 1e-4 * (-1.0) ** row, 0.0)
    lifted = equilateral + striped[:, None] * [0, 0, 1]
    stiffness = (GAUSS_MAP(topology).value(lifted) - flat) / ENERGIES["cotan"].of(grid).value(lifted)
    # the ends of the patch of stripes are seen by normals there
    assert stiffness == pytest.approx(1, abs=0.02)


def test_constraint_gradients_equal_finite_differences():
    mesh = rough()
    constraints = Constraints(np.array([area(mesh)]), np.array([enclosed_volume(mesh)]))
    rows = constraints.gradients(mesh, np.arange(mesh.n_vertices))
    d, h = np.random.default_rng(2).normal(size=mesh.points.shape), 1e-5
    ahead, behind = (constraints.residuals(mesh.moved(mesh.points + s * h * d)) for s in (1, -1))
    for row, name in zip(rows, ("area", "volume")):
        assert np.sum(row * d) == pytest.approx((ahead[name][0] - behind[name][0]) / (2 * h), rel=1e-7)
