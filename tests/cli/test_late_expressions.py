"""Expressions of a scene that are finite at the start and not later: the run ends, in one line."""

import pytest

FLUID = '[[object]]\nname = "f"\nrole = "fluid"\ngrid = { size = [1, 1], cells = [4, 4] }\n'
WIND = 'stretching = {}\nbending = {}\nwind = { velocity = ["EXPRESSION", 0, 0] }'
SHELL = '[[object]]\nname = "f"\nrole = "shell"\nmaterial = "silk"\n'
SHELL += "grid = { size = [1, 1], cells = [2, 2] }\n"


@pytest.mark.parametrize(
    "command, effects, expression",
    [
        ("fluid-sim", 'force = { acceleration = ["EXPRESSION", 0, 0] }', "y*sqrt(0.55 - t)"),
        ("fluid-sim", 'force = { acceleration = ["EXPRESSION", 0, 0] }\npressure = {}', "y/(t - 0.5)"),
        ("fluid-sim", 'dye = { source = "EXPRESSION" }', "sqrt(0.55 - t)"),
        ("fluid-sim", 'buoyancy = { source = "EXPRESSION", gravity = [0, -1, 0] }', "sqrt(0.55 - t)"),
        ("shell-sim", WIND, "sqrt(0.55 - t)"),
    ],
)
def test_an_expression_that_is_not_finite_later_ends_the_run(run, tmp_path, command, effects, expression):
    path = tmp_path / "s.toml"
    text = (FLUID if command == "fluid-sim" else SHELL) + "[effects]\n"
    text += effects.replace("EXPRESSION", expression)
    path.write_text(f"[time]\nduration = 1\nstep = 0.25\n{text}\n")
    done = run(command, path)
    assert done.exit_code == 1
    assert f"the expression '{expression}' is not finite" in done.stderr
    assert "internal error" not in done.stderr + done.output


def test_an_expression_is_finite_at_the_times_at_which_a_run_reads_it(run, tmp_path):
    """At its start, in the middle of its steps, and in frames that show the pressure."""
    path = tmp_path / "s.toml"
    force = 'force = { acceleration = ["y/(t - 0.37)", 0, 0] }'
    path.write_text(f"[time]\nduration = 1\nstep = 0.25\n{FLUID}[effects]\n{force}\n")
    assert run("fluid-sim", path).exit_code == 0
