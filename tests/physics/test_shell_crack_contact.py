"""Contact of a shell that breaks with itself: its pieces meet, and cracks open without a force."""

import numpy as np
import pytest

from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh.shapes import grid, icosphere, random_sphere
from ddgcli.models.shell import model
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.cracks import split_surface
from ddgcli.models.shell.epochs import split_context
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from tests.cli.test_shell_resume import check_resumed_as_whole
from tests.simulate import scalar, shell_run
from tests.triangle_pairs import meshes_intersect

pytest.importorskip("ipctk")

# a bulb of glass that hits the floor so fast that it ends in single faces
BULB = """\
format = "ddgcli-scene/1"
[time]
duration = {duration}
step = 2e-4
frame_every = 4e-4
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
sphere = {{ radius = 0.03, subdivisions = 1 }}
density = 1.25
thickness = "0.5 mm"
young = 1e9
poisson = 0.2
position = [0, 0, 0.031]
rotation = {{ axis = [1, 0.3, 0], degrees = 20 }}
velocity = [0, 0, -9]
[[object]]
name = "floor"
role = "obstacle"
plane = {{}}
[effects]
stretching = {{}}
bending = {{}}
fracture = {{ strain = 4e-3, angle = "2 deg" }}
contact = {{ pairs = [["s", "floor"]], {itself}gap = "0.5 mm", friction = 0.2 }}
"""
SELF, GAP = "self_contact = true, ", 5e-4


def split_shell(mesh, opened):
    """Context of the bulb's shell with another mesh, some of whose interior edges are open."""
    scene = resolve(parse_scene(BULB.format(duration=1, integrator="newmark", itself=SELF)), KIND, {})
    ((context, _),) = model.contexts(scene, None).values()
    whole = ShellContext(context.shell, mesh, scene)
    split = split_surface(mesh.topology, opened(mesh))
    return whole, split_context(whole, split.faces, split.origin)


def barrier_of(whole, pieces, fraction=1.0):
    from ddgcli.models.shell.crack_contact import InsetPairMesh, largest_gap
    from ddgcli.models.shell.pair_contact import PairBarrier

    gap = fraction * largest_gap(whole)
    return PairBarrier(InsetPairMesh(pieces, gap), gap, 1e4), gap


def every_edge(mesh):
    return np.ones(mesh.topology.n_edges - len(mesh.topology.boundary_edges), dtype=bool)


def some_edges(seed, fraction):
    return lambda mesh: np.random.default_rng(seed).random(len(every_edge(mesh))) < fraction


def sides_moved_in(points, faces, margin):
    """Each face for itself with its sides moved in by a margin."""
    corners = points[faces]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radius = np.linalg.norm(normal, axis=1) / length.sum(axis=1)
    middle = np.einsum("mj,mjd->md", np.roll(length, -1, axis=1), corners) / length.sum(axis=1)[:, None]
    less = (1 - margin / radius)[:, None, None]
    return (middle[:, None] + less * (corners - middle[:, None])).reshape(-1, 3)


def test_single_faces_are_seen_with_their_sides_moved_in_by_the_margin():
    whole, pieces = split_shell(random_sphere(40), every_edge)
    barrier, gap = barrier_of(whole, pieces)
    corners = barrier.mesh.joined(np.asarray(pieces.mesh.points), 0.0)[pieces.mesh.faces].reshape(-1, 3)
    expected = sides_moved_in(np.asarray(pieces.mesh.points), pieces.mesh.faces, 0.9 * gap)
    assert np.abs(corners - expected).max() < 1e-13


@pytest.mark.parametrize("mesh", [grid(6, 5, 1.2, 1.0), icosphere(1), random_sphere(60)])
@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.8])
def test_pieces_in_their_places_do_not_push_each_other(mesh, fraction):
    """Cracks with ends, branches and corners; on a sphere also across edges that are bent."""
    for seed in range(5):
        whole, pieces = split_shell(mesh, some_edges(seed, fraction))
        assert len(pieces.mesh.points) > mesh.n_vertices
        barrier, _ = barrier_of(whole, pieces)
        x = np.asarray(pieces.mesh.points)
        assert barrier.outside(x) is None and barrier.energy(x) == 0.0


def test_forces_and_stiffness_of_pieces_are_the_derivatives_of_their_energy_and_balance():
    whole, pieces = split_shell(icosphere(1), some_edges(0, 0.6))
    barrier, gap = barrier_of(whole, pieces, 0.5)
    rng = np.random.default_rng(1)
    x = np.asarray(pieces.mesh.points)
    x = x + 0.45 * gap * rng.normal(size=x.shape)
    gradient = barrier.gradient(x)
    assert barrier.energy(x) > 0
    direction, step = rng.normal(size=x.shape), 1e-6 * gap
    ends = x + step * direction, x - step * direction
    slope = (barrier.energy(ends[0]) - barrier.energy(ends[1])) / (2 * step)
    assert slope == pytest.approx(np.vdot(gradient, direction), rel=1e-6)
    change = (barrier.gradient(ends[0]) - barrier.gradient(ends[1])) / (2 * step)
    along = (barrier.hessian(x, "exact") @ direction.ravel()).reshape(-1, 3)
    assert np.abs(change - along).max() < 1e-6 * np.abs(along).max()
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()


def shattered(itself, duration=3.2e-3):
    run, _, _ = shell_run(BULB.format(duration=duration, integrator="implicit-euler", itself=itself))
    crossed = []
    for snapshot in run:
        observation = snapshot.observations["s"]
        points = sides_moved_in(np.asarray(observation.points), observation.faces, 0.95 * GAP)
        faces = np.arange(len(points)).reshape(-1, 3)
        crossed.append(meshes_intersect(points, faces, points, faces))
    return run, crossed


def test_pieces_of_one_shell_do_not_pass_through_each_other():
    run, crossed = shattered(SELF)
    assert scalar(run, "pieces")[-1] > 20
    assert not any(crossed)
    released = np.array(scalar(run, "fracture_energy"))
    assert (np.diff(released) >= 0).all()
    energy = np.array(scalar(run, "energy")) + released
    assert np.diff(energy).max() <= 1e-9 * energy[0]


def test_without_self_contact_pieces_pass_through_each_other():
    run, crossed = shattered("")
    assert any(crossed)


@pytest.mark.slow
def test_resumed_run_of_pieces_in_contact_has_the_same_bits(run, tmp_path, monkeypatch):
    path = tmp_path / "s.toml"
    path.write_text(BULB.format(duration=1.2e-3, integrator="bdf2", itself=SELF))
    check_resumed_as_whole(run, tmp_path, monkeypatch, path, 2)


def test_a_gap_without_room_in_the_faces_is_less_with_a_warning(caplog):
    text = BULB.format(duration=2e-4, integrator="implicit-euler", itself=SELF)
    shell_run(text.replace('"0.5 mm"', '"20 mm"').replace("0, 0.031]", "0, 0.06]"))
    (warning,) = [r.getMessage() for r in caplog.records if "gap of s with itself" in r.getMessage()]
    assert "pieces may be single faces" in warning
