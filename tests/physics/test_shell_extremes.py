"""Shells at their limits: folded, inside out, of one triangle, with steps and stiffness far too large."""

from types import SimpleNamespace

import numpy as np
import pytest

from ddgcli.errors import SolveError
from ddgcli.mesh.shapes import grid, icosphere
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.face_arrays import face_arrays
from tests.physics.test_shell_midedge import CLAMP, built
from tests.simulate import scalar, shell_run

SCENE = """
[time]
integrator = "{integrator}"
duration = {duration}
step = {step}
on_failure = "{on_failure}"
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = "1 mm"
young = {young}
poisson = 0.3
{motion}
[effects]
stretching = {{ {stretching} }}
bending = {{ rest = "{rest}", model = "{model}" }}
{effects}
"""
IMPLICIT = ["newmark", "implicit-euler", "implicit-midpoint", "bdf2"]


def run(mesh, integrator, effects="", motion="", **options):
    values = {
        "duration": 0.02, "step": 1e-3, "young": 1e6, "rest": "flat", "model": "hinge", "stretching": "",
        "on_failure": "shrink",
    } | options  # fmt: skip
    text = SCENE.format(integrator=integrator, effects=effects, motion=motion, **values)
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    return shell_run(text, lambda path: source)[0]


def largest_strain(mesh, points):
    start, end = mesh.topology.edges.T
    length, rest = (np.linalg.norm(p[end] - p[start], axis=1) for p in (points, mesh.points))
    return np.abs(length / rest - 1).max()


def folded(angle):
    """A strip of 1 m folded across its middle by an angle."""
    flat = grid(6, 2, 1, 0.3, "alternating")
    points = np.asarray(flat.points).copy()
    behind = np.maximum(points[:, 0] - 0.5, 0)
    points[:, 0] = np.minimum(points[:, 0], 0.5) + behind * np.cos(angle)
    points[:, 2] = behind * np.sin(angle)
    return flat.moved(points)


@pytest.mark.parametrize(("model", "angle"), [("hinge", np.pi), ("midedge", np.pi - 1), ("midedge", np.pi)])
def test_folded_strip_of_flat_rest_has_a_flat_equilibrium(model, angle):
    """Held by nothing, so the Hessian is singular at the end."""
    snapshots = run(folded(angle), "static", model=model)
    points = snapshots[-1].observations["s"].points
    assert scalar(snapshots, "energy")[0] > 1e-4
    assert scalar(snapshots, "energy")[-1] <= 1e-12
    assert np.linalg.svd(points - points.mean(axis=0))[1][2] <= 1e-6


@pytest.mark.parametrize("model", ["hinge", "midedge", "cubic", "quadratic"])
@pytest.mark.parametrize("integrator", [*IMPLICIT, "verlet"])
def test_strip_folded_by_a_straight_angle_moves_with_its_energy(model, integrator):
    short = {"duration": 2e-3, "step": 1e-4} if integrator == "verlet" else {}
    energy = np.array(scalar(run(folded(np.pi), integrator, model=model, **short), "energy"))
    assert energy[0] > 1e-4
    assert np.abs(energy / energy[0] - 1).max() <= (1e-3 if integrator != "implicit-euler" else 0.01)


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("step", [0.01, 0.1])
def test_steps_of_a_hundred_and_a_thousand_explicit_limits_lose_energy_or_keep_it(integrator, step):
    """A spinning plate whose explicit limit is 1e-4 s."""
    motion = "angular_velocity = [3, 2, 1]\nvelocity = [0.3, 0, 0]"
    plate = grid(8, 8, 1, 1, "alternating")
    snapshots = run(plate, integrator, motion=motion, young=1e9, step=step, duration=10 * step)
    energy = np.array(scalar(snapshots, "energy"))
    assert (energy <= energy[0] * 1.001).all()
    momentum = np.array(scalar(snapshots, "momentum"))
    assert np.abs(momentum - [0.3, 0, 0]).max() <= 1e-9
    assert largest_strain(plate, snapshots[-1].observations["s"].points) < 0.01


@pytest.mark.parametrize("integrator", [*IMPLICIT, "static"])
def test_shell_a_million_times_stiffer_in_its_plane_than_across_bends_under_its_weight(integrator):
    """Bending of 1e-6 of the stretching stiffness times the area: lengths stay while the tip sinks."""
    strip = grid(10, 2, 1, 0.2, "alternating")
    root = np.flatnonzero(np.asarray(strip.points)[:, 0] < 1e-9).tolist()
    snapshots = run(
        strip, integrator, CLAMP.format(root) + "\ngravity = {}", young=1.2e10, duration=0.1, step=5e-3
    )
    last = snapshots[-1].observations["s"]
    assert last.points[:, 2].min() < -0.01
    assert largest_strain(strip, last.points) <= 1e-4
    energy = np.array(scalar(snapshots, "energy"))
    assert (energy <= energy[0] + 0.01 * np.ptp(scalar(snapshots, "energy_gravity"))).all()


@pytest.mark.parametrize("integrator", [*IMPLICIT, "verlet", "symplectic-euler", "avi"])
def test_body_of_one_triangle_flies_as_a_rigid_body(integrator):
    triangle = TriangleMesh.from_arrays([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    snapshots = run(
        triangle, integrator, "gravity = {}", motion="velocity = [1, 2, 3]", step=1e-4, duration=1e-2
    )
    t = snapshots[-1].time
    moves = snapshots[-1].observations["s"].points - triangle.points
    truth = np.array([1, 2, 3]) * t - [0, 0, 0.5 * 9.81 * t**2]
    first_order = 9.81 * t * 1e-4 if integrator in ("implicit-euler", "symplectic-euler") else 0
    assert np.abs(moves - truth).max() <= 1e-9 + first_order


def test_pressure_acts_outward_whichever_way_the_faces_turn():
    ball = icosphere(1)
    inside_out = TriangleMesh.from_arrays(ball.points, np.asarray(ball.faces)[:, ::-1])
    radii = []
    for mesh in (ball, inside_out):
        last = run(mesh, "static", "pressure = { value = 100 }", rest="input")[-1]
        radii.append(np.linalg.norm(last.observations["s"].points, axis=1).mean())
    assert radii[0] > 1.01
    assert radii[1] == pytest.approx(radii[0], rel=1e-9)


TURNED_OVER = """
[time]
duration = 0.5
step = 1e-2
integrator = "implicit-euler"
[[object]]
name = "s"
role = "shell"
grid = { size = [1, 0.25], cells = [4, 1] }
density = 1
thickness = "2 mm"
young = 1e6
poisson = 0.3
[effects]
stretching = {}
bending = {}
pin = { box = [[0, 0, 0], [0, 0.25, 0]] }
[effects.handle]
box = [[1, 0, 0], [1, 0.25, 0]]
times = [0, 0.2]
positions = [[0, 0, 0], [-2, 0, 0]]
"""


def test_strip_carried_in_its_plane_through_faces_without_area_comes_to_rest_inverted():
    snapshots, contexts, _ = shell_run(TURNED_OVER)
    x, faces = snapshots[-1].observations["s"].points, np.asarray(contexts["s"].mesh.faces)
    normal = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    assert (normal[:, 2] < 0).all()  # at the start all look upwards
    energy = scalar(snapshots, "energy_stretching")
    assert energy[-1] < 0.01 * max(energy)
    start = np.asarray(contexts["s"].mesh.points)
    assert np.abs(x[:, :2] - start[:, :2] * [-1, 1]).max() < 0.05


@pytest.mark.parametrize("integrator", ["newmark", "verlet"])
def test_what_no_step_makes_finite_is_answered_by_weaker_forces_and_a_step(integrator):
    load = "load = {{ vertices = [0], force = [0, 0, {}] }}"
    with pytest.raises(SolveError, match="weaken the forces and velocities, or make the step [0-9.e-]+ s$"):
        run(grid(2, 2), integrator, load.format("1e300"))
    run(grid(2, 2), integrator, load.format("1e-2"), duration=2e-3)


def test_faces_beyond_the_range_of_numbers_have_no_stress():
    """Their eigenvalues stopped the program."""
    mesh = grid(2, 2)
    _, context, system = built(mesh)
    x = np.array(mesh.points)
    x[0, 0] = 1e200
    with np.errstate(all="ignore"):
        faces = face_arrays(context, system.potentials, x)
    at_corner = (np.asarray(mesh.faces) == 0).any(axis=1)
    assert np.isnan(faces["principal_stress"][at_corner]).all()
    assert np.abs(faces["principal_stress"][~at_corner]).max() < 1e-3


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_far_from_the_origin_moves_of_rounding_end_the_iteration(integrator):
    """At 1e8 sizes numbers are 1.5e-8 apart, and no move came below a quarter of their rounding."""
    plate = grid(4, 2, 1, 0.5)
    options = {"motion": "position = [1e8, 0, 0]", "duration": 0.05, "step": 0.01, "on_failure": "stop"}
    snapshots = run(plate, integrator, "gravity = {}\npin = { vertices = [0, 1, 2] }", **options)
    near = run(plate, integrator, "gravity = {}\npin = { vertices = [0, 1, 2] }", **options | {"motion": ""})
    apart = snapshots[-1].observations["s"].points - [1e8, 0, 0] - near[-1].observations["s"].points
    assert np.abs(apart).max() < 1e-6
