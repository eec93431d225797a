"""Inputs on which other programs gave wrong numbers or ended, from their issue threads; ours are right.

The thread of each is named in the docstring. What other files already test: the triangle and the kite
(test_geodesic_hard), shortest paths that leave the boundary (test_shortest_paths), refinement (test_refine).
"""

import numpy as np
import pytest

import ddgcli as ddg
from benchmarks.hardcases import meshes
from ddgcli.mesh import shapes
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import dec_matrices


@pytest.mark.parametrize("pattern", ["right", "left", "alternating"])
def test_distances_on_a_square_are_straight_lines_from_every_vertex(pattern):
    """libigl 1511 (factor 2), 2230 (second source), 2442 (neighbours), gptoolbox 31 (0.36 for 1.41)."""
    square = shapes.grid(6, 6, pattern=pattern)
    for source in range(0, square.n_vertices, 7):
        distance = ddg.geodesic_distance(square, source)
        straight = np.linalg.norm(square.points - square.points[source], axis=1)
        assert np.abs(distance - straight).max() < 1e-13
        assert np.flatnonzero(distance == 0).tolist() == [source]


def test_distances_to_several_sources_are_those_to_the_nearest():
    """compas_cgal 73: a Poisson solve without pinned sources."""
    square = shapes.grid(10, 10, pattern="alternating")
    sources = [0, 57, 113]
    straight = np.linalg.norm(square.points[:, None] - square.points[sources], axis=2).min(axis=1)
    assert np.abs(ddg.geodesic_distance(square, sources) - straight).max() < 1e-13


def test_every_vertex_of_a_bounded_surface_may_be_the_source():
    """libigl 1013, geometry-central 119, 133, 212: assertions at boundary sources."""
    surface = shapes.catenoid(8, 4)
    table = np.stack([ddg.geodesic_distance(surface, source) for source in range(surface.n_vertices)])
    assert np.abs(table - table.T).max() < 1e-12 * table.max()
    straight = np.linalg.norm(surface.points[:, None] - surface.points, axis=2)
    assert (table >= straight - 1e-12).all()


def test_distances_on_an_intrinsic_triangulation_are_those_of_the_surface():
    """geometry-central 212: a triangulation whose faces may be glued to themselves."""
    surface = shapes.random_sphere(60, seed=3)
    flipped = ddg.intrinsic_delaunay(surface)
    assert np.abs(ddg.geodesic_distance(flipped, 7) - ddg.geodesic_distance(surface, 7)).max() < 1e-12


def test_laplacians_of_linear_functions_vanish_and_the_barycentric_star_is_as_far_off_as_documented():
    """CombinatorialSpaces 181: the barycentric star on a grid of right triangles is far from zero."""
    grid = shapes.grid(12, 12, pattern="alternating")
    moved = grid.points.copy()
    inside = ~grid.topology.boundary_vertex
    moved[inside, :2] += np.random.default_rng(0).uniform(-0.01, 0.01, size=(int(inside.sum()), 2))
    uneven = grid.moved(moved)
    values = {}
    for star in ("circumcentric", "galerkin", "barycentric"):
        laplacian = dec_matrices(complex_of(uneven), star).matrices["laplacian0"]
        values[star] = float(np.abs(laplacian @ (2 * moved[:, 0]))[inside].max())
    assert max(values["circumcentric"], values["galerkin"]) < 1e-13
    assert 1e-3 < values["barycentric"] < 0.2


@pytest.mark.parametrize("level", [2, 3, 4])
def test_gaussian_curvature_is_pointwise_and_angle_defects_are_integrated(level):
    """PyMesh 60: means of 0.299, 0.0196, 0.00123 for 1/25, because it returns angle defects."""
    measured = ddg.curvature(ddg.icosphere(level, radius=5.0), "cotan")
    assert measured.vertex["gaussian_curvature"].mean() == pytest.approx(1 / 25, rel=0.03)
    assert measured.vertex["angle_defect"].sum() == pytest.approx(4 * np.pi, rel=1e-12)


def test_skinny_triangles_keep_the_sign_and_boundaries_have_no_spurious_curvature():
    """libigl 221 (sign on skinny triangles), 1532 (boundary vertices), 11 and 490 (small neighbourhoods)."""
    needles = ddg.as_mesh(meshes.cylinder(400))
    vertex = ddg.curvature(needles).vertex
    assert not vertex["gaussian_curvature"].any()
    tall = shapes.cylinder(48, 3)
    inside = ~tall.topology.boundary_vertex
    assert (ddg.curvature(tall).vertex["mean_curvature"][inside] > 0).all()
    lonely = ddg.curvature(ddg.as_mesh(meshes.one_triangle()))
    assert all(np.isfinite(values).all() for values in lonely.vertex.values())
