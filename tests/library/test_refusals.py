"""Refusals and warnings of the library name its own parameters, and what is wrong with their values."""

import logging
from threading import Thread

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.errors import MeshError
from ddgcli.library.arguments import checked_arguments

BALL = ddg.icosphere(1)
N = BALL.n_vertices
ONES = np.ones(N)
INFINITE = np.where(np.arange(N) == 0, np.inf, 1.0)
RING = ddg.CurveSet.from_arrays([[1, 0], [0, 1], [-1, 0]], [[0, 1], [1, 2], [2, 0]])
CENTRE = [0.25, 0.25, 0.5]


def traced(face=0, barycentric=CENTRE, direction=(1, 0, 0), length=1.0):
    return ddg.trace(BALL, face, barycentric, direction, length)


@pytest.mark.parametrize(
    ("call", "parameter"),
    [
        (lambda: ddg.heat_equation(BALL, INFINITE, 0.1), "start"),
        (lambda: ddg.wave_equation(BALL, INFINITE, 0.1), "start"),
        (lambda: ddg.poisson(BALL, INFINITE), "source"),
        (lambda: ddg.poisson(BALL, ONES, {0: 1.0, N: 2.0}), "fixed"),
        (lambda: ddg.harmonic_interpolation(BALL, {}), "fixed"),
        (lambda: ddg.eigenforms(BALL, 999), "k"),
        (lambda: ddg.heat_equation(BALL, N, 0.1), "start"),
        (lambda: ddg.heat_equation(BALL, ONES, 0.1, time_step=1.0), "time_step"),
        (lambda: ddg.mean_curvature_flow(BALL, 0.1, steps=0), "steps"),
        (lambda: ddg.mean_curvature_flow(BALL, np.inf), "time"),
        (lambda: ddg.heat_kernel_signature(BALL, [-1.0]), "times"),
        (lambda: ddg.interior_product(BALL, ONES, ONES), "vectors"),
        (lambda: ddg.interior_product(BALL, np.ones((N, 3)), ONES), "form"),
        (lambda: ddg.interior_product(BALL, np.ones((N, 3)), [1.0]), "form"),
        (lambda: ddg.lie_derivative(BALL, np.full((N, 3), np.inf), ONES), "vectors"),
        (lambda: ddg.lie_derivative(BALL, np.ones((N, 3)), INFINITE), "form"),
        (lambda: ddg.flat(BALL, [1.0]), "vectors"),
        (lambda: ddg.flat(BALL, [[1.0, 0.0, 0.0]]), "vectors"),
        (lambda: ddg.sharp(BALL, [1.0]), "form"),
        (lambda: ddg.geodesic_distance(BALL, []), "sources"),
        (lambda: ddg.geodesic_distance(BALL, [N]), "sources"),
        (lambda: ddg.geodesic_distance(BALL, 0, "heat", heat_time=-1.0), "heat_time"),
        (lambda: ddg.geodesic_distance(BALL, 0, "heat", heat_time=1e308), "heat_time"),
        (lambda: ddg.geodesic_distance(BALL, 0, tolerance=-1.0), "tolerance"),
        (lambda: ddg.geodesic_distance(BALL, source_points=[[np.nan, 0, 0]]), "source_points"),
        (lambda: ddg.geodesic_distance(BALL, source_edges=[[0, 0]]), "source_edges"),
        (lambda: ddg.distance_matrix(BALL, [0], [N]), "targets"),
        (lambda: ddg.distance_matrix(BALL, [N], [0]), "sources"),
        (lambda: ddg.distance_gradient(BALL, [1.0]), "distance"),
        (lambda: ddg.geodesic_fan(BALL, 0, 2, 1.0), "rays"),
        (lambda: ddg.geodesic_fan(BALL, 0, 9, -1.0), "length"),
        (lambda: ddg.geodesic_fan(BALL, 0, 9, 1.0, circles=-1), "circles"),
        (lambda: ddg.geodesic_fan(BALL, N, 9, 1.0), "source"),
        (lambda: ddg.logarithmic_map(BALL, [0, 1]), "source"),
        (lambda: ddg.logarithmic_map(BALL, 0, "dijkstra"), "method"),
        (lambda: ddg.shortest_paths(BALL, 0, N), "targets"),
        (lambda: ddg.integral_curves(BALL, np.ones((N, 3)), count=0), "count"),
        (lambda: ddg.integral_curves(BALL, np.ones((N, 3)), order=3), "order"),
        (lambda: ddg.integral_curves(BALL, np.ones((N, 3)), step=-1.0), "step"),
        (lambda: ddg.integral_curves(BALL, np.ones((N, 3)), duration=-1.0), "duration"),
        (lambda: ddg.integral_curves(BALL, np.zeros((N, 3))), "vectors"),
        (lambda: ddg.isolines(BALL, ONES, 0), "count"),
        (lambda: ddg.isolines(BALL, [1.0]), "values"),
        (lambda: ddg.hodge_decomposition(BALL, np.full((N, 3), np.nan)), "field"),
        (lambda: traced(length=-1.0), "length"),
        (lambda: traced(direction=[0, 0, 0]), "direction"),
        (lambda: ddg.offset_body(BALL, -1.0), "distance"),
        (lambda: ddg.offset_body(BALL, 0.1, angle=-1.0), "angle"),
        (lambda: ddg.delaunay_refinement(BALL, 50.0), "degrees"),
        (lambda: ddg.curvature_measures(BALL, [0, 1]), "regions"),
        (lambda: ddg.curvature_measures(BALL, ONES * 0.5), "regions"),
        (lambda: ddg.curvature(BALL, with_frames=True), "with_frames"),
        (lambda: ddg.curvature(BALL, resample=9), "resample"),
        (lambda: ddg.curvature(RING, "cotan"), "scheme"),
        (lambda: ddg.curvature(RING, resample=2), "resample"),
        (lambda: ddg.repair_mesh(BALL, for_command="curve-flow"), "for_command"),
        (lambda: ddg.repair_mesh(BALL, split_edges=np.inf), "split_edges"),
        (lambda: ddg.repair_mesh(BALL, weld=np.inf), "weld"),
        (lambda: ddg.curve_flow(RING, "elastic", length_penalty=-1), "length_penalty"),
        (lambda: ddg.curve_flow(RING, "elastic", length_penalty=np.inf), "length_penalty"),
        (lambda: ddg.curve_flow(RING, "elastic", length_penalty=np.nan), "length_penalty"),
        (lambda: ddg.willmore_flow(BALL, stop_gradient=np.inf), "stop_gradient"),
        (lambda: ddg.willmore_flow(BALL, stop_energy=np.inf), "stop_energy"),
        (lambda: ddg.tradeoff_table("geodesic", BALL, within=0), "within"),
        (lambda: ddg.tradeoff_table("geodesic", BALL, within=np.inf), "within"),
        (lambda: ddg.conformal_map(BALL, {0: -100.0}), "cones"),
        (lambda: ddg.hodge_decomposition(BALL, np.ones(BALL.topology.n_edges), place="edges"), "place"),
        (lambda: ddg.distance_gradient(BALL, ONES * np.nan), "distance"),
        (lambda: ddg.distance_matrix(BALL, [0.5], [0]), "sources"),
        (lambda: ddg.distance_matrix(BALL, [0], targets=[1.5]), "targets"),
        (lambda: ddg.geodesic_distance(BALL, [0.5]), "sources"),
        (lambda: ddg.logarithmic_map(BALL, np.array([0, 1.5])), "source"),
        (lambda: ddg.integral_curves(BALL, np.ones((N, 3)), [0.5]), "starts"),
        (lambda: ddg.parallel_transport(BALL, [0], [[0, 1]]), "vectors"),
        (lambda: ddg.parallel_transport(BALL, [0, 1], [[0, 1, 0]]), "vectors"),
        (lambda: ddg.parallel_transport(BALL, [0], [[0, 1, np.nan]]), "vectors"),
        (lambda: ddg.straighten_paths(BALL, [[0, 999]]), "paths"),
        (lambda: ddg.straighten_paths(BALL, [[0, 0.5]]), "paths"),
        (lambda: ddg.signed_distance(BALL, [[0, 999]]), "curves"),
        (lambda: ddg.signed_distance(BALL, [1.0]), "curves"),
        (lambda: ddg.wedge(BALL, [1, 2], ONES), "a"),
        (lambda: ddg.wedge(BALL, ONES, INFINITE), "b"),
        (lambda: traced(face=80), "face"),
        (lambda: traced(barycentric=[0.5, 0.5, 0.5]), "barycentric"),
        (lambda: traced(barycentric=[0.5, 0.5]), "barycentric"),
        *((lambda v=v: traced(direction=v), "direction") for v in (True, 1.5, [7], [1, 0], [[[1, 0, 0]]])),
        (lambda: traced(direction=[True, False, False]), "direction"),
        (lambda: traced(length=True), "length"),
        (lambda: traced(length=[True]), "length"),
        (lambda: ddg.straighten_paths(BALL, [[3, 3]]), "paths"),
        (lambda: ddg.edge_paths(BALL, [[3, 3]]), "paths"),
        (lambda: ddg.curvature(BALL, "corrected", -1.0), "radius"),
        (lambda: ddg.curvature_measures(BALL, ball=([0, 0, 0], -1.0)), "ball"),
        (lambda: ddg.curvature_measures(BALL, ball=([0, 0, np.nan], 1.0)), "ball"),
        (lambda: ddg.willmore_flow(BALL, flow="fast"), "flow"),
        (lambda: ddg.willmore_flow(BALL, energy="cotan", integrator="rosenbrock"), "integrator"),
        (lambda: ddg.willmore_flow(BALL, spontaneous_curvature=1.0), "spontaneous_curvature"),
        (lambda: ddg.willmore_flow(BALL, remesh_adaptive=True), "remesh_adaptive"),
        (lambda: ddg.curve_flow(RING, "fast"), "flow"),
        (lambda: ddg.tradeoff_table("weather", BALL), "question"),
        (lambda: ddg.tradeoff_table("curvature", BALL, norm="sum"), "norm"),
        (lambda: ddg.tradeoff_table("curvature", BALL, error="time"), "error"),
        (lambda: ddg.tradeoff_table("curvature", BALL, repeat=0), "repeat"),
        (lambda: ddg.tradeoff_table("curvature", BALL, budget=-1.0), "budget"),
        (lambda: ddg.tradeoff_table("curvature", BALL, sources=[0]), "sources"),
        (lambda: ddg.tradeoff_table("curvature", BALL, degrees=3), "degrees"),
    ],
)
def test_a_wrong_value_is_refused_by_the_name_that_its_parameter_has(call, parameter):
    with pytest.raises(ddg.errors.ParameterError) as refused:
        call()
    assert refused.value.parameter == parameter
    assert str(refused.value).startswith(f"{parameter}: ")


def test_no_start_of_integral_curves_is_refused_by_their_own_word():
    with pytest.raises(ddg.errors.ParameterError, match="`starts=0`"):
        ddg.integral_curves(BALL, np.ones((N, 3)), [])


def test_a_component_without_a_fixed_value_is_refused_by_an_entry_of_the_dict():
    two = (np.vstack([BALL.points, BALL.points + 9.0]), np.vstack([BALL.faces, BALL.faces + N]))
    with pytest.raises(ddg.errors.ParameterError, match=f"add `fixed={{{N}: VALUE}}`"):
        ddg.harmonic_interpolation(two, {0: 1.0})


def test_a_place_that_is_none_lists_the_places():
    with pytest.raises(ddg.errors.ParameterError, match="vertex, face, edge"):
        ddg.hodge_decomposition(BALL, np.ones(BALL.topology.n_edges), place="edges")


def test_signatures_of_short_times_advise_what_the_function_has(caplog):
    ddg.heat_kernel_signature(ddg.icosphere(4), [0.014])
    assert "use longer times" in caplog.text and "eigen`" not in caplog.text


def test_a_distance_that_reaches_not_everywhere_has_no_gradient_there_and_nan_is_refused():
    gradient = ddg.distance_gradient(BALL, np.where(np.arange(N) == 0, np.inf, BALL.points[:, 2]))
    reached = (BALL.faces != 0).all(axis=1)
    assert not gradient[~reached].any() and gradient[reached].any(axis=1).all()
    with pytest.raises(ddg.errors.ParameterError, match="NaN at vertex 3"):
        ddg.distance_gradient(BALL, np.where(np.arange(N) == 3, np.nan, 1.0))


def test_level_lines_of_no_finite_value_are_none_with_a_warning(caplog):
    assert not ddg.isolines(BALL, ONES).polylines and not caplog.text
    assert not ddg.isolines(BALL, ONES * np.nan).polylines
    assert "no value is finite" in caplog.text


@pytest.mark.parametrize("shape", ["one", "many"])
def test_lines_are_traced_from_one_or_many_directions(shape):
    once = traced().polylines[0]
    directions = [[1, 0, 0], [0, 1, 0]] if shape == "many" else [[1, 0, 0]]
    lines = traced(direction=directions, length=np.float32(1.0)).polylines
    assert len(lines) == len(directions)
    np.testing.assert_array_equal(lines[0], once)


def test_repairs_are_written_as_calls_in_warnings_of_this_call_alone(caplog):
    """A filter on the logger would rewrite the warnings of other threads, such as those of a command."""
    log = logging.getLogger("ddgcli")

    @checked_arguments
    def warns(steps: int) -> None:
        log.warning("use `repair=orient`")
        other = Thread(target=log.warning, args=("use `repair=weld`",))
        other.start()
        other.join()

    warns(1)
    log.warning("use `repair=drop_degenerate`")
    assert caplog.messages == [
        "use `ddg.repair_mesh(mesh, orient=True)`", "use `repair=weld`", "use `repair=drop_degenerate`",
    ]  # fmt: skip


def test_fractions_as_vertex_numbers_are_refused_and_whole_floats_taken():
    mesh = ddg.icosphere(1)
    V, F = np.asarray(mesh.points), np.asarray(mesh.faces)
    with pytest.raises(MeshError, match="face indices must be whole numbers"):
        ddg.curvature((V, F + 0.5))
    assert ddg.curvature((V, F.astype(float))).mesh.n_faces == len(F)


@pytest.mark.parametrize("degrees", [0, -5])
def test_an_angle_that_is_not_positive_has_its_bound_named(degrees):
    with pytest.raises(ddg.errors.ParameterError, match="above 0"):
        ddg.delaunay_refinement(BALL, degrees)
