"""Shortest paths have the length of the exact distance, and bend only at saddles and the boundary."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.edge_distance import edge_distance
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.paths import SurfacePaths, joints
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import surface_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.delaunay_cases import non_delaunay_sphere

MESHES = {
    "sphere": shapes.random_sphere(600),
    "torus": shapes.torus(40, 20),
    "box": shapes.box(4, 4, 4),
    "grid": shapes.grid(12, 12),
    "catenoid": shapes.catenoid(24, 12),
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", ["vertex", "points"])
def test_path_length_equals_the_exact_distance(name, kind):
    mesh = MESHES[name]
    points = SurfacePoints(np.array([7, 11]), np.array([[0.2, 0.3, 0.5], [0.0, 0.4, 0.6]]))
    sources = Sources.at([5]) if kind == "vertex" else Sources.at([3], points)
    exact = exact_distance(mesh, sources)
    targets = np.random.default_rng(0).integers(0, mesh.n_vertices, 40).tolist()
    curves = shortest_paths(mesh, exact, sources, targets)
    assert curves.converged and curves.accuracy["path_length_residual"] < 1e-12
    for entry, target in zip(curves.entries, targets, strict=True):
        assert entry["length"] == pytest.approx(exact.distance[target], rel=1e-12, abs=1e-15)
        assert entry["end"]["vertex"] == target
    joint = joints(mesh, curves.paths)
    for angle in (joint.left, joint.right):  # locally shortest: at least pi on both sides
        assert np.nanmin(angle, initial=np.pi) > np.pi - 1e-7


def test_a_path_goes_round_a_hole_along_its_corners():
    mesh = shapes.grid(9, 9, 9.0, 9.0)
    middle = mesh.points[mesh.faces].mean(axis=1)
    mesh = TriangleMesh.from_arrays(mesh.points, mesh.faces[np.abs(middle[:, :2] - 4.5).max(axis=1) > 1.5])
    sources = Sources.at([4 * 10 + 1])  # (4, 1); the hole is [3, 6] x [3, 6]
    target = 4 * 10 + 8
    curves = shortest_paths(mesh, exact_distance(mesh, sources), sources, [target])
    position = surface_position(mesh, curves.paths.face, curves.paths.barycentric)[:, :2]
    for corner in ([4, 1], [3, 3], [3, 6], [4, 8]):
        assert np.abs(position - corner).max(axis=1).min() < 1e-12
    assert curves.entries[0]["length"] == pytest.approx(2 * np.sqrt(5) + 3, rel=1e-14)


def test_unreachable_targets_have_no_path_and_unknown_ones_are_refused():
    a = shapes.icosphere(1)
    two = TriangleMesh.from_arrays(
        np.concatenate([a.points, a.points + 5]), np.concatenate([a.faces, a.faces + a.n_vertices])
    )
    sources = Sources.at([0])
    curves = shortest_paths(two, exact_distance(two, sources), sources, [1, a.n_vertices + 1])
    assert not curves.converged and curves.entries[1]["length"] is None
    with pytest.raises(ParameterError, match="targets: vertex 9999"):
        shortest_paths(two, exact_distance(two, sources), sources, [9999])


def three_sheets(k=8):
    """Three flat sheets on one line, x = 0; vertices of the first come first."""
    grid = shapes.grid(k, k)
    rim, n = grid.points[:, 0] == 0, grid.n_vertices
    points, faces = [], []
    for copy, turn in enumerate((0.0, 2.0, 4.0)):
        x, y = grid.points[:, 0], grid.points[:, 1]
        points.append(np.stack([x * np.cos(turn), y, x * np.sin(turn)], axis=1))
        faces.append(np.where(rim, np.arange(n), np.arange(n) + copy * n)[grid.faces])
    return TriangleMesh.from_arrays(np.concatenate(points), np.concatenate(faces))


def test_paths_across_an_edge_with_three_faces_are_missing_with_a_warning(caplog):
    mesh, source = three_sheets(), Sources.at([40])
    exact = exact_distance(mesh, source)
    curves = shortest_paths(mesh, exact, source, [45, 81 + 20, 162 + 37])
    own, *beyond = curves.entries
    assert own["length"] == pytest.approx(np.linalg.norm(mesh.points[45] - mesh.points[40]), rel=1e-14)
    for entry, target in zip(beyond, (81 + 20, 162 + 37), strict=True):
        assert entry["length"] is None and entry["distance"] == exact.distance[target] < 2
    assert not curves.converged and "2 vertices (first: 101)" in caplog.text
    assert curves.accuracy["path_length_residual"] < 1e-13  # of the paths that there are


@pytest.mark.parametrize("turned", [False, True])
def test_log_map_beyond_an_edge_of_three_faces(turned):
    """Every sheet is unfolded next to the first, for any orientation of its faces."""
    mesh, source = three_sheets(), Sources.at([40])
    if turned:  # the second sheet turned over
        faces = np.where(
            np.isin(mesh.faces, np.arange(81, 162)).any(1)[:, None], mesh.faces[:, ::-1], mesh.faces
        )
        mesh = TriangleMesh.from_arrays(mesh.points, faces)
    mapped = log_map(mesh, exact_distance(mesh, source, directions=True), source)
    first = three_sheets().points[:81, :2]
    unrolled = np.concatenate([first, first * [-1, 1], first * [-1, 1]])
    finite = np.isfinite(mapped.log_map[:, 0])
    np.testing.assert_array_equal(finite, mesh.topology.referenced_vertex)
    flat, truth = mapped.log_map[finite] @ [1, 1j], (unrolled[finite] - unrolled[40]) @ [1, 1j]
    np.testing.assert_allclose(flat, flat[0] / truth[0] * truth, atol=1e-13)
    assert mapped.miss < 1e-13


def test_log_map_beyond_an_edge_of_three_faces_from_the_tip_of_a_cone():
    """The total angle of the source is not 2 pi; the map equals that without the third sheet."""
    mesh, source = three_sheets(), Sources.at([40])
    bumped = mesh.points.copy()
    bumped[40, 2] += 0.1
    mesh = TriangleMesh.from_arrays(bumped, mesh.faces)
    second = np.isin(mesh.faces, np.arange(81, 162)).any(axis=1)
    third = np.isin(mesh.faces, np.arange(162, 243)).any(axis=1)
    two_sheets = np.where(second[:, None], mesh.faces[:, ::-1], mesh.faces)[~third]
    plain = TriangleMesh.from_arrays(bumped, two_sheets)
    maps = [log_map(m, exact_distance(m, source, directions=True), source).log_map for m in (mesh, plain)]
    on_both = np.unique(two_sheets)
    np.testing.assert_allclose(maps[0][on_both], maps[1][on_both], atol=1e-13)


def test_a_source_on_an_edge_of_three_faces_has_paths_but_no_tangent_plane():
    mesh = three_sheets()
    on = np.flatnonzero((mesh.points[mesh.faces][:, :, 0] == 0).sum(axis=1) == 2)[:1]
    weights = np.where(mesh.points[mesh.faces[on], 0] == 0, [0.3, 0.3, 0.7], 0.0)
    weights /= weights.sum()
    points = SurfacePoints(on, weights)
    source = Sources.at([], points)
    exact = exact_distance(mesh, source)
    at = points.positions(mesh)[0]
    reached = [v for v in range(mesh.n_vertices) if mesh.topology.referenced_vertex[v]]
    curves = shortest_paths(mesh, exact, source, reached)
    assert curves.converged
    for entry, target in zip(curves.entries, reached, strict=True):
        assert entry["length"] == pytest.approx(np.linalg.norm(mesh.points[target] - at), rel=1e-12)
    with pytest.raises(ParameterError, match="edge of 3 faces"):
        log_map(mesh, exact, source)


@pytest.mark.parametrize("source", [0, 34, 7, 91, 133])
def test_on_faces_without_area_paths_are_exact_or_missing_with_a_warning(source, caplog):
    """A sphere with a flat cap (vertex 0) and two vertices at one place (34 and 115)."""
    mesh, sources = non_delaunay_sphere(), Sources.at([source])
    exact = exact_distance(mesh, sources)
    curves = shortest_paths(mesh, exact, sources, list(range(mesh.n_vertices)))
    unreached = [entry["target"] for entry in curves.entries if entry["length"] is None]
    assert set(unreached) <= {0, 34, 115} and curves.converged == (not unreached)
    assert bool(unreached) == ("without width" in caplog.text)
    for target, entry in enumerate(curves.entries):
        if target not in unreached:
            assert entry["length"] == pytest.approx(exact.distance[target], rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("name", ["spot.obj", "goathead.obj", "plane_holes.obj", "menger_sponge3.off"])
def test_real_meshes_agree_with_the_reference(shared_meshes, name):
    from ddgcli.io.mesh_file import read_mesh

    mesh = read_mesh(str(shared_meshes / name)).mesh
    sources = Sources.at([17])
    exact = exact_distance(mesh, sources)
    targets = np.random.default_rng(0).integers(0, mesh.n_vertices, 30).tolist()
    curves = shortest_paths(mesh, exact, sources, targets)
    assert curves.accuracy["path_length_residual"] < 1e-9
    assert isinstance(curves.paths, SurfacePaths)


def test_edge_distance_from_a_point_in_a_face_begins_with_straight_lines_to_its_corners():
    mesh = shapes.grid(6, 6)
    source = SurfacePoints(np.array([30]), np.array([[0.2, 0.5, 0.3]]))
    corners = mesh.faces[30]
    straight = np.linalg.norm(mesh.points[corners] - source.barycentric[0] @ mesh.points[corners], axis=1)
    distance = edge_distance(mesh, Sources.at([], source)).distance
    assert distance[corners] == pytest.approx(straight, rel=1e-14)
    by_corner = [edge_distance(mesh, [corner]).distance + way for corner, way in zip(corners, straight)]
    assert distance == pytest.approx(np.min(by_corner, axis=0), rel=1e-14)
