"""Delaunay flips on one-sided surfaces against those of their orientation covers, which have two sides."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.triangulation import (
    flip_to_delaunay,
    glue,
    negative_cotan_edges,
    non_delaunay_edges,
)
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import galerkin_mass, stiffness
from tests.exact.test_hodge_one_sided import klein_and_torus, projective_plane
from tests.exact.test_homology import klein, moebius

SURFACES = {
    "moebius": moebius(30),
    "klein": klein(7),
    "projective plane": projective_plane(),
    "klein and torus": klein_and_torus(),
}


def orientation_cover(mesh: TriangleMesh) -> IntrinsicMesh:
    """Every face twice, in both orientations, glued to an oriented surface; vertices keep their numbers."""
    glued = glue(mesh)
    m, twin, twisted = mesh.n_faces, glued.topology.side_twin.ravel(), glued.topology.twisted.ravel()
    on_back = 3 * m + np.arange(3 * m) // 3 * 3 + 2 - np.arange(3 * m) % 3
    gluing = np.full(6 * m, -1)
    inside = twin >= 0
    on_front, back = twin[inside], on_back[twin[inside]]
    gluing[: 3 * m][inside] = np.where(twisted[inside], back, on_front)
    gluing[on_back[inside]] = np.where(twisted[inside], on_front, back)
    faces = np.concatenate([mesh.faces, mesh.faces[:, [0, 2, 1]]])
    length = np.concatenate([mesh.side_length, mesh.side_length[:, ::-1]])
    return IntrinsicMesh(Topology(faces, mesh.n_vertices, gluing.reshape(-1, 3)), length)


@pytest.mark.parametrize("name", SURFACES)
def test_operators_are_those_of_the_orientation_cover(name):
    mesh = SURFACES[name]
    flipped, cover = flip_to_delaunay(mesh), flip_to_delaunay(orientation_cover(mesh))
    assert flipped.flips > 10 and 2 * flipped.flips == pytest.approx(cover.flips, rel=0.2)
    for matrix in (stiffness, galerkin_mass):
        ours, half = matrix(flipped.mesh), 0.5 * matrix(cover.mesh)
        assert abs(ours - half).max() < 1e-9 * abs(half).max()


@pytest.mark.parametrize("name", SURFACES)
def test_no_edge_is_left_and_the_surface_stays(name):
    mesh = SURFACES[name]
    after = flip_to_delaunay(mesh).mesh
    assert not non_delaunay_edges(after).any()
    assert negative_cotan_edges(after) <= len(mesh.topology.boundary_edges)
    assert face_area(after.side_length).sum() == pytest.approx(face_area(mesh.side_length).sum(), rel=1e-10)
    assert after.topology.euler_characteristic == mesh.topology.euler_characteristic
    assert after.topology.n_components == mesh.topology.n_components
    assert not after.topology.is_orientable and after.topology.boundary_loops == mesh.topology.boundary_loops
    assert len(after.topology.nonmanifold_vertices) == len(mesh.topology.nonmanifold_vertices)
    glue(after)  # twins and twists are consistent
    twin, twisted = after.topology.side_twin.ravel(), after.topology.twisted.ravel()
    length = after.side_length.ravel()
    inside = np.flatnonzero(twin >= 0)
    assert np.array_equal(twisted[inside], twisted[twin[inside]]) and not twisted[twin < 0].any()
    assert np.array_equal(length[inside], length[twin[inside]])


def test_the_faces_of_a_moebius_band_may_be_turned_at_will():
    mesh = SURFACES["moebius"]
    turned = mesh.faces.copy()
    some = np.random.default_rng(1).random(mesh.n_faces) < 0.5
    turned[some] = turned[some][:, ::-1]
    other = TriangleMesh.from_arrays(mesh.points, turned)
    L, M = (stiffness(flip_to_delaunay(one).mesh) for one in (mesh, other))
    assert abs(L - M).max() < 1e-10 * abs(L).max()


def test_the_laplacian_of_a_klein_bottle_is_intrinsic_delaunay_and_equals_the_tufted_one(caplog):
    mesh = SURFACES["klein"]
    ours, tufted = laplace_operator(mesh), laplace_operator(mesh, "tufted")
    assert ours.name == "intrinsic-delaunay" and not caplog.records
    assert abs(ours.stiffness - tufted.stiffness).max() < 1e-9 * abs(ours.stiffness).max()


def test_turned_faces_of_a_two_sided_surface_are_still_an_error():
    both = klein_and_torus()
    faces = both.faces.copy()
    faces[-1] = faces[-1][::-1]
    with pytest.raises(MeshError, match="opposite orientation.*reverse 1 of them"):
        flip_to_delaunay(TriangleMesh.from_arrays(both.points, faces))


def test_the_command_writes_the_twisted_sides(summary, run, tmp_path):
    path, out = str(tmp_path / "band.ply"), str(tmp_path / "idt.npz")
    write_mesh(path, AnnotatedMesh(SURFACES["moebius"]))
    results = summary("delaunay", path, "-o", out)["results"]
    assert results["after"]["non_delaunay_edges"] == 0 < results["before"]["non_delaunay_edges"]
    arrays = np.load(out)
    glued, twisted = arrays["neighbors"], arrays["twisted"].astype(bool)
    face, side = np.nonzero(glued[..., 0] >= 0)
    partner = glued[face, side]
    start, end = arrays["faces"][face, side], arrays["faces"][face, (side + 1) % 3]
    expected = np.where(twisted[face, side], start, end)
    assert np.array_equal(arrays["faces"][partner[:, 0], partner[:, 1]], expected) and twisted.any()
    summary("delaunay", "--condition", path)
    torus = str(tmp_path / "torus.ply")
    write_mesh(torus, AnnotatedMesh(shapes.torus(8, 6)))
    summary("delaunay", torus, "-o", out)
    assert "twisted" not in np.load(out)
    for option in (("--refine", "20"), ("--overlay", str(tmp_path / "cut.ply"))):
        refused = run("delaunay", path, *option)
        assert refused.exit_code == 2 and "one-sided" in refused.stderr
