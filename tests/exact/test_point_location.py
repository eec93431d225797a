"""Map of surface points to the intrinsic triangulation and back."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.point_location import PointMap
from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import vertex_fans
from tests.delaunay_cases import fan, pinched, planar, sharp_cone, sheared_cylinder, stretched

CASES = {
    "stretched": stretched,
    "planar": planar,
    "sheared cylinder": sheared_cylinder,
    "pinched": pinched,
    "fan": lambda: fan(300),
    "loop": sharp_cone,  # a face of its intrinsic triangulation has a vertex twice
}


def cut_of(mesh, degrees):
    if degrees is None:
        return common_subdivision(flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh))
    refined = refine(mesh, degrees)
    return common_subdivision(refined.triangulation, refined.base)


def random_points(n_faces, k, seed=0):
    rng = np.random.default_rng(seed)
    return SurfacePoints(rng.integers(n_faces, size=k), rng.dirichlet([0.5, 0.5, 0.5], size=k))


@pytest.fixture(params=[(name, degrees) for name in CASES for degrees in (None, 25)], ids=str)
def cut(request):
    name, degrees = request.param
    return cut_of(CASES[name](), degrees)


def positions_of(mesh, points):
    return np.einsum("kc,kcd->kd", points.barycentric, mesh.points[mesh.faces[points.face]])


def test_points_come_back_from_the_intrinsic_triangulation(cut):
    carry, size = PointMap(cut), np.ptp(cut.input.points, axis=0).max()
    points = random_points(cut.input.n_faces, 2000)
    mapped = carry.to_intrinsic(points)
    assert (mapped.barycentric >= 0).all() and len(np.unique(mapped.face)) > 6
    back = carry.to_input(mapped)
    assert np.abs(positions_of(cut.input, back) - positions_of(cut.input, points)).max() < 1e-11 * size
    on_intrinsic = random_points(cut.intrinsic.n_faces, 2000, seed=1)
    mapped_back = carry.to_input(on_intrinsic)
    again = carry.to_intrinsic(mapped_back)
    inside = (on_intrinsic.barycentric > 1e-6).all(axis=1)
    assert np.array_equal(again.face[inside], on_intrinsic.face[inside])
    assert np.abs(again.barycentric - on_intrinsic.barycentric)[inside].max() < 1e-8


def test_vertices_and_edges_go_where_they_belong(cut):
    carry = PointMap(cut)
    m = cut.input.n_faces
    corners = SurfacePoints(np.repeat(np.arange(m), 3), np.tile(np.eye(3), (m, 1)))
    mapped = carry.to_intrinsic(corners)
    vertex = cut.intrinsic.faces[mapped.face, mapped.barycentric.argmax(axis=1)]
    assert np.abs(mapped.barycentric.max(axis=1) - 1).max() < 1e-12
    assert np.array_equal(vertex, cut.input.faces.ravel())


def test_the_plane_stays_where_it_is():
    cut = cut_of(planar(), 25)
    points = random_points(cut.input.n_faces, 5000)
    mapped = PointMap(cut).to_intrinsic(points)
    flat = cut.intrinsic.points[cut.intrinsic.faces[mapped.face]]
    moved = np.einsum("kc,kcd->kd", mapped.barycentric, flat)
    assert np.abs(moved - positions_of(cut.input, points)).max() < 1e-12


@pytest.mark.parametrize("degrees", [None, 25])
@pytest.mark.parametrize("name", ["stretched", "sheared cylinder", "fan"])
def test_straight_lines_end_at_the_same_points(name, degrees):
    """A straightest geodesic is intrinsic: traced on either triangulation it ends at the same point.

    Lines leave along an edge that both triangulations have, turned by the same angle.
    """
    cut = cut_of(CASES[name](), degrees)
    ours, theirs = (keyed_sides(mesh) for mesh in (cut.input, cut.intrinsic))
    straight = [e for e in theirs if len(theirs[e]) == 1 and e in ours and is_input_edge(cut, e)]
    sides = np.array([(ours[e][0], theirs[e][0]) for e in straight])[:300]
    turn = np.random.default_rng(0).uniform(0.05, 0.95, size=len(sides))
    length = 0.5 * cut.input.side_length.mean()
    on_input, corner_angle = Tracer(cut.input), vertex_fans(cut.input).corner_angle
    turn *= corner_angle[sides[:, 0]]
    of_input = line_ends(on_input, sides[:, 0], turn, length)
    of_intrinsic = line_ends(Tracer(cut.intrinsic), sides[:, 1], turn, length)
    whole = (of_input.status == 0) & (of_intrinsic.status == 0)
    assert whole.sum() > 40
    expected = positions_of(cut.input, SurfacePoints(of_input.face[whole], of_input.barycentric[whole]))
    located = PointMap(cut).to_input(SurfacePoints(of_intrinsic.face[whole], of_intrinsic.barycentric[whole]))
    error = np.linalg.norm(positions_of(cut.input, located) - expected, axis=1) / length
    assert np.quantile(error, 0.97) < 1e-9  # the rest pass a vertex too closely
    back = PointMap(cut).to_intrinsic(SurfacePoints(of_input.face[whole], of_input.barycentric[whole]))
    same = (back.face == of_intrinsic.face[whole]) & (error < 1e-9)
    assert same.mean() > 0.9 and np.abs(back.barycentric - of_intrinsic.barycentric[whole])[same].max() < 1e-7


def keyed_sides(mesh):
    sides_of_edge = {}
    for side, ends in enumerate(zip(mesh.topology.side_tail, mesh.topology.side_head)):
        sides_of_edge.setdefault(tuple(map(int, ends)), []).append(side)
    return sides_of_edge


def is_input_edge(cut, ends):
    """The straight line in space between the ends is the edge of the intrinsic triangulation too."""
    e = np.flatnonzero((cut.intrinsic.topology.edges == ends).all(axis=1))
    return len(e) == 1 and cut.edge_start[e[0] + 1] - cut.edge_start[e[0]] == 2


def line_ends(tracer, side, turn, length):
    face, k = side // 3, side % 3
    x, y = tracer.unfolding.direction[face, k].T
    angle = np.arctan2(y, x) + turn
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return tracer.trace(face, np.eye(3)[k], heading, np.full(len(side), length))


def test_no_points_are_of_intrinsic_and_wrong_ones_are_refused():
    cut = cut_of(stretched(100), None)
    carry = PointMap(cut)
    assert len(carry.to_intrinsic(SurfacePoints.none())) == 0
    with pytest.raises(ParameterError, match="face 196 is outside"):
        carry.to_intrinsic(SurfacePoints(np.array([196]), np.full((1, 3), 1 / 3)))
