"""`ddgcli curvature` from file to file."""

import json

import numpy as np
import pytest

from ddgcli.algorithms.curvature import totals
from ddgcli.algorithms.curvature.surface_curvature import DEFAULT_SCHEME, SCHEME_PROMISES
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.cli.test_command_group import refused

VERTEX = {
    "angle_defect", "vertex_area", "gaussian_curvature", "geodesic_curvature", "mean_curvature",
    "mean_curvature_normal", "principal_curvature_min", "principal_curvature_max",
    "principal_direction_min", "principal_direction_max", "boundary",
}  # fmt: skip
EDGE = {"edges", "dihedral_angle", "edge_mean_curvature"}
RESULTS = {
    "area", "volume", "total_gaussian_curvature", "total_geodesic_curvature", "total_mean_curvature",
    "willmore_energy", "intrinsic_volumes", "steiner_polynomial", "vector_area",
}  # fmt: skip


@pytest.fixture
def torus(tmp_path):
    path = str(tmp_path / "torus.ply")
    write_mesh(path, AnnotatedMesh(shapes.torus(24, 12)))
    return path


def test_every_array_and_result_of_the_contract_is_there(summary, torus, tmp_path):
    out = str(tmp_path / "out.npz")
    s = summary("curvature", torus, "-o", out)
    assert set(s["results"]) >= RESULTS | (VERTEX - {"boundary", "geodesic_curvature"}) - {
        "principal_direction_min",
        "principal_direction_max",
    }
    assert set(s["accuracy"]) >= {"gauss_bonnet_residual", "force_balance_residual"}
    assert (
        s["results"]["scheme"] == DEFAULT_SCHEME
        and s["results"]["promise"] == SCHEME_PROMISES[DEFAULT_SCHEME]
    )
    with np.load(out) as arrays:
        assert set(arrays) >= VERTEX | EDGE | {"points", "faces"}
        assert arrays["principal_direction_min"].shape == (288, 3)
        assert len(arrays["edges"]) == len(arrays["dihedral_angle"]) == 864
        mean_curvature = arrays["mean_curvature"]
    assert s["results"]["mean_curvature"] == pytest.approx(
        {"min": mean_curvature.min(), "max": mean_curvature.max(), "mean": mean_curvature.mean()}
    )


@pytest.mark.parametrize("extension", ["ply", "vtu", "vtp", "vtkhdf"])
def test_arrays_keep_their_names_and_values_in_other_formats(run, torus, tmp_path, extension):
    out = str(tmp_path / f"out.{extension}")
    assert run("curvature", torus, "-o", out).exit_code == 0
    back = read_mesh(out)
    assert set(back.vertex) >= VERTEX
    assert back.vertex["mean_curvature"].shape == (288,)
    assert back.vertex["principal_direction_max"].shape == (288, 3)


def test_schemes_differ_and_angle_defects_do_not(summary, torus, tmp_path):
    by_scheme = {}
    for scheme in SCHEME_PROMISES:
        out = str(tmp_path / f"{scheme}.npz")
        r = summary("curvature", torus, "--scheme", scheme, "-o", out)["results"]
        assert r["scheme"] == scheme and r["promise"] == SCHEME_PROMISES[scheme]
        with np.load(out) as arrays:
            by_scheme[scheme] = {
                name: arrays[name] for name in ("angle_defect", "mean_curvature", "vertex_area")
            }
    first = by_scheme["cotan"]
    for scheme in ("quadric", "corrected", "normal-cycle"):
        assert (by_scheme[scheme]["angle_defect"] == first["angle_defect"]).all()
        assert (by_scheme[scheme]["mean_curvature"] != first["mean_curvature"]).any()


def test_statistics_leave_the_boundary_out(summary, tmp_path):
    path = str(tmp_path / "cylinder.ply")
    write_mesh(path, AnnotatedMesh(shapes.cylinder(40, 20)))
    r = summary("curvature", path, "--scheme", "cotan")["results"]
    assert r["volume"] is None and r["steiner_polynomial"] is None
    assert r["mean_curvature"]["min"] == pytest.approx(r["mean_curvature"]["max"])
    assert r["geodesic_curvature"]["max"] < 1e-12 and r["total_geodesic_curvature"] == pytest.approx(
        0, abs=1e-9
    )


def test_a_map_of_the_input_is_measured(summary, run, tmp_path):
    mesh = shapes.grid(6, 6)
    path = str(tmp_path / "grid.npz")
    write_mesh(path, AnnotatedMesh(mesh, vertex={"uv": mesh.points[:, :2] * [2.0, 1.0]}))
    assert summary("curvature", path, "--map", "uv")["results"]["nonconformality"] == pytest.approx(0.5)
    refused = run("curvature", path, "--map", "st")
    assert refused.exit_code == 2 and "uv" in refused.stderr and refused.stderr.count("\n") == 1


@pytest.mark.parametrize("extension", ["png", "svg", "pdf"])
def test_pictures_are_written(run, torus, tmp_path, extension):
    picture = tmp_path / f"out.{extension}"
    words = ("curvature", torus, "--plot", picture, "--show", "gaussian_curvature", "--view", "30,20:y")
    assert run(*words).exit_code == 0
    assert picture.stat().st_size > 5000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--show", "nothing", "--plot", "a.png"), "mean_curvature"),
        (("--view", "sideways"), "ELEVATION"),
        (("--view", "95,10"), "beyond 90 degrees"),
        (("--radius", "0"), "greater than 0"),
        (("--radius", "1", "--scheme", "cotan"), "takes no radius"),
        (("--scheme", "best"), "quadric"),
        (("--show", "boundary"), "--plot"),
        (("--view", "iso"), "--plot"),
    ],
)
def test_refusals_are_one_line_and_leave_no_file(run, torus, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    result = run("curvature", torus, "-o", "out.npz", *words)
    assert result.exit_code == 2 and message in result.stderr
    assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("words", [("--scheme", "quadric"), ("--radius", 2), ("--map", "uv")])
def test_options_of_surfaces_are_refused_for_curves(run, tmp_path, words):
    (tmp_path / "a.csv").write_text("0,0\n1,0\n1,1\n")
    result = run("curvature", tmp_path / "a.csv", *words)
    assert result.exit_code == 2 and f"{words[0]} is for surfaces" in result.stderr
    assert run("curvature", tmp_path / "a.csv").exit_code == 0


def test_the_command_accepts_curves(summary, tmp_path):
    t = 2 * np.pi * np.arange(61) / 60
    rows = np.stack([np.cos(t), np.sin(t)], axis=1)
    rows[-1] = rows[0]
    path = tmp_path / "circle.csv"
    np.savetxt(path, rows, delimiter=",")
    out, picture = tmp_path / "out.npz", tmp_path / "out.png"
    s = summary("curvature", path, "-o", out, "--plot", picture)
    assert s["results"]["turning_number"] == 1
    assert s["results"]["length"] == pytest.approx(2 * np.pi, rel=1e-3)
    assert s["accuracy"]["turning_number_residual"] < 1e-14
    with np.load(out) as arrays:
        assert {"turning_angle", "curvature", "vertex_length", "lines"} <= set(arrays)
    np.savetxt(path, np.stack([np.cos(3 * t), np.sin(3 * t), t], axis=1), delimiter=",")
    s = summary("curvature", path, "-o", out)
    assert s["results"]["turning_number"] is None and s["results"]["total_curvature"] > 0
    with np.load(out) as arrays:
        assert "torsion" in arrays


def test_the_same_call_gives_the_same_bytes(run, torus, tmp_path):
    a = json.loads(run("curvature", torus, "--json").stdout)
    b = json.loads(run("curvature", torus, "--json").stdout)
    assert a["results"] == b["results"] and a["accuracy"] == b["accuracy"]


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--radius", 0.4),
        *(("--scheme", name, "--radius", 0.4) for name in ("corrected", "normal-cycle", "normal-voting")),
    ],
)
def test_blocks_are_the_same_bits_for_any_number_of_jobs(options, run, torus, tmp_path):
    arrays = []
    for jobs in (1, 3):
        result = run("curvature", torus, *options, "--jobs", jobs, "-o", tmp_path / f"{jobs}.npz")
        assert result.exit_code == 0, result.stderr
        arrays.append(np.load(tmp_path / f"{jobs}.npz"))
    assert all(np.array_equal(arrays[0][name], arrays[1][name]) for name in VERTEX)


@pytest.mark.parametrize("options", [("--scheme", "cotan"), ("--scheme", "corrected")])
def test_jobs_are_refused_where_there_are_no_blocks(options, run, torus):
    refusal = run("curvature", torus, "--jobs", 2, *options)
    assert refusal.exit_code == 2
    assert "--jobs: is for --scheme quadric and for balls of a --radius" in refusal.stderr


def test_options_for_surfaces_are_refused_together_for_a_curve(run, tmp_path):
    curve = tmp_path / "curve.csv"
    curve.write_text("0,0\n1,0\n1,1\n0,0\n")
    words = ("--offset", 0.1, "--offset-output", tmp_path / "o.ply")
    # the second needs the first: leaving out one of them only would be refused again
    refused(
        run("curvature", curve, *words), "--offset and --offset-output are for surfaces", "leave them out"
    )
    refused(run("curvature", curve, "--jobs", 2), "--jobs is for surfaces", "leave it out")


def test_energies_are_computed_where_the_summary_has_them(run, torus, tmp_path, monkeypatch):
    calls = []
    energies = totals.willmore_energies
    monkeypatch.setattr(totals, "willmore_energies", lambda *a: calls.append(1) or energies(*a))
    for options, count in (((), 0), (("-o", str(tmp_path / "a.vtu")), 0), (("--full",), 1), (("--json",), 1)):
        calls.clear()
        assert run("curvature", torus, *options).exit_code == 0
        assert len(calls) == count
