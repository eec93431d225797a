"""Contact over long runs: a knot that is pulled tight, boxes that rest on each other."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.physics.test_shell_pairs import obstacle, points_by_frame, scene
from tests.simulate import scalar, shell_run
from tests.triangle_pairs import meshes_intersect

pytest.importorskip("ipctk")

PULLED = 0.95  # of its length, between the ends of the knot
KNOT = """
[time]
duration = 0.8
step = 4e-3
frame_every = 8e-3
integrator = "implicit-euler"
[[object]]
name = "s"
role = "shell"
mesh = "knot"
density = 1.0
thickness = "1 mm"
young = 1e6
poisson = 0.3
[effects]
stretching = {{}}
bending = {{ stiffness = 1e-6, rest = "flat" }}
damping = {{ mass = 5 }}
contact = {{ self_contact = true, friction = 0.1 }}
[[effects.handle]]
name = "left"
vertices = [0, 1]
times = [0, 0.8]
positions = [[0, 0, 0], {left}]
interpolation = "linear"
[[effects.handle]]
name = "right"
vertices = [{last}, {end}]
times = [0, 0.8]
positions = [[0, 0, 0], {right}]
interpolation = "linear"
"""


def open_trefoil(count, width):
    """(mesh, length) of a narrow ribbon along Shastri's open trefoil (t^3 - 3t, t^4 - 4t^2, t^5 - 10t)."""
    fine = np.linspace(-2.1, 2.1, 4001)
    curve = 0.05 * np.stack([fine**3 - 3 * fine, fine**4 - 4 * fine**2, 0.2 * (fine**5 - 10 * fine)], axis=1)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0, arc[-1], count + 1)
    points = np.stack([np.interp(even, arc, column) for column in curve.T], axis=1)
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    across = [np.array([0.0, 0.0, 1.0])]
    for direction in tangent:
        next_across = across[-1] - direction * (direction @ across[-1])
        across.append(next_across / np.linalg.norm(next_across))
    side = 0.5 * width * np.array(across[1:])
    vertices = np.stack([points - side, points + side], axis=1).reshape(-1, 3)
    k = 2 * np.arange(count)[:, None]
    faces = np.concatenate([k + [0, 2, 1], k + [1, 2, 3]])
    return TriangleMesh.from_arrays(vertices, faces), float(arc[-1])


def pulled(x, length, part_of_length=PULLED):
    """The scene in which the ends of a knot move apart along the line between them."""
    between = x[:2].mean(axis=0) - x[-2:].mean(axis=0)
    move = 0.5 * between * (part_of_length * length / np.linalg.norm(between) - 1)
    return KNOT.format(left=move.tolist(), right=(-move).tolist(), last=len(x) - 2, end=len(x) - 1)


@pytest.mark.slow
def test_a_knot_pulled_tight_never_passes_through_itself():
    mesh, length = open_trefoil(70, 0.008)
    x = np.asarray(mesh.points)
    snapshots, _, _ = shell_run(pulled(x, length), lambda name: MeshInput(mesh, name))
    faces = np.asarray(mesh.faces)
    for points in points_by_frame(snapshots, "s"):
        assert not meshes_intersect(points, faces, points, faces)
    force = np.linalg.norm(scalar(snapshots, "reaction_force_left"), axis=1)
    assert force[-1] > 8 * np.median(force[10:60])  # it is tight
    z = points_by_frame(snapshots, "s")[-1]
    assert np.linalg.norm(z[0] - z[-1]) < 0.97 * length  # and not a straight ribbon


@pytest.mark.slow
def test_three_boxes_on_each_other_rest_for_ten_seconds_within_the_creep_of_friction():
    """Friction is proportional to the speed below `slip`: by default that is 1e-4 of a box in 10 s.

    The creep is that of the law: with steps of 20 and 50 ms it is the same within 1e-9 m.
    """
    seconds, size = 10.0, 0.1
    boxes = [
        f'[[object]]\nname = "b{k}"\nrole = "shell"\nbox = {{ size = [0.1, 0.1, 0.1], cells = [1, 1, 1] }}\n'
        f'density = 5.0\nthickness = "5 mm"\nyoung = 1e7\npoisson = 0.3\n'
        f"position = [0, 0, {0.004 + 0.104 * k}]\n"
        for k in range(3)
    ]
    text = scene(
        f'duration = {seconds}\nstep = 5e-2\nframe_every = 0.5\nintegrator = "implicit-euler"\n',
        *boxes, obstacle("plane = {}"),
        effects="gravity = {}\ncontact = { pairs = "
        '[["b0", "o"], ["b0", "b1"], ["b1", "b2"]], friction = 0.5 }\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    for name in contexts:
        path = points_by_frame(snapshots, name)
        assert max(np.abs(points - path[4]).max() for points in path[4:]) < 1e-4 * size
        assert np.abs(snapshots[-1].observations[name].vertex["velocity"]).max() < 1e-5 * size
