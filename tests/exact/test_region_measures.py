"""Curvature measures of regions, gradients of area and volume at vertices, offset bodies of "
"Steiner's formula."""

import numpy as np
import pytest

from benchmarks.fuzz.call_meshes import klein_bottle
from ddgcli.algorithms.curvature.offset_body import offset_body
from ddgcli.algorithms.curvature.region_measures import (
    labels_of,
    measures_in_ball,
    measures_of_labels,
)
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.algorithms.curvature.surface_query import gradient_vectors, measure_surface
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import noisy_torus

CUBE = shapes.box(3, 3, 3)
NAMES = ("area", "phi_k", "phi_h", "anisotropic", "normal_cycle")


@pytest.mark.parametrize("place", ["face", "vertex"])
def test_measures_of_disjoint_regions_add_up_to_those_of_their_union(place):
    mesh = noisy_torus()
    rng = np.random.default_rng(2)
    label = rng.integers(0, 7, mesh.n_faces if place == "face" else mesh.n_vertices)
    by_label = measures_of_labels(mesh, label, place)
    union = measures_of_labels(mesh, (label > 2).astype(np.int64), place)
    whole = measures_of_labels(mesh, 0 * label, place)
    for name in NAMES:
        values, both, total = (getattr(m, name) for m in (by_label, union, whole))
        scale = np.abs(values).sum()
        assert np.abs(values[:3].sum(axis=0) - both[0]).max() < 1e-13 * scale
        assert np.abs(values.sum(axis=0) - total[0]).max() < 1e-13 * scale
    assert whole.area[0] == pytest.approx(face_area(mesh.side_length).sum(), rel=1e-12)
    assert abs(whole.phi_k[0]) < 1e-10
    mean = measure_curvature(mesh, "cotan").results["total_mean_curvature"]
    assert whole.phi_h[0] == pytest.approx(2 * mean, rel=1e-12)


def test_a_side_of_a_cube_has_a_third_of_its_corners_and_half_of_its_edges():
    centroid = CUBE.points[CUBE.faces].mean(axis=1)
    top = (centroid[:, 2] == CUBE.points[:, 2].max()).astype(np.int64)
    side = float(np.ptp(CUBE.points[:, 0]))
    measures = measures_of_labels(CUBE, top, "face")
    assert measures.area[1] == pytest.approx(side**2)
    assert measures.phi_k == pytest.approx([4 * np.pi - 2 * np.pi / 3, 2 * np.pi / 3])
    assert measures.phi_h == pytest.approx([5 * np.pi * side, np.pi * side])
    assert np.abs(measures.anisotropic.sum(axis=0) - 2 * np.pi * side * np.eye(3)).max() < 1e-12
    expected = np.pi * side / 2 * np.diag([1.0, 1.0, 0.0])  # along the four edges of the top
    assert np.abs(measures.anisotropic[1] - expected).max() < 1e-12


def test_both_tensors_have_the_trace_of_the_mean_curvature_measure_and_swapped_axes():
    mesh = shapes.cylinder(64, 32, radius=0.5, height=2.0)
    middle = mesh.points.mean(axis=0)
    measures = measures_in_ball(mesh, middle, 0.8)
    phi_h = measures.phi_h[0]
    assert np.trace(measures.anisotropic[0]) == pytest.approx(phi_h)
    assert np.trace(measures.normal_cycle[0]) == pytest.approx(phi_h)
    assert phi_h / measures.area[0] == pytest.approx(1 / 0.5, rel=0.01), "sum of the principal curvatures"
    axis = np.array([0.0, 0.0, 1.0])
    assert axis @ measures.anisotropic[0] @ axis == pytest.approx(phi_h, rel=1e-9), "along the axis: swapped"
    assert abs(axis @ measures.normal_cycle[0] @ axis) < 1e-9 * phi_h
    assert measures.phi_k[0] == pytest.approx(0, abs=1e-12)


def test_a_ball_at_the_corner_of_a_cube_holds_a_corner_and_three_parts_of_edges():
    corner = CUBE.points.min(axis=0)
    radius = 0.41 * float(np.ptp(CUBE.points[:, 0]))
    measures = measures_in_ball(CUBE, corner, radius)
    assert measures.phi_k[0] == pytest.approx(np.pi / 2)
    assert measures.phi_h[0] == pytest.approx(1.5 * np.pi * radius)
    assert measures.area[0] == pytest.approx(0.75 * np.pi * radius**2)
    assert np.abs(measures.anisotropic[0] - 0.5 * np.pi * radius * np.eye(3)).max() < 1e-12
    whole = measures_in_ball(CUBE, corner, 10.0)
    assert whole.phi_k[0] == pytest.approx(4 * np.pi)


@pytest.mark.parametrize("mesh", [noisy_torus(), shapes.icosphere(2)], ids=["torus", "sphere"])
def test_vertex_vectors_are_the_gradients_of_area_and_volume(mesh):
    arrays = gradient_vectors(mesh)
    direction = np.random.default_rng(5).normal(size=mesh.points.shape)
    h = 1e-6
    plus, minus = (mesh.moved(mesh.points + s * h * direction) for s in (1, -1))
    area = (face_area(plus.side_length).sum() - face_area(minus.side_length).sum()) / (2 * h)
    volume = (enclosed_volume(plus) - enclosed_volume(minus)) / (2 * h)
    assert -(arrays["H_p"] * direction).sum() == pytest.approx(area, rel=1e-6)
    assert (arrays["volume_gradient"] * direction).sum() == pytest.approx(volume, rel=1e-6)


def test_h_p_of_a_sphere_is_the_sum_of_the_principal_curvatures():
    mesh = shapes.icosphere(3, radius=2.0)
    arrays = gradient_vectors(mesh)
    sixfold = np.bincount(mesh.faces.ravel()) == 6
    assert np.abs(arrays["h_p"] - 1.0)[sixfold].max() < 0.01, "elsewhere 15 %: the cotangent formula's error"
    assert arrays["gradient_angle"].max() < 0.02
    torus = gradient_vectors(shapes.torus(24, 12))
    assert torus["gradient_angle"].max() < np.pi and (torus["h_p"] >= 0).all()


def test_the_volume_of_the_offset_of_a_cube_converges_to_the_steiner_polynomial_with_order_two():
    mesh, distance, errors = shapes.box(1, 1, 1), 0.3, []
    truth = 1 + 6 * distance + 3 * np.pi * distance**2 + 4 * np.pi / 3 * distance**3
    for angle in (18, 9, 4.5):
        body = offset_body(mesh, distance, angle)
        topology = body.mesh.topology
        assert topology.is_closed and topology.is_oriented and topology.genus == 0
        errors.append(1 - body.volume / truth)
    assert min(errors) > 0, "arcs are inscribed"
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.8
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    nearest = np.clip(body.mesh.points, low, high)
    gap = np.linalg.norm(body.mesh.points - nearest, axis=1)
    assert np.abs(gap - distance).max() < 1e-12, "every point lies at the distance"
    flat = body.part_of_face == 0
    assert face_area(body.mesh.side_length)[flat].sum() == pytest.approx(6.0, rel=1e-12)


def test_the_signed_volume_of_the_offset_of_a_torus_follows_the_polynomial():
    mesh = shapes.torus(16, 10)
    measured = measure_surface(mesh, "cotan", offset=0.1, offset_angle=3.0)
    assert measured.accuracy["offset_volume_error"] < 1e-4
    assert measured.results["offset"]["mesh_volume"] == pytest.approx(measured.offset.volume)
    assert measured.offset.mesh.topology.genus == 1


def test_a_spike_does_not_refine_the_arcs_of_other_edges():
    sphere = shapes.icosphere(2)
    points = sphere.points.copy()
    points[0] *= 4
    spike = sphere.moved(points)
    smooth, sharp = offset_body(sphere, 0.1).mesh, offset_body(spike, 0.1)
    assert sharp.mesh.n_faces < 3 * smooth.n_faces
    topology = sharp.mesh.topology
    assert topology.is_closed and topology.is_manifold and topology.is_oriented and topology.genus == 0
    assert measure_surface(spike, "cotan", offset=0.1).accuracy["offset_volume_error"] < 1e-4


def test_offsets_and_regions_that_do_not_exist_are_refused():
    with pytest.raises(MeshError, match="has 1 boundary loop "):
        offset_body(shapes.grid(3, 3), 0.1)
    with pytest.raises(ParameterError, match="positive length"):
        offset_body(CUBE, -1.0)
    with pytest.raises(ParameterError, match="90 degrees"):
        offset_body(CUBE, 1.0, 120.0)
    with pytest.raises(ParameterError, match="larger angle"):
        offset_body(CUBE, 1.0, 0.01)
    with pytest.raises(ParameterError, match="whole numbers"):
        labels_of(np.array([0.5, 1.0]))
    with pytest.raises(ParameterError, match="radius: must be a positive length"):
        measures_in_ball(CUBE, np.zeros(3), 0.0)
    with pytest.raises(ParameterError, match="array of length 5"):
        measure_surface(CUBE, "cotan", regions=[(np.zeros(5), "")])


def test_a_ball_that_misses_the_surface_warns_with_the_distance(caplog):
    cube = CUBE.moved(CUBE.points - CUBE.points.min(axis=0))
    side = cube.points.max()
    centre = np.array([-3.0, 0, 0])
    missed = measures_in_ball(cube, centre, 2.0)
    assert missed.phi_k == missed.phi_h == 0 and missed.area < 1e-13
    assert "holds no part of the surface; its nearest vertex is 3 from the centre" in caplog.text
    caplog.clear()
    assert measures_in_ball(cube, centre, 3.5).area > 0 and side > 0.5
    face = cube.points[cube.faces[0]].mean(axis=0)
    assert measures_in_ball(cube, face, 1e-6).area == pytest.approx(np.pi * 1e-12, rel=1e-9)  # in a face
    assert not caplog.records


@pytest.fixture
def cube(tmp_path):
    path = tmp_path / "cube.vtu"
    top = (CUBE.points[CUBE.faces].mean(axis=1)[:, 2] == CUBE.points[:, 2].max()).astype(np.int64)
    write_mesh(str(path), AnnotatedMesh(CUBE, face={"part": 10 + top}))
    return path


def test_the_command_measures_regions_by_array_file_and_ball(cube, summary, tmp_path):
    np.save(tmp_path / "label.npy", np.arange(CUBE.n_vertices) % 2)
    corner = ",".join(str(x) for x in CUBE.points.min(axis=0))
    regions = ("--region", "part", "--region", tmp_path / "label.npy", "--region", f"{corner}:0.2")
    report = summary("curvature", cube, *regions, "--vertex-vectors", "-o", tmp_path / "out.npz")
    regions = report["results"]["regions"]
    assert [entry.get("region") for entry in regions] == [10, 11, 0, 1, None]
    assert regions[0]["phi_k"] + regions[1]["phi_k"] == pytest.approx(4 * np.pi)
    assert regions[2]["on"] == "vertex" and regions[4]["phi_k"] == pytest.approx(np.pi / 2)
    assert report["accuracy"]["region_residual"] < 1e-13
    arrays = np.load(tmp_path / "out.npz")
    assert {"H_p", "volume_gradient", "h_p", "gradient_angle"} <= set(arrays)


def test_the_command_writes_the_offset_body(cube, summary, tmp_path):
    out = tmp_path / "offset.npz"
    report = summary("curvature", cube, "--offset", 0.5, "--offset-output", out, "--offset-angle", 10)
    offset = report["results"]["offset"]
    polynomial = report["results"]["steiner_polynomial"]
    assert offset["volume"] == pytest.approx(np.polyval(polynomial[::-1], 0.5))
    assert 0 < report["accuracy"]["offset_volume_error"] < 0.01
    arrays = np.load(out)
    assert len(arrays["faces"]) == offset["faces"] and set(arrays["part"]) == {0, 1, 2}


@pytest.mark.parametrize(
    "words, text",
    [
        (("--offset-output", "o.ply"), "--offset-output: belongs to --offset"),
        (("--offset-angle", 3), "belongs to --offset; give that too, or leave this out"),
        (("--region", "nothing"), "--region: no array 'nothing'"),
        (("--region", "0,0,0:-1"), "not greater than 0"),
        (("--offset", 0), "not greater than 0"),
    ],
)
def test_wrong_measure_options_end_in_one_line(cube, run, words, text):
    result = run("curvature", cube, *words)
    assert result.exit_code == 2 and text in result.stderr and len(result.stderr.strip().split("\n")) == 1


def test_an_offset_of_a_one_sided_surface_is_refused_without_a_repair_that_cannot_help():
    with pytest.raises(MeshError, match="one-sided and bounds no body$"):
        offset_body(TriangleMesh.from_arrays(*klein_bottle()), 0.1)
    with pytest.raises(MeshError, match="is a flat sheet, which encloses nothing; extrude it"):
        offset_body(shapes.grid(3, 3), 0.1)
