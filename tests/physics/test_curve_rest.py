"""Flows of curves to rest that end before name a remedy that leads there."""

import math
import re

import numpy as np
import pytest

from ddgcli.models.curve import setup
from ddgcli.models.curve.report import _extrapolated_rest
from tests.physics.test_curve_flow import ellipse, write_obj


@pytest.mark.parametrize(("small", "named"), [(0.8, False), (0.3, True)])
def test_a_flow_to_rest_that_ends_before_names_a_step_that_leads_there(
    tmp_path, summary, monkeypatch, small, named
):
    """With its number where the time over the most steps is too long a step for the small circle."""
    circles = write_obj(
        tmp_path / "two.obj", (ellipse(16, 1, 1).points, True), (ellipse(16, small, small).points, True)
    )
    monkeypatch.setattr(setup, "MAX_STEPS", 150)  # both shorter: the same ratio to the default step
    monkeypatch.setitem(setup.DEFAULT_STEP, "curvature", 4e-3)
    first = summary("curve-flow", circles)
    (warning,) = [text for text in first["warnings"] if "curves still move" in text]
    assert first["results"]["collapse_times"][0] is None
    step, n_steps, more = re.search(
        r"--dt (\S+?)(?: with --steps (\d+))?, .*: --steps (\d+)$", warning
    ).groups()
    assert (n_steps is not None) == named
    end, dt = float(step) * int(n_steps or 150), first["results"]["times"][-1] / 150
    assert dt * (int(more) - 100) < end < 1.01 * dt * (int(more) + 100)  # the same time, in hundreds of steps
    words = ("--dt", step, "--steps", n_steps) if named else ("--dt", step)
    remedy = summary("curve-flow", circles, *words)
    assert remedy["results"]["stopped_because"] == "every curve has shrunk to a point"
    assert remedy["warnings"] == [] and remedy["accuracy"]["area_rate_error"] < 0.1


def test_a_flow_to_rest_that_ends_before_names_the_steps_that_lead_there(tmp_path, summary, monkeypatch):
    """Longer steps do not help where the linearisation of a step limits its progress."""
    angle = np.linspace(0.0, 2.0, 41)
    arc = write_obj(
        tmp_path / "arc.obj", (np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), False)
    )
    chord = 2.0 * np.sin(1.0)
    monkeypatch.setattr(setup, "MAX_STEPS", 60)
    first = summary("curve-flow", arc)
    (warning,) = [text for text in first["warnings"] if "curves still move" in text]
    assert first["results"]["length"][-1] > chord * (1 + 1e-5)
    remedy = summary("curve-flow", arc, "--steps", warning.rsplit("--steps ", 1)[1])
    assert remedy["results"]["length"][-1] < chord * (1 + 1e-9)


def test_no_number_of_steps_is_named_where_the_energy_falls_no_more_or_ever_faster():
    number = np.arange(51.0)
    assert 1.0 < _extrapolated_rest(1.0 + np.exp(-0.1 * number)) < 6.0
    for energy in (np.ones(51), 1.0 + 1e-13 * np.exp(-0.1 * number), 2.0 - (number / 50) ** 2, np.ones(1)):
        assert math.isinf(_extrapolated_rest(energy))


@pytest.mark.parametrize("turns", [1, 2])
def test_the_steps_named_for_closed_curves_lead_to_points_and_are_few(tmp_path, summary, monkeypatch, turns):
    """(L^2)' <= -8 pi^2 by Fenchel: the time of a circle, and four times that of one that turns twice."""
    angle = 2 * np.pi * turns * (np.arange(24 * turns) + 0.2 * (-1.0) ** np.arange(24 * turns)) / (24 * turns)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    path = write_obj(tmp_path / "circle.obj", (circle, True))
    monkeypatch.setattr(setup, "MAX_STEPS", 40)
    first = summary("curve-flow", path, "--dt", 2.5e-3)
    (warning,) = [text for text in first["warnings"] if "curves still move" in text]
    steps = warning.rsplit("--steps ", 1)[1]
    assert int(steps) <= 1.5 * 200 * turns**2
    remedy = summary("curve-flow", path, "--dt", 2.5e-3, "--steps", steps)
    assert remedy["results"]["stopped_because"] == "every curve has shrunk to a point"


def test_a_singular_matrix_of_a_step_names_a_smaller_penalty_or_step(tmp_path, run):
    """The bending is below the rounding of the penalty: no face and no component is to blame."""
    path = write_obj(tmp_path / "ellipse.obj", (ellipse(60, 2.0, 1.0).points, True))
    words = ("curve-flow", path, "--flow", "elastic", "--steps", 5)
    failed = run(*words, "--length-penalty", 1e30)
    assert failed.exit_code == 1
    assert "use a shorter --dt or a smaller --length-penalty" in failed.stderr and "face" not in failed.stderr
    assert run(*words, "--length-penalty", 10.0).exit_code == 0
    assert run(*words, "--length-penalty", 1e30, "--dt", 1e-33).exit_code == 0


def test_a_fold_counts_after_another_curve_has_shrunk_to_a_point(tmp_path, run):
    angle = 2 * np.pi * np.arange(80) / 80
    eight = np.stack([np.cos(angle), 0.5 * np.sin(2 * angle), 0 * angle], axis=1)
    small = ellipse(24, 0.2, 0.2).points + [3.0, 0.0, 0.0]
    path = write_obj(tmp_path / "both.obj", (eight, True), (small, True))
    ended = run("curve-flow", path, "--dt", 1e-3, "--steps", 700)
    assert ended.exit_code == 1 and "folds back on itself" in ended.stderr


@pytest.mark.parametrize("closed", [True, False])
def test_a_late_collapse_is_reported_beside_other_curves(tmp_path, summary, closed):
    """An open curve took the check away, and a large closed one hid that of a small one."""
    small, large = ellipse(40, 0.5, 0.5).points, ellipse(40, 5.0, 5.0).points + [20.0, 0.0, 0.0]
    path = write_obj(tmp_path / "two.obj", (small, True), (large if closed else large[:20], closed))
    result = summary("curve-flow", path, "--dt", 0.0157, "--steps", 20)
    (end,) = [time for time in result["results"]["collapse_times"] if time is not None]
    exact = 0.125  # half the squared radius
    assert end > 1.3 * exact and result["accuracy"]["area_rate_error"] == pytest.approx(
        1 - exact / end, abs=0.02
    )
    assert any("the area does not fall by 2 pi" in text for text in result["warnings"])
