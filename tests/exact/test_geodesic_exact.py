"""Exact distance against closed forms, symmetries and its own invariances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.hardcases.meshes import cylinder
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics.certificate import certificate
from ddgcli.algorithms.geodesics.exact import bundles as window_bundle
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import beside_a_sphere, cone, jittered, noisy_torus, on_pillow, pillow, with_holes


@pytest.mark.parametrize(
    "mesh", [shapes.grid(12, 9), jittered(shapes.grid(12, 12), 0.025)], ids=["regular", "jittered"]
)
@pytest.mark.parametrize("source", [0, 60])
def test_exact_distance_on_a_flat_square_is_euclidean(mesh, source):
    truth = np.linalg.norm(mesh.points - mesh.points[source], axis=1)
    assert np.abs(exact_distance(mesh, source).distance - truth).max() < 1e-12


@pytest.mark.parametrize("k", [1, 3, 8])
def test_opposite_corners_of_a_cube_have_distance_sqrt_5(k):
    mesh = shapes.box(k, k, k)
    far = int(np.argmax(mesh.points.sum(axis=1)))
    assert exact_distance(mesh, 0).distance[far] == pytest.approx(np.sqrt(5), abs=1e-12)


@pytest.mark.parametrize("angle", [1.0, 3.0, 5.5, 7.0, 9.0, 14.0])
@pytest.mark.parametrize("source", [0, 17, 40])
def test_exact_distance_on_a_cone_equals_the_closed_form(angle, source):
    mesh, radius, phi = cone(angle, 24, 6)
    turn = np.abs(phi - phi[source])
    turn = np.minimum(turn, angle - turn)
    r, bend = radius[source], np.minimum(turn, np.pi)
    straight = np.sqrt((radius - r) ** 2 + 4 * radius * r * np.sin(bend / 2) ** 2)
    by_apex = (turn >= np.pi) | (radius == 0) | (r == 0)
    truth = np.where(by_apex, radius + r, straight)
    assert np.abs(exact_distance(mesh, source).distance - truth).max() < 1e-12 * truth.max()


@pytest.mark.parametrize("source", [0, 8, 40, 100])
def test_exact_distance_on_a_double_covered_square_equals_the_closed_form(source):
    mesh = pillow(8)
    truth = on_pillow(mesh, 8, source)
    assert np.abs(exact_distance(mesh, source).distance - truth).max() < 1e-12


def test_exact_distance_around_a_hole_equals_the_closed_form():
    mesh = shapes.grid(12, 12)
    centre = mesh.points[mesh.faces].mean(axis=1)[:, :2]
    hole = (np.abs(centre - 0.5) < 0.25).all(axis=1)
    mesh = TriangleMesh.from_arrays(mesh.points, mesh.faces[~hole])
    source = int(np.argmin(np.linalg.norm(mesh.points - [0.5, 0, 0], axis=1)))
    target = int(np.argmin(np.linalg.norm(mesh.points - [0.5, 1, 0], axis=1)))
    truth = 2 * np.hypot(0.25, 0.25) + 0.5
    assert exact_distance(mesh, source).distance[target] == pytest.approx(truth, abs=1e-12)


@pytest.mark.parametrize(
    "weights", [[0.2, 0.3, 0.5], [0.5, 0.5, 0.0], [0.0, 0.25, 0.75], [0.0, 1.0, 0.0], [1e-9, 0.5, 0.5 - 1e-9]]
)
def test_a_source_inside_a_face_of_the_plane_has_euclidean_distance(weights):
    mesh = jittered(shapes.grid(9, 9), 0.03)
    points = SurfacePoints(np.array([70]), np.array([weights]))
    truth = np.linalg.norm(mesh.points - points.positions(mesh), axis=1)
    measured = exact_distance(mesh, Sources(np.zeros(0, dtype=int), points))
    assert np.abs(measured.distance - truth).max() < 1e-12
    assert (measured.nearest_source == 0).all()


def test_distance_between_opposite_sides_of_a_cube_equals_the_closed_form():
    mesh = shapes.box(1, 1, 1)
    bottom = np.flatnonzero((mesh.points[mesh.faces][:, :, 2] == 0).all(axis=1))[0]
    diagonal = np.flatnonzero(np.isclose(mesh.side_length[bottom], np.sqrt(2)))[0]
    weights = np.zeros(3)
    weights[[diagonal, (diagonal + 1) % 3]] = 0.5
    centre = Sources(np.zeros(0, dtype=int), SurfacePoints(np.array([bottom]), weights[None]))
    top = mesh.points[:, 2] == 1
    assert np.allclose(exact_distance(mesh, centre).distance[top], np.hypot(0.5, 1.5), atol=1e-14)


def test_several_sources_give_the_minimum_of_single_ones():
    mesh = shapes.torus(30, 15)
    points = SurfacePoints(np.array([11]), np.array([[0.2, 0.2, 0.6]]))
    together = exact_distance(mesh, Sources(np.array([3, 200]), points))
    alone = np.stack([exact_distance(mesh, one).distance for one in together_each(points)])
    assert np.allclose(together.distance, alone.min(axis=0), rtol=1e-14, atol=0)
    of_nearest = np.take_along_axis(alone, together.nearest_source[None], axis=0)[0]
    assert np.allclose(of_nearest, together.distance, rtol=1e-14, atol=0)


def together_each(points: SurfacePoints) -> list[Sources]:
    return Sources(np.array([3, 200]), points).each()


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e6, 1e100])
def test_exact_distance_scales_with_the_mesh(scale):
    mesh = shapes.random_sphere(400)
    once = exact_distance(mesh, 0).distance
    scaled = exact_distance(mesh.moved(mesh.points * scale), 0).distance
    assert np.abs(scaled / scale - once).max() < 1e-13


def test_exact_distance_is_invariant_under_renumbering():
    mesh = shapes.torus(20, 12)
    rng = np.random.default_rng(1)
    vertex, face = rng.permutation(mesh.n_vertices), rng.permutation(mesh.n_faces)
    points = np.empty_like(mesh.points)
    points[vertex] = mesh.points
    turned = np.array(
        [np.roll(f, r) for f, r in zip(vertex[mesh.faces[face]], rng.integers(0, 3, mesh.n_faces))]
    )
    renumbered = TriangleMesh.from_arrays(points, turned)
    a, b = exact_distance(mesh, 5).distance, exact_distance(renumbered, vertex[5]).distance
    assert np.abs(a - b[vertex]).max() < 1e-14


@pytest.mark.parametrize(
    "shape, gain", [(lambda: shapes.random_sphere(600), 1.3), (lambda: shapes.torus(60, 32), 1.02)]
)
def test_pruning_does_not_change_distances(shape, gain):
    mesh = shape()
    runs = [exact_distance(mesh, 7, dominance_every=k) for k in (0, 1, 3, 10)]
    assert runs[0].windows > gain * runs[1].windows  # it does prune
    for other in runs[1:]:
        assert np.array_equal(runs[0].distance, other.distance)


@pytest.mark.parametrize("shape", [noisy_torus, with_holes, lambda: pillow(6)])
def test_windows_outside_shadows_do_not_change_distances(shape):
    """Windows in all directions from a vertex give the same distances as windows in its shadow."""
    mesh = shape()
    tables = window_tables(mesh)
    everywhere = replace(tables, turn=np.full_like(tables.turn, np.nan))
    for source in (0, mesh.n_vertices // 2):
        few = exact_distance(mesh, source, tables=tables)
        many = exact_distance(mesh, source, tables=everywhere)
        assert few.windows < 0.8 * many.windows
        assert np.abs(few.distance - many.distance).max() < 1e-14 * many.distance.max()


@pytest.mark.parametrize("scale", [2.0**-30, 2.0**20])
def test_exact_distance_on_a_component_does_not_depend_on_the_size_of_another(scale):
    mesh = shapes.torus(24, 12)
    both, first, face = beside_a_sphere(mesh, scale)
    target = SurfacePoints(np.array([100]), np.array([[0.2, 0.3, 0.5]]))
    beside_target = SurfacePoints(face + target.face, target.barycentric)
    for limit in (np.inf, 2.0):
        alone = exact_distance(mesh, 5, targets=target, limit=limit)
        beside = exact_distance(both, [0, first + 5], targets=beside_target, limit=scale * limit)
        final = alone.distance < limit
        error = np.abs(beside.distance[first:] / scale - alone.distance)[final]
        assert error.max() < 1e-13
        if limit == np.inf:
            assert np.isclose(beside.target_distance / scale, alone.target_distance, rtol=1e-13).all()


@pytest.mark.parametrize("seed", range(3))
def test_exact_distance_is_invariant_under_face_orientation(seed):
    mesh = shapes.torus(18, 10)
    rng = np.random.default_rng(seed)
    turned = np.where(rng.random(mesh.n_faces)[:, None] < 0.4, mesh.faces[:, ::-1], mesh.faces)
    other = TriangleMesh.from_arrays(mesh.points, turned)
    assert not other.topology.is_oriented
    a, b = exact_distance(mesh, 3).distance, exact_distance(other, 3).distance
    assert np.abs(a - b).max() < 1e-14


def test_intrinsic_delaunay_mesh_has_the_same_distances():
    mesh = shapes.random_sphere(500)
    stretched = mesh.moved(mesh.points * [8, 1, 0.2])
    flipped = flip_to_delaunay(stretched)
    assert flipped.flips > 100
    a, b = exact_distance(stretched, 0).distance, exact_distance(flipped.mesh, 0).distance
    assert np.abs(a - b).max() < 1e-11 * a.max()


def test_three_sheets_on_one_edge_equal_three_planes():
    """Three half planes on the line x = 0: any two of them are one flat plane."""
    half = jittered(shapes.grid(8, 8), 0.03)
    rim = np.flatnonzero(half.points[:, 0] == 0)
    n = half.n_vertices
    points, faces, plane = [half.points], [half.faces], [half.points]
    for copy, turn in ((1, 2.0), (2, 4.0)):
        number = np.arange(n) + copy * n
        number[rim] = rim
        x, y = half.points[:, 0], half.points[:, 1]
        points.append(np.stack([x * np.cos(turn), y, x * np.sin(turn)], axis=1))
        faces.append(number[half.faces])
        plane.append(np.stack([-x, y, 0 * x], axis=1))
    mesh = TriangleMesh.from_arrays(np.concatenate(points), np.concatenate(faces))
    assert len(mesh.topology.nonmanifold_edges) == 8
    source = 40
    truth = np.linalg.norm(np.concatenate(plane) - half.points[source], axis=1)
    referenced = mesh.topology.referenced_vertex
    measured = exact_distance(mesh, source).distance
    assert np.abs(measured - truth)[referenced].max() < 1e-12
    assert np.isinf(measured[~referenced]).all()


def test_repeated_and_collapsed_faces_do_not_change_distances():
    mesh = jittered(shapes.grid(8, 8), 0.03)
    extra = np.concatenate(
        [mesh.faces, mesh.faces[[5, 40]], mesh.faces[[7]][:, ::-1], [[30, 31, 31], [20, 20, 20]]]
    )
    worse = TriangleMesh.from_arrays(mesh.points, extra)
    a, b = exact_distance(mesh, 3).distance, exact_distance(worse, 3).distance
    assert np.abs(a - b).max() < 1e-14


@pytest.mark.parametrize("height", [0.0, 1e-15, 1e-12, 1e-9])
def test_caps_without_height_have_exact_distances(height):
    """Flat grid with a vertex almost at the middle of its neighbour's edge."""
    mesh = shapes.grid(10, 10)
    face = 95
    a, b, c = mesh.faces[face]
    points = np.concatenate([mesh.points, [mesh.points[[a, b]].mean(axis=0)]])
    inward = mesh.points[c] - points[-1]
    points[-1] += height * inward / np.linalg.norm(inward)
    new = len(points) - 1
    faces = np.concatenate([np.delete(mesh.faces, face, axis=0), [[a, b, new], [b, c, new], [c, a, new]]])
    capped = TriangleMesh.from_arrays(points, faces)
    for source in (0, new):
        truth = np.linalg.norm(points - points[source], axis=1)
        assert np.abs(exact_distance(capped, source).distance - truth).max() < 1e-12 + height


def test_zero_edge_carries_paths():
    mesh = shapes.grid(6, 6)
    points = mesh.points.copy()
    points[24] = points[25]
    measured = exact_distance(TriangleMesh.from_arrays(points, mesh.faces), 0)
    assert np.isfinite(measured.distance).all() and measured.patched == 0
    assert measured.distance[24] == measured.distance[25]


def test_islands_have_infinite_distance():
    one, two = shapes.icosphere(1), shapes.icosphere(1)
    faces = np.concatenate([one.faces, two.faces + one.n_vertices])
    measured = exact_distance(TriangleMesh.from_arrays(np.concatenate([one.points, two.points]), faces), 0)
    assert np.isfinite(measured.distance[: one.n_vertices]).all()
    assert np.isinf(measured.distance[one.n_vertices :]).all()
    assert (measured.nearest_source[one.n_vertices :] == -1).all()


def test_limit_leaves_the_near_distances_exact():
    mesh = shapes.random_sphere(800)
    full = exact_distance(mesh, 0)
    near = exact_distance(mesh, 0, limit=0.8)
    inside = full.distance < 0.8
    assert np.array_equal(near.distance[inside], full.distance[inside])
    assert near.windows < 0.6 * full.windows


@pytest.fixture(scope="module")
def fine_sphere():
    mesh = shapes.random_sphere(40_000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window_bundle, "MIN_BOUND_WINDOWS", np.inf)  # windows are compared one by one
        return mesh, exact_distance(mesh, 0)


@pytest.mark.parametrize("tolerance", [0.03, 0.1, 0.3])
def test_a_tolerance_errs_upwards_within_its_bound(fine_sphere, tolerance):
    mesh, exact = fine_sphere
    loose = exact_distance(mesh, 0, tolerance=tolerance)
    error = (loose.distance - exact.distance) / exact.distance.max()
    assert error.min() > -1e-14
    assert 0 < error.max() < 0.05 * tolerance
    assert error.max() < loose.tolerance_error < 12 * error.max()
    assert loose.windows < 0.7 * exact.windows


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, sources",
    [
        ("cloth_ball92.ply", (480, 0, 39637)),
        ("koala.obj", (22030, 31847)),
        ("self_intersectA.obj", (2429, 7300)),
        ("plane_holes.obj", (2023, 6520)),
        ("wingnut.obj", (34, 19)),
        ("nefertiti-lowres.obj", (19860,)),
    ],
)
def test_error_under_a_tolerance_is_not_estimated_too_small(shared_meshes, name, sources):
    """Meshes and sources where the nearest part is smoother than the rest."""
    mesh = read_mesh(str(shared_meshes / name)).mesh
    for source in sources:
        exact = exact_distance(mesh, source).distance
        reached = np.isfinite(exact)
        for tolerance in (0.03, 0.3, 1.0):
            loose = exact_distance(mesh, source, tolerance=tolerance)
            error = (loose.distance[reached] - exact[reached]).max() / exact[reached].max()
            assert error <= loose.tolerance_error <= 25 * error


@pytest.mark.parametrize("tolerance", [0.001, 0.01, 0.1, 1.0])
def test_a_tolerance_never_needs_more_windows_than_exact(tolerance):
    """If a tolerance needs more windows than it saves, the result is exact and reported as exact."""
    sphere = shapes.random_sphere(3000)
    rough = sphere.moved(sphere.points * np.random.default_rng(0).normal(1.0, 0.005, (3000, 1)))
    for mesh in (sphere, rough, shapes.torus(80, 40), shapes.random_sphere(900)):
        exact, loose = exact_distance(mesh, 0), exact_distance(mesh, 0, tolerance=tolerance)
        assert loose.windows <= exact.windows
        assert (loose.distance >= exact.distance * (1 - 1e-14)).all()
        assert (loose.tolerance_error == 0) == np.array_equal(loose.distance, exact.distance)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_distance_is_a_metric(seed):
    rng = np.random.default_rng(seed)
    mesh = shapes.random_sphere(120, seed)
    mesh = mesh.moved(mesh.points * rng.uniform(0.2, 3, 3) * (1 + 0.2 * rng.normal(size=(120, 1))))
    vertices = rng.choice(120, 5, replace=False)
    rows = np.stack([exact_distance(mesh, v).distance for v in vertices])
    table = rows[:, vertices]
    assert np.abs(table - table.T).max() < 1e-12 * table.max()
    assert (table[:, None, :] <= table[:, :, None] + table[None, :, :] + 1e-12 * table.max()).all()
    edges, length = mesh.topology.edges, np.empty(mesh.topology.n_edges)
    length[mesh.topology.side_edge] = mesh.side_length
    assert (np.abs(rows[:, edges[:, 0]] - rows[:, edges[:, 1]]) <= length + 1e-12 * table.max()).all()
    straight = np.linalg.norm(mesh.points[None] - mesh.points[vertices][:, None], axis=2)
    assert (rows >= straight - 1e-12 * table.max()).all()


def test_certificate_has_no_violations_far_from_the_origin():
    """Rounding of large coordinates is no violation."""
    mesh = shapes.grid(8, 8)
    far = mesh.moved(mesh.points + [3e6, -1e7, 2e6])
    distance = exact_distance(far, 0).distance
    assert certificate(far, Sources.at([0]), distance)["violations_straight_line"] == 0
    assert certificate(far, Sources.at([0]), 0.999 * distance)["violations_straight_line"] > 70


@pytest.mark.parametrize("sources", [[], [-1], [25], [0, 99]])
def test_bad_sources_are_refused(sources):
    with pytest.raises(ParameterError):
        exact_distance(shapes.grid(4, 4), sources)


def test_source_on_an_unused_vertex_is_refused():
    mesh = shapes.grid(3, 3)
    with_loose_vertex = TriangleMesh.from_arrays(np.concatenate([mesh.points, [[9, 9, 9]]]), mesh.faces)
    with pytest.raises(ParameterError, match="vertex 16 belongs to no face"):
        exact_distance(with_loose_vertex, 16)


def test_progress_increases_to_the_total():
    fractions: list[float] = []
    exact_distance(noisy_torus(), 0, progress=lambda done, total: fractions.append(done / total))
    assert (
        len(fractions) > 3
        and fractions == sorted(fractions)
        and fractions[0] < 0.2
        and 0.6 < fractions[-1] <= 1
    )


@pytest.mark.parametrize("count", [1, 20])
def test_certificate_detects_wrong_distances(count):
    """Few and many sources use different searches for the nearest straight line."""
    mesh = shapes.grid(12, 12)
    sources = Sources.at(range(0, 8 * count, 8))
    distance = exact_distance(mesh, sources).distance
    away = int((distance > 0).sum())
    right, short, long = (certificate(mesh, sources, factor * distance) for factor in (1.0, 0.99, 1.5))
    counts = ("violations_straight_line", "violations_edge_distance", "violations_lipschitz")
    assert [right[name] for name in counts] == [0, 0, 0]
    assert short["violations_straight_line"] == away and short["violations_edge_distance"] == 0
    assert long["violations_edge_distance"] > away / 4 and long["violations_lipschitz"] > away / 4
    assert long["lipschitz_excess"] == pytest.approx(0.5, abs=1e-9)


def test_a_cylinder_of_needles_has_few_windows_and_its_unrolled_distances():
    """Rounding decides which vertices of a straight boundary improve each other: ties bring no windows."""
    around = 500
    mesh = TriangleMesh.from_arrays(*cylinder(2 * around))
    result = exact_distance(mesh, 0)
    step = np.arange(2 * around) % around
    along = np.minimum(step, around - step) * 2 * np.sin(np.pi / around)
    truth = np.hypot(along, np.asarray(mesh.points)[:, 2])
    assert np.abs(result.distance - truth).max() < 1e-12 * truth.max()
    assert result.windows < 0.2 * (2 * around) ** 2  # 0.83 where each tie bends a path again


@pytest.mark.parametrize("length", [1e2, 1e3, 1e4])
@pytest.mark.parametrize("source", [3, 41, 72])
def test_lines_through_flat_vertices_of_a_long_prism_reach_the_vertices_behind(length, source):
    rings, around = 20, 6
    ring, corner = np.divmod(np.arange(rings * around), around)
    angle = 2 * np.pi * corner / around
    points = np.stack([length * ring / (rings - 1), np.cos(angle), np.sin(angle)], axis=1)
    a = np.flatnonzero(ring < rings - 1)
    b = a - corner[a] + (corner[a] + 1) % around
    faces = np.concatenate([np.stack([a, b + around, a + around], 1), np.stack([a, b, b + around], 1)])
    turn = np.abs(corner - corner[source])
    truth = np.hypot(np.minimum(turn, around - turn), points[:, 0] - points[source, 0])
    distance = exact_distance(TriangleMesh.from_arrays(points, faces), source).distance
    assert np.abs(distance - truth).max() < 1e-12 * truth.max()
