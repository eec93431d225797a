"""Balls about vertices against a slow, plain reference: face by face, every side clipped on its own."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.ball_blocks import ball_blocks
from ddgcli.algorithms.curvature.clip import FacePlanes
from ddgcli.algorithms.curvature.face_balls import FaceBalls
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.algorithms.curvature.vertex_balls import vertex_balls
from ddgcli.errors import ParameterError
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def crumpled():
    mesh = shapes.torus(16, 8)
    return mesh.moved(mesh.points + 0.1 * np.random.default_rng(3).normal(size=mesh.points.shape))


def two_spheres_at_a_vertex():
    one = shapes.random_sphere(60)
    other = np.where(one.faces == 5, 5, one.faces + 60)
    points = np.concatenate([one.points, 2 * one.points[5] - one.points])
    return TriangleMesh.from_arrays(points, np.concatenate([one.faces, other[:, ::-1]]))


def three_pages():
    page = shapes.grid(4, 4).points
    faces = shapes.grid(4, 4).faces
    spine = page[:, 0] < 1e-9
    pages, cells, n = [page], [faces], len(page)
    for turn in (2.0, 4.0):
        new = page @ np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [0, 0, 1]])
        cells.append(np.where(spine, np.arange(n), np.arange(n) + n * len(pages))[faces])
        pages.append(new)
    return TriangleMesh.from_arrays(np.concatenate(pages), np.concatenate(cells))


def with_a_flat_face():
    mesh = shapes.random_sphere(80)
    points = mesh.points.copy()
    a, b, c = mesh.faces[0]
    points[a] = (points[b] + points[c]) / 2
    return mesh.moved(points)


MESHES = {
    "irregular": lambda: shapes.random_sphere(120),
    "crumpled": crumpled,
    "needles": lambda: shapes.torus(28, 5),
    "open": lambda: shapes.grid(6, 5, pattern="alternating"),
    "two fans": two_spheres_at_a_vertex,
    "three pages": three_pages,
    "flat face": with_a_flat_face,
}


def chord_of(a, b, radius):
    """Length of the segment a b inside the ball about the origin."""
    side = b - a
    length = np.linalg.norm(side)
    if length == 0:
        return 0.0
    middle = -(a @ side) / length
    half = np.sqrt(max(radius**2 - a @ a + middle**2, 0.0))
    return max(min(middle + half, length) - max(middle - half, 0.0), 0.0)


def area_of(corners, radius):
    """Area of a triangle inside the ball, by Gauss quadrature of its width between the events of height."""
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal)
    if size < 1e-14:
        return 0.0
    normal = normal / size
    x = (b - a) / np.linalg.norm(b - a)
    y = np.cross(normal, x)
    flat = corners @ np.stack([x, y]).T
    disc = np.sqrt(max(radius**2 - (a @ normal) ** 2, 0.0))
    events = [*flat[:, 1], -disc, disc]
    for p, q in zip(flat, np.roll(flat, -1, axis=0)):
        d = q - p
        roots = np.roots([d @ d, 2 * p @ d, p @ p - disc**2])
        events += [p[1] + t.real * d[1] for t in roots if abs(t.imag) < 1e-12]
    # the rim of the disc is vertical at its ends, so heights follow a sine in every interval
    low, high = max(flat[:, 1].min(), -disc), min(flat[:, 1].max(), disc)
    if low >= high:
        return 0.0
    cuts = sorted({e for e in events if low < e < high} | {low, high})
    node, weight = np.polynomial.legendre.leggauss(40)
    total = 0.0
    for s, e in zip(cuts, cuts[1:]):
        angle = np.arcsin(np.clip([s / disc, e / disc], -1, 1))
        turn = 0.5 * (angle[1] - angle[0]) * node + 0.5 * angle.sum()
        total += (
            0.5
            * (angle[1] - angle[0])
            * sum(
                w * disc * np.cos(t) * width_at(flat, disc * np.sin(t), disc * np.cos(t))
                for w, t in zip(weight, turn)
            )
        )
    return total


def width_at(flat, height, half):
    places = [
        p[0] + (height - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
        for p, q in zip(flat, np.roll(flat, -1, axis=0))
        if (p[1] - height) * (q[1] - height) < 0
    ]
    return max(min(max(places), half) - max(min(places), -half), 0.0) if len(places) == 2 else 0.0


def plain_ball(mesh, vertex, radius):
    """Chords of the sides of the faces in the ball, by a search from face to face across sides inside."""
    edges = mesh.topology.side_edge
    waiting, chords_by_face = [int(f) for f in np.flatnonzero((mesh.faces == vertex).any(axis=1))], {}
    while waiting:
        face = waiting.pop()
        if face in chords_by_face:
            continue
        corners = mesh.points[mesh.faces[face]] - mesh.points[vertex]
        chord = [chord_of(corners[j], corners[(j + 1) % 3], radius) for j in range(3)]
        chords_by_face[face] = np.array(chord)
        for j in np.flatnonzero(chords_by_face[face] > 0):
            waiting += [int(f) for f in np.flatnonzero((edges == edges[face, j]).any(axis=1))]
    return chords_by_face


@pytest.mark.parametrize("reach, every", [(0.45, 1), (1.3, 2), (2.3, 4)])  # a search is longer in large balls
@pytest.mark.parametrize("name", MESHES)
def test_balls_hold_the_faces_and_chords_of_a_direct_search(name, reach, every):
    mesh = MESHES[name]()
    radius = reach * mesh.side_length.mean()
    length = mesh.side_length
    balls, n_balls = FaceBalls(mesh, radius), 0
    for vertex, near in ball_blocks(balls.tree, radius):
        ball = balls.around(vertex, near)
        n_balls += len(vertex)
        for at, k in list(enumerate(vertex))[::every]:
            expected = plain_ball(mesh, k, radius)
            row = ball.whole[[at]].tocoo()
            chords_by_face = {int(f): length[f] for f, one in zip(row.coords[1], row.data) if one}
            for i in np.flatnonzero(ball.owner == at):
                chords_by_face[int(ball.face[i])] = ball.chord[:, i]
            assert chords_by_face.keys() == expected.keys()
            for face, chords in expected.items():
                assert chords_by_face[face] == pytest.approx(chords, abs=1e-7 * radius)
            inside = {
                (int(balls.mesh.topology.corner_fans[f, j]))
                for f in expected
                for j in range(3)
                if np.linalg.norm(mesh.points[mesh.faces[f, j]] - mesh.points[k]) <= radius
            }
            assert set(ball.fans[[at]].indices.tolist()) == inside
    assert n_balls == mesh.n_vertices


def test_areas_inside_balls_against_quadrature():
    rng = np.random.default_rng(0)
    corner = np.concatenate([rng.normal(size=(60, 3, 3)), 3 * rng.normal(size=(60, 3, 3)) * [1, 1, 0.1]])
    planes = FacePlanes.of(corner.transpose(1, 2, 0))
    area, chord = planes.clip(np.arange(len(corner)), np.zeros((3, len(corner))), 1.0)
    expected = np.array([area_of(c, 1.0) for c in corner])
    assert (expected > 0).sum() > 60
    assert area == pytest.approx(expected, abs=1e-9)
    sides = [[chord_of(c[j], c[(j + 1) % 3], 1.0) for c in corner] for j in range(3)]
    assert chord == pytest.approx(np.array(sides), abs=1e-12)


def connected_within(mesh, vertex, radius):
    """Vertices that edges inside the ball connect to its centre, by a search from vertex to vertex."""
    inside = np.linalg.norm(mesh.points - mesh.points[vertex], axis=1) <= radius
    reached, new = {vertex}, [vertex]
    while new:
        ends = mesh.topology.edges[(mesh.topology.edges == new.pop()).any(axis=1)].ravel()
        new += sorted(fresh := {int(v) for v in ends if inside[v]} - reached)
        reached |= fresh
    return sorted(reached)


def two_sheets():
    """Grids nearer to each other than their cells are wide, with a vertex that no face uses between them."""
    lower = shapes.grid(20, 20)
    points = np.concatenate([lower.points, lower.points + [0, 0, 0.03], [[0.5, 0.5, 0.01]]])
    return TriangleMesh.from_arrays(
        points, np.concatenate([lower.faces, lower.faces[:, ::-1] + lower.n_vertices])
    )


@pytest.mark.parametrize("reach", [0.45, 1.3, 2.3, 6.1])
@pytest.mark.parametrize("build", [*MESHES.values(), two_sheets], ids=[*MESHES, "two sheets"])
def test_vertices_of_balls_are_those_of_a_direct_search(build, reach):
    mesh = build()
    radius = reach * float(np.median(mesh.side_length))
    balls = vertex_balls(mesh, radius)
    for vertex in range(0, mesh.n_vertices, max(1, mesh.n_vertices // 60)):
        members = balls.member[balls.start[vertex] : balls.start[vertex + 1]]
        assert members.tolist() == connected_within(mesh, vertex, radius)


def test_balls_do_not_depend_on_their_blocks(monkeypatch):
    mesh = crumpled()
    balls = vertex_balls(mesh, 0.7)
    monkeypatch.setattr("ddgcli.algorithms.curvature.ball_blocks.BALLS_PER_BLOCK", 7)
    monkeypatch.setattr("ddgcli.algorithms.curvature.ball_blocks.MAX_BLOCK_CELLS", 100)
    small = vertex_balls(mesh, 0.7)
    processes = vertex_balls(mesh, 0.7, jobs=3)
    for other in (small, processes):
        assert np.array_equal(balls.start, other.start) and np.array_equal(balls.member, other.member)


@pytest.mark.parametrize("before, after", [(200, 0), (0, 200), (3, 2)])
def test_vertices_of_no_face_have_empty_balls_wherever_they_stand(before, after):
    """A block of such vertices alone ended `curvature --radius` with an internal error."""
    mesh = shapes.icosphere(2)
    apart = [np.zeros((count, 3)) for count in (before, after)]
    padded = TriangleMesh.from_arrays(np.concatenate([apart[0], mesh.points, apart[1]]), mesh.faces + before)
    plain, extended = (areas_of_whole_faces(FaceBalls(one, 0.4)) for one in (mesh, padded))
    on_surface = np.arange(before, before + mesh.n_vertices)
    assert np.allclose(extended[on_surface], plain, rtol=1e-12) and plain.min() > 0.0
    assert not np.delete(extended, on_surface).any()


def areas_of_whole_faces(balls):
    areas = np.zeros(balls.mesh.n_vertices)
    for vertex, near in ball_blocks(balls.tree, balls.radius):
        areas[vertex] = balls.around(vertex, near).whole @ balls.face_area
    return areas


@pytest.mark.parametrize("block", [40, 1 << 21])
def test_balls_by_cubes_hold_the_points_within_the_radius(block, monkeypatch):
    monkeypatch.setattr("ddgcli.algorithms.curvature.point_grid.MAX_CANDIDATES", block)
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(3, 300)) * np.array([[1.0], [1.0], [0.0]])
    places = np.stack(np.meshgrid(*[np.arange(5.0)] * 3)).reshape(3, -1)  # distances equal to the radius
    far = np.append(rng.normal(size=(3, 200)), [[1e7], [0], [0]], axis=1)
    for points in (flat, places, far, np.zeros((3, 7))):
        few, grid = np.arange(0, points.shape[1], 3), PointGrid(points)
        for radius in (0.1, 0.3, 1.0, 2.5, 100.0, 0.2):  # cubes serve for radii up to four edges
            balls = grid.balls(few, radius)
            apart = points[:, few, None] - points[:, None, :]
            inside = apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2 <= radius * radius
            assert (balls.count == inside.sum(axis=1)).all()
            assert (balls.member == np.nonzero(inside)[1]).all()


@pytest.mark.parametrize("scheme", ["corrected", "normal-cycle"])
def test_a_radius_whose_cube_is_no_number_is_refused(scheme):
    """Once the curvature was 0 everywhere, or not a number."""
    ball = shapes.icosphere(1)
    with pytest.raises(ParameterError, match="leave the floating-point range; use 6.18e-101 or more"):
        measure_curvature(ball, scheme, radius=1e-300)
    H = measure_curvature(ball, scheme, radius=1e-90).vertex["mean_curvature"]
    assert np.isfinite(H).all() and (H > 0).all()
