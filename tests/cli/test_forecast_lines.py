"""Predictions of lines on surfaces: the edges that they cross."""

import math

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.query import CurveQuery, DistanceQuery
from ddgcli.algorithms.geodesics.sources import check_sources
from ddgcli.algorithms.geodesics.surface_curves import trace_curves
from ddgcli.algorithms.tangent_fields.fan import geodesic_fan
from ddgcli.algorithms.tangent_fields.geodesic_query import solve_geodesic_task
from ddgcli.algorithms.tangent_fields.geodesic_task import GeodesicTask
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.coefficients import COEFFICIENTS
from ddgcli.cli.forecast.curve_facts import field_facts
from ddgcli.cli.forecast.facts import GeodesicFacts
from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.mesh_facts import crossings_per_length, edge_paths, mean_chord
from ddgcli.cli.forecast.use import InputSize
from ddgcli.mesh import shapes

SPHERE = shapes.random_sphere(500, 0)
ROUGH = SPHERE.moved(SPHERE.points * (1 + 0.05 * np.random.default_rng(0).standard_normal((500, 1))))


def test_crossings_of_straight_lines_are_counted_by_the_formula_of_crofton():
    # lines on tori do not pass everywhere
    for mesh, tolerance in ((shapes.random_sphere(500, 0), 0.07), (shapes.torus(40, 20), 0.3)):
        traces = trace_curves(
            mesh, np.array([0, 9]), np.full((2, 3), 1 / 3), [[1, 0.3, 0], [0, 1, 1]], [30.0, 30.0]
        )
        n_edges = sum(entry["crossings"] for entry in traces.entries)
        assert math.isclose(60 * crossings_per_length(mesh), n_edges, rel_tol=tolerance)
    use = kernels_of(
        "geodesic",
        {"trace": [[0, [1, 0, 0], [1, 0, 0], 30.0]] * 2},
        InputSize("surface", 9, geodesic=GeodesicFacts(crossings_per_length=5.0)),
    )[-1]
    assert use.kernel == "geodesic crossings" and use.elements == 300.0


def test_curves_of_a_geodesic_run_are_counted():
    options = {"isolines": 40, "voronoi": True, "trace": [[0, [1, 0, 0], [1, 0, 0], 1.0]]}
    uses = {use.kernel: use.times for use in kernels_of("geodesic", options, InputSize("surface", 10_000))}
    counts = {"trace": 1, "crossings": 1, "isolines": 2, "level": 40, "voronoi": 1}
    assert uses == {f"geodesic {name}": times for name, times in counts.items()}


def test_the_rays_of_a_fan_are_counted_by_the_edges_that_they_cross():
    """Their number alone was counted: 0.09 of the seconds of 1,000 long rays, 0.15 of their memory."""

    def counts(mesh, length):
        options = {"fan": 40, "fan_length": length}
        uses = {use.kernel: use for use in kernels_of("geodesic", options, size_of(mesh, options))}
        fan = geodesic_fan(mesh, check_sources(mesh, [len(mesh.points) // 2]), 40, length)
        n_points = int(fan.paths.start[40])
        return uses["geodesic fan crossings"].elements / n_points, uses["geodesic fan levels"].elements / 40

    sphere, square = shapes.random_sphere(500, 0), shapes.grid(30, 30)
    assert counts(sphere, 6.0)[0] == pytest.approx(1.0, rel=0.1)
    assert counts(square, 0.3)[0] == pytest.approx(1.0, rel=0.2)
    assert 0.7 < counts(square, 100.0)[0] < 1.8  # rays stop at the boundary, which they start far from
    assert counts(square, 100.0)[1] == 1024 and counts(square, 0.1)[1] == 64


def test_lines_between_boundaries_have_the_mean_length_of_santalo():
    assert mean_chord(shapes.grid(9, 9, 2.0, 2.0)) == pytest.approx(math.pi / 2)  # pi area / perimeter
    assert mean_chord(shapes.icosphere(1)) == math.inf


def predicted(mesh, facts=None, **options):
    """Uses of kernels by their names, and the curves of the run itself."""
    size = size_of(mesh, options).with_geodesic(**(facts or {}))
    if options.get("source"):
        of_all, of_one = edge_paths(mesh, options)
        size = size.with_geodesic(paths=of_all, paths_of_one=of_one)
    uses = {use.kernel: use for use in kernels_of("geodesic", options, size)}
    assert set(uses) <= set(COEFFICIENTS)
    return uses


@pytest.mark.parametrize("mesh", [SPHERE, ROUGH, shapes.grid(20, 20)], ids=["sphere", "rough", "grid"])
def test_points_of_paths_and_level_lines_are_counted(mesh):
    """A path cost as much as a thousand, and 3,000 level lines had the memory of none."""
    targets = tuple(range(1, mesh.n_vertices, 7))
    uses = predicted(mesh, source=[0], path_to=targets, isolines=50, paths_output=("a.vtp", "b.npz"))
    query = DistanceQuery(source=((0,),), isolines=50)
    result = solve_geodesic_task(GeodesicTask.of(mesh, query, CurveQuery(path_to=targets)))
    n_points = np.diff(result.curves.paths.start)
    path, level = uses["geodesic path"], uses["geodesic level"]
    assert path.times == path.added == len(targets) and level.times == level.added == 50
    assert path.elements * len(targets) == pytest.approx(n_points[: len(targets)].sum(), rel=0.35)
    assert level.elements * 50 == pytest.approx(n_points[len(targets) :].sum(), rel=0.3)
    written = uses["write curves"]
    assert written.times == 2 and written.elements == path.elements * len(targets) + level.elements * 50


def test_frames_on_curves_are_counted_by_their_points():
    uses = predicted(
        SPHERE, source=[0], path_to=(5, 6), transport=True, darboux=True, paths_output=("a.vtp",)
    )
    assert uses["geodesic frames"].times == 2
    assert (
        uses["geodesic frames"].elements
        == uses["write curves"].elements
        == 2 * uses["geodesic path"].elements
    )
    assert uses["write curves"].added > 1.0


def test_straightened_paths_are_counted_by_their_way_points():
    options = {"straighten": tuple([k, k + 200] for k in range(20))}
    uses = predicted(SPHERE, **options)
    curves = solve_geodesic_task(GeodesicTask.of(SPHERE, DistanceQuery(), CurveQuery(**options))).curves
    assert uses["geodesic leg"].times == 20
    assert predicted(SPHERE, loop=([0, 1, 2],), straighten=([0, 1, 2],))["geodesic leg"].times == 3 + 2
    assert uses["geodesic straighten"].elements == pytest.approx(len(curves.paths.face), rel=0.35)
    along = predicted(SPHERE, curve=([0, 1, 2, 10_000],))  # the run refuses the last one
    assert along["geodesic leg"].times == 2 and "geodesic straighten" not in along


def test_fixed_steps_of_integral_curves_are_counted():
    """They were predicted as adaptive ones: 0.8 s of 17."""
    field = np.cross([0, 0, 1], SPHERE.points)
    options = {"field": "f", "field_seeds": 4, "field_time": 2.0, "field_step": 0.02}
    uses = predicted(SPHERE, field_facts(SPHERE, field, options), **options)
    curves = solve_geodesic_task(
        GeodesicTask.of(SPHERE, DistanceQuery(), CurveQuery(**options), field=(field, "vertex"))
    ).curves
    assert [entry["steps"] for entry in curves.entries] == [100] * 4
    round_, step = uses["geodesic field round"], uses["geodesic field step"]
    assert round_.times == round_.added == 150 and round_.range == (1.0, 1.0)  # and 50 of twice the length
    assert step.elements == 4 * 150
    points = 4 * 100 + uses["geodesic crossings"].elements
    assert points == pytest.approx(len(curves.paths.face), rel=0.2)
    facts = {"field_steps": 100}
    assert predicted(SPHERE, facts, field_order="1", **options)["geodesic field round"].times == 37.5
    assert predicted(SPHERE, facts, source=[1, 2], field="f")["geodesic field step"].elements == 300


@pytest.mark.parametrize("mesh", [SPHERE, ROUGH, shapes.icosphere(3)], ids=["sphere", "rough", "smooth"])
def test_the_range_of_adaptive_steps_contains_those_of_the_run(mesh):
    field = np.cross([0, 0, 1], mesh.points)
    options = {"field": "f", "field_seeds": 4}
    use = predicted(mesh, field_facts(mesh, field, options), **options)["geodesic field round"]
    curves = solve_geodesic_task(
        GeodesicTask.of(mesh, DistanceQuery(), CurveQuery(**options), field=(field, "vertex"))
    ).curves
    rounds = 3.0 * max(entry["steps"] for entry in curves.entries)
    assert use.range[0] * use.times <= 1.1 * rounds and rounds <= use.range[1] * use.times


def test_fields_that_the_run_refuses_add_no_facts():
    for field in (np.zeros((500, 3)), np.full((500, 3), np.nan), np.zeros(500), np.zeros((0, 3))):
        assert field_facts(SPHERE, field, {"field": "f"}) == {}


def test_rays_from_the_boundary_leave_the_surface_sooner():
    square = shapes.grid(20, 20)
    inner, outer = (
        predicted(square, source=[vertex], fan=40, fan_length=1.0)["geodesic fan crossings"]
        for vertex in (220, 10)
    )
    fan = geodesic_fan(square, check_sources(square, [10]), 40, 1.0)
    assert outer.elements == pytest.approx(int(fan.paths.start[40]), rel=0.4)
    assert outer.elements < inner.elements and outer.range != inner.range == (1.0, 1.0)
