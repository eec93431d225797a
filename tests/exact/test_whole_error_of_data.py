"""Errors of scenes with arrays, with walls without slip, and with rows that differ by rounding alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ddgcli.errors import ParameterError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh import shapes
from ddgcli.tradeoff.candidates import ErrorNorms, MeshLimit, Problem, Reference, Row, Table
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import assign_verdicts, break_even
from ddgcli.tradeoff.problems import simulate, willmore_flow
from ddgcli.tradeoff.refinement import prolonged
from ddgcli.tradeoff.richardson import mesh_limit
from ddgcli.tradeoff.smooth_surface import smooth_midpoint_values
from ddgcli.tradeoff.whole_error import mesh_bound_methods, whole_error

WAVE = """
[time]
duration = 0.4
step = 0.1
integrator = "conservative"
[[object]]
role = "fluid"
mesh = "ball"
[effects]
initial = { vorticity = INITIAL }
"""
PLATE = """
[time]
duration = 0.04
step = 0.005
[[object]]
role = "shell"
grid = { size = [1, 1], cells = [3, 3] }
density = 1
thickness = 1e-3
young = 1e9
poisson = 0.3
[effects]
stretching = {}
bending = {}
"""
CHANNEL = """
[time]
duration = 0.2
step = 0.1
integrator = "conservative"
[[object]]
role = "fluid"
grid = { size = [1, 1], cells = [4, 4], pattern = "PATTERN" }
[effects]
viscosity = { nu = 0.1 }
boundary = { where = "true", kind = "KIND" }
initial = { vorticity = "sin(3*x)" }
"""


def wave(points):
    """A spherical harmonic of degree three."""
    return 6 * points.prod(axis=1)


def test_smooth_data_stay_smooth_on_finer_meshes():
    mesh = shapes.random_sphere(300)
    values, edges = wave(mesh.points), mesh.topology.edges
    middle = mesh.points[edges].mean(axis=1)
    truth = wave(middle / np.linalg.norm(middle, axis=1)[:, None])
    linear, smooth = (
        np.abs(v - truth) for v in (values[edges].mean(axis=1), smooth_midpoint_values(mesh, values))
    )
    assert smooth.mean() < 0.1 * linear.mean() and smooth.max() < 0.3 * linear.max()
    vectors = smooth_midpoint_values(mesh, np.stack([values, -values], axis=1))
    assert np.array_equal(vectors[:, 0], -vectors[:, 1])
    plane = shapes.grid(5, 4)
    quadratic = plane.points[:, 0] ** 2 - plane.points[:, 0] * plane.points[:, 1]
    x, y, _ = plane.points[plane.topology.edges].mean(axis=1).T
    assert np.allclose(smooth_midpoint_values(plane, quadratic), x * x - x * y, atol=1e-12)


def test_data_that_jump_leave_their_range_by_a_tenth_at_most_and_whole_numbers_are_means():
    mesh = shapes.grid(8, 8)
    jump = (mesh.points[:, 0] > 0.5).astype(float)
    assert np.abs(smooth_midpoint_values(mesh, jump) - 0.5).max() <= 0.6
    finer = shapes.midpoint_subdivided(mesh)
    number = np.arange(mesh.n_vertices)
    assert np.array_equal(
        prolonged(number, [mesh, finer])[mesh.n_vertices :], number[mesh.topology.edges].mean(axis=1)
    )


def test_a_vorticity_at_vertices_has_the_mesh_error_of_its_formula():
    mesh = shapes.random_sphere(300)
    vorticity = wave(mesh.points)
    errors = []
    for initial in ('"6*x*y*z"', '"wave.npy"'):
        problem = simulate.fluid_problem(
            parse_scene(WAVE.replace("INITIAL", initial)),
            lambda name: SimpleNamespace(mesh=mesh, vertex={}, face={}, notes=(), sha256=""),
            lambda name: vorticity,
            options={"integrator": "conservative", "tolerance": 1e-3},
        )
        table = run_problem(replace(problem, candidates=problem.candidates[:1]), repeat=0)
        errors.append((table.rows[0].max_error, table.rows[0].mean_error))
    assert np.allclose(*errors, rtol=0.1)


@pytest.mark.parametrize(
    "pattern, kind, converges",
    [("alternating", "no-slip", False), ("right", "no-slip", True), ("alternating", "free-slip", True)],
)
def test_wall_vorticity_that_does_not_converge_makes_the_limit_uncertain(pattern, kind, converges):
    scene = CHANNEL.replace("PATTERN", pattern).replace("KIND", kind)
    problem = simulate.fluid_problem(parse_scene(scene), None, None, options={"tolerance": 1e-3})
    (_, limit), *_ = problem.mesh_limits
    assert limit.func.__self__.simulator.converges == converges


def test_a_sequence_without_a_limit_is_off_by_five_times_its_largest_change():
    answers = np.array([1.0, 0.0]), np.array([1.5, 0.1]), np.array([1.6, 0.3])
    limit, other = mesh_limit(*answers, converges=False)
    assert np.array_equal(limit, answers[-1]) and np.allclose(other - limit, [2.5, 1.0])
    assert np.allclose(mesh_limit(*answers[:2], converges=False)[1] - answers[1], [2.5, 0.5])


def test_explicit_schemes_that_take_the_same_stable_steps_are_not_bound_to_the_mesh():
    scene = parse_scene(PLATE + "gravity = {}\n")
    problem = simulate.shell_problem(scene, None, options={"tolerance": 1e-3}, error_part="time")
    candidates = [c for c in problem.candidates if c.method in ("symplectic-euler", "newmark")]
    table = run_problem(replace(problem, candidates=candidates), repeat=0)
    explicit = [row for row in table.rows if row.method == "symplectic-euler"]
    assert len(explicit) == 4 and len({row.step_taken for row in explicit}) == 1
    assert np.ptp([row.max_error for row in explicit]) < 1e-6 < explicit[0].max_error
    assert mesh_bound_methods(table, "max") == []
    # newmark is exact in free fall: its rows differ by rounding
    exact = [row for row in table.rows if row.method == "newmark" and not row.is_reference]
    assert len(exact) > 1
    assert all(a.has_same_error(b) and not a.is_surely_better(b) for a in exact for b in exact)
    assert {row.step_taken for row in exact} == {row.parameters["dt"] for row in exact}


def test_a_scene_at_rest_has_no_errors_to_compare():
    problem = simulate.shell_problem(parse_scene(PLATE), None, options={"tolerance": 1e-3})
    with pytest.raises(ParameterError, match="displacement is zero throughout.*a motion or a force"):
        run_problem(problem, repeat=0)


def test_the_row_that_is_the_reference_in_time_has_its_uncertainty_as_time_error():
    reference = Reference("r", np.ones(3), 0.04, mean_uncertainty=0.02)
    limit = MeshLimit("m", np.full(3, 1.01), ErrorNorms(0.007, 0.005))
    problem = Problem([], [], lambda a, b: np.abs(a - b), "one", error_part="both")
    whole = whole_error(problem, np.ones(3), np.zeros(3), reference, limit)
    assert whole.time_error == ErrorNorms(0.04, 0.02) and whole.uncertainty == limit.uncertainty
    assert whole.error.max == pytest.approx(0.01) and not whole.is_reference


def test_errors_are_as_uncertain_as_the_limit_that_they_are_measured_against():
    torus = shapes.torus(10, 6)
    table = run_problem(willmore_flow.problem(torus, options={"steps": 4, "tolerance": 1e-3}), repeat=0)
    assert table.mesh_limit is not None
    assert table.uncertainty() == table.mesh_limit.uncertainty.max == table.rows[0].uncertainty.max


@pytest.mark.parametrize("energy, is_remarked", [("hinge", True), ("cotan", False)])
def test_energies_that_depend_on_the_edges_are_remarked_on(energy, is_remarked):
    problem = willmore_flow.problem(shapes.torus(10, 6), options={"energy": energy})
    assert ("energy hinge depends on how the edges lie" in problem.remark) == is_remarked


def test_rows_of_another_law_are_shown_and_not_ranked():
    def row(name, seconds, error, setup=0.0, **more):
        return Row(name, {}, setup, seconds, (seconds, seconds), 3, 1.0, error, 0, error, {}, **more)

    own, other = row("own", 9.0, 0.2), row("other", 1.0, 0.1, setup=3.0, is_other_law=True)
    table = Table([own, other], Reference("r", np.ones(1), 1e-15))
    assert assign_verdicts(table, 0.15) is None and break_even(table.rows) == []
    assert assign_verdicts(table, None) is None
    assert own.on_front and own.verdict == "no other beats it"
    assert not other.on_front and other.verdict == "another law: not ranked"


def test_kinds_of_viscosity_are_other_laws_and_models_of_bending_are_not():
    scene = CHANNEL.replace("PATTERN", "right").replace("KIND", "free-slip")
    fluid = simulate.fluid_problem(parse_scene(scene), None, None)
    shell = simulate.shell_problem(parse_scene(PLATE), None)
    names = {c.model for problem in (fluid, shell) for c in problem.candidates if c.is_other_law}
    assert names == {"viscosity=bochner", "viscosity=deformation"}
