"""`split_edges` closes slits: boundary edges are divided at the vertices on them, and nothing moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ddgcli.algorithms.inspection.quality import surface_defects
from ddgcli.algorithms.repair.pipeline import RepairSteps, repair_mesh
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.t_junctions import t_junctions
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def with_slits(mesh, seed, share=0.3, most=3):
    """The mesh with points on some sides that the faces across do not have, and their number."""
    rng = np.random.default_rng(seed)
    points, faces, n_slits = list(mesh.points), [], 0
    for face in mesh.faces:
        ring = []
        for k in range(3):
            tail, head = face[k], face[(k + 1) % 3]
            ring.append(tail)
            if k == 0 and rng.random() < share:
                count = rng.integers(1, most + 1)
                n_slits += count
                for t in (np.arange(count) + rng.uniform(0.3, 0.7, count)) / count:
                    ring.append(len(points))
                    points.append((1 - t) * mesh.points[tail] + t * mesh.points[head])
        apex = ring.pop()
        faces += [(a, b, apex) for a, b in zip(ring, ring[1:])]
    return TriangleMesh.from_arrays(np.array(points), np.array(faces)), n_slits


@given(seed=st.integers(0, 10**6), size=st.sampled_from([1e-200, 1e-9, 1.0, 1e9, 1e200]))
def test_a_surface_with_slits_is_closed_again_and_nothing_moves(seed, size):
    turn = Rotation.random(random_state=seed)
    mesh, n_slits = with_slits(shapes.icosphere(1), seed)
    mesh = mesh.moved(size * turn.apply(mesh.points + [2.0, 0, 0]))
    repaired, changes = repair_mesh(mesh, RepairSteps(split_edges=0.0))
    topology = repaired.mesh.topology
    assert changes == {"split_edges": n_slits}
    assert topology.is_closed and topology.is_manifold and topology.is_oriented
    assert np.array_equal(repaired.mesh.points, mesh.points)
    before, after = (body.moved(body.points / size) for body in (mesh, repaired.mesh))
    child_area = face_area(after.side_length)
    assert (child_area > 0).all()
    area = np.bincount(repaired.input_face, weights=child_area, minlength=mesh.n_faces)
    assert np.allclose(area, face_area(before.side_length), rtol=1e-9)
    assert np.isclose(enclosed_volume(after), enclosed_volume(shapes.icosphere(1)), rtol=1e-9)


def test_slits_in_coordinates_of_single_precision_are_closed():
    mesh, n_slits = with_slits(shapes.torus(12, 8), 3)
    points = Rotation.random(random_state=5).apply(mesh.points.copy()).astype(np.float32)
    repaired, changes = repair_mesh(mesh.moved(points.astype(float)), RepairSteps(split_edges=0.0))
    assert changes["split_edges"] == n_slits and repaired.mesh.topology.is_closed


def two_grids(coarse, fine, shift, offset):
    """Two grids of the unit square, the second one shifted, and both far from the origin."""
    squares = []
    for n in (coarse, fine):
        square = shapes.grid(n, n)
        squares.append(square.points / np.ptp(square.points, axis=0).max())
    points = np.concatenate([squares[0], squares[1] + shift]) + offset
    faces = [shapes.grid(coarse, coarse).faces, shapes.grid(fine, fine).faces + len(squares[0])]
    return TriangleMesh.from_arrays(points, np.concatenate(faces))


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e4, 1e5, 0), (1e5, 5e5, -1e3)])
@pytest.mark.parametrize("single", [False, True])
def test_the_distance_of_the_origin_changes_no_slit(offset, single):
    """Far from the origin sheets were joined, and slits missed: the tolerance grew with the coordinates."""
    beside = two_grids(4, 16, [1.0, 0, 0], offset)
    above = two_grids(4, 5, [0, 0, 0.0078125], offset)
    for mesh, slits in ((beside, 12), (above, 0)):
        if single:  # a sixteenth is a number of single precision at each of these places
            mesh = mesh.moved((16 * mesh.points).astype(np.float32).astype(float))
        assert len(t_junctions(mesh)[1]) == slits
        for tilt in [] if single else [Rotation.from_euler("xyz", [0.3, -0.4, 0.9])]:
            turned = mesh.moved(tilt.apply(mesh.points.copy()))
            assert len(t_junctions(turned)[1]) == slits


def test_a_large_body_elsewhere_joins_no_sheets():
    sheets, body = two_grids(4, 5, [0, 0, 0.0075], 0.0), shapes.icosphere(2, 1e5)
    points = np.concatenate([sheets.points, body.points + [2e5, 0, 0]])
    mesh = TriangleMesh.from_arrays(points, np.concatenate([sheets.faces, body.faces + sheets.n_vertices]))
    _, changes = repair_mesh(mesh, RepairSteps(split_edges=0.0))
    assert changes == {"split_edges": 0}


def test_slits_of_single_precision_far_from_the_origin_are_closed():
    mesh, n_slits = with_slits(shapes.torus(12, 8), 3)
    turned = Rotation.random(random_state=5).apply(40 * mesh.points) + [3e4, -1e5, 2e3]
    repaired, changes = repair_mesh(
        mesh.moved(turned.astype(np.float32).astype(float)), RepairSteps(split_edges=0.0)
    )
    assert changes["split_edges"] == n_slits and repaired.mesh.topology.is_closed


def test_both_sides_of_a_seam_get_the_vertices_of_the_other():
    """Two sheets with other vertices along their common line, each with vertices of its own."""
    left = shapes.grid(1, 5)
    right = shapes.grid(1, 7)
    width = np.ptp(left.points, axis=0)[:2]
    left = left.points / [*width, 1]
    right = right.points / [*np.ptp(right.points, axis=0)[:2], 1] + [1, 0, 0]
    faces = [shapes.grid(1, 5).faces, shapes.grid(1, 7).faces + len(left)]
    mesh = TriangleMesh.from_arrays(np.concatenate([left, right]), np.concatenate(faces))
    repaired, changes = repair_mesh(mesh, RepairSteps(weld=1e-9, split_edges=0.0, drop_unused=True))
    topology = repaired.mesh.topology
    assert changes == {"weld": 2, "split_edges": 4 + 6, "drop_unused": 0}
    assert (topology.n_components, topology.boundary_loops, topology.is_manifold) == (1, 1, True)
    assert np.isclose(face_area(repaired.mesh.side_length).sum(), 2.0)


def test_a_face_is_divided_at_all_three_of_its_sides():
    corners = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0], [0.25, 0, 0], [0.5, 0, 0], [0, 0.5, 0]]
    )
    below = np.array([[0.3, -1.0, 0], [1, 1, 0], [-1, 0.5, 0]])
    faces = [[0, 1, 2], [4, 0, 7], [5, 4, 7], [1, 5, 7], [3, 1, 8], [2, 3, 8], [6, 2, 9], [0, 6, 9]]
    mesh = TriangleMesh.from_arrays(np.concatenate([corners, below]), np.array(faces))
    repaired, changes = repair_mesh(mesh, RepairSteps(split_edges=0.0))
    assert changes == {"split_edges": 4}
    assert np.bincount(repaired.input_face).tolist() == [5, 1, 1, 1, 1, 1, 1, 1]
    topology = repaired.mesh.topology
    assert topology.is_manifold and topology.is_oriented and len(topology.boundary_edges) == 6
    assert np.isclose(face_area(repaired.mesh.side_length).sum(), face_area(mesh.side_length).sum())


def test_faces_without_area_are_removed_without_a_slit():
    """Three vertices on one line: a face of them closes a T-junction, and its removal opens it."""
    mesh, n_slits = with_slits(shapes.icosphere(1), 7, most=1)
    caps = []
    for v in range(shapes.icosphere(1).n_vertices, mesh.n_vertices):
        near = mesh.faces[(mesh.faces == v).any(axis=1)]
        first, second = near[0], near[1]
        caps.append([second[1], v, first[0]] if first[1] == v else [first[1], v, second[0]])
    closed = TriangleMesh.from_arrays(mesh.points, np.concatenate([mesh.faces, caps]))
    assert closed.topology.is_closed
    slit, _ = repair_mesh(closed, RepairSteps(drop_degenerate=True))
    assert not slit.mesh.topology.is_closed
    whole, changes = repair_mesh(closed, RepairSteps(drop_degenerate=True, split_edges=0.0))
    assert changes == {"drop_degenerate": len(caps), "split_edges": n_slits}
    assert whole.mesh.topology.is_closed and whole.mesh.topology.is_manifold


@pytest.mark.parametrize(("distance", "count"), [(0.0, 0), (1e-3, 0), (1e-2, 1)])
def test_the_distance_of_a_vertex_from_an_edge_decides(distance, count):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, -5e-3, 0], [0, -1, 0], [1, -1, 0]], dtype=float)
    mesh = TriangleMesh.from_arrays(points, [[0, 1, 2], [0, 4, 3], [3, 5, 1]])
    _, changes = repair_mesh(mesh, RepairSteps(split_edges=distance))
    assert changes == {"split_edges": count}


def test_an_inspection_counts_the_slits_that_the_repair_closes():
    mesh, _ = with_slits(shapes.icosphere(1), 11)
    corners = np.arange(3 * mesh.n_faces).reshape(-1, 3)
    separate = TriangleMesh.from_arrays(mesh.points[mesh.faces.ravel()], corners)
    first = np.unique(mesh.faces, return_index=True)[1]
    for shown, slits in ((mesh, np.arange(42, mesh.n_vertices)), (separate, np.sort(first[42:]))):
        defects = surface_defects(shown)
        assert defects["t_junctions"] == len(slits)
        assert set(defects["t_junctions_first"]) <= set(slits.tolist())
        repaired, _ = repair_mesh(shown, RepairSteps(weld=0.0, split_edges=0.0))
        assert surface_defects(repaired.mesh)["t_junctions"] == 0


def test_closed_surfaces_and_edges_without_vertices_on_them_stay():
    for mesh in (shapes.icosphere(2), shapes.grid(4, 3), shapes.catenoid(12, 5)):
        repaired, changes = repair_mesh(mesh, RepairSteps(split_edges=0.0))
        assert changes == {"split_edges": 0} and np.array_equal(repaired.mesh.faces, mesh.faces)
