"""Faces that cross: against an independent test, closed forms, and positions where rounding decides."""

import numpy as np
import pytest

from ddgcli.errors import SolveError
from ddgcli.geometry.intersections import intersecting_faces
from ddgcli.mesh.shapes import box, grid, icosphere, torus
from tests.triangle_pairs import intersecting, meshes_intersect

RNG_SEED = 4


def test_pairs_of_random_triangles_are_those_of_an_independent_test():
    rng = np.random.default_rng(RNG_SEED)
    points = (rng.uniform(size=(40, 1, 3)) + 0.25 * rng.normal(size=(40, 3, 3))).reshape(-1, 3)
    faces = np.arange(120).reshape(-1, 3)
    expected = [
        [i, j]
        for i in range(40)
        for j in range(i + 1, 40)
        if meshes_intersect(points, faces[[i]], points, faces[[j]])
    ]
    assert len(expected) > 12
    assert intersecting_faces(points, faces).tolist() == expected


def test_triangles_with_a_common_vertex_cross_where_an_opposite_edge_passes_through_the_other():
    rng = np.random.default_rng(RNG_SEED)
    faces, crossing = np.array([[0, 1, 2], [4, 0, 3]]), 0
    for _ in range(150):
        points = rng.normal(size=(5, 3))
        # an edge and the face that has none of its ends
        edges = [(np.array([[1, 2, 1]]), faces[[1]]), (np.array([[3, 4, 3]]), faces[[0]])]
        expected = any(intersecting(points, edge, points, face) for edge, face in edges)
        crossing += expected
        assert (len(intersecting_faces(points, faces)) > 0) == expected
    assert 15 < crossing < 135


@pytest.mark.parametrize("scale", [1e-60, 1.0, 1e60])
def test_surfaces_without_intersections_have_none(scale):
    for mesh in (icosphere(3), torus(40, 20), grid(20, 20), box(3, 3, 3)):
        assert len(intersecting_faces(scale * np.asarray(mesh.points), mesh.faces)) == 0
        soup = np.asarray(mesh.points)[mesh.faces].reshape(-1, 3) + [10.0, 20.0, 30.0]
        own = np.arange(len(soup)).reshape(-1, 3)
        assert len(intersecting_faces(scale * soup, own)) == 0  # faces that touch along equal edges


def test_touching_and_coplanar_faces_do_not_cross():
    cube = box(2, 2, 2)
    for shift in ([0, 0, np.ptp(cube.points[:, 2])], [0.25, 0, np.ptp(cube.points[:, 2])]):
        points = np.concatenate([cube.points, np.asarray(cube.points) + shift])
        faces = np.concatenate([cube.faces, np.asarray(cube.faces) + cube.n_vertices])
        assert len(intersecting_faces(points, faces)) == 0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("turned", [False, True])
def test_a_depth_leaves_out_faces_that_cross_less_deep(scale, turned):
    below = 0.01  # of the lowest corner of an upright face under a level one
    points = [[-1, -1, 0], [2, -1, 0], [-1, 2, 0], [0, 0, -below], [0.5, 0, 1], [-0.5, 0, 1]]
    faces = np.array([[0, 1, 2], [3, 4, 5]])[:: -1 if turned else 1]
    for depth, count in ((0.0, 1), (0.99 * below, 1), (1.01 * below, 0)):
        assert len(intersecting_faces(scale * np.array(points), faces, depth=scale * depth)) == count


def test_mirror_images_cross_although_their_edges_meet_exactly():
    ramp = np.array([[-1, 0, 0], [1, 0, 1], [-1, 1, 0], [1, 1, 1]], dtype=float)
    ramp[:, 2] -= 0.5  # z = x / 2
    mirrored = ramp * [1, 1, -1]
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6]])
    pairs = intersecting_faces(np.concatenate([ramp, mirrored]), faces)
    # along the line x = z = 0: the diagonals meet at y = 1/2, faces of either ramp are on the same halves
    assert pairs.tolist() == [[0, 2], [1, 3]]


@pytest.mark.parametrize("faces_on_circle", [24, 96])
def test_two_spheres_cross_along_their_circle_alone(faces_on_circle):
    ball = icosphere(3 if faces_on_circle == 24 else 4)
    shift = np.array([0.9, 0.3, 0.1])
    points = np.concatenate([ball.points, np.asarray(ball.points) + shift])
    faces = np.concatenate([ball.faces, np.asarray(ball.faces) + ball.n_vertices])
    pairs = intersecting_faces(points, faces)
    assert len(pairs) > faces_on_circle
    assert (pairs[:, 0] < ball.n_faces).all() and (pairs[:, 1] >= ball.n_faces).all()
    middle = points[faces[pairs]].mean(axis=2)  # faces at the circle: in the plane between the centres
    edge = np.linalg.norm(points[faces[:, 1]] - points[faces[:, 0]], axis=1).max()
    unit = shift / np.linalg.norm(shift)
    assert np.abs((middle - shift / 2) @ unit).max() < edge


def test_order_of_vertices_and_faces_does_not_change_the_pairs():
    rng = np.random.default_rng(RNG_SEED)
    ball = icosphere(2)
    points = np.concatenate([ball.points, np.asarray(ball.points) + [0.9, 0.3, 0.1]])
    faces = np.concatenate([ball.faces, np.asarray(ball.faces) + ball.n_vertices])
    order = rng.permutation(len(faces))
    turned = np.array([np.roll(face, turn) for face, turn in zip(faces[order], order % 3, strict=True)])
    pairs = np.sort(order[intersecting_faces(points, turned[:, ::-1])], axis=1)
    assert sorted(pairs.tolist()) == intersecting_faces(points, faces).tolist()


def test_faces_that_all_lie_side_by_side_are_not_compared_in_pairs():
    """A fan of 20,000 faces: the boxes of all of them hold its apex."""
    angle = 2 * np.pi * np.arange(20_000) / 20_000
    points = np.append([[0.0, 0.0, 1.0]], np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), axis=0)
    rim = 1 + np.arange(20_000)
    fan = np.stack([np.zeros(20_000, int), rim, np.roll(rim, -1)], axis=1)
    with pytest.raises(SolveError, match=r"more than 2e\+06 pairs of faces lie near each other"):
        intersecting_faces(points, fan, pairs_per_face=100)
    few = intersecting_faces(points, fan[:1000])  # all pairs of a small mesh are compared
    assert few.shape == (0, 2)
