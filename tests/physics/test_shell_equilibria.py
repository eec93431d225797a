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
