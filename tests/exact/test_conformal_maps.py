"""Discrete conformal maps: angle sums, invariance under flips, Moebius maps as truth, overlays."""

import re

import numpy as np
import pytest
from scipy.spatial import Delaunay

from ddgcli.algorithms.conformal.conformal_map import conformal_map
from ddgcli.algorithms.conformal.distortion import planar_area
from ddgcli.algorithms.conformal.ptolemy import DecoratedTriangulation, flip_by_ptolemy
from ddgcli.algorithms.delaunay.triangulation import glue, non_delaunay_edges
from ddgcli.errors import MeshError, ParameterError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.delaunay_cases import stretched
from tests.exact.test_homology import klein, two_tori


def flat_disk(n=7, aspect=1.0, delaunay=False):
    """Irregular triangulation of a rectangle, far from Delaunay or Delaunay in the plane."""
    mesh = shapes.grid(n, n)
    points = mesh.points - mesh.points.mean(axis=0)
    inside = ~mesh.topology.boundary_vertex
    points[inside, :2] += 0.3 / n * np.random.default_rng(0).uniform(-1, 1, size=(inside.sum(), 2))
    points *= [aspect, 1.0, 1.0]
    if not delaunay:
        return mesh.moved(points)
    faces = Delaunay(points[:, :2]).simplices
    thick = np.abs(planar_area(points[faces][..., :2])) > 1e-9
    faces = faces[thick]
    turned = planar_area(points[faces][..., :2]) < 0
    faces[turned] = faces[turned][:, ::-1]
    return TriangleMesh.from_arrays(points, faces)


def inverted(mesh, centre):
    """The mesh under inversion in the unit sphere around a point, and the logarithms of the scale factors."""
    away = mesh.points - centre
    squared = (away**2).sum(axis=1)
    return mesh.moved(away / squared[:, None]), -np.log(squared)


def bumpy_disk():
    mesh = flat_disk(9)
    x, y, _ = mesh.points.T
    return mesh.moved(np.stack([x, y, 0.6 * np.exp(-8 * (x * x + y * y))], axis=1))


def far_vertices(mesh, k):
    landmarks = [int(mesh.points[:, 0].argmax())]
    distance = np.full(mesh.n_vertices, np.inf)
    for _ in range(k - 1):
        apart = np.linalg.norm(mesh.points - mesh.points[landmarks[-1]], axis=1)
        distance = np.minimum(distance, apart)
        landmarks.append(int(distance.argmax()))
    return landmarks


def angle_sums(mesh):
    """By the cosine rule, independent of the half-angle formulas."""
    a, b, c = mesh.side_length.T
    corner = [
        np.arccos((x * x + y * y - z * z) / (2 * x * y)) for x, y, z in ((a, c, b), (a, b, c), (b, c, a))
    ]
    total = np.zeros(mesh.n_vertices)
    np.add.at(total, mesh.faces, np.stack(corner, axis=1))
    return total


def congruent(z, truth):
    """Largest distance after the best rotation and translation, relative to the size."""
    z, truth = (p[:, 0] + 1j * p[:, 1] for p in (z, truth))
    z, truth = z - z.mean(), truth - truth.mean()
    turn = np.vdot(z, truth)
    return np.abs(z * turn / abs(turn) - truth).max() / np.abs(truth).max()


def test_four_cones_of_half_a_turn_on_a_stretched_sphere():
    mesh = stretched(300)
    cones = dict.fromkeys(far_vertices(mesh, 4), 180.0)
    flat = conformal_map(mesh, cones=cones)
    target = np.full(mesh.n_vertices, 2 * np.pi)
    target[list(cones)] = np.pi
    assert flat.converged and flat.delaunay.flips > 50 and flat.metric.triangulation.flips > 50
    assert np.abs(angle_sums(flat.flat) - target).max() < 1e-9  # of arccos near 0
    assert flat.metric.residual < 1e-10 and flat.layout.residual < 1e-9
    assert not non_delaunay_edges(flat.flat).any()
    assert flat.uv is None and flat.layout.seam.any()
    opened = flat.overlay()
    area = planar_area(opened.vertex["uv"][opened.mesh.faces])
    assert (area > 0).all()
    assert 0.5 * area.sum() == pytest.approx(_area(mesh), rel=1e-9)  # of the input
    assert opened.mesh.topology.euler_characteristic == 1 and opened.mesh.topology.is_manifold


def _area(mesh):
    p = mesh.points[mesh.faces]
    return 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum()


def test_a_torus_has_a_flat_metric_without_cones_and_two_seams():
    mesh = shapes.torus(14, 9)
    flat = conformal_map(mesh)
    assert flat.converged and np.abs(angle_sums(flat.flat) - 2 * np.pi).max() < 1e-9
    # the layout is a fundamental domain: its boundary is closed, and sides are glued by translations
    corner, z, seam = flat.layout.corner, flat.layout.z, flat.layout.seam
    side = np.flatnonzero(seam)
    twin = flat.flat.topology.side_twin.ravel()[side]
    start, other = z[corner.ravel()[side]], z[corner.ravel()[3 * (twin // 3) + (twin % 3 + 1) % 3]]
    shifts = np.unique(np.round(start - other, 7))
    assert 4 <= len(shifts) <= 6  # the generators, their sums, with both signs


@pytest.mark.parametrize("boundary", ["free", "angles"])
def test_boundaries_keep_their_lengths_or_have_their_angles(boundary):
    mesh = bumpy_disk()
    flat = conformal_map(mesh, boundary=boundary)
    edge = mesh.topology.boundary_vertex
    total = angle_sums(flat.flat)
    assert np.abs(total[~edge] - 2 * np.pi).max() < 1e-10
    lengths = flat.flat.side_length.ravel()[flat.flat.topology.side_twin.ravel() < 0].sum()
    before = mesh.side_length.ravel()[mesh.topology.side_twin.ravel() < 0].sum()
    if boundary == "free":
        assert np.abs(flat.scale[edge]).max() == 0 and lengths == pytest.approx(before, rel=1e-12)
    else:
        assert (np.pi - total[edge]).sum() == pytest.approx(2 * np.pi, abs=1e-9)
        radius = np.linalg.norm(flat.uv[edge] - flat.uv[edge].mean(axis=0), axis=1)
        assert np.ptp(radius) < 0.2 * radius.mean()  # nearly a circle
    uv = flat.uv
    assert (planar_area(uv[flat.flat.faces]) > 0).all()
    laid_out = np.linalg.norm(uv[flat.flat.faces[:, [1, 2, 0]]] - uv[flat.flat.faces], axis=2)
    assert np.allclose(laid_out, flat.flat.side_length, rtol=1e-9)


def test_four_right_angles_make_a_rectangle_of_an_inverted_rectangle():
    plane = flat_disk(7, aspect=2.0, delaunay=True)
    mesh, _ = inverted(plane, [0.3, 2.0, 0.7])
    corners = [
        int(np.argmin(a * plane.points[:, 0] + b * plane.points[:, 1])) for a in (1, -1) for b in (1, -1)
    ]
    flat = conformal_map(mesh, cones=dict.fromkeys(corners, 90.0), boundary="angles", operator="cotan")
    size = np.sqrt(_area(mesh) / _area(plane))
    assert congruent(flat.uv, size * plane.points[:, :2]) < 1e-9


def test_the_map_of_an_inverted_plane_is_the_plane():
    """Inversions keep the discrete conformal class, with known scale factors."""
    plane = flat_disk(8, delaunay=True)
    mesh, scale = inverted(plane, [0.2, -0.4, 0.6])
    flat = conformal_map(mesh, boundary="lengths", boundary_values=-scale, operator="cotan")
    assert np.abs(flat.scale + scale).max() < 1e-10
    assert congruent(flat.uv, plane.points[:, :2]) < 1e-10
    # between vertices too: circumcircle-preserving projective maps are restrictions of the inversion's
    opened = flat.overlay()
    assert (planar_area(opened.vertex["uv"][opened.mesh.faces]) > 0).all()
    assert flat.subdivision.length_residual < 1e-12


def test_the_plane_is_mapped_to_itself():
    plane = flat_disk(9, aspect=5.0)
    flat = conformal_map(plane)
    assert flat.delaunay.flips > 5 and flat.metric.triangulation.flips == 0
    assert np.abs(flat.scale).max() < 1e-12 and congruent(flat.uv, plane.points[:, :2]) < 1e-10
    opened = flat.overlay()
    assert congruent(opened.vertex["uv"], opened.mesh.points[:, :2]) < 1e-10
    assert np.abs(opened.face["conformal_distortion"] - 1).max() < 1e-4  # a square root of rounding


def test_ptolemy_flips_there_and_back_give_the_lengths_of_the_start():
    mesh = glue(shapes.icosphere(2))
    state = DecoratedTriangulation.of(mesh, np.full((mesh.n_faces, 3), -1))
    before = np.sort(state.length)
    u = np.random.default_rng(3).uniform(-2, 2, mesh.n_vertices)
    flip_by_ptolemy(state, u)
    assert (
        state.flips > 100
        and not non_delaunay_edges(state.mesh(state.scaled_length(u), mesh.n_vertices)).any()
    )
    flip_by_ptolemy(state, np.zeros(mesh.n_vertices))
    assert np.allclose(np.sort(state.length), before, rtol=1e-10)
    assert (state.crossings == -1).all()


def test_crossings_of_ptolemy_flips_fit_the_strips():
    mesh = stretched(300)
    flat = conformal_map(mesh, cones=dict.fromkeys(far_vertices(mesh, 6), 240.0), operator="cotan")
    assert flat.metric.triangulation.flips > 100 and flat.delaunay.flips == 0
    assert 0 < flat.subdivision.length_residual < 1e-12


def test_scale_factors_do_not_depend_on_size_and_position():
    mesh = bumpy_disk()
    one = conformal_map(mesh, boundary="angles")
    other = conformal_map(mesh.moved(1e-6 * mesh.points + 3e-6), boundary="angles")
    assert np.allclose(one.scale, other.scale, atol=1e-8)
    assert congruent(1e6 * other.uv, one.uv) < 1e-8


def test_what_gauss_bonnet_forbids_is_an_error():
    sphere, disk = shapes.icosphere(1), bumpy_disk()
    inner = int(np.flatnonzero(~disk.topology.boundary_vertex)[0])
    edge = int(np.flatnonzero(disk.topology.boundary_vertex)[0])
    for mesh, options, text in (
        (sphere, {}, "sum to 720"),
        (sphere, {"cones": {0: 180.0, 1: 180.0}}, "is 360 degrees in total"),
        (sphere, {"boundary": "angles"}, "closed"),
        (disk, {"cones": {inner: -5.0}}, "use more than 0"),
        (disk, {"cones": {edge: 90.0}}, "lies on the boundary"),
        (disk, {"cones": {edge: 90.0}, "boundary": "angles"}, "must be 360"),
        (disk, {"boundary": "lengths"}, "boundary_values"),
        (disk, {"boundary_values": np.zeros(disk.n_vertices)}, "boundary=lengths"),
        (disk, {"operator": "uniform"}, "is not one of"),
    ):
        with pytest.raises(ParameterError, match=text):
            conformal_map(mesh, **options)
    for mesh, text in ((two_tori(), "2 components"), (klein(7), "one-sided")):
        with pytest.raises(MeshError, match=text):
            conformal_map(mesh)


def test_thin_triangles_at_a_fixed_boundary_are_reported(caplog):
    """A pin of one triangle per ring: the boundary is far too short for what it bounds."""
    a = np.arange(3) * 2 * np.pi / 3
    rings = [np.stack([np.cos(a), np.sin(a), np.full(3, 8.0 * z)], axis=1) for z in range(6)]
    points = np.concatenate([*rings, [[0, 0, 44.0]]])
    faces = [[3 * k + i, 3 * k + (i + 1) % 3, 3 * k + 3 + i] for k in range(5) for i in range(3)]
    faces += [
        [3 * k + (i + 1) % 3, 3 * k + 3 + (i + 1) % 3, 3 * k + 3 + i] for k in range(5) for i in range(3)
    ]
    faces += [[15 + i, 15 + (i + 1) % 3, 18] for i in range(3)]
    flat = conformal_map(TriangleMesh.from_arrays(points, np.array(faces)))
    if not flat.converged:
        assert "subdivide" in caplog.text
    assert np.isfinite(flat.scale).all()


def test_the_command_writes_scale_factors_uv_and_overlay(summary, run, tmp_path):
    path, out, flat = (str(tmp_path / name) for name in ("disk.ply", "out.npz", "flat.npz"))
    write_mesh(path, AnnotatedMesh(bumpy_disk()))
    words = ("laplacian", path, "--parameterize", "discrete-conformal")
    result = summary(*words, "-o", out, "--overlay", flat)
    arrays, overlay = np.load(out), np.load(flat)
    assert result["accuracy"]["angle_sum_residual"] < 1e-10 and result["results"]["seam_edges"] == 0
    for name in ("uv", "log_scale_factor", "angle_sum", "conformal_distortion", "area_distortion"):
        assert name in arrays
    assert np.array_equal(overlay["uv"][: len(arrays["uv"])].shape, arrays["uv"].shape)
    assert overlay["conformal_distortion"].mean() < 1.2
    sphere = str(tmp_path / "sphere.ply")
    write_mesh(sphere, AnnotatedMesh(shapes.icosphere(2)))
    cones = [word for v in (0, 3, 6, 9) for word in ("--cone", f"{v}=180")]
    result = summary("laplacian", sphere, *words[2:], *cones, "-o", out, "--overlay", flat)
    assert "uv" not in np.load(out) and result["results"]["seam_edges"] > 0
    assert read_mesh(flat).surface.topology.euler_characteristic == 1
    refused = run("laplacian", sphere, *words[2:])
    assert refused.exit_code == 2 and "sum to 720 (Gauss-Bonnet): 4 vertices with 180" in refused.stderr
    assert f"ddgcli repair {sphere} --cut-to-disk" in refused.stderr
    refused = run("laplacian", sphere, *words[2:], *cones[:-2])
    assert refused.exit_code == 2 and "720 (Gauss-Bonnet); change the angles of --cone" in refused.stderr
    for extra in (("--cone", "3=90"), ("--boundary", "angles"), ("--overlay", flat)):
        refused = run("laplacian", path, "--parameterize", "conformal", *extra)
        assert refused.exit_code == 2 and "--parameterize discrete-conformal" in refused.stderr


def with_a_short_side(length):
    """A bumpy grid where one vertex lies near its neighbour."""
    mesh = shapes.grid(6, 6)
    points = mesh.points.copy()
    points[:, 2] = 0.3 * np.sin(3 * points[:, 0]) * points[:, 1]
    points[25] = points[24] + [length, 0, 0]
    return mesh.moved(points)


def test_short_sides_are_mapped_down_to_the_length_where_rounding_exceeds_the_tolerance(run, tmp_path):
    assert conformal_map(with_a_short_side(1e-4)).converged
    path, repaired = str(tmp_path / "grid.ply"), str(tmp_path / "grid-repaired.ply")
    write_mesh(path, AnnotatedMesh(with_a_short_side(1e-8)))
    refused = run("laplacian", path, "--parameterize", "discrete-conformal")
    assert refused.exit_code == 2 and "rounding changes their angles" in refused.stderr
    words = re.search(r"ddgcli (repair .*) -o", refused.stderr).group(1).split()
    assert run(*words, "-o", repaired).exit_code == 0
    assert run("laplacian", repaired, "--parameterize", "discrete-conformal").exit_code == 0
    strip = shapes.grid(6, 1)
    write_mesh(path, AnnotatedMesh(strip.moved(strip.points * [1, 1e-9, 1])))
    refused = run("laplacian", path, "--parameterize", "discrete-conformal")
    # a weld would leave no face
    assert refused.exit_code == 2 and refused.stderr.rstrip().endswith("move their vertices apart")
