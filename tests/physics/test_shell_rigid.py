"""Rigid edges by RATTLE: pendulums against their equations, order, momenta, energy, multipliers, files."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from ddgcli.errors import SceneError
from ddgcli.mechanics.constraints import RigidEdges
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import DeadLoad, FixedCoordinates
from ddgcli.simulation.account import Account
from tests.cli.test_shell_resume import check_resumed_as_whole
from tests.simulate import scalar, shell_run

GRAVITY = np.array([0.0, 0.0, -9.81])


def chain(x, masses, pinned=True, gravity=GRAVITY):
    """System of points joined one to the next, the first held, and its motion at rest."""
    x = np.asarray(x, dtype=float)
    edges = np.stack([np.arange(len(x) - 1), np.arange(1, len(x))], axis=1)
    length = np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
    masses = np.asarray(masses, dtype=float)
    terms = [RigidEdges(edges, length), DeadLoad("gravity", masses[:, None] * gravity)]
    if pinned:
        is_fixed = np.zeros((len(x), 3), dtype=bool)
        is_fixed[0] = True
        terms.append(FixedCoordinates(is_fixed, "pin"))
    system = System(masses, terms, Account(), x)
    a = system.acceleration(x, 0 * x, 0.0)
    return system, Motion(x, np.zeros_like(x), a, multipliers=np.zeros(len(edges)))


def moved(system, motion, dt, steps):
    motions = [motion]
    for _ in range(steps):
        motions.append(INTEGRATORS["verlet"].step(system, motions[-1], dt, None))
    return motions


def energies(system, motions):
    return np.array(
        [
            0.5 * float(system.mass @ (m.v**2).sum(axis=1)) + sum(system.energies(m.x).values())
            for m in motions
        ]
    )


def reference(system, x, time):
    """Positions by the equations with multipliers, integrated to 1e-12."""
    (edges,) = system.constraints
    weight = (system.free / system.mass[:, None]).ravel()

    def rate(t, state):
        y, v = state.reshape(2, -1, 3)
        jacobian = edges.jacobian(y).toarray()
        spin = v[edges.edges[:, 1]] - v[edges.edges[:, 0]]
        free = np.tile(GRAVITY, len(y)) * (weight > 0)
        rhs = jacobian @ free + (spin**2).sum(axis=1) / edges.length
        tension = np.linalg.solve(jacobian * weight @ jacobian.T, rhs)
        return np.concatenate([v.ravel(), free - weight * (jacobian.T @ tension)])

    state = np.concatenate([x.ravel(), np.zeros(x.size)])
    return solve_ivp(rate, (0, time), state, "DOP853", rtol=1e-12, atol=1e-12).y[: x.size, -1].reshape(-1, 3)


DOUBLE = [[0, 0, 0], [0.8, 0, 0.3], [1.4, 0.5, 0.3], [1.9, 0.6, -0.2]]


def test_a_chain_of_three_pendulums_converges_to_its_equations_in_second_order():
    system, motion = chain(DOUBLE, [1, 1, 0.5, 2])
    truth = reference(system, motion.x, 0.4)
    errors = [np.abs(moved(system, motion, 0.4 / n, n)[-1].x - truth).max() for n in (40, 80, 160)]
    assert errors[-1] < 2e-4
    assert all(3.6 < a / b < 4.4 for a, b in zip(errors, errors[1:]))


def test_lengths_stay_to_rounding_and_velocities_stay_tangent():
    system, motion = chain(DOUBLE, [1, 1, 0.5, 2])
    (edges,) = system.constraints
    for m in moved(system, motion, 0.01, 100):
        assert np.abs(edges.excess(m.x)).max() < 1e-14
        assert np.abs(edges.jacobian(m.x) @ m.v.ravel()).max() < 1e-13 * (1 + np.abs(m.v).max())


def test_energy_of_a_pendulum_swings_with_the_square_of_the_step_and_does_not_drift():
    swings = []
    for dt in (0.04, 0.02):
        system, motion = chain([[0, 0, 0], [1, 0, 0]], [1, 1])
        energy = energies(system, moved(system, motion, dt, 400))
        error = np.abs(energy - energy[0])
        quarter = len(error) // 4
        assert error[-quarter:].max() < 1.1 * error[:quarter].max()
        swings.append(error.max())
    assert 3.5 < swings[0] / swings[1] < 4.5


def test_momenta_of_a_free_chain_are_conserved_to_rounding():
    system, motion = chain(DOUBLE, [1, 1, 0.5, 2], pinned=False, gravity=np.zeros(3))
    v = np.cross([1.0, -2.0, 3.0], motion.x) + [0.3, 0.2, 0.1]
    v[-1] += np.cross(DOUBLE[-1], [0, 1, 0])  # across the last edge or not: the first step makes it tangent
    motions = moved(system, Motion(motion.x, v, motion.a, multipliers=motion.multipliers), 0.01, 200)
    momentum = np.array([system.mass @ m.v for m in motions])
    turn = np.array([np.cross(m.x, system.mass[:, None] * m.v).sum(axis=0) for m in motions])
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * np.abs(momentum).max()
    assert np.abs(turn - turn[0]).max() < 1e-12 * np.abs(turn).max()


def test_multipliers_are_the_tensions_of_a_hanging_chain():
    x = [[0, 0, 0], [0, 0, -1], [0, 0, -2]]
    system, motion = chain(x, [1, 2, 3])
    last = moved(system, motion, 0.01, 3)[-1]
    assert np.allclose(last.multipliers, [5 * 9.81, 3 * 9.81], rtol=1e-12)
    assert np.array_equal(np.round(last.x, 14), x)


# three panels that hang from a hinge: two rows of vertices, no vertex inside
STRIP = """\
format = "ddgcli-scene/1"
[time]
duration = {duration}
step = {step}
frame_every = 0.02
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.9, 0.3], cells = [{cells}, 1] }}
density = 1
thickness = "1 mm"
young = 1e6
poisson = 0.3
[effects]
gravity = {{}}
rigid = {{ {which} }}
pin = {{ box = [[0, 0, 0], [0, 1, 0]] }}
"""


def strip(duration=0.1, step=2e-3, integrator="verlet", cells=3, which=""):
    return STRIP.format(duration=duration, step=step, integrator=integrator, cells=cells, which=which)


def test_a_rigid_panel_swings_with_the_period_of_the_pendulum():
    """Two triangles on a hinge: the masses of the two free vertices are at the distance 0.9 from it."""
    length = 0.9
    period = 4 * np.sqrt(length / 9.81) * ellipk(0.5)  # from the horizontal
    text = strip(duration=period, step=period / 500, cells=1).replace("0.02", str(period / 4))
    snapshots, contexts, _ = shell_run(text)
    free = contexts["s"].mesh.points[:, 0] > 0.5
    ends = np.array([snapshot.observations["s"].points[free] for snapshot in snapshots])
    assert np.allclose(ends[1][:, [0, 2]], [0, -length], atol=1e-4 * length)
    assert np.allclose(ends[2][:, 0], -length, atol=1e-4 * length)
    assert np.allclose(ends[4], ends[0], atol=1e-4 * length)


def test_an_inextensible_strip_keeps_its_lengths_and_reports_their_force():
    snapshots, _, _ = shell_run(strip())
    assert max(scalar(snapshots, "rigid_error")) < 1e-13
    assert scalar(snapshots, "rigid_force")[-1] > 0
    energy = np.array(scalar(snapshots, "energy"))
    assert np.abs(energy - energy[0]).max() < 1e-3 * max(scalar(snapshots, "energy_kinetic"))


def test_reaction_of_the_pin_has_the_tension_of_the_edges():
    hanging = "density = 1\nrotation = { axis = [0, 1, 0], degrees = 90 }"
    snapshots, contexts, _ = shell_run(strip(0.02).replace("density = 1", hanging))
    weight = 9.81 * contexts["s"].mass.sum()
    assert np.allclose(scalar(snapshots, "reaction_force_pin")[-1], [0, 0, weight], atol=1e-9 * weight)


def test_initial_velocities_become_tangent_with_their_momentum():
    text = strip().replace("pin = {", "#").replace("density = 1", "density = 1\nangular_velocity = [1, 2, 3]")
    snapshots, contexts, _ = shell_run(text.replace("gravity = {}", ""))
    momentum = np.array(scalar(snapshots, "angular_momentum"))
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * np.abs(momentum[0]).max()


def test_resumed_run_with_multipliers_has_the_same_bits(run, tmp_path, monkeypatch):
    path = tmp_path / "s.toml"
    path.write_text(strip())
    check_resumed_as_whole(run, tmp_path, monkeypatch, path, 3)


@pytest.mark.parametrize("text, message", [
    (strip(integrator="newmark"), "verlet"),
    (strip().replace("cells = [3, 1]", "cells = [3, 3]"), "name fewer edges"),
    (strip(which="edges = [[0, 7]]"), "no edge joins"),
    (strip(which="edges = [[0, 1]], vertices = [0]"), "give edges, or vertices, or a box"),
    (strip().replace("pin =", "handle = { vertices = [7], times = [0, 1] }\npin ="), "handle"),
])  # fmt: skip
def test_rigid_edges_refuse_what_they_cannot_keep(text, message):
    with pytest.raises(SceneError, match=message):
        shell_run(text)
