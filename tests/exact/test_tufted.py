"""The tufted cover is a closed oriented double; its Laplacian has no negative weight on any soup."""

import numpy as np
import pytest

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator, negative_weights
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.tufted import tufted_cover

HARD = ["gen_book_edge.ply", "gen_moebius_tri.off", "gen_klein_bottle.obj", "test_nm.obj", "soup.stl",
        "triple_vierbein.obj", "gen_flipped_random.stl", "gen_bowtie_vertex.obj", "gen_duplicate_faces.off",
        "platonic_shelf.obj", "gen_repeated_index.obj", "gen_zero_area.off", "gen_t_junction.obj",
        "gen_random_holes.off", "openscad-nonmanifold-crash.obj", "wallhole.obj"]  # fmt: skip


def fan_of_pages(angles):
    """Pages of one book, hinged on the z axis, in the given order and with alternating orientation."""
    points = [[0.0, 0, 0], [0, 0, 1]] + [[np.cos(a), np.sin(a), 0.5] for a in angles]
    faces = [[0, 1, 2 + i] if i % 2 else [1, 0, 2 + i] for i in range(len(angles))]
    return TriangleMesh.from_arrays(np.array(points), np.array(faces))


PAGES = np.array([0.1, 2.0, 1.0, 4.0, 3.0, 5.5])


@pytest.mark.parametrize("mesh", [shapes.icosphere(1), shapes.grid(3, 4), fan_of_pages(PAGES)])
def test_cover_is_closed_and_oriented(mesh):
    cover = tufted_cover(mesh)
    twin = cover.topology.side_twin.ravel()
    side = np.arange(len(twin))
    assert (twin >= 0).all() and (twin[twin] == side).all() and (twin != side).all()
    assert np.array_equal(cover.topology.side_tail, cover.topology.side_head[twin])
    length = cover.side_length.ravel()
    assert np.array_equal(length, length[twin])
    assert np.array_equal(cover.side_length[: mesh.n_faces], mesh.side_length)


def test_pages_are_glued_to_their_neighbours_around_the_spine():
    topology = tufted_cover(fan_of_pages(PAGES)).topology
    m = len(PAGES)
    spine = np.flatnonzero((topology.side_tail < 2) & (topology.side_head < 2))
    assert len(spine) == 2 * m  # two copies of every page
    neighbour = {(side // 3) % m: set() for side in spine}
    for side in spine:
        neighbour[(side // 3) % m].add((topology.side_twin.ravel()[side] // 3) % m)
    order = np.argsort(PAGES)
    for place, page in enumerate(order):
        assert neighbour[page] == {order[place - 1], order[(place + 1) % m]}


def test_closed_manifold_delaunay_mesh_is_covered_twice():
    mesh = shapes.icosphere(2)
    cotan, tufted = laplace_operator(mesh, "cotan"), laplace_operator(mesh, "tufted")
    assert abs(cotan.stiffness - tufted.stiffness).max() < 1e-13
    assert abs(cotan.mass - tufted.mass).max() < 1e-15
    assert tufted.preparation["flips"] == 0


def test_orientation_of_single_faces_does_not_matter():
    mesh = shapes.random_sphere(150)
    faces = mesh.faces.copy()
    turned = np.random.default_rng(0).random(len(faces)) < 0.5
    faces[turned] = faces[turned][:, ::-1]
    L = laplace_operator(TriangleMesh.from_arrays(mesh.points, faces)).stiffness
    assert abs(L - laplace_operator(mesh).stiffness).max() < 1e-9


@pytest.mark.parametrize("name", HARD)
def test_any_soup_has_a_laplacian(shared_meshes, name):
    mesh = read_mesh(str(shared_meshes / "hard" / name)).mesh
    operator = laplace_operator(mesh, "tufted")
    L, M, vertices = operator.stiffness, operator.mass, operator.referenced_vertices
    assert np.isfinite(L.data).all() and np.isfinite(M.data).all()
    assert negative_weights(L) == 0
    assert abs(L - L.T).max() == 0
    scale = L.diagonal()[vertices]
    assert (np.abs(L @ np.ones(L.shape[0]))[vertices] <= 1e-9 * scale.max()).all()


@pytest.mark.parametrize(
    "name", ["gen_book_edge.ply", "gen_moebius_tri.off", "gen_klein_bottle.obj", "triple_vierbein.obj"]
)
def test_robust_laplacian_agrees(shared_meshes, name):
    robust_laplacian = pytest.importorskip("robust_laplacian")
    mesh = read_mesh(str(shared_meshes / "hard" / name)).mesh
    L, M = robust_laplacian.mesh_laplacian(np.array(mesh.points), np.array(mesh.faces))
    ours = laplace_operator(mesh, "tufted")
    assert abs(ours.stiffness - L).max() < 1e-8 * abs(L).max()
    assert abs(ours.mass - M).max() < 1e-8 * abs(M).max()
