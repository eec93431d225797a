"""`tradeoff` states the error in time and that of the mesh, and gives no verdict that it cannot support."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ddgcli.errors import ParameterError, SolveError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.scene import KIND as FLUID
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND as SHELL
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.shapes import place
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import UNKNOWN, ErrorNorms, MeshLimit, Problem, Reference, Row, Table
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import assign_verdicts, break_even
from ddgcli.tradeoff.problems import simulate, willmore_flow
from ddgcli.tradeoff.problems.table import mesh_problem
from ddgcli.tradeoff.refinement import prolonged, refined_scene
from ddgcli.tradeoff.report import chart_of
from ddgcli.tradeoff.richardson import mesh_limit
from ddgcli.tradeoff.smooth_surface import smoothly_subdivided
from ddgcli.tradeoff.time_budget import TimeBudget
from ddgcli.tradeoff.truths import parse_truth
from ddgcli.tradeoff.whole_error import find_polyhedron_error, mesh_bound_methods, whole_error

STEADY = """
[time]
duration = 0.4
step = 0.05
integrator = "conservative"
[[object]]
role = "fluid"
sphere = { subdivisions = 2 }
[effects]
initial = { vorticity = "10*x*y*z" }
"""
PLATE = """
[time]
duration = 0.016
step = 4e-3
[[object]]
role = "shell"
grid = { size = [1, 1], cells = [3, 3] }
material = "rubber"
[effects]
stretching = {}
bending = {}
gravity = {}
pin = { vertices = [0, 1, 2, 3] }
"""
BEAM = """
[time]
integrator = "static"
[[object]]
role = "shell"
grid = { size = [0.5, 0.05], cells = [6, 1] }
density = 7.8
thickness = 1e-3
young = 2e11
poisson = 0.0
[effects]
stretching = {}
bending = { model = "quadratic" }
gravity = { acceleration = [0, 0, -0.1] }
pin = { vertices = [0, 1], clamp = true }
"""
BOX = """
[time]
duration = 0.1
step = 0.05
[[object]]
role = "fluid"
box = { corner = [0, 0, 0], size = [1, 1, 1], cells = [2, 2, 2] }
[effects]
initial = { velocity = ["y - 0.5", "0.5 - x", "0"] }
"""


def steady_rows(**options):
    scheme = {"integrator": "conservative", "tolerance": 1e-4, **options}
    problem = simulate.fluid_problem(parse_scene(STEADY), None, None, options=scheme)
    return run_problem(problem, repeat=0)


def test_within_names_no_row_of_a_steady_flow_whose_mesh_is_far_off():
    """A Rossby-Haurwitz wave of one degree does not change: its true error is known at every vertex."""
    table = steady_rows()
    assert assign_verdicts(table, 1e-6) is None and all("misses" in row.verdict for row in table.rows)
    scheme = {"integrator": "conservative"}
    problem = simulate.fluid_problem(parse_scene(STEADY), None, None, options=scheme)
    x, y, z = shapes.icosphere(2).points.T
    truth = 10 * x * y * z
    for row, candidate in zip(table.rows[:2], problem.candidates):
        answer = candidate.solve(candidate.setup())
        error = np.abs(answer - truth).max() / np.abs(truth).max()
        assert row.time_error.max < 1e-6 < 1e-4 < row.mesh_error.max
        assert abs(row.max_error - error) <= row.uncertainty.max < 0.6 * error
    # changes fall sixfold, which is an accident: the limit is farther off than the last of them
    of_limit = np.abs(table.mesh_limit.values - truth) / np.abs(truth).max()
    assert of_limit.max() <= table.mesh_limit.uncertainty.max
    assert assign_verdicts(table, 2e-3) is not None


def test_models_of_a_static_scene_have_the_mesh_error_of_its_equilibrium():
    """The limit of fine meshes of a clamped strip under its weight is the beam of Euler and Bernoulli."""
    problem = simulate.shell_problem(parse_scene(BEAM), None)
    table = run_problem(problem, repeat=0)
    assert {row.method for row in table.rows} >= {"static", "static midedge bending"}
    tip = 7.8 * 0.1 * 0.5**4 / 8 / (2e11 * 1e-9 / 12)
    largest = np.abs(table.mesh_limit.values).max()
    assert abs(largest / tip - 1) <= table.mesh_limit.uncertainty.max < 0.02
    for row, candidate in zip(table.rows, problem.candidates):
        own = np.abs(candidate.solve(candidate.setup())).max()
        assert abs(row.mesh_error.max - abs(tip / own - 1)) <= 2 * row.uncertainty.max
    with pytest.raises(ParameterError, match="equilibria"):
        simulate.shell_problem(parse_scene(BEAM), None, options={"step": 0.1})


def test_fluids_in_volumes_are_compared_by_the_integrators_that_they_have():
    problem = simulate.fluid_problem(parse_scene(BOX), None, None, error_part="time")
    assert {c.arguments["integrator"] for c in problem.candidates} == {"circulation", "covector", "energy"}
    candidates = [c for c in problem.candidates if c.method == "energy"]
    table = run_problem(replace(problem, candidates=candidates), repeat=0)
    assert table.reference.name.startswith("energy") and len(table.rows) == len(candidates)


def test_methods_that_interpolate_are_named_and_have_their_own_distance_from_the_limit():
    """A wave of degree 3 in a rotation turns at 5/6 of it; the sum of both errors counted the mesh twice."""
    scene = STEADY.replace("10*x*y*z", "z + 6*x*y*z").replace("0.4", "0.8")
    problem = simulate.fluid_problem(parse_scene(scene), None, None, options={"tolerance": 1e-3})
    candidates = [c for c in problem.candidates if c.method in ("circulation", "conservative", "energy")]
    table = run_problem(replace(problem, candidates=candidates), repeat=0)
    assert mesh_bound_methods(table, "max") == mesh_bound_methods(table, "mean") == ["circulation"]
    x, y, z = shapes.icosphere(2).points.T
    position = (x + 1j * y) * np.exp(-1j * 5 / 6 * 0.5 * 0.8)
    truth = z + 6 * position.real * position.imag * z
    for row, candidate in zip(table.rows, candidates):
        error = np.abs(candidate.solve(candidate.setup()) - truth) / np.abs(truth).max()
        assert abs(row.max_error - error.max()) <= row.uncertainty.max, row.label
        assert abs(row.mean_error - error.mean()) <= row.uncertainty.mean, row.label


def test_parts_of_an_error_that_cancel_do_not_count_twice():
    def lengths(values, truth):
        return np.abs(values - truth)

    problem = Problem([], [], lengths, "one", "query", error_part="both")
    limit = MeshLimit("limit", np.array([1.0, 2.0]), ErrorNorms(1e-3, 1e-3))
    reference = Reference("small steps", np.array([1.1, 2.1]), 1e-4)
    answer = np.array([1.01, 2.0])  # steps that are too long move it towards the limit
    whole = whole_error(problem, answer, lengths(answer, reference.values), reference, limit)
    assert whole.error.max == pytest.approx(0.01) and whole.error.mean == pytest.approx(0.005)
    assert whole.worst == 0 and whole.uncertainty == limit.uncertainty
    assert whole.time_error.max == pytest.approx(0.1) and whole.mesh_error.max == pytest.approx(0.1)


@pytest.mark.parametrize("error_part", ["both", "mesh"])
def test_the_time_error_of_the_reference_is_its_uncertainty_without_a_mesh_error_too(error_part):
    """It was 0, in a row that was not the reference."""

    def lengths(values, truth):
        return np.abs(values - truth)

    problem = Problem([], [], lengths, "one", "query", error_part=error_part)
    reference = Reference("small steps", np.array([1.1, 2.1]), 1e-4)
    whole = whole_error(problem, reference.values, np.zeros(2), reference, None)
    assert whole.is_reference and whole.worst is None and whole.time_error.max == whole.error.max == 1e-4
    assert np.isinf(whole.uncertainty.max)
    limit = MeshLimit("limit", np.array([1.0, 2.0]), ErrorNorms(1e-3, 1e-3))
    assert whole_error(problem, reference.values, np.zeros(2), reference, limit).time_error.max == 1e-4


def test_steps_that_the_mesh_error_hides_are_not_told_apart():
    table = steady_rows()
    assign_verdicts(table, None)
    assert "differ by at most" in table.undecided
    assert {row.verdict.split(";")[0] for row in table.rows} == {"no verdict possible"}
    assert not any(row.on_front for row in table.rows)
    chart = chart_of(table.rows, "max", None)
    assert chart["pareto_front"] is None and not any(chart["ringed"].values())


def test_the_mesh_error_of_a_shell_covers_a_finer_mesh_and_its_models_are_rows():
    document = parse_scene(PLATE)
    problem = simulate.shell_problem(document, None, options={"integrator": "newmark", "tolerance": 1e-2})
    models = {c.model for c in problem.candidates}
    assert models == {
        "", "bending=midedge", "bending=quadratic", "bending=cubic", "stretching=edges",
        "stretching=edges-area",
    }  # fmt: skip
    assert {c.arguments.get("model", "") for c in problem.candidates} == models
    table = run_problem(problem, repeat=0)
    assert "bending=midedge" in table.mesh_limit.name
    finest = refined_scene(document, SHELL, None, None, 3)
    moved = simulate._displacement(list(frames_of(finest, 8)), finest.input_vertices)
    error = problem.error(table.mesh_limit.values, moved)
    assert error.max() <= table.mesh_limit.uncertainty.max < 0.2
    assert all(0 < row.mesh_error.max <= row.max_error + row.time_error.max for row in table.rows)


def frames_of(finer, steps):
    overrides = {"steps": steps, "step": 0.016 / steps, "model": ("bending=midedge",)}
    scene = resolve(finer.document, SHELL, overrides)
    shells = {name: context for name, (context, _) in model.contexts(scene, finer.read).items()}
    models = model.build(scene, shells, Account())
    for snapshot in evolve(models, scene.schedule(), Account()):
        yield snapshot.observations


def test_vertices_of_a_finer_cylinder_lie_on_it():
    scene = PLATE.replace(
        "grid = { size = [1, 1], cells = [3, 3] }",
        "cylinder = { start = [0, 0, 1], end = [0, 2, 2], radius = 0.5, cells = [8, 2] }",
    )
    finer = refined_scene(parse_scene(scene), SHELL, None, None, 2)
    section = resolve(finer.document, SHELL, {}).objects[0]
    points = np.asarray(finer.read(section.mesh).mesh.points)
    axis = np.array([0, 2, 1]) / np.sqrt(5)
    assert len(points) == 32 * 9
    assert np.linalg.norm(np.cross(points - [0, 0, 1], axis), axis=1) == pytest.approx(0.5)
    assert np.isclose((points - [0, 0, 1]) @ axis, 0).sum() == 32


def test_pins_of_a_finer_plate_hold_the_vertices_between_them():
    finer = refined_scene(parse_scene(PLATE), SHELL, None, None, 2)
    mesh = finer.read(finer.document.data["object"][0]["mesh"]).mesh
    pinned = np.unique(finer.document.data["effects"]["pin"]["vertices"])
    coarse = shapes.grid(3, 3).points[:4]
    axis = int(np.ptp(coarse, axis=0).argmax())
    side = np.flatnonzero(np.abs(np.delete(mesh.points, axis, axis=1)).max(axis=1) < 1e-12)
    assert len(side) == 13 and np.array_equal(pinned, side)


@pytest.mark.parametrize("cells", ["cells = [4, 4]", 'cells = [4, 6], pattern = "cross"'])
def test_a_finer_periodic_grid_keeps_the_vertices_of_the_input(cells):
    text = STEADY.replace(
        "sphere = { subdivisions = 2 }", f'grid = {{ size = [1, 2], periodic = "xy", {cells} }}'
    )
    document = parse_scene(text)
    finer = refined_scene(document, FLUID, None, None, 1)
    (number,) = finer.input_vertices.values()
    coarse, fine = (place(resolve(d, FLUID).objects[0], None).mesh for d in (document, finer.document))
    assert fine.n_faces == 4 * coarse.n_faces and len(np.unique(number)) == coarse.n_vertices
    assert np.allclose(fine.points[number], coarse.points, atol=1e-12)


def test_midpoints_of_a_mesh_lie_on_the_sphere_to_fourth_order_and_those_of_a_cube_in_its_faces():
    off = []
    for level in (2, 3):
        finer = smoothly_subdivided(shapes.icosphere(level))
        off.append(np.abs(np.linalg.norm(finer.points, axis=1) - 1).max())
        flat = np.abs(np.linalg.norm(shapes.midpoint_subdivided(shapes.icosphere(level)).points, axis=1) - 1)
        assert off[-1] < 0.03 * flat.max()
    assert off[0] / off[1] > 12
    cube = shapes.box(2, 2, 2)
    assert np.array_equal(smoothly_subdivided(cube).points, shapes.midpoint_subdivided(cube).points)


def test_arrays_on_finer_meshes_are_those_of_linear_functions():
    meshes = [shapes.grid(3, 3)]
    for _ in range(2):
        meshes.append(shapes.midpoint_subdivided(meshes[-1]))
    assert prolonged(meshes[0].points[:, 0], meshes) == pytest.approx(meshes[2].points[:, 0])


def test_limits_of_planted_sequences_cover_their_own_error():
    first = np.array([1.0, -2.0])
    for rate in (2.0, 4.0, 16.0):
        answers = [first * rate**-k for k in range(3)]
        limit, other = mesh_limit(*answers)
        assert limit == pytest.approx(np.zeros(2), abs=1e-12) and (np.abs(other) > 0).all()
        limit, other = mesh_limit(*answers[:2])
        assert (np.abs(limit) <= np.abs(other - limit)).all()
    limit, other = mesh_limit(first, 2 * first, 4 * first)  # differences that do not fall
    assert np.abs(other - limit) == pytest.approx(10 * np.abs(first))


def row(method, seconds, error, uncertainty=0.0):
    norms = ErrorNorms(uncertainty, uncertainty)
    one = Row(method, {}, 0.0, seconds, (seconds, seconds), 3, 1.0, error, 0, error, {})
    one.uncertainty = norms
    return one


def test_a_reference_that_is_too_uncertain_ranks_no_rows():
    rows = [row("a", 1.0, 0.5, 12.0), row("b", 2.0, 0.1, 12.0), row("c", 3.0, 3.0, 12.0)]
    table = Table(rows, Reference("r", np.zeros(1), 12.0))
    assert assign_verdicts(table, None) is None and "uncertain by 1.2e+01" in table.undecided
    assert [r.verdict for r in rows] == ["no verdict possible; within the error of the reference"] * 3
    rows[2].max_error = 40.0  # surely worse than the others
    assign_verdicts(table, None)
    assert not table.undecided and rows[0].on_front and not rows[1].on_front
    assert rows[1].verdict.startswith("no verdict possible") and rows[2].verdict == "beaten by a"


def test_within_counts_the_uncertainty():
    rows = [row("a", 1.0, 0.09, 0.02), row("b", 2.0, 0.05, 0.02), row("c", 3.0, 0.2, 0.02)]
    table = Table(rows, Reference("r", np.zeros(1), 0.02))
    assert assign_verdicts(table, 0.1) is rows[1]
    assert rows[0].verdict == "no verdict possible: 0.1 is within its uncertainty"
    assert rows[2].verdict == "misses 0.1"
    assert assign_verdicts(table, 0.06) is None and "uncertain by 2.0e-02" in table.undecided
    assert assign_verdicts(table, 0.01) is None and not table.undecided


def test_an_unknown_mesh_error_leaves_no_verdict():
    cut = STEADY + '[[object]]\nrole = "obstacle"\nsphere = { center = [0, 0, 1], radius = 0.3 }\n'
    with pytest.raises(SolveError, match="obstacles are cut out"):
        refined_scene(parse_scene(cut), FLUID, None, None, 1)
    table = Table([row("a", 1.0, 1e-7), row("b", 2.0, 1e-8)], mesh_failure="no reason")
    for one in table.rows:
        one.uncertainty = UNKNOWN
    assert assign_verdicts(table, 0.1) is None
    assert table.undecided.startswith("the mesh error is not known (no reason)")
    assert {one.verdict for one in table.rows} == {"no verdict possible"}
    assert math.isinf(table.uncertainty())


def test_break_even_compares_rows_of_like_error():
    direct, factored = row("direct", 3.0, 0.01), row("factored", 1.0, 0.1)
    factored.setup_seconds = 10.0
    assert break_even([direct, factored]) == []
    direct.max_error = 0.06
    assert [pair["queries"] for pair in break_even([direct, factored])] == [5]
    direct.seconds_spread = (0.9, 3.5)  # not always slower
    assert break_even([direct, factored]) == []


def test_break_even_needs_repeated_queries_and_set_ups_that_surely_differ():
    direct, factored = row("direct", 3.0, 0.06), row("factored", 1.0, 0.1)
    direct.setup_seconds, direct.setup_spread = 1.0, (1.0, 4.9)
    factored.setup_seconds, factored.setup_spread = 11.0, (10.0, 12.0)
    assert [pair["queries"] for pair in break_even([direct, factored])] == [5]
    direct.setup_spread = (1.0, 5.1)
    assert break_even([direct, factored]) == []
    direct.setup_spread, direct.repeats = (1.0, 1.0), 2
    assert break_even([direct, factored]) == []


def test_the_mesh_error_of_a_willmore_flow_covers_a_finer_mesh():
    mesh = shapes.icosphere(1)
    mesh = mesh.moved(mesh.points * [1.0, 1.0, 1.3])
    problem = willmore_flow.problem(mesh)
    span = float(problem.error_scale.split("t = ")[1])
    limit = problem.mesh_limits[0][1]()
    finest = mesh
    for _ in range(3):
        finest = smoothly_subdivided(finest)
    energy = willmore_flow._answer(willmore_flow._setup(finest, {}, span, {"step": span / 16}))
    assert abs(energy[0] - limit.values[0]) / energy[0] <= limit.uncertainty.max < 0.3


@pytest.mark.parametrize("command", ["geodesic", "laplacian", "delaunay"])
def test_the_distance_of_a_polyhedron_from_the_smooth_surface_is_that_of_the_truth(command):
    """Rows of 1e-14 were listed where the sphere is half a percent away; a cube is its own smooth surface."""
    sphere = shapes.random_sphere(300)
    table, problem = Table(), mesh_problem(command, sphere)
    reference = problem.references[0][1]()
    find_polyhedron_error(problem, reference, TimeBudget(None), table)
    truth = mesh_problem(command, sphere, truth=parse_truth("sphere:1", sphere.points)).references[0][1]()
    expected = problem.error(truth.values, reference.values)
    assert table.polyhedron_error.max == pytest.approx(expected.max(), rel=0.1)
    assert table.polyhedron_error.mean == pytest.approx(expected.mean(), rel=0.1)

    problem = mesh_problem(command, shapes.box(2, 2, 2))
    reference = problem.references[0][1]()
    find_polyhedron_error(problem, reference, TimeBudget(None), table)
    assert table.polyhedron_error.max <= reference.uncertainty + 1e-12
    if command == "geodesic":  # a component without a source
        both = TriangleMesh.from_arrays(
            np.vstack([sphere.points, sphere.points + 3]), np.vstack([sphere.faces, sphere.faces + 300])
        )
        problem = mesh_problem(command, both)
        find_polyhedron_error(problem, problem.references[0][1](), TimeBudget(None), table)
        assert table.polyhedron_error.max == pytest.approx(expected.max(), rel=0.1)
