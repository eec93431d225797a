"""Benchmark shells: the linear obstacle course, and (slow) the nonlinear problems of Sze, Liu and Lo."""

import numpy as np
import pytest

from benchmarks.common.linear_shells import LINEAR_PROBLEMS, deflection
from benchmarks.common.shell_problems import PROBLEMS, displacements


@pytest.mark.parametrize("pattern", ["alternating", "irregular"])
@pytest.mark.parametrize(("name", "bound"), [("Scordelis-Lo roof", 0.025), ("pinched hemisphere", 0.015)])
def test_midedge_shells_converge_on_the_linear_course(name, pattern, bound):
    """Bounds at 1200 triangles; a quarter of the triangles has at least twice the error."""
    errors = [abs(deflection(LINEAR_PROBLEMS[name], faces, pattern)[1] - 1) for faces in (300, 1200)]
    assert errors[1] <= bound
    assert errors[1] <= 0.5 * errors[0]


def test_pinched_cylinder_descends_to_the_reference():
    """Its point load makes the deflection of coarse meshes too large."""
    problem = LINEAR_PROBLEMS["pinched cylinder with diaphragms"]
    ratios = [deflection(problem, faces, "alternating")[1] for faces in (300, 1200)]
    assert ratios[0] > ratios[1] > 1
    assert ratios[1] - 1 <= 0.55 * (ratios[0] - 1)


@pytest.mark.parametrize(("pattern", "bound"), [("alternating", 0.01), ("irregular", 0.06)])
def test_midedge_shells_bend_without_stretching_however_thin(pattern, bound):
    """A membrane that locks lets nothing move at a thickness of 0.001: hinges reach 0.14 on 300 triangles."""
    for thickness in (0.1, 0.01, 0.001):
        problem = LINEAR_PROBLEMS[f"free hyperboloid, thickness {thickness:g}"]
        coarse, fine = (abs(deflection(problem, faces, pattern)[1] - 1) for faces in (300, 1200))
        assert fine <= bound
        assert fine <= 0.5 * coarse


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "pattern", "steps", "bound"),
    [
        ("open hemisphere", "irregular", 20, 0.012),
        ("slit annular plate", "alternating", 40, 0.03),
        ("pinched cylinder", "alternating", 40, 0.015),
    ],
)
def test_nonlinear_shells_follow_the_tables_of_sze_on_1200_triangles(name, pattern, steps, bound):
    """At every load, in parts of the displacement under the whole load."""
    problem = PROBLEMS[name]
    _, moves = displacements(problem, 1200, pattern, steps=steps)
    truth = np.array(problem.reference).T
    assert (np.abs(moves - truth) <= bound * np.abs(truth).max(axis=0)).all()
