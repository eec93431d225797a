"""Exact distance from edges, curves and the boundary; Voronoi regions; distance matrices; types of "
"vertices."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.compare_methods import compare
from ddgcli.algorithms.geodesics.distance import measure_distance
from ddgcli.algorithms.geodesics.distance_matrix import distance_matrix
from ddgcli.algorithms.geodesics.edge_sets import EdgeSet, boundary_set, curve_pairs, edge_set
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.voronoi import describe_regions, vertex_types, voronoi_regions
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.degenerate_meshes import degenerate_mesh
from tests.geodesic_cases import cone, jittered, noisy_torus, with_holes


def of_edges(edge, curve=None):
    edge = np.asarray(edge)
    return Sources(np.zeros(0, int), edge=edge, curve=np.zeros(len(edge), int) if curve is None else curve)


def edges_where(mesh, marked):
    """Edges whose two ends are marked."""
    return np.flatnonzero(marked[mesh.topology.edges].all(axis=1))


def to_segment(points, a, b):
    t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(points - a - t[:, None] * (b - a), axis=1)


SQUARE = jittered(shapes.grid(16, 16, pattern="alternating"), 0.012, 1)


def test_distance_to_the_boundary_of_a_square_is_the_distance_to_its_nearest_side():
    x, y = SQUARE.points[:, :2].T
    distance = exact_distance(SQUARE, of_edges(SQUARE.topology.boundary_edges)).distance
    assert np.abs(distance - np.minimum.reduce([x, 1 - x, y, 1 - y])).max() < 1e-14


@pytest.mark.parametrize("edge", [3, 200, 401])
def test_distance_to_one_edge_of_a_plane_is_that_to_the_segment(edge):
    a, b = SQUARE.points[SQUARE.topology.edges[edge]]
    distance = exact_distance(SQUARE, of_edges([edge])).distance
    assert np.abs(distance - to_segment(SQUARE.points, a, b)).max() < 1e-13


def test_distance_of_a_point_in_a_face_to_an_edge_is_that_to_the_segment():
    face = np.arange(0, SQUARE.n_faces, 7)
    points = SurfacePoints(face, np.random.default_rng(0).dirichlet([1, 1, 1], len(face)))
    a, b = SQUARE.points[SQUARE.topology.edges[200]]
    result = exact_distance(SQUARE, of_edges([200]), targets=points)
    truth = to_segment(points.positions(SQUARE), a, b)
    assert np.abs(result.target_distance - truth).max() < 1e-13


def test_distance_to_the_rim_of_a_face_of_a_cube_unfolds_the_walls():
    mesh = shapes.box(6, 6, 6)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    p = (mesh.points - low) / (high - low)
    x, y, z = p.T
    rim = edge_set(mesh, (p[mesh.faces].mean(axis=1)[:, 2] == 0).astype(int)).edge
    inward = np.minimum.reduce([x, 1 - x, y, 1 - y])
    truth = np.where(z == 1, 1 + inward, np.where(z == 0, inward, z))
    distance = exact_distance(mesh, of_edges(rim)).distance
    assert np.abs(distance - truth * (high - low)[0]).max() < 1e-13


@pytest.mark.parametrize("angle", [2.0, 5.5, 7.0, 11.0])
def test_distance_to_a_ray_of_a_cone_is_that_of_the_unrolled_sector(angle):
    mesh, radius, phi = cone(angle, 24, 6)
    on_ray = (phi == 0) | (radius == 0)
    turn = np.minimum(np.minimum(phi, angle - phi), np.pi / 2)
    truth = radius * np.sin(turn)
    # the ray ends at radius 6: beyond the foot of the perpendicular nothing changes
    distance = exact_distance(mesh, of_edges(edges_where(mesh, on_ray))).distance
    assert np.abs(distance - truth).max() < 1e-12


def test_distance_to_a_great_circle_of_a_sphere_converges_with_order_two():
    errors = []
    for level in (1, 2, 3, 4):
        mesh = shapes.icosphere(level)
        height = mesh.points @ mesh.points[0]
        circle = edges_where(mesh, np.abs(height) < 1e-9)
        assert len(circle) == 5 * 2**level
        distance = exact_distance(mesh, of_edges(circle)).distance
        errors.append(np.abs(distance - np.abs(np.arcsin(np.clip(height, -1, 1)))).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] > 1.8


@pytest.mark.parametrize("mesh", [noisy_torus(), with_holes()], ids=["torus", "holes"])
def test_distance_to_edges_is_the_limit_of_distances_to_points_on_them(mesh):
    edge = np.arange(10, 30)
    distance = exact_distance(mesh, of_edges(edge)).distance
    length, count = 0.0, 24
    faces, weights = [], []
    for side in np.flatnonzero(np.isin(mesh.topology.side_edge.ravel(), edge)):
        face, j = divmod(int(side), 3)
        length = max(length, float(mesh.side_length[face, j]))
        for t in np.linspace(0, 1, count + 1):
            weight = np.zeros(3)
            weight[j], weight[(j + 1) % 3] = 1 - t, t
            faces.append(face)
            weights.append(weight)
    points = SurfacePoints(np.array(faces), np.array(weights))
    dense = exact_distance(mesh, Sources(np.zeros(0, int), points)).distance
    excess = dense - distance
    half = 0.5 * length / count  # from a point of an edge to the nearest of the sample
    bound = np.sqrt(distance**2 + half**2) - distance  # in the plane; a path on the surface is no longer
    assert excess.min() > -1e-12 and (excess <= bound + 1e-9 + 0.1 * half * (distance < 4 * half)).all()


def test_orientation_of_faces_does_not_change_distances_to_edges():
    turn = np.random.default_rng(1).random(SQUARE.n_faces) < 0.4
    mixed = TriangleMesh.from_arrays(
        SQUARE.points, np.where(turn[:, None], SQUARE.faces[:, ::-1], SQUARE.faces)
    )
    plain = exact_distance(SQUARE, of_edges([200, 317])).distance
    assert np.abs(exact_distance(mixed, of_edges([200, 317])).distance - plain).max() < 1e-14


def test_distance_to_edges_continues_into_all_faces_of_an_edge():
    page = shapes.grid(5, 5)
    n, x, y = page.n_vertices, *page.points[:, :2].T
    hinge = x == 0
    number = np.where(hinge, np.arange(n), -1)
    points, faces = [page.points], [page.faces]
    for k, turned in enumerate((2.0, 4.0)):
        own = np.where(hinge, number, n + k * int((~hinge).sum()) + np.cumsum(~hinge) - 1)
        points.append(np.stack([x * np.cos(turned), y, x * np.sin(turned)], axis=1)[~hinge])
        faces.append(own[page.faces])
    book = TriangleMesh.from_arrays(np.concatenate(points), np.concatenate(faces))
    outer = np.zeros(book.n_vertices, dtype=bool)
    outer[:n] = x == 1
    depth = np.concatenate([1 - x, 1 + x[~hinge], 1 + x[~hinge]])
    distance = exact_distance(book, of_edges(edges_where(book, outer))).distance
    assert np.abs(distance - depth).max() < 1e-13


def test_lines_from_the_edges_of_triangles_without_width_end():
    mesh = degenerate_mesh(12)  # two triangles with two corners at one point, glued along all sides
    assert not exact_distance(mesh, of_edges([0, 1, 2])).distance.any()


def test_scale_does_not_change_distances_to_edges():
    big = SQUARE.moved(SQUARE.points * 1e90)
    distance = exact_distance(big, of_edges([200])).distance
    assert np.abs(distance * 1e-90 - exact_distance(SQUARE, of_edges([200])).distance).max() < 1e-14


def test_paths_to_a_curve_have_the_length_of_the_distance_and_end_on_it():
    mesh = noisy_torus()
    sources = of_edges(np.arange(40, 60))
    exact = exact_distance(mesh, sources)
    curves = shortest_paths(mesh, exact, sources, list(range(0, mesh.n_vertices, 23)))
    assert curves.converged and curves.accuracy["path_length_residual"] < 1e-12
    segments = mesh.points[mesh.topology.edges[sources.edge]]
    for entry in curves.entries:
        start = np.array([entry["start"]["point"]])
        assert min(to_segment(start, a, b)[0] for a, b in segments) < 1e-12


def test_a_cover_of_reversed_faces_keeps_the_edges_of_sources():
    faces = SQUARE.faces.copy()
    faces[::3] = faces[::3, ::-1]
    cover = oriented_cover(TriangleMesh.from_arrays(SQUARE.points, faces))
    lifted = cover.lift_sources(of_edges([5, 200]))
    ends = np.sort(cover.mesh.topology.edges[lifted.edge])
    assert np.array_equal(ends, np.sort(cover.base.topology.edges[[5, 200]]))


@pytest.mark.parametrize("method", ["exact", "heat", "fast-marching", "dijkstra"])
def test_every_method_numbers_curves_after_the_vertices(method):
    left = edges_where(SQUARE, SQUARE.points[:, 0] == 0)
    right = edges_where(SQUARE, SQUARE.points[:, 0] == 1)
    curve = np.repeat([0, 1], [len(left), len(right)])
    middle = int(np.argmin(np.linalg.norm(SQUARE.points - [0.5, 0.5, 0], axis=1)))
    sources = Sources(np.array([middle]), edge=np.concatenate([left, right]), curve=curve)
    result = measure_distance(SQUARE, sources, method)
    x = SQUARE.points[:, 0]
    assert (result.nearest_source[x == 0] == 1).all() and (result.nearest_source[x == 1] == 2).all()
    assert result.nearest_source[middle] == 0
    assert method == "heat" or result.accuracy["certificate_excess"] < 1e-3
    assert [entry.get("edges") for entry in result.results["sources"]] == [None, len(left), len(right)]
    error = compare(SQUARE, sources, result.distance, ["exact"])["exact"]["max_error"]
    assert error < {"exact": 1e-15, "heat": 0.3, "fast-marching": 0.05, "dijkstra": 0.2}[method]


def test_edge_sets_agree_whether_given_as_pairs_marks_labels_or_polylines():
    inside = np.abs(SQUARE.points[SQUARE.faces].mean(axis=1)[:, 0] - 0.5) < 0.26
    labels = edge_set(SQUARE, inside.astype(int))
    ends = SQUARE.topology.edges[labels.edge]
    directed = np.where(labels.sign[:, None] > 0, ends, ends[:, ::-1])
    pairs = edge_set(SQUARE, directed)
    marks = np.zeros(SQUARE.topology.n_edges)
    marks[labels.edge] = labels.sign
    polyline = curve_pairs(SQUARE, SQUARE.points, directed)
    for other in (pairs, edge_set(SQUARE, marks), edge_set(SQUARE, polyline, "pairs")):
        assert np.array_equal(other.edge, labels.edge) and np.array_equal(other.sign, labels.sign)
    assert set(labels.curves(SQUARE)) == {0, 1}
    left = SQUARE.points[directed[:, 1]] - SQUARE.points[directed[:, 0]]
    middle = SQUARE.points[directed].mean(axis=1)[:, 0] - 0.5
    assert (left[:, 1] * middle > 0).all(), "the higher label lies on the left"
    assert (edge_set(SQUARE, np.abs(marks)).sign == 0).all()


@pytest.mark.parametrize(
    "array, text",
    [
        (np.array([[0, 5000]]), "row 0"),
        (np.array([[0, 1], [0, 40]]), "row 1: vertices 0 and 40 are not joined by an edge"),
        (np.ones(17), r"shape \(17,\)"),
        (np.zeros(SQUARE.n_vertices), "no edge"),
    ],
)
def test_wrong_edge_sets_are_refused_with_their_place(array, text):
    with pytest.raises(ParameterError, match=text):
        edge_set(SQUARE, array)


def test_edge_sources_are_refused_where_they_do_not_exist():
    with pytest.raises(MeshError, match="closed: it has no boundary"):
        boundary_set(shapes.icosphere(1))
    with pytest.raises(ParameterError, match="source edge 99999"):
        exact_distance(SQUARE, of_edges([99999]))
    with pytest.raises(ParameterError, match="needs sources at vertices or points"):
        exact_distance(SQUARE, of_edges([5]), tolerance=0.1)
    far = SQUARE.points.copy()
    far[3] += 0.3
    with pytest.raises(ParameterError, match="point 3 of the curve"):
        curve_pairs(SQUARE, far, np.array([[2, 3]]))


def test_voronoi_regions_of_a_plane_are_those_of_the_nearest_source_of_each_centroid():
    vertices = np.array([5, 120, 230, 260])
    region = voronoi_regions(SQUARE, Sources(vertices))
    centroid = SQUARE.points[SQUARE.faces].mean(axis=1)
    gap = np.linalg.norm(centroid[:, None] - SQUARE.points[vertices], axis=2)
    assert np.array_equal(region, np.argmin(gap, axis=1))
    entries = describe_regions(SQUARE, region, 4)
    assert sum(entry["faces"] for entry in entries) == SQUARE.n_faces
    assert sum(entry["area"] for entry in entries) == pytest.approx(face_area(SQUARE.side_length).sum())


def test_a_face_that_no_source_reaches_has_no_region():
    one, two = shapes.icosphere(1), shapes.icosphere(0)
    both = TriangleMesh.from_arrays(
        np.concatenate([one.points, two.points + 5]), np.concatenate([one.faces, two.faces + one.n_vertices])
    )
    region = voronoi_regions(both, Sources(np.array([0])))
    assert (region[: one.n_faces] == 0).all() and (region[one.n_faces :] == -1).all()


def test_a_distance_matrix_holds_the_distances_of_single_sources():
    mesh, sources, targets = noisy_torus(), [3, 700, 3, 15], [0, 3, 15, 400, 700, 12]
    matrix = distance_matrix(mesh, sources, targets)
    rows = [exact_distance(mesh, v).distance[targets] for v in sources]
    assert np.array_equal(matrix, rows)
    turned = distance_matrix(mesh, targets, sources)
    assert np.array_equal(turned, matrix.T), "the smaller set is propagated either way"
    square = distance_matrix(mesh, targets, targets)
    assert np.abs(square - square.T).max() < 1e-13 * square.max() and not np.diag(square).any()


def test_a_distance_matrix_does_not_depend_on_the_number_of_processes():
    one = distance_matrix(SQUARE, [0, 9, 30], [4, 5, 6, 200], "heat")
    assert np.array_equal(distance_matrix(SQUARE, [0, 9, 30], [4, 5, 6, 200], "heat", jobs=2), one)


def test_vertex_types_follow_the_total_angle():
    box = vertex_types(shapes.box(3, 3, 3))
    assert (box == 1).sum() == 8 and (box == 0).sum() == len(box) - 8
    flat, _, _ = cone(7.0, 12, 3)
    assert vertex_types(flat)[0] == -1 and set(vertex_types(flat)[1:25]) == {0}
    assert set(vertex_types(flat)[25:]) == {2}


def test_a_set_of_edges_is_closed_if_every_vertex_has_an_even_number_of_them():
    rim = boundary_set(SQUARE)
    assert rim.is_closed(SQUARE) and not EdgeSet(rim.edge[1:], rim.sign[1:]).is_closed(SQUARE)
