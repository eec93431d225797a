"""Faults that random valid calls met: each call here once ended in an internal error or a wrong message."""

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz.call_resume import interrupted_after
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def written(path, mesh):
    write_mesh(str(path), AnnotatedMesh(mesh))
    return path


def test_a_surface_without_generators_writes_an_empty_file_of_curves(summary, tmp_path):
    disk, curves = written(tmp_path / "a.npz", shapes.grid(2, 2)), tmp_path / "c.vtp"
    assert summary("hodge", disk, "--generators", curves)["results"]["generators"] == []
    assert curves.is_file()


def test_dual_edges_to_a_circumcentre_at_infinity_are_left_out(run, tmp_path):
    points = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [6, 0, 0], [5, 1, 0]])
    mesh = TriangleMesh.from_arrays(points, np.array([[0, 2, 1], [4, 5, 6]]))  # the first has no area
    result = run("delaunay", written(tmp_path / "a.npz", mesh), "--dual", tmp_path / "d.vtp")
    assert result.exit_code == 1  # its residuals are not finite, as a warning states
    lines = read_mesh(str(tmp_path / "d.vtp")).mesh
    assert np.isfinite(lines.points).all()
    assert len(lines.points)


def test_a_heat_distance_lost_to_rounding_names_a_remedy_for_comparisons_too(run, tmp_path):
    needles = shapes.grid(20, 1)
    path = written(tmp_path / "a.npz", needles.moved(needles.points * [1.0, 5e-10, 1.0]))
    for words in (("--method", "heat"), ("--compare", "heat")):
        result = run("geodesic", path, "--source", 1, *words)
        assert result.exit_code == 2
        assert result.stderr.strip().endswith("give a shorter --heat-time, or use another method")


def test_a_surface_without_any_area_is_not_sent_to_a_repair_that_leaves_no_face(run, tmp_path):
    mesh = TriangleMesh.from_arrays(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    path = written(tmp_path / "a.npz", mesh)
    for words in (("shell-sim", path, "--effect", "stretching", "--steps", 1), ("hodge", path, "--basis")):
        result = run(*words)
        assert "the only face has no area" in result.stderr
        assert "repair" not in result.stderr


def test_tetrahedra_without_any_volume_are_not_sent_to_a_repair_that_leaves_no_cell(run, tmp_path):
    np.savez(
        tmp_path / "t.npz", points=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], tetrahedra=[[0, 1, 2, 3]]
    )
    for command, *words in (("laplacian",), ("fluid-sim", "--steps", 1), ("repair", "--drop-degenerate")):
        result = run(command, tmp_path / "t.npz", *words, "-o", tmp_path / "out.vtu")
        assert result.exit_code == 2
        assert (
            "the only tetrahedron has no volume above 2e-08 of the longest edge cubed; check the coordinates"
            in result.stderr
        )


def test_the_repair_of_a_mesh_from_standard_input_names_its_format_for_scenes_too(run, tmp_path):
    points, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]), np.array([[0, 1, 2], [0, 1, 3]])
    content = Path(written(tmp_path / "a.npz", TriangleMesh.from_arrays(points, faces))).read_bytes()
    words = ("--effect", "stretching", "--steps", 1, "--dt", 1e-3)
    result = run("shell-sim", "-", "--input-format", "npz", *words, input=content)
    repair = re.search(r"ddgcli (repair MESH .*) -o (\S+)$", result.stderr.strip())
    assert result.exit_code == 2 and repair
    arguments = [*repair.group(1).replace("MESH", "-").split(), "-o", tmp_path / repair.group(2)]
    assert run(*arguments, input=content).exit_code == 0
    assert run("shell-sim", tmp_path / repair.group(2), *words).exit_code == 0


@pytest.mark.parametrize("height, code", [(1e-9, 2), (1e-6, 0)])
def test_tetrahedra_flatter_than_rounding_are_refused_by_info_the_dry_run_and_the_run(
    run, tmp_path, height, code
):
    """A volume from edge lengths, a square root, has an error of 1e-8: below it stars are rounding."""
    points = np.vstack([np.zeros(3), np.diag([1.0, 1.0, height])])
    np.savez(tmp_path / "t.npz", points=points, tetrahedra=[[0, 1, 2, 3]])
    for command in ("dec", "hodge", "laplacian"):
        codes = [run(command, tmp_path / "t.npz", *more).exit_code for more in ((), ("--dry-run",))]
        assert codes == [code, code]


def test_what_cannot_start_at_edges_names_the_option_of_these_edges(run, tmp_path):
    disk = written(tmp_path / "a.npz", shapes.grid(2, 2))
    result = run("geodesic", disk, "--source-boundary", "--field", "v")
    assert result.stderr.strip().endswith("leave --source-boundary out")


def test_lines_among_sides_without_length_end_soon(run, tmp_path):
    """Once 100,000 crossings, a minute, without any progress."""
    points = np.array([[0.0, 2, 2], [0, 2, 2], [-2, 4, 2], [0, 2, 2]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    np.savez(tmp_path / "a.npz", points=points, faces=faces)
    result = run("geodesic", tmp_path / "a.npz", "--fan", 5, "--fan-length", 1, "--source", 3)
    assert "stopped short of the length" in result.stderr


def test_a_tolerance_below_the_smallest_error_ends_with_a_message(run, tmp_path):
    """Once steps of error zero became shorter until they were zero: an internal error."""
    disk = written(tmp_path / "a.npz", shapes.grid(2, 2))
    words = ("--vorticity", "1", "--viscosity", 0, "--integrator", "energy", "--duration", 1e-3, "--dt", 1e-3)
    result = run("fluid-sim", disk, *words, "--tolerance", 1e-300)
    assert result.exit_code == 1
    assert "internal" not in result.stderr
    assert "however short the step" in result.stderr


def test_a_comparison_of_curvatures_takes_a_radius_or_auto(run, tmp_path):
    call = (
        "tradeoff",
        "--budget",
        20,
        "--repeat",
        1,
        "curvature",
        written(tmp_path / "a.npz", shapes.icosphere(3)),
    )
    assert "--radius': 'wide' is not" in run(*call, "--radius", "wide").stderr
    assert run(*call, "--radius", "auto").exit_code == 0


def test_options_of_time_are_left_out_together_where_a_flow_goes_to_rest(run, tmp_path):
    """Once `--tolerance` required `--duration`, which `--remesh` refuses."""
    sphere = written(tmp_path / "a.npz", shapes.icosphere(1))
    timed = ("--duration", 1, "--tolerance", 0.1, "--frame-every", 0.5, "--integrator", "rosenbrock")
    result = run("willmore-flow", sphere, "--remesh", "mean", *timed)
    assert "leave --dt, --duration, --tolerance, --frame-every and --integrator out" in result.stderr


def test_an_energy_that_is_not_defined_is_null_with_a_warning(summary, tmp_path):
    """The normals of the middle vertex cancel: four faces of a square, and the same turned over."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    above = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    below = np.where(above == 0, 5, above)[:, ::-1]
    mesh = TriangleMesh.from_arrays(np.vstack([points, points[:1]]), np.vstack([above, below]))
    flow = ("--energy", "cotan", "--report-energy", "all", "--steps", 1, "--dt", 1e-9)
    result = summary("willmore-flow", written(tmp_path / "a.npz", mesh), *flow, code=1)
    assert result["results"]["energies"]["gauss-map"]["start"] is None
    assert "energy gauss-map could not be computed" in " ".join(result["warnings"])


def test_steps_far_from_the_origin_end_where_a_move_changes_no_coordinate(summary, tmp_path):
    """Once 300 iterations of Newton's method a step, with moves below the rounding of the coordinates."""
    cube = shapes.icosphere(1)
    path = written(tmp_path / "a.npz", cube.moved(np.round(4 * cube.points) + [5e10, -1.5e10, 3.5e10]))
    words = ("--effect", "stretching", "--effect", "gravity", "--dt", 1e-2, "--steps", 2)
    results = summary("shell-sim", path, *words)["results"]
    assert results["rejected_steps"] == 0
    assert results["newton_iterations"] < 20


@pytest.mark.parametrize("suffix", [".stl", ".glb"])
def test_coordinates_beyond_32_bits_are_refused_by_formats_of_them(run, tmp_path, suffix):
    """Once written as infinite, so that the file could not be read."""
    sphere = shapes.icosphere(0)
    path = written(tmp_path / "a.npz", sphere.moved(sphere.points * 1e99))
    for words in ((), ("--dry-run",)):
        result = run("info", path, "-o", tmp_path / f"b{suffix}", *words)
        assert result.exit_code == 2
        assert "holds 32-bit coordinates" in result.stderr
    assert not (tmp_path / f"b{suffix}").exists()


def test_operators_are_written_to_standard_output(run, tmp_path, monkeypatch):
    """Once to a file whose name was `-`."""
    monkeypatch.chdir(tmp_path)
    sphere = written(tmp_path / "a.npz", shapes.icosphere(0))
    result = run("dec", sphere, "-o", "-", "--output-format", ".npz")
    assert np.load(io.BytesIO(result.stdout_bytes))["star0_shape"].tolist() == [12, 12]
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_flow_that_cannot_move_is_resumed_as_one(run, tmp_path):
    """Once it made steps: the first frame did not store the reason of the end."""
    disk, trajectory = written(tmp_path / "a.npz", shapes.grid(1, 1)), tmp_path / "b.vtkhdf"
    flow = ("willmore-flow", disk, "--duration", 0.5, "-o", trajectory)
    with interrupted_after(1):
        assert run(*flow).exit_code == 130
    result = run(*flow, "--resume", f"{trajectory}.part", "--json")
    assert json.loads(result.stdout)["results"]["stopped_because"].startswith("no vertex can move")


def test_a_signed_distance_without_tangent_planes_is_refused_by_the_dry_run(run, tmp_path):
    points = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 1, 0]]
    mesh = TriangleMesh.from_arrays(np.array(points), np.array([[0, 1, 2], [0, 3, 4], [1, 5, 2]]))
    curve = tmp_path / "c.npy"
    np.save(curve, [[0, 1]])
    words = ("geodesic", written(tmp_path / "a.npz", mesh), "--signed-distance", curve, "--method", "heat")
    errors = [run(*words, *more).stderr for more in ((), ("--dry-run",))]
    assert "has no tangent plane" in errors[0]
    assert errors[0] == errors[1]


@pytest.mark.parametrize("suffix", [".stl", ".glb", ".ply"])
def test_single_precision_far_from_the_origin_warns(run, tmp_path, suffix):
    """A ball 1e14 away became one point, exit 0, in silence."""
    ball = shapes.icosphere(1)
    for offset, warns in ((1e8, suffix != ".ply"), (10.0, False)):
        write_mesh(str(tmp_path / "far.npz"), AnnotatedMesh(ball.moved(ball.points + offset)))
        result = run("laplacian", tmp_path / "far.npz", "--smooth", 1e-3, "-o", tmp_path / f"o{suffix}")
        assert result.exit_code == 0 and ("32-bit coordinates" in result.stderr) == warns


@pytest.mark.parametrize("words", ["--straighten 3,10,20", "--loop 8,9,15,14", "--field wind"])
def test_a_dry_run_of_curves_refuses_faces_that_name_a_vertex_twice(run, tmp_path, words):
    """The run did, after the prediction of what it takes."""
    mesh = shapes.grid(6, 6)
    mesh = TriangleMesh.from_arrays(mesh.points, np.vstack([mesh.faces, [0, 1, 1]]))
    path = tmp_path / "a.npz"
    write_mesh(path, AnnotatedMesh(mesh, vertex={"wind": np.ones((mesh.n_vertices, 3))}))
    for more in ((), ("--dry-run",)):
        result = run("geodesic", path, *words.split(), *more)
        assert result.exit_code == 2 and "face 72 names a vertex twice" in result.stderr
