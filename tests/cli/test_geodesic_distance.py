"""`ddgcli geodesic`: sources, methods, arrays, certificate and errors of the contract."""

from pathlib import Path

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


@pytest.fixture
def square(tmp_path):
    """Unit square of 10 x 10 cells; vertex (i, j) has number 11 i + j."""
    path = tmp_path / "square.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(10, 10)))
    return path


@pytest.fixture
def islands(tmp_path):
    one, two = shapes.icosphere(1), shapes.icosphere(2)
    points = np.concatenate([one.points, two.points + 4, [[9.0, 9.0, 9.0]]])
    path = tmp_path / "islands.ply"
    faces = np.concatenate([one.faces, two.faces + one.n_vertices])
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(points, faces)))
    return path


def test_the_default_method_is_exact(square, summary, tmp_path):
    out = tmp_path / "out.npz"
    report = summary("geodesic", square, "--source", 0, "-o", out)
    assert report["results"]["method"] == "exact"
    assert report["results"]["windows"] > 0 and report["results"]["unreachable"] == 0
    arrays = np.load(out)
    truth = np.linalg.norm(arrays["points"] - arrays["points"][0], axis=1)
    assert np.abs(arrays["geodesic_distance"] - truth).max() < 1e-12
    assert report["results"]["max_distance"] == pytest.approx(truth.max(), rel=1e-12)
    assert report["results"]["mean_distance"] == pytest.approx(truth.mean(), rel=1e-12)
    accuracy = report["accuracy"]
    assert accuracy["violations_straight_line"] == accuracy["violations_edge_distance"] == 0
    assert accuracy["violations_lipschitz"] == 0
    assert accuracy["gradient_deviation"]["median"] < 0.05


@pytest.mark.parametrize(
    "words", [["--source", 0, 5, 120], ["--source", "0,5", "--source", 120], ["--source", "0,5,120"]]
)
def test_all_spellings_of_several_sources_agree(square, summary, tmp_path, words):
    out = tmp_path / "out.npz"
    report = summary("geodesic", square, *words, "--each-source", "-o", out)
    assert report["options"]["source"] == [0, 5, 120]
    assert [entry["vertex"] for entry in report["results"]["sources"]] == [0, 5, 120]
    arrays = np.load(out)
    each = np.stack([arrays[f"geodesic_distance_{i:03d}"] for i in range(3)])
    assert np.allclose(arrays["geodesic_distance"], each.min(axis=0), atol=1e-14)
    nearest = arrays["nearest_source"]
    assert np.allclose(np.take_along_axis(each, nearest[None], axis=0)[0], arrays["geodesic_distance"])


def test_target_points_have_the_distance_of_the_plane(square, summary):
    targets = ["--target-point", "0.33,0.71,5", "--target-face", "0:0.2,0.3,0.5"]
    report = summary("geodesic", square, "--source", 0, 120, *targets)
    near, inside = report["results"]["targets"]
    assert near["nearest_source"] == 1 and near["position"] == pytest.approx([0.33, 0.71, 0])
    assert near["distance"] == pytest.approx(np.hypot(0.67, 0.29), abs=1e-12)
    assert inside["face"] == 0
    assert inside["distance"] == pytest.approx(np.linalg.norm(inside["position"]), abs=1e-12)


def test_an_unreached_target_has_null_distance(islands, summary):
    report = summary("geodesic", islands, "--source", 0, "--target-face", "200:0.2,0.3,0.5")
    assert report["results"]["targets"][0]["distance"] is None


def test_exact_draws_a_progress_bar(square, run):
    done = run("geodesic", square, "--source", 0, "--progress")
    assert "exact distance [" in done.stderr and done.exit_code == 0


def test_source_point_and_source_face_agree(square, summary, tmp_path):
    out = tmp_path / "out.npz"
    report = summary("geodesic", square, "--source-point", "0.33,0.41,7", "-o", out)
    entry = report["results"]["sources"][0]
    assert np.allclose(entry["position"], [0.33, 0.41, 0])
    arrays = np.load(out)
    truth = np.linalg.norm(arrays["points"] - [0.33, 0.41, 0], axis=1)
    assert np.abs(arrays["geodesic_distance"] - truth).max() < 1e-12
    weights = ",".join(repr(b) for b in entry["barycentric"])
    again = tmp_path / "again.npz"
    summary("geodesic", square, "--source-face", f"{entry['face']}:{weights}", "-o", again)
    assert np.allclose(np.load(again)["geodesic_distance"], truth, atol=1e-12)


def test_negative_coordinates_are_not_options(square, summary):
    report = summary("geodesic", square, "--source-point", "-1,-1,0", "0.5,0.5,0")
    assert len(report["results"]["sources"]) == 2


MIXED = ("--source", 0, "--source-face", "150:0.2,0.3,0.5")


@pytest.mark.parametrize(
    "method, least, most",
    [("exact", 0, 1e-15), ("heat", 1e-4, 0.2), ("fast-marching", 1e-5, 0.02), ("dijkstra", 0.05, 0.45)],
)
def test_every_method_accepts_mixed_sources(square, summary, tmp_path, method, least, most):
    out, truth = tmp_path / "out.npz", tmp_path / "truth.npz"
    summary("geodesic", square, *MIXED, "-o", truth)
    words = ("--method", method, "--compare", "exact", "dijkstra", "-o", out)
    report = summary("geodesic", square, *MIXED, *words)
    table = report["accuracy"]["compare"]
    assert set(table) == {"exact", "dijkstra"}
    assert least <= table["exact"]["max_error"] <= most
    arrays = [np.load(path)["geodesic_distance"] for path in (out, truth)]
    error = np.abs(arrays[0] - arrays[1]) / arrays[1].max()
    assert table["exact"]["max_error"] == pytest.approx(error.max(), rel=1e-12, abs=1e-15)
    assert table["exact"]["mean_error"] == pytest.approx(error.mean(), rel=1e-9, abs=1e-15)
    assert error[table["exact"]["max_error_at"]] == pytest.approx(error.max(), abs=1e-15)
    assert table["exact"]["seconds"] > 0


def test_heat_reports_its_residuals(square, summary):
    report = summary(
        "geodesic", square, "--source", 0, "--method", "heat", "--heat-time", 4, "--heat-refine", 1
    )
    assert report["results"]["operator"] == "intrinsic-delaunay"
    assert 0 < report["accuracy"]["heat_residual"] < 1e-12
    assert 0 < report["accuracy"]["poisson_residual"] < 1e-9


def test_heat_states_its_error_and_warns_behind_a_hole(summary, tmp_path):
    grid = shapes.grid(12, 12)
    hole = np.abs(grid.points[grid.faces].mean(axis=1) - grid.points.mean(axis=0)).max(axis=1) < 0.3
    holed = TriangleMesh.from_arrays(grid.points, grid.faces[~hole])
    for mesh, is_large in ((holed, True), (shapes.icosphere(4), False)):
        write_mesh(str(tmp_path / "m.ply"), AnnotatedMesh(mesh))
        words = ("--source", 3, "--method", "heat", "--compare", "exact")
        report = summary("geodesic", tmp_path / "m.ply", *words)
        accuracy = report["accuracy"]
        estimate, error = accuracy["error_estimate"], accuracy["compare"]["exact"]["max_error"]
        assert 0.2 * estimate < error < 1.7 * estimate
        warnings = [text for text in report["warnings"] if text.startswith("error_estimate is")]
        assert (estimate > 0.1) == is_large == bool(warnings)
        assert not is_large or "--method fast-marching" in warnings[0]


def test_gradient_is_that_of_the_linear_interpolant_and_zero_on_unreached_faces(islands, summary, tmp_path):
    out = tmp_path / "out.npz"
    summary("geodesic", islands, "--source", 0, "--gradient", "-o", out)
    arrays = np.load(out)
    gradient, faces, distance = (arrays[k] for k in ("distance_gradient", "faces", "geodesic_distance"))
    reached = np.isfinite(distance[faces]).all(axis=1)
    assert (~reached).sum() == 320 and (gradient[~reached] == 0).all()
    corner, value = arrays["points"][faces[reached]], distance[faces[reached]]
    side, rise = np.roll(corner, -1, axis=1) - corner, np.roll(value, -1, axis=1) - value
    assert np.abs(np.einsum("fd,fjd->fj", gradient[reached], side) - rise).max() < 1e-14
    normal = np.cross(side[:, 0], side[:, 1])
    assert np.abs((gradient[reached] * normal).sum(axis=1)).max() < 1e-14


def test_isolines_are_circles(square, summary, tmp_path):
    lines = tmp_path / "lines.npz"
    report = summary("geodesic", square, "--source", 0, "--isolines", 4, "--paths-output", lines)
    arrays = np.load(lines)
    radius = np.linalg.norm(arrays["points"], axis=1)
    assert np.abs(radius - arrays["level"]).max() < 0.01
    assert len(report["results"]["paths"]) == len(set(arrays["path_id"])) >= 4
    ahead = np.diff(arrays["points"], axis=0)[np.diff(arrays["path_id"]) == 0]
    middle = arrays["points"][:-1][np.diff(arrays["path_id"]) == 0] + ahead / 2
    outwards = (np.cross([0, 0, 1.0], ahead) * middle).sum(axis=1)
    assert (
        outwards.min() > -1e-15 and outwards.sum() > 1
    )  # farther on the left; through vertices in steps of 0
    first = report["results"]["paths"][0]
    assert first["kind"] == "isoline"
    assert first["length"] == pytest.approx(np.pi / 2 * first["level"], rel=0.01)


def test_tolerance_reports_its_error(square, summary, tmp_path):
    path = tmp_path / "sphere.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.random_sphere(4000)))
    report = summary("geodesic", path, "--source", 40, "--tolerance", 1, "--compare", "exact")
    error = report["accuracy"]["compare"]["exact"]["max_error"]
    assert error < report["accuracy"]["tolerance_error_estimate"] < 20 * error
    assert 0 < error < 0.3
    report = summary("geodesic", square, "--source", 40, "--tolerance", 0.3, "--compare", "exact")
    assert report["accuracy"]["compare"]["exact"]["max_error"] == 0  # 121 vertices: exact is the cheaper
    assert report["accuracy"]["tolerance_error_estimate"] == 0


def test_certify_reports_symmetry_and_triangle_residuals(square, summary):
    report = summary("geodesic", square, "--source", 0, "--certify")
    assert report["accuracy"]["symmetry_residual"] < 1e-12
    assert report["accuracy"]["triangle_residual"] < 1e-12
    assert report["accuracy"]["sampled_pairs"] == 6


@pytest.mark.parametrize("method", ["exact", "heat", "fast-marching", "dijkstra"])
def test_unreachable_components_are_named(islands, summary, tmp_path, method):
    out = tmp_path / "out.npz"
    report = summary("geodesic", islands, "--source", 0, "--method", method, "-o", out)
    assert report["results"]["unreachable"] == 163
    assert any("component 1 (162 vertices" in warning for warning in report["warnings"])
    assert np.isinf(np.load(out)["geodesic_distance"]).sum() == 163


def test_a_source_point_in_another_unit_is_a_warning(square, summary):
    far = summary("geodesic", square, "--source-point", "500,500,0")["warnings"]
    assert len(far) == 1 and "first: 500,500,0," in far[0] and "check the unit" in far[0]
    assert not summary("geodesic", square, "--source-point", "0.5,0.5,0.5")["warnings"]


def test_a_soup_has_one_warning_of_all_its_unreached_components(summary, tmp_path):
    points = np.random.default_rng(2).normal(size=(30, 3))
    path = tmp_path / "soup.ply"
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(points, np.arange(30).reshape(-1, 3))))
    assert summary("geodesic", path, "--source", 4)["warnings"] == [
        "9 components (27 vertices; first: component 0, vertex 0) are not reached by any source; "
        "their distance is inf"
    ]


def test_components_that_meet_at_equal_positions_are_joined_by_the_repair_that_the_warning_names(
    run, summary, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    sphere = shapes.icosphere(1)
    corners = np.arange(3 * sphere.n_faces).reshape(-1, 3)
    write_mesh(
        "stl.npz", AnnotatedMesh(TriangleMesh.from_arrays(sphere.points[sphere.faces.ravel()], corners))
    )
    (warning,) = summary("geodesic", "stl.npz", "--source", 0)["warnings"]
    repair = warning.split("with ddgcli ")[1].split()
    assert run(*repair).exit_code == 0
    assert not summary("geodesic", repair[-1], "--source", 0)["warnings"]


@pytest.mark.parametrize(
    "words, message",
    [
        ([], "no source"),
        (["--source", 121], "outside 0..120"),
        (["--source", -1], "outside 0..120"),
        (["--source", 10**30], "not a vertex index"),
        (["--source", 0, "--method", "heat", "--heat-time", 1e17], "shorter --heat-time"),
        (["--source-face", f"{10**30}:1,0,0"], "not a face index"),
        (["--source", "one"], "not a vertex index"),
        (["--source-face", "999:0.2,0.3,0.5"], "face 999"),
        (["--source-face", "3:0.9,0.9,0.9"], "sum to 1"),
        (["--source-point", "1,2"], "3 numbers"),
        (["--source-point", "nan,0,0"], "not finite"),
        (["--source", 0, "--tolerance", "-1"], "less than 0"),
        (["--source", 0, "--tolerance", "0.1", "--method", "heat"], "belongs to --method exact"),
        (["--source", 0, "--heat-time", "2"], "belongs to --method heat"),
        (["--source", 0, "--target-point", "1,0,0", "--method", "heat"], "belongs to --method exact"),
        (["--source", 0, "--target-face", "999:0.2,0.3,0.5"], "face 999"),
        (["--target-face", "0:0.2,0.3,0.5"], "needs a source"),
        (["--source", 0, "--isolines", "0"], "isolines"),
        (["--source", 0, "--method", "magic"], "magic"),
        (["--certify"], "needs a source"),
    ],
)
def test_refusals_are_one_line_and_exit_2(square, run, tmp_path, words, message):
    out = tmp_path / "out.npz"
    result = run("geodesic", square, *words, "-o", out)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1
    assert not out.exists()


def test_a_source_on_an_isolated_vertex_is_refused(islands, run):
    result = run("geodesic", islands, "--source", 204)
    assert result.exit_code == 2 and "belongs to no face" in result.stderr


@pytest.mark.parametrize(
    "words", [["--source", 0], ["--source-point", "0,0,0"], ["--source-face", "0:1,0,0"]]
)
def test_a_file_without_faces_is_refused_in_one_line(run, shared_meshes, words):
    result = run("geodesic", shared_meshes / "hard" / "gen_only_points.off", *words)
    assert result.exit_code == 2 and result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1


def test_repeated_calls_give_the_same_bits(square, summary, tmp_path):
    files = [tmp_path / "a.npz", tmp_path / "b.npz"]
    for path in files:
        summary("geodesic", square, "--source", 7, 90, "-o", path)
    a, b = (np.load(path)["geodesic_distance"] for path in files)
    assert np.array_equal(a, b)


def test_the_picture_is_written(square, summary, tmp_path):
    picture = tmp_path / "bands.png"
    report = summary("geodesic", square, "--source", 0, "--plot", picture)
    assert picture.stat().st_size > 10_000 and str(picture) in report["outputs"]


@pytest.mark.parametrize("words, lines", [(["--isolines", 4], 4), ([], 12)])
def test_the_picture_has_the_requested_level_lines(square, summary, tmp_path, monkeypatch, words, lines):
    pytest.importorskip("matplotlib")
    from ddgcli.plots import array

    drawn = {}

    def draw(path, mesh, values, **how):
        Path(path).touch()
        drawn.update(how)

    monkeypatch.setattr(array, "draw_surface", draw)
    summary("geodesic", square, "--source", 0, "--path-to", 120, *words, "--plot", tmp_path / "a.png")
    radius = [np.hypot(*line.T[:2]) for line in drawn["level_lines"]]
    levels = np.sqrt(2) * np.arange(1, lines + 1) / (lines + 1)
    radii = np.sort([r.mean() for r in radius if len(r) > 4])
    assert np.abs(radii[:, None] - levels).min(axis=1).max() < 0.01 and len(radius) >= lines
    (path,) = drawn["curves"]
    assert np.ptp(path[:, 0] - path[:, 1]) < 1e-12 and drawn["limits"] == (0.0, pytest.approx(np.sqrt(2)))
