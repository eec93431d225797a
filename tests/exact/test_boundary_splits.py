"""Boundary edges opposite obtuse angles: no negative cotangent is left, and what diffuses keeps its sign."""

import logging

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.boundary_splits import split_obtuse_boundary
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay, negative_cotan_edges
from ddgcli.algorithms.geodesics.distance import DistanceOptions, measure_distance
from ddgcli.algorithms.geodesics.edge_sets import edge_set
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.heat_log_map import heat_log_map
from ddgcli.algorithms.tangent_fields.signed_distance import signed_distance
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import from_vertex_frames, to_vertex_frames
from tests.geodesic_cases import disk


def coarse_rim(n=300, per_side=2):
    """Random points in the unit square, and few on its rim: obtuse angles opposite the boundary."""
    from scipy.spatial import Delaunay

    inside = np.random.default_rng(n).uniform(0.01, 0.99, (n, 2))
    along = np.arange(per_side) / per_side
    low, high = np.zeros(per_side), np.ones(per_side)
    rim = [[along, low], [high, along], [1 - along, high], [low, 1 - along]]
    points = np.concatenate([inside, *(np.stack(side, axis=1) for side in rim)])
    faces = Delaunay(points).simplices
    corner = points[faces]
    turn = np.linalg.det(corner[:, 1:] - corner[:, :1])
    faces[turn < 0] = faces[turn < 0][:, ::-1]
    solid = np.abs(turn) > 1e-12
    return TriangleMesh.from_arrays(np.pad(points, ((0, 0), (0, 1))), faces[solid])


FLAT = coarse_rim()


def strip(twist):
    """Band with coarse rims, closed to a ring or (with a twist) to a Moebius strip."""
    k = 12
    angle = 2 * np.pi * np.arange(k) / k
    half = angle / 2 if twist else np.zeros(k)
    out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    across = np.cos(half)[:, None] * [0, 0, 1] + np.sin(half)[:, None] * out
    low, high = out - 0.05 * across, out + 0.05 * across
    points = np.concatenate([low, high, 0.5 * (out + np.roll(out, -1, axis=0))])
    i, j, centre = np.arange(k), (np.arange(k) + 1) % k, 2 * k + np.arange(k)
    lower, upper = i.copy(), i + k
    lower_next, upper_next = j.copy(), j + k
    if twist:
        lower_next[-1], upper_next[-1] = k, 0
    ring = [(lower, lower_next), (lower_next, upper_next), (upper_next, upper), (upper, lower)]
    faces = np.concatenate([np.stack([a, b, centre], axis=1) for a, b in ring])
    return TriangleMesh.from_arrays(points, faces)


@pytest.mark.parametrize("mesh", [FLAT, strip(False), strip(True)])
def test_cuts_leave_no_negative_cotangent_and_change_no_metric(mesh):
    flipped = flip_to_delaunay(mesh).mesh
    assert negative_cotan_edges(flipped) > 4
    split = split_obtuse_boundary(flipped).mesh
    assert negative_cotan_edges(split) == 0
    assert face_area(split.side_length).sum() == pytest.approx(face_area(mesh.side_length).sum(), rel=1e-12)
    rims = [m.side_length[m.topology.side_twin < 0].sum() for m in (mesh, split)]
    assert rims[1] == pytest.approx(rims[0], rel=1e-12)
    assert split.topology.euler_characteristic == mesh.topology.euler_characteristic
    n = mesh.n_vertices
    angle = [np.bincount(f.vertex, f.total_angle)[:n] for f in map(vertex_fans, (mesh, split))]
    if mesh.topology.is_oriented:
        assert np.allclose(*angle, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "mesh", [shapes.grid(6, 5), shapes.icosphere(2), shapes.grid(4, 4, pattern="alternating")]
)
def test_meshes_without_obtuse_boundary_angles_are_the_same_object(mesh):
    flipped = flip_to_delaunay(mesh).mesh
    assert split_obtuse_boundary(flipped, track_turn=True).mesh is flipped
    assert VectorHeat(mesh).mesh is mesh


@pytest.mark.parametrize("mesh", [FLAT, coarse_rim(2000, 5), disk(400)])
def test_constant_vectors_spread_unchanged_where_boundary_angles_are_obtuse(mesh):
    constant = np.tile([0.6, -0.8, 0.0], (mesh.n_vertices, 1))
    planar = to_vertex_frames(mesh, constant)
    heat = VectorHeat(mesh)
    for source in (0, 7, mesh.n_vertices // 2):
        spread = from_vertex_frames(mesh, heat.transport(np.array([source]), planar[[source]]).vector)
        assert np.abs(spread - constant).max() < 1e-9
    sizes = np.array([1.0, 2.0])
    lengths = np.abs(heat.transport(np.array([3, 50]), sizes * planar[[3, 50]]).vector)
    assert lengths.min() > 1 - 1e-9 and lengths.max() < 2 + 1e-9


def test_heat_distance_and_log_map_in_a_square_with_a_coarse_rim():
    sources = Sources.at([10])
    away = FLAT.points - FLAT.points[10]
    truth = np.linalg.norm(away, axis=1)
    result = measure_distance(FLAT, sources, "heat")
    assert np.abs(result.distance - truth).mean() < 0.02 * truth.max()
    assert result.accuracy["error_estimate"] < 0.1
    mapped = heat_log_map(FLAT, result.distance, sources)
    x = np.array(mapped.axis["x_axis"])
    planar = np.stack([away @ x, away @ np.cross([0, 0, 1], x)], axis=1)
    error = np.linalg.norm(mapped.log_map - planar, axis=1)
    assert np.sqrt((error**2).mean()) < 0.15 * truth.max()


@pytest.mark.parametrize("per_side", [1, 5])
def test_signed_heat_has_the_sign_of_the_region(per_side):
    mesh = coarse_rim(500, per_side)
    curves = edge_set(mesh, (mesh.points[mesh.faces].mean(axis=1)[:, 0] > 0.5).astype(int))
    exact, heat = (signed_distance(mesh, curves, method).distance for method in ("exact", "heat"))
    assert exact.shape == heat.shape
    away = np.abs(exact) > 0.05
    assert (exact[away] * heat[away] > 0).all()


def test_heat_below_zero_on_faces_as_they_are_is_reported_with_a_remedy(caplog):
    with caplog.at_level(logging.WARNING, logger="ddgcli"):
        measure_distance(FLAT, Sources.at([10]), "heat")
        assert "heat is not positive" not in caplog.text
        measure_distance(FLAT, Sources.at([10]), "heat", DistanceOptions(operator="plain"))
        assert "heat is not positive" in caplog.text and "`operator=intrinsic-delaunay`" in caplog.text
        caplog.clear()
        VectorHeat(FLAT, intrinsic_delaunay=False).transport(np.array([10]), np.ones(1, dtype=complex))
        assert "heat is not positive" in caplog.text
