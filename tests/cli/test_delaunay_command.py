"""`ddgcli delaunay` from file to file."""

import json

import numpy as np
import pytest

from ddgcli.algorithms.delaunay import triangulation_statistics
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import stiffness
from tests.delaunay_cases import planar, sharp_cone
from tests.delaunay_cases import stretched as stretched_sphere


@pytest.fixture
def stretched(tmp_path):
    mesh = shapes.random_sphere(200, seed=1)
    path = tmp_path / "stretched.ply"
    write_mesh(str(path), AnnotatedMesh(mesh.moved(mesh.points * np.array([10.0, 1.0, 0.1]))))
    return path


def test_no_edge_is_non_delaunay_after_the_flips(summary, stretched, tmp_path):
    out, overlay = tmp_path / "idt.npz", tmp_path / "overlay.ply"
    report = summary("delaunay", stretched, "-o", out, "--overlay", overlay, "--condition")
    before, after = report["results"]["before"], report["results"]["after"]
    assert report["results"]["flips"] > 0 and report["results"]["steiner_points"] == 0
    assert before["non_delaunay_edges"] > 0 and after["non_delaunay_edges"] == 0
    assert before["negative_cotan_edges"] == before["non_delaunay_edges"]  # closed
    assert after["negative_cotan_edges"] == 0
    assert after["min_angle_degrees"] >= before["min_angle_degrees"]
    assert after["laplacian_condition"] < before["laplacian_condition"]
    assert after["dirichlet_energy"] < before["dirichlet_energy"]
    assert report["accuracy"]["area_residual"] < 1e-12
    assert report["accuracy"]["angle_defect_residual"] < 1e-11
    assert report["outputs"] == [str(out), str(overlay)]

    z = np.load(out)
    faces, length, neighbors = z["faces"], z["face_edge_lengths"], z["neighbors"]
    assert faces.shape == length.shape == neighbors.shape[:2]
    f, s = neighbors[..., 0], neighbors[..., 1]
    k, j = np.meshgrid(np.arange(len(faces)), np.arange(3), indexing="ij")
    assert np.array_equal(neighbors[f, s], np.stack([k, j], axis=-1))
    assert np.array_equal(length[f, s], length)
    assert np.array_equal(faces[f, s], faces[k, (j + 1) % 3])
    assert np.array_equal(z["points"], read_mesh(str(stretched)).mesh.points)

    common = read_mesh(str(overlay))
    assert set(common.vertex["vertex_kind"]) == {0, 2}
    assert common.face["input_face"].max() == common.face["intrinsic_face"].max() == len(faces) - 1


def statistics_of(faces, length, neighbors):
    """Counts and angles of a triangulation, report from its file alone."""
    longest = length.astype(np.longdouble)
    a, b, c = longest, np.roll(longest, -1, axis=1), np.roll(longest, 1, axis=1)
    angle = np.degrees(np.arccos((b**2 + c**2 - a**2) / (2 * b * c)))  # opposite side j
    sides = [(f, j) for f in range(len(faces)) for j in range(3)]
    other = {(f, j): tuple(int(x) for x in neighbors[f, j]) for f, j in sides}
    edges = [side for side in sides if other[side][0] < 0 or side <= other[side]]
    ends = [tuple(sorted((int(faces[f, j]), int(faces[f, (j + 1) % 3])))) for f, j in edges]
    inner = [(angle[s] + angle[other[s]], s) for s in edges if other[s][0] >= 0]
    return {
        "non_delaunay_edges": sum(1 for total, _ in inner if total > 180 + 1e-7),
        "negative_cotan_edges": sum(1 for total, _ in inner if total > 180 + 1e-7)
        + sum(1 for s in edges if other[s][0] < 0 and angle[s] > 90 + 1e-7),
        "min_angle_degrees": pytest.approx(float(angle.min()), rel=1e-9),
        "max_angle_degrees": pytest.approx(float(angle.max()), rel=1e-9),
        "self_edges": sum(1 for v, w in ends if v == w),
        "multi_edges": sum(1 for pair in ends if pair[0] != pair[1] and ends.count(pair) > 1),
    }


@pytest.mark.parametrize("make", [lambda: stretched_sphere(150), sharp_cone, lambda: planar(n=60)])
def test_statistics_are_those_of_the_file(summary, tmp_path, make):
    mesh, path, out = make(), tmp_path / "in.npz", tmp_path / "out.npz"
    write_mesh(str(path), AnnotatedMesh(mesh))
    results = summary("delaunay", path, "-o", out)["results"]
    z, twin = np.load(out), mesh.topology.side_twin.reshape(-1, 3)
    gluing = np.stack([np.where(twin < 0, -1, twin // 3), np.where(twin < 0, -1, twin % 3)], axis=-1)
    for report, numbers in (
        (results["before"], (mesh.faces, mesh.side_length, gluing)),
        (results["after"], (z["faces"], z["face_edge_lengths"], z["neighbors"])),
    ):
        assert {name: report[name] for name in statistics_of(*numbers)} == statistics_of(*numbers)


def test_three_kites_need_three_flips(summary, tmp_path):
    kite = np.array([[0, 0, 0], [2, -0.3, 0], [4, 0, 0], [2, 0.3, 0]])
    points = np.concatenate([kite + [0, 3 * k, 0] for k in range(3)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(3)])
    path = tmp_path / "kites.npz"
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(points, faces)))
    results = summary("delaunay", path)["results"]
    assert results["flips"] == results["before"]["non_delaunay_edges"] == 3


@pytest.mark.parametrize("words", [(), ("--refine", 25)])
def test_labels_in_the_overlay_file(summary, stretched, tmp_path, words):
    out, overlay = tmp_path / "out.npz", tmp_path / "overlay.npz"
    results = summary("delaunay", stretched, *words, "-o", out, "--overlay", overlay)["results"]
    mesh, z, cut = read_mesh(str(stretched)).mesh, np.load(out), np.load(overlay)
    whole = face_area(TriangleMesh.from_arrays(cut["points"], cut["faces"]).side_length)
    for label, length in (("input_face", mesh.side_length), ("intrinsic_face", z["face_edge_lengths"])):
        pieces = np.bincount(cut[label], whole, minlength=len(length))
        np.testing.assert_allclose(pieces, face_area(length), atol=1e-9 * whole.sum())
    n, steiner = mesh.n_vertices, len(z["points"]) - mesh.n_vertices
    kind = cut["vertex_kind"]
    counts = {"input_vertices": n, "steiner_points": steiner, "crossings": (kind == 2).sum()}
    assert [(kind == k).sum() for k in (0, 1)] == [n, steiner]
    assert results["overlay"] == counts | {"faces": len(cut["faces"])}
    for k, expected in ((0, mesh.points), (1, z["points"][n:])):
        arrays = cut["points"][kind == k]
        np.testing.assert_allclose(arrays[np.lexsort(arrays.T)], expected[np.lexsort(expected.T)], atol=1e-14)


@pytest.mark.parametrize("name", ["stretched", "sharp cone"])
def test_files_hold_the_whole_triangulation(summary, tmp_path, name):
    """Faces, lengths and gluing read back give the very Laplacian; loops and all (the cone has one)."""
    mesh = {"stretched": stretched_sphere, "sharp cone": sharp_cone}[name]()
    path, files = tmp_path / "in.npz", [tmp_path / "idt.npz", tmp_path / "idt.vtkhdf"]
    write_mesh(str(path), AnnotatedMesh(mesh))
    summary("delaunay", path, "-o", files[0], "-o", files[1])
    expected = stiffness(flip_to_delaunay(mesh).mesh)
    for file in files:
        source = read_mesh(str(file))
        neighbors, length = source.face["neighbors"], source.face["face_edge_lengths"]
        gluing = np.where(neighbors[..., 0] >= 0, 3 * neighbors[..., 0] + neighbors[..., 1], -1)
        topology = Topology(source.mesh.faces, source.mesh.n_vertices, gluing.astype(np.int64))
        assert (stiffness(IntrinsicMesh(topology, length)) != expected).nnz == 0
        assert any("intrinsic triangulation" in word for word in summary("info", file)["warnings"])


def test_a_condition_that_cannot_be_measured_is_null(summary, tmp_path):
    path = tmp_path / "needle.npz"  # the eigenvalues of a needle of aspect 1e9 differ by 1e18
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1e-9, 0]])
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(points, np.array([[0, 1, 2]]))))
    report = summary("delaunay", path, "--condition")
    assert report["results"]["before"]["laplacian_condition"] is None
    assert any("results.before.laplacian_condition" in warning for warning in report["warnings"])


def test_a_picture_is_written(run, stretched, tmp_path):
    picture = tmp_path / "edges.png"
    assert run("delaunay", stretched, "--plot", picture).exit_code == 0
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("name, words", [("gen_book_edge.ply", "more than two faces")])
def test_wrong_inputs_are_refused_in_one_line(run, shared_meshes, name, words):
    result = run("delaunay", shared_meshes / "hard" / name)
    assert result.exit_code == 2
    assert words in result.stderr and result.stderr.count("\n") == 1


def test_points_without_faces_are_not_sent_to_an_operator_that_needs_faces_too(run, tmp_path):
    path = tmp_path / "point.off"
    path.write_text("OFF\n1 0 0\n0 0 0\n")
    for command in ("delaunay", "laplacian"):
        result = run(command, path)
        assert result.exit_code == 2 and "no triangles" in result.stderr and "tufted" not in result.stderr


def test_a_format_that_cannot_hold_it_is_refused_before_any_work(run, stretched, tmp_path):
    result = run("delaunay", stretched, "-o", tmp_path / "idt.obj")
    assert result.exit_code == 2 and ".npz" in result.stderr
    assert not (tmp_path / "idt.obj").exists()


def test_refinement_reaches_its_angle_and_counts_its_points(summary, stretched, tmp_path):
    out, overlay = tmp_path / "fine.npz", tmp_path / "overlay.vtu"
    report = summary("delaunay", stretched, "--refine", 25, "-o", out, "--overlay", overlay)
    results = report["results"]
    assert results["steiner_points"] == len(np.load(out)["points"]) - 200 > 0
    assert results["after"]["min_angle_degrees"] > 24.999
    assert results["overlay"]["steiner_points"] == results["steiner_points"]
    assert report["accuracy"]["overlay_length_residual"] < 1e-9
    assert set(read_mesh(str(overlay)).vertex["vertex_kind"]) == {0, 1, 2}
    z, mesh = np.load(out), read_mesh(str(stretched)).mesh
    where = np.einsum("kc,kcd->kd", z["input_barycentric"], mesh.points[mesh.faces[z["input_face"]]])
    assert np.abs(where - z["points"]).max() < 1e-13 * np.abs(z["points"]).max()


@pytest.fixture
def plane(tmp_path):
    """A flat patch with needles, and on its vertices a linear and a rough function."""
    mesh = planar()
    height = mesh.points @ [2.0, -3.0, 0.0] + 1.0
    arrays = {"height": height, "rough": np.random.default_rng(0).normal(size=(mesh.n_vertices, 2))}
    path = tmp_path / "plane.npz"
    write_mesh(str(path), AnnotatedMesh(mesh, vertex=arrays))
    return path


@pytest.mark.parametrize("refine", [(), ("--refine", 25)])
def test_functions_are_transferred_to_the_triangulation(summary, plane, tmp_path, refine):
    out, overlay = tmp_path / "idt.npz", tmp_path / "overlay.npz"
    carry = ("--transfer", "height", "--transfer", "rough")
    report = summary("delaunay", plane, *refine, *carry, "-o", out, "--overlay", overlay)
    z, cut, mesh = np.load(out), np.load(overlay), read_mesh(str(plane))
    for arrays in (z, cut):  # linear functions of the plane arrive unchanged
        assert np.abs(arrays["height"] - (arrays["points"] @ [2.0, -3.0, 0.0] + 1.0)).max() < 1e-9
    change = {name: one["l2_change"] for name, one in report["results"]["transfer"].items()}
    assert change["height"] < 1e-10 and change["rough"] > 0.01
    assert report["accuracy"]["transfer_integral_residual"] < 1e-12

    def integral(points, faces, values):
        corner = points[faces]
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
        return area @ values[faces].mean(axis=1)

    integral_before = integral(mesh.mesh.points, mesh.mesh.faces, mesh.vertex["rough"])
    for arrays in (z, cut):
        assert integral(arrays["points"], arrays["faces"], arrays["rough"]) == pytest.approx(
            integral_before, abs=1e-12
        )


@pytest.mark.parametrize("refine", [(), ("--refine", 25)])
def test_functions_are_transferred_without_an_overlay(summary, plane, tmp_path, refine):
    out, beside = tmp_path / "idt.npz", tmp_path / "beside.npz"
    report = summary("delaunay", plane, *refine, "--transfer", "rough", "-o", out)
    summary("delaunay", plane, *refine, "--transfer", "rough", "-o", beside, "--overlay", tmp_path / "o.npz")
    assert report["results"]["transfer"]["rough"]["l2_change"] > 0.01
    assert np.array_equal(np.load(out)["rough"], np.load(beside)["rough"])


@pytest.mark.parametrize(
    "name, words", [("warmth", "height, rough"), ("input_face", "rename"), ("torn", "vertex 3")]
)
def test_functions_that_cannot_be_transferred_are_refused(run, tmp_path, name, words):
    mesh = planar()
    torn = np.where(np.arange(mesh.n_vertices) == 3, np.nan, 0.0)
    arrays = {"height": 1 + torn, "rough": torn, "input_face": 0 * torn, "torn": torn}
    if name == "warmth":
        arrays = {"height": arrays["height"], "rough": arrays["rough"]}
    write_mesh(str(tmp_path / "plane.npz"), AnnotatedMesh(mesh, vertex=arrays))
    result = run("delaunay", tmp_path / "plane.npz", "--transfer", name)
    assert result.exit_code == 2 and words in result.stderr and result.stderr.count("\n") == 1


def test_points_need_refinement(run, stretched):
    result = run("delaunay", stretched, "--max-points", 20)
    assert result.exit_code == 2 and "--refine" in result.stderr


def test_the_seed_chooses_among_faces(summary, tmp_path):
    path = tmp_path / "big.ply"
    mesh = shapes.random_sphere(800, seed=1)
    write_mesh(str(path), AnnotatedMesh(mesh.moved(mesh.points * np.array([10.0, 1.0, 0.1]))))
    counts = [
        summary("delaunay", path, "--refine", 25, "--seed", seed)["results"]["steiner_points"]
        for seed in (0, 0, 1)
    ]
    assert counts[0] == counts[1] != counts[2]


def test_points_run_out(summary, stretched, tmp_path):
    out = tmp_path / "some.npz"
    report = summary("delaunay", stretched, "--refine", 25, "--max-points", 20, "-o", out, code=1)
    assert report["results"]["converged"] is False and report["results"]["steiner_points"] == 20
    assert any("--max-points" in warning for warning in report["warnings"])
    assert len(np.load(out)["points"]) == 220


def test_edges_that_are_not_delaunay_in_the_result_are_reported(run, tmp_path, monkeypatch):
    write_mesh(str(tmp_path / "torus.ply"), AnnotatedMesh(shapes.torus(8, 6)))
    count = triangulation_statistics.non_delaunay_edges
    monkeypatch.setattr(
        triangulation_statistics, "non_delaunay_edges", lambda mesh: count(mesh) | (mesh.faces == 0)
    )
    result = run("delaunay", tmp_path / "torus.ply", "--json")
    remaining = json.loads(result.stdout)["results"]["after"]["non_delaunay_edges"]
    assert result.exit_code == 1 and remaining > 0
    assert f"Warning: {remaining} edges of flat triangles are not flipped" in result.stderr
