"""Straightest geodesics are straight when unfolded, halve angles at vertices, and are reversible."""

import numpy as np
import pytest

from benchmarks.common.submesh import submesh
from ddgcli.algorithms.tracing.trace import BOUNDARY_STATUS, END_STATUS, FAILURE_STATUS, Tracer, trace
from ddgcli.errors import InputError
from ddgcli.geometry.face_frames import surface_position, to_face_frame, to_space
from ddgcli.geometry.unfolding import corner_position
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.scenes.shapes import Grid, grid_mesh


def random_starts(mesh, k, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(0, mesh.n_faces, k), rng.dirichlet([1, 1, 1], k), rng.normal(size=(k, 3))


def cone(total_angle, n=12, jitter=0.2, radius=1.0, seed=0):
    """Fan of `n` triangles around vertex 0 with the given total angle, glued shut, as lengths alone."""
    rng = np.random.default_rng(seed)
    share = 1 + jitter * rng.uniform(-1, 1, n)
    angle = total_angle * share / share.sum()
    r = radius * np.ones(n + 1)
    rim = np.arange(1, n + 1)
    faces = np.stack([np.zeros(n, dtype=int), rim, np.roll(rim, -1)], axis=1)
    chord = 2 * radius * np.sin(angle / 2)
    length = np.stack([r[:n], chord, r[:n]], axis=1)
    topology = TriangleMesh.from_arrays(np.zeros((n + 1, 3)), faces).topology
    return IntrinsicMesh(topology, length)


@pytest.mark.parametrize("pattern", ["right", "alternating"])
@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
def test_lines_in_the_plane_are_straight(pattern, scale):
    mesh = shapes.grid(20, 13, 2.0, 1.0, pattern=pattern)
    mesh = mesh.moved(mesh.points * scale)
    face, barycentric, direction = random_starts(mesh, 300)
    direction[:, 2] = 0
    length = scale * np.random.default_rng(1).uniform(0, 2, 300)
    end = trace(mesh, face, barycentric, direction, length)
    displacement = surface_position(mesh, end.face, end.barycentric) - surface_position(
        mesh, face, barycentric
    )
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_allclose(displacement, end.length[:, None] * unit, atol=1e-12 * scale)
    np.testing.assert_allclose(to_space(mesh, end.face, end.direction), unit, atol=1e-12)
    assert np.all(end.length[end.status == END_STATUS] == length[end.status == END_STATUS])
    stopped = surface_position(mesh, end.face, end.barycentric)[end.status == BOUNDARY_STATUS] / scale
    assert len(stopped) > 20
    assert np.abs(stopped[:, :2] * (stopped[:, :2] - [2.0, 1.0])).min(axis=1).max() < 1e-12


@pytest.mark.parametrize("degrees", range(0, 360, 45))
def test_lines_along_edges_and_through_flat_vertices_are_straight(degrees):
    mesh = shapes.grid(8, 8)
    centre = 4 * 9 + 4
    face = np.flatnonzero((mesh.faces == centre).any(axis=1))
    barycentric = (mesh.faces[face] == centre).astype(float)
    angle = np.deg2rad(degrees)
    direction = np.array([[np.cos(angle), np.sin(angle), 0]])
    end = trace(mesh, face, barycentric, direction, np.full(len(face), 0.4), record=True)
    assert np.all(end.status == END_STATUS)
    computed = surface_position(mesh, end.face, end.barycentric)
    np.testing.assert_allclose(
        computed, np.array([0.5, 0.5, 0]) + 0.4 * direction.repeat(len(face), 0), atol=1e-13
    )


@pytest.mark.parametrize("total", [0.3, 1.5 * np.pi, 2 * np.pi, 3.1 * np.pi, 7 * np.pi])
@pytest.mark.parametrize("share", [0.0, 0.31])
def test_lines_through_a_vertex_halve_its_angle(total, share):
    mesh = cone(total)
    tracer = Tracer(mesh)
    corners = corner_position(tracer.unfolding)
    start = (1 - share) * corners[0, 1] + share * corners[0, 2]  # on the rim of face 0, aimed at the apex
    length = np.linalg.norm(start) + 0.25
    end = tracer.trace([0], [[0.0, 1 - share, share]], [-start], [length])
    assert end.status[0] == END_STATUS and end.crossings[0] >= 1
    position = end.barycentric[0] @ corners[end.face[0]]
    assert np.linalg.norm(position) == pytest.approx(0.25, abs=1e-12)
    fans = tracer.fans
    into = fans.angle_before[0] + np.arctan2(start[1], start[0])
    out = fans.angle_before[3 * end.face[0]] + np.arctan2(position[1], position[0])
    turn = (out - into) % total
    assert turn == pytest.approx(total / 2, abs=1e-10)


@pytest.mark.parametrize("pattern", ["right", "left", "alternating"])
def test_lines_from_a_reentrant_corner_start_in_the_plane_of_any_of_its_faces(pattern):
    """Directions more than half a turn from the face that states them ended at once."""
    square = grid_mesh(Grid(size=[2, 2], cells=[4, 4], pattern=pattern))
    centre = square.points[square.faces].mean(axis=1)
    mesh = submesh(square, square.faces[(centre[:, 0] < 1) | (centre[:, 1] < 1)])
    at = np.flatnonzero((np.abs(mesh.points - [1, 1, 0]) < 1e-9).all(axis=1))[0]
    face, corner = np.nonzero(mesh.faces == at)
    for angle in np.radians([95, 135, 200, 250, 300, 355]):
        direction = np.array([np.cos(angle), np.sin(angle), 0.0])
        planar = to_face_frame(mesh, face, np.tile(direction, (len(face), 1)))
        lines = Tracer(mesh).trace(face, np.eye(3)[corner], planar, np.full(len(face), 0.3))
        place = surface_position(mesh, lines.face, lines.barycentric)
        assert np.abs(place - mesh.points[at] - 0.3 * direction).max() < 1e-12


def test_cube_corner_turns_equally_on_both_sides():
    mesh = shapes.box(1, 1, 1)
    corner = np.flatnonzero((mesh.points == 1).all(axis=1))[0]
    top = np.flatnonzero((mesh.points[mesh.faces][:, :, 2] == 1).all(axis=1))
    face = [f for f in top if (mesh.points[mesh.faces[f]] == [0, 0, 1]).all(axis=1).any()][0]
    middle = (mesh.points[mesh.faces[face]] == [0, 0, 1]).all(axis=1).astype(float)
    assert corner in mesh.faces[face]  # the diagonal runs from (0,0,1) to (1,1,1)
    end = trace(mesh, [face], [middle], [[1, 1, 0]], [np.sqrt(2) + 0.5])
    # three right angles: 3 pi/4 on each side is straight down the opposite edge
    np.testing.assert_allclose(surface_position(mesh, end.face, end.barycentric), [[1, 1, 0.5]], atol=1e-12)


@pytest.mark.parametrize("mesh", [shapes.random_sphere(400), shapes.torus(24, 12), shapes.box(3, 2, 4)])
def test_lines_are_reversible_and_intrinsic(mesh):
    face, barycentric, direction = random_starts(mesh, 200)
    forth = trace(mesh, face, barycentric, direction, np.full(200, 1.3))
    back = trace(mesh, forth.face, forth.barycentric, -forth.direction, forth.length)
    gap = surface_position(mesh, back.face, back.barycentric) - surface_position(mesh, face, barycentric)
    assert np.median(np.linalg.norm(gap, axis=1)) < 1e-13
    assert np.linalg.norm(gap, axis=1).max() < 1e-8
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    planar = to_face_frame(mesh, face, direction)
    same = trace(intrinsic, face, barycentric, planar, np.full(200, 1.3))
    far = np.einsum("ij,ijk->ik", same.barycentric, mesh.points[mesh.faces[same.face]])
    gap = far - surface_position(mesh, forth.face, forth.barycentric)
    assert np.linalg.norm(gap, axis=1).max() < 1e-8


def test_helix_on_the_cylinder_has_constant_slope():
    n, height = 40, 3.0
    mesh = shapes.cylinder(n, 17, 1.0, height)
    end = trace(mesh, [0], [[0.2, 0.3, 0.5]], [[-0.2, 1.0, 0.4]], [5.0], record=True)
    f, b = end.path(0)
    z = surface_position(mesh, f, b)
    step = np.diff(z, axis=0)
    slope = step[:, 2] / np.linalg.norm(step, axis=1)
    np.testing.assert_allclose(slope, slope[0], atol=1e-12)
    assert np.linalg.norm(step, axis=1).sum() == pytest.approx(end.length[0], rel=1e-13)


def test_recorded_points_lie_in_their_faces_and_are_connected():
    mesh = shapes.random_sphere(300)
    face, barycentric, direction = random_starts(mesh, 50)
    barycentric[:10, 0] = 0  # starts on edges
    barycentric[:10] /= barycentric[:10].sum(axis=1, keepdims=True)
    barycentric[10:20] = [1, 0, 0]  # at vertices
    end = trace(mesh, face, barycentric, direction, np.full(50, 2.0), record=True)
    for i in range(50):
        f, b = end.path(i)
        assert np.abs(b.sum(axis=1) - 1).max() < 1e-14 and b.min() >= 0
        p = surface_position(mesh, f, b)
        assert np.linalg.norm(np.diff(p, axis=0), axis=1).sum() == pytest.approx(2.0, rel=1e-13)
        np.testing.assert_allclose(p[0], surface_position(mesh, face[i : i + 1], barycentric[i : i + 1])[0])
        leaves = b[:-1] @ np.ones(3)
        assert len(leaves) == len(f) - 1
        for j in range(len(f) - 1):  # the next point lies in the plane of the face that the segment crosses
            a, c, d = mesh.points[mesh.faces[f[j]]]
            assert abs(np.linalg.det([c - a, d - a, p[j + 1] - a])) < 1e-13


def test_reflected_lines_in_a_box_equal_folded_straight_lines():
    mesh = shapes.grid(7, 5, 1.0, 1.0)
    direction = np.array([0.83, 0.41, 0.0])
    end = trace(mesh, [8], [[0.2, 0.3, 0.5]], [direction], [9.0], at_boundary="reflect")
    start = surface_position(mesh, np.array([8]), np.array([[0.2, 0.3, 0.5]]))[0]
    straight = start + 9.0 * direction / np.linalg.norm(direction)
    folded = np.abs((straight[:2] + 1) % 2 - 1)
    computed = surface_position(mesh, end.face, end.barycentric)[0]
    np.testing.assert_allclose(computed[:2], folded, atol=1e-12)


def test_reflection_at_boundary_vertices_is_continuous():
    mesh = shapes.grid(10, 10)
    start = np.array([0.3, 0.2, 0.0])
    face = np.flatnonzero((np.linalg.norm(mesh.points[mesh.faces] - start, axis=2) < 1e-12).any(axis=1))[:1]
    corner = (np.linalg.norm(mesh.points[mesh.faces[face]] - start, axis=2) < 1e-12).astype(float)
    end = trace(mesh, face, corner, [[0.2, -0.2, 0]], [np.hypot(0.5, 0.5)], at_boundary="reflect")
    np.testing.assert_allclose(surface_position(mesh, end.face, end.barycentric), [[0.8, 0.3, 0]], atol=1e-12)
    steep = trace(mesh, face, corner, [[0.1, -0.2, 0]], [np.hypot(0.2, 0.4)], at_boundary="reflect")
    np.testing.assert_allclose(
        surface_position(mesh, steep.face, steep.barycentric), [[0.5, 0.2, 0]], atol=1e-12
    )


@pytest.mark.parametrize(
    "face, barycentric, direction, length, word",
    [
        (99, [1, 0, 0], [1, 0, 0], 1, "face 99"),
        (-1, [1, 0, 0], [1, 0, 0], 1, "face -1"),
        (0, [0.5, 0.6, 0.1], [1, 0, 0], 1, "sum to 1"),
        (0, [1.5, -0.5, 0], [1, 0, 0], 1, "non-negative"),
        (0, [1, 0, np.nan], [1, 0, 0], 1, "sum to 1"),
        (0, [1, 0, 0], [0, 0, 0], 1, "direction"),
        (0, [1, 0, 0], [0, 0, 1], 1, "direction"),
        (0, [1, 0, 0], [np.inf, 0, 0], 1, "finite"),
        (0, [1, 0, 0], [1, 0, 0], -1, "length"),
        (0, [1, 0, 0], [1, 0, 0], np.nan, "length"),
    ],
)
def test_bad_starts_are_refused_with_a_remedy(face, barycentric, direction, length, word):
    with pytest.raises(InputError, match=word):
        trace(shapes.grid(2, 2), [face], [barycentric], [direction], [length])


def test_abandoned_lines_have_a_warning(caplog):
    mesh = shapes.random_sphere(50)
    end = trace(mesh, [0], [[0.2, 0.3, 0.5]], [[1.0, 0.3, 0.2]], [1e9], max_crossings=100)
    assert end.status[0] == FAILURE_STATUS and 0 < end.length[0] < 1e3
    assert np.isfinite(end.barycentric).all()


@pytest.mark.parametrize("axis", range(3))
def test_closed_geodesics_of_an_ellipsoid(axis):
    """The lines along the three plane ellipses close; their length tends to the ellipse's with h^2."""
    axes = np.array([1.0, 1.3, 1.7])
    a, b = (axis + 1) % 3, (axis + 2) % 3
    angle = np.linspace(0, 2 * np.pi, 100001)
    ellipse = np.hypot(np.diff(axes[a] * np.cos(angle)), np.diff(axes[b] * np.sin(angle))).sum()
    errors = []
    for level in (2, 3, 4):
        sphere = shapes.icosphere(level)
        mesh = TriangleMesh(sphere.points * axes, sphere.topology)
        on = np.abs(sphere.points[:, axis]) < 1e-12  # the plane of symmetry holds some edges
        face = np.flatnonzero(on[mesh.faces].sum(axis=1) == 2)[:1]
        corner, other = np.flatnonzero(on[mesh.faces[face[0]]])
        start, ahead = mesh.points[mesh.faces[face[0], [corner, other]]]
        end = trace(mesh, face, np.eye(3)[[corner]], [ahead - start], [1.05 * ellipse], record=True)
        points = surface_position(mesh, *end.path(0))
        assert np.abs(points[:, axis]).max() < 1e-12
        arc_length = np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))
        back = np.linalg.norm(points[1:-1] - start, axis=1) < 1e-10
        assert back.any()
        errors.append(abs(arc_length[:-1][back][0] / ellipse - 1))
    assert np.log2(errors[0] / errors[1]) > 1.8 and np.log2(errors[1] / errors[2]) > 1.8


def test_lines_on_the_sphere_follow_great_circles():
    errors = []
    for level in (3, 4, 5):
        mesh = shapes.icosphere(level)
        face, barycentric, direction = random_starts(mesh, 200, seed=4)
        tracer = Tracer(mesh)
        end = tracer.trace(face, barycentric, direction, np.full(200, 1.0), record=True)
        start = surface_position(mesh, face, barycentric)
        first = to_space(mesh, face, to_face_frame(mesh, face, direction))
        p = start / np.linalg.norm(start, axis=1, keepdims=True)
        d = first - np.einsum("ij,ij->i", first, p)[:, None] * p
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        truth = np.cos(1.0) * p + np.sin(1.0) * d
        computed = surface_position(mesh, end.face, end.barycentric)
        computed /= np.linalg.norm(computed, axis=1, keepdims=True)
        errors.append(np.sqrt(np.mean(np.sum((computed - truth) ** 2, axis=1))))
    assert errors[-1] < 2e-3 and np.log2(errors[0] / errors[-1]) / 2 > 1.2, errors


def test_lines_do_not_depend_on_the_batch_size(monkeypatch):
    mesh = shapes.random_sphere(300)
    starts = (*random_starts(mesh, 50), np.random.default_rng(1).uniform(0, 4, 50))
    once = trace(mesh, *starts, record=True)
    monkeypatch.setattr("ddgcli.algorithms.tracing.trace.BATCH_SIZE", 7)
    shares = []
    in_batches = Tracer(mesh).trace(
        *starts, record=True, progress=lambda done, total: shares.append(done / total)
    )
    for name in ("face", "status", "crossings", "path_start", "path_face"):
        np.testing.assert_array_equal(getattr(in_batches, name), getattr(once, name))
    for name in ("barycentric", "direction", "length", "path_barycentric"):  # few lines: other last bits
        np.testing.assert_allclose(getattr(in_batches, name), getattr(once, name), rtol=0, atol=1e-12)
    assert len(shares) >= 8 and shares == sorted(shares) and shares[0] >= 0 and shares[-1] <= 1


def test_lines_of_very_different_lengths_keep_their_own_points():
    """Ended lines stay in the arrays for some steps; their points must not appear in other lines."""
    mesh = shapes.random_sphere(300)
    face, barycentric, direction = random_starts(mesh, 40)
    length = np.where(np.arange(40) % 9 == 4, 40.0, 0.3) * np.random.default_rng(2).uniform(0, 1, 40)
    together = trace(mesh, face, barycentric, direction, length, record=True)
    for i in range(40):
        one_line = slice(i, i + 1)
        alone = trace(
            mesh, face[one_line], barycentric[one_line], direction[one_line], length[one_line], record=True
        )
        np.testing.assert_array_equal(together.path(i)[0], alone.path(0)[0])
        np.testing.assert_allclose(together.path(i)[1], alone.path(0)[1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("mesh", [shapes.random_sphere(300), shapes.grid(8, 8)], ids=["sphere", "grid"])
@pytest.mark.parametrize("at_boundary", ["stop", "reflect"])
def test_scalar_and_array_tracing_agree(mesh, at_boundary, monkeypatch):
    """Points, vertices met, boundaries, ends and counts are the same, however a crossing is computed."""
    corners = np.eye(3)[np.arange(12) % 3]  # along edges, from vertex to vertex
    face, barycentric, direction = random_starts(mesh, 12, seed=3)
    along = mesh.side_vector[face, np.arange(12) % 3]
    starts = np.tile(face, 2), np.concatenate([barycentric, corners]), np.concatenate([direction, along])
    tracer, ways = Tracer(mesh), []
    for few in (0, 24):
        monkeypatch.setattr("ddgcli.algorithms.tracing.batch.MAX_SCALAR_LINES", few)
        ways.append(tracer.trace(*starts, np.linspace(0, 9, 24), at_boundary=at_boundary, record=True))
    arrays, numbers = ways
    for name in ("status", "crossings", "path_start", "path_face"):
        np.testing.assert_array_equal(getattr(numbers, name), getattr(arrays, name))
    np.testing.assert_allclose(numbers.path_barycentric, arrays.path_barycentric, rtol=0, atol=1e-11)
    np.testing.assert_allclose(numbers.length, arrays.length, rtol=1e-13)
