"""Geodesic polar coordinates by fast marching against closed forms and the exact logarithmic map."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance
from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.algorithms.tangent_fields.polar_coordinates import fast_marching_log_map
from ddgcli.errors import ParameterError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import disk


def mapped(mesh, sources):
    return fast_marching_log_map(mesh, fast_marching_distance(mesh, sources), sources)


def exactly(mesh, sources):
    return log_map(mesh, exact_distance(mesh, sources, directions=True), sources)


def sphere_errors(result, mesh, source):
    """Root mean square distance to the sphere's logarithmic map, turned to fit; degrees of directions."""
    p = mesh.points[source]
    e1 = np.cross(p, [0.3, 0.5, 0.8])
    planar = mesh.points @ e1 + 1j * (mesh.points @ np.cross(p, e1))
    angle = np.arccos(np.clip(mesh.points @ p, -1, 1))
    near = (angle < 2.5) & (angle > 1e-6)
    truth, computed = (
        (angle * planar / np.maximum(np.abs(planar), 1e-300))[near],
        (result.log_map @ [1, 1j])[near],
    )
    computed = computed * np.exp(1j * np.angle(np.vdot(computed, truth)))
    off = np.degrees(np.abs(np.angle(computed * truth.conj())))
    return np.sqrt(np.mean(np.abs(computed - truth) ** 2)), np.percentile(off, 95)


def test_the_fast_marching_log_map_converges_on_spheres():
    errors = []
    for n in (1000, 4000, 16_000):
        mesh = shapes.random_sphere(n)
        approximate = [sphere_errors(mapped(mesh, Sources.at([v])), mesh, v) for v in (0, 7, 100)]
        exact = [sphere_errors(exactly(mesh, Sources.at([v])), mesh, v) for v in (0, 7, 100)]
        assert np.mean(approximate, axis=0)[0] < 1.5 * np.mean(exact, axis=0)[0]
        errors.append(np.mean(approximate, axis=0))
    coarse, _, fine = np.array(errors)
    assert (fine < 0.4 * coarse).all() and fine[0] < 0.008 and fine[1] < 0.8


def flat_error(mesh, sources, at):
    """Distance of each vertex of a planar mesh to its position by the map."""
    result = mapped(mesh, sources)
    x = np.array(result.axis["x_axis"])
    y = np.cross([0, 0, 1], x)
    return np.linalg.norm(result.log_map[:, :1] * x + result.log_map[:, 1:] * y - (mesh.points - at), axis=1)


@pytest.mark.parametrize("mesh", [shapes.grid(40, 32, 2.0, 1.0), shapes.grid(20, 20, pattern="alternating")])
@pytest.mark.parametrize("source", [0, 40, 205])
def test_on_grids_in_the_plane_the_map_is_the_difference(mesh, source):
    assert flat_error(mesh, Sources.at([source]), mesh.points[source]).max() < 1e-12


@pytest.mark.parametrize("source", [5, 7, 14, 4000])
def test_on_a_disk_the_map_is_nearly_the_difference(source):
    """Vertex 4000 is on the boundary. Only the first edges may have an error."""
    mesh = disk(4000)
    error = flat_error(mesh, Sources.at([source]), mesh.points[source])
    assert np.sqrt(np.mean(error**2)) < 1e-3 and np.median(error) < 1e-5
    if source == 14:
        assert error.max() < 1e-12


@pytest.mark.parametrize("weights", [[0.2, 0.3, 0.5], [0.0, 0.3, 0.7], [0.0, 1.0, 0.0]])
def test_sources_in_faces_on_sides_and_at_corners(weights):
    mesh = shapes.grid(30, 30)
    points = SurfacePoints(np.array([777]), np.array([weights]))
    error = flat_error(mesh, Sources.at([], points), points.positions(mesh)[0])
    assert np.sqrt(np.mean(error**2)) < 0.004
    sphere, points = shapes.random_sphere(2000), SurfacePoints(np.array([51]), np.array([weights]))
    result, exact = (call(sphere, Sources.at([], points)) for call in (mapped, exactly))
    assert result.axis == exact.axis
    off = np.angle((result.log_map @ [1, 1j]) * (exact.log_map @ [1, 1j]).conj())
    assert np.degrees(np.median(np.abs(off))) < 1.5


def test_the_map_is_intrinsic_and_independent_of_face_order():
    mesh = shapes.random_sphere(2000)
    mesh = mesh.moved(mesh.points * [1.0, 1.0, 0.5])
    sources = Sources.at([5])
    original = mapped(mesh, sources)
    again = mapped(IntrinsicMesh(mesh.topology, mesh.side_length), sources)
    np.testing.assert_allclose(again.log_map, original.log_map, atol=1e-9)
    flipped = flip_to_delaunay(mesh).mesh
    assert flipped.topology.gluing is not None and not np.array_equal(flipped.faces, mesh.faces)
    glued, exact = (call(flipped, sources).log_map @ [1, 1j] for call in (mapped, exactly))
    assert np.degrees(np.median(np.abs(np.angle(glued * exact.conj())))) < 0.5
    turned = np.random.default_rng(0).random(mesh.n_faces) < 0.3
    mixed = TriangleMesh.from_arrays(mesh.points, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))
    cover = oriented_cover(mixed)
    over = fast_marching_log_map(cover.mesh, fast_marching_distance(cover.mesh, sources), sources).log_map
    flat, other = original.log_map @ [1, 1j], over @ [1, 1j]
    np.testing.assert_allclose(other, flat * (other[0] / flat[0]), atol=1e-9)


def test_at_the_cut_locus_directions_are_those_of_one_side():
    """A torus is its own mirror image, so both sides are valid, but not their mean."""
    mesh, sources = shapes.torus(40, 20), Sources.at([0])
    result, exact = mapped(mesh, sources).log_map, exactly(mesh, sources).log_map
    gaps = [np.linalg.norm(result - exact * sides, axis=1) for sides in ([1, 1], [1, -1], [-1, 1])]
    assert (np.min(gaps, axis=0) < 0.2).mean() > 0.975
    tube = shapes.cylinder(41, 30, 1.0, 4.0)
    np.testing.assert_allclose(
        mapped(tube, Sources.at([3])).log_map, exactly(tube, Sources.at([3])).log_map, atol=1e-12
    )


def test_long_edges_from_the_source_have_their_own_directions():
    """Most vertices lie in one corner: the far ends of the fan are not among the two hundred nearest."""
    n = 60
    rim = np.stack([np.cos(t := np.linspace(0, np.pi, n)), np.sin(t), 0 * t], axis=1)
    crowd = shapes.grid(19, 19, 0.01, 0.01).points[1:] + [-0.005, -0.02, 0]
    points = np.concatenate([[[0.0, 0, 0]], rim, crowd])
    faces = Delaunay(points[:, :2]).simplices
    mesh = TriangleMesh.from_arrays(points, faces)
    up = np.cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1])[:, 2]
    faces = np.where(up[:, None] < 0, faces[:, ::-1], faces)[np.abs(up) > 1e-12]
    error = flat_error(TriangleMesh.from_arrays(points, faces), Sources.at([0]), points[0])
    assert error[: n + 1].max() < 1e-9


def test_the_skew_converges_and_needs_one_source():
    skews = [mapped(shapes.random_sphere(n), Sources.at([0])).skew["median"] for n in (1000, 4000)]
    assert skews[1] < 0.7 * skews[0] < 0.05
    with pytest.raises(ParameterError, match="one source"):
        mapped(shapes.random_sphere(100), Sources.at([1, 2]))


def test_the_map_is_inf_at_unreached_vertices():
    a = shapes.icosphere(3)
    two = TriangleMesh.from_arrays(
        np.concatenate([a.points, a.points + 5]), np.concatenate([a.faces, a.faces + a.n_vertices])
    )
    result = mapped(two, Sources.at([0])).log_map
    assert np.isfinite(result[: a.n_vertices]).all() and np.isinf(result[a.n_vertices :]).all()
