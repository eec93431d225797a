"""`info` reports known facts of meshes correctly."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.hardcases import meshes
from ddgcli.algorithms.inspection import quality
from ddgcli.geometry.unfolding import face_corner_angle
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.repair import oriented
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


@pytest.fixture
def info(tmp_path, summary):
    def call(mesh, *words):
        path = tmp_path / "mesh.npz"
        write_mesh(str(path), AnnotatedMesh(mesh))
        return summary("info", path, *words)

    return call


def moebius(n=20):
    t = 2 * np.pi * np.arange(n) / n
    ring = [
        np.stack(
            [(1 + s * np.cos(t / 2)) * np.cos(t), (1 + s * np.cos(t / 2)) * np.sin(t), s * np.sin(t / 2)], 1
        )
        for s in (-0.3, 0.3)
    ]
    i, j = np.arange(n), (np.arange(n) + 1) % n
    a, b, c, d = i, i + n, np.where(j == 0, n, j), np.where(j == 0, 0, j + n)
    return TriangleMesh.from_arrays(np.concatenate(ring), np.concatenate([np.c_[a, c, d], np.c_[a, d, b]]))


def test_a_sound_torus_has_no_defects(info):
    document = info(shapes.torus())
    assert document["input"]["genus"] == 1
    assert document["input"]["closed"] and document["input"]["oriented"] and document["input"]["manifold"]
    results = document["results"]
    assert results["orientation"] == "outward"
    assert results["nonmanifold_edges"] == results["duplicate_faces"] == results["coincident_vertices"] == 0
    assert results["accepts"]["delaunay"] == "yes"


def test_inward_and_mixed_orientations_are_reported(info):
    sphere = shapes.icosphere(1)
    inward = TriangleMesh.from_arrays(sphere.points, sphere.faces[:, ::-1])
    assert info(inward)["results"]["orientation"] == "inward"
    both = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, sphere.points + 5]),
        np.concatenate([sphere.faces, sphere.faces[:, ::-1] + len(sphere.points)]),
    )
    assert info(both)["results"]["orientation"] == "mixed"


def test_moebius_band_is_not_orientable(info):
    document = info(moebius())
    assert document["results"]["orientable"] is False
    assert document["input"]["genus"] is None
    assert document["input"]["boundary_loops"] == 1
    assert document["results"]["accepts"]["hodge"] == "yes"
    assert document["results"]["accepts"]["fluid-sim"].startswith("no: ")


def test_turned_faces_are_inconsistent_but_orientable_and_can_be_turned_back(info):
    mesh = shapes.torus(12, 8)
    faces = mesh.faces.copy()
    turned = np.random.default_rng(0).random(len(faces)) < 0.3
    faces[turned] = faces[turned][:, ::-1]
    mixed = TriangleMesh.from_arrays(mesh.points, faces)
    document = info(mixed)
    assert document["results"]["orientation"] == "inconsistent" and document["results"]["orientable"]
    assert document["input"]["genus"] == 1
    repaired, turn = oriented(mixed)
    assert repaired.topology.is_oriented
    np.testing.assert_array_equal(turn, turned)


def test_quality_of_the_3_4_5_triangle_is_exact(info):
    mesh = TriangleMesh.from_arrays(np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))
    measured = info(mesh)["results"]["quality"]
    assert measured["max_angle_degrees"] == pytest.approx(90)
    assert measured["min_angle_degrees"] == pytest.approx(np.degrees(np.arctan2(3, 4)))
    assert measured["needle_ratio_max"] == pytest.approx(5 / 3)
    inradius = 1.0  # area 6 over half perimeter 6
    assert measured["aspect_ratio_max"] == pytest.approx(5 / (2 * np.sqrt(3) * inradius))
    assert sum(measured["angle_histogram"]) == 3


def test_shapes_of_an_equilateral_an_obtuse_and_a_needle_triangle():
    corners = [[[0, 0], [2, 0], [1, np.sqrt(3)]], [[0, 0], [4, 0], [1, 0.5]], [[0, 0], [1, 0], [1, 0.05]]]
    points = np.column_stack([np.reshape(corners, (9, 2)), np.zeros(9)])
    mesh = TriangleMesh.from_arrays(points, np.arange(9).reshape(3, 3))
    measures = quality.triangle_quality(mesh, np.degrees(face_corner_angle(mesh)))
    aspect = [1.0]
    for triangle in np.array(corners[1:]):
        length = np.linalg.norm(np.roll(triangle, -1, axis=0) - triangle, axis=1)
        s = length.sum() / 2
        aspect.append(length.max() / (2 * np.sqrt(3) * np.sqrt(np.prod(s - length) / s)))  # Heron
    assert measures["aspect_ratio_max"] == pytest.approx(max(aspect))
    assert measures["aspect_ratio_median"] == pytest.approx(np.median(aspect))
    assert measures["needle_ratio_max"] == pytest.approx(np.hypot(1, 0.05) / 0.05)
    assert measures["faces_below_5_degrees"] == measures["faces_above_120_degrees"] == 1
    assert measures["mean_min_angle_degrees"] == pytest.approx(
        np.degrees(np.pi / 3 + np.arctan(0.5 / 3) + np.arctan(0.05)) / 3
    )


def test_size_of_a_box_away_from_the_origin():
    box = shapes.box(1, 1, 1, size=(1.0, 2.0, 3.0))
    measures = quality.surface_size(box.moved(box.points + [5.0, -7.0, 11.0]))
    np.testing.assert_allclose(measures["bounding_box"], [[5, -7, 11], [6, -5, 14]])
    assert measures["diagonal"] == pytest.approx(np.sqrt(14))
    assert measures["area"] == pytest.approx(22) and measures["volume"] == pytest.approx(6)
    assert measures["min_edge"] == pytest.approx(1) and measures["max_edge"] == pytest.approx(np.sqrt(13))
    half = TriangleMesh.from_arrays(box.points, box.faces[1:])
    turned = TriangleMesh.from_arrays(box.points, np.concatenate([box.faces[:1, ::-1], box.faces[1:]]))
    assert "volume" not in quality.surface_size(half) and "volume" not in quality.surface_size(turned)


def test_inverted_flat_and_duplicate_tetrahedra_are_counted():
    """Four cells on one face, the first of them regular and listed twice; and a flat cell, listed twice."""
    points = np.array(
        [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [-3, -3, -3], [1, 1, -1.0], [1, 0, 0], [9, 9, 9]]
    )
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [1, 2, 3, 5], [0, 1, 6, 5], [3, 2, 1, 0], [0, 1, 5, 6]])
    mesh = TetMesh.from_arrays(points, cells)
    measures = quality.tetrahedra_quality(mesh)
    sign = np.sign([np.linalg.det(points[c[1:]] - points[c[0]]) for c in cells])
    assert measures["inverted_tetrahedra"] == (sign < 0).sum() and measures["flat_tetrahedra"] == 2
    assert measures["flat_tetrahedra_first"] == [3, 5] and measures["duplicate_tetrahedra_first"] == [4, 5]
    assert measures["unreferenced_vertices_first"] == [7]
    assert measures["faces_with_three_or_more_cells"] == 1  # all others have two cells at most
    regular = quality.dihedral_degrees(mesh)[0]
    np.testing.assert_allclose(regular, np.degrees(np.arccos(1 / 3)))
    only = quality.tetrahedra_quality(TetMesh.from_arrays(points * 1e-9, cells[:1]))
    assert only["volume"] == pytest.approx(8 / 3 * 1e-27)
    assert only["min_dihedral_degrees"] == pytest.approx(np.degrees(np.arccos(1 / 3)))


@pytest.mark.parametrize("height", [1e-3, 1e-6, 1e-9])
def test_needle_angles_keep_their_digits(height):
    mesh = TriangleMesh.from_arrays(np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0]]), np.array([[0, 1, 2]]))
    angle = np.degrees(face_corner_angle(mesh))
    assert quality.face_min_angle(mesh, angle)[0] == pytest.approx(
        np.degrees(np.arctan(2 * height)), rel=1e-12
    )


def test_scale_does_not_matter(info):
    mesh = shapes.torus(12, 8)
    plain = info(mesh)["results"]["quality"]
    for factor in (1e-8, 1e8):
        scaled = info(mesh.moved(mesh.points * factor))["results"]["quality"]
        for name, value in plain.items():
            assert scaled[name] == pytest.approx(value, rel=1e-9), name


def test_defects_are_counted_and_named(info):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [7, 7, 7], [2, 0, 0]])
    faces = np.array([[0, 1, 2], [2, 1, 0], [0, 1, 3], [0, 1, 4], [0, 1, 6], [2, 2, 3]])
    results = info(TriangleMesh.from_arrays(points, faces))["results"]
    assert results["duplicate_faces"] == 1 and results["duplicate_faces_first"] == [1]
    assert results["unreferenced_vertices"] == 1 and results["unreferenced_vertices_first"] == [5]
    assert results["coincident_vertices"] == 1 and results["coincident_vertices_first"] == [4]
    assert results["degenerate_faces"] == 2 and results["degenerate_faces_first"] == [4, 5]
    assert results["repeated_index_faces"] == 1
    assert [0, 1] in results["nonmanifold_edges_first"]


def test_output_shows_where(info, tmp_path):
    sphere = shapes.icosphere(1)
    both = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, sphere.points + 5]),
        np.concatenate([sphere.faces[1:], sphere.faces + 42]),
    )
    output = tmp_path / "out.vtu"
    info(both, "-o", output)
    annotated = read_mesh(str(output))
    assert set(annotated.vertex) == {"component", "boundary", "non_manifold"}
    np.testing.assert_array_equal(annotated.vertex["component"], np.repeat([0, 1], 42))
    assert sorted(np.flatnonzero(annotated.vertex["boundary"])) == sorted(sphere.faces[0])
    assert annotated.face["min_angle_degrees"].min() > 50


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
def test_crossing_faces_are_counted_and_marked_on_request_at_any_scale(info, tmp_path, scale):
    sphere, shift = shapes.icosphere(3), [1.0, 0.02, 0.03]
    both = TriangleMesh.from_arrays(
        scale * np.concatenate([sphere.points, np.asarray(sphere.points) + shift]),
        np.concatenate([sphere.faces, sphere.faces + sphere.n_vertices]),
    )
    results = info(both, "--self-intersections", "-o", tmp_path / "out.npz")["results"]
    marked = np.flatnonzero(read_mesh(str(tmp_path / "out.npz")).face["self_intersecting"])
    # the faces on the circle in which the spheres meet: its plane bisects the shift
    height = (np.asarray(both.points) / scale - np.array(shift) / 2) @ shift
    across = np.ptp(np.sign(height[both.faces]), axis=1) > 0
    # along the circle each crossing ends where it leaves one of its faces, and each face is left once
    assert 100 < len(marked) == results["self_intersections"]
    assert across[marked].mean() > 0.9 and across.sum() < 1.2 * len(marked)
    assert len(results["self_intersections_first"]) == 5
    assert info(sphere, "--self-intersections")["results"]["self_intersections"] == 0
    assert "self_intersections" not in info(both)["results"]


@pytest.mark.parametrize("words", [(), ("--dry-run",)])
def test_self_intersections_of_tetrahedra_are_refused(run, tmp_path, words):
    write_mesh(str(tmp_path / "box.npz"), AnnotatedMesh(shapes.box_tetrahedra(1, 1, 1)))
    refused = run("info", tmp_path / "box.npz", "--self-intersections", *words)
    assert refused.exit_code == 2 and "needs a surface, and the input holds tetrahedra" in refused.stderr


def test_curves_and_tetrahedra_have_their_own_facts(tmp_path, summary):
    square = tmp_path / "square.csv"
    square.write_text("x,y\n0,0\n1,0\n1,1\n0,1\n0,0\n")
    document = summary("info", square)
    assert document["input"] == {
        "path": str(square),
        "vertices": 4,
        "lines": 4,
        "components": 1,
        "closed": True,
    }
    assert document["results"]["length"] == pytest.approx(4)
    assert document["results"]["accepts"]["curvature"] == "yes"
    assert document["results"]["accepts"]["geodesic"].startswith("no: ")


def test_arrays_mark_components_and_ends_of_curves():
    points = np.column_stack([np.arange(8.0), np.arange(8.0) ** 2, np.zeros(8)])
    open_and_closed = CurveSet(points, np.array([[0, 1], [1, 2], [4, 5], [5, 6], [6, 4]]))
    marks = quality.curve_marks(open_and_closed)
    assert marks["component"].tolist() == [0, 0, 0, -1, 1, 1, 1, -1]
    assert marks["boundary"].tolist() == [1, 0, 1, 0, 0, 0, 0, 0]
    assert quality.curve_quality(open_and_closed)["unreferenced_vertices"] == 2


@pytest.mark.parametrize("name", ["ball.vtu", "ellipse.csv", "torus.ply"])
def test_every_kind_has_a_picture(summary, tmp_path, name):
    document = summary(
        "info", Path(__file__).parents[2] / "sample_meshes" / name, "--plot", tmp_path / "a.png"
    )
    assert document["warnings"] == [] and (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.parametrize("scale", [2.0**-450, 2.0**450])
def test_the_area_far_from_the_origin_is_that_of_the_stored_positions(scale):
    box = shapes.box(1, 1, 1, size=(1.0, 2.0, 3.0))
    far = box.moved((box.points + np.array([1.0, -3.0, 5.0]) * 2**49) * scale)  # 2^49 + 3 is a float64
    assert quality.surface_size(far)["area"] == 22.0 * scale**2


def test_area_of_caps_does_not_lose_digits_to_their_side_lengths():
    points, faces = meshes.caps(1e8)
    area = quality.surface_size(TriangleMesh.from_arrays(points, faces))["area"]
    assert area == pytest.approx(meshes.truths_of(points, faces).area, rel=1e-13)


@pytest.mark.parametrize("name", ["ball.vtu", "torus.ply"])
def test_the_page_of_info_has_every_key_of_its_results(summary, name):
    root = Path(__file__).parents[2]
    page = (root / "docs" / "info.md").read_text(encoding="utf-8")
    keys = [key for key in summary("info", root / "sample_meshes" / name)["results"] if "first" not in key]
    assert len(keys) > 10 and [key for key in keys if f"`{key}`" not in page] == []
