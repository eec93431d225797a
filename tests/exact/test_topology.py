"""Twins and fans of faces against plain searches."""

import numpy as np
import pytest

from ddgcli.mesh import shapes, topology
from ddgcli.mesh.ragged import sorted_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.exact.test_curvature_balls import MESHES


def from_faces(*faces):
    faces = np.array(faces)
    return TriangleMesh.from_arrays(np.random.default_rng(0).random((faces.max() + 1, 3)), faces)


def pinched_torus():
    """Two vertices of a closed surface are one: a closed fan with another."""
    mesh = shapes.torus(12, 8)
    return TriangleMesh.from_arrays(mesh.points, np.where(mesh.faces == 50, 3, mesh.faces))


CASES = MESHES | {
    "bow tie": lambda: from_faces([0, 1, 2], [2, 3, 4]),
    "pinched": pinched_torus,
    "repeated vertex": lambda: from_faces([0, 1, 2], [6, 6, 7], [0, 3, 4], [0, 4, 5]),
    "one-sided": lambda: from_faces([0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 0], [4, 0, 1]),
    "no face": lambda: TriangleMesh.from_arrays(np.zeros((3, 3)), np.zeros((0, 3), dtype=int)),
}


def fans_by_search(mesh):
    """Lists of corners that shared edges join around a vertex, in the order of their lowest corners."""
    vertex, ends = mesh.faces.ravel(), [set(map(int, face)) for face in np.repeat(mesh.faces, 3, axis=0)]
    remaining, fans = list(range(len(vertex))), []
    while remaining:
        fan, new = [], [remaining[0]]
        while new:
            corner = new.pop()
            remaining.remove(corner)
            fan.append(corner)
            joined = {
                k for k in remaining if vertex[k] == vertex[corner] and len(ends[k] & ends[corner]) >= 2
            }
            new += sorted(joined - set(new))
        fans.append(sorted(fan))
    return fans


@pytest.mark.parametrize("name", CASES)
def test_fans_are_those_of_a_search(name):
    mesh = CASES[name]()
    expected = np.zeros(3 * mesh.n_faces, dtype=int)
    fans = fans_by_search(mesh)
    for number, fan in enumerate(fans):
        expected[fan] = number
    assert np.array_equal(mesh.topology.corner_fans.ravel(), expected)
    vertex = [int(mesh.faces.ravel()[fan[0]]) for fan in fans]
    several = [v for v in range(mesh.n_vertices) if vertex.count(v) > 1]
    assert mesh.topology.nonmanifold_vertices.tolist() == several


def test_fans_do_not_depend_on_how_they_are_computed(monkeypatch):
    mesh = shapes.random_sphere(300)
    rotated = TriangleMesh.from_arrays(mesh.points, mesh.faces).topology.corner_fans
    monkeypatch.setattr(topology, "MAX_ROTATION_STEPS", 3)
    assert np.array_equal(TriangleMesh.from_arrays(mesh.points, mesh.faces).topology.corner_fans, rotated)


@pytest.mark.parametrize("name", CASES)
def test_twins_are_the_sides_of_edges_with_two_faces(name):
    mesh = CASES[name]()
    side = np.sort(np.stack([mesh.topology.side_tail, mesh.topology.side_head], axis=1), axis=1)
    for k, twin in enumerate(mesh.topology.side_twin.ravel()):
        same = np.flatnonzero((side == side[k]).all(axis=1))
        assert twin == (same[same != k][0] if len(same) == 2 else -1)


def test_numbers_of_a_mesh_whose_products_exceed_32_bits_are_those_of_its_small_copy():
    """Edge keys are products of vertex indices: 60,000 squared is above 2^31."""
    small = shapes.random_sphere(60).topology
    spread = topology.Topology(small.faces * 1000 + 7, 60_008)
    assert np.array_equal(spread.edges, small.edges * 1000 + 7)
    for name in ("side_edge", "side_sign", "side_twin", "edge_face_count", "interior_sides"):
        assert np.array_equal(getattr(spread, name), getattr(small, name)), name
    assert spread.genus == 0 and spread.is_manifold and spread.n_components == 1


@pytest.mark.parametrize("n_keys", [5, 2**62])
def test_sorted_keys_are_ascending_and_their_order_is_stable(n_keys):
    key = np.random.default_rng(0).integers(0, 5, 1000)
    ordered, order = sorted_keys(key, n_keys)
    assert np.array_equal(order, np.argsort(key, kind="stable")) and np.array_equal(ordered, key[order])
