"""Newton flow: Hessians, quadratic convergence at rest; the gradient flow of the circle-angle energy."""

import json

import numpy as np
import pytest

from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore import setup, trust_region
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import energy_gradient, preconditioner_at, size_across
from ddgcli.models.willmore.endings import ROUNDING, small_gradient
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.flow_options import with_stop
from ddgcli.models.willmore.gauss_map_energy import GaussMapEnergy
from ddgcli.models.willmore.helfrich_energy import with_curvature
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import DEFAULT_STOP, NEWTON_STOP
from ddgcli.models.willmore.trust_region import Lagrangian
from tests.physics.willmore_runs import assert_falls, bowl, ellipsoid, energies, run_flow, two_components

NEWTON = FlowOptions(flow="newton", stop=NEWTON_STOP)


def rough_ball():
    ball = shapes.icosphere(1)
    return ball.moved(ball.points * [1.0, 1.2, 1.5] + 0.05 * np.random.default_rng(0).normal(size=(42, 3)))


@pytest.mark.parametrize("name", ENERGIES)
def test_hessian_products_are_symmetric_and_match_second_differences(name):
    mesh = rough_ball()
    energy, free = ENERGIES[name].of(mesh), np.arange(mesh.n_vertices)
    rng = np.random.default_rng(1)
    u, v = rng.normal(size=(2, mesh.n_vertices, 3))
    hu, hv = (trust_region.hessian_product(energy, mesh, free, w) for w in (u, v))
    assert np.sum(v * hu) == pytest.approx(np.sum(u * hv), rel=1e-6, abs=1e-6 * np.abs(u * hu).sum())
    h = 1e-3 / np.abs(u).max()
    values = [energy.value(mesh.points + k * h * u) for k in (-2, -1, 0, 1, 2)]
    second = (-values[0] + 16 * values[1] - 30 * values[2] + 16 * values[3] - values[4]) / (12 * h**2)
    assert np.sum(u * hu) == pytest.approx(second, rel=1e-3)


@pytest.mark.parametrize("mesh", [bowl(), ellipsoid(2)], ids=["clamped", "closed"])
def test_the_gradient_falls_quadratically_at_rest(mesh):
    flow, model = setup.build(mesh, NEWTON)
    state, sizes = model.start, []
    for _ in range(20):
        state = model.advance(state, 0.0, 1.0)
        sizes.append(size_across(flow._gradient(state)))
        if state.ending or flow.ending(state):
            break
    sizes = np.array(sizes)
    assert sizes.min() < 1e-5 and len(sizes) < 16
    last = np.flatnonzero((sizes[:-1] < 1.0) & (sizes[:-1] > 1e-4) & (sizes[1:] < sizes[:-1]))
    assert (sizes[last + 1] < 0.1 * sizes[last]).all() and len(last)


def test_newton_finds_the_minimum_of_descent_on_a_clamped_plate():
    snapshots, end, _ = run_flow(bowl(), NEWTON)
    slow, _, _ = run_flow(bowl(), FlowOptions(stop=DEFAULT_STOP))
    assert energies(snapshots)[-1] == pytest.approx(energies(slow)[-1], rel=0.2)
    assert_falls(snapshots)


def test_newton_makes_an_ellipsoid_round():
    snapshots, end, _ = run_flow(ellipsoid(2), NEWTON)
    assert energies(snapshots)[-1] == pytest.approx(4 * np.pi, rel=1e-9) and len(snapshots) < 16
    assert_falls(snapshots)


@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-4])
def test_newton_makes_components_of_any_size_round(size):
    """As alone: neither the differences nor the trust region of one depend on the size of another."""
    ball = shapes.icosphere(2)
    first, second = ball.moved(ball.points * [1.0, 1.0, 1.5]), ball.moved(ball.points * [1.0, 1.3, 0.7])
    steps = [len(run_flow(mesh, NEWTON)[0]) for mesh in (first, second)]
    both = two_components(first, second.moved(second.points * size))
    observations, _, _ = run_flow(both, NEWTON)
    assert energies(observations)[-1] == pytest.approx(8 * np.pi, rel=1e-9)
    assert len(observations) <= max(steps) + 6


def test_circle_angle_flow_makes_an_ellipsoid_round():
    """Convex Delaunay meshes inscribed in a sphere have no circle-angle energy."""
    options = FlowOptions(flow="circle-angle", stop=DEFAULT_STOP)
    snapshots, end, _ = run_flow(ellipsoid(2), options, steps=60)
    assert energies(snapshots)[-1] < 0.02 * energies(snapshots)[0]
    assert_falls(snapshots)


@pytest.mark.parametrize(
    "words, message",
    [
        (("--flow", "newton", "--dt", "1e-3"), "--flow quadratic"),
        (("--flow", "circle-angle", "--energy", "cotan"), "--flow quadratic"),
    ],
)
def test_other_choices_with_these_flows_are_refused(run, tmp_path, words, message):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(1)))
    result = run("willmore-flow", path, *words, "--json")
    assert result.exit_code == 2 and message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("curvature", [0.0, 0.5])
def test_a_lagrangians_hessian_products_match_second_differences(curvature):
    mesh = rough_ball()
    constraints = Constraints(np.array([area(mesh)]), np.array([enclosed_volume(mesh)]))
    energy = with_curvature(GaussMapEnergy, curvature)(mesh.topology)
    lagrangian = Lagrangian(
        mesh.topology, energy, constraints, np.array([[3.0], [-2.0]]), np.arange(mesh.n_vertices)
    )
    u = np.random.default_rng(1).normal(size=(mesh.n_vertices, 3))
    hu = trust_region.hessian_product(lagrangian, mesh, np.arange(mesh.n_vertices), u)
    h = 1e-3 / np.abs(u).max()
    values = [lagrangian.value(mesh.points + k * h * u) for k in (-2, -1, 0, 1, 2)]
    second = (-values[0] + 16 * values[1] - 30 * values[2] + 16 * values[3] - values[4]) / (12 * h**2)
    assert np.sum(u * hu) == pytest.approx(second, rel=1e-3)


def test_preconditioned_motions_keep_the_constraints_to_first_order():
    mesh = ellipsoid(2)
    constraints = Constraints(np.array([area(mesh)]), np.array([enclosed_volume(mesh)]))
    free = np.arange(mesh.n_vertices)
    at = energy_gradient(mesh, GaussMapEnergy(mesh.topology), free, constraints, along_normals=True)
    normal = sphere_normals(mesh)
    solve = trust_region.tangent_solve(preconditioner_at(at, 0.05), constraints, normal)
    a, b = (solve(c) for c in np.random.default_rng(0).normal(size=(2, mesh.n_vertices, 3)))
    for row in constraints.gradients(mesh, free):
        assert abs(np.sum(row * a)) < 1e-12 * np.linalg.norm(row) * np.linalg.norm(a)
    assert np.abs(np.cross(a, normal)).max() < 1e-12 * np.abs(a).max()
    assert np.sum(at.gradient * solve(at.gradient)) > 0 and np.linalg.norm(a - b) > 0


@pytest.mark.parametrize(
    "options",
    [
        FlowOptions(flow="newton", fix_area=True, fix_volume=True),
        FlowOptions(flow="newton", fix_area=True, fix_volume=True, spontaneous_curvature=0.5),
        FlowOptions(flow="newton", fix_volume=True, energy="sullivan"),
    ],
    ids=["vesicle", "spontaneous curvature", "volume"],
)
def test_membranes_come_to_rest_with_a_gradient_of_rounding_by_few_newton_steps(options):
    mesh = ellipsoid(2).moved(ellipsoid(2).points * [1.0, 1.0, 1.3])
    options = with_stop(options, mesh.topology, False)
    flow, model = setup.build(mesh, options)
    state, sizes = model.start, []
    while state.ending is None:
        sizes.append(size_across(flow._gradient(state)))
        state = model.advance(state, 0.0, 1.0)
        assert max(map(abs, flow.constraints.residuals(flow.mesh(state)).values())) < 1e-11
        if ending := model.stop(state):
            break
    assert (state.ending or ending) in (ROUNDING, small_gradient(1e-9))
    assert state.steps <= 25 and state.increases == 0
    assert size_across(flow._gradient(state)) < 1e-6 * max(sizes)
    # the last factor falls quadratically
    small = [s for s in sizes if s < 1e-2 * max(sizes)]
    assert any(after < 0.05 * before for before, after in zip(small, small[1:]))


def test_both_flows_as_commands(run, tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(1)))
    for flow, convention in (("newton", "int K"), ("circle-angle", "circumcircles")):
        result = run("willmore-flow", path, "--flow", flow, "--steps", 3, "--json")
        out = json.loads(result.stdout)
        assert result.exit_code == 0 and convention in out["results"]["energy_convention"]
        assert out["accuracy"]["energy_increases"] == 0
