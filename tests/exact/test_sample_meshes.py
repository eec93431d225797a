"""The samples are what their README states, and their script reproduces them byte for byte."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipe

from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import read_mesh

FOLDER = Path(__file__).parents[2] / "sample_meshes"
FILES = sorted(p.name for p in FOLDER.iterdir() if p.suffix not in (".py", ".md"))
# name -> vertices' Euler characteristic, boundary loops, area, volume
SURFACES = {
    "sphere.ply": (2, 0, 4 * np.pi, 4 * np.pi / 3),
    "ellipsoid.ply": (2, 0, 48.882, 8 * np.pi),
    "torus.ply": (0, 0, 4 * np.pi**2 * 0.4, 2 * np.pi**2 * 0.16),
    "bad_torus.ply": (0, 0, 4 * np.pi**2 * 0.4, 2 * np.pi**2 * 0.16),
    "catenoid.off": (0, 2, np.pi * (2 + np.sinh(2)), None),
    "saddle.obj": (1, 1, None, None),
    "cylinder.ply": (0, 2, 4 * np.pi, None),
    "cube.obj": (2, 0, 6, 1),
    "frame.off": (-8, 0, None, None),
    "hat.ply": (1, 1, None, None),
    "cap.ply": (1, 1, None, None),
}


def test_the_script_writes_these_bytes(tmp_path):
    subprocess.run([sys.executable, str(FOLDER / "make.py"), str(tmp_path)], check=True, cwd=FOLDER.parent)
    assert sorted(p.name for p in tmp_path.iterdir()) == FILES
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes(), name


def test_under_five_megabytes_and_described():
    assert sum(p.stat().st_size for p in FOLDER.iterdir()) < 5e6
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in readme for name in FILES)
    assert set(SURFACES) | {"ball.vtu", "trefoil.obj", "ellipse.csv"} == set(FILES)


@pytest.mark.parametrize("name", SURFACES)
def test_sample_surfaces_have_their_topology_area_and_volume(name):
    euler, loops, area, volume = SURFACES[name]
    mesh = read_mesh(str(FOLDER / name)).mesh
    topology = mesh.topology
    assert topology.is_manifold and topology.is_oriented and topology.n_components == 1
    assert (topology.euler_characteristic, topology.boundary_loops) == (euler, loops)
    tolerance = 0.02 if name == "bad_torus.ply" else 0.006
    if area is not None:
        assert face_area(mesh.side_length).sum() == pytest.approx(area, rel=tolerance)
    if volume is not None:
        assert enclosed_volume(mesh) == pytest.approx(volume, rel=tolerance)


def test_hat_faces_up():
    mesh = read_mesh(str(FOLDER / "hat.ply")).mesh
    top = mesh.points[mesh.faces[0]]
    assert np.cross(top[1] - top[0], top[2] - top[0])[2] > 0


def test_the_sample_ball_has_positive_cells_and_its_volume():
    mesh = read_mesh(str(FOLDER / "ball.vtu")).mesh
    assert (mesh.signed_volume > 0).all()
    assert mesh.signed_volume.sum() == pytest.approx(4 * np.pi / 3, rel=0.02)
    assert mesh.boundary.topology.euler_characteristic == 2


@pytest.mark.parametrize("name, length", [("ellipse.csv", 8 * ellipe(0.75)), ("trefoil.obj", None)])
def test_sample_curves_are_closed_with_their_length(name, length):
    curves = read_mesh(str(FOLDER / name)).mesh
    ((path, closed),) = curves.paths
    assert closed and len(path) == curves.n_vertices
    assert curves.planar == (name == "ellipse.csv")
    if length is not None:
        segment = np.diff(curves.points[np.append(path, path[0])], axis=0)
        assert np.linalg.norm(segment, axis=1).sum() == pytest.approx(length, rel=1e-3)
