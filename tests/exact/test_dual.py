"""The circumcentric dual: areas, cotangent weights, Voronoi diagrams of the plane."""

import numpy as np
import pytest
from scipy.spatial import Voronoi

from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.dual import circumcentric_dual, dual_lines
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.operators.dec import complex_of
from ddgcli.operators.laplacian import lumped_mass, stiffness
from ddgcli.operators.stars import hodge_star
from tests.delaunay_cases import CASES, stretched
from tests.exact.test_homology import moebius


@pytest.mark.parametrize("name", [*CASES, "moebius"])
def test_areas_sum_to_the_area_and_lengths_are_cotangent_weights(name):
    mesh = flip_to_delaunay(moebius(20) if name == "moebius" else CASES[name]()).mesh
    dual = circumcentric_dual(mesh)
    total = lumped_mass(mesh).diagonal().sum()
    aspect = (mesh.side_length.max(axis=1) / dual.circumradius).min()  # cotangents of thin triangles
    assert dual.dual_area.sum() == pytest.approx(total, rel=1e-12 / aspect)
    inside = dual.edge_faces[:, 1] >= 0
    assert (dual.dual_length[inside] > -1e-9 * dual.circumradius.max()).all()
    a, b = mesh.topology.edges.T
    L = stiffness(mesh)
    weight = dual.dual_length / dual.edge_length
    diagonal = sum_by_index(np.where(a != b, a, -1) + 1, weight, mesh.n_vertices + 1)[1:]
    diagonal += sum_by_index(np.where(a != b, b, -1) + 1, weight, mesh.n_vertices + 1)[1:]
    assert np.abs(diagonal - L.diagonal()).max() < 1e-9 * L.diagonal().max()
    assert dual.length_residual < 1e-9 and dual.area_residual < 1e-9 / aspect


def test_the_dual_is_the_circumcentric_star_of_the_exterior_calculus():
    mesh = shapes.icosphere(2)
    dual, complex_ = circumcentric_dual(mesh), complex_of(mesh)
    star0, star1 = (hodge_star(complex_, k, "circumcentric").diagonal() for k in (0, 1))
    assert np.allclose(dual.dual_area, star0, rtol=1e-12)
    assert np.array_equal(mesh.topology.edges, complex_.edges)
    assert np.allclose(dual.dual_length / dual.edge_length, star1, rtol=1e-11)


def test_in_the_plane_the_dual_is_the_voronoi_diagram():
    mesh = CASES["planar"]()
    flipped = flip_to_delaunay(mesh, track=True)
    dual = circumcentric_dual(flipped.mesh)
    corners = mesh.points[flipped.mesh.faces]
    ours = np.einsum("fk,fkd->fd", dual.circumcentre, corners)[:, :2]
    truth = Voronoi(mesh.points[:, :2]).vertices
    # every circumcentre of a face that is not cut off by the boundary is a vertex of the diagram
    apart = np.linalg.norm(ours[:, None] - truth[None], axis=2).min(axis=1)
    size = np.ptp(mesh.points[:, :2], axis=0).max()
    well = dual.circumradius < 0.5 * size
    assert well.sum() > 10 and np.median(apart[well]) < 1e-9 * size
    lines = dual_lines(dual, common_subdivision(flipped, BaseTriangulation.itself(mesh)))
    ends = np.linalg.norm(lines.points[:, None, :2] - ours[None], axis=2).min(axis=1)
    assert (ends < 1e-7 * size).sum() > well.sum()
    first = lines.lines[:, 0]
    assert np.array_equal(lines.point_arrays["edge"][first], lines.point_arrays["edge"][lines.lines[:, 1]])


def test_the_command_writes_arrays_and_lines(summary, tmp_path):
    path, arrays, lines = (str(tmp_path / name) for name in ("in.ply", "dual.npz", "dual.vtp"))
    write_mesh(path, AnnotatedMesh(stretched()))
    result = summary("delaunay", path, "--dual", arrays)
    assert result["results"]["dual"]["negative_edges"] == 0 < result["results"]["dual"]["least_area"]
    assert max(result["accuracy"][f"dual_{what}_residual"] for what in ("area", "length")) < 1e-12
    stored = np.load(arrays)
    area = summary("laplacian", path)["results"]["area"]
    assert stored["dual_area"].sum() == pytest.approx(area, rel=1e-12)
    assert stored["edge_faces"].shape == stored["edges"].shape == (len(stored["dual_length"]), 2)
    assert np.allclose(stored["circumcentre"].sum(axis=1), 1.0)
    summary("delaunay", path, "--dual", lines)
    assert read_mesh(lines).kind == "curve"
