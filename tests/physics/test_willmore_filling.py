"""Holes filled with patches that flow, and free boundaries."""

import json
import re

import numpy as np
import pytest

from benchmarks.common.submesh import submesh
from ddgcli.algorithms.repair.patches import fill_loops
from ddgcli.algorithms.repair.pipeline import RepairSteps, repair_mesh
from ddgcli.algorithms.repair.polygon_triangulation import (
    NotAPolygonError,
    points_inside,
    polygon_triangles,
)
from ddgcli.algorithms.repair.steps import RepairedMesh, separated
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import DEFAULT_STOP
from tests.physics.willmore_runs import assert_falls, energies, run_flow, saddle


def ball_with_holes(level, top=0.8, bottom=-2.0):
    """The unit sphere without the faces above z = top and below z = bottom."""
    ball = shapes.icosphere(level)
    z = ball.points[ball.faces][..., 2]
    faces = ball.faces[~((z > top).all(axis=1) | (z < bottom).all(axis=1))]
    return submesh(ball, faces)


def test_patches_that_would_fold_onto_the_surface_are_refused_with_a_remedy_that_works():
    holed = ball_with_holes(2)
    apart = np.concatenate([holed.points, [[3.0, 0, 0], [4, 0, 0], [3, 1, 0]]])
    triangle = TriangleMesh.from_arrays(
        apart, np.concatenate([holed.faces, [holed.n_vertices + np.arange(3)]])
    )
    flat = shapes.grid(6, 6)
    from_centre = np.abs(flat.points[flat.faces].mean(axis=1) - flat.points.mean(axis=0)).max(axis=1)
    holes = submesh(flat, flat.faces[from_centre > 0.2 * np.ptp(flat.points[:, 0])])
    for mesh, advice in [(triangle, "repair=largest"), (flat, "leave `fill` out"), (holes, "such as `fill=")]:
        with pytest.raises(MeshError, match="1 boundary loop bounds flat pieces") as error:
            fill_loops(mesh)
        assert advice in str(error.value)
    closed = fill_loops(holes, int(re.search("fill=([0-9]+)", str(error.value))[1]))[0]
    assert closed.topology.boundary_loops == 1
    largest = repair_mesh(triangle, RepairSteps(largest=True, drop_unused=True))[0].mesh
    assert fill_loops(largest)[0].topology.is_closed


def test_a_loop_that_runs_back_along_itself_is_refused():
    flat = shapes.grid(4, 4)
    along = (flat.topology.edges == [[7, 12]]).all(axis=1) | (flat.topology.edges == [[12, 17]]).all(axis=1)
    assert along.sum() == 2
    with pytest.raises(MeshError, match="through vertex 7 runs back along itself"):
        fill_loops(separated(RepairedMesh.unchanged(flat), ~along).mesh, 12)


@pytest.mark.parametrize("level, top", [(2, 0.8), (3, 0.8), (3, 0.4)])
def test_a_filled_sphere_returns_to_the_sphere(level, top):
    holed = ball_with_holes(level, top)
    closed, patch = fill_loops(holed)
    assert closed.topology.is_closed and closed.topology.euler_characteristic == 2
    assert np.array_equal(closed.faces[: holed.n_faces], holed.faces)
    snapshots, end, _ = run_flow(closed, region=patch)
    h = 2.0 / np.sqrt(10 * 4**level)
    off = np.abs(np.linalg.norm(end.points, axis=1) - 1)
    assert np.abs(np.linalg.norm(closed.points, axis=1) - 1).max() > 0.1 and off.max() < 0.02 * h**2
    assert np.array_equal(end.points[~patch], holed.points)
    cosine = np.einsum("ij,ij->i", sphere_normals(end), end.points)  # also at the seam
    assert cosine.min() > 1 - 0.02 * h**2
    assert energies(snapshots)[-1] == pytest.approx(4 * np.pi, rel=1e-6)
    assert_falls(snapshots)


def test_patches_of_rough_loops_are_manifolds():
    """Also where an edge of the mesh already joins two vertices of a loop."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        ball = shapes.random_sphere(120, seed=seed)
        start, size = rng.integers(ball.n_faces), int(rng.integers(1, 30))
        middle = ball.points[ball.faces].mean(axis=1)
        hole = np.argsort(np.linalg.norm(middle - middle[start], axis=1))[:size]
        holed = submesh(ball, np.delete(ball.faces, hole, axis=0))
        if not holed.topology.is_manifold:
            continue
        closed, _ = fill_loops(holed)
        assert closed.topology.is_closed and closed.topology.is_manifold
        assert closed.topology.euler_characteristic == 2 and closed.topology.is_oriented


def catenoid_with_jagged_hole():
    """The catenoid without the faces around (1, 0, 0), and a vertex of the hole's rim."""
    whole = shapes.catenoid(40, 20)
    middle = whole.points[whole.faces].mean(axis=1)
    holed = submesh(whole, whole.faces[np.linalg.norm(middle - [1, 0, 0], axis=1) > 0.5])
    inside = np.abs(holed.points[:, 2]) < 0.9
    return holed, int(np.flatnonzero(holed.topology.boundary_vertex & inside)[0])


def test_a_jagged_hole_in_a_catenoid_is_filled_with_the_catenoid():
    """Once with needles of 165 degrees, on which the catenoid itself had an energy of bending."""
    holed, on_rim = catenoid_with_jagged_hole()
    closed, patch = fill_loops(holed, on_rim)
    added = corner_angle(closed.side_length)[holed.n_faces :]
    assert np.degrees(added.max()) < 120 and np.degrees(added.min()) > 20
    exact = closed.points.copy()
    exact[patch, :2] *= (np.cosh(exact[patch, 2]) / np.hypot(*exact[patch, :2].T))[:, None]
    snapshots, _, _ = run_flow(closed.moved(exact), region=patch, steps=1)
    assert energies(snapshots)[0] < 0.01
    snapshots, end, _ = run_flow(closed, region=patch)
    assert energies(snapshots)[-1] < 0.002
    x, y, z = end.points[patch].T
    assert np.abs(np.hypot(x, y) - np.cosh(z)).max() < (2 * np.pi / 40) ** 2 / 8  # the sagitta of an edge
    assert_falls(snapshots)


@pytest.mark.parametrize(
    ("surface", "most"), [(shapes.icosphere(3), 125), (shapes.torus(48, 24), 145)], ids=["sphere", "torus"]
)
def test_patches_of_jagged_holes_have_no_needles(surface, most):
    """Once up to 170 degrees. The holes of the torus have rims with edges that are not Delaunay."""
    middle = surface.points[surface.faces].mean(axis=1)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        nearest = np.argsort(np.linalg.norm(middle - middle[rng.integers(surface.n_faces)], axis=1))
        holed = submesh(surface, np.delete(surface.faces, nearest[: rng.integers(20, 120)], axis=0))
        closed, patch = fill_loops(holed)
        assert closed.topology.is_closed and closed.topology.is_manifold and closed.topology.is_oriented
        assert closed.topology.euler_characteristic == surface.topology.euler_characteristic
        assert np.degrees(corner_angle(closed.side_length)[holed.n_faces :].max()) < most


def test_loops_that_cross_themselves_in_every_plane_are_filled():
    """Both loops of a band along a trefoil knot."""
    t = 2 * np.pi * np.arange(60) / 60
    knot = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    i, j = np.arange(60), (np.arange(60) + 1) % 60
    faces = np.concatenate([np.stack([i, j, i + 60], axis=1), np.stack([j, j + 60, i + 60], axis=1)])
    band = TriangleMesh.from_arrays(np.concatenate([knot, knot + [0, 0, 0.2]]), faces)
    closed, patch = fill_loops(band)
    assert closed.topology.is_closed and closed.topology.is_manifold and closed.topology.is_oriented
    assert closed.topology.euler_characteristic == 2 and patch.sum() > 100


def doubled_area(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def star(n, seed):
    """Corners of a polygon around the origin with random radii, counter-clockwise."""
    angle = 2 * np.pi * np.arange(n) / n
    radius = np.random.default_rng(seed).uniform(0.2, 1.0, n)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("n", [3, 9, 40])
def test_polygons_are_triangulated_with_their_edges(n):
    """Such stars have edges that are not Delaunay."""
    for seed in range(10):
        rim = star(n, seed)
        points = np.random.default_rng(seed).uniform(-1, 1, (60, 2))
        radius, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
        k = np.floor(angle / (2 * np.pi / n)).astype(int) % n
        a, b = rim[k], rim[(k + 1) % n]
        ray = doubled_area(a, b) / doubled_area(points / radius[:, None], b - a)  # length up to the side
        inside = points_inside(rim, points)
        assert np.array_equal(inside, radius < ray)
        triangles = polygon_triangles(rim, points[inside])
        assert len(triangles) == n - 2 + 2 * inside.sum()
        flat = np.concatenate([rim, points[inside]])
        corner = flat[triangles]
        doubled = doubled_area(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        assert doubled.min() > 0
        assert doubled.sum() == pytest.approx(doubled_area(rim, np.roll(rim, -1, axis=0)).sum(), rel=1e-12)


@pytest.mark.parametrize(
    "rim",
    [
        [[0, 0], [1, 0], [0, 1], [1, 1]],
        [[0, 0], [1, 0], [1, 1], [0, 0], [-1, 1]],
        [[0, 0], [0.5, 0], [1, 0]],
    ],
    ids=["crossing", "touching", "straight"],
)
def test_lines_that_bound_no_polygon_are_refused(rim):
    with pytest.raises(NotAPolygonError):
        polygon_triangles(0.5 * np.array(rim, dtype=float), np.zeros((0, 2)))


def test_an_ear_between_two_loop_vertices_is_kept_a_manifold():
    """A hole of four edges whose only diagonals exist already: a tetrahedron's edges."""
    faces = [[0, 1, 2], [0, 3, 1]]
    mesh = TriangleMesh.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]], faces)
    closed, patch = fill_loops(mesh)
    assert closed.topology.is_closed and closed.topology.is_manifold


@pytest.fixture
def holed_file(tmp_path):
    path = tmp_path / "holed.ply"
    mesh = ball_with_holes(2, 0.8, -0.8)
    write_mesh(str(path), AnnotatedMesh(mesh))
    return path, mesh, tmp_path


def test_one_loop_or_all_are_filled(run, holed_file):
    path, mesh, folder = holed_file
    loops = boundary_vertex_loops(mesh.topology)
    assert len(loops) == 2
    for loop, n_holes in ((str(loops[1][3]), 1), ("all", 0)):
        out = folder / "filled.ply"
        result = run("willmore-flow", path, "--fill", loop, "-o", out, "--json")
        assert result.exit_code == 0, result.stderr
        results = json.loads(result.stdout)["results"]
        filled = read_mesh(str(out)).surface
        assert filled.topology.boundary_loops == n_holes
        assert results["patch"]["faces"] == filled.n_faces - mesh.n_faces > 0
        assert results["patch"]["vertices"] == filled.n_vertices - mesh.n_vertices
        most = 1e-3 if n_holes == 0 else 0.02  # with a boundary the default energy is cotan
        assert np.abs(np.linalg.norm(filled.points, axis=1) - 1).max() < most


@pytest.mark.parametrize(
    "words, message",
    [
        (("--fill", "hole"), "not a vertex index"),
        (("--fill", "60"), "on no boundary loop"),
        (("--fill", "all", "--region", "x.npy"), "--region"),
    ],
)
def test_wrong_loops_are_refused(run, holed_file, words, message):
    path, mesh, folder = holed_file
    assert not mesh.topology.boundary_vertex[60]
    np.save(folder / "x.npy", [1, 2])
    words = (folder / word if word == "x.npy" else word for word in words)
    result = run("willmore-flow", path, *words, "--json")
    assert result.exit_code == 2 and result.stdout == "" and message in result.stderr
    assert "--fill" in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_closed_surfaces_have_no_hole_to_fill(run, tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    result = run("willmore-flow", path, "--fill", "all", "--json")
    assert result.exit_code == 2 and "closed" in result.stderr


@pytest.mark.parametrize("energy", ["cotan", "sullivan"])
def test_with_a_free_boundary_the_surface_becomes_minimal(energy):
    """Minimal surfaces have no energy; the saddle's rim moves to let it become one."""
    mesh = saddle(12)
    snapshots, end, _ = run_flow(mesh, FlowOptions(energy=energy, boundary="free", stop=DEFAULT_STOP))
    assert energies(snapshots)[-1] < 0.01 * energies(snapshots)[0]
    rim = mesh.topology.boundary_vertex
    assert np.linalg.norm(end.points - mesh.points, axis=1)[rim].max() > 0.005
    assert snapshots[-1].scalar["min_angle_degrees"] > 25
    assert_falls(snapshots)


def test_free_films_and_gauss_map_energies_are_refused(run, tmp_path):
    path = tmp_path / "saddle.ply"
    write_mesh(str(path), AnnotatedMesh(saddle(6)))
    for words, message in (
        (("--flow", "mean-curvature"), "--boundary fixed"),
        (("--energy", "gauss-map"), "--energy cotan"),
    ):
        result = run("willmore-flow", path, "--boundary", "free", *words, "--json")
        assert result.exit_code == 2 and message in result.stderr


def test_a_loop_with_an_edge_of_rounding_is_refused():
    """Two of its three vertices lie on one point of the circle: once an internal error."""
    points = [[0, 0, 0], [1e-20, 0, 0], [1, 0, 0], [0.5, 0.5, 1]]
    cone = TriangleMesh.from_arrays(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]])
    with pytest.raises(MeshError, match="runs back along itself"):
        fill_loops(cone)


@pytest.mark.parametrize("words", [(), ("--duration", 0.1)], ids=["to rest", "in time"])
def test_a_hole_of_one_face_is_filled_with_a_warning_that_nothing_moves(run, tmp_path, words):
    """Once the reason named the boundary, which the filled surface does not have, without a warning."""
    ball = shapes.icosphere(1)
    path, out = tmp_path / "a.npz", tmp_path / "b.npz"
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(ball.points, ball.faces[1:])))
    result = run("willmore-flow", path, "--fill", "all", *words, "-o", out, "--json")
    summary = json.loads(result.stdout)
    reason = "no vertex can move: the patches have no vertices inside"
    assert summary["results"]["stopped_because"] == reason
    assert [reason in warning for warning in summary["warnings"]] == [True]
    assert result.exit_code == 0 and read_mesh(str(out)).surface.topology.is_closed


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ((), "all lie on the boundary, which is clamped, or beside it"),
        (("--boundary", "fixed", "--region", "0"), "all of the region lie on the boundary, which is fixed"),
        (("--flow", "mean-curvature", "--duration", 1), "all lie on the boundary, which is fixed"),
    ],
)
def test_a_surface_whose_vertices_are_all_held_stays_with_a_warning(run, tmp_path, words, reason):
    path, region = tmp_path / "a.npz", tmp_path / "r.txt"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(1, 1)))
    region.write_text("0\n")
    result = run("willmore-flow", path, *(region if word == "0" else word for word in words), "--json")
    summary = json.loads(result.stdout)
    assert summary["results"]["stopped_because"] == f"no vertex can move: {reason}"
    (warning,) = summary["warnings"]
    assert reason in warning and "--boundary free" in warning and "--subdivide" in warning
    freed = run("willmore-flow", path, "--boundary", "free", "--json")
    assert "no vertex can move" not in freed.stdout
