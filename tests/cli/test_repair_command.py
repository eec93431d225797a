"""`ddgcli repair`: flags, maps in the file, and what still refuses the result."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


@pytest.fixture
def bad(tmp_path):
    """A sphere with turned faces, a hole and a fin."""
    sphere = shapes.icosphere(2)
    faces = sphere.faces[1:].copy()
    faces[::5] = faces[::5, ::-1]
    points = np.concatenate([sphere.points, [[2.0, 0, 0]]])
    a, b = faces[40, :2]
    mesh = TriangleMesh.from_arrays(points, np.concatenate([faces, [[a, b, len(points) - 1]]]))
    path = tmp_path / "bad.ply"
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"height": points[:, 2]}))
    return path


def test_a_surface_that_a_command_refuses_is_accepted_after_repair(run, summary, bad, tmp_path):
    assert run("delaunay", bad).exit_code == 2
    out = tmp_path / "good.ply"
    result = summary("repair", bad, "--for", "delaunay", "-o", out)
    assert result["results"]["changes"]["orient"] > 0
    assert "delaunay" not in result["results"]["refused_by"]
    assert run("delaunay", out).exit_code == 0
    repaired = read_mesh(str(out))
    assert np.array_equal(repaired.vertex["height"], repaired.surface.points[:, 2])
    original = read_mesh(str(bad)).surface
    assert np.array_equal(repaired.surface.points, original.points[repaired.vertex["input_vertex"]])


def test_a_null_genus_is_a_warning_of_info_alone(summary, moebius):
    warning = "genus is null: the surface cannot be oriented"
    assert warning in summary("info", moebius)["warnings"]
    report = summary("laplacian", moebius, "--eigen", 2)
    assert report["input"]["genus"] is None and warning not in report["warnings"]


def test_the_warning_of_a_null_genus_names_its_reason(summary, tmp_path):
    book = tmp_path / "book.off"
    book.write_text("OFF\n5 3 0\n0 0 0\n1 0 0\n0 1 0\n0 -1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 1 4\n")
    assert "genus is null: the surface is not manifold" in summary("info", book)["warnings"]


def test_filled_faces_are_marked(summary, bad, tmp_path):
    out = tmp_path / "closed.npz"
    words = ("--split-fans", "--orient", "--largest", "--fill-holes", "10", "--drop-unused")
    result = summary("repair", bad, *words, "-o", out)
    assert (read_mesh(str(out)).face["input_face"] == -1).sum() == result["results"]["changes"]["fill_holes"]
    assert result["results"]["changes"]["fill_holes"] == 1  # the fin, a piece of one face, stays open
    alone = summary("repair", out, "--largest", "--drop-unused", "-o", tmp_path / "sphere.ply")
    assert alone["results"]["repaired"]["closed"] is True


@pytest.fixture
def moebius(tmp_path):
    band = shapes.grid(8, 1)
    faces = band.faces.copy()
    left, right = band.points[:, 0].min(), band.points[:, 0].max()
    ends = {tuple(p[1:]): i for i, p in enumerate(band.points.tolist()) if p[0] == left}
    top = band.points[:, 1].max() + band.points[:, 1].min()
    glue = {i: ends[(top - p[1], p[2])] for i, p in enumerate(band.points.tolist()) if p[0] == right}
    faces = np.vectorize(lambda v: glue.get(v, v))(faces)
    path = tmp_path / "moebius.obj"
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(band.points, faces)))
    return path


def test_the_advice_for_a_welded_surface_with_one_side_works(run, moebius):
    """Welding would close the cut again."""
    refused = run("repair", moebius, "--weld", "--fill-holes", 50)
    assert refused.exit_code == 2 and refused.stderr.endswith(
        ", and drop --weld then, which closes the cut\n"
    )
    cut = moebius.with_name("moebius-repaired.ply")
    assert run("repair", moebius, "--cut-to-disk", "--orient", "-o", cut).exit_code == 0
    assert run("repair", cut, "--fill-holes", 50).exit_code == 0


def test_the_remedy_of_a_step_repeats_the_steps_before_it(run, moebius, tmp_path, monkeypatch):
    """A face that is there twice: without --drop-duplicates the cut is refused."""
    monkeypatch.chdir(tmp_path)
    mesh = read_mesh(str(moebius)).surface
    double = TriangleMesh.from_arrays(mesh.points, np.concatenate([mesh.faces, mesh.faces[:1]]))
    path = moebius.with_name("double.npz")
    write_mesh(str(path), AnnotatedMesh(double))
    refused = run("repair", path, "--drop-duplicates", "--fill-holes", 50)
    assert refused.exit_code == 2 and "--drop-duplicates --cut-to-disk --orient -o" in refused.stderr
    words = refused.stderr[refused.stderr.index("repair ", refused.stderr.index("ddgcli ")) :].split()
    assert run(*words).exit_code == 0, run(*words).stderr


def test_a_step_that_needs_an_earlier_one_names_it(run, tmp_path):
    """A repair of its own would not do: the weld joins the parted sheets again."""
    points = [[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-0.5, 0.8, 0.5], [-0.5, -0.8, 0.5]]
    path = tmp_path / "book.npz"
    np.savez(path, points=np.array(points, dtype=float), faces=[[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    words = ("repair", path, "--weld", "1e-6", "--fill-holes", 7, "-o", tmp_path / "out.ply")
    refused = run(*words)
    assert refused.exit_code == 2 and refused.stderr.endswith("split the surface there: add --split-fans\n")
    assert run(*words, "--split-fans").exit_code == 0


def test_a_dry_run_of_frames_along_isolines_knows_one_sided_surfaces(run, moebius):
    words = ("geodesic", moebius, "--source", 0, "--isolines", 3)
    assert run(*words, "--dry-run").exit_code == 0
    for further in ((), ("--dry-run",)):
        refused = run(*words, "--darboux", *further)
        assert refused.exit_code == 2 and "a Darboux frame needs two sides" in refused.stderr


def test_no_repair_is_advised_where_none_closes_the_surface(run, moebius):
    refused = run("willmore-flow", moebius, "--flow", "conformal")
    assert refused.exit_code == 2 and "ddgcli repair" not in refused.stderr
    assert refused.stderr.endswith("a closed surface: no repair closes this one, which is one-sided\n")


def test_a_command_that_repairs_cannot_satisfy_is_exit_1(summary, moebius):
    result = summary("repair", moebius, "--for", "fluid-sim", code=1)
    assert "one-sided" in result["results"]["refused_by"]["fluid-sim"]


def test_the_steps_of_several_commands_are_those_of_each(summary, bad, moebius, tmp_path):
    steps = {
        name: summary("repair", bad, "--for", name)["results"]["changes"]
        for name in ("laplacian", "delaunay")
    }
    both = summary("repair", bad, "--for", "delaunay", "--for", "laplacian")["results"]["changes"]
    assert set(both) == set(steps["laplacian"]) | set(steps["delaunay"]) > set(steps["laplacian"])
    for calls in (("fluid-sim", "delaunay"), ("delaunay", "fluid-sim")):
        words = [word for name in calls for word in ("--for", name)]
        assert "fluid-sim" in summary("repair", moebius, *words, code=1)["results"]["refused_by"]


@pytest.mark.parametrize(
    "words, text",
    [
        (("--weld", "-1"), "-1 is less than 0"),
        (("--split-edges", "-1e-3"), "-1e-3 is less than 0"),
        ((), "no repair is chosen; name one, such as --orient, or a command by --for"),
        (("--for", "frames"), "--for: 'frames' takes no surface"),
        (("--for", "delaunay", "--orient"), "leave the other flags out"),
        (("--cut-to-disk",), "--cut-to-disk: "),
        (("--fill-holes", "2"), "--fill-holes"),
    ],
)
def test_wrong_calls_are_refused_in_one_line(run, bad, words, text):
    result = run("repair", bad, *words)
    assert result.exit_code == 2 and text in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_weld_takes_a_distance_or_none(summary, bad):
    assert summary("repair", bad, "--weld")["results"]["changes"] == {"weld": 0}
    assert summary("repair", bad, "--weld", "0.28")["results"]["changes"]["weld"] > 0
