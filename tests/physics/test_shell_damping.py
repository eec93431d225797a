"""Damping by stiffness leaves the turning of a body alone, in steps of any length that resolves it."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.simulate import scalar, shell_run

# an equilateral triangle of circumradius 1 m that turns at 1 rad/s, the strain of its spin 0.04
DENSITY, THICKNESS, POISSON, STRAIN = 2.0, 1e-3, 0.3, 0.04
YOUNG = DENSITY * (1 - POISSON) / (2 * THICKNESS * STRAIN)
BREATHING = STRAIN**-0.5  # rad/s, the frequency of its size; damped critically
SCENE = f"""
[time]
integrator = "{{integrator}}"
step = {{step}}
duration = 5
[[object]]
name = "s"
role = "shell"
mesh = "triangle.obj"
density = {DENSITY}
thickness = {THICKNESS}
young = {YOUNG}
poisson = {POISSON}
angular_velocity = [0, 0, 1]
[effects]
stretching = {{{{}}}}
damping = {{{{ stiffness = {2 / BREATHING} }}}}
"""


def triangle(name):
    angle = 2 * np.pi / 3 * np.arange(3)
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return MeshInput(TriangleMesh.from_arrays(points, np.array([[0, 1, 2]])), name)


def errors(integrator, step):
    """Of the Green strain at the end, beside the closed form for its speed then, and of the momentum."""
    run, _, _ = shell_run(SCENE.format(integrator=integrator, step=step), triangle)
    x = run[-1].observations["s"].points
    square = float(np.sum(x**2)) / 3
    spin = np.array(scalar(run, "angular_momentum"))[:, 2]
    speed = spin[-1] / (spin[0] * square)  # the moment of inertia grows with the square of the size
    # pull and inertia: 4 (lambda + mu) t A e = M w^2 r^2, lambda + mu = E / (2 (1 - nu))
    return abs(0.5 * (square - 1) / (STRAIN * speed**2) - 1), abs(spin[-1] / spin[0] - 1)


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint", "bdf2"])
def test_a_body_that_spins_has_the_size_of_its_centrifugal_force_in_second_order(integrator):
    coarse, fine = (errors(integrator, step) for step in (0.05, 0.025))
    for before, after in zip(coarse, fine, strict=True):
        assert after < 1e-9 or before / after > 3.5
    assert max(fine) < 0.25 * (0.025 * BREATHING) ** 2
