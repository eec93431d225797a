"""The intrinsic Delaunay triangulation: what must hold after flips, against scipy and libigl."""

import tracemalloc

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

from ddgcli.algorithms.curvature.measures import angle_defect
from ddgcli.algorithms.delaunay.flips import SideArrays, flip, flip_until_delaunay
from ddgcli.algorithms.delaunay.triangulation import (
    flip_to_delaunay,
    glue,
    negative_cotan_edges,
    non_delaunay_edges,
    unglue,
)
from ddgcli.algorithms.geodesics.distance import measure_distance
from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area, half_angle_tangent, triangle_excess
from ddgcli.linalg.condition import condition_number
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import stiffness
from tests.delaunay_cases import CASES, planar, rounding, sharp_cone, stretched


@pytest.fixture(params=CASES)
def mesh(request):
    return CASES[request.param]()


def test_no_edge_is_left_and_the_metric_stays(mesh):
    flipped = flip_to_delaunay(mesh)
    after = flipped.mesh
    assert flipped.flips > 0
    assert not non_delaunay_edges(after).any()
    assert (after.side_length > 0).all() and np.isfinite(after.side_length).all()
    assert (after.n_vertices, after.topology.n_edges, after.n_faces) == (
        mesh.n_vertices,
        mesh.topology.n_edges,
        mesh.n_faces,
    )
    area = face_area(mesh.side_length)
    assert face_area(after.side_length).sum() == pytest.approx(area.sum(), rel=max(1e-12, rounding(mesh)))
    aspect = (mesh.side_length.max(axis=1) ** 2 / area).max()
    change = angle_defect(after) - angle_defect(glue(mesh))
    assert np.abs(change).max() < 1e-12 * max(aspect, 10.0)
    assert len(after.topology.boundary_edges) == len(mesh.topology.boundary_edges)


def test_unflipped_edges_are_edges_of_the_triangulation(mesh):
    """Both sides of an edge stay or go; what stays joins the same vertices at the same length."""
    flipped = flip_to_delaunay(mesh, list_flipped=True)
    before, after = mesh.topology, flipped.mesh.topology
    assert 0 < len(flipped.flipped_sides) <= 2 * flipped.flips
    stays = np.ones(3 * mesh.n_faces, dtype=bool)
    stays[flipped.flipped_sides] = False
    edge_stays = np.zeros(before.n_edges, dtype=bool)
    edge_stays[before.side_edge.ravel()[stays]] = True
    assert not edge_stays[before.side_edge.ravel()[flipped.flipped_sides]].any()

    def described(topology, length, rows):
        low, high = np.sort(topology.edges, axis=1)[topology.side_edge.ravel()[rows]].T
        return set(zip(low.tolist(), high.tolist(), length.ravel()[rows].tolist()))

    begun = flipped.mollification.length.astype(float)  # what the flips began with
    flipped_edges = described(after, flipped.mesh.side_length, np.arange(3 * mesh.n_faces))
    assert described(before, begun, np.flatnonzero(stays)) <= flipped_edges
    assert not described(before, begun, flipped.flipped_sides) & flipped_edges


@pytest.mark.parametrize("name", [name for name in CASES if name != "fan"])
def test_matrix_is_that_of_libigl(name):
    igl = pytest.importorskip("igl")
    mesh = CASES[name]()
    after = flip_to_delaunay(mesh).mesh
    ours = stiffness(after)
    theirs = igl.intrinsic_delaunay_cotmatrix(mesh.points, mesh.faces)
    theirs = -(theirs[0] if isinstance(theirs, tuple) else theirs)
    floor = 10 * max(rounding(mesh), rounding(after))
    assert abs(ours - theirs).max() <= max(1e-9, floor) * abs(theirs).max()


@pytest.mark.parametrize("name", ["fan", "stretched"])
def test_lengths_are_those_of_extended_precision(name):
    """On the fan libigl's matrix is off by 1e-8; ours must not be."""
    mesh = CASES[name]()
    state = SideArrays.of(mesh.faces, mesh.topology.side_twin, mesh.side_length.astype(np.longdouble))
    flip_until_delaunay(state)
    ours = flip_to_delaunay(mesh).mesh
    assert np.array_equal(ours.faces.ravel(), state.tail)
    length = state.length.reshape(-1, 3)
    assert np.abs(ours.side_length / length - 1).max() < 1e-13
    loss = 2.0**-53 * (length.max(axis=1) / triangle_excess(length).min(axis=1)).max()
    t, true = half_angle_tangent(ours.side_length), half_angle_tangent(length)
    assert np.abs(t / true - 1).max() < 1e-14 + 100 * float(loss)


@pytest.mark.parametrize("seed", range(3))
def test_planar_points_give_the_planar_triangulation(seed):
    from scipy.spatial import Delaunay

    mesh = planar(seed)
    ours = flip_to_delaunay(mesh).mesh.faces
    full = Delaunay(mesh.points[:, :2]).simplices

    def inner(faces):
        return {tuple(sorted(f)) for f in faces}

    # the squeezed copy's hull is the same hull, so the triangulations are of the same region
    assert inner(ours) == inner(full)


def test_delaunay_input_is_left_alone():
    assert flip_to_delaunay(shapes.icosphere(3)).flips == 0
    assert flip_to_delaunay(shapes.grid(20, 20)).flips == 0  # co-circular everywhere: no tie is flipped
    mesh = shapes.grid(20, 20)
    assert flip_to_delaunay(mesh.moved(mesh.points + 1e6)).flips <= 400  # noise decides ties, but it ends


def test_random_flips_are_undone():
    mesh = flip_to_delaunay(shapes.random_sphere(300, seed=4)).mesh
    state = SideArrays.of(mesh.faces, mesh.topology.side_twin, mesh.side_length)
    rng = np.random.default_rng(0)
    done = 0
    for side in rng.integers(0, 3 * mesh.n_faces, 400):
        twin = state.twin[side]
        angles = 2 * np.arctan(state.tangent)
        faces = np.arange(3) + 3 * np.array([[side // 3], [twin // 3]])
        i = angles[faces[0][(side + 1) % 3]] + angles[faces[1][(twin + 2) % 3]]
        j = angles[faces[0][(side + 2) % 3]] + angles[faces[1][(twin + 1) % 3]]
        if max(i, j) < 3.0:  # the quadrilateral is convex
            done += len(flip(state, np.array([side]), force=True))
    assert done > 50
    scrambled = unglue(state, mesh, 1.0)
    assert non_delaunay_edges(scrambled).sum() > 20
    back = flip_to_delaunay(scrambled).mesh
    assert np.sort(back.side_length.ravel()) == pytest.approx(np.sort(mesh.side_length.ravel()), rel=1e-11)
    assert abs(stiffness(back) - stiffness(mesh)).max() < 1e-10


def test_dirichlet_energy_never_rises():
    mesh = stretched()
    values = np.random.default_rng(0).normal(size=(mesh.n_vertices, 4))
    energies = [
        np.einsum("ik,ik->k", values, stiffness(flip_to_delaunay(mesh, max_rounds=r).mesh) @ values)
        for r in range(12)
    ]
    assert (np.diff(energies, axis=0) <= 1e-12 * np.abs(energies[0])).all()
    assert energies[-1].sum() < 0.9 * energies[0].sum()


def two_spheres_and_a_lone_vertex():
    one, two = shapes.random_sphere(60, seed=2), shapes.icosphere(1)
    points = np.concatenate([one.points * [3.0, 1, 0.5], two.points + 9, [[0, 0, 0]]])
    return TriangleMesh.from_arrays(points, np.concatenate([one.faces, two.faces + one.n_vertices]))


@pytest.mark.parametrize("make", [stretched, planar, two_spheres_and_a_lone_vertex])
def test_condition_is_that_of_the_whole_matrix(make):
    mesh = make()
    matrix, referenced = stiffness(mesh), mesh.topology.referenced_vertex
    values = np.linalg.eigvalsh(matrix.toarray()[referenced][:, referenced])
    components = mesh.topology.n_components
    assert condition_number(matrix) == pytest.approx(values[-1] / values[components], rel=1e-6)


def test_condition_of_many_parts_is_that_of_one():
    """The dense null space of 20,000 components would need 24 GiB."""
    one = shapes.random_sphere(30, seed=1)
    copies = 5000
    points = np.tile(one.points, (copies, 1))
    faces = (one.faces + one.n_vertices * np.arange(copies)[:, None, None]).reshape(-1, 3)
    many = TriangleMesh.from_arrays(points, faces)
    tracemalloc.start()
    computed = condition_number(stiffness(many))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert computed == pytest.approx(condition_number(stiffness(one)), rel=1e-9)
    assert peak < 3e8


def test_condition_of_a_dense_upper_end():
    """A cylinder of needles: the largest eigenvalues differ by 1e-5 of themselves."""
    k = 600
    matrix = stiffness(shapes.cylinder(k, 1))
    values = np.linalg.eigvalsh(matrix.toarray()[: 2 * k, : 2 * k])
    assert condition_number(matrix) == pytest.approx(values[-1] / values[1], rel=1e-5)


def test_glued_complexes_are_accepted():
    # two isosceles triangles, glued to a sphere with one vertex of degree one: a self-edge at the base
    faces = np.array([[0, 1, 2], [1, 0, 2]])
    gluing = np.array([[3, 5, 4], [0, 2, 1]])
    length = np.array([[1.0, 4.0, 4.0], [1.0, 4.0, 4.0]])
    closed = IntrinsicMesh(Topology(faces, 3, gluing), length)
    flipped = flip_to_delaunay(closed)
    assert flipped.flips == 0 and not non_delaunay_edges(flipped.mesh).any()
    after = flip_to_delaunay(sharp_cone()).mesh
    assert not non_delaunay_edges(after).any()
    assert (after.topology.edges[:, 0] == after.topology.edges[:, 1]).sum() == 1
    assert flip_to_delaunay(after).flips == 0


def test_laplacian_and_geodesic_use_this_triangulation():
    mesh = stretched()
    flipped = flip_to_delaunay(mesh).mesh
    assert (laplace_operator(mesh).stiffness != stiffness(flipped)).nnz == 0
    solver = HeatSolver(flipped, source_mesh=mesh)
    expected = solver.distance(Sources.at([3])).distance
    assert np.array_equal(measure_distance(mesh, Sources.at([3]), "heat").distance, expected)


def test_refusals_name_the_place():
    book = TriangleMesh.from_arrays(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]),
        np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    )
    with pytest.raises(MeshError, match="more than two faces.*0-1"):
        flip_to_delaunay(book)
    turned = TriangleMesh.from_arrays(book.points, np.array([[0, 1, 2], [0, 1, 3]]))
    with pytest.raises(MeshError, match="opposite orientation"):
        flip_to_delaunay(turned)
    wrong = IntrinsicMesh(Topology(np.array([[0, 1, 2]]), 3), np.array([[1.0, np.nan, 1.0]]))
    with pytest.raises(MeshError, match="face 0"):
        flip_to_delaunay(wrong)


@hypothesis.settings(max_examples=40, deadline=None)
@hypothesis.given(seed=st.integers(0, 2**32 - 1), spread=st.floats(0.0, 8.0), none=st.floats(0.0, 0.1))
def test_any_lengths_end_in_lengths(seed, spread, none):
    """Lengths drawn at random break the triangle inequality nearly everywhere, or are zero."""
    rng = np.random.default_rng(seed)
    topology = shapes.icosphere(1).topology
    edge = np.exp(spread * rng.normal(size=topology.n_edges)) * (rng.random(topology.n_edges) >= none)
    edge[topology.side_edge[0]] = edge.max() or 1.0  # one face with an area
    flipped = flip_to_delaunay(IntrinsicMesh(topology, edge[topology.side_edge]))
    length = flipped.mesh.side_length
    assert np.isfinite(length).all() and (length > 0).all()
    assert non_delaunay_edges(flipped.mesh).sum() == flipped.remaining_edges
    assert flipped.mesh.topology.euler_characteristic == 2
    assert (length[:, [1, 2, 0]] + length[:, [2, 0, 1]] >= length * (1 - 1e-15)).all()


def test_flat_triangles_are_mollified_with_a_warning(caplog):
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0.0], [1, -1, 0]])
    faces = np.array([[0, 1, 3], [1, 2, 3], [0, 2, 1], [2, 0, 4]])  # face 2 is flat
    flipped = flip_to_delaunay(TriangleMesh.from_arrays(points, faces))
    assert list(flipped.mollification.faces) == [2] and 0 < flipped.mollification.largest_change < 1e-9
    assert any("mollified" in note for note in flipped.notes) and "mollified" in caplog.text
    assert np.isfinite(flipped.mesh.side_length).all() and (flipped.mesh.side_length > 0).all()
    assert not non_delaunay_edges(flipped.mesh).any()
    assert negative_cotan_edges(flipped.mesh) <= 1
