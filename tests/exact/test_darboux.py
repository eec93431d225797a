"""Darboux frames, normal curvature and geodesic torsion of curves on surfaces."""

import numpy as np
import pytest
from matplotlib.image import imread

from ddgcli.algorithms.geodesics.darboux import add_darboux_frames
from ddgcli.algorithms.geodesics.edge_curves import edge_curves
from ddgcli.algorithms.geodesics.surface_curves import trace_curves
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.plots.glyphs import FRAME_SPACING, frame_arrows


def traced(mesh, face, direction, length):
    return trace_curves(mesh, [face], [[0.3, 0.3, 0.4]], [direction], [length])


def test_the_normal_curvature_of_a_sphere_converges_with_order_two():
    errors = []
    for level in (3, 4, 5):
        mesh = shapes.icosphere(level, radius=2.0)
        curves = add_darboux_frames(mesh, traced(mesh, 7, [1, 0.3, 0.2], 5.0))
        errors.append(np.abs(curves.arrays["normal_curvature"] - 0.5).max())
        assert np.abs(curves.arrays["geodesic_torsion"]).max() < 1e-11, "radial normals do not twist"
    assert errors[0] < 0.01 and np.log2(errors[0] / errors[-1]) > 2 * 1.7


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.1, np.pi / 2])
def test_curvature_and_torsion_of_a_line_on_a_cylinder_follow_euler(angle):
    mesh = shapes.cylinder(96, 96, radius=0.5, height=2.0)
    centroid = mesh.points[mesh.faces].mean(axis=1)
    face = int(np.argmin(np.linalg.norm(centroid - (mesh.points.mean(axis=0) + [0.5, 0, 0]), axis=1)))
    direction = [0, np.cos(angle), np.sin(angle)]
    curves = add_darboux_frames(mesh, traced(mesh, face, direction, 0.6))
    inner = slice(2, -2)
    curvature, torsion = (curves.arrays[n][inner] for n in ("normal_curvature", "geodesic_torsion"))
    assert np.abs(curvature - 2 * np.cos(angle) ** 2).max() < 0.03
    assert np.abs(np.abs(torsion) - 2 * np.cos(angle) * np.sin(angle)).max() < 0.03


def test_a_helix_to_the_right_and_one_to_the_left_have_opposite_geodesic_torsion():
    mesh = shapes.cylinder(96, 96, radius=0.5, height=2.0)
    centroid = mesh.points[mesh.faces].mean(axis=1)
    face = int(np.argmin(np.linalg.norm(centroid - (mesh.points.mean(axis=0) + [0.5, 0, 0]), axis=1)))
    right, left = (
        add_darboux_frames(mesh, traced(mesh, face, [0, 1, s], 0.5)).arrays["geodesic_torsion"][2:-2]
        for s in (1, -1)
    )
    # on a helix, a geodesic of the cylinder, it is the torsion: positive for a right-handed one
    assert (right > 0.9).all() and (left < -0.9).all()


def test_frames_are_orthonormal_and_the_conormal_points_left():
    mesh = shapes.torus(24, 12)
    curves = add_darboux_frames(mesh, edge_curves(mesh, [[0, 12, 24, 37, 50, 5]]))
    names = ("darboux_tangent", "darboux_conormal", "darboux_normal")
    darboux_frame = np.stack([curves.arrays[name] for name in names], axis=1)
    assert np.abs(darboux_frame @ darboux_frame.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.abs(np.linalg.det(darboux_frame) - 1).max() < 1e-12


def test_the_command_writes_darboux_frames(tmp_path, summary, run):
    path = tmp_path / "sphere.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(3)))
    out = tmp_path / "path.npz"
    summary("geodesic", path, "--source", 0, "--path-to", 50, "--darboux", "--paths-output", out)
    arrays = np.load(out)
    assert np.abs(arrays["normal_curvature"] - 1).max() < 0.1 and arrays["darboux_normal"].shape[1] == 3
    result = run("geodesic", path, "--source", 0, "--darboux")
    assert result.exit_code == 2 and "--darboux: has no curves" in result.stderr


def test_the_picture_has_the_frames_of_the_curves(tmp_path, summary):
    path = tmp_path / "sphere.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(2)))
    words = ("geodesic", path, "--source", 0, "--path-to", 50, "--size", "600x500", "--plot")
    painted = []
    for name, more in (("with.png", ["--darboux"]), ("without.png", [])):
        summary(*words, tmp_path / name, *more)
        colours = imread(tmp_path / name)[..., :3].reshape(-1, 3).astype(float)
        other = np.stack([np.delete(colours, k, axis=1).max(axis=1) for k in range(3)], axis=1)
        pure = (colours - other > 0.4).T
        painted.append([int(mask.sum()) for mask in pure])
    assert (np.subtract(*painted) > 50).all()


def test_frames_stand_at_equal_distances_and_at_both_ends():
    points = np.stack([np.linspace(0, 1, 101), np.zeros(101), np.zeros(101)], axis=1)
    normal = np.tile([0.0, 0.0, 1.0], (101, 1))
    (arrows,) = frame_arrows(points, np.array([0, 101]), 1.0, {"blue": normal})
    places = arrows.places[:, 0]
    assert places[0] == 0 and places[-1] == 1 and np.ptp(np.diff(places)) < 0.011
    assert np.diff(places).min() >= FRAME_SPACING and arrows.vectors.shape == arrows.places.shape
