"""The same motion at every size: a copy of a scene with all lengths and forces scaled moves alike."""

from functools import cache

import numpy as np
import pytest

from tests.simulate import shell_run

# lengths l: accelerations l, membrane stiffness l^2 and rigidity l^4 times the mass per area
SCENE = """
[time]
duration = 0.05
step = {step}
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [{l}, {l}], cells = [3, 3] }}
density = 2
thickness = {thickness}
young = {young}
poisson = 0.3
velocity = [{l}, 0, 0]
angular_velocity = [0, 8, 3]
[[object]]
name = "floor"
role = "obstacle"
plane = {{ point = [0, 0, {floor}] }}
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
gravity = {{ acceleration = [0, 0, {gravity}] }}
contact = {{ pairs = [["s", "floor"]], friction = 0.3, gap = {gap}, slip = {slip}, stiffness = {press} }}
pin = {{ vertices = [0] }}
"""


@cache
def ends(size, integrator, bending):
    step = 2e-3 if integrator in ("newmark", "implicit-euler", "bdf2") else 2e-4
    text = SCENE.format(
        l=size, thickness=2e-3 * size, young=1e6 * size, floor=-0.2 * size, gravity=-9.81 * size,
        gap=0.05 * size, slip=1e-2 * size, press=2e3 * size, integrator=integrator,
        bending=bending, step=step,
    )  # fmt: skip
    snapshots, _, _ = shell_run(text)
    return np.array([snapshot.observations["s"].points for snapshot in snapshots]) / size


@pytest.mark.parametrize("size", [1e-6, 1e6])
@pytest.mark.parametrize("integrator, bending", [
    ("implicit-euler", "hinge"), ("newmark", "midedge"), ("avi", "hinge")
])  # fmt: skip
def test_copies_of_a_millionth_and_a_million_times_the_size_move_alike(size, integrator, bending):
    base, copy = ends(1.0, integrator, bending), ends(size, integrator, bending)
    assert np.abs(base[-1] - base[0]).max() > 0.02
    assert np.abs(copy - base).max() < 1e-6


ONE = """
[time]
duration = 0.5
step = 0.01
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
mesh = "one"
density = 1
thickness = "1 mm"
young = 1e6
poisson = 0.3
angular_velocity = [0, 0, 3]
[effects]
stretching = {{}}
bending = {{}}
"""


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint", "bdf2", "avi"])
def test_a_shell_of_one_triangle_turns_on(integrator):
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    triangle = TriangleMesh.from_arrays(np.eye(3)[:, [1, 2, 0]] * [1, 0.8, 0], np.array([[0, 1, 2]]))
    snapshots, _, _ = shell_run(ONE.format(integrator=integrator), lambda n: MeshInput(triangle, n))
    points = snapshots[-1].observations["s"].points
    centre = points.mean(axis=0)
    assert np.abs(centre - np.asarray(triangle.points).mean(axis=0)).max() < 1e-9
    side = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    rest = np.linalg.norm(triangle.points - np.roll(triangle.points, 1, axis=0), axis=1)
    assert np.abs(side / rest - 1).max() < 0.01
    turned = np.arctan2(*(points[0] - centre)[[1, 0]]) - np.arctan2(
        *(np.asarray(triangle.points)[0] - centre)[[1, 0]]
    )
    assert abs((turned - 1.5 + np.pi) % (2 * np.pi) - np.pi) < 0.02
