"""Refusals of meshes name a call of `ddgcli repair`, and this call remedies them."""

import json
import re
import shlex

import numpy as np
import pytest

from benchmarks.hardcases.meshes import voxel_surface
from ddgcli.algorithms.repair.pipeline import RepairSteps
from ddgcli.algorithms.repair.solid import repair_solid
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.remedies import REMEDIES, remedy
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.degenerate_meshes import degenerate_mesh

REPAIR = re.compile(r"ddgcli repair .*? -o ('[^']*'|\S+\.ply)")


def with_faces(mesh, faces, points=()):
    return TriangleMesh.from_arrays(np.concatenate([mesh.points, *([points] if len(points) else [])]), faces)


def fin():
    """A third face on an edge of a grid."""
    grid = shapes.grid(3, 3)
    a, b = grid.faces[4, :2]
    return with_faces(grid, np.concatenate([grid.faces, [[a, b, grid.n_vertices]]]), [[0.5, 0.5, 1.0]])


def touching_voxels():
    """Two cubes that share an edge."""
    solid = np.zeros((4, 4, 3), dtype=bool)
    solid[1, 1, 1] = solid[2, 2, 1] = True
    return TriangleMesh.from_arrays(*voxel_surface(solid))


def duplicates():
    """Two faces of a grid twice."""
    grid = shapes.grid(3, 3)
    return with_faces(grid, np.concatenate([grid.faces, grid.faces[4:6, [1, 2, 0]]]))


def two_fans():
    """Two tetrahedra that share a vertex."""
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]])
    number = np.array([0, 4, 5, 6])
    return TriangleMesh.from_arrays(points, np.concatenate([faces, number[faces][:, ::-1]]))


def turned():
    """Every fifth face of a sphere reversed."""
    sphere = shapes.icosphere(1)
    faces = sphere.faces.copy()
    faces[::5] = faces[::5, ::-1]
    return with_faces(sphere, faces)


def moebius():
    """A band of 8 x 1 quads glued with a half turn."""
    x, y = np.meshgrid(np.arange(9), np.arange(2), indexing="ij")
    angle = 2 * np.pi * x / 8
    radius = 1 + (y - 0.5) * np.cos(angle / 2)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), (y - 0.5) * np.sin(angle / 2)], -1)
    vertex = np.arange(18).reshape(9, 2)
    vertex[8] = vertex[0, ::-1]
    quads = np.stack([vertex[:-1, 0], vertex[1:, 0], vertex[1:, 1], vertex[:-1, 1]], axis=1)
    return TriangleMesh.from_arrays(points.reshape(-1, 3)[:16], quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def holes():
    """A sphere without two faces."""
    sphere = shapes.icosphere(1)
    return with_faces(sphere, sphere.faces[2:])


def unwelded():
    """A sphere whose faces share no vertex."""
    sphere = shapes.icosphere(1)
    points = sphere.points[sphere.faces].reshape(-1, 3)
    return TriangleMesh.from_arrays(points, np.arange(len(points)).reshape(-1, 3))


def unwelded_holes():
    """Those of its faces without two."""
    sphere = unwelded()
    return with_faces(sphere, sphere.faces[2:])


def flat_faces():
    """A grid with one vertex moved onto an edge."""
    grid = shapes.grid(4, 4)
    points = grid.points.copy()
    a, b, c = grid.faces[9]
    points[a] = 0.5 * (points[b] + points[c])
    return TriangleMesh.from_arrays(points, grid.faces)


def repeated_vertex():
    """A face that names a vertex twice."""
    grid = shapes.grid(3, 3)
    return with_faces(grid, np.concatenate([grid.faces, [[0, 0, 1]]]))


def repeated_vertex_of_a_ball():
    """A closed surface with a face that names a vertex twice: a boundary of one edge."""
    sphere = shapes.icosphere(1)
    return with_faces(sphere, np.concatenate([sphere.faces, [[1, 1, 2]]]))


def message_parts():
    """Two sheets, one of them larger."""
    small, large = shapes.grid(2, 2), shapes.grid(4, 4)
    points = np.concatenate([0.5 * small.points, large.points + [3, 0, 0]])
    return TriangleMesh.from_arrays(points, np.concatenate([small.faces, large.faces + small.n_vertices]))


def handle():
    """A torus without a face."""
    torus = shapes.torus(8, 6)
    return with_faces(torus, torus.faces[1:])


FLATTEN = ("laplacian", "--parameterize", "conformal")
FLOW = ("fluid-sim", "--effect", "initial vorticity='z'", "--steps", "1", "--dt", "0.01")
FALL = ("shell-sim", "--effect", "stretching", "--steps", "1", "--dt", "0.01")
REFUSALS = [
    (fin, FLOW, "more than two faces"),
    (two_fans, FLOW, "several fans"),
    (turned, FLOW, "opposite orientation"),
    (flat_faces, FLOW, "no area"),
    (flat_faces, FALL, "no area"),
    (fin, ("delaunay",), "more than two faces"),
    (fin, ("hodge",), "more than two faces"),
    (fin, ("willmore-flow", "--steps", "1"), "more than two faces"),
    (touching_voxels, ("willmore-flow", "--fix-volume", "--steps", "1"), "more than two faces"),
    (duplicates, ("delaunay",), "more than two faces"),
    (duplicates, ("dec",), "more than two faces"),
    (two_fans, ("hodge",), "several fans"),
    (two_fans, ("willmore-flow", "--steps", "1"), "several fans"),
    (turned, ("delaunay",), "opposite orientation"),
    (turned, ("hodge",), "opposite orientation"),
    (turned, ("willmore-flow", "--steps", "1"), "opposite orientation"),
    (moebius, ("delaunay", "--refine", "20"), "one-sided"),
    (moebius, ("curvature", "--scheme", "corrected"), "one-sided"),
    (moebius, ("curvature", "--region", "1,0,0:0.5", "--scheme", "quadric"), "one-sided"),
    (moebius, FLATTEN, "one-sided"),
    (moebius, ("geodesic", "--source", "0", "--signed-distance", "edges.npy"), "one-sided"),
    (turned, ("geodesic", "--source", "0", "--signed-distance", "edges.npy"), "opposite orientation"),
    (holes, ("willmore-flow", "--fix-volume", "--steps", "1"), "needs a closed surface"),
    (unwelded, ("willmore-flow", "--fix-volume", "--steps", "1"), "needs a closed surface"),
    (unwelded_holes, ("willmore-flow", "--fix-volume", "--steps", "1"), "needs a closed surface"),
    (flat_faces, ("willmore-flow", "--steps", "1"), "no area"),
    (flat_faces, ("dec",), "no area"),
    (repeated_vertex, ("delaunay",), "names a vertex twice"),
    (repeated_vertex_of_a_ball, ("willmore-flow", "--flow", "conformal"), "needs a closed surface"),
    (message_parts, FLATTEN, "2 components"),
    (lambda: shapes.icosphere(1), FLATTEN, "is closed"),
    (lambda: shapes.torus(8, 6), FLATTEN, "is closed"),
    (handle, FLATTEN, "1 handles"),
]  # fmt: skip


@pytest.mark.parametrize("bad, words, text", REFUSALS)
def test_the_command_that_a_refusal_names_remedies_it(run, tmp_path, monkeypatch, bad, words, text):
    monkeypatch.chdir(tmp_path)
    mesh = bad()
    write_mesh("bad mesh.ply", AnnotatedMesh(mesh))
    np.save("edges.npy", mesh.faces[:1, :2])
    outputs = ("-o", "flow.vtkhdf") if words[0] == "willmore-flow" else ()
    outputs = ("-o", "operators.npz") if words[0] == "dec" else outputs
    refused = run(*words, "bad mesh.ply", *outputs)
    assert refused.exit_code == 2 and text in refused.stderr, refused.stderr
    assert len(refused.stderr.splitlines()) == 1 and "`" not in refused.stderr
    _, *repair = shlex.split(REPAIR.search(refused.stderr).group())
    assert repair[1] == "bad mesh.ply"
    repaired = run(*repair)
    assert repaired.exit_code == 0, repaired.stderr
    accepted = run(*words, repair[-1], *outputs)
    assert text not in accepted.stderr and accepted.exit_code in (0, 1), accepted.stderr


def test_the_boundary_of_tetrahedra_is_written_before_its_repair(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]]
    np.savez("bad.npz", points=points, tetrahedra=[[0, 1, 2, 4], [0, 1, 2, 3]])  # the second one is flat
    call = ("--region", "0,0,0:0.5")
    refused = run("curvature", "bad.npz", *call)
    assert refused.exit_code == 2 and "opposite orientation" in refused.stderr, refused.stderr
    commands = refused.stderr.strip().partition("ddgcli ")[2].split(" && ddgcli ")
    assert [command.split()[0] for command in commands] == ["info", "repair"]
    assert all(run(*shlex.split(command)).exit_code == 0 for command in commands)
    assert run("curvature", commands[-1].split()[-1], *call).exit_code == 0


FORCE = ("--effect", "force acceleration=[0,0,1]", "--integrator", "energy", "--dt", "0.01", "--steps", "1")


@pytest.mark.parametrize(
    "last, words, text",
    [
        ([0, 1, 2, 3], ("laplacian",), "flat, with a volume of at most 2e-08"),
        ([0, 1, 2, 3], ("fluid-sim", *FORCE), "flat, with a volume of at most 2e-08"),
        ([0, 1, 2, 5], ("fluid-sim", *FORCE), "flat, with a volume of at most 2e-08"),
        ([2, 0, 3, 4], ("fluid-sim", *FORCE), "inverted"),
    ],
)
def test_tetrahedra_are_cured_by_the_command_that_a_refusal_names(
    run, summary, tmp_path, monkeypatch, last, words, text
):
    monkeypatch.chdir(tmp_path)
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0], [0, 1, 1e-9]]
    np.savez("bad.npz", points=points, tetrahedra=[[0, 1, 2, 4], last])
    refused = run(words[0], "bad.npz", *words[1:])
    assert refused.exit_code == 2 and text in refused.stderr, refused.stderr
    assert text in summary("info", "bad.npz")["results"]["accepts"][words[0]]
    _, *repair = shlex.split(refused.stderr[refused.stderr.index("ddgcli repair") :])
    changes = summary(*repair)["results"]["changes"]
    assert list(changes.values()) == [1]
    assert run(words[0], repair[-1], *words[1:]).exit_code == 0
    assert summary("info", repair[-1])["results"]["accepts"][words[0]] == "yes"
    mesh = read_mesh(repair[-1])
    assert np.array_equal(mesh.face["input_cell"], np.arange(len(mesh.mesh.tetrahedra)))


@pytest.mark.parametrize("shift", [(1, 1, 0), (1, 1, 1)], ids=["edge", "vertex"])
@pytest.mark.parametrize("words", [("hodge", "--field", "wind"), ("laplacian", "--form-eigen", "2")])
def test_boxes_that_touch_are_parted_and_stay_tetrahedra(run, summary, tmp_path, monkeypatch, shift, words):
    monkeypatch.chdir(tmp_path)
    box = shapes.box_tetrahedra(1, 1, 1)
    points = np.concatenate([box.points, box.points + shift])
    unique, number = np.unique(points.round(9), axis=0, return_inverse=True)
    corners = number.ravel()[np.concatenate([box.tetrahedra, box.tetrahedra + box.n_vertices])]
    wind = np.random.default_rng(0).normal(size=(len(corners), 3))
    np.savez("bad.npz", points=unique, tetrahedra=corners, wind=wind)
    refused = run(words[0], "bad.npz", *words[1:])
    assert refused.exit_code == 2 and "touch" in refused.stderr, refused.stderr
    assert words[0] != "hodge" or "touch" in summary("info", "bad.npz")["results"]["accepts"]["hodge"]
    _, *repair = shlex.split(refused.stderr[refused.stderr.index("ddgcli repair") :])
    assert summary(*repair)["results"]["changes"] == {"split_fans": len(points) - len(unique)}
    again = ("repair", "bad.npz", "--for", words[0], "-o", "again.vtu")
    assert words[0] != "hodge" or summary(*again)["results"]["changes"]["split_fans"] > 0
    report = summary(words[0], repair[-1], *words[1:])
    assert report["input"]["components"] == 2


def test_a_body_that_touches_itself_at_an_edge_and_at_a_vertex_gets_a_manifold_boundary():
    box = shapes.box_tetrahedra(3, 3, 3)
    cube = np.floor(3 * box.points[box.tetrahedra].mean(axis=1)).astype(int)
    for seed in range(6):
        filled = np.random.default_rng(seed).random((3, 3, 3)) < 0.6
        mesh = TetMesh.from_arrays(box.points, box.tetrahedra[filled[tuple(cube.T)]])
        repaired = repair_solid(mesh, RepairSteps(split_fans=True))
        assert not mesh.boundary.topology.is_manifold and repaired.mesh.boundary.topology.is_manifold
        assert np.array_equal(repaired.input_vertex[repaired.mesh.tetrahedra], mesh.tetrahedra)
        assert np.array_equal(repaired.mesh.points, mesh.points[repaired.input_vertex])
        assert repair_solid(repaired.mesh, RepairSteps(split_fans=True)).changes == {"split_fans": 0}


def test_steps_of_surfaces_are_refused_for_tetrahedra(run, tmp_path):
    np.savez(tmp_path / "one.npz", points=np.eye(4, 3), tetrahedra=[[0, 1, 2, 3]])
    result = run("repair", tmp_path / "one.npz", "--fill-holes", "9", "-o", tmp_path / "out.vtu")
    assert result.exit_code == 2 and "--fill-holes: is a step of surfaces" in result.stderr
    assert "--drop-unused; name one of them" in result.stderr
    words = (
        "repair",
        tmp_path / "one.npz",
        "--cut-to-disk",
        "--drop-unused",
        "--largest",
        "-o",
        tmp_path / "out.vtu",
    )
    assert run(*words).stderr.strip().endswith("; leave --largest, --cut-to-disk out")
    assert run(*(word for word in words if word not in ("--cut-to-disk", "--largest"))).exit_code == 0


def test_tetrahedra_that_are_flat_by_position_or_by_length_are_refused_alike(run, tmp_path):
    """Volumes of 1.7e-8 and 0.92e-8 of the longest edge cubed: hodge saw one, its repair and `info` both.

    The dry run of that repair was accepted.
    """
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0], [0.5, 0.3, 0]])
    points = np.concatenate([corners + [0, 0, z] for z in (0, 2)])
    points[[3, 7], 2] += 1.07e-7, 0.66e-7  # volumes: a sixth of 0.9 times that, the longest edge 1.08
    mesh = tmp_path / "flat.npz"
    np.savez(mesh, points=points, tetrahedra=[[0, 1, 2, 3], [4, 5, 6, 7]])
    for words in (["hodge", mesh], ["repair", mesh, "--drop-degenerate", "--dry-run"]):
        result = run(*words)
        assert result.exit_code == 2 and "none of the 2 tetrahedra has a volume above 2e-08" in result.stderr


def test_a_scene_is_cured_by_the_command_for_its_mesh(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").mkdir()
    write_mesh("scenes/bad.ply", AnnotatedMesh(turned()))
    scene = tmp_path / "scenes" / "flow.toml"
    text = """format = "ddgcli-scene/1"
[time]
duration = 0.02
step = 0.01
[[object]]
name = "ball"
role = "fluid"
mesh = "bad.ply"
[effects]
initial = { vorticity = "z" }
"""
    scene.write_text(text)
    refused = run("fluid-sim", "scenes/flow.toml")
    assert refused.exit_code == 2 and "scenes/flow.toml: line 5" in refused.stderr
    _, *repair = shlex.split(REPAIR.search(refused.stderr).group())
    assert repair[1] == "scenes/bad.ply" and run(*repair).exit_code == 0
    scene.write_text(text.replace("bad.ply", f"../{repair[-1]}"))
    assert run("fluid-sim", "scenes/flow.toml").exit_code == 0


def test_info_and_repair_name_the_command_for_every_command_that_refuses(summary, tmp_path):
    path, out = tmp_path / "bad.ply", tmp_path / "still-bad.ply"
    write_mesh(str(path), AnnotatedMesh(turned()))
    reason = summary("info", path)["results"]["accepts"]["fluid-sim"]
    assert f"with ddgcli repair {path} --orient -o bad-repaired.ply" in reason
    reason = summary("repair", path, "--weld", "-o", out)["results"]["refused_by"]["fluid-sim"]
    assert f"with ddgcli repair {out} --orient -o still-bad-repaired.ply" in reason


def test_a_moebius_band_is_cut_to_an_oriented_disk(run, summary, tmp_path):
    path, out = tmp_path / "moebius.ply", tmp_path / "disk.ply"
    write_mesh(str(path), AnnotatedMesh(moebius()))
    facts = summary("repair", path, "--cut-to-disk", "-o", out)["results"]["repaired"]
    assert (facts["oriented"], facts["boundary_loops"], facts["euler_characteristic"]) == (True, 1, 1)
    disk = read_mesh(str(out))
    assert np.array_equal(disk.surface.points, moebius().points[disk.vertex["input_vertex"]])


@pytest.mark.parametrize(
    "command, words, seed",
    [
        ("laplacian", ("--eigen", 4), 3034),
        ("delaunay", (), 3010),
        ("geodesic", ("--source", 0, "--method", "heat"), 3046),
    ],
)
def test_the_remedy_of_a_residual_works(run, tmp_path, monkeypatch, command, words, seed):
    monkeypatch.chdir(tmp_path)
    mesh = degenerate_mesh(seed)
    flow = np.random.default_rng(0).normal(size=(mesh.n_faces, 3))
    write_mesh("bad.npz", AnnotatedMesh(mesh, face={"flow": flow}))

    def residuals(*call):
        warnings = json.loads(run(*call, "--json").stdout)["warnings"]
        return [text for text in warnings if "residual" in text.split(" is ")[0]]

    warning = residuals(command, "bad.npz", *words)[0]
    assert "repair the mesh" not in warning
    if command == "geodesic":
        assert "--method exact" in warning and not residuals(command, "bad.npz", "--source", 0)
        return
    call = shlex.split(warning[warning.index("ddgcli repair") :])
    assert run(*call[1:-1], "good.npz").exit_code == 0
    assert not residuals(command, "good.npz", *words)


def test_no_repair_is_named_for_folds_of_thin_triangles(run, tmp_path, monkeypatch):
    # parted, they are as thin as before: the residual stays
    monkeypatch.chdir(tmp_path)
    mesh = degenerate_mesh(3016)
    flow = np.random.default_rng(0).normal(size=(mesh.n_faces, 3))
    write_mesh("bad.npz", AnnotatedMesh(mesh, face={"flow": flow}))
    result = run("hodge", "bad.npz", "--field", "flow")
    assert result.exit_code == 1
    assert "move their vertices" in result.stderr and "ddgcli repair" not in result.stderr


def test_remedies_name_steps_of_the_repair():
    from ddgcli.algorithms.repair.pipeline import RepairSteps

    for defect in REMEDIES:
        steps = re.search("`repair(?:_cells)?=(.*)`", remedy(defect)).group(1).split()
        assert all(hasattr(RepairSteps(), step) for step in steps), defect


PRESSURE_SCENE = """
[time]
duration = 0.01
step = 0.01
[[object]]
name = "s"
role = "shell"
mesh = "sub/bad mesh.ply"
material = "rubber"
[effects]
stretching = {}
pressure = { value = 10 }
"""


def klein_bottle():
    """A grid of 6 x 6 quads, glued along one direction with a flip."""
    i, j = np.meshgrid(np.arange(6), np.arange(6), indexing="ij")
    corner = [np.stack([(i + a) % 6, np.where(i + a == 6, -(j + b), j + b) % 6]) for a, b in
              ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
    number = np.stack([6 * row + column for row, column in corner], axis=-1).reshape(-1, 4)
    u, v = (2 * np.pi / 6 * angle.ravel() for angle in (i, j))
    across = 3 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = np.stack([across * np.cos(u), across * np.sin(u), height], axis=1)
    return TriangleMesh.from_arrays(points, number[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def test_refusals_of_an_effect_name_the_mesh_file_of_the_scene(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "s.toml").write_text(PRESSURE_SCENE)
    write_mesh("sub/bad mesh.ply", AnnotatedMesh(turned()))
    refused = run("shell-sim", "s.toml")
    assert refused.exit_code == 2 and "opposite orientation" in refused.stderr
    _, *repair = shlex.split(REPAIR.search(refused.stderr).group())
    assert repair[1] == "sub/bad mesh.ply" and run(*repair).exit_code == 0
    (tmp_path / "s.toml").write_text(PRESSURE_SCENE.replace("sub/bad mesh.ply", repair[-1]))
    assert run("shell-sim", "s.toml").exit_code == 0
    other = (
        '[[object]]\nrole = "shell"\nname = "t"\nmaterial = "rubber"\n'
        "sphere = { radius = 1, subdivisions = 1, center = [5, 0, 0] }\n"
    )
    two = PRESSURE_SCENE.replace("[effects]", f"{other}[effects]")
    (tmp_path / "s.toml").write_text(two.replace("value = 10", 'object = "s", value = 10'))
    assert "ddgcli repair 'sub/bad mesh.ply'" in run("shell-sim", "s.toml").stderr


def test_pressure_in_a_one_sided_shell_has_no_repair(run, tmp_path, monkeypatch):
    """Cut open, it would have a boundary, and no repair gives it an inside."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "s.toml").write_text(PRESSURE_SCENE)
    mesh = klein_bottle()
    assert mesh.topology.is_closed and mesh.topology.is_manifold and mesh.topology.one_sided_face.all()
    write_mesh("sub/bad mesh.ply", AnnotatedMesh(mesh))
    refused = run("shell-sim", "s.toml")
    assert refused.exit_code == 2 and "is one-sided: it has no inside" in refused.stderr
    assert "ddgcli repair" not in refused.stderr
    text = PRESSURE_SCENE.replace("pressure = { value = 10 }", "load = { traction = [0, 0, 10] }")
    (tmp_path / "s.toml").write_text(text)
    assert run("shell-sim", "s.toml").exit_code == 0


def test_pieces_whose_edges_do_not_coincide_are_joined_by_their_remedy(run, tmp_path):
    """The weld of T-junctions joins vertices alone; edges are divided at the vertices on them too."""
    points = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 0.5, 0],
        [1, 1, 0],
        [0, 1, 0],
        [1, 0, 0],
        [2, 0, 0],
        [2, 1, 0],
        [1, 1, 0],
    ]
    left, right = [[0, 1, 2], [0, 2, 4], [2, 3, 4]], [[5, 6, 7], [5, 7, 8]]
    for name, faces, advice in (
        ("junction", left + right, "--weld --split-edges"),
        ("square", [[0, 1, 4], [1, 3, 4]] + right, "--weld"),
    ):
        np.savez(tmp_path / f"{name}.npz", points=np.array(points, dtype=float), faces=faces)
        result = run("hodge", tmp_path / f"{name}.npz")
        assert result.exit_code == 0 and "the surface is in pieces" in result.stderr
        assert advice in result.stderr and ("--split-edges" in result.stderr) == (name == "junction")
        words = ("repair", tmp_path / f"{name}.npz", *advice.split(), "--drop-unused")
        assert run(*words, "-o", tmp_path / "joined.npz").exit_code == 0
        joined = run("hodge", tmp_path / "joined.npz", "--json")
        assert "pieces" not in joined.stderr and json.loads(joined.stdout)["input"]["boundary_loops"] == 1
