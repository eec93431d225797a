"""`ddgcli geodesic`: edge sources, distance matrices, Voronoi regions, signed distance, fan, vertex types."""

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.algorithms.geodesics import voronoi
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh

MESH = shapes.grid(8, 8, pattern="alternating")
MIDDLE = 40  # of 9 x 9 vertices, number 9 i + j


@pytest.fixture
def square(tmp_path):
    """Unit square of 8 x 8 cells with an array of labels on its faces."""
    path = tmp_path / "square.vtu"
    inside = (np.abs(MESH.points[MESH.faces].mean(axis=1)[:, :2] - 0.5) < 0.25).all(axis=1)
    write_mesh(str(path), AnnotatedMesh(MESH, face={"label": inside.astype(np.int64)}))
    return path


def test_source_boundary_gives_the_distance_to_the_nearest_side(square, summary, tmp_path):
    report = summary("geodesic", square, "--source-boundary", "--path-to", MIDDLE, "-o", tmp_path / "d.npz")
    x, y = MESH.points[:, :2].T
    arrays = np.load(tmp_path / "d.npz")
    truth = np.minimum.reduce([x, 1 - x, y, 1 - y])
    assert np.abs(arrays["geodesic_distance"] - truth).max() < 1e-14
    assert report["results"]["sources"][0]["edges"] == 32 and report["results"]["sources"][0]["closed"]
    assert report["results"]["paths"][0]["length"] == pytest.approx(0.5, rel=1e-12)
    library = ddg.geodesic_distance(MESH, source_edges=MESH.topology.edges[MESH.topology.boundary_edges])
    assert np.array_equal(library, arrays["geodesic_distance"])


@pytest.mark.parametrize("kind", ["array", "pairs", "polyline"])
def test_source_edges_are_an_array_pairs_or_polylines(square, summary, tmp_path, kind):
    column = 36 + np.arange(9)
    pairs = np.stack([column[:-1], column[1:]], axis=1)
    name, truth = "label", None
    if kind != "array":
        truth = np.abs(MESH.points[:, 0] - 0.5)
    if kind == "pairs":
        name = tmp_path / "pairs.csv"
        np.savetxt(name, pairs, fmt="%d", delimiter=",")
    if kind == "polyline":
        name = tmp_path / "line.vtp"
        write_mesh(str(name), AnnotatedMesh(CurveSet.from_paths([MESH.points[column]])))
    report = summary("geodesic", square, "--source-edges", name, "--voronoi", "-o", tmp_path / "d.npz")
    arrays = np.load(tmp_path / "d.npz")
    distance = arrays["geodesic_distance"]
    if truth is None:
        assert distance[MIDDLE] == pytest.approx(0.25) and report["results"]["sources"][0]["edges"] == 16
    else:
        assert np.abs(distance - truth).max() < 1e-15
    assert (arrays["region"] == 0).all() and report["results"]["regions"][0]["area"] == pytest.approx(1)


def test_regions_and_distances_come_from_one_propagation(square, summary, tmp_path, monkeypatch):
    """The command ran the wavefront twice: 3.8 s for 2.3 s on 50,000 vertices."""
    expected = voronoi.voronoi_regions(MESH, Sources.at((0, 40, 77)))
    monkeypatch.setattr(voronoi, "exact_distance", None)
    words = ["geodesic", square, "--source", "0,40,77", "--voronoi", "-o", tmp_path / "d.npz"]
    report = summary(*words, "--target-face", "5:0.5,0.25,0.25")
    assert np.array_equal(np.load(tmp_path / "d.npz")["region"], expected)
    assert len(report["results"]["targets"]) == 1
    areas = [region["area"] for region in report["results"]["regions"]]
    assert sum(areas) == pytest.approx(1) and min(areas) > 0.1


@pytest.mark.parametrize("suffix, separator", [(".csv", ","), (".txt", " ")])
def test_a_file_of_one_pair_is_one_edge(square, summary, tmp_path, suffix, separator):
    path = (tmp_path / "pair").with_suffix(suffix)
    path.write_text(separator.join(["40", "41"]) + "\n")
    report = summary("geodesic", square, "--source-edges", path)
    assert report["results"]["sources"][0]["edges"] == 1
    assert report["results"]["sources"][0]["length"] == pytest.approx(0.125)


def test_signed_distance_needs_no_source(square, summary, tmp_path):
    report = summary(
        "geodesic", square, "--signed-distance", "label", "--vertex-types", "-o", tmp_path / "d.npz"
    )
    arrays = np.load(tmp_path / "d.npz")
    assert "geodesic_distance" not in arrays
    assert arrays["signed_distance"][[MIDDLE, 36]] == pytest.approx([-0.25, 0.25])
    assert report["results"]["signed_distance"]["method"] == "exact"
    types = {"spherical": 0, "euclidean": 49, "hyperbolic": 0, "boundary": 32}
    assert report["results"]["vertex_types"] == types
    heat = summary("geodesic", square, "--signed-distance", "label", "--method", "heat")
    assert heat["results"]["signed_distance"]["method"] == "heat"


def test_a_broken_curve_has_a_signed_distance_by_heat(square, summary, tmp_path):
    pairs = np.array([[38, 39], [39, 40], [40, 41]])
    np.save(tmp_path / "pairs.npy", pairs)
    report = summary(
        "geodesic", square, "--signed-distance", tmp_path / "pairs.npy", "-o", tmp_path / "d.npz"
    )
    assert report["results"]["signed_distance"]["method"] == "heat"
    assert any("signed heat method" in warning for warning in report["warnings"])
    signed = np.load(tmp_path / "d.npz")["signed_distance"]
    assert signed[31] < 0 < signed[49], "negative on the left: at smaller x, as the curve runs along +y"
    assert np.array_equal(ddg.signed_distance(MESH, pairs), signed)


def test_a_distance_matrix_has_the_rows_of_the_sources(square, summary, tmp_path):
    out = tmp_path / "matrix.npz"
    report = summary("geodesic", square, "--source", 0, 80, "--target", "0,8", "80", "--distance-matrix", out)
    arrays = np.load(out)
    assert arrays["sources"].tolist() == [0, 80] and arrays["targets"].tolist() == [0, 8, 80]
    diagonal = np.sqrt(2)
    assert np.abs(arrays["distance"] - [[0, 1, diagonal], [diagonal, 1, 0]]).max() < 1e-15
    assert report["accuracy"]["matrix_symmetry_residual"] < 1e-15
    assert np.array_equal(ddg.distance_matrix(MESH, [0, 80], [0, 8, 80]), arrays["distance"])
    assert str(out) in report["outputs"]


def test_the_fan_goes_to_the_paths_output_with_its_levels(square, summary, tmp_path):
    out = tmp_path / "fan.npz"
    report = summary(
        "geodesic", square, "--source", MIDDLE, "--fan", 16, "--fan-length", 0.4, "--fan-circles", 4,
        "--paths-output", out,
    )  # fmt: skip
    arrays = np.load(out)
    gap = np.linalg.norm(arrays["points"] - MESH.points[MIDDLE], axis=1)
    assert np.abs(gap - arrays["level"]).max() < 1e-14 and not arrays["caustic"].any()
    assert len(np.unique(arrays["path_id"])) == 20
    fan = report["results"]["fan"]
    levels = [round(circle["level"], 9) for circle in fan["circles"]]
    assert fan["rays"] == 16 and levels == [0.1, 0.2, 0.3, 0.4]
    assert "paths" not in report["results"]


@pytest.mark.parametrize(
    "words, text",
    [
        (("--source", 0, "--fan", 8), "--fan: needs --fan-length"),
        (("--source", 0, "--fan-length", 1), "--fan-length: needs --fan"),
        (("--fan", 8, "--fan-length", 1), "--fan: needs a source"),
        (("--source", 0, 5, "--fan", 8, "--fan-length", 1), "exactly one source"),
        (("--source", 0, "--fan-circles", 3), "--fan-circles: belongs to --fan"),
        (("--source", 0, "--target", 3), "--target: needs --distance-matrix"),
        (("--source", 0, "--distance-matrix", "m.npz"), "--distance-matrix: needs --target"),
        (("--source", 0, "--jobs", 2), "--jobs: is for the distances"),
        (("--voronoi",), "--voronoi: needs a source"),
        (("--source", 0, "--voronoi", "--method", "heat"), "--voronoi: belongs to --method exact"),
        (("--signed-distance", "label", "--method", "dijkstra"), "--signed-distance: has no method dijkstra"),
        (("--source-edges", "label", "--tolerance", 0.1), "--tolerance: needs sources at vertices"),
        (("--source-boundary", "--log-map"), "--log-map: starts at vertices or points"),
        (("--source-edges", "nothing"), "--source-edges: no array 'nothing'"),
        (("--source", 0, "--target", 5000, "--distance-matrix", "m.npz"), "5000 is outside 0..80"),
        (("--source-boundary", "--target", 5, "--distance-matrix", "m.npz"), "source vertices only"),
        (("--source", 0, "--paths-output", "lines.vtp"), "--paths-output: has no curves"),
    ],
)
def test_wrong_calls_end_in_one_line(square, run, words, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("geodesic", square, *words)
    assert result.exit_code == 2 and text in result.stderr and len(result.stderr.strip().split("\n")) == 1
    assert not (tmp_path / "m.npz").exists()


@pytest.mark.parametrize("method", ["exact", "heat"])
def test_distances_of_each_source_are_the_same_bits_for_any_number_of_jobs(square, summary, tmp_path, method):
    arrays = []
    for jobs in (1, 2):
        path = tmp_path / f"{jobs}.npz"
        words = ("--source", "0,9,40", "--each-source", "--method", method, "--jobs", jobs, "-o", path)
        summary("geodesic", square, *words)
        arrays.append(np.load(path))
    names = [name for name in arrays[0] if name.startswith("geodesic_distance_")]
    assert len(names) == 3
    assert all(np.array_equal(arrays[0][name], arrays[1][name]) for name in names)


def test_isolines_without_a_source_are_those_of_the_signed_distance(summary, tmp_path):
    write_mesh(str(tmp_path / "m.ply"), AnnotatedMesh(shapes.grid(10, 10)))
    mesh = read_mesh(str(tmp_path / "m.ply")).surface
    middle = np.flatnonzero(np.isclose(mesh.points[:, 0], mesh.points[:, 0].mean()))
    middle = middle[np.argsort(mesh.points[middle, 1])]
    np.savetxt(tmp_path / "c.csv", np.stack([middle[:-1], middle[1:]], axis=1), fmt="%d", delimiter=",")
    words = ("--signed-distance", tmp_path / "c.csv", "--isolines", 3, "--paths-output", tmp_path / "l.vtp")
    report = summary("geodesic", tmp_path / "m.ply", *words)
    width = np.ptp(mesh.points[:, 0])
    levels = [path["level"] for path in report["results"]["paths"]]
    assert np.allclose(levels, np.array([-0.25, 0.0, 0.25]) * width, atol=0.03 * width)


@pytest.mark.parametrize("words", [("--fan", 12, "--fan-length", 1), ("--method", "heat")])
def test_a_mesh_whose_vertices_coincide_is_refused_with_a_remedy(words, run, tmp_path):
    mesh = shapes.grid(2, 2)
    write_mesh(str(tmp_path / "m.ply"), AnnotatedMesh(mesh.moved_unchecked(0.0 * mesh.points)))
    files = ("--paths-output", tmp_path / "l.vtp") if "--fan" in words else ("-o", tmp_path / "o.npz")
    result = run("geodesic", tmp_path / "m.ply", "--source", 1, *words, *files)
    assert result.exit_code == 2 and "every vertex is at the same place" in result.stderr
    assert len(result.stderr.strip().split("\n")) == 1
