"""`ddgcli tradeoff laplacian MESH --maps`: distortion of maps to the plane against seconds."""

import json
import shlex

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


@pytest.fixture
def saddle(tmp_path):
    square = shapes.grid(7, 7, pattern="alternating")
    x, y, _ = square.points.T
    path = str(tmp_path / "saddle.ply")
    write_mesh(path, AnnotatedMesh(square.moved(np.stack([x, y, 0.8 * x * y * (1 - x)], axis=1))))
    return path


def rows_of(summary, path, *words):
    return summary("tradeoff", "laplacian", path, "--maps", "--repeat", 1, *words)["results"]["rows"]


def test_conformal_maps_of_a_plane_are_similarities_and_a_harmonic_map_to_a_disk_is_not(summary, tmp_path):
    path = str(tmp_path / "sheet.ply")
    write_mesh(path, AnnotatedMesh(shapes.grid(5, 4)))
    rows = rows_of(summary, path)
    assert {row["method"] for row in rows} == {"harmonic", "conformal", "discrete-conformal"}
    # a ratio 1 + e of singular values is computed from its half sum 1 + e^2 / 2: half of the digits
    assert all((row["max_error"] < 1e-6) == (row["method"] != "harmonic") for row in rows)
    assert all(row["mean_error"] > 0.05 for row in rows if row["method"] == "harmonic")


def test_every_row_has_the_distortion_of_its_command(summary, saddle):
    rows = rows_of(summary, saddle)
    assert len(rows) == 12 and all(row["verdict"] for row in rows)
    assert any(row["on_front"] for row in rows)
    for row in rows:
        if "subdivide" in row["parameters"]:
            continue
        _, command, *words = shlex.split(row["command"])
        distortion = summary(command, *words)["results"]["conformal_distortion"]
        assert distortion["max"] - 1 == pytest.approx(row["max_error"], rel=1e-9)
    # more unknowns: nearer to the conformal map of the same surface
    mean = {
        (row["method"], row["parameters"].get("subdivide", 0)): row["mean_error"]
        for row in rows
        if row["parameters"]["operator"] == "intrinsic-delaunay"
    }
    assert mean["conformal", 1] < 0.7 * mean["conformal", 0]
    assert mean["discrete-conformal", 1] < 0.7 * mean["discrete-conformal", 0]


def test_operators_and_subdivisions_restrict_the_rows(summary, run, saddle, tmp_path):
    rows = rows_of(summary, saddle, "--operator", "cotan", "--subdivide", 1)
    assert [row["parameters"] for row in rows] == 3 * [{"operator": "cotan", "subdivide": 1}]
    table = tmp_path / "rows.json"
    result = run("tradeoff", "laplacian", saddle, "--maps", "--repeat", 1, "--within", 1e-9, "-o", table)
    assert result.exit_code == 1 and json.loads(table.read_text())["chosen"] is None


@pytest.mark.parametrize(
    "words, message",
    [
        (("--eigen", 3), "--eigen changes nothing that --maps compares; it takes --operator"),
        (("--mass", "voronoi"), "--mass changes nothing"),
        (
            ("--operator", "tufted"),
            "--operator: tufted defines no map; compare intrinsic-delaunay and cotan",
        ),
        (("--truth", "plane"), "--truth: maps are compared with conformal ones"),
    ],
)
def test_what_does_not_affect_maps_is_refused_in_one_line(run, saddle, words, message):
    result = run("tradeoff", "laplacian", saddle, "--maps", *words)
    assert result.exit_code == 2 and message in result.stderr and result.stderr.count("\n") == 1


def test_maps_need_a_boundary_and_the_command_laplacian(run, saddle, tmp_path):
    closed = str(tmp_path / "ball.ply")
    write_mesh(closed, AnnotatedMesh(shapes.icosphere(1)))
    result = run("tradeoff", "laplacian", closed, "--maps")
    assert result.exit_code == 2 and "is closed" in result.stderr and result.stderr.count("\n") == 1
    result = run("tradeoff", "curvature", saddle, "--maps")
    assert result.exit_code == 2 and "--maps: compares maps of laplacian" in result.stderr
