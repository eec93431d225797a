"""Particles and sources: paths with known ends, seeds, amounts."""

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.fluids.runs import run_fluid
from ddgcli.cli.main import main
from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.io.trajectories.paths import particle_paths
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.particles import placed_seeds
from ddgcli.models.fluid.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

BALL = "sphere = {{ subdivisions = {} }}"
SQUARE = 'grid = { size = [1, 1], cells = [8, 8], periodic = "xy" }'
BOX = "box = {{ size = [3.141592653589793, 3.141592653589793, 1], cells = [{0}, {0}, 2] }}"
SCENE = """format = "ddgcli-scene/1"
[time]
duration = {duration}
step = {step}
frame_every = {every}
integrator = "{integrator}"
[[object]]
name = "f"
role = "fluid"
{shape}
[effects]
{effects}
"""


def fluid_observations(shape, effects, duration, step, integrator="energy", every=None):
    text = SCENE.format(shape=shape, effects=effects, duration=duration, step=step, integrator=integrator,
                        every=every or duration)  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    models = build(scene, fluids, Account())
    snapshots = evolve({n: m.model() for n, m in models.items()}, scene.schedule(), Account())
    return [snapshot.observations["f"] for snapshot in snapshots]


def places(observation):
    return observation.scalar["particles_f"].reshape(-1, 3)


def test_particles_on_a_turning_ball_come_back_with_second_order():
    apart = []
    for level, steps in ((2, 20), (3, 40)):
        effects = 'initial = { flow = "rotation" }\nparticles = { points = [[1, 0, 0], [0.6, 0, 0.8]] }'
        first, last = fluid_observations(BALL.format(level), effects, 2 * np.pi, 2 * np.pi / steps)
        apart.append(np.abs(places(last) - places(first)).max())
    assert apart[1] < 0.08 and np.log2(apart[0] / apart[1]) > 1.6


def test_particles_in_a_volume_stay_on_their_stream_line():
    """In the steady cell sin x sin y of a box, with the cells that n has."""
    effects = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }\nparticles = { count = 20 }'
    apart = []
    for n in (6, 12):
        first, last = (places(o) for o in fluid_observations(BOX.format(n), effects, 1.0, 0.1))
        apart.append(
            np.abs(np.prod(np.sin(last[:, :2]), axis=1) - np.prod(np.sin(first[:, :2]), axis=1)).max()
        )
        assert np.abs(last - first).max() > 0.3 and np.abs(last[:, 2] - first[:, 2]).max() < 0.1
    assert apart[1] < 0.6 * apart[0] < 0.1


def test_seeds_are_even_repeatable_and_in_their_box():
    one, other, boxed = (
        places(fluid_observations(SQUARE, f"particles = {{ {key} }}", 0.1, 0.1)[0])
        for key in ("count = 4000", "count = 4000, seed = 1",
                    "count = 50, box = { corner = [0.2, 0.2, -1], size = [0.1, 0.3, 2] }")
    )  # fmt: skip
    assert (one == places(fluid_observations(SQUARE, "particles = { count = 4000 }", 0.1, 0.1)[0])).all()
    assert (one != other).any()
    left = np.histogram2d(one[:, 0] % 1, one[:, 1] % 1, bins=2)[0]
    assert abs(left - 1000).max() < 150  # five deviations
    assert len(boxed) == 50
    assert (boxed[:, :2] >= 0.2).all() and (boxed[:, :2] <= [0.3, 0.5]).all()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("", "count or points"),
        ("count = 3, points = [[0, 0, 0]]", "count or points"),
        ("points = [[5, 5, 0]]", "outside"),
        ("count = 3, box = { corner = [7, 7, 7], size = [1, 1, 1] }", "holds 0 of 3"),
        ("points = []", "at least one"),
    ],
)
def test_seeds_that_cannot_be_placed_are_refused(keys, message):
    with pytest.raises(SceneError, match=message):
        fluid_observations(SQUARE, f"particles = {{ {keys} }}", 0.1, 0.1)


def test_a_source_adds_its_amount_of_dye():
    """1 + cos(2 pi x) a second for half a second over the unit square: 1/2, whatever the flow."""
    flow = 'initial = { vorticity = "sin(6.283185307179586*x)*sin(6.283185307179586*y)*20" }\n'
    _, last = fluid_observations(
        SQUARE, flow + 'dye = { source = "1 + cos(6.283185307179586*x)" }', 0.5, 0.05
    )
    assert last.scalar["total_dye"] == pytest.approx(0.5, rel=1e-12)
    assert np.ptp(last.vertex["dye"]) > 0.1
    with pytest.raises(SceneError, match="amount or source"):
        fluid_observations(SQUARE, "dye = {}", 0.1, 0.1)


def test_speed_is_the_length_of_the_velocity():
    last = fluid_observations(SQUARE, 'initial = { flow = "taylor-green" }', 0.1, 0.1)[-1]
    assert np.allclose(last.vertex["speed"], np.linalg.norm(last.vertex["velocity"], axis=1))
    assert last.vertex["speed"].max() > 0.5


def test_frames_writes_the_paths_of_particles(tmp_path):
    effects = 'initial = { flow = "taylor-green" }\nparticles = { count = 7 }'
    scene, run = tmp_path / "a.toml", tmp_path / "a.vtkhdf"
    scene.write_text(SCENE.format(shape=SQUARE, effects=effects, duration=1, step=0.1, every=0.1,
                                  integrator="energy"))  # fmt: skip
    assert CliRunner().invoke(main, ["fluid-sim", str(scene), "-o", str(run)]).exit_code == 0
    with Trajectory(str(run)) as source:
        paths = particle_paths(source, range(source.n_frames))
        last = source.scalars["particles_f"][-1].reshape(-1, 3)
    assert paths.n_vertices == 7 * 11 and np.allclose(paths.points[10::11], last)
    assert np.abs(paths.points[paths.lines[:, 1]] - paths.points[paths.lines[:, 0]]).max() < 0.5
    result = CliRunner().invoke(main, ["frames", str(run), "--paths", "-o", str(tmp_path / "p.vtp")])
    assert result.exit_code == 0 and (tmp_path / "p.vtp").stat().st_size > 0
    bare = tmp_path / "b.toml"
    bare.write_text(scene.read_text().replace("particles = { count = 7 }", ""))
    CliRunner().invoke(main, ["fluid-sim", str(bare), "-o", str(tmp_path / "b.vtkhdf")])
    result = CliRunner().invoke(
        main, ["frames", str(tmp_path / "b.vtkhdf"), "--paths", "-o", str(tmp_path / "q.vtp")]
    )
    assert result.exit_code == 2 and "particles" in result.output


def test_points_in_a_volume_end_where_they_leave_it_and_slide_along_walls():
    """They crept over the outflow."""
    shape = "box = { size = [1, 1, 1], cells = [3, 3, 3] }"
    boundary = "viscosity = { nu = 0.1 }\n"
    for kind, rest in (
        ("inflow", 'velocity = [1, 0, 0]\nwhere = "x < 0.01"'),
        ("outflow", 'where = "x > 0.99"'),
    ):
        boundary += f'[[effects.boundary]]\nkind = "{kind}"\n{rest}\n'
    model = run_fluid(boundary, 'integrator = "energy"\nduration = 0.1\nstep = 0.1', shape).fluid
    paths, start = model.setting.volume_paths, np.array([[0.41, 0.2, 0.5], [0.41, 0.83, 0.5]])
    cell, _ = placed_seeds(model.context, start)
    _, ends = paths.moved(cell, start, np.array([[1.18, 0.59, 0.0], [0.5, 0.4, 0.0]]))
    assert ends == pytest.approx(np.array([[1.0, 0.495, 0.5], [0.91, 1.0, 0.5]]), abs=1e-9)
