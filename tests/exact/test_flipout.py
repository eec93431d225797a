"""Straightened edge paths and loops are geodesic, shorter, and in their class; flips keep the metric."""

from pathlib import Path

import numpy as np
import pytest

from ddgcli.algorithms.geodesics import flipout, halfedge_traces
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.flipout import straighten_curves
from ddgcli.algorithms.geodesics.flippable_mesh import DETOUR_LIMITS, EdgeGraph, FlippableMesh, edge_path
from ddgcli.algorithms.geodesics.paths import joints
from ddgcli.algorithms.hodge.homology import generator_loops
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import surface_position
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

NU, NV = 36, 18


def ring(v):
    """Way-points once round the torus the long way, at row v."""
    return [i * NV + v for i in range(0, NU, 3)]


def check_geodesic(mesh, curves):
    joint = joints(mesh, curves.paths)
    for angle in (joint.left, joint.right):
        assert np.nanmin(angle, initial=np.pi) > np.pi - 1e-6


@pytest.mark.parametrize("mesh", [shapes.random_sphere(500), shapes.torus(NU, NV), shapes.box(4, 4, 4)])
def test_paths_are_geodesics_no_shorter_than_the_distance(mesh):
    pairs = np.random.default_rng(0).integers(0, mesh.n_vertices, (8, 2)).tolist()
    pairs = [p for p in pairs if p[0] != p[1]]
    curves = straighten_curves(mesh, pairs, [False] * len(pairs))
    assert curves.converged
    check_geodesic(mesh, curves)
    for (a, b), entry in zip(pairs, curves.entries, strict=True):
        assert entry["start"]["vertex"] == a and entry["end"]["vertex"] == b
        assert exact_distance(mesh, [a]).distance[b] <= entry["length"] * (1 + 1e-13)
        assert entry["length"] <= entry["edge_path_length"] * (1 + 1e-13)


def test_loops_around_the_torus_become_the_inner_equator():
    mesh = shapes.torus(NU, NV, 1.0, 0.4)
    inner = 2 * NU * 0.6 * np.sin(np.pi / NU)  # the polygon of edges at v = pi
    for row in (NV // 2, NV // 2 - 3, NV // 2 + 4):
        curves = straighten_curves(mesh, [ring(row)], [True])
        assert curves.converged and curves.entries[0]["length"] == pytest.approx(inner, rel=1e-12)
        check_geodesic(mesh, curves)


def test_meridian_of_the_torus_stays_in_its_class():
    mesh = shapes.torus(NU, NV, 1.0, 0.4)
    meridian = list(range(0, NV, 2))
    skewed = [*meridian[:4], 5 * NV + 8, *meridian[5:]]
    curves = straighten_curves(mesh, [meridian, skewed], [True, True])
    check_geodesic(mesh, curves)
    polygon = 2 * NV * 0.4 * np.sin(np.pi / NV)
    for entry in curves.entries:
        assert entry["length"] <= polygon * (1 + 1e-12)
        assert entry["length"] > 0.9 * polygon


def windings(mesh, paths, major=1.0):
    """Winding numbers of a closed path on a torus."""
    p = surface_position(mesh, paths.face, paths.barycentric)
    p = np.concatenate([p, p[:1]])
    u = np.arctan2(p[:, 1], p[:, 0])
    v = np.arctan2(p[:, 2], np.hypot(p[:, 0], p[:, 1]) - major)
    turns = [np.sum((np.diff(a) + np.pi) % (2 * np.pi) - np.pi) / (2 * np.pi) for a in (u, v)]
    return [round(t) for t in turns]


@pytest.mark.parametrize("size", [(36, 18), (48, 24), (24, 48)])
def test_loops_keep_their_windings(size):
    nu, nv = size
    mesh = shapes.torus(nu, nv)
    around = [i * nv for i in range(0, nu, 4)]
    short = list(range(0, nv, 3))
    both = [(k % nu) * nv + (k * nv // nu) % nv for k in range(0, nu, 3)]
    twice = [*around, *(i * nv + 5 for i in range(0, nu, 4))]
    for stops, expected in ((around, [1, 0]), (short, [0, 1]), (both, [1, 1]), (twice, [2, 0])):
        curves = straighten_curves(mesh, [stops], [True])
        assert windings(mesh, curves.paths) == expected
        assert curves.entries[0]["length"] <= curves.entries[0]["edge_path_length"]
        if expected != [2, 0]:
            assert curves.converged
            check_geodesic(mesh, curves)


def test_a_loop_of_one_edge_keeps_its_winding_number(monkeypatch):
    monkeypatch.setattr(flipout, "MAX_STEPS", 1000)  # a loop that is opened and closed without end fails here
    mesh = read_mesh(str(Path(__file__).parents[2] / "sample_meshes" / "torus.ply")).mesh
    curves = straighten_curves(mesh, [[0, 10, 20, 30]], [True])
    assert curves.converged and windings(mesh, curves.paths) == [0, 1]
    assert curves.entries[0]["length"] <= curves.entries[0]["edge_path_length"]
    check_geodesic(mesh, curves)


@pytest.mark.parametrize(
    "name, genus", [("boot.obj", 12), ("1002_tray_bottom.STL", 23), ("plate_holes.STL", 5)]
)
def test_generators_of_surfaces_of_high_genus_become_closed_geodesics(shared_meshes, name, genus):
    """A loop of a homology basis does not bound, so it cannot shrink to a point."""
    mesh = read_mesh(str(shared_meshes / name)).mesh
    loops = [[int(v) for v in loop] for loop in generator_loops(mesh)]
    assert len(loops) == 2 * genus
    curves = straighten_curves(mesh, loops, [True] * len(loops))
    assert curves.converged
    check_geodesic(mesh, curves)
    for entry in curves.entries:
        assert 0 < entry["length"] <= entry["edge_path_length"] * (1 + 1e-12)


def test_a_contractible_loop_shrinks_to_a_point():
    mesh = shapes.torus(NU, NV)
    curves = straighten_curves(mesh, [[0, 2, 2 * NV + 2, 2 * NV]], [True])
    assert curves.entries[0]["length"] == 0.0 and curves.entries[0]["points"] == 0


def test_halfedges_reach_their_heads_also_through_vertices(monkeypatch):
    """Lines that scalar arithmetic leaves in front of a vertex are traced through it, to the same points."""
    mesh = shapes.random_sphere(800)
    stops = [[0, 300], [5, 200]]
    before = straighten_curves(mesh, stops, [False, False]).paths
    assert len(before.face) > 20
    monkeypatch.setattr(halfedge_traces, "scalar_crossings", lambda *line: [])
    after = straighten_curves(mesh, stops, [False, False]).paths
    np.testing.assert_array_equal(after.face, before.face)
    np.testing.assert_allclose(after.barycentric, before.barycentric, atol=1e-11)


def test_flips_keep_lengths_angles_and_signposts():
    mesh = shapes.random_sphere(300)
    tracer = Tracer(mesh)
    flipping = FlippableMesh(tracer)
    halfedges = flipping.halfedges(list(range(3 * mesh.n_faces)))
    done = 0
    for k in np.random.default_rng(0).integers(0, len(halfedges), 2000).tolist():
        h = halfedges[k]
        if max(h.angle + h.twin.next.angle, h.twin.angle + h.next.angle) < np.pi - 1e-3:
            done += flipping.flip(h)
    assert done > 500
    total = np.zeros(len(tracer.fans.vertex))
    np.add.at(total, [h.fan for h in halfedges], [h.angle for h in halfedges])
    np.testing.assert_allclose(total, tracer.fans.total_angle, atol=1e-11)
    flipped = [h for h in halfedges if h.is_flipped]
    assert len(flipped) > 500
    fan = np.array([h.fan for h in flipped])
    post = np.array([h.post for h in flipped]) % tracer.fans.total_angle[fan]
    corner = tracer.fans.locate(fan, post)
    local = post - tracer.fans.angle_before[corner]
    e = tracer.unfolding.direction.reshape(-1, 2)[corner]
    direction = np.stack(
        [
            e[:, 0] * np.cos(local) - e[:, 1] * np.sin(local),
            e[:, 0] * np.sin(local) + e[:, 1] * np.cos(local),
        ],
        1,
    )
    ends = tracer.trace(
        corner // 3, np.eye(3)[corner % 3], direction, [flipping.scale * h.length for h in flipped]
    )
    head = [flipping.tail(h.twin) for h in flipped]
    gap = surface_position(mesh, ends.face, ends.barycentric) - mesh.points[head]
    assert np.linalg.norm(gap, axis=1).max() < 1e-9
    flipping.rewind()
    fresh = FlippableMesh(tracer)
    assert [state(h) for h in flipping.halfedges([7, 5])] == [state(h) for h in fresh.halfedges([7, 5])]
    neighbours = [flipping.twin(h) for h in flipping.halfedges(list(range(0, 300, 3)))]
    assert [state(h) for h in neighbours] == [
        state(h) for h in fresh.halfedges([h.index for h in neighbours])
    ]


def state(h):
    """Everything about a halfedge and its face."""
    return [
        (g.index, g.fan, g.length, g.angle, g.post, g.is_flipped, g.uses) for g in (h, h.next, h.next.next)
    ]


@pytest.mark.parametrize("mesh", [shapes.random_sphere(200), shapes.grid(8, 8)], ids=["closed", "boundary"])
def test_signpost_angles_equal_wedge_angles(mesh):
    """On the input and after flips, at inner vertices and on the boundary, counter-clockwise and back."""
    flipping = FlippableMesh(Tracer(mesh))
    halfedges = flipping.halfedges(list(range(3 * mesh.n_faces)))
    for k in np.random.default_rng(2).integers(0, len(halfedges), 600).tolist():
        h, t = halfedges[k], halfedges[k].twin
        ends = ((h, t.next), (t, h.next)) if t.next else ()
        if ends and all(a.angle + b.angle < np.pi - 1e-3 for a, b in ends):
            flipping.flip(h)
    assert sum(h.is_flipped for h in halfedges) > 50
    for first in halfedges:
        around = [first]
        while around[-1].next and len(around) < 4:
            around.append(around[-1].next.next.twin)
        for last in around[1:]:
            if last is not first:
                expected = flipping.wedge(first, last)[1], flipping.wedge(last, first)[1]
                np.testing.assert_allclose(flipping.turns(first, last), expected, atol=1e-12)
                np.testing.assert_allclose(flipping.turns(last, first), expected[::-1], atol=1e-12)


@pytest.mark.parametrize("mesh", [shapes.random_sphere(400), shapes.cylinder(60, 4, 1.0, 0.5)])
def test_edge_paths_do_not_depend_on_the_search_region(mesh):
    """Near vertices, far ones, and vertices near in space but far on the surface: a cylinder cut open."""
    mesh = TriangleMesh.from_arrays(mesh.points, mesh.faces[np.abs(mesh.points[mesh.faces, 1]).min(1) > 0.01])
    graph, rng, flipping = EdgeGraph(mesh), np.random.default_rng(0), FlippableMesh(Tracer(mesh))
    from scipy.sparse.csgraph import dijkstra

    distance, classes, longest = dijkstra(graph.graph), set(), mesh.side_length.max()  # by the longest side
    for a, b in rng.integers(0, mesh.n_vertices, (60, 2)).tolist():
        if a != b and np.isfinite(distance[a, b]):
            sides = graph.shortest_path(a, b)
            length = sum(h.length for h in flipping.halfedges(sides))
            assert length == pytest.approx(distance[a, b], rel=1e-12)
            straight = np.linalg.norm(mesh.points[a] - mesh.points[b]) / longest
            classes.add(int(np.searchsorted(DETOUR_LIMITS, distance[a, b] / straight - 1)))
    assert {0, 1} <= classes


def test_the_search_does_not_miss_the_edge_path_around_a_wall():
    """The path over the wall stays nearer to the straight line, the path around it is shorter."""
    from scipy.sparse.csgraph import dijkstra

    plane = shapes.grid(60, 60, 2.0, 2.0, pattern="alternating")
    x, y = plane.points[:, 0] - 1.0, plane.points[:, 1] - 1.0
    wall = (np.abs(x) < 0.01) & (np.abs(y) < 0.46)
    mesh = plane.moved(plane.points + 0.35 * wall[:, None] * [0, 0, 1])
    a, b = (int(np.argmin(np.hypot(x - at, y))) for at in (-0.5, 0.5))
    graph = EdgeGraph(mesh)
    truth = dijkstra(graph.graph, indices=a)[b]
    sides = graph.shortest_path(a, b)
    length = sum(h.length for h in FlippableMesh(Tracer(mesh)).halfedges(sides))
    assert length == pytest.approx(truth, rel=1e-12)
    assert mesh.points[mesh.topology.side_tail[sides], 2].max() == 0


def test_paths_agree_with_potpourri3d():
    pp3d = pytest.importorskip("potpourri3d")
    mesh = shapes.random_sphere(800)
    solver = pp3d.EdgeFlipGeodesicSolver(mesh.points, mesh.faces)
    for a, b in np.random.default_rng(3).integers(0, mesh.n_vertices, (6, 2)).tolist():
        if a != b:
            theirs = np.linalg.norm(np.diff(solver.find_geodesic_path(a, b), axis=0), axis=1).sum()
            ours = straighten_curves(mesh, [[a, b]], [False]).entries[0]["length"]
            assert ours == pytest.approx(theirs, rel=1e-12)


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_results_scale_with_the_mesh(scale):
    mesh = shapes.random_sphere(200)
    one, other = (
        straighten_curves(m, [[0, 50, 90]], [False]) for m in (mesh, mesh.moved(scale * mesh.points))
    )
    assert other.entries[0]["length"] == pytest.approx(scale * one.entries[0]["length"], rel=1e-12)
    assert other.entries[0]["edge_path_length"] == pytest.approx(scale * one.entries[0]["edge_path_length"])


def test_bad_way_points_are_refused():
    mesh = shapes.icosphere(1)
    for stops, word in ([[0, 999], "999"], [[3], "two different"], [[3, 3], "two different"]):
        with pytest.raises(ParameterError, match=word):
            edge_path(EdgeGraph(mesh), stops, False)


def test_boundary_paths_bend_around_holes():
    mesh = shapes.grid(9, 9, 9.0, 9.0)
    middle = mesh.points[mesh.faces].mean(axis=1)
    mesh = TriangleMesh.from_arrays(mesh.points, mesh.faces[np.abs(middle[:, :2] - 4.5).max(axis=1) > 1.5])
    below = straighten_curves(mesh, [[41, 22, 48]], [False])  # the same ends, either side of the hole
    above = straighten_curves(mesh, [[41, 82, 48]], [False])
    assert below.entries[0]["length"] == pytest.approx(2 * np.sqrt(5) + 3, rel=1e-13)
    assert above.entries[0]["length"] == pytest.approx(2 * np.hypot(2, 2) + 3, rel=1e-13)


def test_paths_through_a_pinched_vertex_keep_it():
    """Two spheres, or two sheets, that share one vertex: the geodesic is one of each, joined."""
    for submesh in (shapes.random_sphere(60), shapes.grid(4, 4)):
        n = submesh.n_vertices
        points = np.concatenate([submesh.points, 2 * submesh.points[0] - submesh.points])
        second = np.where(submesh.faces == 0, 0, submesh.faces + n)
        mesh = TriangleMesh.from_arrays(points, np.concatenate([submesh.faces, second[:, ::-1]]))
        far = n - 5
        curves = straighten_curves(mesh, [[far, 0, far + n - 1], [far, 0]], [False, False])
        through, half = (entry["length"] for entry in curves.entries)
        other = straighten_curves(submesh, [[0, far - 1]], [False]).entries[0]["length"]
        assert curves.converged and through == pytest.approx(half + other, rel=1e-12)


def test_a_path_that_blocks_itself_has_a_warning(caplog):
    mesh = shapes.grid(5, 5)
    holes = TriangleMesh.from_arrays(mesh.points, np.delete(mesh.faces, [1, 12, 30, 34], axis=0))
    curves = straighten_curves(holes, [[21, 28, 27, 26, 19, 12, 13, 14, 21, 28]], [False])
    assert not curves.converged and "overlaps itself" in caplog.text
    assert curves.entries[0]["length"] <= curves.entries[0]["edge_path_length"] * (1 + 1e-12)
    assert curves.converged == (curves.accuracy["path_angle_deficit"] < 1e-6)


def test_a_path_across_an_edge_of_three_pages_is_not_straight_and_has_a_warning(caplog):
    """Three squares on one edge: the shortest path crosses the edge inside, where flips do not move it."""
    square = shapes.grid(4, 4)
    spine = np.flatnonzero(square.points[:, 0] < 1e-12)
    pages, faces = [square.points], [square.faces]
    for k, angle in enumerate((2.0, 4.0), start=1):
        turned = square.points * [np.cos(angle), 1, 0] + square.points[:, :1] * [0, 0, np.sin(angle)]
        number = np.arange(square.n_vertices) + k * square.n_vertices
        number[spine] = spine
        pages.append(turned)
        faces.append(number[square.faces])
    mesh = TriangleMesh.from_arrays(np.concatenate(pages), np.concatenate(faces))
    start, middle, end = (
        int(np.argmin(np.abs(square.points[:, :2] - place).sum(axis=1)))
        for place in ([0.5, 0.75], [0.5, 0.5], [0.75, 0.0])
    )
    second = end + square.n_vertices
    by_a_vertex = straighten_curves(mesh, [[middle, middle + square.n_vertices]], [False])
    assert by_a_vertex.entries[0]["length"] == pytest.approx(1.0, rel=1e-12)
    assert by_a_vertex.converged and not caplog.text
    across = straighten_curves(mesh, [[start, second]], [False])
    assert across.entries[0]["length"] > np.hypot(1.25, 0.75) + 1e-4
    assert not across.converged and "edges of three or more faces, at 1 vertex" in caplog.text
    caplog.clear()
    on_a_page = straighten_curves(mesh, [[start, int(spine[0])]], [False])
    assert on_a_page.converged and not caplog.text
