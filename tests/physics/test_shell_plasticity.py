"""Plasticity: yield and hardening of single elements, dissipation, spring-back, resume."""

import numpy as np
import pytest
from scipy.optimize import brentq

from ddgcli.io.scene_file import parse_scene
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from tests.simulate import scalar, shell_run

# a strip that a handle pulls and bends, and brings back
STRIP = """
[time]
duration = {duration}
step = 2e-3
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.4, 0.1], cells = [6, 2] }}
material = "rubber"
[effects]
stretching = {{ model = "{model}" }}
bending = {{}}
{effects}
pin = {{ box = [[-0.01, -1, -1], [0.01, 1, 1]] }}
[effects.handle]
box = [[0.39, -1, -1], [0.41, 1, 1]]
times = [0, 0.02, 0.04]
positions = [[0, 0, 0], [{pull}, 0, 0.05], [0, 0, 0]]
"""
YIELD = "plasticity = { yield_strain = 0.02, yield_angle = 0.05, hardening = 0.1 }"


def strip(effects, model="stvk", integrator="implicit-euler", duration=0.05, pull=0.04):
    return STRIP.format(effects=effects, model=model, integrator=integrator, duration=duration, pull=pull)


@pytest.mark.parametrize("membrane", ["stvk", "edges"])
def test_return_leaves_the_elastic_strain_at_the_limit_and_takes_energy(membrane):
    scene = resolve(parse_scene(strip(YIELD, membrane)), KIND, {})
    (context, _) = model.contexts(scene, None)["s"]
    system = model.make_system(scene, context, Account())
    rng = np.random.default_rng(0)
    memory = tuple(term.initial() for term in system.memories)
    x = np.asarray(context.mesh.points)
    for _ in range(20):
        before = memory
        x = x + 0.002 * rng.normal(size=x.shape)
        memory = system.committed(x, before)
        for term, old, new in zip(system.memories, before, memory, strict=True):
            assert (new["accumulated"] >= old["accumulated"]).all() and new["work"][0] >= old["work"][0]
            limit = term.limit + term.hardening * new["accumulated"]
            assert (term.strain(x, new["rest"]) <= limit * (1 + 1e-9)).all()
    assert all(arrays["work"][0] > 0 for arrays in memory)


@pytest.mark.parametrize("membrane", ["stvk", "edges"])
def test_pulled_strip_stays_deformed_and_its_plastic_work_grows(membrane):
    run, _, _ = shell_run(strip(YIELD, membrane))
    work = np.array(scalar(run, "plastic_work"))
    assert (np.diff(work) >= 0).all() and work[-1] > 0
    rest = [run[k].checkpoint["s/memory_0_rest"] for k in (0, -1)]
    assert np.abs(rest[1] / np.where(rest[0] > 0, rest[0], 1) - (rest[0] > 0)).max() > 0.05
    # energy and plastic work come from the handle; the scheme takes the rest
    balance = np.array(scalar(run, "energy")) + work - np.array(scalar(run, "external_work"))
    # the trapezoidal rule of the handle's work misses at most half of |change of force| |move| in a step
    force = np.array(scalar(run, "reaction_force_handle"))
    points = np.array([snapshot.observations["s"].points for snapshot in run])
    path = points[:, np.argmax(points[0, :, 0])]
    missed = 0.5 * np.linalg.norm(np.diff(force, axis=0), axis=1)
    missed *= np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert (balance <= np.concatenate([[0], np.cumsum(missed)]) + 1e-12).all()


def test_energy_and_plastic_work_of_a_free_plate_that_spins_until_it_yields_balance():
    text = strip("plasticity = { yield_strain = 5e-4 }", integrator="newmark", duration=0.01)
    text = (
        text[: text.index("pin =")]
        .replace("step = 2e-3", "step = 5e-4")
        .replace("material", "angular_velocity = [0, 0, 300]\nmaterial")
    )
    run, _, _ = shell_run(text)
    work, energy = np.array(scalar(run, "plastic_work")), np.array(scalar(run, "energy"))
    assert work[-1] > 0.01 * energy[0]
    # forces of the shell before it yielded, in the step after, lost nearly as much as the plastic work
    assert np.abs(energy + work - energy[0]).max() < 0.15 * work[-1]


def test_shell_below_its_limits_moves_as_an_elastic_one_to_the_last_bit():
    stiff = "plasticity = { yield_strain = 10, yield_angle = 10 }"
    runs = [shell_run(strip(effects, integrator="newmark", duration=0.02))[0] for effects in ("", stiff)]
    assert len(runs[0]) > 1 and not np.array_equal(*(runs[0][k].observations["s"].points for k in (0, -1)))
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.observations["s"].points, b.observations["s"].points)


@pytest.mark.parametrize("name", ["newmark", "verlet"])
def test_resumed_run_has_the_same_bits(name):
    scene = resolve(parse_scene(strip(YIELD, integrator=name, duration=0.03)), KIND, {})
    contexts = {key: context for key, (context, _) in model.contexts(scene, None).items()}

    def snapshots(resume=None):
        return list(evolve(model.build(scene, contexts, Account()), scene.schedule(), Account(), resume))

    whole = snapshots()
    assert whole[8].checkpoint["s/memory_0_work"][0] > 0
    again = snapshots((8, {key: value.copy() for key, value in whole[8].checkpoint.items()}))
    for a, b in zip(whole[9:], again, strict=True):
        for key, value in a.checkpoint.items():
            assert np.array_equal(value, b.checkpoint[key]), key


PULLED = """
[time]
integrator = "static"
load_steps = {steps}

[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.5], cells = [4, 2] }}
density = 1
thickness = "1 mm"
young = 1e6
poisson = 0

[effects]
stretching = {{ model = "stvk" }}
plasticity = {{ yield_strain = 0.01, hardening = {hardening} }}
load = {{ box = [[1, 0, 0], [1, 1, 0]], line_force = [15, 0, 0], times = [0, 0.5, 1], factors = [0, 1, 0] }}

[[effects.pin]]
name = "wall"
box = [[0, 0, 0], [0, 1, 0]]
axes = "x"

[[effects.pin]]
box = [[0, 0, 0], [1, 1, 0]]
axes = "yz"
"""


def test_equilibria_of_a_strip_that_yields_balance_its_load_and_stay_long_without_it():
    """Pulled by N per width, and let go.

    Green's elastic strain e of a rest metric m is at its limit: 2 de / (1 + 2e) = h dm / m, so that 1 + 2e is
    (1 + 2 yield) m^h; the force is E t e sqrt((1 + 2e) / m).
    """
    hardening, limit = 0.5, 0.01

    def elastic(m):
        return 0.5 * ((1 + 2 * limit) * m**hardening - 1)

    def lacking(m):
        return 1e3 * elastic(m) * np.sqrt((1 + 2 * elastic(m)) / m) - 15

    metric = brentq(lacking, 1, 1.1)
    # work at the limit: stress times plastic strain rate, over the area of 0.5
    path = np.linspace(1, metric, 1001)
    rate = 0.5 * 1e3 * elastic(path) * 0.5 * (1 + 2 * elastic(path)) / path
    work = float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(path)))
    ends, misses = [np.sqrt(metric * (1 + 2 * elastic(metric))), np.sqrt(metric)], []
    for steps in (6, 12):
        run, _, _ = shell_run(PULLED.format(steps=steps, hardening=hardening))
        tips = [run[k].observations["s"].points[-1, 0] for k in (steps // 2, -1)]
        force = scalar(run, "reaction_force_wall")
        assert np.abs(np.array(force[steps // 2]) - [-7.5, 0, 0]).max() < 1e-5
        miss = np.append(np.subtract(tips, ends) / (metric - 1), scalar(run, "plastic_work")[-1] / work - 1)
        misses.append(np.abs(miss))
    # the return is of first order
    assert (misses[1] < 0.02).all() and (misses[0] > 1.8 * misses[1]).all()


def test_a_load_that_the_limits_do_not_bear_has_no_equilibrium(run, tmp_path):
    path = tmp_path / "s.toml"
    path.write_text('format = "ddgcli-scene/1"\n' + PULLED.format(steps=2, hardening=0))
    result = run("shell-sim", path, "--json")
    assert result.exit_code == 1 and "yields without end" in result.stderr
    assert "lessen the loads or raise" in result.stderr and "make the step" not in result.stderr


DRAWN = """
[time]
{time}
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.2, 0.05], cells = [4, 1] }}
density = 1.0
thickness = 0.002
young = 1e8
poisson = 0.3
[effects]
stretching = {{}}
bending = {{}}
{damping}
plasticity = {{ yield_strain = 0.005 }}
[[effects.pin]]
box = [[-0.001, -1, -1], [0.001, 1, 1]]
axes = "xz"
[[effects.pin]]
vertices = [0]
[[effects.handle]]
name = "h"
box = [[0.199, -1, -1], [0.201, 1, 1]]
times = [0, 1]
positions = [[0, 0, 0], [0.004, 0, 0]]
"""


def test_the_remedy_of_a_strip_that_is_drawn_beyond_its_limit_gives_the_force_of_the_limit(
    run, summary, tmp_path
):
    """Static steps do not follow perfect yielding under a handle; damped steps in time do."""
    path = tmp_path / "s.toml"
    path.write_text(DRAWN.format(time='duration = 1\nstep = 0.1\nintegrator = "static"', damping=""))
    result = run("shell-sim", path)
    assert result.exit_code == 1 and "--integrator implicit-euler with damping" in result.stderr
    time = 'duration = 1\nstep = 0.01\nframe_every = 0.1\nintegrator = "implicit-euler"'
    path.write_text(DRAWN.format(time=time, damping="damping = { mass = 5 }"))
    out = summary("shell-sim", path)
    force = out["results"]["reaction_forces"]["h"]["force"][0]
    assert force == pytest.approx(1e8 * 0.005 * 0.002 * 0.05, rel=0.05)
