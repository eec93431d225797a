"""`--subdivide`: the same surface, so what a call names on the input is the same on the finer mesh."""

import numpy as np
import pytest

from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision

MESH = shapes.grid(8, 8, pattern="alternating")
COLUMN = 36 + np.arange(9)  # the vertices on x = 1/2, in the direction of y
LEFT = MESH.points[MESH.faces].mean(axis=1)[:, 0] < 0.5


@pytest.fixture
def square(tmp_path):
    """Unit square with marks on the vertices of x = 1/2 and labels of its left half."""
    path = tmp_path / "square.npz"
    line = np.isin(np.arange(MESH.n_vertices), COLUMN)
    vertex = {"line": line.astype(float), "mark": line.astype(np.int8)}
    write_mesh(str(path), AnnotatedMesh(MESH, vertex=vertex, face={"left": LEFT.astype(np.int8)}))
    return path


def test_points_edges_and_values_are_the_same_on_the_subdivision():
    mesh = shapes.random_sphere(30)
    finer = MidpointSubdivision.of(mesh, 3)
    rng = np.random.default_rng(0)
    face, weights = rng.integers(0, mesh.n_faces, 300), rng.dirichlet(np.ones(3), 300)
    weights[:6] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.25, 0.5, 0.25]]
    points = SurfacePoints(*finer.points(face, weights))
    expected = SurfacePoints(face, weights).positions(mesh)
    assert np.abs(points.positions(finer.mesh) - expected).max() < 1e-14 and points.barycentric.min() >= 0
    assert np.array_equal(finer.face_values(np.arange(mesh.n_faces))[points.face], face)
    assert np.array_equal(finer.vertex_values(mesh.points), finer.mesh.points)
    pairs, row = finer.edge_pieces(mesh.topology.edges)
    piece = finer.mesh.points[pairs[:, 1]] - finer.mesh.points[pairs[:, 0]]
    whole = mesh.points[mesh.topology.edges[:, 1]] - mesh.points[mesh.topology.edges[:, 0]]
    assert np.abs(8 * piece - whole[row]).max() < 1e-14


@pytest.mark.parametrize("times", [0, 1, 2])
def test_points_on_faces_stay_where_they_are(square, summary, tmp_path, times):
    words = ["geodesic", square, "--source-face", "17:0.2,0.7,0.1", "--target-face", "30:0.1,0.1,0.8"]
    words += ["--trace", "17:0.2,0.7,0.1:1,0.2,0:0.1", "--subdivide", times]
    results = summary(*words, "-o", tmp_path / "d.npz")["results"]
    start, target = np.array([0.2, 0.7, 0.1]), np.array([0.1, 0.1, 0.8])
    start, target = start @ MESH.points[MESH.faces[17]], target @ MESH.points[MESH.faces[30]]
    assert results["sources"][0]["position"] == pytest.approx(start, abs=1e-14)
    assert results["targets"][0]["distance"] == pytest.approx(np.linalg.norm(target - start), abs=1e-14)
    assert results["paths"][0]["start"]["point"] == pytest.approx(start, abs=1e-14)


def test_faces_are_those_of_the_input(square, run):
    result = run("geodesic", square, "--source-face", "128:0.2,0.7,0.1", "--subdivide", 1)
    assert result.exit_code == 2 and "face 128 is outside 0..127" in result.stderr


@pytest.mark.parametrize("kind", ["line", "mark", "left", "pairs", "labels", "polyline"])
def test_curves_are_the_same_curves(square, summary, tmp_path, kind):
    """Marks on vertices were interpolated, and half marked vertices were sources; the rest was an error."""
    name = tmp_path / "curve.csv"
    if kind == "pairs":
        np.savetxt(name, np.stack([COLUMN[:-1], COLUMN[1:]], axis=1), fmt="%d", delimiter=",")
    elif kind == "labels":
        np.savetxt(name, LEFT.astype(int), fmt="%d")
    elif kind == "polyline":
        name = tmp_path / "curve.vtp"
        write_mesh(str(name), AnnotatedMesh(CurveSet.from_paths([MESH.points[COLUMN]])))
    else:
        name = kind
    output = tmp_path / "d.npz"
    words = ["--source-edges", name, "--signed-distance", name, "--subdivide", 2, "-o", output]
    source = summary("geodesic", square, *words)["results"]["sources"][0]
    assert source["edges"] == 32 and source["length"] == pytest.approx(1)
    arrays = np.load(output)
    x = arrays["points"][:, 0] - 0.5
    assert np.abs(arrays["geodesic_distance"] - np.abs(x)).max() < 1e-14
    signed = np.abs(arrays["signed_distance"]) if kind in ("line", "mark") else arrays["signed_distance"]
    assert np.abs(signed - (np.abs(x) if kind in ("line", "mark") else x)).max() < 1e-14


@pytest.mark.parametrize("on", ["vertices", "faces"])
def test_fields_of_files_follow(square, summary, tmp_path, on):
    n = {"vertices": MESH.n_vertices, "faces": MESH.n_faces}[on]
    np.save(tmp_path / "f.npy", np.tile([0.3, 0.4, 0.0], (n, 1)))
    words = ["--field", tmp_path / "f.npy", "--source", 10, "--field-time", 0.5, "--subdivide", 1]
    path = summary("geodesic", square, *words)["results"]["paths"][0]
    assert path["end"]["point"] == pytest.approx(MESH.points[10] + [0.15, 0.2, 0], abs=1e-9)


def test_functions_of_files_follow(square, summary, tmp_path):
    """A file with one value for each vertex of the input was an error."""
    np.save(tmp_path / "f.npy", MESH.points[:, 0] > 0.6)
    fine = MidpointSubdivision.of(MESH, 1)
    np.save(tmp_path / "fine.npy", fine.vertex_values(1.0 * (MESH.points[:, 0] > 0.6)))
    solutions = []
    for name in ("f.npy", "fine.npy"):
        words = ["--poisson", tmp_path / name, "--fix", "0=0", "--subdivide", 1, "-o", tmp_path / "u.npz"]
        summary("laplacian", square, *words)
        solutions.append(np.load(tmp_path / "u.npz")["poisson"])
    assert np.array_equal(*solutions)


def test_angles_at_the_boundary_are_straight_at_midpoints(square, summary, tmp_path):
    corners = np.isin(np.arange(MESH.n_vertices), [0, 8, 72, 80])
    np.save(tmp_path / "angles.npy", np.where(corners, 90.0, 180.0))
    words = ["--parameterize", "discrete-conformal", "--boundary", "angles", "--boundary-values"]
    words += [tmp_path / "angles.npy", "--subdivide", 1, "-o", tmp_path / "u.npz"]
    summary("laplacian", square, *words)
    assert np.abs(np.load(tmp_path / "u.npz")["log_scale_factor"]).max() < 1e-9


@pytest.mark.parametrize("kind", ["mask", "numbers"])
def test_a_region_is_the_same_region(tmp_path, summary, kind):
    """A mask of the input's length was read as the vertex indices 0 and 1."""
    ball = shapes.icosphere(2)
    mesh = ball.moved(ball.points * np.array([1, 1, 1.2]))
    path, out, name = tmp_path / "ball.ply", tmp_path / "out.npz", tmp_path / "region.npy"
    write_mesh(str(path), AnnotatedMesh(mesh))
    mask = mesh.points[:, 2] > 0.5
    np.save(name, mask if kind == "mask" else np.flatnonzero(mask))
    summary("willmore-flow", path, "--region", name, "--subdivide", 1, "--steps", 1, "-o", out)
    finer = shapes.midpoint_subdivided(mesh)
    moved = np.linalg.norm(np.load(out)["points"] - finer.points, axis=1) > 1e-9
    beside = np.concatenate([mask, mask[mesh.topology.edges].any(axis=1)])
    assert not moved[~beside].any() and moved[beside].mean() > 0.9
