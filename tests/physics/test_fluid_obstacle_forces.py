"""Forces on obstacles: the cylinder of Schaefer and Turek (1996), and identities of the weak form."""

import numpy as np

from benchmarks.fluids.cylinder import DRAG, LIFT, scene, steady
from benchmarks.fluids.steady import SteadyFlow, model_of


def test_drag_and_lift_of_the_cylinder_approach_the_published_figures():
    apart = np.array([steady(ny) - [DRAG, LIFT] for ny in (20, 41)])
    assert abs(apart[1, 0]) < 0.06 * DRAG < abs(apart[0, 0])
    assert abs(apart[1, 1]) < 0.02 < abs(apart[0, 1])


def test_forces_without_flow_vanish_and_turn_with_the_flow():
    model = model_of(scene(12, 0.3, length=0.82))
    flow = SteadyFlow(model)
    assert (model.start["vorticity"] == 0).all()
    force = model.observe(flow.state(flow.solve(1e-3))).scalar["force_cylinder"]
    assert force[0] > 5 * abs(force[1]) > 0  # along the stream


def test_only_scenes_with_obstacles_without_slip_have_forces():
    text = scene(12, 0.3, length=0.82).replace('kind = "no-slip"', 'kind = "free-slip"')
    model = model_of(text)
    assert "force_cylinder" not in model.observe(model.start).scalar
