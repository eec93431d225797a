"""Convergence rates of the distances to great circles and to the exact polyhedral distance."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics import fast_marching
from ddgcli.algorithms.geodesics.edge_distance import edge_distance
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance
from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import SolveError
from ddgcli.geometry.face_frames import surface_position
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import beside_a_sphere, disk, jittered, pillow


def jittered_torus(nu: int) -> TriangleMesh:
    u, v, faces = shapes.wrapped_grid(nu, nu // 2, wrap_u=True, wrap_v=True)
    shift = np.random.default_rng(0).uniform(-0.25, 0.25, (2, len(u)))
    u, v = 2 * np.pi * (u + shift[0] / nu), 2 * np.pi * (v + 2 * shift[1] / nu)
    r = 1 + 0.4 * np.cos(v)
    return TriangleMesh.from_arrays(np.stack([r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)], axis=1), faces)


SPHERES = [shapes.random_sphere(n) for n in (1000, 4000, 16000)]
TORI = [jittered_torus(nu) for nu in (40, 80, 160)]


def mean_errors(meshes, method):
    errors = []
    for mesh in meshes:
        truth = exact_distance(mesh, 0).distance
        errors.append(np.abs(method(mesh) - truth).mean() / truth.mean())
    return np.array(errors)


def rate(errors):
    """Order in the mesh size, which halves from mesh to mesh."""
    return np.log2(errors[0] / errors[-1]) / (len(errors) - 1)


def heat(**options):
    return lambda mesh: HeatSolver(flip_to_delaunay(mesh).mesh, **options).distance(0).distance


def test_exact_distance_converges_to_great_circles_with_order_two():
    errors = []
    for level in (2, 3, 4):
        mesh = shapes.icosphere(level)
        angle = np.arccos(np.clip(mesh.points @ mesh.points[0], -1, 1))
        errors.append(np.abs(exact_distance(mesh, 0).distance - angle).max())
    assert 1.9 < rate(errors) < 2.1


@pytest.mark.parametrize("meshes, least, last", [(SPHERES, 0.7, 3e-3), (TORI, 0.5, 2e-3)])
def test_fast_marching_is_of_first_order(meshes, least, last):
    errors = mean_errors(meshes, lambda mesh: fast_marching_distance(mesh, 0).distance)
    assert rate(errors) > least
    assert errors[-1] < last


@pytest.mark.parametrize("meshes", [SPHERES, TORI])
def test_straight_wavefronts_are_of_first_order_with_a_larger_constant(meshes):
    planar = mean_errors(meshes, lambda mesh: fast_marching_distance(mesh, 0, planar=True).distance)
    round_ = mean_errors(meshes, lambda mesh: fast_marching_distance(mesh, 0).distance)
    assert rate(planar) > 0.5
    assert (planar > 3 * round_).all()


def test_fast_marching_is_accurate_on_needles():
    """On the intrinsic Delaunay triangulation; stencils of the needles themselves have an error of 0.9 %."""
    mesh = SPHERES[1].moved(SPHERES[1].points * [10.0, 1.0, 0.1])
    truth, approximate = exact_distance(mesh, 0).distance, fast_marching_distance(mesh, 0).distance
    assert np.abs(approximate - truth).mean() < 1e-3 * truth.mean()


@pytest.mark.parametrize(
    "name", ["featuretype.STL", "hard/gen_concave_ngon.off", "hard/openscad-nonmanifold-crash.obj"]
)
def test_fast_marching_is_never_longer_than_paths_along_edges(shared_meshes, name):
    """Flipped edges still carry paths."""
    mesh = read_mesh(str(shared_meshes / name)).mesh
    approximate, along = fast_marching_distance(mesh, 0).distance, edge_distance(mesh, 0).distance
    assert (approximate <= along * (1 + 1e-12)).all()
    truth, reached = exact_distance(mesh, 0).distance, np.isfinite(along)
    assert np.abs(approximate[reached] - truth[reached]).mean() < 0.02 * truth[reached].mean()


@pytest.mark.parametrize("mesh", [SPHERES[0], TORI[0]])
def test_fast_marching_is_invariant_under_face_orientation(mesh):
    turned = np.where(np.arange(mesh.n_faces)[:, None] % 3 == 0, mesh.faces[:, ::-1], mesh.faces)
    other = TriangleMesh.from_arrays(mesh.points, turned)
    assert not other.topology.is_oriented
    truth = exact_distance(mesh, 0).distance
    assert np.abs(fast_marching_distance(other, 0).distance - truth).mean() < 0.02 * truth.mean()


def test_heat_of_a_square_is_that_of_its_double_cover():
    """Mirror images: half the sum of insulated and absorbing boundary is the heat without a boundary."""
    cover, k = pillow(8), 8
    square = TriangleMesh.from_arrays(cover.points[: (k + 1) ** 2], cover.faces[: 2 * k * k])
    source, logs = 2 * (k + 1) + 3, []
    for mesh in (cover, square):
        start = np.eye(1, mesh.n_vertices, source)[0]
        solver = HeatSolver(mesh, time=0.02)
        value, level, _, _ = solver._diffuse(start, np.ones(mesh.n_vertices, dtype=bool))
        logs.append(np.log(value / value[source]) + level)
    np.testing.assert_allclose(logs[1], logs[0][: square.n_vertices], atol=1e-9)


def test_refined_heat_converges_on_the_sphere_and_published_heat_does_not():
    published = mean_errors(SPHERES, heat())
    refined = mean_errors(SPHERES, heat(refine=1, time_factor=4.0))
    assert rate(published) < 0.3
    assert rate(refined) > 0.9
    assert refined[-1] < 0.1 * published[-1]


@pytest.mark.parametrize("options", [{}, {"refine": 1, "time_factor": 4.0}])
def test_heat_error_decreases_on_the_torus(options):
    """The cut locus is long: both smooth it over sqrt(t), so the error decreases more slowly than h."""
    errors = mean_errors(TORI, heat(**options))
    assert rate(errors) > 0.35
    assert errors[-1] < 0.03


def test_circular_wavefronts_are_exact_on_flat_pieces():
    mesh = shapes.grid(20, 20, pattern="alternating")
    truth = np.linalg.norm(mesh.points - mesh.points[0], axis=1)
    assert np.abs(fast_marching_distance(mesh, 0).distance - truth).max() < 1e-12


def test_circular_wavefronts_are_exact_next_to_a_source():
    """There the ends of the edge that a line crosses may lie beyond its own end."""
    mesh = disk(4000)
    for source in (0, 5, 14):
        truth = np.linalg.norm(mesh.points - mesh.points[source], axis=1)
        assert np.abs(fast_marching_distance(mesh, source).distance - truth).max() < 1e-12


@pytest.mark.parametrize("mesh", [disk(300), shapes.grid(30, 30)], ids=["disk", "grid"])
@pytest.mark.parametrize("at", ["vertex", "edge", "face"])
def test_fast_marching_is_exact_on_convex_flat_pieces_from_every_kind_of_point(mesh, at):
    """Also where a line reaches a vertex across an edge with an end farther away than the vertex, and where
    the faces unfolded beyond an obtuse corner hold the point."""
    random = np.random.default_rng(0)
    for face in random.integers(0, mesh.n_faces, 20):
        weights = random.dirichlet(np.ones(3)) * {"vertex": [1, 0, 0], "edge": [1, 1, 0]}.get(at, 1)
        points = SurfacePoints(np.array([face]), weights[None] / weights.sum())
        truth = np.linalg.norm(mesh.points - surface_position(mesh, points.face, points.barycentric), axis=1)
        distance = fast_marching_distance(mesh, Sources.at([], points)).distance
        assert np.abs(distance - truth).max() < 1e-7


def rim(mesh, on=lambda points: np.ones(len(points), dtype=bool)):
    """Sources on the boundary edges whose ends are all chosen, as one curve."""
    edge = mesh.topology.boundary_edges
    edge = edge[on(mesh.points)[mesh.topology.edges[edge]].all(axis=1)]
    return Sources.at([], None, edge, np.zeros(len(edge), dtype=np.int64))


def test_wavefronts_of_a_straight_side_are_exact():
    """They were circles around vertices: 2.4 % off on the finest of such meshes, too."""
    mesh = jittered(shapes.grid(20, 20), 0.015)
    sources = rim(mesh, lambda points: points[:, 0] == 0)
    assert np.abs(fast_marching_distance(mesh, sources).distance - mesh.points[:, 0]).max() < 1e-12


def test_the_distance_to_the_rim_of_a_square_is_exact_but_near_its_diagonals():
    """Fronts of two sides meet there: they have no common direction."""
    for cells in (10, 20, 40):
        mesh = jittered(shapes.grid(cells, cells), 0.3 / cells)
        x, y, _ = mesh.points.T
        error = fast_marching_distance(mesh, rim(mesh)).distance - np.minimum.reduce([x, y, 1 - x, 1 - y])
        beside = np.minimum(np.abs(x - y), np.abs(x + y - 1))
        assert np.abs(error).max() < 0.2 / cells
        assert np.abs(error[beside > 3 / cells]).max(initial=0.0) < 1e-12


def test_the_distance_from_a_round_hole_converges():
    """The largest error stayed at 2.4 % of the distance."""
    errors = []
    for cells in (12, 24, 48):
        u, v, faces = shapes.wrapped_grid(2 * cells, cells, wrap_u=True)
        points = np.stack(
            [(0.2 + v) * np.cos(2 * np.pi * u), (0.2 + v) * np.sin(2 * np.pi * u), 0 * u], axis=1
        )
        mesh = jittered(TriangleMesh.from_arrays(points, faces), 0.25 / cells)
        sources = rim(mesh, lambda points: np.hypot(*points.T[:2]) < 0.3)
        truth = exact_distance(mesh, sources).distance
        errors.append(np.abs(fast_marching_distance(mesh, sources).distance - truth).max())
    assert rate(np.array(errors)) > 0.7 and errors[-1] < 0.01


def test_nearest_sources_are_curves_or_vertices():
    mesh = jittered(shapes.grid(24, 24), 0.01)
    edge = mesh.topology.boundary_edges
    ends = mesh.points[mesh.topology.edges[edge]]
    left, right = (edge[(ends[:, :, 0] == x).all(axis=1)] for x in (0, 1))
    curve = np.repeat([0, 1], [len(left), len(right)])
    sources = Sources.at([300], None, np.concatenate([left, right]), curve)
    truth, nearest = exact_distance(mesh, sources), fast_marching_distance(mesh, sources).nearest_source
    assert (nearest == truth.nearest_source).mean() > 0.95 and set(nearest) == {0, 1, 2}


def test_fast_marching_on_a_component_does_not_depend_on_the_size_of_another():
    mesh = shapes.random_sphere(1000)
    points = SurfacePoints(np.array([100]), np.array([[0.2, 0.3, 0.5]]))
    alone = fast_marching_distance(mesh, Sources.at([4], points))
    for scale in (2.0**-10, 2.0**-30):
        both, first, face = beside_a_sphere(mesh, scale)
        moved = SurfacePoints(face + points.face, points.barycentric)
        beside = fast_marching_distance(both, Sources.at([first + 4], moved))
        assert np.allclose(beside.distance[first:] / scale, alone.distance, rtol=0, atol=1e-9)
        assert beside.updates < 1.5 * alone.updates  # the vertices of a bucket are about as many


def test_fast_marching_without_convergence_is_an_error(monkeypatch):
    monkeypatch.setattr(fast_marching, "MAX_ROUNDS_PER_VERTEX", 0)
    with pytest.raises(SolveError, match="exact"):
        fast_marching_distance(SPHERES[0], 0)
