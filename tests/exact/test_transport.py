"""Parallel transport along curves, around vertices and by the connection Laplacian; the logarithmic map."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.paths import SurfacePaths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.intrinsic_frames import frame_turn
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.algorithms.tangent_fields.transport import holonomy, transported_frame
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat, check_vector_heat
from ddgcli.algorithms.tracing.trace import Tracer, trace
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import face_normal
from ddgcli.geometry.face_frames import surface_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import (
    connection_laplacian,
    edge_transport,
    from_vertex_frames,
    to_vertex_frames,
)
from ddgcli.operators.laplacian import stiffness
from tests.geodesic_cases import beside_a_sphere


def loop_round(mesh, vertex, seed=0):
    """Closed path through the interiors of the faces around a vertex, counter-clockwise."""
    fans = vertex_fans(mesh)
    fan = int(np.flatnonzero(fans.vertex == vertex)[0])
    corners = fans.corner[fans.start[fan] : fans.start[fan + 1]]
    rng = np.random.default_rng(seed)
    face, b = [], []
    for c in corners:  # a point on the side that enters each face's wedge, counter-clockwise
        f, k = divmod(int(c), 3)
        share = rng.uniform(0.2, 0.8)
        on_side = np.zeros(3)
        on_side[k], on_side[(k + 1) % 3] = 1 - share, share
        inside = np.zeros(3)
        inside[k] = 0.4
        inside[(k + 1) % 3] = inside[(k + 2) % 3] = 0.3
        face += [f, f]
        b += [on_side, inside]
    return np.array(face), np.array(b)


@pytest.mark.parametrize("mesh", [shapes.random_sphere(200), shapes.box(2, 2, 2), shapes.torus(12, 8)])
def test_holonomy_round_a_vertex_is_its_angle_defect(mesh):
    fans = vertex_fans(mesh)
    defect = np.zeros(mesh.n_vertices)
    defect[fans.vertex] = 2 * np.pi - fans.total_angle
    vertices = list(range(0, mesh.n_vertices, 3))
    loops = SurfacePaths.of_points(mesh, [loop_round(mesh, v, v) for v in vertices], [True] * len(vertices))
    np.testing.assert_allclose(holonomy(mesh, loops), defect[vertices], atol=1e-12)


def test_frames_stay_parallel_in_the_plane_and_along_straight_lines():
    mesh = shapes.grid(10, 10)
    bent = SurfacePaths.of_points(mesh, [_staircase(mesh)])
    curve_frame = transported_frame(mesh, bent)
    np.testing.assert_allclose(
        curve_frame["transport_x"], np.tile(curve_frame["transport_x"][0], (len(bent.face), 1)), atol=1e-12
    )
    sphere = shapes.random_sphere(400)
    line = SurfacePaths.of_traces(
        trace(sphere, [3], [[0.2, 0.3, 0.5]], [[1.0, 0.2, 0.1]], [2.0], record=True)
    )
    curve_frame = transported_frame(sphere, line)
    along = np.diff(surface_position(sphere, line.face, line.barycentric), axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(curve_frame["transport_x"], np.concatenate([along, along[-1:]]), atol=1e-9)
    assert np.abs(np.einsum("ij,ij->i", curve_frame["transport_x"], curve_frame["transport_y"])).max() < 1e-14


def _staircase(mesh):
    """Centres of neighbouring faces and the middles of the sides between them."""
    topology = mesh.topology
    face, faces, b = 0, [], []
    came = -1
    for turn in range(30):
        faces.append(face)
        b.append(np.full(3, 1 / 3))
        ways = [
            j
            for j in range(3)
            if topology.side_twin[face, j] >= 0 and topology.side_twin[face, j] // 3 != came
        ]
        j = ways[turn % len(ways)]
        twin = int(topology.side_twin[face, j])
        middle = np.zeros(3)
        middle[twin % 3] = middle[(twin % 3 + 1) % 3] = 0.5
        came, face = face, twin // 3
        faces.append(face)
        b.append(middle)
    return np.array(faces), np.array(b)


@pytest.mark.parametrize("mesh", [shapes.grid(6, 6), shapes.random_sphere(150), shapes.torus(12, 8)])
def test_connection_laplacian_is_hermitian_and_curvature_is_its_holonomy(mesh):
    matrix = connection_laplacian(mesh)
    assert abs(matrix - matrix.conj().T).max() < 1e-13
    eigenvalues = np.linalg.eigvalsh(matrix.toarray())
    assert eigenvalues[0] > -1e-12
    carry = edge_transport(mesh).reshape(-1, 3)
    if mesh.topology.is_closed:  # the angle of going round each face, summed: Gauss and Bonnet
        around = np.angle(carry.prod(axis=1))
        assert around.sum() == pytest.approx(2 * np.pi * mesh.topology.euler_characteristic, abs=1e-9)
    same = connection_laplacian(IntrinsicMesh(mesh.topology, mesh.side_length))
    assert abs(same - matrix).max() < 1e-11


def test_on_a_flat_mesh_constant_fields_have_no_energy_and_spread_unchanged():
    mesh = shapes.grid(9, 7, pattern="alternating")
    constant = np.tile([0.6, -0.8, 0.0], (mesh.n_vertices, 1))
    planar = to_vertex_frames(mesh, constant)
    np.testing.assert_allclose(from_vertex_frames(mesh, planar), constant, atol=1e-13)
    assert np.abs(connection_laplacian(mesh) @ planar).max() < 1e-12
    assert (planar.conj() @ connection_laplacian(mesh) @ planar).real == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(stiffness(mesh) @ np.ones(mesh.n_vertices)) < 1e-12
    spread = VectorHeat(mesh).transport(np.array([12]), planar[[12]]).vector
    np.testing.assert_allclose(from_vertex_frames(mesh, spread), constant, atol=1e-9)


def test_edges_with_three_faces_leave_no_tangent_plane():
    """The vector heat method has no other branch for them: no complex with one is accepted."""
    random, refused = np.random.default_rng(0), 0
    for _ in range(100):
        faces = np.array([random.choice(7, 3, replace=False) for _ in range(6)])
        mesh = TriangleMesh.from_arrays(random.normal(size=(7, 3)), faces)
        if len(mesh.topology.nonmanifold_edges):
            refused += 1
            with pytest.raises(MeshError, match="fans of faces and has no tangent plane"):
                check_vector_heat(mesh)
    assert refused > 50


def sphere_transport(mesh, source, vector):
    """Parallel transport along great circles from a vertex of the unit sphere."""
    p, q = mesh.points[source], mesh.points
    axis = np.cross(p, q)
    cosine = q @ p
    return vector + np.cross(axis, vector) + np.cross(axis, np.cross(axis, vector)) / (1 + cosine)[:, None]


def test_vector_heat_is_exact_on_long_and_sheared_strips():
    """One diffusion step underflows on the strip, and needles have negative cotangents."""
    mesh = shapes.grid(1500, 2, 500.0, 0.6)
    sheared = mesh.moved(mesh.points + mesh.points[:, 1:2] * [6.0, 0, 0])
    for strip in (mesh, sheared):
        constant = np.tile([0.6, -0.8, 0.0], (strip.n_vertices, 1))
        planar = to_vertex_frames(strip, constant)
        spread = VectorHeat(strip).transport(np.array([0]), planar[[0]]).vector
        np.testing.assert_allclose(from_vertex_frames(strip, spread), constant, atol=1e-7)


@pytest.mark.parametrize("long", [False, True])
def test_vector_heat_on_a_component_does_not_depend_on_others(long):
    """Not even where the time is raised on one of them, against underflow."""
    mesh = shapes.random_sphere(400)
    both, first, _ = beside_a_sphere(mesh, 2.0**-8)
    start = np.array([1.0 + 0.5j])
    alone = VectorHeat(mesh).transport(np.array([3]), start).vector
    vertex = np.array([first + 3])
    if long:
        strip = shapes.grid(2000, 1)
        faces = np.concatenate([both.faces, strip.faces + both.n_vertices])
        points = np.concatenate([both.points, strip.points * [2000, 1, 1]])
        vertex, start = np.append(vertex, both.n_vertices), np.append(start, start)
        both = TriangleMesh.from_arrays(points, faces)
    heat = VectorHeat(both)
    beside = heat.transport(vertex, start).vector[first : first + mesh.n_vertices]
    assert np.allclose(beside, alone, rtol=0, atol=1e-9)
    assert (heat.time[:2] == 1).all() and (heat.time[2:] > 1).all()


def squeezed_sphere(n):
    mesh = shapes.random_sphere(n)
    points = mesh.points * [2.0, 1.0, 0.5]
    return mesh.moved(points / np.linalg.norm(points, axis=1, keepdims=True))


def test_transported_vectors_have_the_length_of_the_nearest_source():
    mesh = shapes.grid(60, 6, 10.0, 1.0)
    x = mesh.points[:, 0]
    sources = np.array([np.argmin(np.abs(x - at) + np.abs(mesh.points[:, 1] - 0.5)) for at in (1.0, 9.0)])
    vectors = np.zeros((mesh.n_vertices, 3))
    vectors[sources] = [[1.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    spread = VectorHeat(mesh).transport(sources, to_vertex_frames(mesh, vectors)[sources]).vector
    transported = from_vertex_frames(mesh, spread)
    assert np.abs(transported[x < 3] - vectors[sources[0]]).max() < 1e-3
    assert np.abs(transported[x > 7] - vectors[sources[1]]).max() < 1e-3


def test_transported_vectors_do_not_depend_on_the_orientation_of_a_surface_with_boundary():
    grid = shapes.grid(5, 4)
    points = grid.points + 0.1 * np.random.default_rng(0).normal(size=grid.points.shape)
    spread = []
    for faces in (grid.faces, grid.faces[:, ::-1]):
        mesh = TriangleMesh.from_arrays(points, faces)
        start = to_vertex_frames(mesh, np.tile([1.0, 0.4, 0.2], (mesh.n_vertices, 1)))[[7]]
        spread.append(from_vertex_frames(mesh, VectorHeat(mesh).transport(np.array([7]), start).vector))
    assert np.allclose(*spread, atol=1e-9)


def test_intrinsic_delaunay_vector_heat_is_accurate_on_needles():
    mesh = squeezed_sphere(10_000)
    vector = np.cross(mesh.points[0], [0.3, 0.5, 0.8])
    start = to_vertex_frames(mesh, np.tile(vector, (mesh.n_vertices, 1)))[[0]]
    truth = sphere_transport(mesh, 0, vector)
    near = mesh.points @ mesh.points[0] > 0
    error = {}
    for delaunay in (True, False):
        heat = VectorHeat(mesh, intrinsic_delaunay=delaunay)
        spread = from_vertex_frames(mesh, heat.transport(np.array([0]), start).vector)[near]
        turn = np.einsum("ij,ij->i", np.cross(truth[near], spread), mesh.points[near])
        error[delaunay] = np.degrees(np.abs(np.arctan2(turn, np.einsum("ij,ij->i", truth[near], spread))))
    assert error[True].mean() < 1.2 and error[False].mean() > 5  # degrees; plain gets no better with n


def test_delaunay_frames_rotate_to_those_of_the_mesh():
    """An intrinsic edge traced on the input in its rotated direction ends at its other vertex."""
    mesh = squeezed_sphere(400)
    flipped = flip_to_delaunay(mesh, track=True)
    assert flipped.flips > 100
    turn, fans, own = frame_turn(mesh, flipped), vertex_fans(flipped.mesh), vertex_fans(mesh)
    side = np.arange(3 * mesh.n_faces)
    topology = flipped.mesh.topology
    total = np.zeros(mesh.n_vertices)
    total[own.vertex] = own.total_angle
    tail, head = topology.side_tail, topology.side_head
    scaled = fans.angle_before[side] * 2 * np.pi / total[tail] + np.angle(turn[tail])
    angle = (scaled % (2 * np.pi)) * total[tail] / (2 * np.pi)
    fan = np.argsort(own.vertex)[tail]
    corner = own.locate(fan, angle)
    e = Tracer(mesh).unfolding.direction.reshape(-1, 2)[corner].view(np.complex128)[:, 0]
    direction = (e * np.exp(1j * (angle - own.angle_before[corner])))[:, None].view(np.float64)
    lines = Tracer(mesh).trace(
        corner // 3, np.eye(3)[corner % 3], direction, flipped.mesh.side_length.ravel()
    )
    ends = surface_position(mesh, lines.face, lines.barycentric)
    gap = np.linalg.norm(ends - mesh.points[head], axis=1)
    assert gap.max() < 1e-9


def test_vector_heat_converges_to_parallel_transport_on_the_sphere():
    errors = []
    for n in (1000, 4000):
        mesh = shapes.random_sphere(n)
        vector = np.cross(mesh.points[0], [0.3, 0.5, 0.8])
        start = to_vertex_frames(mesh, np.tile(vector, (n, 1)))[[0]]
        spread = from_vertex_frames(mesh, VectorHeat(mesh).transport(np.array([0]), start).vector)
        near = mesh.points @ mesh.points[0] > -0.5
        truth = sphere_transport(mesh, 0, vector)
        cosine = (
            np.einsum("ij,ij->i", spread, truth)
            / np.linalg.norm(spread, axis=1)
            / np.linalg.norm(truth, axis=1)
        )
        errors.append(np.degrees(np.arccos(np.clip(cosine[near], -1, 1))).mean())
        np.testing.assert_allclose(np.linalg.norm(spread[near], axis=1), np.linalg.norm(vector), rtol=0.02)
    assert errors[0] < 3 and errors[1] < 0.75 * errors[0]


@pytest.mark.parametrize("where", ["vertex", "corner", "face", "side"])
def test_log_map_of_the_plane_is_the_difference(where):
    mesh = shapes.grid(10, 8, 2.0, 1.0)
    if where in ("vertex", "corner"):
        source = 40 if where == "vertex" else 0
        sources, at = Sources.at([source]), mesh.points[source]
    else:
        weights = [0.2, 0.3, 0.5] if where == "face" else [0.0, 0.3, 0.7]
        points = SurfacePoints(np.array([51]), np.array([weights]))
        sources, at = Sources.at([], points), points.positions(mesh)[0]
    mapped = log_map(mesh, exact_distance(mesh, sources), sources)
    x = np.array(mapped.axis["x_axis"])
    y = np.cross([0, 0, 1], x)
    np.testing.assert_allclose(
        mapped.log_map[:, :1] * x + mapped.log_map[:, 1:] * y, mesh.points - at, atol=1e-12
    )


@pytest.mark.parametrize("mesh", [shapes.random_sphere(400), shapes.torus(30, 15)])
def test_the_exponential_map_inverts_the_log_map(mesh):
    """The exponential map inverts the logarithmic map, except for paths that bend at or graze a vertex."""
    points = SurfacePoints(np.array([51]), np.array([[0.2, 0.3, 0.5]]))
    sources = Sources.at([], points)
    exact = exact_distance(mesh, sources)
    mapped = log_map(mesh, exact, sources)
    straight = (exact.origin_vertex < 0) & (exact.distance > 0)
    x = np.array(mapped.axis["x_axis"])
    y = np.cross(face_normal(mesh)[51], x)
    way = mapped.log_map[straight] @ np.stack([x, y])
    k = len(way)
    lines = trace(mesh, np.full(k, 51), np.tile(points.barycentric, (k, 1)), way, np.linalg.norm(way, axis=1))
    gap = np.linalg.norm(
        surface_position(mesh, lines.face, lines.barycentric) - mesh.points[straight], axis=1
    )
    assert k > 0.5 * mesh.n_vertices and np.mean(gap < 1e-9) > 0.97


def sphere_log_error(n):
    mesh = shapes.random_sphere(n)
    sources = Sources.at([0])
    mapped = log_map(mesh, exact_distance(mesh, sources), sources).log_map
    p = mesh.points[0]
    e1 = np.cross(p, [0.3, 0.5, 0.8])
    e1 /= np.linalg.norm(e1)
    planar = np.stack([mesh.points @ e1, mesh.points @ np.cross(p, e1)], axis=1)
    angle = np.arccos(np.clip(mesh.points @ p, -1, 1))
    planar *= (angle / np.maximum(np.linalg.norm(planar, axis=1), 1e-300))[:, None]
    turn = np.angle(np.vdot(mapped[:, 0] + 1j * mapped[:, 1], planar[:, 0] + 1j * planar[:, 1]))
    turned = (mapped[:, 0] + 1j * mapped[:, 1]) * np.exp(1j * turn)
    error = np.abs(turned - planar[:, 0] - 1j * planar[:, 1])
    return np.sqrt(np.mean(error[angle < 2.5] ** 2))


def test_log_map_of_the_sphere_converges():
    coarse, fine = sphere_log_error(600), sphere_log_error(5000)
    assert fine < 0.012 and fine < 0.5 * coarse


def test_log_map_around_a_hole_keeps_distance_and_needs_one_source(shared_meshes):
    from ddgcli.io.mesh_file import read_mesh

    mesh = read_mesh(str(shared_meshes / "plane_holes.obj")).mesh
    sources = Sources.at([17])
    exact = exact_distance(mesh, sources)
    mapped = log_map(mesh, exact, sources)
    np.testing.assert_allclose(np.linalg.norm(mapped.log_map, axis=1), exact.distance, rtol=1e-13)
    with pytest.raises(ParameterError, match="one source"):
        log_map(mesh, exact, Sources.at([1, 2]))


def test_log_map_is_inf_at_unreached_vertices():
    a = shapes.icosphere(1)
    two = TriangleMesh.from_arrays(
        np.concatenate([a.points, a.points + 5]), np.concatenate([a.faces, a.faces + a.n_vertices])
    )
    sources = Sources.at([0])
    mapped = log_map(two, exact_distance(two, sources), sources).log_map
    assert np.isfinite(mapped[: a.n_vertices]).all() and np.isinf(mapped[a.n_vertices :]).all()
