"""Shapes have the stated properties: closed, outward, of the right Euler characteristic."""

import numpy as np
import pytest

from ddgcli.algorithms.curvature.measures import angle_defect
from ddgcli.errors import ParameterError
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


@pytest.mark.parametrize(
    ("make", "parameter"),
    [
        (lambda: shapes.icosphere(-1), "subdivisions"),
        *((lambda r=r: shapes.icosphere(1, r), "radius") for r in (0.0, -1.0, np.inf, np.nan)),
        (lambda: shapes.grid(nx=0), "nx"),
        (lambda: shapes.grid(ny=0), "ny"),
        (lambda: shapes.grid(2, 2, 0), "width"),
        (lambda: shapes.grid(2, 2, height=-1), "height"),
        (lambda: shapes.torus(2, 6), "nu"),
        (lambda: shapes.torus(6, 2), "nv"),
        (lambda: shapes.torus(6, 6, np.inf), "major"),
        (lambda: shapes.torus(6, 6, minor=0), "minor"),
        (lambda: shapes.cylinder(2, 1), "nu"),
        (lambda: shapes.cylinder(3, 0), "nz"),
        (lambda: shapes.cylinder(3, 1, 0.0), "radius"),
        (lambda: shapes.cylinder(3, 1, height=np.inf), "height"),
        (lambda: shapes.box(1, 0, 1), "ny"),
        (lambda: shapes.box(size=(1.0, 0.0, 1.0)), "size"),
    ],
)
def test_shapes_without_extent_are_refused_by_the_name_of_the_parameter(make, parameter):
    with pytest.raises(ParameterError) as refused:
        make()
    assert refused.value.parameter == parameter


def test_the_least_periodic_shapes_are_manifold():
    for mesh, euler in ((shapes.torus(3, 3), 0), (shapes.cylinder(3, 1), 0)):
        assert mesh.topology.is_manifold and mesh.topology.euler_characteristic == euler
