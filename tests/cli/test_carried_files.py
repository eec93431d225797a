"""Files that carry on: texture coordinates, colours, polylines, tables of vertices."""

import csv
import json
import struct

import numpy as np
import pytest
from click.testing import CliRunner

from ddgcli.cli.main import main
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

SEAM = """v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 1 1 0 0 0 1
v 0 1 0 0.2 0.4 0.6
v 2 0.5 0 1 1 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 0.25 0.75
f 1/1 2/2 3/3 4/4
f -4/-1/1 5/1 3/3
"""
UV_OF_CORNERS = [  # after the quad is split
    [[0, 0], [1, 0], [1, 1]],
    [[0, 0], [1, 1], [0, 1]],
    [[0.25, 0.75], [0, 0], [1, 1]],
]
COLOURS = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [51, 102, 153], [255, 255, 255]]


def run(*words):
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output + result.stderr
    return result


@pytest.fixture
def seam(tmp_path):
    path = tmp_path / "seam.obj"
    path.write_text(SEAM)
    return path


def corner_values(mesh):
    """(m, 3, 2) texture coordinates, whichever array holds them."""
    if "corner_uv" in mesh.face:
        return mesh.face["corner_uv"]
    return mesh.vertex["uv"][mesh.surface.faces]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb", ".vtu", ".vtp", ".npz", ".vtkhdf"])
def test_texture_coordinates_with_a_seam_and_colours_survive_where_the_faces_do(seam, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    run("curvature", seam, "-o", out)
    mesh = read_mesh(str(out))
    np.testing.assert_allclose(corner_values(mesh), UV_OF_CORNERS, atol=1e-7)
    np.testing.assert_array_equal(mesh.vertex["color"][:5, :3], COLOURS)
    again = tmp_path / f"again{suffix}"  # and a second time, from the format itself
    run("info", out, "-o", again)
    np.testing.assert_allclose(corner_values(read_mesh(str(again))), UV_OF_CORNERS, atol=1e-7)


def test_a_vertex_keeps_its_number_in_glb_and_copies_at_seams_name_it(seam, tmp_path):
    out = tmp_path / "out.glb"
    result = run("info", seam, "-o", out)
    assert "1 vertex at a seam is added" in result.stderr
    source, mesh = read_mesh(str(seam)), read_mesh(str(out))
    np.testing.assert_allclose(mesh.surface.points[:5], source.surface.points)
    assert mesh.surface.n_vertices == 5 + 1  # only vertex 1 has two values
    corners = mesh.surface.points[mesh.surface.faces]
    np.testing.assert_allclose(corners, source.surface.points[source.surface.faces])


def test_other_faces_have_no_texture_coordinates_of_the_input(seam, tmp_path):
    out = tmp_path / "out.npz"
    run("laplacian", seam, "--subdivide", 1, "-o", out)
    assert not {"uv", "corner_uv", "color"} & set(np.load(out).files)


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".ply"])
def test_a_parameterization_is_written_as_texture_coordinates(tmp_path, suffix):
    patch = tmp_path / "patch.ply"
    write_mesh(str(patch), AnnotatedMesh(shapes.grid(6, 4)))
    run(
        "laplacian",
        patch,
        "--parameterize",
        "conformal",
        "-o",
        tmp_path / "a.npz",
        "-o",
        tmp_path / f"a{suffix}",
    )
    expected = np.load(tmp_path / "a.npz")["uv"]
    np.testing.assert_allclose(read_mesh(str(tmp_path / f"a{suffix}")).vertex["uv"], expected, atol=1e-6)


def test_trimesh_reads_texture_coordinates_and_colours_of_glb(tmp_path):
    import trimesh

    patch = tmp_path / "patch.ply"
    mesh = shapes.grid(6, 4)
    colours = np.arange(3 * mesh.n_vertices).reshape(-1, 3).astype(np.uint8)
    uv = mesh.points[:, :2] / 7
    write_mesh(str(tmp_path / "a.glb"), AnnotatedMesh(mesh, {"uv": uv, "color": colours}))
    (peer,) = trimesh.load_scene(tmp_path / "a.glb", process=False).geometry.values()
    np.testing.assert_allclose(peer.visual.uv, uv, atol=1e-6)
    np.testing.assert_array_equal(peer.visual.vertex_attributes["color"][:, :3], colours)
    assert not patch.exists()


def metadata_of(path):
    data = path.read_bytes()
    if path.suffix == ".glb":
        (length,) = struct.unpack("<I", data[12:16])
        return json.loads(data[20 : 20 + length])["asset"]["extras"]["ddgcli"]
    (line,) = [x for x in data[:4000].splitlines() if x.startswith(b"comment ddgcli ")]
    return json.loads(line.removeprefix(b"comment ddgcli "))


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_baked_colours_follow_the_array_and_state_their_range(tmp_path, suffix):
    sphere, out = tmp_path / "sphere.ply", tmp_path / f"a{suffix}"
    write_mesh(str(sphere), AnnotatedMesh(shapes.icosphere(2)))
    run(
        "geodesic",
        sphere,
        "--source",
        0,
        "-o",
        tmp_path / "d.npz",
        "-o",
        out,
        "--colors",
        "geodesic_distance",
    )
    distance, colours = np.load(tmp_path / "d.npz")["geodesic_distance"], read_mesh(str(out)).vertex["color"]
    stated = metadata_of(out)["colors"]
    assert stated["array"] == "geodesic_distance" and 0 <= stated["low"] < stated["high"] <= distance.max()
    from matplotlib import colormaps

    share = np.clip((distance - stated["low"]) / (stated["high"] - stated["low"]), 0, 1)
    expected = 255 * colormaps["viridis"](0.04 + 0.96 * share)[:, :3]
    assert np.abs(colours[:, :3] - expected).max() < 6


def test_colors_without_a_format_of_colours_or_an_array_is_an_error(seam, tmp_path):
    runner = CliRunner()
    result = runner.invoke(main, ["info", str(seam), "-o", str(tmp_path / "a.vtu"), "--colors", "boundary"])
    assert result.exit_code == 2 and ".ply .glb .obj" in result.stderr
    result = runner.invoke(main, ["info", str(seam), "-o", str(tmp_path / "a.ply"), "--colors", "heat"])
    assert result.exit_code == 2 and "boundary" in result.stderr and not (tmp_path / "a.ply").exists()


def polylines(path):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    sizes = [data.GetCell(k).GetNumberOfPoints() for k in range(data.GetNumberOfCells())]
    return sizes, vtk_to_numpy(data.GetCellData().GetArray("path_id")).tolist()


def test_paths_traces_and_generators_are_one_polyline_each_in_vtp(tmp_path):
    torus = tmp_path / "torus.ply"
    write_mesh(str(torus), AnnotatedMesh(shapes.torus(16, 12)))
    result = run("geodesic", torus, "--source", 0, "--path-to", 50, "--path-to", 77, "--trace",
                 "3:0.3,0.3,0.4:1,0,0:2", "--paths-output", tmp_path / "p.vtp", "--json")  # fmt: skip
    points = [path["points"] for path in json.loads(result.stdout)["results"]["paths"]]
    assert polylines(tmp_path / "p.vtp") == (points, [0, 1, 2])
    result = run("hodge", torus, "--generators", tmp_path / "g.vtp", "--json")
    loops = json.loads(result.stdout)["results"]["generators"]
    assert polylines(tmp_path / "g.vtp") == ([len(loop) + 1 for loop in loops], [0, 1])
    curves = read_mesh(str(tmp_path / "g.vtp"))
    np.testing.assert_array_equal(curves.vertex["vertex"], np.concatenate(loops))


def test_a_table_of_vertices_holds_every_array_in_full_precision(seam, tmp_path):
    run("curvature", seam, "-o", tmp_path / "a.csv", "-o", tmp_path / "a.npz")
    with open(tmp_path / "a.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    arrays = np.load(tmp_path / "a.npz")
    assert [int(row["vertex"]) for row in rows] == [0, 1, 2, 3, 4]
    for name in ("angle_defect", "vertex_area"):
        np.testing.assert_array_equal([float(row[name]) for row in rows], arrays[name])
    np.testing.assert_array_equal(
        [[float(row[f"principal_direction_min_{c}"]) for c in "xyz"] for row in rows],
        arrays["principal_direction_min"],
    )
    result = CliRunner().invoke(main, ["info", str(tmp_path / "a.csv")])
    assert result.exit_code == 2 and "table of vertices" in result.stderr
