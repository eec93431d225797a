"""Lines on degenerate triangles: needles, caps, faces without area, many faces around a vertex."""

from functools import partial

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance
from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import trace_curves
from ddgcli.algorithms.tangent_fields.field_curves import add_transport
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.algorithms.tangent_fields.polar_coordinates import fast_marching_log_map
from ddgcli.algorithms.tangent_fields.tangent_field import field_of_array
from ddgcli.algorithms.tracing.trace import END_STATUS, FAILURE_STATUS, Tracer, trace
from ddgcli.errors import InputError, MeshError, ParameterError
from ddgcli.geometry.face_frames import surface_position, to_face_frame
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import face_corner_angle
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def needles(n=400, seed=0):
    """The unit square cut into needles and caps: a fan-like triangulation of very uneven points."""
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (n, 2)) ** [6, 1]
    corners = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    points = np.concatenate([corners, points])
    stretched = Delaunay(points * [1e3, 1]).simplices
    a, b, c = (points[stretched[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    stretched[area < 0] = stretched[area < 0][:, ::-1]
    return TriangleMesh.from_arrays(np.column_stack([points, np.zeros(len(points))]), stretched[area != 0])


def test_lines_stay_straight_through_needles():
    mesh = needles()
    rng = np.random.default_rng(1)
    k = 300
    face, b = rng.integers(0, mesh.n_faces, k), rng.dirichlet([1, 1, 1], k)
    angle = rng.uniform(0, 2 * np.pi, k)
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    end = trace(mesh, face, b, direction, np.full(k, 0.7))
    displacement = surface_position(mesh, end.face, end.barycentric) - surface_position(mesh, face, b)
    np.testing.assert_allclose(displacement, end.length[:, None] * direction, atol=1e-9)
    assert (end.status != FAILURE_STATUS).all()


def test_lines_cross_faces_without_area():
    """Triangle with its third corner on the opposite side: it does not change lines."""
    mesh = shapes.grid(4, 4)
    edge = np.flatnonzero(mesh.topology.edge_face_count == 2)[5]
    a, b = mesh.topology.edges[edge]
    middle = mesh.points[[a, b]].mean(axis=0)
    side = np.flatnonzero(mesh.topology.side_edge.ravel() == edge)[0]
    f, j = divmod(int(side), 3)
    u, v, w = mesh.faces[f, j], mesh.faces[f, (j + 1) % 3], mesh.faces[f, (j + 2) % 3]
    new = mesh.n_vertices  # on edge u-v: split f in two and put the flat triangle (u, v, new) between
    faces = np.concatenate([np.delete(mesh.faces, f, axis=0), [[u, new, w], [new, v, w], [u, v, new]]])
    flat = TriangleMesh.from_arrays(np.concatenate([mesh.points, [middle]]), faces)
    assert flat.topology.is_oriented and flat.topology.is_manifold
    rng = np.random.default_rng(0)
    face = np.flatnonzero(np.arange(flat.n_faces) < flat.n_faces - 1)
    face = rng.choice(face, 200)
    bary, angle = rng.dirichlet([1, 1, 1], 200), rng.uniform(0, 2 * np.pi, 200)
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    end = trace(flat, face, bary, direction, np.full(200, 0.5))
    displacement = surface_position(flat, end.face, end.barycentric) - surface_position(flat, face, bary)
    np.testing.assert_allclose(displacement, end.length[:, None] * direction, atol=1e-12)


def test_lines_cross_a_vertex_of_many_faces():
    n = 20_000
    angle = 2 * np.pi * np.arange(n) / n
    points = np.concatenate([[[0, 0, 0]], np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)])
    faces = np.stack([np.zeros(n, dtype=int), 1 + np.arange(n), 1 + (np.arange(n) + 1) % n], axis=1)
    mesh = TriangleMesh.from_arrays(points, faces)
    direction = np.array([[0.3, 0.7, 0]])
    end = Tracer(mesh).trace([17], [[1, 0, 0]], direction, [0.5])
    expected = 0.5 * direction / np.linalg.norm(direction)
    np.testing.assert_allclose(surface_position(mesh, end.face, end.barycentric), expected, atol=1e-11)


@pytest.mark.parametrize("scale", [1e-150, 1e-30, 1e30, 1e150])
def test_lines_scale_with_the_mesh(scale):
    mesh = shapes.random_sphere(100)
    big = mesh.moved(mesh.points * scale)
    start = ([3, 8], [[0.2, 0.3, 0.5], [0.3, 0.3, 0.4]], [[1.0, 0.2, 0.1], [0.0, 1.0, 0.4]])
    one, other = trace(mesh, *start, [2.0, 3.0]), trace(big, *start, [2.0 * scale, 3.0 * scale])
    assert np.array_equal(one.face, other.face)
    np.testing.assert_allclose(one.barycentric, other.barycentric, atol=1e-9)


def test_lines_of_extreme_length_are_abandoned():
    mesh = shapes.icosphere(1)
    tiny = mesh.moved(mesh.points * 1e-200)
    line = trace(tiny, [0], [[0.2, 0.3, 0.5]], [[1.0, 0.2, 0.1]], [1e150], max_crossings=50)
    assert line.status[0] == FAILURE_STATUS and line.crossings[0] > 50


def moebius_strip(n=12):
    faces = []
    for i in range(n):
        a, b, c, d = 2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 3
        if i == n - 1:
            c, d = 1, 0
        faces += [[a, c, b], [b, c, d]]
    t = 2 * np.pi * np.arange(n) / n
    half = t / 2
    rim = [
        np.stack(
            [(1 + s * np.cos(half)) * np.cos(t), (1 + s * np.cos(half)) * np.sin(t), s * np.sin(half)], 1
        )
        for s in (-0.3, 0.3)
    ]
    return TriangleMesh.from_arrays(np.stack(rim, axis=1).reshape(-1, 3), np.array(faces))


def test_the_tracer_refuses_one_sided_and_mixed_faces():
    with pytest.raises(MeshError, match="consistently oriented"):
        trace(moebius_strip(), [0], [[1, 0, 0]], [[1, 0, 0]], [1.0])


def some_faces_turned(mesh, seed):
    turn = np.random.default_rng(seed).random(mesh.n_faces) < 0.4
    return mesh.from_arrays(mesh.points, np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)), turn


@pytest.mark.parametrize("mesh", [moebius_strip(), shapes.random_sphere(300)], ids=["moebius", "sphere"])
def test_lines_are_invariant_under_face_orientation(mesh):
    rng = np.random.default_rng(3)
    face, weights = rng.integers(0, mesh.n_faces, 20), rng.dirichlet([1, 1, 1], 20)
    direction, drawn = rng.normal(size=(20, 3)), []
    for seed in (0, 1):
        mixed, turn = some_faces_turned(mesh, seed)
        assert not mixed.topology.is_oriented
        cover = oriented_cover(mixed)
        own = np.where(turn[face][:, None], weights[:, ::-1], weights)
        start = cover.lift_points(SurfacePoints(face, own))
        curves = trace_curves(
            cover.mesh, start.face, start.barycentric, direction, np.full(20, 9.0), at_boundary="reflect"
        )
        assert curves.accuracy["trace_angle_defect"] < 1e-9
        on_mesh = cover.project(curves)
        drawn.append(surface_position(mixed, on_mesh.paths.face, on_mesh.paths.barycentric))
        ends = surface_position(
            mixed,
            np.array([e["end"]["face"] for e in on_mesh.entries]),
            np.array([e["end"]["barycentric"] for e in on_mesh.entries]),
        )
        np.testing.assert_array_equal(ends, drawn[-1][on_mesh.paths.start[1:] - 1])
        assert on_mesh.paths.face.max() < mesh.n_faces
    np.testing.assert_allclose(drawn[0], drawn[1], atol=1e-9)


@pytest.mark.parametrize("mesh", [moebius_strip(), shapes.random_sphere(300)], ids=["moebius", "sphere"])
def test_shortest_paths_are_invariant_under_face_orientation(mesh):
    mixed, _ = some_faces_turned(mesh, 0)
    cover, sources = oriented_cover(mixed), Sources.at([3])
    exact = exact_distance(mixed, sources)
    curves = shortest_paths(cover.mesh, cover.lift_exact(exact), sources, list(range(mesh.n_vertices)))
    assert curves.converged and curves.accuracy["path_length_residual"] < 1e-12
    p = cover.project(curves).paths
    drawn = surface_position(mixed, p.face, p.barycentric)
    for i in range(mesh.n_vertices):
        step = np.diff(drawn[p.start[i] : p.start[i + 1]], axis=0)
        assert np.linalg.norm(step, axis=1).sum() == pytest.approx(exact.distance[i], rel=1e-12)


def klein_bottle(n=10, k=8, noise=0.15):
    """A rough Klein bottle: the first n rows of k are glued to the last by a reflection."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(k) * 2 * np.pi / k, indexing="ij")
    r = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    z = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1).reshape(-1, 3)
    number = np.arange(n * k).reshape(n, k)
    number = np.vstack([number, number[0, -np.arange(k)]])
    number = np.hstack([number, number[:, :1]])
    a, b, c, d = (q.ravel() for q in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    points += noise * np.random.default_rng(0).normal(size=points.shape)
    return TriangleMesh.from_arrays(points, faces)


def test_bent_paths_on_a_one_sided_surface_are_one_lift():
    """Left and right add up to the total angle at every bend; transport is invariant under face
    orientation."""
    mesh, ends = klein_bottle(), []
    total = np.bincount(mesh.faces.ravel(), weights=face_corner_angle(mesh).ravel())
    for turned in (mesh, some_faces_turned(mesh, 1)[0]):
        cover, sources = oriented_cover(turned), Sources.at([35])
        exact = cover.lift_exact(exact_distance(turned, sources))
        targets = [v for v in range(mesh.n_vertices) if v != 35]
        curves = shortest_paths(cover.mesh, exact, sources, targets, join_lifts=cover.join_lifts)
        bends = [bend for entry in curves.entries for bend in entry["vertices"]]
        assert len(bends) > 40
        for bend in bends:
            assert bend["left"] + bend["right"] == pytest.approx(total[bend["vertex"]], rel=1e-12)
        paths = curves.paths
        assert (paths.face[paths.start[:-1]] < mesh.n_faces).all()
        length = [entry["length"] for entry in cover.project(curves).entries]
        np.testing.assert_allclose(length, exact.distance[targets], rtol=1e-12)
        ends.append(add_transport(cover.mesh, curves).arrays["transport_x"][paths.start[1:] - 1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def test_a_field_on_faces_stays_there_where_there_are_as_many_vertices():
    mesh = moebius_strip()
    assert mesh.n_vertices == mesh.n_faces
    cover, values = oriented_cover(mesh), np.random.default_rng(0).normal(size=(mesh.n_faces, 3))
    lifted, place = cover.lift_values(values, "face")
    field = field_of_array(cover.mesh, lifted, place)
    face = np.arange(cover.mesh.n_faces)
    ahead = field(face, np.full((len(face), 3), 1 / 3))
    truth = to_face_frame(cover.mesh, face, values[face % mesh.n_faces])
    np.testing.assert_allclose(ahead, truth, atol=1e-14)
    assert cover.lift_values(values, "vertex")[0] is values
    with pytest.raises(ParameterError, match="give vectors on vertices"):
        field_of_array(cover.mesh, values, "edge")


@pytest.mark.parametrize("how", ["function", "tracer"])
def test_directions_out_of_a_face_without_area_are_refused(how):
    points = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0]])
    mesh = TriangleMesh.from_arrays(points, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 4]]))
    call = partial(trace, mesh) if how == "function" else Tracer(mesh).trace
    for direction in ([0.0, 1], [1, 0.5], [1.0, 1, 0], [1.0, 0, 0.1]):
        with pytest.raises(ParameterError, match="line 1 starts in face 0, which has no area"):
            call([3, 0], [[0.3, 0.7, 0], [0.7, 0.3, 0]], [direction], [0.3])
    with pytest.raises(ParameterError, match="face 0"):  # at its corner a planar one is of the fan
        call([0], [[1.0, 0, 0]], [[1.0, 1, 0]], [0.3])
    for direction in ([1.0, 0], [1.0, 0, 0], [1e200, 0, 0], [1e-200, 0, 0]):  # along it
        lines = call([0], [[0.7, 0.3, 0]], [direction], [0.3])
        np.testing.assert_allclose(
            surface_position(mesh, lines.face, lines.barycentric), [[0.9, 0, 0]], atol=1e-15
        )
    beside = call([3], [[0.3, 0.7, 0]], [[0.0, 1, 0]], [0.3])  # across it, from the face below
    assert beside.status[0] == END_STATUS


def test_two_sided_computations_are_refused_on_one_sided_surfaces():
    with pytest.raises(MeshError, match="one-sided"):
        oriented_cover(moebius_strip()).require_two_sides("--log-map")


def test_log_maps_of_hard_meshes_have_no_nan_and_hit_their_vertices(shared_meshes):
    """The map comes from the windows of the distance, whose bits it does not change, or from fast
    marching."""
    mapped = 0
    for path in sorted((shared_meshes / "hard").iterdir()):
        if path.suffix in (".json", ".md", ".msh", ".mesh") or path.stat().st_size > 100_000:
            continue
        try:
            cover = oriented_cover(read_mesh(str(path)).mesh)
            cover.require_two_sides("--log-map")
        except InputError:  # no mesh, no triangles, or one side
            continue
        mesh, inside = cover.mesh, SurfacePoints(np.array([0]), np.array([[0.2, 0.3, 0.5]]))
        if not mesh.n_faces:
            continue
        for source in (Sources.at([int(mesh.faces[0, 0])]), Sources.at([], inside)):
            exact = exact_distance(mesh, source, directions=True)
            np.testing.assert_array_equal(exact.distance, exact_distance(mesh, source).distance)
            try:
                curves = log_map(mesh, exact, source)
            except (ParameterError, MeshError):  # several fans at the vertex; a face that names one twice
                continue
            assert not np.isnan(curves.log_map).any() and curves.miss < 1e-9, path
            approximate = fast_marching_distance(mesh, source)
            size = np.hypot(*fast_marching_log_map(mesh, approximate, source).log_map.T)
            np.testing.assert_allclose(size, approximate.distance, rtol=1e-12, err_msg=str(path))
            mapped += 1
    assert mapped > 80
