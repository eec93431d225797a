"""Discrete conformal maps of hard public meshes: angle sums to 1e-10, bijective overlays."""

import numpy as np
import pytest

from ddgcli.algorithms.conformal.conformal_map import conformal_map
from ddgcli.io.mesh_file import read_mesh
from tests.exact.test_conformal_maps import far_vertices

# a disk with fingers; long limbs; genus 12 with 20k vertices; 50k vertices and angles of 0.01 degrees
QUICK = ("hand_lowres.obj", "penguin_control_mesh.obj", "spot_control_mesh.obj")
LARGE = ("boot.obj", "koala.obj", "blub_triangulated.obj")


def mapped(path):
    mesh = read_mesh(str(path)).surface
    topology = mesh.topology
    euler = topology.euler_characteristic
    if not topology.is_closed or euler == 0:
        return conformal_map(mesh)
    k = 4 if euler > 0 else -2 * euler
    return conformal_map(mesh, cones=dict.fromkeys(far_vertices(mesh, k), 360.0 - 360.0 * euler / k))


def check(path):
    flat = mapped(path)
    assert flat.converged and flat.metric.residual < 1e-10 and flat.metric.triangulation.flips > 0, path
    total = np.zeros(flat.mesh.n_vertices)
    a, b, c = flat.flat.side_length.T
    for k, (x, y, z) in enumerate(((a, c, b), (b, a, c), (c, b, a))):
        np.add.at(
            total, flat.flat.faces[:, k], np.arccos(np.clip((x * x + y * y - z * z) / (2 * x * y), -1, 1))
        )
    free = ~flat.mesh.topology.boundary_vertex
    assert (
        np.abs(total - flat.metric.angle)[free].max() < 1e-7
    )  # the cosine rule loses digits on thin triangles
    opened = flat.overlay()
    area, before = (m.side_length.size and _area(m) for m in (opened.mesh, flat.mesh))
    assert area == pytest.approx(before, rel=1e-9), path
    assert np.isfinite(opened.vertex["uv"]).all()


def _area(mesh):
    p = mesh.points[mesh.faces]
    return 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum()


@pytest.mark.parametrize("name", QUICK)
def test_angle_sums_are_prescribed_on_hard_meshes(shared_meshes, name):
    check(shared_meshes / name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_angle_sums_are_prescribed_on_large_meshes(shared_meshes, name):
    check(shared_meshes / name)
