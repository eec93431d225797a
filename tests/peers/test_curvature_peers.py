"""The same question to libigl and trimesh, where they mean the same thing."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.measures import angle_defect, curvature_vector, vertex_area
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.mesh import shapes
from tests.curvature_truths import ellipsoid_truth, irregular_ellipsoid

igl = pytest.importorskip("igl")


def crumpled():
    mesh = shapes.random_sphere(800, seed=2)
    return mesh.moved(mesh.points * [1.5, 1.0, 0.6])


def test_angle_defect_area_and_mean_curvature_vector_are_libigl_s():
    mesh = crumpled()
    assert angle_defect(mesh) == pytest.approx(igl.gaussian_curvature(mesh.points, mesh.faces), abs=1e-12)
    mass = igl.massmatrix(mesh.points, mesh.faces, igl.MASSMATRIX_TYPE_VORONOI).diagonal()
    assert vertex_area(mesh) == pytest.approx(mass, rel=1e-9)
    laplacian = igl.cotmatrix(mesh.points, mesh.faces)
    assert curvature_vector(mesh) == pytest.approx(0.5 * (laplacian @ mesh.points), abs=1e-11)


def test_boundary_defects_differ_from_libigl_s_by_pi_as_they_should():
    mesh = shapes.catenoid(20, 10)
    difference = igl.gaussian_curvature(mesh.points, mesh.faces) - angle_defect(mesh)
    assert difference == pytest.approx(np.where(mesh.topology.boundary_vertex, np.pi, 0.0), abs=1e-12)


def test_angle_defects_are_trimesh_s():
    import trimesh

    mesh = crumpled()
    theirs = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    assert angle_defect(mesh) == pytest.approx(theirs.vertex_defects, abs=1e-10)
    assert measure_curvature(mesh).results["volume"] == pytest.approx(theirs.volume, rel=1e-12)
    assert measure_curvature(mesh).edge["dihedral_angle"].shape == theirs.face_adjacency_angles.shape
    ours = np.sort(np.abs(measure_curvature(mesh).edge["dihedral_angle"]))
    assert ours == pytest.approx(np.sort(theirs.face_adjacency_angles), abs=1e-7)


def test_the_default_scheme_is_closer_to_the_truth_than_libigl_s_fits():
    mesh = irregular_ellipsoid(4000)
    truth = ellipsoid_truth(mesh.points, (1.5, 1.0, 0.6))
    v = measure_curvature(mesh).vertex
    d_max, d_min, k_max, k_min, *_ = igl.principal_curvature(mesh.points, mesh.faces, radius=2)
    assert np.median(np.abs(k_max - truth.k_max)) < 0.05, "same sign and order"

    def error(low, high):
        return np.sqrt(np.mean((low - truth.k_min) ** 2) + np.mean((high - truth.k_max) ** 2))

    ours = error(v["principal_curvature_min"], v["principal_curvature_max"])
    assert ours < 0.2 * error(np.minimum(k_min, k_max), np.maximum(k_min, k_max))
    apart = truth.k_max - truth.k_min > 0.5
    agree = np.abs(np.einsum("ij,ij->i", v["principal_direction_max"], d_max))[apart]
    assert np.median(agree) > 0.999
