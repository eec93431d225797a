"""Shapes have the stated properties: closed, outward, of the right Euler characteristic."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.measures import angle_defect
from ddgcli.geometry.extrinsic import dihedral_angle, enclosed_volume
from ddgcli.mesh import shapes

CLOSED_SHAPES = {
    "icosphere": (shapes.icosphere(2), 2),
    "random_sphere": (shapes.random_sphere(200), 2),
    "torus": (shapes.torus(16, 8), 0),
    "box": (shapes.box(2, 3, 4), 2),
}
OPEN = {
    "grid": (shapes.grid(4, 5, pattern="alternating"), 1),
    "cylinder": (shapes.cylinder(8, 3), 0),
    "catenoid": (shapes.catenoid(8, 6), 0),
}


@pytest.mark.parametrize("name", CLOSED_SHAPES)
def test_closed_shapes_are_outward_manifolds_of_their_genus(name):
    mesh, euler = CLOSED_SHAPES[name]
    topology = mesh.topology
    assert topology.is_closed and topology.is_manifold and topology.is_oriented
    assert topology.euler_characteristic == euler
    assert enclosed_volume(mesh) > 0


@pytest.mark.parametrize("name", CLOSED_SHAPES | OPEN)
def test_angle_defects_of_closed_shapes_sum_to_2_pi_chi(name):
    mesh, euler = (CLOSED_SHAPES | OPEN)[name]
    assert mesh.topology.euler_characteristic == euler
    assert angle_defect(mesh).sum() == pytest.approx(2 * np.pi * euler, abs=1e-11)


def test_box_dihedral_angles_are_right_angles_on_its_twelve_edges():
    mesh = shapes.box(1, 1, 1)
    angle = dihedral_angle(mesh)
    assert np.sum(np.isclose(angle, np.pi / 2)) == 12
    assert np.sum(np.isclose(angle, 0)) == 6
