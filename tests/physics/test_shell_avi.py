"""Asynchronous steps: Verlet where all are equal; momenta, energy and economy on a graded mesh."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import MeshInput
from ddgcli.mechanics import asynchronous
from ddgcli.mesh.shapes import grid
from tests.simulate import scalar, shell_run

SCENE = """
[time]
duration = {duration}
step = {step}
frame_every = {every}
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
{shape}
density = 1
thickness = "2 mm"
young = 1e5
poisson = 0.4
velocity = [0.1, 0.2, 0.3]
angular_velocity = [2, 3, 4]
[effects]
stretching = {{ model = "{stretching}" }}
bending = {{ rest = "flat" }}
{more}
"""
UNIFORM = 'grid = { size = [1, 1], cells = [5, 5], pattern = "alternating" }'


def graded(name):
    """Columns that grow from 1/216 to 91/216 of the length, on a curve, so that they move."""
    mesh = grid(6, 2)
    x, y = np.asarray(mesh.points)[:, :2].T
    return MeshInput(mesh.moved(np.stack([x**3, 0.4 * y, 0.1 * x**2], axis=1)), name)


def run(integrator, step, duration, every=None, shape='mesh = "graded"', stretching="stvk", more=""):
    text = SCENE.format(
        integrator=integrator, step=step, duration=duration, every=every or duration, shape=shape,
        stretching=stretching, more=more,
    )  # fmt: skip
    return shell_run(text, graded)


@pytest.mark.parametrize("stretching", ["edges", "edges-area", "stvk"])
def test_equal_steps_of_all_elements_are_those_of_verlet(stretching):
    a, b = (run(n, 1e-4, 5e-3, shape=UNIFORM, stretching=stretching)[0] for n in ("avi", "verlet"))
    for name in ("points", "velocity"):
        ends = [s[-1].observations["s"] for s in (a, b)]
        ends = [e.points if name == "points" else e.vertex[name] for e in ends]
        assert np.abs(ends[0] - ends[1]).max() < 1e-12 * np.abs(ends[1]).max()


def test_elements_of_a_graded_mesh_act_as_often_as_they_need_and_keep_the_order(monkeypatch):
    divisions, divided = [], asynchronous._assign_levels

    def watched(system, dt):
        divisions.append(divided(system, dt))
        return divisions[-1]

    monkeypatch.setattr(asynchronous, "_assign_levels", watched)
    run("avi", 2e-3, 4e-3)
    (levels,) = divisions
    counts = [sum(len(b.potential.stencil) for b in batches) for batches in levels.batches]
    finest = len(counts) - 1
    assert finest >= 3 and sum(c > 0 for c in counts) >= 3
    evaluations = sum(c * 2**k for k, c in enumerate(counts))
    assert evaluations < 0.6 * sum(counts) * 2**finest


def test_elements_of_two_coupled_shells_act_as_often_as_they_need(monkeypatch):
    """The elements of a group were all on the finest level."""
    divisions, divided = [], asynchronous._assign_levels
    monkeypatch.setattr(
        asynchronous, "_assign_levels", lambda *system: divisions.append(divided(*system)) or divisions[-1]
    )

    def energies(integrator, step):
        text = SCENE.format(
            integrator=integrator, step=step, duration=0.02, every=0.01, shape='mesh = "graded"',
            stretching="stvk", more='attach = { object = "s", to = "other", vertices = [18, 19, 20], '
            "to_vertices = [0, 1, 2], stiffness = 200 }",
        )  # fmt: skip
        start, end = text.index("[[object]]"), text.index("[effects]")
        other = text[start:end].replace('"s"', '"other"').replace("velocity", "#velocity")
        other = other.replace("angular_#velocity", "#angular_velocity")
        text = text[:end] + other + "position = [1, 0, 0.1]\n" + text[end:]
        scalars = shell_run(text, graded)[0][-1].observations["s"].scalar
        return np.array([scalars[f"energy_{kind}"] for kind in ("kinetic", "stretching", "bending")])

    shell_energies = energies("avi", 1e-3)
    (levels,) = divisions
    counts = [sum(len(b.potential.stencil) for b in batches) for batches in levels.batches]
    assert len(counts) > 2 and all(counts) and counts[-1] < 0.3 * sum(counts)
    truth = energies("verlet", 5e-5)
    assert np.abs(shell_energies - truth).max() < 2e-3 * truth.sum()


def test_a_graded_mesh_converges_in_second_order_when_the_steps_of_all_elements_shrink(monkeypatch):
    def end(name, step, safety=1.0):
        monkeypatch.setattr(asynchronous, "SAFETY", safety)
        return run(name, step, 0.02)[0][-1].observations["s"].points

    truth = end("verlet", 5e-6)
    errors = [np.abs(end("avi", 1e-3 * f, 0.8 * f) - truth).max() for f in (0.5, 0.25, 0.125)]
    assert errors[1] / errors[2] == pytest.approx(4, abs=1)


def test_momenta_are_kept_to_rounding_and_the_energy_does_not_drift():
    snapshots, contexts, _ = run("avi", 1e-3, 0.6, 0.005)
    momentum = np.array(scalar(snapshots, "momentum"))
    turn = np.array(scalar(snapshots, "angular_momentum"))
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * np.abs(momentum[0]).max()
    assert np.abs(turn - turn[0]).max() < 1e-11 * np.abs(turn[0]).max()
    energy = np.array(scalar(snapshots, "energy"))
    error = np.abs(energy - energy[0])
    quarter = len(error) // 4
    assert error[-quarter:].max() < 1.5 * error[:quarter].max()
    assert error.max() < 0.02 * energy[0]


def test_drag_friction_and_a_barrier_act_as_in_verlet():
    floor = '[[object]]\nname = "floor"\nrole = "obstacle"\nplane = { point = [0, 0, -0.02] }\n'
    more = "gravity = {}\ndamping = { mass = 1 }\n"
    more += 'contact = { pairs = [["s", "floor"]], friction = 0.3, gap = 0.01 }'
    energies = []
    for integrator in ("avi", "verlet"):
        text = SCENE.format(
            integrator=integrator, step=1e-4, duration=0.03, every=5e-3, shape=UNIFORM, stretching="stvk",
            more=more,
        )  # fmt: skip
        snapshots, _, _ = shell_run(text.replace("[effects]", floor + "[effects]").replace("0.3]", "-1]"))
        energies.append(np.array(scalar(snapshots, "energy")))
    assert (np.diff(energies[0]) < 0).all()
    assert np.abs(energies[0] - energies[1]).max() < 0.01 * np.ptp(energies[1])


def test_a_step_far_too_long_for_an_element_is_refused():
    from ddgcli.simulation.model import RunFailed

    with pytest.raises(RunFailed, match="take an implicit scheme"):
        run("avi", 1000.0, 1000.0)
