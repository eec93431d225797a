"""Newton flow: Hessians, quadratic convergence at rest; the gradient flow of the circle-angle energy."""

import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore import setup, trust_region
from ddgcli.models.willmore.descent import size_across
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import DEFAULT_STOP, NEWTON_STOP
from tests.physics.willmore_runs import assert_falls, bowl, ellipsoid, energies, run_flow

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
    hu, hv = (trust_region.hessian_product(energy, mesh.points, free, w) for w in (u, v))
    assert np.sum(v * hu) == pytest.approx(np.sum(u * hv), rel=1e-6, abs=1e-6 * np.abs(u * hu).sum())
    h = 1e-3 / np.abs(u).max()
    values = [energy.value(mesh.points + k * h * u) for k in (-2, -1, 0, 1, 2)]
    second = (-values[0] + 16 * values[1] - 30 * values[2] + 16 * values[3] - values[4]) / (12 * h**2)
    assert np.sum(u * hu) == pytest.approx(second, rel=1e-3)


@pytest.mark.parametrize("radius", [1e-3, 1e3])
def test_motions_minimise_the_model_in_the_trust_region(radius):
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(9, 9))
    hessian, gradient = matrix @ matrix.T + np.eye(9), rng.normal(size=(3, 3))
    newton = trust_region.newton_motion(
        gradient, lambda v: (hessian @ v.ravel()).reshape(3, 3), lambda r: r, radius
    )
    exact = -np.linalg.solve(hessian, gradient.ravel()).reshape(3, 3)
    d = newton.motion
    model = np.sum(gradient * d) + 0.5 * d.ravel() @ hessian @ d.ravel()
    assert newton.promised == pytest.approx(-model, rel=1e-9)
    if radius < 1:
        assert newton.at_boundary and np.linalg.norm(d) == pytest.approx(radius)
        assert np.allclose(d / radius, -gradient / np.linalg.norm(gradient), atol=0.02)
    else:
        assert not newton.at_boundary and np.linalg.norm(d - exact) < 0.3 * np.linalg.norm(exact)


@pytest.mark.parametrize("mesh", [bowl(), ellipsoid(2)], ids=["clamped", "closed"])
def test_the_gradient_falls_quadratically_at_rest(mesh):
    flow, model = setup.build(mesh, NEWTON)
    state, sizes = model.start, []
    for _ in range(20):
        state = model.advance(state, 0.0, 1.0)
        sizes.append(size_across(flow._gradient(state)))
        if state.stopped or flow.reason(state):
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


def test_circle_angle_flow_makes_an_ellipsoid_round():
    """Convex Delaunay meshes inscribed in a sphere have no circle-angle energy."""
    options = FlowOptions(flow="circle-angle", stop=DEFAULT_STOP)
    snapshots, end, _ = run_flow(ellipsoid(2), options, steps=60)
    assert energies(snapshots)[-1] < 0.02 * energies(snapshots)[0]
    assert_falls(snapshots)


@pytest.mark.parametrize(
    "words, message",
    [
        (("--flow", "newton", "--fix-area"), "--flow quadratic"),
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


def test_both_flows_as_commands(run, tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(1)))
    for flow, convention in (("newton", "int K"), ("circle-angle", "circumcircles")):
        result = run("willmore-flow", path, "--flow", flow, "--steps", 3, "--json")
        out = json.loads(result.stdout)
        assert result.exit_code == 0 and convention in out["results"]["energy_convention"]
        assert out["accuracy"]["energy_increases"] == 0
