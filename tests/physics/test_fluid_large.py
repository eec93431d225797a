"""Fluid steps by conjugate gradients, where the factors of the Poisson problem do not fit into memory."""

import json

import numpy as np
import pytest

from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.linalg import backends

SCENE = """
[time]
duration = 0.02
step = 0.01
integrator = "{integrator}"
[[object]]
name = "f"
role = "fluid"
{shape}
[effects]
{effect}
"""
SCENES = {
    "surface": (
        "circulation",
        "sphere = { radius = 1, subdivisions = 2 }",
        'initial = { vorticity = "x*y + z" }',
    ),
    "volume": (
        "energy",
        "box = { size = [1, 1, 1], cells = [3, 3, 3] }",
        'initial = { velocity = ["x*(1-x)*(1-2*y)", "-(1-2*x)*y*(1-y)", 0] }',
    ),
}


@pytest.mark.parametrize("solver", ITERATIVE_SOLVERS)
@pytest.mark.parametrize("name", SCENES)
def test_steps_without_memory_for_factors_give_the_same_flow_and_name_their_solver(
    name, solver, monkeypatch, tmp_path, run
):
    if solver == "multigrid":
        pytest.importorskip("pyamg")
    scene = tmp_path / "scene.toml"
    integrator, shape, effect = SCENES[name]
    scene.write_text(SCENE.format(integrator=integrator, shape=shape, effect=effect))

    def result(file):
        outcome = run("fluid-sim", scene, "-o", tmp_path / file, "--json")
        with np.load(tmp_path / file) as arrays:
            fields = {key: np.array(arrays[key]) for key in arrays if arrays[key].dtype.kind == "f"}
        return outcome, json.loads(outcome.stdout)["accuracy"], fields

    _, direct, expected = result("a.npz")
    assert "step_solver" not in direct
    monkeypatch.setattr(backends, "MIN_CHECKED_UNKNOWNS", 0)
    monkeypatch.setattr(backends, "available_memory", lambda: 1e3)
    monkeypatch.setattr(backends, "preferred_iterative_solver", lambda: solver)
    limited, accuracy, fields = result("b.npz")
    assert "need about" in limited.stderr and "solve instead" in limited.stderr
    assert accuracy["step_solver"] == solver and 0 < accuracy["step_solver_iterations"] < 500
    assert 0 <= accuracy["step_solver_residual"] < 1e-12
    assert fields.keys() == expected.keys() and len(fields) > 1
    for key, field in fields.items():
        assert np.abs(field - expected[key]).max() <= 1e-9 * max(1.0, np.abs(expected[key]).max()), key
