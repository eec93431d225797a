"""`info` tells the truth about meshes whose truth is known."""

import numpy as np
import pytest

from ddgcli.algorithms.inspect import quality
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.repair import oriented
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


def test_torus(info):
    found = info(shapes.torus())
    assert found["input"]["genus"] == 1
    assert found["input"]["closed"] and found["input"]["oriented"] and found["input"]["manifold"]
    results = found["results"]
    assert results["orientation"] == "outward"
    assert results["nonmanifold_edges"] == results["duplicate_faces"] == results["coincident_vertices"] == 0
    assert results["accepts"]["delaunay"] == "yes"


def test_inward_and_mixed(info):
    sphere = shapes.icosphere(1)
    inward = TriangleMesh.from_arrays(sphere.points, sphere.faces[:, ::-1])
    assert info(inward)["results"]["orientation"] == "inward"
    both = TriangleMesh.from_arrays(
        np.concatenate([sphere.points, sphere.points + 5]),
        np.concatenate([sphere.faces, sphere.faces[:, ::-1] + len(sphere.points)]),
    )
    assert info(both)["results"]["orientation"] == "mixed"


def test_moebius_band_is_not_orientable(info):
    found = info(moebius())
    assert found["results"]["orientable"] is False
    assert found["input"]["genus"] is None
    assert found["input"]["boundary_loops"] == 1
    assert found["results"]["accepts"]["hodge"].startswith("no: ")


def test_turned_faces_are_inconsistent_but_orientable_and_can_be_turned_back(info):
    mesh = shapes.torus(12, 8)
    faces = mesh.faces.copy()
    turned = np.random.default_rng(0).random(len(faces)) < 0.3
    faces[turned] = faces[turned][:, ::-1]
    mixed = TriangleMesh.from_arrays(mesh.points, faces)
    found = info(mixed)
    assert found["results"]["orientation"] == "inconsistent" and found["results"]["orientable"]
    assert found["input"]["genus"] == 1
    mended, turn = oriented(mixed)
    assert mended.topology.is_oriented
    np.testing.assert_array_equal(turn, turned)


def test_angles_of_one_triangle(info):
    mesh = TriangleMesh.from_arrays(np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))
    measured = info(mesh)["results"]["quality"]
    assert measured["max_angle_degrees"] == pytest.approx(90)
    assert measured["min_angle_degrees"] == pytest.approx(np.degrees(np.arctan2(3, 4)))
    assert measured["needle_ratio_max"] == pytest.approx(5 / 3)
    inradius = 1.0  # area 6 over half perimeter 6
    assert measured["aspect_ratio_max"] == pytest.approx(5 / (2 * np.sqrt(3) * inradius))
    assert sum(measured["angle_histogram"]) == 3


@pytest.mark.parametrize("height", [1e-3, 1e-6, 1e-9])
def test_needle_angles_keep_their_digits(height):
    mesh = TriangleMesh.from_arrays(np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0]]), np.array([[0, 1, 2]]))
    assert quality.face_min_angle(mesh)[0] == pytest.approx(np.degrees(np.arctan(2 * height)), rel=1e-12)


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
    found = read_mesh(str(output))
    assert set(found.vertex) == {"component", "boundary", "non_manifold"}
    np.testing.assert_array_equal(found.vertex["component"], np.repeat([0, 1], 42))
    assert sorted(np.flatnonzero(found.vertex["boundary"])) == sorted(sphere.faces[0])
    assert found.face["min_angle_degrees"].min() > 50


def test_curves_and_tetrahedra(tmp_path, summary):
    square = tmp_path / "square.csv"
    square.write_text("x,y\n0,0\n1,0\n1,1\n0,1\n0,0\n")
    found = summary("info", square)
    assert found["input"] == {"path": str(square), "vertices": 4, "lines": 4, "components": 1, "closed": True}
    assert found["results"]["length"] == pytest.approx(4)
    assert found["results"]["accepts"]["curvature"] == "yes"
    assert found["results"]["accepts"]["geodesic"].startswith("no: ")
