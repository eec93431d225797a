"""Every hard mesh through `curvature`: answered or refused in a line, never NaN; identities on real ones."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz.call_meshes import klein_bottle
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.degenerate_meshes import degenerate_mesh

SHARED = Path(__file__).parent.parent.parent.parent / "shared" / "meshes"
HARD = sorted(p.name for p in (SHARED / "hard").glob("*") if p.suffix not in (".md", ".json"))
REAL = [
    "spot.obj", "wingnut.obj", "plate_holes.STL", "featuretype.STL", "lego.ply", "hemisphere.off",
    "penguin_control_mesh.obj", "hand_lowres.obj", "1002_tray_bottom.STL", "menger_sponge3.off",
]  # fmt: skip


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("scheme", ["quadric", "corrected"])
def test_hard_meshes_give_results_or_refusals(run, name, scheme, tmp_path):
    out = tmp_path / "out.npz"
    result = run("curvature", SHARED / "hard" / name, "--json", "--scheme", scheme, "-o", out)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    if result.exit_code == 2:
        assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1
        assert not out.exists()
        return
    assert result.exit_code == (name == "openscad-nonmanifold-crash.obj")  # balances violated by 2%
    summary = json.loads(result.stdout)
    assert summary["accuracy"]["gauss_bonnet_residual"] < 1e-12
    with np.load(out) as arrays:
        for array in arrays:
            if arrays[array].dtype.kind == "f":
                assert np.isfinite(arrays[array]).all(), array


@pytest.mark.parametrize("name", REAL)
def test_identities_hold_on_real_meshes(summary, shared_meshes, name):
    measured = summary("curvature", shared_meshes / name, "--scheme", "cotan")
    assert measured["accuracy"]["gauss_bonnet_residual"] < 1e-12
    assert measured["accuracy"]["vertex_area_residual"] < 1e-12
    for balance in ("force", "torque", "area"):
        assert measured["accuracy"][f"{balance}_balance_residual"] < 1e-12


def test_misoriented_faces_are_turned_over_with_a_warning(caplog):
    mesh = shapes.torus(16, 8)
    some = np.random.default_rng(0).random(mesh.n_faces) < 0.3
    faces = np.where(some[:, None], mesh.faces[:, ::-1], mesh.faces)
    mixed = measure_curvature(TriangleMesh.from_arrays(mesh.points, faces), "corrected")
    plain = measure_curvature(mesh, "corrected")
    assert "turned over" in caplog.text
    assert mixed.vertex["mean_curvature"] == pytest.approx(plain.vertex["mean_curvature"])
    assert mixed.results["volume"] == pytest.approx(plain.results["volume"])


def moebius():
    u, v, faces = shapes.wrapped_grid(40, 4)
    last = u == u.max()
    join = {int(i): int(np.flatnonzero((u == 0) & np.isclose(v, 1 - v[i]))[0]) for i in np.flatnonzero(last)}
    faces = np.vectorize(lambda i: join.get(int(i), int(i)))(faces)
    w, half = 0.4 * (v - 0.5), np.pi * u
    r = 1 + w * np.cos(half)
    points = np.stack([r * np.cos(2 * half), r * np.sin(2 * half), w * np.sin(half)], axis=1)
    return TriangleMesh.from_arrays(points, faces)


def test_a_moebius_strip_has_curvature_but_no_total_mean_curvature(caplog, run):
    mesh = moebius()
    assert not mesh.topology.is_oriented
    measured = measure_curvature(mesh)
    assert measured.results["total_mean_curvature"] is None and "one-sided" in caplog.text
    assert measured.accuracy["gauss_bonnet_residual"] < 1e-13
    inner = mesh.topology.referenced_vertex & ~mesh.topology.boundary_vertex
    assert np.abs(measured.vertex["mean_curvature"][inner]).max() < 2, "no jump at the seam"
    with pytest.raises(MeshError, match="one-sided"):
        measure_curvature(mesh, "normal-cycle")


@pytest.mark.parametrize("scheme", ["quadric", "cotan"])
def test_a_one_sided_surface_does_not_depend_on_how_its_faces_are_turned(scheme, caplog):
    mesh = moebius()
    faces = np.array(mesh.faces)
    turned = np.random.default_rng(0).random(len(faces)) < 0.5
    faces[turned] = faces[turned, ::-1]
    plain, mixed = (
        measure_curvature(m, scheme) for m in (mesh, TriangleMesh.from_arrays(mesh.points, faces))
    )
    for name in ("willmore_energy", "noise_estimate", "area"):
        assert mixed.results[name] == pytest.approx(plain.results[name], rel=1e-9), name
    energies = plain.results["willmore_energies"]
    assert mixed.results["willmore_energies"] == pytest.approx(energies, rel=1e-9)
    assert energies["sullivan"] == pytest.approx(energies["cotan"], rel=0.1), "both stand for int H^2"
    inner = mesh.topology.referenced_vertex & ~mesh.topology.boundary_vertex
    mean = [np.abs(k.vertex["mean_curvature"][inner]) for k in (plain, mixed)]
    assert mean[1] == pytest.approx(mean[0], abs=1e-9), "but for the sign, which holds locally"
    assert "noise" not in caplog.text


def test_of_a_one_sided_surface_the_noise_is_stated_and_no_error(caplog):
    """Vertices and balls of the double cover are not those of the surface."""
    faces = klein_bottle(40)[1]
    u, v = (
        2 * np.pi * a.ravel() / 40 for a in np.meshgrid(np.arange(40), np.arange(40) + 0.5, indexing="ij")
    )
    x, z = np.sin(v), np.sin(2 * v)  # a figure of eight that turns by half a turn
    x, z = 3 + np.cos(u / 2) * x - np.sin(u / 2) * z, np.sin(u / 2) * x + np.cos(u / 2) * z
    points = np.column_stack([x * np.cos(u), x * np.sin(u), z])
    edge = np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).mean()
    noisy = points + 0.2 * edge * np.random.default_rng(0).normal(size=points.shape)
    clean, measured = (measure_curvature(TriangleMesh.from_arrays(p, faces)) for p in (points, noisy))
    assert clean.results["noise_estimate"] < 0.1 < measured.results["noise_estimate"] < 0.3
    assert measured.results["expected_error"] is None and "noise" not in caplog.text
    auto = measure_curvature(TriangleMesh.from_arrays(noisy, faces), radius="auto")
    assert auto.results["radius"] is None


def test_a_one_sided_surface_with_an_edge_of_three_faces_has_a_normal_at_every_vertex(caplog):
    mesh = moebius()
    a, b = mesh.topology.edges[mesh.topology.edge_face_count == 2][0]
    points = np.concatenate([mesh.points, [[0.0, 0.0, 2.0]]])
    faces = np.concatenate([mesh.faces, [[a, b, len(mesh.points)]]])
    turned = np.random.default_rng(0).random(len(faces)) < 0.5
    faces[turned] = faces[turned, ::-1]
    measured = measure_curvature(TriangleMesh.from_arrays(points, faces), "cotan")
    assert np.isfinite(measured.vertex["principal_direction_min"]).all()
    assert measured.results["willmore_energies"]["sullivan"] is None and "one-sided" in caplog.text


@pytest.mark.parametrize("scheme", ["quadric", "corrected", "normal-cycle", "normal-voting"])
def test_a_ball_that_holds_the_whole_surface_is_refused_with_a_radius_that_works(scheme, caplog):
    mesh = shapes.icosphere(2, radius=0.02)
    with pytest.raises(ParameterError, match="holds the whole surface") as error:
        measure_curvature(mesh, scheme, 1.0)
    radius = float(re.search(r"below (\S+),", str(error.value))[1])
    mean = measure_curvature(mesh, scheme, 0.99 * radius, full=False).vertex["mean_curvature"]
    assert mean == pytest.approx(50, rel=0.3)


def test_components_that_a_ball_holds_whole_are_counted(caplog):
    small, large = shapes.icosphere(1, radius=0.02), shapes.icosphere(2)
    points = np.concatenate([small.points + [3, 0, 0], large.points])
    faces = np.concatenate([small.faces, large.faces + small.n_vertices])
    measure_curvature(TriangleMesh.from_arrays(points, faces), radius=0.5)
    assert f"1 component of the surface whole ({small.n_vertices} vertices)" in caplog.text


@pytest.mark.parametrize(
    "scheme, radius, region, message",
    [
        ("normal-cycle", 0.01, "ball", "no other vertex around 642 vertices"),
        ("normal-voting", 0.01, "two rings", "no more vertices than two rings around 642 vertices"),
        ("quadric", 0.2, "two rings", "no more vertices than two rings around 642 vertices"),
    ],
)
def test_a_radius_below_the_edges_is_reported_with_one_that_works(scheme, radius, region, message, caplog):
    mesh = shapes.icosphere(3)
    results = measure_curvature(mesh, scheme, radius, full=False).results
    assert results["region"] == region and results["radius"] == (radius if region == "ball" else None)
    assert message in caplog.text
    remedy = float(re.search(r"`radius=(\S+)`", caplog.text)[1])
    caplog.clear()
    assert measure_curvature(mesh, scheme, remedy, full=False).results["region"] == "ball"
    assert not caplog.text


def test_corrected_measures_of_the_smallest_balls_are_those_of_the_star(caplog):
    mean = measure_curvature(shapes.icosphere(3), "corrected", 1e-4, full=False).vertex["mean_curvature"]
    assert mean == pytest.approx(1, rel=1e-9) and not caplog.text


def test_only_the_vertices_whose_balls_are_empty_are_counted(caplog):
    coarse, fine = shapes.icosphere(2), shapes.icosphere(4)
    points = np.concatenate([coarse.points + [3, 0, 0], fine.points])
    faces = np.concatenate([coarse.faces, fine.faces + coarse.n_vertices])
    results = measure_curvature(TriangleMesh.from_arrays(points, faces), radius=0.25, full=False).results
    assert results["region"] == "ball"
    assert f"no other vertex around {coarse.n_vertices} vertices (first: vertex 0)" in caplog.text


def test_inward_faces_cause_a_warning(caplog):
    mesh = shapes.icosphere(1)
    measure_curvature(TriangleMesh.from_arrays(mesh.points, mesh.faces[:, ::-1]))
    assert "inward" in caplog.text


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.1])
def test_folds_by_180_degrees_are_counted_and_no_volume_is_not_inward(turn, caplog):
    angle = 2 * np.pi * np.arange(12) / 12
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    flat = np.concatenate([rim, [[0.1, 0.0, 0.0], [-0.1, 0.05, 0.0]]])  # two fans joined by folds
    a, b = np.arange(12), (np.arange(12) + 1) % 12
    faces = np.concatenate([np.stack([a, b, 12 + 0 * a], 1), np.stack([b, a, 13 + 0 * a], 1)])
    cosine, sine = np.cos(turn), np.sin(turn)
    flat = flat @ np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]).T
    measured = measure_curvature(TriangleMesh.from_arrays(flat, faces))
    assert "12 edges are folded by 180 degrees" in caplog.text and "inward" not in caplog.text
    assert abs(measured.results["volume"]) < 1e-14


def test_vertices_without_faces_and_tiny_meshes():
    mesh = shapes.icosphere(1)
    points = np.concatenate([mesh.points, [[9.0, 9, 9]]])
    measured = measure_curvature(TriangleMesh.from_arrays(points, mesh.faces))
    for name in ("angle_defect", "vertex_area", "mean_curvature", "gaussian_curvature"):
        assert measured.vertex[name][-1] == 0
    one = TriangleMesh.from_arrays(np.eye(3), np.array([[0, 1, 2]]))
    tetrahedron = TriangleMesh.from_arrays(
        np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]),
        np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]),
    )
    for scheme in ("quadric", "corrected", "normal-cycle", "cotan"):
        assert np.abs(measure_curvature(one, scheme).vertex["mean_curvature"]).max() < 1e-12
        corners = measure_curvature(tetrahedron, scheme).vertex["mean_curvature"]
        assert corners == pytest.approx(np.full(4, corners[0]), rel=1e-6) and corners[0] > 0


def test_a_volume_beyond_the_range_of_numbers_is_null_with_a_warning(summary, tmp_path):
    huge = shapes.icosphere(1)
    path = tmp_path / "huge.ply"
    write_mesh(str(path), AnnotatedMesh(huge.moved(1e130 * huge.points)))
    report = summary("curvature", path)
    assert report["results"]["volume"] is None and "results.volume" in report["warnings"][-1]
    area = face_area(huge.side_length).sum()
    assert report["results"]["area"] == pytest.approx(1e260 * area, rel=1e-12)


@pytest.mark.parametrize("seed", [3001, 3055])
def test_violated_balances_are_reported_and_end_with_exit_one(run, tmp_path, seed):
    """Faces without area leave their normals to rounding; both once ended with exit 0 without a word."""
    write_mesh(str(tmp_path / "bad.npz"), AnnotatedMesh(degenerate_mesh(seed)))
    result = run("curvature", tmp_path / "bad.npz", "--json")
    summary = json.loads(result.stdout)
    assert result.exit_code == 1
    assert summary["accuracy"]["force_balance_residual"] > 1e-3
    warning = next(text for text in summary["warnings"] if text.startswith("force_balance_residual is"))
    words = shlex.split(warning[warning.index("ddgcli repair") :])
    assert words[2] == str(tmp_path / "bad.npz") and words[-2] == "-o"
    repaired = tmp_path / "repaired.npz"
    assert run("repair", *words[2:-1], repaired).exit_code == 0
    assert run("curvature", repaired).exit_code == 0  # the remedy works
