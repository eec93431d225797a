"""Repair of flat tetrahedra: the others fill the same body, with the same boundary, without gaps."""

import itertools

import numpy as np
import pytest

from ddgcli.algorithms.hodge.homology import betti_numbers
from ddgcli.algorithms.inspection.quality import tetrahedra_quality
from ddgcli.algorithms.repair.pipeline import RepairSteps
from ddgcli.algorithms.repair.solid import repair_solid
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.geometry.remedies import warn_of_solid
from ddgcli.mesh.requirements import unmet_need
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh

DROP = RepairSteps(drop_degenerate=True)


def mirrored_cubes(n, seed):
    """Cubes of six tetrahedra round one of four diagonals; flat cells where diagonals of squares differ.

    Some squares of the boundary have a flat cell on them too.
    """
    rng = np.random.default_rng(seed)
    points = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells, diagonals = [], {}
    for corner in itertools.product(range(n), repeat=3):
        mirror = rng.integers(0, 2, 3)
        for order in itertools.permutations(range(3)):
            path = np.zeros((4, 3), dtype=int)
            for step, axis in enumerate(order):
                path[step + 1] = path[step]
                path[step + 1, axis] = 1
            place = corner + (path ^ mirror)
            cells.append(place @ [(n + 1) ** 2, n + 1, 1])
    for face in np.array(cells)[:, TET_FACES].reshape(-1, 3):
        p = points[face]
        axis = np.flatnonzero(np.ptp(p, axis=0) == 0)
        if len(axis):
            low = tuple(p.min(axis=0).tolist())
            size = [np.abs(p[i] - p[j]).sum() for i, j in ((0, 1), (0, 2), (1, 2))]
            ends = np.delete(face, 2 - np.argmax(size))
            diagonals.setdefault((int(axis[0]), low), set()).add(tuple(sorted(ends.tolist())))
    for (axis, low), ends in diagonals.items():
        is_outer = low[axis] in (0, n)
        if len(ends) == 2 or (is_outer and rng.random() < 0.3):
            steps = np.insert(list(itertools.product((0, 1), repeat=2)), axis, 0, axis=1)
            cells.append((np.array(low) + steps) @ [(n + 1) ** 2, n + 1, 1])
    return points.astype(float), np.array(cells)


def sliver_in_octahedron():
    """A flat cell of the equator of an octahedron, whose halves have different diagonals."""
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1.0], [0, 0, -1]])
    return points, np.array([[0, 1, 2, 4], [0, 2, 3, 4], [0, 1, 3, 5], [1, 2, 3, 5], [0, 1, 2, 3]])


def assert_same_body(mesh, before):
    assert len(mesh.flat_tetrahedra) == 0 and len(mesh.duplicate_tetrahedra) == 0
    volumes = [np.abs(body.signed_volume).sum() for body in (mesh, before)]
    assert np.isclose(*volumes, rtol=1e-7, atol=0)
    facts = tetrahedra_quality(mesh)
    assert facts["flat_gaps"] == facts["crack_faces"] == facts["folded_faces"] == 0
    assert mesh.boundary.topology.is_manifold and mesh.boundary.topology.euler_characteristic == 2
    assert betti_numbers(mesh).absolute == (1, 0, 0, 0)
    used = len(np.unique(mesh.tetrahedra))
    assert used - len(mesh.edges) + len(mesh.triangles) - len(mesh.tetrahedra) == 1


@pytest.mark.parametrize("seed", range(3))
def test_flat_cells_between_cubes_and_on_their_boundary_leave_a_cube(seed):
    points, cells = mirrored_cubes(3, seed)
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    number = rng.permutation(len(points))
    cells = number[cells[rng.permutation(len(cells))][:, rng.permutation(4)]]
    before = TetMesh.from_arrays((points @ turn)[np.argsort(number)], cells)
    assert len(before.flat_tetrahedra) > 20
    repaired = repair_solid(before, DROP)
    mesh = repaired.mesh
    assert repaired.changes == {"drop_degenerate": len(before.flat_tetrahedra)}
    assert_same_body(mesh, before)
    sides = face_area_vector(mesh.boundary) @ turn.T  # of each face of the cube: its area, in one direction
    assert np.allclose([sides.clip(0).sum(axis=0), -sides.clip(None, 0).sum(axis=0)], 9)
    assert np.allclose(np.sort(np.abs(sides), axis=1)[:, :2], 0, atol=1e-12)
    again = repair_solid(mesh, DROP)
    assert again.changes == {"drop_degenerate": 0} and np.array_equal(again.mesh.tetrahedra, mesh.tetrahedra)


def test_a_missing_flat_cell_leaves_a_gap_that_is_closed(caplog):
    """The body between the sides of the gap was hollow: Betti numbers [1, 0, 1, 0]."""
    points, cells = sliver_in_octahedron()
    shell = np.concatenate([points, 3 * points])
    faces = TetMesh.from_arrays(points, cells[:4]).boundary.faces
    faces = faces[~(faces < 4).all(axis=1)]
    prism = np.concatenate([[[*f, f[2] + 6], [f[0], f[1], f[1] + 6, f[2] + 6], [f[0], *(f + 6)]]
                            for f in np.sort(faces, axis=1)])  # fmt: skip
    whole = TetMesh.from_arrays(shell, np.concatenate([cells, prism]))
    hollow = TetMesh.from_arrays(shell, np.concatenate([cells[:4], prism]))
    assert betti_numbers(hollow).absolute == (1, 0, 1, 0)
    warn_of_solid(hollow)
    assert "1 flat gap between boundary faces" in caplog.text and "drop_degenerate" in caplog.text
    assert tetrahedra_quality(hollow)["flat_gaps"] == 1
    for body in (whole, hollow):
        repaired = repair_solid(body, DROP)
        assert repaired.changes == {"drop_degenerate": 1}
        assert_same_body(repaired.mesh, body)
        assert np.array_equal(repaired.mesh.boundary.faces[:, 0] >= 6, np.ones(8, dtype=bool))


def test_new_cells_come_from_the_nearest_of_those_that_they_replace():
    points, cells = sliver_in_octahedron()
    repaired = repair_solid(TetMesh.from_arrays(points, cells), DROP)
    assert len(repaired.mesh.tetrahedra) == 4 and np.array_equal(repaired.input_vertex, np.arange(6))
    upper = (repaired.mesh.tetrahedra == 4).any(axis=1)
    assert np.array_equal(np.isin(repaired.input_cell, [0, 1]), upper) and (repaired.input_cell < 4).all()


def test_a_vertex_just_inside_a_boundary_face_comes_to_lie_on_the_boundary():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0], [0.2, 0.2, 1e-9]])
    sides = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    before = TetMesh.from_arrays(points, np.column_stack([sides, np.full(4, 4)]))
    assert len(before.flat_tetrahedra) == 1
    repaired = repair_solid(before, DROP)
    assert_same_body(repaired.mesh, before)
    assert repaired.mesh.boundary.n_faces == 6 and np.array_equal(repaired.input_cell, [0, 1, 2])


def test_vertices_at_one_place_merge_where_no_flip_removes_the_cells_between_them():
    ring = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    points = np.array([*ring, [0, 0, 1], [0, 0, -1], [0, 0, 0], [0, 0, 0]], dtype=float)
    cells = [[a, b, *ends] for ends in ((4, 6), (6, 7), (7, 5)) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    before = TetMesh.from_arrays(points, np.array(cells))
    assert len(before.flat_tetrahedra) == 4
    repaired = repair_solid(before, DROP)
    assert_same_body(repaired.mesh, before)
    assert repaired.changes == {"drop_degenerate": 4} and len(repaired.mesh.tetrahedra) == 8
    assert (
        np.array_equal(repaired.mesh.points, points[repaired.input_vertex])
        and len(repaired.input_vertex) == 7
    )


def test_a_flat_cell_that_cannot_be_removed_is_left_and_no_repair_is_named(caplog):
    """On each of its sides stands a cell of its own: no other cells fill the same body."""
    square = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    tips = [[0.3, 0.3, 1], [-0.3, -0.3, 1], [0.3, -0.3, -1], [-0.3, 0.3, -1]]
    cells = [[0, 1, 2, 3], [0, 1, 2, 4], [0, 2, 3, 5], [0, 1, 3, 6], [1, 2, 3, 7]]
    mesh = TetMesh.from_arrays(np.array(square + tips, dtype=float), np.array(cells))
    repaired = repair_solid(mesh, DROP)
    assert repaired.changes == {"drop_degenerate": 0} and np.array_equal(repaired.mesh.tetrahedra, cells)
    assert "1 flat cell is left (first: tetrahedron 0)" in caplog.text
    for command in ("laplacian", "dec", "hodge", "fluid-sim"):
        message = unmet_need(repaired.mesh, command)
        assert "1 tetrahedron is flat, with a volume of at most 2e-08 of" in message
        assert "no repair removes 1 of them" in message and "drop_degenerate" not in message
