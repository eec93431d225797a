"""Signed distance to closed and to broken curves; the fan of geodesics with its circles and caustics."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.edge_sets import EdgeSet, boundary_set, edge_set
from ddgcli.algorithms.geodesics.paths import path_lengths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.fan import describe_fan, geodesic_fan
from ddgcli.algorithms.tangent_fields.signed_distance import signed_distance
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import surface_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import beside_a_sphere, disk, jittered

SQUARE = shapes.grid(16, 16, pattern="alternating")


def directed(mesh, edges):
    """Vertex pairs of an edge set in its directions."""
    ends = mesh.topology.edges[edges.edge]
    return np.where(edges.sign[:, None] > 0, ends, ends[:, ::-1])


def inner_square(mesh):
    centroid = mesh.points[mesh.faces].mean(axis=1)[:, :2]
    return edge_set(mesh, (np.abs(centroid - 0.5) < 0.25).all(axis=1).astype(int))


def to_square(points):
    q = np.abs(points[:, :2] - 0.5) - 0.25
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    return np.where(q.max(axis=1) > 0, outside, q.max(axis=1))


def test_signed_distance_to_a_square_in_the_plane_equals_the_closed_form():
    signed = signed_distance(SQUARE, inner_square(SQUARE))
    assert signed.method == "exact" and signed.closed
    assert np.abs(signed.distance - to_square(SQUARE.points)).max() < 1e-13


def test_reversing_the_curve_reverses_the_sign():
    edges = inner_square(SQUARE)
    turned = signed_distance(SQUARE, EdgeSet(edges.edge, -edges.sign))
    assert np.array_equal(turned.distance, -signed_distance(SQUARE, edges).distance)


def test_without_directions_the_larger_region_is_positive():
    edges = inner_square(SQUARE)
    free = signed_distance(SQUARE, EdgeSet(edges.edge, 0 * edges.sign))
    assert np.array_equal(free.distance, signed_distance(SQUARE, edges).distance)


def test_nested_curves_bound_regions_of_alternating_sign():
    centroid = SQUARE.points[SQUARE.faces].mean(axis=1)[:, :2]
    ring = np.abs(centroid - 0.5).max(axis=1)
    edges = edge_set(SQUARE, ((ring > 0.125) & (ring < 0.375)).astype(int))
    signed = signed_distance(SQUARE, edges).distance
    truth = np.abs(np.abs(SQUARE.points[:, :2] - 0.5).max(axis=1) - 0.25) - 0.125
    corner = np.abs(np.diff(np.abs(SQUARE.points[:, :2] - 0.5), axis=1))[:, 0] < 0.26  # nearest to a corner
    assert np.abs(signed - truth)[~corner].max() < 1e-13


def test_the_boundary_of_a_disk_is_a_curve_with_the_disk_inside():
    mesh = disk(300)
    signed = signed_distance(mesh, boundary_set(mesh))
    assert signed.method == "exact" and signed.distance.max() == 0 and signed.distance.min() < -0.9


def test_the_signed_heat_method_converges_to_the_exact_distance_of_a_closed_curve():
    errors = []
    for level in (3, 4, 5):
        mesh = shapes.icosphere(level)
        circle = edge_set(mesh, (mesh.points[mesh.faces].mean(axis=1)[:, 2] > 0.1).astype(int))
        exact, heat = (signed_distance(mesh, circle, method) for method in ("exact", "heat"))
        assert exact.closed and heat.closed
        errors.append(float(np.abs(heat.distance - exact.distance).mean()))
    assert errors[0] < 0.02 and errors[-1] < 0.5 * errors[0]


def test_the_signed_heat_method_bridges_the_gaps_of_a_broken_circle():
    mesh = shapes.icosphere(4)
    circle = edge_set(mesh, (mesh.points[mesh.faces].mean(axis=1)[:, 2] > 0.1).astype(int))
    exact = signed_distance(mesh, circle).distance
    pairs = directed(mesh, circle)
    angle = np.arctan2(*mesh.points[pairs[:, 0], :2].T)
    broken = edge_set(mesh, pairs[np.abs(angle % 1.0 - 0.5) < 0.4])
    assert not broken.is_closed(mesh)
    signed = signed_distance(mesh, broken)
    assert signed.method == "heat" and not signed.closed and signed.residual < 1e-9
    assert np.abs(signed.distance - exact).mean() < 0.02
    far = np.abs(exact) > 0.1
    assert (np.sign(signed.distance) == np.sign(exact))[far].all()
    assert not signed.distance[np.unique(pairs[np.abs(angle % 1.0 - 0.5) < 0.4])].any()


def test_another_component_has_no_signed_heat_distance():
    one, two = SQUARE, shapes.icosphere(0)
    both = TriangleMesh.from_arrays(
        np.concatenate([one.points, two.points + 5]), np.concatenate([one.faces, two.faces + one.n_vertices])
    )
    column = np.flatnonzero(SQUARE.points[:, 0] == 0.5)[3:9]
    order = column[np.argsort(SQUARE.points[column, 1])]
    signed = signed_distance(both, edge_set(both, np.stack([order[:-1], order[1:]], axis=1)))
    assert np.isinf(signed.distance[one.n_vertices :]).all()
    x = SQUARE.points[:, 0] - 0.5
    assert np.isfinite(signed.distance[: one.n_vertices]).all()
    near = (np.abs(x) < 0.15) & (np.abs(SQUARE.points[:, 1] - 0.4) < 0.1)
    assert np.abs(signed.distance[: one.n_vertices] - x)[near].max() < 0.02, "negative on the left"


def test_the_signed_heat_distance_on_a_component_does_not_depend_on_the_size_of_another():
    mesh = jittered(shapes.grid(16, 16, pattern="alternating"), 0.01)
    pairs = directed(mesh, inner_square(mesh))
    both, first, _ = beside_a_sphere(mesh, 2.0**-8)
    alone = signed_distance(mesh, edge_set(mesh, pairs), "heat").distance
    beside = signed_distance(both, edge_set(both, pairs + first), "heat").distance[first:]
    assert np.allclose(2.0**8 * beside, alone, rtol=0, atol=1e-9)


def test_signed_distances_that_do_not_exist_are_refused():
    edge = EdgeSet(np.array([200]), np.array([0]))
    with pytest.raises(ParameterError, match="has no direction"):
        signed_distance(SQUARE, edge)
    with pytest.raises(ParameterError, match="do not separate the surface"):
        signed_distance(SQUARE, edge, "exact")
    with pytest.raises(ParameterError, match="not one of"):
        signed_distance(SQUARE, edge, "fast")


def circle_points(mesh, fan, number):
    index = [i for i, entry in enumerate(fan.entries) if entry["kind"] == "geodesic circle"][number]
    face, weights = fan.paths.path(index)
    return surface_position(mesh, face, weights), fan.entries[index]


@pytest.mark.parametrize("source", ["vertex", "point"])
def test_geodesic_circles_of_the_plane_are_circles_without_caustics(source):
    mesh = jittered(SQUARE, 0.012, 3)
    middle = int(np.argmin(np.linalg.norm(mesh.points[:, :2] - 0.5, axis=1)))
    points = SurfacePoints(np.array([130]), np.array([[0.2, 0.3, 0.5]]))
    start = Sources(np.array([middle])) if source == "vertex" else Sources(np.zeros(0, int), points)
    centre = start.positions(mesh)[0]
    reach = float(min(centre[0], 1 - centre[0], centre[1], 1 - centre[1])) * 0.99
    fan = geodesic_fan(mesh, start, 40, reach, 5)
    for number in range(5):
        points, entry = circle_points(mesh, fan, number)
        radius = np.linalg.norm(points - centre, axis=1)
        assert entry["closed"] and np.abs(radius - reach * (number + 1) / 5).max() < 1e-13
        chord = 2 * 40 * np.sin(np.pi / 40) * entry["level"]
        assert entry["length"] == pytest.approx(chord, rel=1e-12), "directions are spaced evenly"
    summary = describe_fan(fan)
    assert summary["rays"] == 40 and summary["caustics"] == [] and summary["rays_with_caustic"] == 0
    rays = np.flatnonzero([entry["kind"] == "fan ray" for entry in fan.entries])
    start_of = fan.paths.start
    only = type(fan.paths)(
        fan.paths.face[: start_of[len(rays)]], fan.paths.barycentric[: start_of[len(rays)]],
        start_of[: len(rays) + 1], fan.paths.closed[: len(rays)],
    )  # fmt: skip
    assert np.abs(path_lengths(mesh, only) - reach).max() < 1e-13
    assert fan.arrays["level"][start_of[1] - 1] == pytest.approx(reach, rel=1e-12)


def test_circles_around_the_corner_of_a_cube_have_three_quarters_of_the_length():
    mesh = shapes.box(4, 4, 4)
    corner = int(np.argmin(mesh.points.sum(axis=1)))
    side = float(np.ptp(mesh.points[:, 0]))
    fan = geodesic_fan(mesh, Sources(np.array([corner])), 300, 0.9 * side, 3)
    circles = describe_fan(fan)["circles"]
    assert len(circles) == 3
    for entry in circles:
        assert entry["length"] == pytest.approx(1.5 * np.pi * entry["level"], rel=1e-4)


@pytest.mark.parametrize("scale", [2.0**-100, 2.0**100])
def test_a_fan_has_the_scale_of_its_mesh(scale):
    """Points of rays were searched with a gap of 1 between them, in which lengths of 1e-13 were lost."""
    mesh = shapes.icosphere(3)
    fans = [
        describe_fan(geodesic_fan(mesh.moved(s * mesh.points), Sources(np.array([0])), 60, 1.5 * s, 3))
        for s in (1.0, scale)
    ]
    unit, scaled = ([circle["length"] for circle in fan["circles"]] for fan in fans)
    assert unit == pytest.approx(2 * np.pi * np.sin([0.5, 1.0, 1.5]), rel=5e-3)
    assert np.array(scaled) / scale == pytest.approx(np.array(unit), rel=1e-12)


def test_rays_that_leave_through_the_boundary_open_the_circles():
    fan = geodesic_fan(SQUARE, Sources(np.array([0])), 21, 1.2, 4)
    summary = describe_fan(fan)
    assert summary["stopped_at_boundary"] > 0
    assert not any(circle["closed"] for circle in summary["circles"])
    assert summary["circles"][0]["length"] == pytest.approx(20 / 21 * 0.5 * np.pi * 0.3, rel=1e-3)


@pytest.mark.parametrize("hole", [False, True])
def test_circles_end_where_rays_have_ended_and_no_chord_crosses_a_hole(hole):
    """In a square with a hole rays end at both boundaries: two arcs. In the plane all chords are equal."""
    mesh = shapes.grid(24, 24)
    place = mesh.points[:, :2] - 0.5
    if hole:
        mesh = TriangleMesh.from_arrays(
            mesh.points, mesh.faces[(np.abs(place[mesh.faces].mean(axis=1)) > 0.125).any(axis=1)]
        )
    source = int(np.argmin(np.linalg.norm(place - [0.25, 0.0], axis=1)))
    fan = geodesic_fan(mesh, Sources(np.array([source])), 36, 0.44, 4)
    chord = 2 * np.sin(np.pi / 36)
    arcs = [entry for entry in fan.entries if entry["kind"] == "geodesic circle"]
    for number, arc in enumerate(arcs):
        points, _ = circle_points(mesh, fan, number)
        ring = np.append(points, points[:1], axis=0) if arc["closed"] else points
        sides = np.linalg.norm(np.diff(ring, axis=0), axis=1)
        assert sides == pytest.approx(np.full(len(sides), chord * arc["level"]), rel=1e-9)
        assert arc["length"] == pytest.approx(float(sides.sum()), rel=1e-12)
    ends = [entry["length"] for entry in fan.entries if entry["kind"] == "fan ray"]
    for circle in describe_fan(fan)["circles"]:
        present = np.array(ends) >= circle["level"] * (1 - 1e-12)
        sides_of_circle = int((present & np.roll(present, 1)).sum())
        assert circle["length"] == pytest.approx(sides_of_circle * chord * circle["level"], rel=1e-9)
        assert circle["closed"] == bool(present.all())
        assert circle["arcs"] == (1 if present.all() else int((present & ~np.roll(present, 1)).sum()))
    assert max(circle["arcs"] for circle in describe_fan(fan)["circles"]) == (2 if hole else 1)


def test_caustics_of_a_sphere_contract_to_the_antipode():
    spread, level = [], []
    for subdivision in (3, 4, 5):
        mesh = shapes.icosphere(subdivision)
        fan = geodesic_fan(mesh, Sources(np.array([0])), 48, 3.6, 6)
        lengths = [entry["caustic_length"] for entry in fan.entries if entry["kind"] == "fan ray"]
        level.append(np.array([np.inf if length is None else length for length in lengths]))
        spread.append(float(np.quantile(np.abs(level[-1] - np.pi), 0.8)))
    assert spread[-1] < 0.6 * spread[0] and abs(np.median(level[-1]) - np.pi) < 0.03
    circles = describe_fan(fan)["circles"]
    assert [circle["behind_caustic"] for circle in circles] == [0, 0, 0, 0, 0, 48]
    assert circles[2]["length"] == pytest.approx(2 * np.pi * np.sin(1.8), rel=5e-3)
    inside = fan.arrays["caustic"] > 0
    assert (fan.arrays["level"][inside] > 3.0).all() and inside.any()


@pytest.mark.parametrize(
    "rays, length, text", [(2, 1.0, "3 rays"), (8, 0.0, "positive length"), (8, np.nan, "positive length")]
)
def test_wrong_fans_are_refused(rays, length, text):
    with pytest.raises(ParameterError, match=text):
        geodesic_fan(SQUARE, Sources(np.array([5])), rays, length)
    with pytest.raises(ParameterError, match="exactly one source"):
        geodesic_fan(SQUARE, Sources(np.array([5, 6])), 8, 1.0)
