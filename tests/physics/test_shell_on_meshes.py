"""Contact with mesh obstacles does not depend on how large or how coarse their faces are."""

import logging

import numpy as np
import pytest

from ddgcli.geometry.surface_points import largest_distance, nearest_points
from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.shapes import icosphere
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.simulate import shell_run

SCENE = """
[time]
integrator = "newmark"
duration = {duration}
step = {step}
frame_every = {step}
[[object]]
name = "s"
role = "shell"
grid = {{ size = [{side}, {side}], cells = [4, 4] }}
position = [{x}, {x}, {z}]
young = {young}
poisson = 0.3
thickness = {thickness}
density = {density}
[[object]]
name = "floor"
role = "obstacle"
{floor}
[effects]
stretching = {{}}
bending = {{}}
gravity = {{ acceleration = [0, 0, {gravity}] }}
contact = {{ pairs = [["s", "floor"]] }}
"""
PLANE = "plane = { point = [0, 0, 0], normal = [0, 0, 1] }"


def run(floor, read=None, unit=1.0, z=1.8e-3, duration=0.02):
    """A sheet of 0.1 m above a floor; `unit` is the number of units of length in a metre."""
    text = SCENE.format(
        floor=floor, side=0.1 * unit, x=-0.05 * unit, z=z * unit, young=1e6 / unit, thickness=2e-3 * unit,
        density=1 / unit**2, gravity=-9.81 * unit, duration=duration, step=2.5e-3,
    )  # fmt: skip
    snapshots = shell_run(text, read) if read else shell_run(text)
    return [snapshot.observations["s"] for snapshot in snapshots[0]]


def square(width):
    """Two triangles, whose diagonal passes below the sheet."""
    w = 0.5 * width
    points = [[-w, -w, 0], [w, -w, 0], [w, w, 0], [-w, w, 0]]
    return TriangleMesh.from_arrays(points, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("width", [0.2, 2.0, 200.0])
def test_a_shell_on_a_large_floor_of_two_triangles_stays_there(width):
    """Once the stiffness grew with the size of the floor, and the weights with that of its faces: 310 mm."""
    pytest.importorskip("ipctk")
    observations = run('mesh = "floor.obj"', lambda name: MeshInput(square(width), name))
    plane = run(PLANE)
    assert max(o.points[:, 2].max() for o in observations) < 1.9e-3
    stored = [start.scalar["energy_contact"] for start in (observations[0], plane[0])]
    assert 0.3 < stored[0] / stored[1] < 4.0


@pytest.mark.parametrize("falls", [False, True])
def test_contact_does_not_depend_on_the_unit_of_length(falls):
    """Once its stiffness took g = 9.81 whatever the scene's gravity."""
    one, other = (run(PLANE, unit=unit, z=2.5e-3 if falls else 1.8e-3)[-1] for unit in (1.0, 1000.0))
    assert np.abs(other.points / 1000 - one.points).max() < 1e-9


def test_a_shell_that_nearly_touches_a_mesh_warns(caplog):
    pytest.importorskip("ipctk")
    with caplog.at_level(logging.WARNING):
        run('mesh = "floor.obj"', lambda name: MeshInput(square(2.0), name), z=1e-4, duration=2.5e-3)
    assert "'s' and 'floor' start 0.0001 m apart, within the gap of 0.002 m" in caplog.text


def test_the_largest_distance_from_a_surface_is_that_of_all_positions():
    positions = np.random.default_rng(0).normal(size=(200, 3))
    for mesh in (icosphere(0), icosphere(2), square(3.0)):
        assert largest_distance(mesh, positions) == nearest_points(mesh, positions)[1].max()
