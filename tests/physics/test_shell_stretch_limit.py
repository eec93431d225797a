"""Runs end where edges stretch beyond any material: in the step in which they do."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ddgcli.errors import SolveError
from ddgcli.mesh.shapes import icosphere
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.groups import Group
from ddgcli.models.shell.stretch_limit import MAX_STRETCH, StretchLimit

BALL = """
[time]
duration = 0.03
step = 0.01
integrator = "{integrator}"
[[object]]
name = "ball"
role = "shell"
sphere = {{ radius = 0.1, subdivisions = 0 }}
material = "rubber"
young = "1 MPa"
thickness = "0.3 mm"
velocity = [0, 1, 0]
[effects]
stretching = {{}}
{effects}
"""


def ball_scene(tmp_path, effects, integrator="newmark"):
    path = tmp_path / "ball.toml"
    path.write_text(BALL.format(effects=effects, integrator=integrator))
    return path


@pytest.mark.parametrize("integrator", ["newmark", "implicit-euler", "verlet"])
def test_a_balloon_under_a_pressure_that_nothing_bears_ends_at_once(tmp_path, run, integrator):
    """Its steps were divided for minutes, and it ended with strains of 10,000 and exit code 0."""
    path = ball_scene(
        tmp_path,
        "bending = {}\npressure = { value = 2147483648, times = [0, 0.03], factors = [0, 1] }",
        integrator,
    )
    result = run("shell-sim", path)
    assert result.exit_code == 1
    (line,) = (line for line in result.stderr.splitlines() if "object ball: an edge is" in line)
    assert float(re.search(r"an edge is ([\d.e+]+) times", line)[1]) > MAX_STRETCH
    assert "lessen the loads" in line


def test_the_remedy_lets_the_balloon_run(tmp_path, run):
    path = ball_scene(tmp_path, "pressure = { value = 100, times = [0, 0.03], factors = [0, 1] }")
    assert run("shell-sim", path).exit_code == 0


def test_what_nothing_resists_may_stretch(tmp_path, run):
    """Vertices without `stretching` fly apart, which a warning states."""
    text = ball_scene(tmp_path, "load = { vertices = [0], force = [0, 0, 1e4] }").read_text()
    path = tmp_path / "apart.toml"
    path.write_text(text.replace("stretching = {}\n", ""))
    result = run("shell-sim", path)
    assert result.exit_code == 0 and "no effect of the scene resists it" in result.stderr


def group_of(*meshes):
    shells = {f"shell{k}": SimpleNamespace(mesh=mesh) for k, mesh in enumerate(meshes)}
    return Group(shells, tuple(range(len(meshes))))


def longest(mesh, x):
    """The largest length of an edge by that at rest."""
    tail, head = mesh.topology.edges.T
    rest = np.linalg.norm(mesh.points[head] - mesh.points[tail], axis=1)
    return (np.linalg.norm(x[head] - x[tail], axis=1) / rest).max()


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.floats(0.1, 30.0), st.floats(0.0, 1e3))
def test_the_limit_is_seen_in_the_first_step_that_passes_it(seed, speed, drift):
    """Steps that are not measured are those that cannot have passed it; a common motion changes nothing."""
    rng = np.random.default_rng(seed)
    mesh = icosphere(1)
    limit, x = StretchLimit(group_of(mesh)), np.array(mesh.points)
    for step in range(60):
        x = x + speed * rng.normal(size=x.shape) + drift
        passed = longest(mesh, x) > MAX_STRETCH
        if passed:
            with pytest.raises(SolveError, match=f"t = {step} s, object shell0"):
                limit.check(x, step)
            return
        limit.check(x, step)


def test_the_shell_whose_edge_is_too_long_is_named():
    mesh = icosphere(0)
    other = TriangleMesh.from_arrays(mesh.points * 2, mesh.faces)
    x = np.concatenate([mesh.points * 50, other.points * 110])
    with pytest.raises(SolveError, match="object shell1: an edge is 110 times"):
        StretchLimit(group_of(mesh, other)).check(x, 0.0)
