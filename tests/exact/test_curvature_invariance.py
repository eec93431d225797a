"""Curvature does not depend on place, scale, numbers of vertices and faces, or the axes."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.exact.test_curvature_identities import crumpled

POWERS = {"gaussian_curvature": -2, "vertex_area": 2, "angle_defect": 0, "principal_curvature_max": -1}


@pytest.mark.parametrize("scheme", CURVATURE_SCHEMES)
@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
def test_moving_scaling_and_relabelling_change_nothing_else(scheme, scale):
    mesh = crumpled(shapes.random_sphere(200))
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    points = scale * (mesh.points @ turn.T + np.array([3.0, -2.0, 5.0]))[order]
    faces = np.roll(place[mesh.faces][rng.permutation(mesh.n_faces)], 1, axis=1)
    before, after = (
        measure_curvature(mesh, scheme),
        measure_curvature(TriangleMesh.from_arrays(points, faces), scheme),
    )
    for name, power in POWERS.items():
        old, new = before.vertex[name][order], after.vertex[name] / scale**power
        assert np.abs(new - old).max() < 1e-9 * np.abs(old).max(), name
    assert after.results["willmore_energy"] == pytest.approx(before.results["willmore_energy"], rel=1e-9)
    assert after.results["volume"] == pytest.approx(scale**3 * before.results["volume"], rel=1e-11)


CORNER_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def few_neighbours():
    cube = shapes.box(1, 1, 1)
    corners = np.array([[0, 0, 0], [1, 0, 0.1], [1, 1, 0], [0, 1, 0.1]])
    a = np.linspace(0, 1, 12)
    i = np.arange(11)[:, None]
    around, after = np.arange(24), np.roll(np.arange(24), -1)
    rim = np.stack([np.cos(around * np.pi / 12), np.sin(around * np.pi / 12), 0 * around], axis=1)
    return {
        "cube": cube,  # all directions alike
        "two cubes": TriangleMesh.from_arrays(np.concatenate([cube.points, cube.points * [2, 1, 1] + 5]),
                                              np.concatenate([cube.faces, cube.faces + cube.n_vertices])),
        "box of right angles": shapes.box(2, 2, 2),  # neighbours whose normals are at right angles
        "corner of a cube": TriangleMesh.from_arrays(np.vstack([np.zeros(3), np.eye(3)]), CORNER_FACES),
        "bipyramid": TriangleMesh.from_arrays(  # neighbours of the rim that do not face away lie on a line
            np.vstack([rim, [[0, 0, 5], [0, 0, -5]]]),
            np.vstack([np.stack([around, after, around * 0 + 24], axis=1),
                       np.stack([after, around, around * 0 + 25], axis=1)])),
        "two faces": TriangleMesh.from_arrays(corners, np.array([[0, 1, 2], [0, 2, 3]])),
        "strip": TriangleMesh.from_arrays(
            np.concatenate([np.stack([a, 0 * a + y, a * a], 1) for y in (0, 0.1)]),
            np.concatenate([np.hstack([i, i + 1, i + 13]), np.hstack([i, i + 13, i + 12])])),
    }  # fmt: skip


@pytest.mark.parametrize("name, mesh", few_neighbours().items())
def test_curvature_of_few_or_symmetric_neighbours_does_not_depend_on_numbers_and_axes(name, mesh):
    rng = np.random.default_rng(2)
    before = measure_curvature(mesh, "quadric").vertex
    size = np.abs(before["principal_curvature_max"]).max()
    for _ in range(4):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        order = rng.permutation(mesh.n_vertices)
        points, faces = (mesh.points @ (turn * np.linalg.det(turn)).T)[order], np.argsort(order)[mesh.faces]
        moved = TriangleMesh.from_arrays(points, rng.permutation(faces))
        after = measure_curvature(moved, "quadric").vertex
        for key in ("principal_curvature_min", "principal_curvature_max"):
            assert np.abs(after[key] - before[key][order]).max() < 1e-11 * size


def test_vertices_that_symmetry_exchanges_have_equal_curvature_and_corners_have_some():
    rim = measure_curvature(few_neighbours()["bipyramid"]).vertex["mean_curvature"][:24]
    assert np.ptp(rim) < 1e-9 and 0.5 < rim[0] < 1
    # the paraboloid through the three neighbours: heights of 3^-1/2 at distances of (2/3)^1/2
    corner = measure_curvature(few_neighbours()["corner of a cube"]).vertex["mean_curvature"][0]
    assert corner == pytest.approx(3**0.5, rel=1e-6)


def undecided():
    ball = shapes.icosphere(1)
    half = ball.faces.copy()
    half[::2] = half[::2, ::-1]  # as many faces on one side as on the other
    grid = shapes.grid(4, 4)
    flat = grid.faces.copy()
    flat[::2] = flat[::2, ::-1]
    x, y, _ = grid.points.T
    tip = ball.points - ball.points[0]
    other = np.where(np.arange(ball.n_vertices) > 0, np.arange(ball.n_vertices) + ball.n_vertices - 1, 0)
    cones = TriangleMesh.from_arrays(
        np.vstack([tip, -tip[1:]]), np.vstack([ball.faces, other[ball.faces[:, ::-1]]])
    )
    return {
        "half of the faces reversed": TriangleMesh.from_arrays(ball.points, half),
        "half of a graph reversed": TriangleMesh.from_arrays(
            np.stack([x, y, x * x + 0.3 * x * y], axis=1), flat
        ),
        "normals that cancel in a common tip": cones,
    }


@pytest.mark.parametrize("scheme", CURVATURE_SCHEMES)
@pytest.mark.parametrize("name, mesh", undecided().items())
def test_undecided_orientations_and_normals_do_not_depend_on_numbers(name, mesh, scheme):
    rng = np.random.default_rng(1)
    before = measure_curvature(mesh, scheme, full=False).vertex["mean_curvature"]
    for _ in range(4):
        order = rng.permutation(mesh.n_vertices)
        faces = np.roll(np.argsort(order)[rng.permutation(mesh.faces)], 1, axis=1)
        moved = TriangleMesh.from_arrays(mesh.points[order], faces)
        after = measure_curvature(moved, scheme, full=False).vertex["mean_curvature"]
        assert np.abs(after - before[order]).max() < 1e-9 * np.abs(before).max()
