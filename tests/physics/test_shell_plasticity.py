"""Plasticity: yield and hardening of single elements, dissipation, spring-back, resume."""

import numpy as np
import pytest

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
