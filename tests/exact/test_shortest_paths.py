"""Shortest paths: as long as the exact distance, straight, and bent only where a shortest path may bend."""

import numpy as np
import pytest

from ddgcli.algorithms.curves.paths import SurfacePaths, joints
from ddgcli.algorithms.curves.shortest_paths import shortest_paths
from ddgcli.algorithms.distance.exact import exact_distance
from ddgcli.algorithms.distance.sources import Sources
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import surface_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

MESHES = {
    "sphere": shapes.random_sphere(600),
    "torus": shapes.torus(40, 20),
    "box": shapes.box(4, 4, 4),
    "grid": shapes.grid(12, 12),
    "catenoid": shapes.catenoid(24, 12),
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", ["vertex", "points"])
def test_length_is_the_exact_distance(name, kind):
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


def test_unreachable_and_unknown_targets():
    a = shapes.icosphere(1)
    two = TriangleMesh.from_arrays(
        np.concatenate([a.points, a.points + 5]), np.concatenate([a.faces, a.faces + a.n_vertices])
    )
    sources = Sources.at([0])
    curves = shortest_paths(two, exact_distance(two, sources), sources, [1, a.n_vertices + 1])
    assert not curves.converged and curves.entries[1]["length"] is None
    with pytest.raises(ParameterError, match="target vertex 9999"):
        shortest_paths(two, exact_distance(two, sources), sources, [9999])


@pytest.mark.parametrize("name", ["spot.obj", "goathead.obj", "plane_holes.obj", "menger_sponge3.off"])
def test_real_meshes(shared_meshes, name):
    from ddgcli.io.mesh_file import read_mesh

    mesh = read_mesh(str(shared_meshes / name)).mesh
    sources = Sources.at([17])
    exact = exact_distance(mesh, sources)
    targets = np.random.default_rng(0).integers(0, mesh.n_vertices, 30).tolist()
    curves = shortest_paths(mesh, exact, sources, targets)
    assert curves.accuracy["path_length_residual"] < 1e-9
    assert isinstance(curves.paths, SurfacePaths)
