"""Predictions of seconds and memory from a table of costs, without a run."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

import ddgcli as ddg
from ddgcli import memory
from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.intrinsic_delaunay import intrinsic_delaunay
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics import certificate
from ddgcli.algorithms.hodge.homology import betti_numbers
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import signature_pairs
from ddgcli.algorithms.laplacian.weyl import MAX_SIGNATURE_PAIRS, pairs_for_times
from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.cli.forecast import prediction
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS
from ddgcli.cli.forecast.delaunay_kernels import steiner_points
from ddgcli.cli.forecast.facts import CurvatureFacts, DelaunayFacts, GeodesicFacts
from ddgcli.cli.forecast.kernels import COPIES_FACTOR, kernels_of
from ddgcli.cli.forecast.mesh_facts import (
    compactness,
    edge_paths,
    handles,
    harmonic_fields,
)
from ddgcli.cli.forecast.prediction import predict
from ddgcli.cli.forecast.simulator_kernels import (
    ITERATIONS_PER_LOAD_STEP,
    ITERATIONS_TO_REST,
    MAX_REMESHES,
    REMESHING_INTERVAL,
)
from ddgcli.cli.forecast.use import InputSize, Use
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import remesh_step
from ddgcli.models.willmore.energies import ENERGIES

MIB = 2.0**20


def test_memory_taken_after_a_prediction_counts_as_available(monkeypatch):
    size = InputSize("surface", 1000)
    cost = predict([Use("info")], size)
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 600 * MIB)
    monkeypatch.setattr(prediction, "resident_memory", lambda: (400 * MIB, 500 * MIB))
    assert prediction.as_results(cost, size)["available_mib"] == 1000.0


def test_available_memory_follows_ulimit_and_the_container(tmp_path, monkeypatch):
    most, current = tmp_path / "max", tmp_path / "current"
    most.write_text(f"{3 * 2**20}\n")
    current.write_text(f"{2**20}\n")
    monkeypatch.setattr(memory, "CGROUP_FILES", ((str(most), str(current)),))
    assert memory.available_memory() == 2 * 2**20
    most.write_text("max\n")
    assert memory.available_memory() > 2**24
    if memory.resource is not None:
        size = memory._proc_value("/proc/self/status", "VmSize:") or 0.0
        monkeypatch.setattr(memory.resource, "getrlimit", lambda kind: (int(size + 7 * MIB), -1))
        assert memory.available_memory() <= 8 * MIB
        with pytest.raises(Exception, match="above"):
            memory.check_memory(9 * MIB, "rows", "use fewer")


def test_seconds_scale_with_the_probe_and_memory_does_not(monkeypatch):
    uses, size = [Use("delaunay")], InputSize("surface", 50_000)
    costs = []
    for factor in (1.0, 3.0):
        monkeypatch.setattr(prediction, "probe", lambda factor=factor: factor * PROBE_SECONDS)
        costs.append(predict(uses, size))
    seconds, mib = ([cost.kernels[0][key] for cost in costs] for key in ("seconds", "mib"))
    assert math.isclose(seconds[1], 3 * seconds[0]) and mib[0] == mib[1]


def test_the_probe_sorts_without_vector_instructions_that_its_commands_do_not_use(monkeypatch):
    kinds, argsort = [], np.argsort

    def recorded(values, **options):
        kinds.append(options.get("kind"))
        return argsort(values, **options)

    monkeypatch.setattr(np, "argsort", recorded)
    prediction.probe()
    assert set(kinds) == {"stable"}


def test_options_change_what_is_predicted():
    size = InputSize("surface", 10_000, curvature=CurvatureFacts(edge_length=0.1))

    def names(command, **options):
        return [use.kernel for use in kernels_of(command, options, size)]

    assert names("laplacian", eigen=8) == ["laplacian", "laplacian eigen"]
    assert names("laplacian", operator="intrinsic-delaunay")[1:] == ["delaunay"]
    assert names("laplacian", eigen=9)[-1] == "laplacian eigenpair"
    tasks = ["poisson", "eigen", "smooth", "form-eigen"]
    arguments = {"poisson": "f", "eigen": 8, "smooth": 1.0, "form_eigen": 4}
    for solver in ITERATIVE_SOLVERS:
        kernels = [f"laplacian {task} {solver}" for task in tasks]
        assert names("laplacian", solver=solver, **arguments)[1:] == kernels
        assert set(kernels) <= set(COEFFICIENTS)
        heat = {"method": "heat", "source": [0], "solver": solver, "log_map": True}
        assert names("geodesic", **heat) == [f"geodesic heat {solver}", f"geodesic vector-heat {solver}"]
        assert names("geodesic", source=[0], solver=solver) == ["geodesic exact"]
    assert names("delaunay", refine=25.0, overlay="x") == [
        *2 * ["delaunay"],
        "delaunay refine",
        "delaunay overlay",
        "delaunay refined faces",
    ]
    assert names("delaunay", transfer=["f"])[1:] == ["delaunay overlay", "delaunay transfer"]
    assert names("laplacian", operator="tufted")[1:] == ["laplacian tufted"]
    log_map = {"method": "heat", "source": [0], "log_map": True}
    assert names("geodesic", **log_map) == ["geodesic heat", "geodesic heat log-map"]
    *_, ball, arrays, energies = kernels_of("curvature", {"scheme": "quadric", "radius": 0.3}, size)
    assert (arrays.kernel, energies.kernel) == ("curvature further arrays", "curvature energies")
    short = kernels_of("curvature", {"scheme": "cotan"}, size, full=False, energies=False)
    assert short == [Use("curvature cotan")]
    assert ball.kernel == "curvature quadric radius" and math.isclose(ball.elements, 5000 * (30 + 9 * 4.15))
    loaded = InputSize("surface", 10_000, steps=11)
    _, _, _, last, *rest = kernels_of("shell-sim", {"integrator": "static"}, loaded)
    assert last == Use("shell-sim rest check")
    assert [use.times for use in rest] == [ITERATIONS_TO_REST, 10 * ITERATIONS_PER_LOAD_STEP]
    assert kernels_of("shell-sim", {"integrator": "static"}, replace(loaded, steps=1))[4:] == rest[:1]
    analysed = kernels_of("shell-sim", {"modes": 20}, replace(loaded, steps=0))
    once = [Use("shell-sim assembly"), Use("shell-sim solvers", added=1.0)]
    assert analysed == [Use("shell-sim"), Use("shell-sim modes", 2), *once]
    curve = InputSize("curve", 1000, steps=10)
    elastic, plain = (kernels_of("curve-flow", {"flow": f}, curve)[-1] for f in ("elastic", "curvature"))
    assert elastic.kernel == plain.kernel and elastic.times > plain.times == 10
    many = kernels_of("geodesic", {"method": "heat", "source": [1, 2], "each_source": True}, size)
    assert many[-1] == Use("geodesic heat solve", 2)


def test_steiner_points_are_counted_after_the_flips_and_up_to_their_limit():
    grid = shapes.grid(30, 30)
    sheared = grid.moved(grid.points + grid.points[:, 1:2] * [5.0, 0, 0])  # flips make it square again
    size = size_of(sheared, {"refine": 25.0})
    assert size.delaunay.angle_deficit < 0.1 * sheared.n_faces  # but at the boundary
    size = InputSize("surface", 2000, delaunay=DelaunayFacts(500.0))
    few, many = (
        kernels_of("delaunay", {"refine": 25.0, "max_points": most}, size)[-1] for most in (100, None)
    )
    assert few.elements < 0.1 * many.elements  # points, and memory
    assert few.elements * few.times > 0.1 * many.elements * many.times  # flips, of the input too


def random_strip(width):
    """A random triangulation of a square, made narrow: needles, and slivers along the boundary."""
    points = np.vstack([np.random.default_rng(0).random((300, 2)), [[0, 0], [1, 0], [0, 1], [1, 1]]])
    faces = Delaunay(points).simplices.astype(np.int64)
    return TriangleMesh.from_arrays(np.c_[points * [1.0, width], np.zeros(304)], faces)


@pytest.mark.parametrize(
    "mesh",
    [
        random_strip(1.0),
        random_strip(1e-3),  # 0.34 of the points and 0.13 of the faces were predicted
        shapes.random_sphere(300, 0),
        shapes.cylinder(40, 1, 0.5, 10.0),  # all faces are equal needles, which share points
    ],
    ids=["square", "strip", "sphere", "needles"],
)
def test_steiner_points_and_faces_of_refined_overlays_are_counted_by_small_angles(mesh):
    """Predicted by the differences of the angles of neighbours, and by the formula of Cauchy and Crofton."""
    options = {"refine": 25.0, "transfer": ["f"]}
    size = size_of(mesh, options)
    overlay = intrinsic_delaunay(mesh, degrees=25.0, subdivide=True).results["overlay"]
    points = steiner_points(25.0, None, size.delaunay.angle_deficit, size.delaunay)
    assert points == pytest.approx(overlay["steiner_points"], rel=0.35)
    uses = {use.kernel: use for use in kernels_of("delaunay", options, size)}
    n_faces = mesh.n_faces + uses["delaunay refined faces"].elements
    assert n_faces == pytest.approx(overlay["faces"], rel=0.35)
    assert uses["delaunay transfer"].elements == mesh.n_faces + 2.0 * points


def test_refinement_without_small_angles_adds_no_faces():
    mesh = shapes.icosphere(2)
    uses = kernels_of(
        "delaunay", {"refine": 25.0, "overlay": "x"}, size_of(mesh, {"refine": 25, "overlay": "x"})
    )
    assert [use.kernel for use in uses] == [*2 * ["delaunay"], "delaunay refine", "delaunay overlay"]


@pytest.mark.parametrize("stretch", [1.0, 3.0, 30.0])
def test_faces_of_overlays_are_counted(stretch):
    sphere = shapes.random_sphere(1002, 0)
    mesh = sphere.moved(sphere.points * [1.0, 1.0, stretch])
    size = size_of(mesh, {"overlay": "x"})
    cut = common_subdivision(flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh))
    assert mesh.n_faces + size.delaunay.further_overlay_faces == cut.mesh.n_faces
    kernels = kernels_of("delaunay", {"overlay": "x"}, size)
    assert [use.kernel for use in kernels[2:]] == (["delaunay further faces"] if stretch > 1.0 else [])


def test_rows_of_needles_may_take_many_more_flips():
    size = InputSize("surface", 2000)
    needles, others = (
        kernels_of("delaunay", {"refine": 25.0}, replace(size, delaunay=DelaunayFacts(deficit)))[-1]
        for deficit in (1999.0, 500.0)
    )
    assert needles.range[1] > 4 * others.range[1]


@pytest.mark.parametrize("platform", ["linux", "darwin"])
@pytest.mark.parametrize(
    ("method", "rows", "processes"), [("exact", 2, 2), ("heat", 9, 4), ("fast-marching", 9, 4)]
)
def test_the_rows_of_a_distance_matrix_are_those_that_the_run_propagates(
    method, rows, processes, platform, monkeypatch
):
    """Symmetric methods start from the smaller set; each process of --jobs may prepare for itself."""
    monkeypatch.setattr("sys.platform", platform)
    options = {"method": method, "source": list(range(9)), "target": [[5, 6]], "jobs": 4}
    uses = kernels_of("geodesic", options, InputSize("surface", 10_000))
    assert [use.times for use in uses if use.kernel == f"geodesic {method} solve"] == [rows]
    assert [use.times for use in uses if use.kernel == "geodesic job"] == [processes]
    prepared = [1] if method == "exact" or platform == "linux" else [1, 4]
    assert [use.times for use in uses if use.kernel == f"geodesic {method}"] == prepared


def test_trees_of_many_sources_are_counted():
    def uses(options):
        kernels = kernels_of("geodesic", {"method": "heat", **options}, InputSize("surface", 1000))
        return [use.kernel for use in kernels].count("geodesic many sources")

    assert uses({"source": list(range(17))}) == uses({"source_boundary": True}) == 1
    assert uses({"source": list(range(16))}) == 0
    assert certificate.MAX_BRUTE_FORCE_STARTS == 16


def test_rounds_of_fast_marching_are_counted_by_the_longest_path():
    """A wavefront on a long strip has few vertices a round, and each round its cost."""

    def runs(mesh, **options):
        options = {"method": "fast-marching", "source": [0], **options}
        of_all, of_one = edge_paths(mesh, options)
        size = InputSize("surface", mesh.n_faces, geodesic=GeodesicFacts(of_all, of_one))
        uses = {use.kernel: use.times for use in kernels_of("geodesic", options, size)}
        return uses.get("geodesic fast-marching solve", 0.0)

    sphere, strip = shapes.random_sphere(2000, 0), shapes.grid(400, 5, 400.0, 5.0)
    assert runs(sphere) < 0.3 and 3 < runs(strip) < 20  # in runs on a sphere of as many faces
    assert runs(strip, each_source=True, source=[0, 1]) == pytest.approx(3 * runs(strip) + 2, rel=0.01)


def test_constants_of_components_are_no_eigenpairs_to_compute():
    one = shapes.icosphere(1)

    def uses(n, k, scale=1.0):
        points = [scale**i * one.points + [5.0 * i, 0, 0] for i in range(n)]
        faces = [one.faces + i * one.n_vertices for i in range(n)]
        mesh = TriangleMesh.from_arrays(np.concatenate(points), np.concatenate(faces))
        return kernels_of("laplacian", {"eigen": k}, size_of(mesh, {"eigen": k}))[1:]

    assert uses(9, 9) == [Use("laplacian eigen")]
    assert uses(9, 8) == [Use("laplacian eigen", elements=0)]
    copies, others = uses(9, 30)[1], uses(9, 30, 1.1)[1]
    assert others == Use("laplacian eigenpair", 30 - 8 - 8, added=22)
    assert copies.times == COPIES_FACTOR * others.times and copies.assumes


def test_a_run_of_unknown_length_has_a_range_of_seconds_and_others_have_none():
    def seconds(command, steps=None, adaptive=False, **options):
        kind = "curve" if command == "curve-flow" else "surface"
        size = InputSize(kind, 50_000, steps=steps, adaptive=adaptive)
        cost = predict(kernels_of(command, options, size), size)
        return (cost.seconds_range[0], cost.seconds, cost.seconds_range[1]), cost.kernels[-1]

    for known in (
        seconds("geodesic", method="heat", source=[0]),
        seconds("laplacian", parameterize="harmonic"),
        seconds("fluid-sim", 5, integrator="conservative"),
    ):
        assert len(set(known[0])) == 1 and "times_range" not in known[1]
    for unknown in (
        seconds("shell-sim", 1, integrator="static"),
        seconds("fluid-sim", 5, integrator="circulation"),
        seconds("willmore-flow"),
        seconds("willmore-flow", 5),
        seconds("willmore-flow", 5, step=1e-6),
        seconds("curve-flow"),
        seconds("shell-sim", 5),
        seconds("shell-sim", 5, contact=True),
        seconds("delaunay", refine=25.0),
        seconds("geodesic", source=[0]),
        seconds("laplacian", parameterize="conformal"),
    ):
        assert unknown[1]["assumes"]
        assert unknown[0][0] < unknown[0][1] < unknown[0][2]
        assert unknown[1]["times_range"][0] < unknown[1]["times"] < unknown[1]["times_range"][1]
    cost, step = seconds("fluid-sim", 5, adaptive=True)
    assert step["times"] == 5 and cost[1] < cost[2]


def test_the_range_of_seconds_is_printed_where_it_is_wide():
    facts = {"peak_mib": 1.0, "available_mib": 9.0, "seconds": 10.0, "kernels": []}
    assert prediction.as_text({**facts, "seconds_range": [9.0, 12.0]}, full=False)[1].endswith("10 s")
    long = {**facts, "seconds": 96.4, "seconds_range": [2.0, 1234.0]}
    assert "96 s (2 to 1,200 s:" in prediction.as_text(long, full=False)[1]
    assert prediction.as_text({**facts, "seconds": 99.7}, full=False)[1].endswith("100 s")
    assert "(1 to 50 s:" in prediction.as_text({**facts, "seconds_range": [1.0, 50.0]}, full=False)[1]
    facts["kernels"] = [{"kernel": "a", "assumes": "100 steps"}, {"kernel": "b"}]
    facts["kernels"].append({"kernel": "search", "assumes": "100 steps"})  # stated once
    assert (
        "(1 to 50 s: assumes 100 steps)"
        in prediction.as_text({**facts, "seconds_range": [1.0, 50.0]}, full=False)[1]
    )


def test_a_mesh_of_many_parts_needs_smaller_factors_than_one_part():
    def mib(component, kernel="shell-sim implicit step"):
        size = InputSize("surface", 100_000, component_elements=component)
        return predict([Use(kernel)], size).kernels[0]["mib"]

    assert mib(4) < 0.6 * mib(100_000) and mib(None) == mib(100_000) < mib(10**6)
    assert mib(4, "shell-sim") == mib(None, "shell-sim")


def rough_square(n):
    square = shapes.grid(n, n)
    height = 2.0 / n * np.random.default_rng(0).random(square.n_vertices)
    return square.moved(square.points + height[:, None] * [0, 0, 1])


@pytest.mark.parametrize(
    ("mesh", "least", "most"),
    [
        (shapes.random_sphere(2000, 0), 0.7, 1.4),  # the measured kernel itself
        (shapes.grid(400, 5, 400.0, 5.0), 4.0, 30.0),  # measured: 5 (2,000 cells long: 10)
        (shapes.grid(45, 45), 0.7, 2.0),
        (rough_square(45), 0.5, 1.4),  # measured: 0.75; saddle vertices stop the windows
    ],
    ids=["sphere", "strip", "square", "rough square"],
)
def test_exact_distances_are_predicted_by_the_windows_near_the_sources(mesh, least, most):
    def times(**options):
        of_all, of_one = edge_paths(mesh, options)
        size = InputSize("surface", mesh.n_faces, geodesic=GeodesicFacts(of_all, of_one))
        return [use.times for use in kernels_of("geodesic", {"method": "exact", **options}, size)]

    (from_end,) = times(source=[0])
    assert least < from_end < most
    assert times(source=[0, mesh.n_vertices // 2])[0] < from_end
    assert times(source=[0], certify=True)[1] == 4 * from_end
    assert times(field="wind")[0] == 1.0  # no source, no distance


def test_edge_paths_end_at_other_components_and_ignore_sources_outside_the_mesh():
    one = shapes.icosphere(1)
    faces = np.concatenate([one.faces, one.faces + one.n_vertices])
    two = TriangleMesh.from_arrays(np.concatenate([one.points, one.points + 9.0]), faces)
    of_two, of_one = (edge_paths(mesh, {"source": [0]})[0] for mesh in (two, one))
    assert replace(of_two, reach_all=True) == of_one and not of_two.reach_all
    assert edge_paths(one, {"source": [-1, 999]}) == edge_paths(one, {"source": [0]})
    at_pole = edge_paths(one, {"source_point": [one.points[5]]})
    assert at_pole == edge_paths(one, {"source": [5]})
    face = int(np.flatnonzero(one.faces[:, 0] == 5)[0])
    assert edge_paths(one, {"source_face": [[face, [1, 0, 0]]]}) == at_pole
    square = shapes.grid(4, 4)
    assert edge_paths(square, {"source_boundary": True})[0].longest == 2.0


def test_heat_kernel_signatures_take_the_eigenpairs_that_the_run_computes():
    for mesh, times in ((shapes.icosphere(2), [0.2, 1.0]), (shapes.box_tetrahedra(4, 4, 4), [0.05])):
        operator = laplace_operator(mesh)
        pairs = signature_pairs(operator, times)
        assert 20 < pairs < 300
        size = size_of(mesh, {"hks": times})
        further = kernels_of("laplacian", {"hks": times}, size)[-1]
        assert further.kernel == "laplacian eigenpair" and further.times == pairs - 8
        assert kernels_of("laplacian", {"hks": times, "eigen": 900}, size)[-1].times == 892


def test_handles_of_solids_are_counted_by_the_genus_of_their_boundary():
    """A solid of genus eleven was predicted at 0.57 of its seconds."""
    whole = shapes.box_tetrahedra(5, 5, 3)
    hole = (np.floor(5 * whole.points[whole.tetrahedra].mean(axis=1)[:, :2]) % 2 == 1).all(axis=1)
    cavity = (np.floor(5 * whole.points[whole.tetrahedra].mean(axis=1)) == [2, 2, 2]).all(axis=1)
    for outside, count in ((hole, 4), (np.zeros(len(hole), dtype=bool), 0), (cavity, 0)):
        solid = TetMesh.from_arrays(whole.points, whole.tetrahedra[~outside])
        assert handles(solid.boundary) == betti_numbers(solid).absolute[1] == count
        uses = kernels_of("hodge", {"basis": False}, size_of(solid, {"basis": False}))
        assert [use.times for use in uses[1:]] == [count] * (count > 0)


def test_thin_solids_have_smaller_factors_than_cubes():
    """A mat of one layer was predicted at 1.55 times the memory of its eigenforms."""
    cube, mat = shapes.box_tetrahedra(6, 6, 6), shapes.box_tetrahedra(15, 15, 1, (15.0, 15.0, 1.0))
    assert compactness(cube) == pytest.approx(1.0)
    assert compactness(mat) == pytest.approx(12 * 225 ** (2 / 3) / (4 * 225 + 2 * 60))

    def elements(mesh):
        (use,) = kernels_of("laplacian", {"form_eigen": 4}, size_of(mesh, {"form_eigen": 4}))[1:]
        return use.elements

    assert elements(cube) is None and 0.6 < elements(mat) / len(mat.tetrahedra) < 0.9


def test_remeshings_are_counted_as_often_as_the_flow_may_remesh():
    """One a step was counted, of the cost of a fourth: 0.29 of the seconds of a run of one step."""
    assert (REMESHING_INTERVAL, MAX_REMESHES) == (remesh_step.INTERVAL, remesh_step.MAX_REMESHES)
    counts = [
        next(
            use.times
            for use in kernels_of("willmore-flow", {"remesh": "mean"}, InputSize("surface", 99, steps=steps))
            if use.kernel == "willmore-flow remeshing"
        )
        for steps in (1, 5, 6, 12, 1000)
    ]
    assert counts == [1, 1, 2, 3, remesh_step.MAX_REMESHES]


def test_harmonic_fields_are_counted_by_eulers_formula():
    tube = shapes.cylinder(8, 4)
    for mesh, count in ((shapes.torus(8, 6), 2), (shapes.icosphere(1), 0), (shapes.grid(3, 3), 0), (tube, 1)):
        assert harmonic_fields(mesh) == betti_numbers(mesh).of_boundary("tangential")[1] == count
        uses = kernels_of("hodge", {"basis": True}, size_of(mesh, {"basis": True}))
        assert [use.times for use in uses[1:]] == [1, count] * (count > 0)


def test_the_constant_part_of_steps_counts_once():
    def seconds(steps):
        size = InputSize("surface", 1000, steps=steps)
        uses = kernels_of("laplacian", {"wave": "f", "time_step": 0.1}, size)
        return predict(uses, size, calibrate=False).kernels[-1]["seconds"]

    constant = COEFFICIENTS["laplacian wave"].seconds
    assert math.isclose(seconds(200) - constant, 20 * (seconds(10) - constant))


@pytest.mark.parametrize(
    "mesh", [shapes.icosphere(2), shapes.random_sphere(600), shapes.box_tetrahedra(6, 6, 6)]
)
@pytest.mark.parametrize("duration", [1.0, 10.0])
def test_default_steps_of_a_wave_from_a_vertex_are_those_of_the_run(mesh, duration):
    steps = ddg.wave_equation(mesh, 0, duration, n_frames=2).results["steps"]
    options = {"wave": "0", "duration": duration}
    assert 0.6 < size_of(mesh, options).steps / steps < 1.6
    (*_, use) = kernels_of("laplacian", {**options, "wave": "f"}, InputSize("surface", 1000, steps=1600))
    assert use.times == 4 and use.range == (0.25, 4)  # 100 of a smooth start to 1,600


def test_heat_costs_its_frames_and_not_its_steps():
    def uses(steps, **options):
        return kernels_of("laplacian", {"heat": "0", **options}, InputSize("surface", 1000, steps=steps))

    assert uses(1000) == uses(100) and uses(100)[-1].times == 48
    assert uses(1000, n_frames=500)[-1].times == 498 and len(uses(2)) == len(uses(100)) - 1


def test_a_flow_to_rest_may_end_before_its_second_remesh():
    options = {"flow": "newton", "remesh": "mean"}
    least = {}
    for steps in (1, 12):
        uses = kernels_of("willmore-flow", options, replace(InputSize("surface", 10_000), steps=steps))
        (use,) = (use for use in uses if use.kernel == "willmore-flow remeshing")
        least[steps] = use.times * use.range[0]
    assert least[12] == pytest.approx(least[1])


def test_triangles_that_a_flow_improves_before_its_first_step_are_counted():
    def is_counted(**options):
        uses = kernels_of(
            "willmore-flow", {"flow": "quadratic", **options}, InputSize("surface", 10_000, steps=1)
        )
        return "willmore-flow improvement" in {use.kernel for use in uses}

    assert is_counted() and not is_counted(step=1e-9) and not is_counted(flow="newton")
    for name, energy in ENERGIES.items():
        assert is_counted(energy=name) == energy.keeps_triangles


@pytest.mark.parametrize("dimension", [2, 3])
def test_times_of_signatures_near_the_smallest_number_take_all_pairs(dimension):
    assert pairs_for_times(1.0, dimension, [1.0, 1e-300], 5000) == MAX_SIGNATURE_PAIRS


def test_fillings_of_holes_cost_the_triangles_among_which_they_are_chosen():
    """A loop of 1,580 edges was predicted as 1 s and took 170."""
    mesh = shapes.cylinder(12, 3, 1.0, 0.5)
    uses = {
        edges: kernels_of("repair", {"fill_holes": edges}, size_of(mesh, {"fill_holes": edges}))
        for edges in (11, 12)
    }
    assert [use.kernel for use in uses[11]] == ["repair"]
    assert [use.elements for use in uses[12] if use.kernel == "repair holes"] == [2 * 12**3 / 6]
