"""Forces on a stream that leaves through a natural outflow."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid

STREAM = """
viscosity = { nu = 0.02 }
harmonic = {}
boundary = [
  { kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" },
  { kind = "outflow", where = "x > 2 - 1e-6" },
  { kind = "free-slip" },
]
"""
POST = """
[[object]]
name = "post"
role = "obstacle"
cylinder = { start = [1.5, 0.45, -1], end = [1.5, 0.45, 1], radius = 0.2 }
"""
TIME = "duration = 0.5\nstep = 0.05\nframe_every = 0.5"


def velocity_of(effects, cells=8, objects="", time=TIME):
    """(n, 3) at the end of a stream through the rectangle 2 x 1."""
    shape = f'grid = {{ size = [2, 1], cells = [{2 * cells}, {cells}], pattern = "alternating" }}'
    return run_fluid(STREAM + effects, time, shape, objects=objects).observations[-1].vertex["velocity"]


@pytest.mark.parametrize("objects", ["", POST], ids=["channel", "post"])
def test_a_gradient_moves_nothing_before_a_natural_outflow(objects):
    """The gradient of y sin x + 3 x y - 2 y^2 errs by its quadrature; round a post it drove 1.4 m/s."""
    gradient = 'force = { acceleration = ["y*cos(x) + 3*y", "sin(x) + 3*x - 4*y", 0] }'
    error = [
        np.abs(velocity_of(gradient, cells, objects) - velocity_of("", cells, objects)).max()
        for cells in (8, 16)
    ]
    assert error[1] < 1e-4 and error[0] / error[1] > 2


def test_velocities_of_a_flow_through_a_natural_outflow_are_those_of_that_flow():
    """Their vorticity there had the tangential velocity of the last faces, of which there is none."""
    shape = 'grid = { size = [2, 1], cells = [16, 8], pattern = "alternating" }'
    fluid = run_fluid(STREAM, "duration = 0.2\nstep = 0.05", shape, objects=POST).fluid
    space, start = fluid.space, fluid.start
    state = start.replaced(vorticity=0.1 * np.cos(np.arange(space.n)), coefficients=np.array([0.3]))
    vorticity, coefficients = space.of_face_velocity(space.face_velocity(space.flow(state).side_flux))
    assert np.abs(vorticity - state["vorticity"])[space.free].max() < 1e-12
    assert coefficients + space.rest()["coefficients"] == pytest.approx(state["coefficients"], abs=1e-12)
