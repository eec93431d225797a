"""Equilibria end where the forces balance, also where energies differ by rounding alone."""

import numpy as np
import pytest

from tests.simulate import shell_run

CANTILEVER = """
[time]
duration = 1
step = 1
integrator = "static"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.1], cells = [{cells}, {rows}] }}
young = 2e11
poisson = 0
density = 7.8
thickness = "1 mm"
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
pin = {{ box = [[-1, -1, -1], [1e-6, 1, 1]], clamp = true }}
load = {{ box = [[0.999, -1, -1], [2, 1, 1]], force = [0, 0, -1e-3] }}
"""


def cantilever(bending, cells):
    """Deflection of the tip and force at the clamp, across a strip of steel."""
    run, *_ = shell_run(CANTILEVER.format(bending=bending, cells=cells, rows=cells // 10))
    end = run[-1].observations["s"]
    return end.points[:, 2].min(), np.asarray(end.scalar["reaction_force_pin"])[2]


@pytest.mark.parametrize("cells", [20, 40])
@pytest.mark.parametrize("bending", ["cubic", "quadratic"])
def test_models_of_hinges_agree_where_deflections_are_small(bending, cells):
    """They are one energy there; moves that rounding of the energies cut ended 4e-4 away."""
    tip, force = cantilever(bending, cells)
    assert tip == pytest.approx(cantilever("hinge", cells)[0], rel=1e-6)
    assert force == pytest.approx(1e-3, rel=1e-6)


PLATE = """
[time]
duration = 1
step = 1
integrator = "static"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [8, 8] }}
young = 1e9
poisson = 0.3
density = 1
thickness = {thickness}
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
pin = {{ box = [[-1, -1, -1], [1e-9, 2, 1]], clamp = true }}
load = {{ box = [[-1, -1, -1], [2, 2, 2]], traction = [0, 0, {traction}] }}
"""


def plate(bending, thickness, traction):
    """Deflection of a clamped plate over traction / thickness^3, and the clamp's force over the load's."""
    run, *_ = shell_run(PLATE.format(bending=bending, thickness=thickness, traction=-traction))
    end = run[-1].observations["s"]
    force = np.asarray(end.scalar["reaction_force_pin"])[2]
    return -end.points[:, 2].min() * thickness**3 / traction, force / traction


@pytest.mark.parametrize("thickness, traction", [(1e-5, 1e-12), (1e-3, 1e-12), (1e-3, 1e-9), (1e-2, 1e-6)])
@pytest.mark.parametrize("bending", ["midedge", "cubic"])
def test_small_loads_bend_in_proportion(bending, thickness, traction):
    """The first moves of the iteration are short because it is damped, not because the forces balance."""
    flexibility, force = plate(bending, thickness, traction)
    assert force == pytest.approx(1, rel=1e-6)
    assert flexibility == pytest.approx(plate(bending, 1e-2, 1e-4)[0], rel=1e-5)
