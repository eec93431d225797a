"""Equilibrium paths by arc length: limit points, snap-through, the end at the whole load."""

from types import SimpleNamespace

import numpy as np
import pytest

from ddgcli.errors import InputError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.equilibrium import unstable_directions
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

HEIGHT = 0.3
# four edge springs from a square to its apex, a truss of von Mises
CORNERS = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, HEIGHT]], dtype=float)
PYRAMID = TriangleMesh.from_arrays(CORNERS, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))
SCENE = """
[time]
integrator = "static"
load_steps = {steps}
{arc}
on_failure = "stop"
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = 0.01
young = 1e5
[effects]
stretching = {{ model = "edges" }}
load = {{ force = [0, 0, -60], vertices = [4] }}
pin = {{ vertices = [0, 1, 2, 3] }}
"""


def built(steps, arc):
    scene = resolve(parse_scene(SCENE.format(steps=steps, arc=arc)), KIND, {})
    source = SimpleNamespace(mesh=PYRAMID, vertex={}, face={}, sha256="", notes=[])
    context, _ = model.contexts(scene, lambda path: source)["s"]
    return scene, context


def path(steps=60, arc='arc_length = "3 cm"'):
    scene, context = built(steps, arc)
    account = Account()
    return list(evolve(model.build(scene, {"s": context}, account), scene.schedule(), account))


def load_at(z):
    """Load factor in equilibrium with the apex at height z, from the energy of the four springs."""
    system = model.make_system(*built(2, ""), Account())
    springs = next(p for p in system.potentials if p.name == "stretching")
    x = CORNERS.copy()
    x[4, 2] = z
    return -springs.gradient(x)[4, 2] / 60


def test_path_of_a_truss_follows_the_closed_form_through_both_limit_points():
    snapshots = path()
    z = np.array([snapshot.observations["s"].points[4, 2] for snapshot in snapshots])
    factor = np.array([snapshot.time for snapshot in snapshots])
    assert factor == pytest.approx([load_at(height) for height in z], abs=1e-7)
    assert (np.diff(z) < 0).all()
    # the truth along a fine line: the path has both limit points
    line = np.array([load_at(height) for height in np.linspace(HEIGHT, -HEIGHT, 400)])
    assert factor.max() == pytest.approx(1)
    assert factor.min() == pytest.approx(line.min(), rel=0.05)
    rises = factor[: np.argmin(factor)]
    assert rises.max() == pytest.approx(line.max(), rel=0.05)


def test_steps_of_a_path_have_its_arc_length_and_the_last_one_the_whole_load():
    snapshots = path()
    assert snapshots[-1].stopped == "the whole load is reached"
    assert snapshots[-1].time == 1.0
    z = np.array([snapshot.observations["s"].points[4, 2] for snapshot in snapshots])
    moves = np.abs(np.diff(z))[:-1]
    system = model.make_system(*built(2, ""), Account())
    share = system.mass[4] / system.mass.sum()
    assert np.sqrt(share) * moves == pytest.approx(0.03, rel=1e-6)


def test_equilibria_between_the_limit_points_are_unstable():
    snapshots = path()
    system = model.make_system(*built(60, 'arc_length = "3 cm"'), Account())
    counts, slopes = [], []
    for snapshot in snapshots[1:-1]:
        x = snapshot.observations["s"].points
        counts.append(unstable_directions(system.at(snapshot.time), x))
        slopes.append(load_at(x[4, 2] - 1e-4) - load_at(x[4, 2] + 1e-4))
    assert {0, 1} == set(counts)
    assert [count == 1 for count in counts] == [slope < 0 for slope in slopes]


def test_load_steps_alone_leap_over_the_unstable_part():
    z = [snapshot.observations["s"].points[4, 2] for snapshot in path(steps=20, arc="")]
    assert np.max(-np.diff(z)) > 1.5 * HEIGHT
    assert load_at(z[-1]) == pytest.approx(1, abs=1e-6)


def test_arc_length_without_load_steps_is_an_error():
    with pytest.raises(InputError, match="arc_length needs load_steps"):
        path(1)


def test_a_path_goes_on_from_any_checkpoint_with_the_same_bits():
    """Behind the first limit point too: the direction onwards is in the checkpoint."""
    whole = path()
    scene, context = built(60, 'arc_length = "3 cm"')
    start = len(whole) // 2
    account = Account()
    models = model.build(scene, {"s": context}, account)
    rest = list(evolve(models, scene.schedule(), account, (start, whole[start].checkpoint)))
    assert len(rest) == len(whole) - start - 1 > 3
    for a, b in zip(whole[start + 1 :], rest):
        assert a.time == b.time
        assert np.array_equal(a.observations["s"].points, b.observations["s"].points)
