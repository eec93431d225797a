"""A path whose last point repeats its first is a closed curve, in every format."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh

ANGLE = np.linspace(0.0, 2.0 * np.pi, 41)


def ring(centre, radius, gap=0.0):
    points = np.stack([centre + radius * np.cos(ANGLE), radius * np.sin(ANGLE), 0 * ANGLE], axis=1)
    points[-1] = points[0] + [gap, 0, 0]
    return points


@pytest.mark.parametrize("suffix", [".obj", ".vtp", ".vtu", ".ply", ".npz", ".vtk"])
def test_paths_that_end_where_they_begin_are_closed_and_keep_their_arrays(tmp_path, suffix):
    arc = np.array([[20.0, 0, 0], [21, 0, 0], [21, 1, 0]])
    curves = CurveSet.from_paths([ring(0, 1), arc, ring(9, 2)])
    number = np.arange(curves.n_vertices, dtype=float)
    path = str(tmp_path / f"curves{suffix}")
    write_mesh(path, AnnotatedMesh(curves, vertex={} if suffix == ".obj" else {"number": number}))
    source = read_mesh(path)
    assert sorted(is_closed for _, is_closed in source.mesh.paths) == [False, True, True]
    assert source.mesh.n_vertices == curves.n_vertices - 2
    assert np.array_equal(source.mesh.points[source.input_vertex], curves.points)
    if suffix != ".obj":
        assert np.array_equal(source.vertex["number"], np.delete(number, [40, 84]))


def test_a_gap_of_rounding_is_closed_with_a_warning_and_a_wider_one_is_not(tmp_path, summary):
    for gap, is_closed in ((1e-13, True), (1e-9, False)):
        path = str(tmp_path / "ring.obj")
        write_mesh(path, AnnotatedMesh(CurveSet.from_paths([ring(0, 1, gap)])))
        report = summary("info", path)
        assert report["input"]["closed"] == is_closed
        assert any("repeats its first to round-off" in text for text in report["warnings"]) == is_closed


def test_curvature_at_the_seam_is_that_of_the_other_points(tmp_path, summary):
    path, out = str(tmp_path / "ring.obj"), str(tmp_path / "out.npz")
    write_mesh(path, AnnotatedMesh(CurveSet.from_paths([ring(0, 2)])))
    summary("curvature", path, "-o", out)
    assert read_mesh(out).vertex["curvature"] == pytest.approx(np.full(40, 0.5), rel=2e-3)
