"""The common subdivision: exact counts, straight edges, and labels that give both triangulations back."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.common_subdivision import CROSSING, BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.flips import SideArrays, _independent, _violating, flip
from ddgcli.algorithms.delaunay.gluing import around
from ddgcli.algorithms.delaunay.normal_coordinates import base_edges_of, crossings_of, flipped_crossings
from ddgcli.algorithms.delaunay.overlay_lines import in_order
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.geometry.extrinsic import face_area_vector, face_normal
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh import shapes
from tests.delaunay_cases import CASES, rounding

SMALL = [name for name in CASES if name != "fan"]


@pytest.fixture(params=SMALL)
def case(request):
    mesh = CASES[request.param]()
    flipped = flip_to_delaunay(mesh, track=True)
    return mesh, flipped, common_subdivision(flipped, BaseTriangulation.itself(mesh))


def test_a_flip_and_its_undoing():
    one = np.array([-1])
    assert flipped_crossings(one, one, one, one, one) == 1
    assert flipped_crossings(np.array([1]), one, one, one, one) == -1  # the input edge is back
    assert flipped_crossings(np.array([0]), *[np.array([n]) for n in (2, 2, 2, 2)]) == 4


def test_a_batch_of_flips_and_its_undoing_restore_the_coordinates():
    mesh = CASES["stretched"]()
    state = SideArrays.of(mesh.faces, mesh.topology.side_twin, mesh.side_length)
    state.crossings = np.full(3 * mesh.n_faces, -1, dtype=np.int64)

    def edges():
        _, following, _ = around(np.arange(len(state.tail)))
        return np.unique(np.stack([state.tail, state.tail[following], state.crossings]), axis=1)

    for _ in range(5):
        before = edges()
        side, violation = _violating(state, np.arange(3 * mesh.n_faces))
        done = flip(state, side[_independent(state, side, violation)])
        assert not np.array_equal(edges(), before)
        undone = flip(state, around(done)[1], force=True)
        assert np.array_equal(edges(), before)
        flip(state, around(undone)[1])
    assert state.crossings.max() > 2


def test_overlay_is_a_mesh_of_the_same_surface(case):
    mesh, flipped, cut = case
    topology = cut.mesh.topology
    assert topology.is_manifold and topology.is_oriented
    assert topology.euler_characteristic == mesh.topology.euler_characteristic
    crossings = crossings_of(flipped.crossings, flipped.mesh.topology.side_twin)
    assert (cut.vertex_kind == CROSSING).sum() == crossings.total // 2
    assert cut.mesh.n_vertices == mesh.n_vertices + crossings.total // 2
    area = face_area(mesh.side_length)
    loss = max(1e-12, 10 * rounding(mesh))
    assert face_area(cut.mesh.side_length).sum() == pytest.approx(area.sum(), rel=loss)
    along = np.einsum("ij,ij->i", face_area_vector(cut.mesh), face_normal(mesh)[cut.input_face])
    assert (along > -1e-9 * area.max()).all()  # no triangle is turned over


def test_labels_give_both_triangulations_back(case):
    mesh, flipped, cut = case
    area = np.linalg.norm(face_area_vector(cut.mesh), axis=1)
    for label, whole in ((cut.input_face, mesh), (cut.intrinsic_face, flipped.mesh)):
        total = np.bincount(label, area, minlength=whole.n_faces)
        expected = face_area(whole.side_length)
        assert np.abs(total - expected).max() <= max(1e-9, 10 * rounding(mesh)) * expected.max()
        # corners: the vertices of either triangulation that the pieces of a face touch are the face's own
        corner = np.repeat(label, 3), cut.mesh.faces.ravel()
        old = cut.vertex_kind[corner[1]] != CROSSING
        pairs = np.unique(np.stack([corner[0][old], corner[1][old]]), axis=1)
        own = np.stack([np.repeat(np.arange(whole.n_faces), 3), whole.faces.ravel()])
        assert np.array_equal(pairs, np.unique(own, axis=1))


def test_intrinsic_edges_are_straight_and_of_their_length(case):
    mesh, flipped, cut = case
    far = np.abs(mesh.points).max() / mesh.side_length.min() * 2.0**-50
    pieces = [np.linalg.norm(np.diff(c, axis=0), axis=1).sum() for c in cut.curves()]
    topology = flipped.mesh.topology
    length = np.zeros(topology.n_edges)
    length[topology.side_edge] = flipped.mesh.side_length
    assert np.abs(np.array(pieces) / length - 1).max() < max(1e-9, 10 * far)
    assert cut.length_residual < 1e-9


def test_shares_that_rounding_put_out_of_order_are_exchanged(case):
    mesh, flipped, cut = case
    topology = flipped.mesh.topology
    edges = base_edges_of(crossings_of(flipped.crossings, topology.side_twin), topology.side_tail)
    side, share = cut.crossings.labels.crossed, cut.crossings.share
    edge, along_edge = mesh.topology.side_edge.ravel()[side], mesh.topology.side_sign.ravel()[side] > 0
    rough = np.random.default_rng(0).random(len(share))
    ordered = in_order(rough.copy(), edges.label, edges)
    true, rough, ordered = (np.where(along_edge, s, 1 - s) for s in (share, rough, ordered))
    order = np.lexsort((true, edge))
    apart = np.append(np.diff(true[order]) > 1e-12, False)  # ties may go either way
    assert (np.diff(ordered[order])[(apart & (edge[order] == np.roll(edge[order], -1)))[:-1]] >= 0).all()
    assert np.array_equal(ordered[np.lexsort((ordered, edge))], rough[np.lexsort((rough, edge))])


def test_linear_functions_are_transferred_exactly(case):
    mesh, _, cut = case
    assert np.abs(cut.from_input @ mesh.points - cut.mesh.points).max() <= 1e-14 * np.abs(mesh.points).max()
    ones = np.ones(mesh.n_vertices)
    assert np.abs(cut.from_intrinsic @ ones - 1).max() < 1e-14


def test_interpolants_over_the_intrinsic_triangulation_are_linear_along_its_edges():
    mesh = CASES["planar"]()
    cut = common_subdivision(flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh))
    # in the plane the vertices are where the intrinsic interpolation of the positions places them
    assert np.abs(cut.from_intrinsic @ mesh.points - cut.mesh.points).max() < 1e-12


def test_input_that_is_delaunay_is_its_own_overlay():
    mesh = shapes.icosphere(2)
    cut = common_subdivision(flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh))
    assert np.array_equal(np.sort(cut.input_face), np.arange(mesh.n_faces))
    assert np.array_equal(cut.input_face, cut.intrinsic_face)
