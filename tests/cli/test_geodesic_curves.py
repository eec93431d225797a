"""`ddgcli geodesic` with curves: names of the contract, files, errors."""

import json

import numpy as np
import pytest

from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

TRACE = "5:0.2,0.3,0.5:1,0,0.2:2.5"


@pytest.fixture
def sphere(tmp_path):
    mesh = shapes.icosphere(3)
    path = tmp_path / "sphere.npz"
    field = np.cross([0, 0, 1.0], mesh.points)
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"spin": field}))
    return path


def test_one_run_computes_all_kinds_of_curves(summary, sphere, tmp_path):
    out = tmp_path / "paths.npz"
    report = summary(
        "geodesic", sphere, "--source", 3, "--path-to", 100, 200, "--trace", TRACE, "17:1,0,0:0,1,0:1",
        "--straighten", "3,50,80", "--loop", "1,60,88", "--field", "spin", "--field-time", 1, "--transport",
        "--log-map", "--spread-vector", "1,0,0", "--paths-output", out,
        "-o", tmp_path / "out.npz",
    )  # fmt: skip
    paths = report["results"]["paths"]
    kinds = [p["kind"] for p in paths]
    assert kinds == ["shortest"] * 2 + ["trace"] * 2 + ["straightened", "loop", "integral curve"]
    for path in paths[:5]:
        assert {"length", "start", "end", "vertices"} <= set(path)
    assert paths[2]["length"] == pytest.approx(2.5, rel=1e-12)
    assert report["accuracy"]["trace_angle_defect"] < 1e-9
    assert report["accuracy"]["path_length_residual"] < 1e-12
    with np.load(out) as z:
        assert {"points", "lines", "path_id", "face", "barycentric", "transport_x", "transport_y"} <= set(z)
        assert z["path_id"].max() == len(paths) - 1
        one = z["points"][z["path_id"] == 2]
        assert np.linalg.norm(np.diff(one, axis=0), axis=1).sum() == pytest.approx(2.5, rel=1e-12)
    with np.load(tmp_path / "out.npz") as z:
        assert z["log_map"].shape == (642, 2)
        np.testing.assert_allclose(np.linalg.norm(z["log_map"], axis=1), z["geodesic_distance"], rtol=1e-12)
        assert z["transported_vector"].shape == (642, 3)


def test_an_edge_path_has_geodesic_curvature_and_holonomy(summary, tmp_path):
    mesh, file, out = shapes.box(3, 3, 3), tmp_path / "box.npz", tmp_path / "c.npz"
    write_mesh(str(file), AnnotatedMesh(mesh))
    corner = int(np.argmax(mesh.points.sum(axis=1)))
    edges = mesh.topology.edges
    link = set(edges[(edges == corner).any(axis=1)].ravel().tolist()) - {corner}
    around = vertex_fans(mesh)
    fan = int(np.flatnonzero(around.vertex == corner)[0])
    corners = around.corner[around.start[fan] : around.start[fan + 1]]
    ring = mesh.topology.side_head[corners].tolist()
    assert set(ring) == link
    report = summary(
        "geodesic", file, "--curve", ",".join(map(str, [*ring, ring[0]])), "--curve", f"{ring[0]},{corner}",
        "--transport", "--paths-output", out,
    )  # fmt: skip
    loop, spoke = report["results"]["paths"]
    assert loop["closed"] and loop["points"] == len(ring)
    assert loop["holonomy"] == pytest.approx(np.pi / 2, abs=1e-12)  # the angle defect of the corner
    assert loop["total_geodesic_curvature"] == pytest.approx(2 * np.pi - np.pi / 2, abs=1e-12)  # Gauss-Bonnet
    left = sum(np.pi - bend["left"] for bend in loop["vertices"])  # the corner lies on the left
    right = sum(np.pi - bend["right"] for bend in loop["vertices"])
    assert left == pytest.approx(1.5 * np.pi, abs=1e-12) and right < 0
    assert not spoke["closed"] and spoke["total_geodesic_curvature"] == 0
    assert spoke["length"] == pytest.approx(np.linalg.norm(mesh.points[ring[0]] - mesh.points[corner]))
    with np.load(out) as z:
        first = z["geodesic_curvature"][z["path_id"] == 0][: len(ring)]
        assert first.sum() == pytest.approx(1.5 * np.pi, abs=1e-12)


@pytest.mark.slow
def test_the_picture_of_curves_is_written(summary, sphere, tmp_path):
    picture = tmp_path / "p.png"
    summary("geodesic", sphere, "--trace", TRACE, "--plot", picture)
    assert picture.stat().st_size > 10_000


def read_by_vtk(path):
    """Points, polylines and point arrays as the readers see them that ParaView has."""
    pytest.importorskip("vtk")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOGeometry import vtkOBJReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    readers = {".vtp": vtkXMLPolyDataReader, ".vtu": vtkXMLUnstructuredGridReader, ".obj": vtkOBJReader}
    reader = readers[path.suffix]()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    points, arrays = vtk_to_numpy(data.GetPoints().GetData()).copy(), data.GetPointData()
    chains = []
    for k in range(data.GetNumberOfCells()):
        ids = data.GetCell(k).GetPointIds()
        chains.append([ids.GetId(j) for j in range(ids.GetNumberOfIds())])
    names = [arrays.GetArrayName(k) for k in range(arrays.GetNumberOfArrays())]
    return points, chains, {name: vtk_to_numpy(arrays.GetArray(name)).copy() for name in names}


def read_by_trimesh(path):
    """Points and polylines as trimesh sees them; it keeps no arrays."""
    import trimesh

    path = trimesh.load(path, process=False)
    return path.vertices, [entity.points for entity in path.entities], {}


@pytest.mark.parametrize(
    "suffix, read, has_arrays",
    [
        ("vtp", read_by_vtk, True),
        ("vtu", read_by_vtk, True),
        ("obj", read_by_vtk, False),
        ("ply", read_by_trimesh, False),
    ],
)
def test_vtk_and_trimesh_read_the_paths(summary, sphere, tmp_path, suffix, read, has_arrays):
    """ParaView's readers and trimesh see the polylines and arrays of our own file."""
    ours, theirs = tmp_path / "paths.npz", tmp_path / f"paths.{suffix}"
    words = ("--trace", TRACE, "--path-to", "30", "--source", "0", "--isolines", "3", "--transport")
    summary("geodesic", sphere, *words, "--paths-output", ours, "--paths-output", theirs)
    own = np.load(ours)
    points, chains, arrays = read(theirs)
    exact = 1e-6 if suffix == "obj" else 0.0  # VTK reads OBJ into float32
    np.testing.assert_allclose(points, own["points"], rtol=0, atol=exact)
    segments = {tuple(sorted(pair)) for chain in chains for pair in zip(chain[:-1], chain[1:], strict=True)}
    assert segments == {tuple(sorted(pair)) for pair in own["lines"].tolist()}
    names = {"path_id", "face", "barycentric", "transport_x", "transport_y", "level"}
    assert names <= set(own)
    for name in names if has_arrays else ():
        np.testing.assert_array_equal(arrays[name], own[name])


def test_traces_report_their_status_and_the_log_map_its_axis(summary, tmp_path):
    mesh, file, out = shapes.grid(8, 8), tmp_path / "square.npz", tmp_path / "log.npz"
    write_mesh(str(file), AnnotatedMesh(mesh))
    start = mesh.points[mesh.faces[20]].mean(axis=0)
    third = "0.3333333333333333,0.3333333333333333,0.3333333333333334"
    lines = f"20:{third}:3,4,0:0.1", f"20:{third}:-3,-4,0:9"
    report = summary("geodesic", file, "--source", 40, "--log-map", "--trace", *lines, "-o", out)["results"]
    short, long = report["paths"]
    for path, status, direction in ((short, "reached", [0.6, 0.8, 0]), (long, "boundary", [-0.6, -0.8, 0])):
        assert path["status"] == status and path["crossings"] == path["points"] - 2
        np.testing.assert_allclose(path["end_direction"], direction, atol=1e-12)
        displacement = np.array(path["end"]["point"]) - start
        np.testing.assert_allclose(displacement, path["length"] * np.array(direction), atol=1e-12)
    assert short["target_length"] == 0.1 and short["length"] == pytest.approx(0.1, rel=1e-14)
    assert long["length"] < long["target_length"] == 9
    axis = report["log_map_axis"]
    ahead = mesh.points[axis["towards_vertex"]] - mesh.points[40]
    np.testing.assert_allclose(axis["x_axis"], ahead / np.linalg.norm(ahead), atol=1e-15)
    maps = np.load(out)["log_map"][axis["towards_vertex"]]
    np.testing.assert_allclose(maps, [np.linalg.norm(ahead), 0], atol=1e-15)


def test_the_log_map_has_the_method_of_the_distance(summary, sphere, tmp_path):
    maps = {}
    for method, field in (
        ("exact", "log_map_miss"),
        ("fast-marching", "log_map_skew"),
        ("heat", "log_map_skew"),
    ):
        out = tmp_path / f"{method}.npz"
        report = summary("geodesic", sphere, "--source", 3, "--log-map", "--method", method, "-o", out)
        assert field in report["accuracy"] and len([k for k in report["accuracy"] if "log_map" in k]) == 1
        with np.load(out) as z:
            maps[method] = z["log_map"], report["results"]["log_map_axis"]
            size = np.linalg.norm(z["log_map"], axis=1)
            np.testing.assert_allclose(size, z["geodesic_distance"], rtol=1e-12)
    exact, axis = maps.pop("exact")
    for approximate, same in maps.values():
        assert axis == same and np.abs(approximate - exact).max() / np.pi > 1e-4
        assert np.median(np.linalg.norm(approximate - exact, axis=1)) < 0.05


def test_angles_at_vertices_are_reported(summary, sphere):
    mesh = shapes.icosphere(3)
    ahead = mesh.points[mesh.faces[0, 1]] - mesh.points[mesh.faces[0, 0]]
    words = ",".join(repr(float(x)) for x in ahead)
    (path,) = summary("geodesic", sphere, "--trace", f"0:1,0,0:{words}:1.5")["results"]["paths"]
    assert path["vertices"]
    for vertex in path["vertices"]:
        assert vertex["left"] == pytest.approx(vertex["right"], abs=1e-9)


def test_bends_on_a_one_sided_surface_have_both_angles(summary, tmp_path):
    """A Moebius band of four strips, folded roughly: inner bends have left and right, no null."""
    n, k = 16, 4
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(-0.4, 0.4, k + 1), indexing="ij")
    r = 1 + v * np.cos(u / 2)
    points = np.stack([r * np.cos(u), r * np.sin(u), v * np.sin(u / 2)], axis=-1).reshape(-1, 3)
    points += 0.15 * np.random.default_rng(0).normal(size=points.shape)
    number = np.arange(n * (k + 1)).reshape(n, k + 1)
    number = np.vstack([number, number[0, ::-1]])
    a, b, c, d = (q.ravel() for q in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    np.savez(tmp_path / "band.npz", points=points, faces=faces)
    inner = set(np.arange(n * (k + 1)).reshape(n, k + 1)[:, 1:-1].ravel().tolist())
    report = summary("geodesic", tmp_path / "band.npz", "--source", 33, "--path-to", *range(n * (k + 1)))
    bends = [bend for path in report["results"]["paths"] for bend in path["vertices"]]
    bends = [bend for bend in bends if bend["vertex"] in inner]
    assert len(bends) > 20
    assert all(bend["left"] and bend["right"] for bend in bends)


@pytest.mark.parametrize(
    "words, reason",
    [
        (["--trace", "99999:1,0,0:1,0,0:1"], "99999"),
        (["--trace", "0:0.5,0.6,0.7:1,0,0:1"], "sum to 1"),
        (["--trace", "0:1,0,0:0,0,0:1"], "direction"),
        (["--trace", "0:1,0,0:1,0,0:-1"], "length"),
        (["--trace", "0:1,0,0:1,0,0:nan"], "finite"),
        (["--trace", "0:1,0,0:1,0,0"], "FACE:b0,b1,b2"),
        (["--path-to", "3"], "needs a source"),
        (["--source", "0", "--path-to", "99999"], "99999"),
        (["--source", "0", "--path-to", "3", "--method", "dijkstra"], "exact distance"),
        (["--source", "0", "1", "--log-map"], "one source"),
        (["--source", "0", "1", "--log-map", "--method", "fast-marching"], "one source"),
        (["--source", "0", "--log-map", "--method", "dijkstra"], "--method fast-marching"),
        (["--source", "0", "--paths-output", "x.vtp"], "no curves"),
        (["--field", "nothing"], "--field: no array 'nothing'"),
        (["--field-time", "1", "--trace", TRACE], "belongs to --field"),
        (["--field-order", "2", "--trace", TRACE], "belongs to --field"),
        (["--source", "0", "--at-boundary", "reflect"], "belongs to --trace"),
        (["--trace", TRACE, "--tolerance", "0.1"], "needs a source"),
        (["--trace", TRACE, "--method", "heat"], "needs a source"),
        (["--straighten", "3"], "two different"),
        (["--straighten", "3,x"], "vertex indices"),
        (
            ["--source", "0", "--spread-vector", "1,0,0", "--spread-vector", "0,1,0"],
            "--spread-vector: 2 vectors for 1 source vertex; give one for each",
        ),
        (
            ["--source", "0,5,0", *2 * ["--spread-vector", "1,0,0"], "--spread-vector", "0,1,0"],
            "vertex 0 has two vectors, [1.0, 0.0, 0.0] and [0.0, 1.0, 0.0]",
        ),
    ],
)
def test_bad_curve_options_are_refused_in_one_line(run, sphere, tmp_path, words, reason):
    out = tmp_path / "out.npz"
    result = run("geodesic", sphere, *words, "-o", out)
    assert result.exit_code == 2, result.output
    assert reason in result.stderr and result.stderr.startswith("Error:") and result.stderr.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("name", ["gen_denormal_scale.obj", "gen_overflow_scale.obj"])
def test_vector_transport_on_extreme_scales_is_refused(run, shared_meshes, name):
    result = run("geodesic", shared_meshes / "hard" / name, "--source", 0, "--spread-vector", "1,0.3,0.2")
    assert result.exit_code == 2 and "rescale" in result.stderr and result.stderr.count("\n") == 1


def test_unreached_targets_give_exit_1(run, tmp_path):
    a = shapes.icosphere(1)
    two = np.concatenate([a.points, a.points + 5]), np.concatenate([a.faces, a.faces + a.n_vertices])
    path = tmp_path / "two.npz"
    np.savez(path, points=two[0], faces=two[1])
    written = tmp_path / "distance.vtu", tmp_path / "lines.vtp"
    result = run(
        "geodesic", path, "--source", 0, "--path-to", 1, 50, "--json", "-q", "-o", written[0],
        "--paths-output", written[1],
    )  # fmt: skip
    assert result.exit_code == 1
    for output in written:
        assert b'"converged": false' in output.read_bytes().replace(b"&quot;", b'"')
    report = json.loads(result.stdout)
    assert report["results"]["converged"] is False and report["results"]["paths"][1]["length"] is None


@pytest.mark.slow
def test_hard_meshes_have_finite_curves_or_one_error_line(run, shared_meshes):
    """Traces and paths on every hard mesh: an answer or one line, never a traceback or nan."""
    n_solved = 0
    for path in sorted((shared_meshes / "hard").iterdir()):
        if path.suffix in (".json", ".md", ".msh", ".mesh") or path.stat().st_size > 300_000:
            continue
        result = run(
            "geodesic", path, "--source", 0, "--path-to", 2, "--log-map",
            "--trace", "0:0.2,0.3,0.5:1,0.3,0.2:3", "--straighten", "0,2", "--json", "-q",
        )  # fmt: skip
        assert result.exit_code in (0, 1, 2), (path, result.exception)
        assert result.exception is None or isinstance(result.exception, SystemExit), (path, result.exception)
        if result.exit_code < 2:
            report = json.loads(result.stdout)
            for entry in report["results"]["paths"]:
                assert entry["length"] is None or np.isfinite(entry["length"]), path
                n_solved += entry["length"] is not None
        else:
            assert result.stderr.count("\n") == 1, (path, result.stderr)
    assert n_solved >= 20
