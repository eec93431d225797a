"""Curves on surfaces: lengths, side angles, geodesic curvature, from analytic examples."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.path_results import curve_set
from ddgcli.algorithms.geodesics.paths import SurfacePaths, joints, path_lengths, reversed_paths
from ddgcli.algorithms.geodesics.surface_curves import largest_angle_defect
from ddgcli.algorithms.tracing.trace import trace
from ddgcli.errors import ParameterError
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh


def vertex_path(mesh, vertices):
    """Points at consecutive neighbours, each in a face that the edge to the next one bounds."""
    faces, b = [], []
    for v, w in zip(vertices, [*vertices[1:], vertices[-2]], strict=True):
        has = (mesh.faces == v).any(axis=1) & (mesh.faces == w).any(axis=1)
        faces.append(np.flatnonzero(has)[0])
        b.append((mesh.faces[faces[-1]] == v).astype(float))
    return np.array(faces), np.array(b)


def straight_lines(mesh, k=60, length=2.0, seed=0):
    rng = np.random.default_rng(seed)
    start = rng.integers(0, mesh.n_faces, k), rng.dirichlet([1, 1, 1], k), rng.normal(size=(k, 3))
    return trace(mesh, *start, np.full(k, length), record=True)


@pytest.mark.parametrize("mesh", [shapes.random_sphere(300), shapes.torus(16, 8), shapes.box(2, 2, 2)])
def test_traces_have_equal_angles_and_their_own_length(mesh):
    lines = straight_lines(mesh)
    paths = SurfacePaths.of_traces(lines)
    assert largest_angle_defect(mesh, paths) < 1e-9
    np.testing.assert_allclose(path_lengths(mesh, paths), lines.length, rtol=1e-13)
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    np.testing.assert_allclose(path_lengths(intrinsic, paths), lines.length, rtol=1e-9)


def test_a_bent_line_has_an_angle_defect():
    mesh = shapes.random_sphere(300)
    f, b = straight_lines(mesh, 1).path(0)
    moved = b.copy()
    on = np.flatnonzero(moved[10] > 0)
    moved[10, on] = moved[10, on[::-1]] if abs(moved[10, on[0]] - 0.5) > 0.05 else [0.9, 0.1]
    assert largest_angle_defect(mesh, SurfacePaths.of_points(mesh, [(f, moved)])) > 1e-2


def test_angles_of_an_edge_path_on_the_grid_equal_the_corner_sums():
    mesh = shapes.grid(4, 4)

    def at(i, j):
        return 5 * i + j

    # right along x, then a left turn up at (2, 1), then on along the diagonal
    path = vertex_path(mesh, [at(0, 1), at(1, 1), at(2, 1), at(2, 2), at(3, 3)])
    joint = joints(mesh, SurfacePaths.of_points(mesh, [path]))
    np.testing.assert_allclose(joint.left[1:4], [np.pi, np.pi / 2, 1.25 * np.pi], atol=1e-12)
    np.testing.assert_allclose(joint.right[1:4], [np.pi, 1.5 * np.pi, 0.75 * np.pi], atol=1e-12)
    np.testing.assert_allclose(joint.geodesic_curvature[1:4], [0, np.pi / 2, -np.pi / 4], atol=1e-12)
    assert np.isnan(joint.left[[0, 4]]).all()
    assert joint.vertex.tolist() == [at(0, 1), at(1, 1), at(2, 1), at(2, 2), at(3, 3)]


def test_along_the_boundary_one_side_is_cut_off():
    mesh = shapes.grid(4, 4)
    joint = joints(mesh, SurfacePaths.of_points(mesh, [vertex_path(mesh, [0, 5, 10, 15])]))  # along y = 0
    np.testing.assert_allclose(joint.left[1:3], np.pi, atol=1e-13)
    assert np.isnan(joint.right[1:3]).all()
    np.testing.assert_allclose(joint.geodesic_curvature[1:3], 0, atol=1e-13)


@pytest.mark.parametrize("mesh", [shapes.icosphere(2), shapes.random_sphere(200), shapes.box(3, 3, 3)])
def test_gauss_bonnet_around_a_vertex_star(mesh):
    vertex = 7
    ring = {}
    for a, b, c in mesh.faces:
        if vertex in (a, b, c):
            x, y = [(b, c), (c, a), (a, b)][[a, b, c].index(vertex)]
            ring[x] = y
    loop = [next(iter(ring))]
    while ring[loop[-1]] != loop[0]:
        loop.append(ring[loop[-1]])
    f, b = vertex_path(mesh, [*loop, loop[0]])
    joint = joints(mesh, SurfacePaths.of_points(mesh, [(f[:-1], b[:-1])], [True]))
    theta = np.sum(
        [np.arccos(np.clip(_cosine(mesh, face, vertex), -1, 1)) for face in mesh.faces if vertex in face]
    )
    inner = joint.left  # the star lies on the left of the counter-clockwise loop
    assert np.sum(np.pi - inner) + (2 * np.pi - theta) == pytest.approx(2 * np.pi, abs=1e-10)


def _cosine(mesh, face, vertex):
    k = list(face).index(vertex)
    p, q, r = mesh.points[face[k]], mesh.points[face[(k + 1) % 3]], mesh.points[face[(k + 2) % 3]]
    return np.dot(q - p, r - p) / np.linalg.norm(q - p) / np.linalg.norm(r - p)


def test_reversed_paths_swap_left_and_right():
    mesh = shapes.torus(16, 8)
    paths = SurfacePaths.of_points(mesh, [vertex_path(mesh, [0, 1, 10, 18, 26])])
    forth, back = joints(mesh, paths), joints(mesh, reversed_paths(mesh, paths))
    np.testing.assert_allclose(back.left[::-1], forth.right, atol=1e-12)
    np.testing.assert_allclose(path_lengths(mesh, reversed_paths(mesh, paths)), path_lengths(mesh, paths))


def test_curve_set_keeps_order_and_arrays():
    mesh = shapes.random_sphere(100)
    lines = straight_lines(mesh, 3)
    curves = curve_set(mesh, SurfacePaths.of_traces(lines))
    assert set(curves.point_arrays) == {"path_id", "face", "barycentric"}
    assert len(curves.lines) == len(curves.points) - 3
    assert np.all(
        curves.point_arrays["path_id"][curves.lines[:, 0]]
        == curves.point_arrays["path_id"][curves.lines[:, 1]]
    )


def test_points_without_a_common_face_are_refused():
    mesh = shapes.grid(4, 4)
    paths = SurfacePaths.of_points(mesh, [(np.array([0, 20]), np.full((2, 3), 1 / 3))])
    with pytest.raises(ParameterError, match="next point"):
        path_lengths(mesh, paths)
