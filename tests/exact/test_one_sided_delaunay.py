"""Delaunay flips on one-sided surfaces against those of their orientation covers, which have two sides."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.intrinsic_delaunay import intrinsic_delaunay
from ddgcli.algorithms.delaunay.point_location import PointMap
from ddgcli.algorithms.delaunay.triangulation import (
    flip_to_delaunay,
    glue,
    negative_cotan_edges,
    non_delaunay_edges,
)
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.mesh_file import read_mesh, write_mesh
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
    """Every face twice, in both orientations, glued to an oriented surface; vertices keep their indices."""
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


@pytest.mark.parametrize("name", SURFACES)
def test_the_common_subdivision_is_the_surface_cut_along_straight_intrinsic_edges(name):
    mesh = SURFACES[name]
    result = intrinsic_delaunay(mesh, subdivide=True)
    cut = result.subdivision
    area = face_area(cut.mesh.side_length)
    for face, metric in ((cut.input_face, mesh), (cut.intrinsic_face, cut.intrinsic)):
        whole = face_area(metric.side_length)
        assert np.bincount(face, area, len(whole)) == pytest.approx(whole, rel=1e-11)
    topology, before = cut.mesh.topology, mesh.topology
    assert topology.euler_characteristic == before.euler_characteristic and topology.is_manifold
    assert topology.boundary_loops == before.boundary_loops and not topology.is_orientable
    drawn = [np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() for curve in cut.curves()]
    length = np.empty(cut.intrinsic.topology.n_edges)
    length[cut.intrinsic.topology.side_edge] = cut.intrinsic.side_length
    assert drawn == pytest.approx(length, rel=1e-11)
    crossings = np.maximum(flip_to_delaunay(mesh, track=True).crossings, 0).sum() // 2
    assert crossings > 10 and (cut.vertex_kind == 2).sum() == crossings
    for matrix in (cut.from_input, cut.from_intrinsic):
        assert matrix.sum(axis=1) == pytest.approx(1.0)
    assert np.abs(cut.from_input @ mesh.points - cut.mesh.points).max() < 1e-14


@pytest.mark.parametrize("name", ["moebius", "projective plane"])
def test_points_go_to_the_intrinsic_triangulation_of_a_one_sided_surface_and_back(name):
    mesh = SURFACES[name]
    cut = intrinsic_delaunay(mesh, subdivide=True).subdivision
    rng = np.random.default_rng(4)
    points = SurfacePoints(rng.integers(0, mesh.n_faces, 200), rng.dirichlet(np.ones(3), 200))
    carry = PointMap(cut)
    mapped = carry.to_intrinsic(points)
    assert mapped.face.max() < mesh.n_faces
    assert carry.to_input(mapped).positions(mesh) == pytest.approx(points.positions(mesh), abs=1e-12)


def test_functions_and_the_dual_go_over_a_moebius_band(summary, run, tmp_path):
    path, out, cut = (str(tmp_path / name) for name in ("band.npz", "idt.npz", "cut.npz"))
    mesh = SURFACES["moebius"]
    write_mesh(path, AnnotatedMesh(mesh, vertex={"warm": mesh.points[:, 2] + 1.0}))
    result = summary("delaunay", path, "-o", out, "--overlay", cut, "--transfer", "warm", "--dual",
                     tmp_path / "dual.vtp", "--plot", tmp_path / "edges.png")  # fmt: skip
    assert result["accuracy"]["transfer_integral_residual"] < 1e-13
    assert result["results"]["overlay"]["crossings"] > 10
    with np.load(out) as intrinsic, np.load(cut) as overlay:
        assert len(intrinsic["warm"]) == mesh.n_vertices
        assert overlay["warm"] == pytest.approx(overlay["points"][:, 2] + 1.0, abs=1e-13)
    lines = read_mesh(str(tmp_path / "dual.vtp")).mesh
    assert len(lines.lines) > mesh.n_faces and np.isfinite(lines.points).all()


def test_refinement_of_a_one_sided_surface_is_refused_with_a_remedy_that_works(summary, run, tmp_path):
    path, opened = str(tmp_path / "band.ply"), str(tmp_path / "open.ply")
    write_mesh(path, AnnotatedMesh(SURFACES["moebius"]))
    refused = run("delaunay", path, "--refine", "20")
    assert refused.exit_code == 2 and refused.stderr.splitlines()[-1].count("one-sided") == 1
    assert f"ddgcli repair {path} --cut-to-disk --orient" in refused.stderr
    summary("repair", path, "--cut-to-disk", "--orient", "-o", opened)
    after = summary("delaunay", opened, "--refine", "20")["results"]
    assert after["steiner_points"] > 0 and after["refinement"]["unreached_faces"] == 0
