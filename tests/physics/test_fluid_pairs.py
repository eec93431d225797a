"""Every integrator and every effect on surfaces and in volumes: it runs, or it is refused by name."""

import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.errors import SceneError
from ddgcli.models.fluid.model import SURFACE_EFFECTS
from ddgcli.models.fluid.scene import EFFECTS, KIND, OPEN_TRANSPORTS, TRANSPORTS

SHAPES = {
    2: "grid = { size = [1, 1], cells = [4, 4] }",
    3: "box = { size = [1, 1, 1], cells = [2, 2, 2] }",
}
TURN = 'initial = { velocity = ["x*(1-x)*(1-2*y)", "-(1-2*x)*y*(1-y)", 0] }\n'
PARAMETERS = {
    "viscosity": "{ nu = 0.01 }",
    "boundary": '{ kind = "free-slip" }',
    "harmonic": "{}",
    "force": '{ acceleration = ["y", 0, 0] }',
    "rotation": "{ angular_velocity = [0, 0, 1] }",
    "buoyancy": '{ temperature = "x" }',
    "pressure": "{}",
    "dye": '{ amount = "x" }',
    "particles": "{ count = 3 }",
}
THROUGH = """
viscosity = { nu = 0.1 }
boundary = [
  { kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" },
  { kind = "outflow", where = "x > 1 - 1e-6" },
]
"""


def outcome(effects, shape, integrator="energy"):
    """Message of a refusal, or "" for a run."""
    try:
        run_fluid(effects, f'duration = 0.02\nstep = 0.01\nintegrator = "{integrator}"', shape)
    except SceneError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("dimension", SHAPES)
@pytest.mark.parametrize("integrator", KIND.integrators)
def test_an_integrator_runs_in_the_dimensions_that_its_table_names_and_nowhere_else(integrator, dimension):
    message = outcome(TURN, SHAPES[dimension], integrator)
    if dimension in TRANSPORTS[integrator]:
        assert message == ""
    else:
        others = [name for name, modules in TRANSPORTS.items() if dimension in modules]
        assert f"{integrator} does not exist in {dimension}-D; take {' or '.join(others)}" in message


@pytest.mark.parametrize("dimension", SHAPES)
@pytest.mark.parametrize("effect", [name for name in EFFECTS if name != "initial"])
def test_an_effect_runs_in_its_dimensions_and_is_refused_by_name_in_the_other(effect, dimension):
    message = outcome(TURN + f"{effect} = {PARAMETERS[effect]}", SHAPES[dimension])
    if dimension == 3 and effect in SURFACE_EFFECTS:
        assert f"{effect} acts on surfaces" in message
    else:
        assert message == ""


@pytest.mark.parametrize("dimension", SHAPES)
@pytest.mark.parametrize("integrator", KIND.integrators)
def test_fluid_crosses_the_boundary_only_by_the_integrators_that_can(integrator, dimension):
    message = outcome(THROUGH, SHAPES[dimension], integrator)
    if dimension not in TRANSPORTS[integrator]:
        assert "does not exist" in message
    elif integrator not in OPEN_TRANSPORTS:
        assert "no inflow and outflow" in message
    else:
        assert message == ""


def test_every_integrator_has_its_row_in_the_tables_of_the_page():
    from pathlib import Path

    page = (Path(__file__).parents[2] / "docs" / "fluid-sim.md").read_text()
    for integrator, modules in TRANSPORTS.items():
        volumes = "yes" if 3 in modules else "refused"
        assert f"| `{integrator}` | yes | {volumes} |" in page
