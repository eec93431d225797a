"""Library functions: arrays in the place of meshes, the numbers of the command line, refusals."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path

import numpy as np
import pytest

import ddgcli as ddg
from tests.degenerate_meshes import degenerate_mesh

ROOT = Path(__file__).parents[2]
METHODS = ("exact", "heat", "fast-marching", "dijkstra")
SPHERE = ddg.icosphere(1)
SQUARE = ddg.grid(3, 3)
NO_FACES = ddg.TriangleMesh.from_arrays(np.eye(3), np.zeros((0, 3), dtype=np.int64))
TET = ddg.TetMesh.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
RING = ddg.CurveSet.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])
X = SQUARE.points[:, 0]

# one call of every exported function with a parameter `mesh`
CALLS = {
    "as_mesh": lambda m: ddg.as_mesh(m).faces,
    "betti_numbers": lambda m: ddg.betti_numbers(m).absolute,
    "circumcentric_dual": lambda m: ddg.circumcentric_dual(m).dual_area,
    "conformal_map": lambda m: ddg.conformal_map(m).uv,
    "connection_laplacian": lambda m: ddg.connection_laplacian(m).toarray(),
    "curvature_measures": lambda m: ddg.curvature_measures(m, np.arange(18) % 2).area,
    "offset_body": lambda m: (
        ddg.offset_body(SPHERE if m is SQUARE else (SPHERE.points, SPHERE.faces), 1).volume
    ),
    "dec_operators": lambda m: ddg.dec_operators(m)["laplacian1"].toarray(),
    "heat_equation": lambda m: ddg.heat_equation(m, X, 0.1).evolution_frames[-1].values,
    "wave_equation": lambda m: ddg.wave_equation(m, X, 0.1).evolution_frames[-1].values,
    "curve_flow": lambda m: (
        next(iter(ddg.curve_flow(RING if m is SQUARE else (RING.points, RING.lines)))).points
    ),
    "inspect_mesh": lambda m: ddg.inspect_mesh(m).face["min_angle_degrees"],
    "repair_mesh": lambda m: ddg.repair_mesh(m, weld=0.0).vertex["input_vertex"],
    "willmore_flow": lambda m: [s.points for s in ddg.willmore_flow(m, "mean-curvature", steps=2)][-1],
    "curvature": lambda m: ddg.curvature(m).vertex["mean_curvature"],
    "d0": lambda m: ddg.d0(m).toarray(),
    "d1": lambda m: ddg.d1(m).toarray(),
    "d2": lambda m: ddg.d2(TET if m is SQUARE else (TET.points, TET.tetrahedra)).toarray(),
    "delaunay_refinement": lambda m: ddg.delaunay_refinement(m, 30).mesh.side_length,
    "distance_matrix": lambda m: ddg.distance_matrix(m, [0, 3], [5, 6, 7]),
    "distance_gradient": lambda m: ddg.distance_gradient(m, X),
    "divergence": lambda m: ddg.divergence(m).toarray(),
    "DistanceSolver": lambda m: ddg.DistanceSolver(m).distance(0),
    "eigenforms": lambda m: ddg.eigenforms(m, 3).pairs.values,
    "flat": lambda m: ddg.flat(m, [[1, 2, 0]] * 18),
    "interior_product": lambda m: ddg.interior_product(m, [[1, 2, 0]] * 18, ddg.d0(m) @ X),
    "lie_derivative": lambda m: ddg.lie_derivative(m, [[1, 2, 0]] * 18, X),
    "sharp": lambda m: ddg.sharp(m, ddg.d0(m) @ X),
    "wedge": lambda m: ddg.wedge(m, X, ddg.d0(m) @ X),
    "edge_paths": lambda m: ddg.edge_paths(m, [[0, 1, 2]]).polylines[0],
    "eigenpairs": lambda m: ddg.eigenpairs(m, 3).values,
    "galerkin_mass": lambda m: ddg.galerkin_mass(m).toarray(),
    "geodesic_distance": lambda m: ddg.geodesic_distance(m, 0),
    "geodesic_fan": lambda m: ddg.geodesic_fan(m, 5, 8, 0.3, 2).polylines[0],
    "geodesic_voronoi": lambda m: ddg.geodesic_voronoi(m, [0, 15]),
    "gradient": lambda m: ddg.gradient(m).toarray(),
    "harmonic_basis": lambda m: ddg.harmonic_basis(m, "normal").forms,
    "harmonic_interpolation": lambda m: ddg.harmonic_interpolation(m, {0: 0.0, 15: 1.0}).values,
    "heat_kernel_signature": lambda m: ddg.heat_kernel_signature(m, [1.0]).values,
    "HeatSolver": lambda m: ddg.HeatSolver(m).distance(0),
    "hodge_decomposition": lambda m: ddg.hodge_decomposition(m, ddg.d0(SQUARE) @ X).vertex["potential"],
    "hodge_star": lambda m: ddg.hodge_star(m, 1).toarray(),
    "homology_generators": lambda m: len(ddg.homology_generators(m)),
    "integral_curves": lambda m: ddg.integral_curves(m, [[1, 0, 0]] * 18, [5], duration=0.2).polylines[0],
    "intrinsic_delaunay": lambda m: ddg.intrinsic_delaunay(m).side_length,
    "isolines": lambda m: ddg.isolines(m, X, 2).polylines[0],
    "laplace_operator": lambda m: ddg.laplace_operator(m).stiffness.toarray(),
    "logarithmic_map": lambda m: ddg.logarithmic_map(m, 5).vertex["log_map"],
    "lumped_mass": lambda m: ddg.lumped_mass(m).toarray(),
    "mean_curvature_flow": lambda m: ddg.mean_curvature_flow(m, 0.1).mesh.points,
    "measure_distance": lambda m: ddg.measure_distance(m, 0).vertex["geodesic_distance"],
    "parallel_transport": lambda m: ddg.parallel_transport(m, 0, [1, 0, 0]).vertex["transported_vector"],
    "parameterize": lambda m: ddg.parameterize(m).uv,
    "poisson": lambda m: ddg.poisson(m, X - X.mean()).values,
    "shortest_paths": lambda m: ddg.shortest_paths(m, 0, 15).polylines[0],
    "signed_distance": lambda m: ddg.signed_distance(m, [[0, 1], [1, 2]], "heat"),
    "stiffness": lambda m: ddg.stiffness(m).toarray(),
    "straighten_paths": lambda m: ddg.straighten_paths(m, [[0, 1, 2, 6]]).polylines[0],
    "trace": lambda m: ddg.trace(m, 0, [0.4, 0.3, 0.3], [1, 0.2, 0], 0.3).polylines[0],
    "subdivide": lambda m: ddg.subdivide(m, 2).points,
    "tradeoff_table": lambda m: (
        ddg.tradeoff_table("geodesic", m, method="dijkstra", repeat=1).rows[0].max_error
    ),
    "uniform_stiffness": lambda m: ddg.uniform_stiffness(m).toarray(),
    "vertex_types": lambda m: ddg.vertex_types(m),
    "voronoi_mass": lambda m: ddg.voronoi_mass(m).toarray(),
}
WRITERS = {"write_mesh", "write_picture", "write_trajectory"}
HOLDERS = {"Measurement", "Simulation"}  # their `mesh` is a result, not an argument


def test_table_of_calls_holds_every_function_of_a_mesh():
    exported = set(ddg.__all__) - {"__version__", "errors"}
    takes_mesh = {n for n in exported if "mesh" in inspect.signature(getattr(ddg, n)).parameters}
    assert takes_mesh - WRITERS - HOLDERS == set(CALLS)


@pytest.mark.parametrize("name", sorted(CALLS))
def test_pair_of_arrays_gives_what_the_mesh_gives(name):
    pair = (SQUARE.points.tolist(), SQUARE.faces.tolist())
    np.testing.assert_array_equal(CALLS[name](pair), CALLS[name](SQUARE))


TRIANGLE = ([[0, 0], [1, 0], [1, 1]], [[0, 1], [1, 2], [2, 0]])
SHOWN = [
    ("as_mesh", lambda m: m, "TriangleMesh(10000 vertices, 19602 faces)"),
    ("intrinsic_delaunay", ddg.intrinsic_delaunay, "IntrinsicMesh(10000 vertices, 19602 faces)"),
    ("curvature", ddg.curvature, "'mean_curvature_normal': float64[10000,3]"),
    ("shortest_paths", lambda m: ddg.shortest_paths(m, 0, 9).mesh, "CurveSet(10 vertices, 9 lines)"),
    ("laplace_operator", ddg.laplace_operator, "mass=csr_array (10000, 10000) with 10000 entries"),
    ("eigenpairs", lambda m: ddg.eigenpairs(m, 2), "vectors=float64[10000,2]"),
    ("hodge", lambda m: ddg.betti_numbers(m), "BettiNumbers(absolute=(1, 0, 0)"),
    ("heat_equation", lambda m: ddg.heat_equation(m, 0, 0.1), "evolution_frames=list of 51 EvolutionFrame"),
    ("HeatSolver", ddg.HeatSolver, "DistanceSolver(TriangleMesh(10000 vertices"),
    ("curve_flow", lambda m: ddg.curve_flow(TRIANGLE, steps=1), "n_frames=2"),
    ("conformal_map", ddg.conformal_map, "metric=ConeMetric(...)"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "text"), [row[1:] for row in SHOWN], ids=[row[0] for row in SHOWN])
def test_a_result_is_shown_by_the_types_and_shapes_of_its_arrays(call, text):
    shown = repr(call(ddg.grid(99, 99)))
    assert text in shown
    assert len(shown) < 2500 and max(map(len, shown.splitlines())) <= 110
    assert " at 0x" not in shown and "array([" not in shown


def test_what_read_mesh_returns_is_accepted_as_a_mesh(tmp_path):
    ddg.write_mesh(tmp_path / "square.ply", (SQUARE.points, SQUARE.faces))
    read = ddg.read_mesh(tmp_path / "square.ply")
    assert abs(ddg.stiffness(read) - ddg.stiffness(SQUARE)).max() == 0


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: ddg.curvature(TET), "curvature takes a triangle surface in space or curves, not tetrahedra"),
        (lambda: ddg.gradient(ddg.intrinsic_delaunay(SQUARE)), "not an intrinsic triangulation"),
        (lambda: ddg.curvature("bunny.ply"), "str is not a mesh; give a mesh, a pair"),
        (lambda: ddg.stiffness((SQUARE.points, SQUARE.faces + 1)), "names vertex 16, outside 0..15"),
        (lambda: ddg.stiffness((SQUARE.points, SQUARE.faces * 0.5)), "indices must be whole numbers"),
        (lambda: ddg.stiffness(([[0, 0], [1]], [[0, 1, 1]])), "rows of different lengths"),
        (lambda: ddg.curvature((SQUARE.points, [[0, 99]])), "segment 0 names a point outside 0..15"),
        (lambda: ddg.write_mesh("x.vtu", SQUARE, vertex={"a": [1, 2]}), "'a' has shape .2,.; it needs 16"),
        (lambda: ddg.write_mesh("x.vtu", SQUARE, face={"a": ["b"] * 18}), "write real numbers"),
        (lambda: ddg.write_mesh("x.npz", TET, edge={"a": [1]}), "edge arrays belong to surfaces"),
        (lambda: ddg.write_trajectory("x.vtkhdf", []), "pass it as mesh"),
        (lambda: ddg.circumcentric_dual(NO_FACES), "no triangles; a circumcentric dual needs a surface"),
        (lambda: ddg.mean_curvature_flow(NO_FACES, 1.0), "no triangles; smoothing needs a surface"),
        (lambda: ddg.signed_distance(NO_FACES, [[0, 1]]), "no triangles; edges on a surface need a surface"),
        (lambda: ddg.integral_curves(NO_FACES, np.ones((3, 3))), "no triangles; random starts need"),
    ],
)
def test_wrong_meshes_and_arrays_are_refused(call, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ddg.errors.MeshError, match=message):
        call()
    assert list(tmp_path.iterdir()) == []


CALL = re.compile(r"`(ddg\.repair_mesh\(mesh, [^`]*\))`")


@pytest.mark.parametrize(
    "points, faces, call",
    [
        (SPHERE.points, [SPHERE.faces[0][::-1], *SPHERE.faces[1:]], ddg.willmore_flow),
        (SPHERE.points, [*SPHERE.faces, SPHERE.faces[0]], ddg.harmonic_basis),
        (SPHERE.points, SPHERE.faces[1:], lambda m: ddg.willmore_flow(m, "conformal")),
        (np.vstack([SPHERE.points, SPHERE.points[0]]), [[42, *SPHERE.faces[0][1:]], *SPHERE.faces[1:]],
         lambda m: ddg.willmore_flow(m, "conformal")),
    ],
)  # fmt: skip
def test_the_call_that_an_error_about_a_mesh_names_repairs_it(points, faces, call):
    mesh = ddg.TriangleMesh.from_arrays(points, faces)
    for _ in range(3):  # each error names the repair of one defect
        try:
            call(mesh)
            break
        except ddg.errors.MeshError as error:
            mesh = eval(CALL.search(str(error)).group(1), {"ddg": ddg, "mesh": mesh}).mesh
    assert call(mesh) is not None


def test_inspection_and_repair_are_those_of_the_commands(run, tmp_path):
    path = str(ROOT / "sample_meshes" / "saddle.obj")
    mesh = ddg.read_mesh(path)
    info = json.loads(run("info", path, "--json", "-o", tmp_path / "info.npz").stdout)["results"]
    inspected = ddg.inspect_mesh(mesh)
    own = json.loads(json.dumps(inspected.results, default=lambda array: array.tolist()))
    assert {k: v for k, v in own.items() if k != "accepts"} == {k: info[k] for k in own if k != "accepts"}
    assert own["accepts"]["geodesic"] == info["accepts"]["geodesic"] == "yes"
    np.testing.assert_array_equal(
        inspected.face["min_angle_degrees"], np.load(tmp_path / "info.npz")["min_angle_degrees"]
    )
    words = ("repair", path, "--fill-holes", 999, "--cut-to-disk", "--json", "-o", tmp_path / "disk.npz")
    done = run(*words)
    repaired = ddg.repair_mesh(mesh, fill_holes=999, cut_to_disk=True)
    results = json.loads(done.stdout)["results"]
    assert results["changes"] == repaired.results["changes"]
    assert results["refused_by"].keys() == repaired.results["refused_by"].keys()
    stored = np.load(tmp_path / "disk.npz")
    np.testing.assert_array_equal(repaired.mesh.points, stored["points"])
    np.testing.assert_array_equal(repaired.vertex["input_vertex"], stored["input_vertex"])
    np.testing.assert_array_equal(repaired.face["input_face"], stored["input_face"])
    assert ddg.repair_mesh(TET, orient=True).face["input_cell"].tolist() == [0]


def test_the_remedy_for_tetrahedra_works():
    with pytest.raises(ddg.errors.MeshError, match=r"pass their boundary, mesh\.boundary"):
        ddg.stiffness(TET)
    assert ddg.stiffness(TET.boundary).shape == (4, 4)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: ddg.geodesic_distance(SPHERE), "no source"),
        (lambda: ddg.geodesic_distance(SPHERE, [1.5]), "whole numbers"),
        (lambda: ddg.geodesic_distance(SPHERE, 0, "heat", tolerance=1), "tolerance: is not an option of"),
        (lambda: ddg.geodesic_distance(SPHERE, 0, tolerance=-1), "tolerance: must be 0 or more"),
        (lambda: ddg.geodesic_distance(SPHERE, source_points=[[0, 0]]), r"of shape \(k, 3\)"),
        (lambda: ddg.HeatSolver(SPHERE, heat_time=float("nan")), "heat_time: must be a number"),
        (lambda: ddg.HeatSolver(SPHERE, heat_refine=1.5), "heat_refine: must be a whole number"),
        # once a distance of 1, which left one vertex, and loops of one edge, of which there are none
        (lambda: ddg.repair_mesh(SPHERE, weld=True), "weld: must be a number, not True"),
        (lambda: ddg.repair_mesh(SQUARE, fill_holes=True), "fill_holes: must be a whole number, not True"),
        (lambda: ddg.write_mesh("x.vtu", SQUARE, vertex={1: np.ones(16)}), "must be a name in quotes, not 1"),
        (lambda: ddg.eigenpairs(SPHERE, "5"), "k: must be a whole number, not '5'"),
        (lambda: ddg.curvature(SPHERE, "corrected", -1.0), "radius: must be a positive length"),
        (lambda: ddg.curvature((SQUARE.points, [[0, 1]]), radius=1.0), "radius: belongs to surfaces"),
        (lambda: ddg.curvature_measures(SQUARE), "give either `regions` or `ball`"),
        (lambda: ddg.curvature_measures(SQUARE, [0, 1]), "one value for each of 18 faces"),
        (lambda: ddg.heat_equation(SQUARE, [1.0], 0.1), "each of 16 vertices"),
        (lambda: ddg.conformal_map(SPHERE), "sum to 720"),
        (lambda: ddg.curve_flow(RING, tolerance=0.1), "tolerance: needs `duration`"),
        (lambda: ddg.willmore_flow(SPHERE, "area"), "choose one of quadratic, newton"),
        (lambda: ddg.willmore_flow(SPHERE, tolerance=0.1), "tolerance: needs `duration`"),
        (lambda: ddg.willmore_flow(SPHERE, steps=0), "steps: must be 1 or more, not 0"),
        (lambda: ddg.willmore_flow(SPHERE, remesh="short"), "remesh: 'short' is not a length"),
        (lambda: ddg.willmore_flow(SPHERE, region=[42]), "region: .* vertex indices from 0 to 41"),
        (lambda: ddg.willmore_flow(SPHERE, energy="cotan", integrator="rosenbrock"), "needs `step` or"),
        (lambda: ddg.repair_mesh(SPHERE), "no repair is chosen"),
        (lambda: ddg.repair_mesh(SPHERE, weld=-1.0), "weld: must be 0 or a positive number, not -1"),
        (lambda: ddg.repair_mesh(SPHERE, fill_holes=2), "fill_holes: must be 3 or more, not 2"),
        (lambda: ddg.repair_mesh(SPHERE, orient=True, for_command="hodge"), "selects the steps"),
        (lambda: ddg.repair_mesh(TET, fill_holes=9), "is a step of surfaces"),
        (lambda: ddg.parameterize(SQUARE, "area"), "method: 'area' is not one of"),
        (lambda: ddg.mean_curvature_flow(SQUARE, -1.0), "time: must be positive"),
        (lambda: ddg.poisson(SPHERE, [1.0]), "source: an array of shape .* for each of 42 vertices"),
        (lambda: ddg.heat_kernel_signature(SPHERE, []), "times: must be a list of positive numbers"),
        (lambda: ddg.dec_operators(SPHERE, "x"), "^star: 'x' is not one of"),
        (lambda: ddg.eigenpairs(SPHERE, 500), "^k: 500 eigenpairs exceed"),
        (lambda: ddg.eigenforms(SPHERE, 500), "^k: 500 eigenforms exceed"),
        (lambda: ddg.hodge_decomposition(SPHERE, [1.0]), "use vectors on 42 vertices"),
        (lambda: ddg.hodge_decomposition(SPHERE, np.ones(120), "free"), "boundary: 'free' is not one of"),
        (lambda: ddg.logarithmic_map(SPHERE, 0, "dijkstra"), "not 'dijkstra'"),
        (lambda: ddg.isolines(SPHERE, SPHERE.points[:, 0], 0), "count: must be at least 1"),
        (lambda: ddg.trace(SPHERE, [0, 1], [1, 0, 0], [1, 0, 0], [1, 2, 3]), "do not fit together"),
        (lambda: ddg.shortest_paths(SPHERE, 0, 1.5), "whole numbers"),
        (lambda: ddg.tradeoff_table("geodesic", SPHERE, scheme="cotan"), "scheme: is not an option"),
        (lambda: ddg.tradeoff_table("curvature", SPHERE, norm="sum"), "norm: must be"),
        (lambda: ddg.tradeoff_table("curvature", SPHERE, scheme="none"), "scheme: is one of quadric,"),
        (lambda: ddg.tradeoff_table("curvature", SPHERE, radius=[1]), "radius: must be a number"),
        (lambda: ddg.tradeoff_table("laplacian", SPHERE, eigen=1.5), "eigen: must be a whole number"),
        (lambda: ddg.tradeoff_table("laplacian", SPHERE, eigen=0), "eigen: must be at least 1, not 0"),
        (lambda: ddg.tradeoff_table("delaunay", SPHERE, refine=40), "must be above 0 and at most 33, not 40"),
        (lambda: ddg.tradeoff_table("geodesic", SPHERE, operator="x"), "operator: is one of intrinsic-"),
    ],
)
def test_wrong_parameters_are_refused(call, message):
    with pytest.raises(ddg.errors.ParameterError, match=message):
        call()


@pytest.mark.parametrize("method", ["exact", "heat", "fast-marching", "dijkstra"])
def test_distance_is_that_of_the_command(method, summary, tmp_path):
    path = str(ROOT / "sample_meshes" / "torus.ply")
    summary("geodesic", path, "--source", "3", "--method", method, "-o", tmp_path / "d.npz")
    of_command = np.load(tmp_path / "d.npz")["geodesic_distance"]
    np.testing.assert_array_equal(ddg.geodesic_distance(ddg.read_mesh(path), 3, method), of_command)


def test_options_of_distance_change_it():
    sphere = ddg.icosphere(2)
    mesh = sphere.moved(sphere.points * [1, 1, 5])  # stretched: not Delaunay
    plain = ddg.geodesic_distance(mesh, 0, "heat")
    for options in ({"heat_time": 4.0}, {"heat_refine": 2}, {"operator": "plain"}):
        assert np.abs(ddg.geodesic_distance(mesh, 0, "heat", **options) - plain).max() > 1e-6


def test_source_points_are_projected_to_the_surface():
    distance = ddg.geodesic_distance(SQUARE, [15], source_points=[[0.4, 0.45, 2.0]])
    from_point = np.hypot(*(SQUARE.points[:, :2] - [0.4, 0.45]).T)
    from_vertex = np.hypot(*(SQUARE.points[:, :2] - [1.0, 1.0]).T)
    np.testing.assert_allclose(distance, np.minimum(from_point, from_vertex), atol=1e-14)


def test_one_heat_solver_answers_as_new_ones_do():
    solver = ddg.HeatSolver(SPHERE)
    first, second = solver.distance(0), solver.distance([5])
    np.testing.assert_array_equal(solver.distance(0), first)
    np.testing.assert_array_equal(ddg.HeatSolver(SPHERE).distance([5]), second)


@pytest.mark.parametrize("scheme", ["quadric", "corrected", "normal-cycle", "cotan"])
def test_curvature_is_that_of_the_command(scheme, summary, tmp_path):
    path = str(ROOT / "sample_meshes" / "ellipsoid.ply")
    of_command = summary("curvature", path, "--scheme", scheme, "-o", tmp_path / "k.npz")
    measured = ddg.curvature(ddg.read_mesh(path), scheme)
    np.testing.assert_array_equal(
        measured.vertex["mean_curvature"], np.load(tmp_path / "k.npz")["mean_curvature"]
    )
    assert measured.results["willmore_energy"] == of_command["results"]["willmore_energy"]


def test_the_radius_of_the_warning_of_noise_is_one_of_the_library(caplog):
    """Once `radius=auto`, the advice of the warning, was an error: no number."""
    sphere = ddg.icosphere(3)
    noise = np.random.default_rng(0).standard_normal((sphere.n_vertices, 1))
    noisy = ddg.as_mesh((sphere.points * (1 + 0.01 * noise), sphere.faces))
    star = ddg.curvature(noisy)
    assert "radius='auto'" in caplog.text
    ball = ddg.curvature(noisy, radius="auto")
    error = [np.std(k.vertex["mean_curvature"] - 1.0) for k in (star, ball)]  # of the unit sphere
    assert error[1] < 0.5 * error[0]
    with pytest.raises(ddg.errors.ParameterError, match="radius: must be a length or 'auto', not 'best'"):
        ddg.curvature(noisy, radius="best")


def test_curvature_of_a_polygon_is_that_of_its_arrays():
    angle = 2 * np.pi * np.arange(12) / 12
    points = np.stack([2 * np.cos(angle), 2 * np.sin(angle)], axis=1)
    measured = ddg.curvature((points, [[i, (i + 1) % 12] for i in range(12)]))
    assert measured.results["turning_number"] == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(measured.vertex["turning_angle"], 2 * np.pi / 12, rtol=1e-12)


def test_paths_and_transport_on_a_torus_agree_with_the_distance():
    mesh = ddg.torus(24, 12)
    paths = ddg.shortest_paths(mesh, [0], [50, 140], transport=True)
    distance = ddg.geodesic_distance(mesh, 0)
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in paths.polylines]
    np.testing.assert_allclose(lengths, distance[[50, 140]], rtol=1e-10)
    x, y = paths.vertex["transport_x"], paths.vertex["transport_y"]
    np.testing.assert_allclose(np.einsum("ij,ij->i", x, y), 0, atol=1e-12)


def test_a_target_that_no_source_reaches_has_an_empty_polyline():
    two = (
        np.concatenate([SQUARE.points, SQUARE.points + 5]),
        np.concatenate([SQUARE.faces, SQUARE.faces + 16]),
    )
    paths = ddg.shortest_paths(two, 0, [31, 3])
    assert [len(line) > 0 for line in paths.polylines] == [False, True]


def test_results_are_written_with_their_arrays(tmp_path):
    paths = ddg.shortest_paths(SQUARE, 0, [15])
    ddg.write_mesh(tmp_path / "paths.vtp", paths)
    assert {"path_id", "face", "barycentric"} <= set(ddg.read_mesh(tmp_path / "paths.vtp").vertex)
    ddg.write_mesh(tmp_path / "k.npz", ddg.curvature(SPHERE), vertex={"height": SPHERE.points[:, 2]})
    written = np.load(tmp_path / "k.npz")
    assert {"height", "mean_curvature", "dihedral_angle"} <= set(written)


def test_tradeoff_judges_rows_against_a_known_truth():
    table = ddg.tradeoff_table("geodesic", SQUARE, truth="plane", within=0.5, repeat=1)
    assert table.reference is not None and table.reference.is_truth
    assert any(row.on_front for row in table.rows) and any(row.verdict for row in table.rows)
    options = {"sources": [5], "method": "dijkstra", "norm": "mean", "repeat": 1}
    mean = ddg.tradeoff_table("geodesic", SPHERE, **options)
    assert [row.method for row in mean.rows] == ["dijkstra"]
    lines = repr(table).splitlines()
    assert len(lines) == len(table.rows) + 2 and "known truth" in lines[0]
    cheapest = min(table.rows, key=lambda row: row.total_seconds)
    assert cheapest.label in lines[1] and f"{cheapest.max_error:.2e}" in lines[1]


def test_summary_block_of_betti_numbers_agrees(summary):
    path = str(ROOT / "sample_meshes" / "torus.ply")
    of_command = summary("hodge", path)["results"]["betti_numbers"]
    numbers = ddg.betti_numbers(ddg.read_mesh(path))
    assert json.loads(json.dumps(of_command)) == {
        "absolute": list(numbers.absolute),
        "relative": list(numbers.relative),
    }


def test_flat_of_a_linear_field_on_vertices_is_the_derivative_of_its_quadratic_potential():
    x, y, _ = SQUARE.points.T
    field = np.column_stack([2 * x + y, x, 0 * x])
    assert np.abs(ddg.flat(SQUARE, field) - ddg.d0(SQUARE) @ (x * x + x * y)).max() < 1e-14


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: ddg.harmonic_interpolation(SPHERE, {}), "fixed: no value is fixed; add `fixed={ID: VALUE}`"),
        (lambda: ddg.harmonic_interpolation(SPHERE, {-1: 0.0}), "fixed: vertex -1 does not exist"),
        (lambda: ddg.parallel_transport(SPHERE, [0, 1], [[1, 0, 0]]), "vectors: 1 vector for 2"),
        (lambda: ddg.distance_matrix(SPHERE, [0, 1], []), "no target; name a vertex, such as `targets=0`"),
        (lambda: ddg.distance_matrix(SPHERE, [], [0]), "no source; name a vertex, such as `sources=0`"),
        (lambda: ddg.distance_matrix(SPHERE, [0], [10**6]), "target vertex 1000000 is outside"),
    ],
)
def test_refusals_name_the_parameters_of_the_function(call, message):
    with pytest.raises(ddg.errors.ParameterError) as error:
        call()
    assert message in str(error.value)


def test_warnings_name_the_repair_as_a_call_of_the_library(caplog):
    ddg.curvature(degenerate_mesh(3001), "quadric")
    assert "`ddg.repair_mesh(mesh, drop_degenerate=True, split_folds=True)`" in caplog.text


@pytest.mark.parametrize(
    "measure",
    [
        *(lambda m, method=method: ddg.measure_distance(m, 0, method) for method in METHODS),
        *(lambda m, method=method: ddg.logarithmic_map(m, 5, method) for method in METHODS[:3]),
        lambda m: ddg.HeatSolver(m).measure(0),
        lambda m: ddg.shortest_paths(m, 0, 15),
    ],
)
def test_a_distance_that_the_command_line_refuses_has_not_converged(measure, monkeypatch):
    """`converged` was True where `ddgcli geodesic` ends with exit 1."""
    assert measure(SQUARE).converged
    monkeypatch.setattr("ddgcli.algorithms.geodesics.convergence.MAX_EXCESS", -1.0)
    assert not measure(SQUARE).converged


@pytest.mark.parametrize(
    "flatten, module",
    [(ddg.parameterize, "laplacian.parameterize"), (ddg.conformal_map, "conformal.conformal_map")],
)
def test_a_map_that_the_command_line_refuses_has_not_converged(flatten, module, monkeypatch):
    assert flatten(SQUARE).converged
    monkeypatch.setattr(f"ddgcli.algorithms.{module}.LARGEST_RESIDUAL", -1.0)
    assert not flatten(SQUARE).converged


@pytest.mark.parametrize(
    "words, message", [((2, 0.3), "rays"), ((8, -1.0), "length"), ((8, 0.3, -1), "circles")]
)
def test_errors_of_a_fan_name_its_parameters(words, message):
    with pytest.raises(ddg.errors.ParameterError, match=f"^{message}: "):
        ddg.geodesic_fan(SQUARE, 5, *words)


def test_a_vertex_with_the_same_vector_twice_has_it_once():
    once, twice = (ddg.parallel_transport(SQUARE, n * [5], n * [[1, 2, 0]]) for n in (1, 2))
    np.testing.assert_allclose(*(x.vertex["transported_vector"] for x in (once, twice)), atol=1e-12)


def test_an_interrupt_ends_a_table_of_costs(monkeypatch):
    """The command prints the rows so far; a loop of calls could not be stopped."""

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("ddgcli.tradeoff.measure._run_candidates", interrupt)
    with pytest.raises(KeyboardInterrupt):
        ddg.tradeoff_table("geodesic", SPHERE, method="dijkstra", repeat=1)


def test_jobs_of_curvature_change_no_bit():
    one, two = (ddg.curvature(SPHERE, radius=0.5, jobs=jobs).vertex for jobs in (1, 2))
    assert all((one[name] == two[name]).all() for name in one)
