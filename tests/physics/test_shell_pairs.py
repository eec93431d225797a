"""Contact of shells with meshes, other shells and themselves."""

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.io.mesh_file import MeshInput
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh.shapes import icosphere
from ddgcli.models.shell.pair_contact import PairBarrier, PairFriction, PairMesh
from ddgcli.models.shell.scene import KIND
from ddgcli.models.shell.shell_scene import ShellScene
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.shapes import Grid, grid_mesh
from ddgcli.simulation.account import Account
from tests.simulate import scalar, shell_run
from tests.triangle_pairs import meshes_intersect

pytest.importorskip("ipctk")

SHELL = """
[[object]]
name = "{name}"
role = "shell"
grid = {{ size = [0.2, 0.2], cells = [{cells}, {cells}] }}
density = 1.0
thickness = "2 mm"
young = 1e6
poisson = 0.3
{place}
"""
BALL = icosphere(1, 0.06)


def scene(time, *objects, effects):
    elastic = "stretching = {}\nbending = {}\n"
    return "[time]\n" + time + "".join(objects) + "[effects]\n" + elastic + effects


def shell(name, place, cells=4):
    return SHELL.format(name=name, place=place, cells=cells)


def obstacle(text):
    return f'[[object]]\nname = "o"\nrole = "obstacle"\n{text}\n'


def read_ball(name):
    return MeshInput(BALL, name)


def total(snapshots, name):
    return np.array(
        [sum(np.asarray(o.scalar.get(name, 0.0)) for o in s.observations.values()) for s in snapshots]
    )


def points_by_frame(snapshots, name):
    return [s.observations[name].points for s in snapshots]


def random_turn(rng):
    axis = rng.normal(size=3).tolist()
    return f"rotation = {{ axis = {axis}, degrees = {rng.uniform(0, 45):.3f} }}"


def pair_barrier(motion=None):
    """Two sheets that lie 0.6 of the gap apart, shifted and slightly bent."""
    grid = grid_mesh(Grid(size=[0.2, 0.2], cells=[2, 2]))
    points, n = np.asarray(grid.points), grid.n_vertices
    rng = np.random.default_rng(3)
    x = np.concatenate([points, points + [0.013, 0.007, 0.006]]) + 1e-3 * rng.normal(size=(2 * n, 3))
    mesh = PairMesh(
        np.arange(2 * n), np.concatenate([points, points]),
        np.concatenate([grid.topology.edges, grid.topology.edges + n]),
        np.concatenate([grid.faces, grid.faces + n]), [("a", 0, 0), ("b", n, grid.n_faces)],
        np.repeat([0, 1], n),
    )  # fmt: skip
    return PairBarrier(mesh, 0.01, 1e4), x


def test_forces_and_stiffness_of_pairs_are_the_derivatives_of_their_energy():
    barrier, x = pair_barrier()
    rng = np.random.default_rng(0)
    move = rng.normal(size=x.shape)
    move /= np.linalg.norm(move)
    gradient, h = barrier.gradient(x), 1e-7
    assert np.linalg.norm(gradient) > 0
    slope = (barrier.energy(x + h * move) - barrier.energy(x - h * move)) / (2 * h)
    assert np.vdot(gradient, move) == pytest.approx(slope, rel=1e-6)
    change = (barrier.gradient(x + h * move) - barrier.gradient(x - h * move)) / (2 * h)
    product = (barrier.hessian(x, "exact") @ move.ravel()).reshape(-1, 3)
    assert np.abs(product - change).max() < 1e-6 * np.abs(product).max()
    projected = barrier.hessian(x, "projected").toarray()
    assert np.linalg.eigvalsh(projected).min() > -1e-9 * np.abs(projected).max()


def test_forces_of_pairs_and_of_their_friction_balance():
    barrier, x = pair_barrier()
    gradient = barrier.gradient(x)
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    assert np.abs(np.cross(x, gradient).sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    v = np.random.default_rng(1).normal(size=x.shape)
    sliding = PairFriction(barrier, 0.3, 1e-3).frozen(x, 1e-3)
    drag = sliding.gradient(v)
    assert np.abs(drag).max() > 0
    assert np.abs(drag.sum(axis=0)).max() < 1e-12 * np.abs(drag).sum()
    assert np.vdot(drag, v) > 0
    h, move = 1e-6, np.random.default_rng(2).normal(size=x.shape)
    slope = (sliding.energy(v + h * move) - sliding.energy(v - h * move)) / (2 * h)
    assert np.vdot(drag, move) == pytest.approx(slope, rel=1e-5)


def test_pressure_at_half_the_gap_is_the_stiffness():
    barrier, x = pair_barrier()
    n = len(x) // 2
    flat = grid_mesh(Grid(size=[0.2, 0.2], cells=[2, 2])).points
    x = np.concatenate([flat, flat + [0.0, 0.0, 0.005]])
    force = barrier.gradient(x)[:n, 2].sum()
    assert force / 0.04 == pytest.approx(1e4, rel=0.2)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "integrator",
    ["implicit-euler", *(pytest.param(i, marks=SLOW) for i in ("newmark", "implicit-midpoint", "bdf2"))],
)
def test_two_shells_collide_without_passing_and_keep_their_momentum(integrator):
    text = scene(
        f'duration = 0.04\nstep = 5e-4\nframe_every = 2e-3\nintegrator = "{integrator}"\n',
        shell("a", ""), shell("b", "position = [0.03, 0.02, 0.02]\nvelocity = [0.1, 0, -1]", 3),
        effects='contact = { pairs = [["a", "b"]], friction = 0.3 }\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    momentum, energy = total(snapshots, "momentum"), total(snapshots, "energy")
    size = np.abs(momentum[0]).max()
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * size
    assert energy.max() <= energy[0] * (1 + 1e-9 if integrator != "newmark" else 1.02)
    faces = [np.asarray(contexts[name].mesh.faces) for name in "ab"]
    assert momentum[-1][2] == pytest.approx(momentum[0][2])
    upward = snapshots[-1].observations["b"].vertex["velocity"][:, 2].mean()
    assert upward > -0.9  # they met
    for a, b in zip(points_by_frame(snapshots, "a"), points_by_frame(snapshots, "b")):
        assert not meshes_intersect(a, faces[0], b, faces[1])


def test_shells_that_nothing_couples_have_the_bits_of_their_own_run():
    time = 'duration = 0.02\nstep = 1e-3\nintegrator = "implicit-euler"\n'
    pair = shell("a", ""), shell("b", "position = [0.03, 0.02, 0.01]\nvelocity = [0, 0, -1]", 3)
    contact = 'contact = { pairs = [["a", "b"]] }\n'
    alone, _, _ = shell_run(scene(time, *pair, effects=contact))
    # between the two in the file, so that the group is not in one piece
    free = shell("free", "position = [1, 0, 0]\nangular_velocity = [3, 1, 0]", 2)
    beside, _, _ = shell_run(scene(time, pair[0], free, pair[1], effects=contact))
    for name in "ab":
        assert all(
            np.array_equal(p, q) for p, q in zip(points_by_frame(alone, name), points_by_frame(beside, name))
        )
    alone, _, _ = shell_run(scene(time, free, effects=""))
    assert all(
        np.array_equal(p, q) for p, q in zip(points_by_frame(alone, "free"), points_by_frame(beside, "free"))
    )


@pytest.mark.parametrize("seed", range(2))
def test_a_shell_dropped_on_a_mesh_never_enters_it_and_gains_no_energy(seed):
    rng = np.random.default_rng(seed)
    corner = [*rng.uniform(-0.12, -0.08, 2).tolist(), 0.12]
    place = f"position = {corner}\n{random_turn(rng)}\nvelocity = [0, 0, -1]"
    text = scene(
        'duration = 0.12\nstep = 2e-3\nframe_every = 2e-3\nintegrator = "implicit-euler"\n',
        shell("s", place), obstacle('mesh = "ball.obj"'),
        effects='gravity = {}\ncontact = { pairs = [["s", "o"]], friction = 0.3 }\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text, read_ball)
    faces, energy = np.asarray(contexts["s"].mesh.faces), total(snapshots, "energy")
    assert (np.diff(energy) <= 1e-9 * np.abs(energy).max()).all()
    assert total(snapshots, "energy_contact").max() > 0
    for points in points_by_frame(snapshots, "s"):
        assert not meshes_intersect(points, faces, np.asarray(BALL.points), np.asarray(BALL.faces))


CRUMPLED = scene(
    'duration = {duration}\nstep = 4e-3\nframe_every = 8e-3\nintegrator = "implicit-euler"\n',
    """
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.05, 0.3], cells = [2, 12] }}
density = 0.2
thickness = "2 mm"
young = 2e5
poisson = 0.3
position = [0, 0, 0.02]
rotation = {{ axis = [1, 0, 0], degrees = 80 }}
""",
    obstacle("plane = {{}}"),
    effects="gravity = {{}}\ndamping = {{ mass = 2 }}\n"
    'contact = {{ pairs = [["s", "o"]], {itself}friction = 0.2 }}\n',
).replace("stretching = {}\nbending = {}", "stretching = {{}}\nbending = {{ stiffness = 1e-6 }}")


def crumpled(itself, duration):
    snapshots, contexts, _ = shell_run(CRUMPLED.format(itself=itself, duration=duration))
    faces = np.asarray(contexts["s"].mesh.faces)
    return snapshots, [meshes_intersect(p, faces, p, faces) for p in points_by_frame(snapshots, "s")]


def test_a_strip_that_falls_on_itself_does_not_pass_through_itself():
    snapshots, crossed = crumpled("self_contact = true, ", 0.4)
    assert not any(crossed)
    energy = total(snapshots, "energy")
    assert (np.diff(energy) <= 1e-9 * np.abs(energy).max()).all()


@SLOW
def test_without_self_contact_the_strip_passes_through_itself():
    assert any(crumpled("", 0.4)[1])


@pytest.mark.parametrize("kind", ["box", "mesh of a box"])
@pytest.mark.parametrize("degrees, sticks", [(14, True), (23, False)])
def test_friction_holds_a_shell_on_an_incline_up_to_the_angle_of_coulomb(kind, degrees, sticks):
    """tan(theta) = mu at 18.4 degrees; above, the acceleration is g (sin - mu cos)."""
    mu, angle = 1 / 3, np.radians(degrees)
    sharp = "sharp = true, " if kind != "box" else ""
    gravity = [float(9.81 * np.sin(angle)), 0.0, float(-9.81 * np.cos(angle))]
    text = scene(
        'duration = 0.2\nstep = 4e-3\nframe_every = 0.02\nintegrator = "implicit-euler"\n',
        shell("s", "position = [-0.1, -0.1, 0.0016]", 2),
        obstacle("box = { corner = [-1, -1, -0.1], size = [2, 2, 0.1] }"),
        effects=f"gravity = {{ acceleration = {gravity} }}\n"
        f'contact = {{ pairs = [["s", "o"]], {sharp}friction = {mu} }}\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    speed = total(snapshots, "momentum")[:, 0] / contexts["s"].mass.sum()
    if sticks:
        assert abs(speed[-1]) < 1.5e-4  # a part of the default `slip`, 2e-4 m/s
        return
    late = np.array([s.time for s in snapshots]) > 0.06
    slope = np.polyfit(np.array([s.time for s in snapshots])[late], speed[late], 1)[0]
    assert slope == pytest.approx(9.81 * (np.sin(angle) - mu * np.cos(angle)), rel=0.05)


@pytest.mark.parametrize("integrator", ["implicit-euler", "newmark", "bdf2"])
def test_a_shell_that_lands_on_a_mesh_loses_the_speed_that_coulomb_takes(integrator):
    """With the normal forces of the start of each step it was 2 % off, newmark and bdf2 up to a half."""
    mu, duration = 0.3, 0.1
    text = scene(
        f'duration = {duration}\nstep = 5e-3\nframe_every = 0.05\nintegrator = "{integrator}"\n',
        shell("s", "position = [-0.1, -0.1, 0.01]\nvelocity = [1.5, 0, -1]", 2),
        obstacle("box = { corner = [-1, -1, -0.1], size = [2, 2, 0.1] }"),
        effects=f'gravity = {{}}\ncontact = {{ pairs = [["s", "o"]], sharp = true, friction = {mu} }}\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    velocity = total(snapshots, "momentum")[-1] / contexts["s"].mass.sum()
    assert 1.5 - velocity[0] == pytest.approx(mu * (velocity[2] + 1.0 + 9.81 * duration), rel=0.02)


@SLOW
def test_a_stack_of_boxes_comes_to_rest_and_its_weight_is_the_contact_force():
    boxes = [
        f'[[object]]\nname = "b{k}"\nrole = "shell"\nbox = {{ size = [0.1, 0.1, 0.1], cells = [1, 1, 1] }}\n'
        f'density = 5.0\nthickness = "5 mm"\nyoung = 1e7\npoisson = 0.3\n'
        f"position = [0, 0, {0.004 + 0.104 * k}]\n"
        for k in range(2)
    ]
    text = scene(
        'duration = 1.0\nstep = 1e-2\nframe_every = 0.1\nintegrator = "implicit-euler"\n',
        *boxes, obstacle("plane = {}"),
        effects='gravity = {}\ncontact = { pairs = [["b0", "o"], ["b0", "b1"]], friction = 0.5 }\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    mass = sum(context.mass.sum() for context in contexts.values())
    assert total(snapshots, "contact_force_o")[-1][2] == pytest.approx(-9.81 * mass, rel=1e-3)
    half, end = snapshots[len(snapshots) // 2], snapshots[-1]
    for name in contexts:
        drift = end.observations[name].points - half.observations[name].points
        assert np.abs(drift).max() < 1e-5
        assert np.abs(end.observations[name].vertex["velocity"]).max() < 1e-4


def test_a_moving_mesh_lifts_a_shell_and_its_work_is_booked():
    text = scene(
        'duration = 0.44\nstep = 8e-3\nframe_every = 0.04\nintegrator = "bdf2"\n',
        shell("s", "position = [-0.1, -0.1, 0.002]", 2),
        obstacle(
            "box = { corner = [-0.2, -0.2, -0.1], size = [0.4, 0.4, 0.1] }\n"
            "times = [0, 0.4]\npositions = [[0, 0, 0], [0, 0, 0.1]]"
        ),
        effects='gravity = {}\ncontact = { pairs = [["s", "o"]], sharp = true }\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    z = points_by_frame(snapshots, "s")[-1][:, 2]
    assert z.min() > 0.1 and z.max() < 0.1025
    # 1641 where every small gain of energy halves a step
    assert scalar(snapshots, "newton_iterations")[-1] < 500
    mass = contexts["s"].mass.sum()
    raised = 9.81 * mass * (z.mean() - 0.002)
    assert scalar(snapshots, "external_work")[-1] == pytest.approx(raised, rel=0.1)


@pytest.mark.parametrize("more, word", [
    ('position = [0.03, 0.02, -0.01]\nrotation = { axis = [1, 0, 0], degrees = 20 }', "passes through"),
    ("position = [0.03, 0.02, 0]", "touch at the start|passes through"),
    ("position = [0.03, 0.02, 1e-9]", "nearly in touch.*move one of them, or write a gap"),
])  # fmt: skip
def test_shells_that_intersect_at_the_start_are_refused_with_the_first_pair(more, word):
    text = scene("duration = 0.01\n", shell("a", ""), shell("b", more, 3),
                 effects='contact = { pairs = [["a", "b"]] }\n')  # fmt: skip
    with pytest.raises(SceneError, match=word) as refused:
        shell_run(text)
    assert "'a'" in str(refused.value) and "'b'" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("integrator", ["verlet", "symplectic-euler"])
def test_explicit_schemes_are_refused_for_pairs(integrator):
    text = scene(f'duration = 0.01\nintegrator = "{integrator}"\n', shell("a", ""),
                 effects="contact = { self_contact = true }\n")  # fmt: skip
    with pytest.raises(SceneError, match="implicit scheme"):
        shell_run(text)


def test_without_the_library_pairs_are_refused_and_boxes_work(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "ipctk", None)
    time = 'duration = 0.02\nstep = 1e-3\nintegrator = "implicit-euler"\n'
    with pytest.raises(SceneError, match=r"pip install 'ddgcli\[contact\]'"):
        shell_run(scene(time, shell("a", ""), effects="contact = { self_contact = true }\n"))
    snapshots, _, _ = shell_run(
        scene(time, shell("a", "position = [0, 0, 0.01]\nvelocity = [0, 0, -1]", 2),
              obstacle("box = { corner = [-1, -1, -1], size = [2, 2, 1] }"),
              effects='contact = { pairs = [["a", "o"]] }\n')
    )  # fmt: skip
    assert points_by_frame(snapshots, "a")[-1][:, 2].min() > 0


def test_forces_and_stiffness_of_ties_are_the_derivatives_of_their_energy():
    from ddgcli.models.shell.attach import Ties

    rng = np.random.default_rng(0)
    x, move = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    ties, h = Ties(np.array([[0, 3], [1, 4], [2, 5]]), np.array([0.0, 0.7, 3.0]), 50.0), 1e-6
    slope = (ties.energy(x + h * move) - ties.energy(x - h * move)) / (2 * h)
    assert np.vdot(ties.gradient(x), move) == pytest.approx(slope, rel=1e-7)
    change = (ties.gradient(x + h * move) - ties.gradient(x - h * move)) / (2 * h)
    local = np.einsum("kij,kj->ki", ties.blocks(x, "exact"), move[ties.stencil].reshape(3, 6)).reshape(
        3, 2, 3
    )
    assert np.abs(local[:, 0] - change[:3]).max() < 1e-6 * np.abs(change).max()
    assert np.linalg.eigvalsh(ties.blocks(x, "projected")).min() > -1e-12 * 50


@pytest.mark.parametrize("integrator", ["newmark", "verlet"])
def test_tied_shells_stay_together_and_keep_their_momentum(integrator):
    text = scene(
        f'duration = 0.05\nstep = 1e-3\nintegrator = "{integrator}"\n',
        shell("a", "velocity = [0, 0, 1]", 2), shell("b", "position = [0.2, 0, 0]", 2),
        effects='[[effects.attach]]\nobject = "a"\nto = "b"\nbox = [[0.2, 0, 0], [0.2, 0.2, 0]]\n',
    )  # fmt: skip
    snapshots, _, _ = shell_run(text)
    momentum = total(snapshots, "momentum")
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * np.abs(momentum[0]).max() * len(snapshots)
    # the last column of a's vertices and the first of b's
    apart = [
        np.abs(a[6:] - b[:3]).max()
        for a, b in zip(points_by_frame(snapshots, "a"), points_by_frame(snapshots, "b"))
    ]
    assert max(apart) < 2e-3
    assert snapshots[-1].observations["b"].points[:, 2].mean() > 5e-3


def test_vertices_attached_to_an_obstacle_turn_with_it():
    text = scene(
        'duration = 0.2\nstep = 2e-3\nframe_every = 0.02\nintegrator = "newmark"\n',
        shell("s", "position = [0.1, -0.1, 0]", 2),
        obstacle("cylinder = { start = [0, 0, -1], end = [0, 0, 1], radius = 0.05 }\n"
                 "angular_velocity = [0, 0, 5]"),
        effects='[[effects.attach]]\nobject = "s"\nto = "o"\nbox = [[0.1, -0.1, 0], [0.1, 0.1, 0]]\n',
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(text)
    start = np.asarray(contexts["s"].mesh.points)[:3]
    c, s = np.cos(1.0), np.sin(1.0)
    expected = start @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    assert np.abs(points_by_frame(snapshots, "s")[-1][:3] - expected).max() < 1e-12
    velocity = snapshots[-1].observations["s"].vertex["velocity"][:3]
    assert np.allclose(velocity, np.cross([0, 0, 5], expected))
    assert "reaction_force_attach_0" in snapshots[-1].observations["s"].scalar


def test_a_dry_run_of_attached_shells_names_the_terms_of_both():
    text = scene(
        'duration = 0.05\nstep = 1e-3\n', shell("a", "", 2), shell("b", "position = [0.2, 0, 0]", 2),
        obstacle('mesh = "ball"\nposition = [0.1, 0.1, -0.2]'),
        effects='contact = { pairs = [["a", "o"], ["b", "o"]] }\n'
        '[[effects.attach]]\nobject = "a"\nto = "b"\nbox = [[0.2, 0, 0], [0.2, 0.2, 0]]\n',
    )  # fmt: skip
    dry = ShellScene(resolve(parse_scene(text), KIND, {}), Account(), read_ball, read_ball)
    assert dry.assembled(dry.scene.schedule())["a+b"]["terms"] == {
        "stretching": "StVK, 16 elements", "bending": "HingeBending, 16 elements",
        "contact": "PairBarrier, elements found in each step", "attach": "Ties, 3 elements",
    }  # fmt: skip
