"""Predictions of seconds and memory from a table of costs, without a run."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ddgcli import memory
from ddgcli.algorithms.hodge.homology import betti_numbers
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import signature_pairs
from ddgcli.cli.forecast import prediction
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS
from ddgcli.cli.forecast.kernels import CLEAN_MEMORY_SHARE, CLEAN_SECONDS_SHARE, kernels_of
from ddgcli.cli.forecast.mesh_facts import ball_vertices, edge_paths, harmonic_fields
from ddgcli.cli.forecast.prediction import predict
from ddgcli.cli.forecast.simulator_kernels import ITERATIONS_PER_LOAD_STEP, ITERATIONS_TO_REST
from ddgcli.cli.forecast.use import InputSize, Use
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

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


def test_options_change_what_is_predicted():
    size = InputSize("surface", 10_000, edge_length=0.1)

    def names(command, **options):
        return [use.kernel for use in kernels_of(command, options, size)]

    assert names("laplacian", eigen=8) == ["laplacian", "laplacian eigen"]
    assert names("laplacian", eigen=9)[-1] == "laplacian eigenpair"
    assert names("delaunay", refine=25.0, overlay="x") == ["delaunay", "delaunay refine", "delaunay overlay"]
    assert names("delaunay", transfer=["f"])[1:] == ["delaunay overlay", "laplacian poisson"]
    *_, ball, further = kernels_of("curvature", {"scheme": "quadric", "radius": 0.3}, size)
    assert further.kernel == "curvature further results"
    noise, own = kernels_of("curvature", {"scheme": "cotan"}, size, full=False)
    assert own == Use("curvature cotan") and noise.kernel == "curvature noise"
    assert (noise.times, noise.added) == (CLEAN_SECONDS_SHARE, CLEAN_MEMORY_SHARE)
    assert ball.kernel == "curvature quadric radius" and math.isclose(ball.times, 9)
    loaded = InputSize("surface", 10_000, steps=11)
    rest = kernels_of("shell-sim", {"integrator": "static"}, loaded)[1:]
    assert [use.times for use in rest] == [ITERATIONS_TO_REST, 10 * ITERATIONS_PER_LOAD_STEP]
    assert kernels_of("shell-sim", {"integrator": "static"}, replace(loaded, steps=1))[1:] == rest[:1]
    analysed = kernels_of("shell-sim", {"modes": 20}, replace(loaded, steps=0))
    assert analysed == [Use("shell-sim"), Use("shell-sim modes", 2)]
    curve = InputSize("curve", 1000, steps=10)
    elastic, plain = (kernels_of("curve-flow", {"flow": f}, curve)[-1] for f in ("elastic", "curvature"))
    assert elastic.kernel == plain.kernel and elastic.times > plain.times == 10
    many = kernels_of("geodesic", {"method": "heat", "source": [1, 2], "each_source": True}, size)
    assert many[-1] == Use("geodesic heat solve", 2)


@pytest.mark.parametrize(("method", "rows", "processes"), [("exact", 2, 2), ("heat", 9, 4)])
def test_the_rows_of_a_distance_matrix_are_those_that_the_run_propagates(method, rows, processes):
    """Symmetric methods start from the smaller set; each process of --jobs factorises for itself."""
    options = {"method": method, "source": list(range(9)), "target": [[5, 6]], "jobs": 4}
    uses = kernels_of("geodesic", options, InputSize("surface", 10_000))
    assert [use.times for use in uses if use.kernel == f"geodesic {method} solve"] == [rows]
    assert [use.times for use in uses if use.kernel == "geodesic job"] == [processes]
    assert [use.times for use in uses if use.kernel == "geodesic heat"] == [1, 4] * (method == "heat")


def test_noise_of_a_surface_is_part_of_the_prediction_of_its_curvature():
    smooth, options = shapes.torus(80, 40), {"scheme": "quadric"}
    noise = 0.1 * smooth.side_length.mean() * np.random.default_rng(0).standard_normal(smooth.points.shape)

    def uses(mesh, **more):
        return kernels_of("curvature", {**options, **more}, size_of(mesh, {**options, **more}))

    for mesh, share in ((smooth, CLEAN_SECONDS_SHARE), (smooth.moved(smooth.points + noise), 1.0)):
        assert uses(mesh)[0].times == uses(mesh, radius="auto")[0].times == share
        radii = [use.kernel for use in uses(mesh, radius="auto") if use.kernel.endswith(" radius")]
        assert len(radii) == (share == 1.0)
    assert uses(shapes.icosphere(1))[0].times == CLEAN_SECONDS_SHARE  # large turns of one sign
    assert all(use.kernel != "curvature noise" for use in uses(smooth, radius=0.1))
    rough = smooth.moved(smooth.points + noise)
    assert any(use.kernel == "curvature noise" for use in uses(rough, radius=0.1))
    corrected = uses(rough, radius=0.1, scheme="corrected")  # its balls do not depend on noise
    assert all(use.kernel != "curvature noise" for use in corrected)


def test_a_run_of_unknown_length_has_a_range_of_seconds_and_others_have_none():
    def seconds(command, steps=None, adaptive=False, **options):
        kind = "curve" if command == "curve-flow" else "surface"
        size = InputSize(kind, 50_000, steps=steps, adaptive=adaptive)
        cost = predict(kernels_of(command, options, size), size)
        return (cost.seconds_range[0], cost.seconds, cost.seconds_range[1]), cost.kernels[-1]

    for known in (
        seconds("geodesic", method="heat", source=[0]),
        seconds("willmore-flow", 5, step=1e-6),
        seconds("fluid-sim", 5),
    ):
        assert len(set(known[0])) == 1 and "times_range" not in known[1]
    for unknown in (
        seconds("shell-sim", 1, integrator="static"),
        seconds("willmore-flow"),
        seconds("willmore-flow", 5),
        seconds("curve-flow"),
        seconds("shell-sim", 5),
        seconds("shell-sim", 5, contact=True),
        seconds("delaunay", refine=25.0),
        seconds("geodesic", source=[0]),
    ):
        assert unknown[1]["assumes"]
        assert unknown[0][0] < unknown[0][1] < unknown[0][2]
        assert unknown[1]["times_range"][0] < unknown[1]["times"] < unknown[1]["times_range"][1]
    cost, step = seconds("fluid-sim", 5, adaptive=True)
    assert step["times"] == 5 and cost[1] < cost[2]


def test_the_range_of_seconds_is_printed_where_it_is_wide():
    facts = {"peak_mib": 1.0, "available_mib": 9.0, "seconds": 10.0, "kernels": []}
    assert prediction.as_text({**facts, "seconds_range": [9.0, 12.0]})[1].endswith("10 s")
    assert "(1 to 50 s:" in prediction.as_text({**facts, "seconds_range": [1.0, 50.0]})[1]
    facts["kernels"] = [{"kernel": "a", "assumes": "100 steps"}, {"kernel": "b"}]
    assert "(1 to 50 s: assumes 100 steps)" in prediction.as_text({**facts, "seconds_range": [1.0, 50.0]})[1]


def test_a_mesh_of_many_parts_needs_smaller_factors_than_one_part():
    def mib(component, kernel="shell-sim implicit step"):
        size = InputSize("surface", 100_000, component_elements=component)
        return predict([Use(kernel)], size).kernels[0]["mib"]

    assert mib(4) < 0.6 * mib(100_000) and mib(None) == mib(100_000) < mib(10**6)
    assert mib(4, "shell-sim") == mib(None, "shell-sim")


@pytest.mark.parametrize(
    ("mesh", "least", "most"),
    [
        (shapes.random_sphere(2000, 0), 0.7, 1.4),  # the measured kernel itself
        (shapes.grid(400, 5, 400.0, 5.0), 4.0, 30.0),  # measured: 5 (2,000 cells long: 10)
        (shapes.grid(45, 45), 0.7, 2.0),
    ],
    ids=["sphere", "strip", "square"],
)
def test_exact_distances_are_predicted_by_the_edges_between_sources_and_vertices(mesh, least, most):
    def times(**options):
        of_all, of_one = edge_paths(mesh, options)
        size = InputSize("surface", mesh.n_faces, paths=of_all, paths_of_one=of_one)
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
    assert edge_paths(two, {"source": [0]}) == edge_paths(one, {"source": [0]})
    assert edge_paths(one, {"source": [-1, 999]}) == edge_paths(one, {"source": [0]})
    at_pole = edge_paths(one, {"source_point": [one.points[5]]})
    assert at_pole == edge_paths(one, {"source": [5]})
    face = int(np.flatnonzero(one.faces[:, 0] == 5)[0])
    assert edge_paths(one, {"source_face": [[face, [1, 0, 0]]]}) == at_pole
    square = shapes.grid(4, 4)
    assert edge_paths(square, {"source_boundary": True})[0].longest == 2.0


def test_balls_are_counted_where_the_vertices_lie():
    """On graded meshes as many as a search finds, not as the mean edge suggests."""
    square, radius = shapes.grid(60, 60), 0.1
    graded = square.moved(square.points**3)
    for mesh in (square, graded):
        distance = np.linalg.norm(mesh.points[:, None, :2] - mesh.points[None, ::7, :2], axis=2)
        count = float((distance <= radius).sum(axis=0).mean())
        assert math.isclose(ball_vertices(mesh, radius), count, rel_tol=0.15)

    def times(mesh):
        size = InputSize("surface", mesh.n_faces, ball_vertices=ball_vertices(mesh, radius))
        return kernels_of("curvature", {"scheme": "corrected", "radius": radius}, size)[1].times

    assert times(graded) > 2 * times(square)
    # measured: balls of eight edges take 2.4 to 2.9 times as long as balls of three
    size = InputSize("surface", 9, edge_length=1.0)
    three, eight = (
        kernels_of("curvature", {"scheme": "corrected", "radius": rings}, size) for rings in (3.0, 8.0)
    )
    assert 2.0 < eight[1].times / three[1].times < 3.0


def test_heat_kernel_signatures_take_the_eigenpairs_that_the_run_computes():
    for mesh, times in ((shapes.icosphere(2), [0.2, 1.0]), (shapes.box_tetrahedra(4, 4, 4), [0.05])):
        operator = laplace_operator(mesh)
        pairs = signature_pairs(operator, times)
        assert 20 < pairs < 300
        size = size_of(mesh, {"hks": times})
        further = kernels_of("laplacian", {"hks": times}, size)[-1]
        assert further.kernel == "laplacian eigenpair" and further.times == pairs - 8
        assert kernels_of("laplacian", {"hks": times, "eigen": 900}, size)[-1].times == 892


def test_curves_of_a_geodesic_run_are_counted():
    options = {"fan": 300, "isolines": 40, "voronoi": True, "trace": ["0:1,0,0:1,0,0:1"]}
    uses = {use.kernel: use.times for use in kernels_of("geodesic", options, InputSize("surface", 10_000))}
    assert uses == {"geodesic trace": 1, "geodesic fan": 3, "geodesic isolines": 2, "geodesic voronoi": 1}


def test_harmonic_fields_are_counted_by_eulers_formula():
    tube = shapes.cylinder(8, 4)
    for mesh, count in ((shapes.torus(8, 6), 2), (shapes.icosphere(1), 0), (shapes.grid(3, 3), 0), (tube, 1)):
        assert harmonic_fields(mesh) == betti_numbers(mesh).of_boundary("tangential")[1] == count
        uses = kernels_of("hodge", {"basis": True}, size_of(mesh, {"basis": True}))
        assert [use.times for use in uses[1:]] == [1, count] * (count > 0)


def test_the_constant_part_of_steps_counts_once():
    def seconds(steps):
        size = InputSize("surface", 1000, steps=steps)
        return predict(kernels_of("laplacian", {"heat": "f"}, size), size, calibrate=False).kernels[-1][
            "seconds"
        ]

    constant = COEFFICIENTS["laplacian evolution"].seconds
    assert math.isclose(seconds(200) - constant, 20 * (seconds(10) - constant))
