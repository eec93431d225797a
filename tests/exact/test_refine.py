"""Delaunay refinement: the angle is reached, the metric stays, and the overlay works afterwards."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.measures import angle_defect
from ddgcli.algorithms.delaunay.common_subdivision import CROSSING, STEINER_POINT, common_subdivision
from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.triangulation import non_delaunay_edges
from ddgcli.algorithms.delaunay.triangulation_statistics import metric_residuals
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import face_area_vector, face_normal
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.delaunay_cases import non_delaunay_sphere, pinched, planar, sheared_cylinder, stretched


def thin_grid():
    mesh = shapes.grid(10, 3, 10, 1)
    return mesh.moved(mesh.points * np.array([1, 0.02, 1]))


def cone(total_angle, rim=7):
    """A cone of a given total angle over a regular polygon."""
    slope = total_angle / (2 * np.pi)  # radius of the rim over slant height 1
    angle = 2 * np.pi * np.arange(rim) / rim
    points = np.stack([slope * np.cos(angle), slope * np.sin(angle), np.zeros(rim)], axis=1)
    apex = [[0, 0, np.sqrt(1 - slope**2)]]
    k = np.arange(rim)
    faces = np.stack([k, (k + 1) % rim, np.full(rim, rim)], axis=1)
    return TriangleMesh.from_arrays(np.concatenate([points, apex]), faces)


CASES = {
    "stretched": stretched,
    "planar": lambda: planar(n=80),
    "sheared cylinder": sheared_cylinder,
    "thin grid": thin_grid,
    "pinched": pinched,
    "tiny": lambda: (lambda m: m.moved(1e-8 * m.points))(stretched(200)),
    "huge": lambda: (lambda m: m.moved(1e8 * m.points))(stretched(200)),
}


@pytest.fixture(params=CASES, scope="module")
def case(request):
    mesh = CASES[request.param]()
    return mesh, refine(mesh, 25)


def test_no_angle_is_smaller_and_the_metric_stays(case):
    mesh, refined = case
    after = refined.triangulation.mesh
    small = corner_angle(after.side_length).min(axis=1) < np.radians(25) * (1 - 1e-6)
    assert refined.converged and small.sum() == refined.excepted_faces
    if refined.sharp_vertices == 0:
        assert not small.any()
    assert not non_delaunay_edges(after).any()
    assert face_area(after.side_length).sum() == pytest.approx(face_area(mesh.side_length).sum(), rel=1e-11)
    change = angle_defect(after)
    change[: mesh.n_vertices] -= angle_defect(mesh)
    assert np.abs(change).max() < 1e-9  # Steiner points are flat
    assert after.topology.euler_characteristic == mesh.topology.euler_characteristic
    assert after.topology.boundary_loops == mesh.topology.boundary_loops


def test_the_overlay_after_refinement_is_a_mesh_of_the_same_topology(case):
    mesh, refined = case
    cut = common_subdivision(refined.triangulation, refined.base)
    topology = cut.mesh.topology
    assert topology.is_manifold == mesh.topology.is_manifold and topology.is_oriented
    assert np.array_equal(topology.nonmanifold_vertices, mesh.topology.nonmanifold_vertices)
    assert topology.euler_characteristic == mesh.topology.euler_characteristic
    assert (cut.vertex_kind == STEINER_POINT).sum() == len(refined.steiner)
    assert cut.length_residual < 1e-9
    turned = np.einsum("ij,ij->i", face_area_vector(cut.mesh), face_normal(mesh)[cut.input_face])
    assert (turned > -1e-9 * face_area(mesh.side_length).max()).all()
    area = np.linalg.norm(face_area_vector(cut.mesh), axis=1)
    for label, whole in ((cut.input_face, mesh), (cut.intrinsic_face, refined.triangulation.mesh)):
        expected = face_area(whole.side_length)
        assert np.bincount(label, area, minlength=whole.n_faces) == pytest.approx(
            expected, abs=1e-9 * expected.max()
        )
    # crossings lie on input edges: each belongs to two input faces, or to one at the boundary
    corner = np.unique(np.stack([cut.mesh.faces.ravel(), np.repeat(cut.input_face, 3)]), axis=1)
    faces_at = np.bincount(corner[0], minlength=cut.mesh.n_vertices)
    assert (faces_at[cut.vertex_kind == CROSSING] == 2).all()
    assert (faces_at[cut.vertex_kind == STEINER_POINT] == 1).all()
    assert np.abs(cut.from_input @ mesh.points - cut.mesh.points).max() < 1e-13 * np.abs(mesh.points).max()


def test_what_is_good_already_gets_no_points():
    refined = refine(shapes.icosphere(2), 25)
    assert len(refined.steiner) == 0 and refined.batches == 0 and refined.triangulation.flips == 0


@pytest.mark.parametrize("degrees", [40, 20])
def test_sharp_cones_are_excepted_and_counted(degrees):
    refined = refine(cone(np.radians(degrees)), 25)
    assert refined.sharp_vertices == 1
    assert refined.converged and refined.unreached_faces == 0
    small = corner_angle(refined.triangulation.mesh.side_length).min(axis=1) < np.radians(25) * (1 - 1e-6)
    assert small.sum() == refined.excepted_faces
    assert len(refined.steiner) < 500


def test_a_sharp_corner_of_the_boundary_is_excepted():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0.1, 0], [2, 0.3, 0], [2, 1.0, 0]])
    mesh = TriangleMesh.from_arrays(points, np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]]))
    refined = refine(mesh, 25)
    assert refined.sharp_vertices >= 1 and refined.converged
    assert len(refined.steiner) < 500


def test_coincident_vertices_are_excepted_and_counted(caplog):
    mesh = non_delaunay_sphere()
    refined = refine(mesh, 25)
    assert refined.coincident_vertices == 2 and refined.sharp_vertices == 0
    assert refined.converged and 0 < refined.excepted_faces < 20
    assert "mollified" in caplog.text
    change = metric_residuals(mesh, refined.triangulation.mesh)
    assert change["area_residual"] < 1e-8  # the cap gets a height of about 3e-8 of its sides
    assert change["angle_defect_residual"] < 4 * 3e-8 / (2 * np.pi)


def test_points_run_out():
    refined = refine(stretched(), 25, max_points=50)
    assert len(refined.steiner) == 50 and not refined.converged and refined.unreached_faces > 0
    assert not non_delaunay_edges(refined.triangulation.mesh).any()


def test_refinement_stops_where_rounding_has_changed_the_area(caplog):
    # a point on a side of 0.05 changes the lengths beside it by h^2 / 0.05, h the height of the faces
    for height, converged in ((5e-6, True), (5e-10, False)):
        strip = shapes.grid(20, 1)
        strip = strip.moved(strip.points * [1, height / np.ptp(strip.points[:, 1]), 1])
        refined = refine(strip, 0.02)
        assert refined.converged == converged and len(refined.steiner) < 2000
        assert ("rounding has changed the area" in caplog.text) != converged


def test_impossible_refinements_are_refused():
    with pytest.raises(ParameterError, match="does not end"):
        refine(shapes.icosphere(1), 45)
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    book = TriangleMesh.from_arrays(points, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    with pytest.raises(MeshError, match="more than two faces.*0-1.*tufted"):
        refine(book, 25)
    with pytest.raises(MeshError, match="face 1 names a vertex twice"):
        refine(TriangleMesh.from_arrays(points, np.array([[0, 1, 2], [1, 1, 3]])), 25)


def test_two_runs_are_equal():
    a, b = refine(stretched(), 25), refine(stretched(), 25)
    assert np.array_equal(a.triangulation.mesh.side_length, b.triangulation.mesh.side_length)
    assert np.array_equal(a.steiner.barycentric, b.steiner.barycentric)
