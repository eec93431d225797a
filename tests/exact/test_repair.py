"""Repairs: what each step changes, the maps to the input, and that a repaired mesh is accepted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.hardcases.meshes import voxel_surface
from ddgcli.algorithms.repair.holes import least_area_triangles
from ddgcli.algorithms.repair.pipeline import RepairSteps, repair_mesh, steps_for
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import dihedral_angle, enclosed_volume, folded_edges
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh import repair, shapes
from ddgcli.mesh.requirements import unmet_need
from ddgcli.mesh.triangle_mesh import TriangleMesh


def area(mesh):
    return np.linalg.norm(np.cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1]), axis=1).sum() / 2


def soup(mesh):
    """Every face with vertices of its own."""
    return TriangleMesh.from_arrays(
        mesh.points[mesh.faces.ravel()], np.arange(3 * mesh.n_faces).reshape(-1, 3)
    )


def turned(mesh, every):
    faces = mesh.faces.copy()
    faces[::every] = faces[::every, ::-1]
    return TriangleMesh.from_arrays(mesh.points, faces)


def test_weld_joins_a_soup_into_the_sphere_it_was():
    sphere = shapes.icosphere(2)
    repaired, changes = repair_mesh(soup(sphere), RepairSteps(weld=0.0))
    assert changes == {"weld": 3 * sphere.n_faces - sphere.n_vertices}
    assert repaired.mesh.topology.is_closed and repaired.mesh.n_vertices == sphere.n_vertices
    apart = soup(sphere)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(apart.points.shape)
    near, _ = repair_mesh(apart.moved(apart.points + noise), RepairSteps(weld=1e-4))
    assert near.mesh.topology.is_closed and near.mesh.n_vertices == sphere.n_vertices


def test_maps_name_the_input_of_every_vertex_and_face():
    mesh = turned(soup(shapes.torus(9, 7)), 3)
    repaired, _ = repair_mesh(mesh, RepairSteps(weld=0.0, orient=True, cut_to_disk=True, drop_unused=True))
    assert np.array_equal(repaired.mesh.points, mesh.points[repaired.input_vertex])
    assert np.array_equal(repaired.input_face, np.arange(mesh.n_faces))
    positions = np.sort(repaired.mesh.points[repaired.mesh.faces], axis=1)
    assert np.array_equal(positions, np.sort(mesh.points[mesh.faces], axis=1))


def test_orient_turns_the_fewer_faces():
    mesh = turned(shapes.icosphere(2), 4)
    repaired, changes = repair_mesh(mesh, RepairSteps(orient=True))
    assert changes["orient"] == mesh.n_faces // 4 and repaired.mesh.topology.is_oriented


def test_split_fans_parts_a_fin_from_a_sphere_and_two_cones_at_their_tip():
    sphere = shapes.icosphere(1)
    a, b = sphere.topology.edges[0]
    fin = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, [[2.0, 0, 0]]]),
        np.concatenate([sphere.faces, [[a, b, sphere.n_vertices]]]),
    )
    repaired, _ = repair_mesh(fin, RepairSteps(split_fans=True))
    assert repaired.mesh.topology.is_manifold and repaired.mesh.topology.n_components == 2
    first = int(sphere.points[:, 2].argmax())
    other = np.where(sphere.faces == first, first, sphere.faces + sphere.n_vertices)
    twins = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, [0, 0, 2 * sphere.points[first, 2]] - sphere.points * [1, 1, 1]]),
        np.concatenate([sphere.faces, other]),
    )
    parted, changes = repair_mesh(twins, RepairSteps(split_fans=True, drop_unused=True))
    assert changes == {"split_fans": 1, "drop_unused": 1} and parted.mesh.topology.n_components == 2


@pytest.mark.parametrize("seed", range(40))
def test_voxel_bodies_that_touch_along_edges_stay_closed(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 6))
    solid = np.pad(random.random((n, n, n)) < random.choice([0.2, 0.4, 0.6]), 1)
    solid[1, 1, 1] = solid[2, 2, 1] = True
    solid[1, 2, 1] = solid[2, 1, 1] = False
    points, faces = voxel_surface(solid)
    turn = Rotation.random(random_state=seed).as_matrix()
    mesh = TriangleMesh.from_arrays(points @ turn.T, random.permutation(faces))
    assert len(mesh.topology.nonmanifold_edges)
    repaired, changes = repair_mesh(mesh, RepairSteps(split_fans=True))
    topology = repaired.mesh.topology
    assert topology.is_manifold and topology.is_oriented and topology.is_closed
    assert enclosed_volume(repaired.mesh) == pytest.approx(solid.sum(), rel=1e-12)
    assert np.array_equal(repaired.mesh.points[repaired.mesh.faces], mesh.points[mesh.faces])
    assert changes["split_fans"] == repaired.mesh.n_vertices - mesh.n_vertices
    again, changes = repair_mesh(repaired.mesh, RepairSteps(split_fans=True))
    assert changes == {"split_fans": 0}


def test_two_bodies_that_touch_along_an_edge_become_two_and_one_that_touches_itself_stays_one():
    solid = np.zeros((4, 4, 4), dtype=bool)
    solid[1, 1, 1] = solid[2, 2, 1] = True
    repaired, _ = repair_mesh(TriangleMesh.from_arrays(*voxel_surface(solid)), RepairSteps(split_fans=True))
    assert repaired.mesh.topology.n_components == 2 and repaired.mesh.topology.is_closed
    solid[1:3, 1:3, 2] = True
    bridge = np.pad(solid, 1)
    bridge[2:4, 2:4, 1] = True  # the edge has a full layer above it and below it
    for body in (solid, bridge):  # legs below a plate; a block with two notches
        mesh = TriangleMesh.from_arrays(*voxel_surface(body))
        repaired, _ = repair_mesh(mesh, RepairSteps(split_fans=True))
        topology = repaired.mesh.topology
        assert topology.n_components == 1 and topology.is_closed and len(mesh.topology.nonmanifold_edges) == 1
        assert topology.euler_characteristic == 2


def test_faces_that_lie_on_each_other_at_an_edge_are_all_parted():
    points, faces = shapes.box().points, shapes.box().faces
    pair = np.array([faces[0], faces[0][::-1]])  # of no thickness, on a face of the box
    mesh = TriangleMesh.from_arrays(points, np.concatenate([faces, pair]))
    repaired, _ = repair_mesh(mesh, RepairSteps(split_fans=True))
    assert repaired.mesh.topology.is_manifold and len(repaired.mesh.topology.boundary_edges)


def test_split_fans_ends_on_random_soups_of_few_vertices():
    random = np.random.default_rng(3)
    for _ in range(40):
        n = int(random.integers(4, 9))
        faces = np.array([random.permutation(n)[:3] for _ in range(int(random.integers(2, 30)))])
        mesh = TriangleMesh.from_arrays(random.standard_normal((n, 3)), faces)
        repaired, _ = repair_mesh(mesh, RepairSteps(split_fans=True, orient=True))
        assert repaired.mesh.topology.is_manifold
        assert np.isclose(area(repaired.mesh), area(mesh))


def test_split_folds_parts_the_sheets_of_a_folded_strip_and_of_a_face_that_lies_on_others():
    strip = shapes.grid(7, 3)
    points = strip.points.copy()
    points[:, 0] = np.where(points[:, 0] > points[12, 0], 2 * points[12, 0] - points[:, 0], points[:, 0])
    folded = TriangleMesh.from_arrays(points, strip.faces)
    repaired, changes = repair_mesh(folded, RepairSteps(split_folds=True))
    assert changes == {"split_folds": 4} and repaired.mesh.topology.n_components == 2
    assert np.array_equal(repaired.mesh.points, points[repaired.input_vertex])
    assert not repair_mesh(shapes.icosphere(1), RepairSteps(split_folds=True))[1]["split_folds"]
    # one edge inside a surface: its faces also meet around both ends
    flat = shapes.grid(4, 4)
    points = flat.points.copy()
    points[12] = 0.5 * (points[6] + points[7]) + 1.3 * (points[6] - points[11])
    flipped = TriangleMesh.from_arrays(points, flat.faces)
    assert len(folded_edges(dihedral_angle(flipped)))
    repaired, _ = repair_mesh(flipped, RepairSteps(split_folds=True))
    assert not len(folded_edges(dihedral_angle(repaired.mesh))) and repaired.mesh.n_faces == flat.n_faces


def test_degenerate_duplicate_and_unused_parts_are_dropped():
    sphere = shapes.icosphere(1)
    points = np.concatenate([sphere.points, [sphere.points[0] + [0, 0, 1], [5.0, 5, 5]]])
    n = sphere.n_vertices
    line = [sphere.faces[0, 0], sphere.faces[0, 0], n]
    faces = np.concatenate([sphere.faces, sphere.faces[:2, [1, 2, 0]], [line]])
    repaired, changes = repair_mesh(
        TriangleMesh.from_arrays(points, faces),
        RepairSteps(drop_degenerate=True, drop_duplicates=True, drop_unused=True),
    )
    assert changes == {"drop_degenerate": 1, "drop_duplicates": 2, "drop_unused": 2}
    assert repaired.mesh.topology.is_closed


def test_a_face_without_area_is_dropped_though_its_three_vertices_differ():
    grid = shapes.grid(2, 2)  # vertices 0, 1, 2 lie on a line
    mesh = TriangleMesh.from_arrays(grid.points, np.concatenate([grid.faces, [[0, 2, 1]]]))
    repaired, changes = repair_mesh(mesh, RepairSteps(drop_degenerate=True))
    assert changes["drop_degenerate"] == 1
    assert np.array_equal(repaired.mesh.faces, grid.faces)


def test_a_filled_hole_closes_the_sphere_with_the_least_area():
    sphere = shapes.icosphere(3)
    hole = sphere.points[sphere.faces].mean(axis=1)[:, 2] > 0.9
    open_sphere = TriangleMesh.from_arrays(sphere.points, sphere.faces[~hole])
    repaired, changes = repair_mesh(open_sphere, RepairSteps(fill_holes=100, drop_unused=True))
    assert changes["fill_holes"] == 1 and (repaired.input_face == -1).sum() > 3
    assert repaired.mesh.topology.is_closed and repaired.mesh.topology.is_oriented
    assert repaired.mesh.topology.genus == 0
    lid = area(repaired.mesh) - area(open_sphere)
    rim = np.pi * (1 - 0.9**2)
    assert 0.7 * rim < lid < 1.1 * rim  # a nearly flat disk
    result, counts = repair_mesh(open_sphere, RepairSteps(fill_holes=5))
    assert counts == {"fill_holes": 0} and not result.mesh.topology.is_closed


def test_a_square_hole_is_filled_by_its_shorter_diagonal():
    grid = shapes.grid(3, 3)
    middle = np.abs(grid.points[grid.faces].mean(axis=1)[:, :2] - grid.points[:, :2].mean(axis=0)).max(axis=1)
    square_ring = TriangleMesh.from_arrays(grid.points, grid.faces[middle > middle.min() + 1e-9])
    repaired, _ = repair_mesh(square_ring, RepairSteps(fill_holes=4))
    assert np.isclose(area(repaired.mesh), area(grid))


def with_vertex_on_edge(mesh):
    """A vertex on an edge of a closed surface that the face on one side has, and a face without area."""
    a, b, c = mesh.faces[0].tolist()
    x = mesh.n_vertices
    points = np.concatenate([mesh.points, [0.5 * (mesh.points[a] + mesh.points[b])]])
    return TriangleMesh.from_arrays(
        points, np.concatenate([mesh.faces[1:], [[a, x, c], [x, b, c], [a, b, x]]])
    )


def with_vertex_on_line(mesh):
    """A vertex of three faces on the line along an edge: one of them has no area."""
    a, c, x = mesh.faces[0].tolist()
    b = mesh.n_vertices
    points = np.concatenate([mesh.points, [2 * mesh.points[x] - mesh.points[a]]])
    return TriangleMesh.from_arrays(
        points, np.concatenate([mesh.faces[1:], [[x, a, b], [a, c, b], [c, x, b]]])
    )


@pytest.mark.parametrize("disturbed, n_further", [(with_vertex_on_edge, 2), (with_vertex_on_line, 0)])
def test_the_hole_of_a_face_without_area_is_closed_by_faces_with_area(disturbed, n_further):
    sphere = shapes.icosphere(1)
    mesh = disturbed(sphere)
    assert len(mesh.flat_faces) == 1 and mesh.topology.is_closed
    repaired, changes = repair_mesh(mesh, RepairSteps(drop_degenerate=True, fill_holes=3))
    assert changes == {"drop_degenerate": 1, "fill_holes": 1}
    closed = repaired.mesh
    assert closed.topology.is_closed and closed.topology.is_oriented and not len(closed.flat_faces)
    assert closed.n_faces == sphere.n_faces + n_further and (repaired.input_face >= 0).all()
    assert np.isclose(enclosed_volume(closed), enclosed_volume(sphere)) and np.isclose(
        area(closed), area(sphere)
    )


def test_a_fin_of_one_triangle_is_not_filled_by_its_own_reverse():
    """Fans are split before holes are filled: the fin is a component of one face then."""
    ball = shapes.icosphere(1)
    a, b, _ = ball.faces[5]
    points = np.concatenate([ball.points, [2.0 * ball.points[a]]])
    mesh = TriangleMesh.from_arrays(points, [*ball.faces[1:], [a, b, ball.n_vertices]])
    options = RepairSteps(split_fans=True, orient=True, fill_holes=3, drop_duplicates=True)
    once, changes = repair_mesh(mesh, options)
    lone = once.mesh.topology.edge_face_count[once.mesh.topology.side_edge] == 1
    assert changes["fill_holes"] == 1 and lone.all(axis=1).sum() == 1
    again, changes = repair_mesh(once.mesh, options)
    assert not any(changes.values()) and np.array_equal(again.mesh.faces, once.mesh.faces)


def test_a_loop_with_straight_parts_is_filled_by_triangles_with_area():
    """A rim of a square has collinear vertices; every sum of triangles with area has the square's own."""
    bowl = shapes.grid(6, 6)
    bowl = bowl.moved(
        bowl.points - [0, 0, 1] * np.sin(np.pi * bowl.points[:, :1]) * np.sin(np.pi * bowl.points[:, 1:2])
    )
    repaired, changes = repair_mesh(bowl, RepairSteps(fill_holes=24))
    lid = repaired.input_face == -1
    assert changes["fill_holes"] == 1 and lid.sum() == 22
    assert face_area(repaired.mesh.side_length)[lid].min() > 1e-3
    assert np.isclose(face_area(repaired.mesh.side_length)[lid].sum(), 1.0)


@pytest.mark.parametrize(
    "mesh",
    [shapes.icosphere(2), shapes.torus(12, 8), shapes.grid(5, 5), shapes.cylinder(9, 5)],
    ids=["sphere", "torus", "disk", "annulus"],
)
def test_a_cut_surface_is_a_disk(mesh):
    repaired, changes = repair_mesh(mesh, RepairSteps(cut_to_disk=True))
    topology = repaired.mesh.topology
    assert (topology.boundary_loops, topology.euler_characteristic, topology.genus) == (1, 1, 0)
    assert topology.is_manifold and topology.is_oriented
    assert (changes["cut_to_disk"] == 0) == (mesh.topology.euler_characteristic == 1)


def test_the_largest_component_stays():
    small, large = shapes.icosphere(1), shapes.icosphere(3)
    both = TriangleMesh.from_arrays(
        np.concatenate([small.points + 5, large.points]),
        np.concatenate([small.faces, large.faces + small.n_vertices]),
    )
    repaired, _ = repair_mesh(both, RepairSteps(largest=True, drop_unused=True))
    assert repaired.mesh.n_faces == large.n_faces and repaired.input_vertex.min() == small.n_vertices


@pytest.mark.parametrize(
    "command", ["delaunay", "hodge", "fluid-sim", "willmore-flow", "shell-sim", "curvature"]
)
def test_steps_for_a_command_make_it_accept_the_mesh(command):
    sphere = turned(shapes.icosphere(2), 4)
    a, b, c = sphere.faces[0]
    bad = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, [[0, 0, 3.0]]]),
        np.concatenate([sphere.faces, [[a, b, sphere.n_vertices], [a, a, b], [a, b, c]]]),
    )
    repaired, _ = repair_mesh(bad, steps_for(command))
    assert unmet_need(repaired.mesh, command) is None


def test_what_cannot_be_repaired_is_refused():
    sphere = shapes.icosphere(1)
    with pytest.raises(ParameterError, match="no repair is chosen"):
        repair_mesh(sphere, RepairSteps())
    with pytest.raises(ParameterError, match="takes no surface"):
        steps_for("frames")
    with pytest.raises(MeshError, match="add `orient`"):
        repair_mesh(turned(sphere, 3), RepairSteps(cut_to_disk=True))


def test_a_weld_that_collapses_faces_warns_with_a_remedy_that_works(caplog):
    """Both faces beside a short edge name one vertex twice once its ends are one."""
    grid = shapes.grid(4, 4)
    points = grid.points.copy()
    ends = next(edge for edge in grid.topology.edges if not grid.topology.boundary_vertex[edge].any())
    points[ends[1]] = points[ends[0]] + 1e-3 * (points[ends[1]] - points[ends[0]])
    mesh = grid.moved(points)
    repaired, changes = repair_mesh(mesh, RepairSteps(weld=0.01))
    assert changes == {"weld": 1} and len(repaired.mesh.topology.repeated_vertex_faces) == 2
    assert "the weld makes 2 faces name a vertex twice" in caplog.text and "drop_degenerate" in caplog.text
    caplog.clear()
    repaired, _ = repair_mesh(mesh, RepairSteps(weld=0.01, drop_degenerate=True))
    assert repaired.mesh.n_faces == grid.n_faces - 2 and unmet_need(repaired.mesh, "hodge") is None
    repair_mesh(soup(grid), RepairSteps(weld=0.0))
    assert not caplog.records


def test_a_weld_that_leaves_no_face_is_refused():
    with pytest.raises(MeshError, match="the weld leaves no face with three different vertices; weld by a"):
        repair_mesh(shapes.icosphere(1), RepairSteps(weld=10.0))


@pytest.mark.parametrize("n_hashes", [None, 1, 7])
def test_merged_points_are_the_unique_positions_whatever_their_hashes(monkeypatch, n_hashes):
    points = np.random.default_rng(3).integers(-4, 5, (2000, 3)) / 4
    points[::50] = -0.0
    points[::333, 1] = np.nan  # equal to nothing, itself included
    if n_hashes is not None:
        monkeypatch.setattr(
            repair, "_position_hash", lambda c: (np.abs(c[0] * 8).astype(np.uint64) % n_hashes) << 60
        )
    merged, index = repair.merged_points(points)
    first: dict[tuple, int] = {}
    key = [tuple(p) if np.isfinite(p).all() else k for k, p in enumerate((points + 0.0).tolist())]
    expected = [first.setdefault(k, len(first)) for k in key]
    assert np.array_equal(index, expected) and len(merged) == len(first) < 1000
    assert np.array_equal(merged[index], points, equal_nan=True)


def test_hashes_of_grids_in_single_precision_differ_as_random_numbers():
    grid = np.stack(np.meshgrid(*[np.float32(0.1) * np.arange(50, dtype=np.float32)] * 3), -1).reshape(-1, 3)
    high = repair._position_hash(np.ascontiguousarray(grid.T, dtype=np.float64)) >> np.uint64(34)
    n_pairs = len(grid) - len(np.unique(high))
    assert n_pairs < 30  # 7.3 are expected of 125,000 random numbers of 30 bits


def least_area(points, first, last, forbidden):
    """Least area over the chord between two corners, by recursion over the apex of its triangle."""
    if last - first < 2:
        return 0.0
    chord = last - first < len(points) - 1 and {first, last} in forbidden
    a, b = points[first], points[last]
    return np.inf if chord else min(
        least_area(points, first, m, forbidden) + least_area(points, m, last, forbidden)
        + 0.5 * np.linalg.norm(np.cross(points[m] - a, b - a))
        for m in range(first + 1, last)
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(6))
def test_loops_are_filled_with_the_least_area_of_all_triangulations(seed):
    """Blocks of chords of one length at once; diagonals that are edges already are left out."""
    rng = np.random.default_rng(seed)
    loop, points = rng.permutation(20)[:8], rng.normal(size=(20, 3))
    pairs = [(0, 2), (1, 4), (3, 7)][: seed % 4]
    edges = np.array([[loop[i], loop[j]] for i, j in pairs], dtype=np.int64).reshape(-1, 2)
    triangles = least_area_triangles(points, loop, edges)
    a, b, c = points[triangles].transpose(1, 0, 2)
    total = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    truth = least_area(points[loop], 0, 7, [{i, j} for i, j in pairs])
    assert total == pytest.approx(truth, rel=1e-4)  # equal areas are decided by the shape
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert not (sides[:, None] == np.sort(edges, axis=1)).all(axis=2).any()


def test_a_loop_without_another_triangulation_stays_open():
    edges = np.array([[0, 2], [1, 3]])
    assert least_area_triangles(np.eye(4, 3), np.arange(4), edges) is None
    assert least_area_triangles(np.eye(4, 3), np.arange(4), edges[:1]).tolist() == [[0, 1, 3], [1, 2, 3]]
