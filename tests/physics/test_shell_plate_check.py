"""Warnings that hinges do not bend as the plate: none where results are those of a beam."""

import numpy as np
import pytest

STRIP = """format = "ddgcli-scene/1"
[time]
{time}
[[object]]
name = "strip"
role = "shell"
grid = {{ size = [1, 0.1], cells = [{cells}, {rows}] }}
young = 1e9
poisson = 0
thickness = "{thickness} mm"
density = 1
[effects]
stretching = {{}}
bending = {{ model = "hinge" }}
pin = {{ box = [[0, 0, 0], [0, 1, 0]], clamp = true }}
load = {{ box = [[1, 0, 0], [1, 1, 0]], {load} }}
"""


STEPS = 'integrator = "static"\nload_steps = 6'


def strip_run(tmp_path, summary, *options, cells, rows, load="force = [-1, 0, 0]", thickness=5, time=""):
    """Results of a strip clamped at one end, and warnings about its hinges."""
    path = tmp_path / "strip.toml"
    path.write_text(STRIP.format(time=time, cells=cells, rows=rows, load=load, thickness=thickness))
    out = summary("shell-sim", path, *options)
    return out["results"], [text for text in out["warnings"] if "hinges" in text]


RIGIDITY = 1e9 * 0.005**3 / 12  # N m


def test_the_euler_load_of_a_fine_strip_has_no_warning(tmp_path, summary):
    """The plate beside it had a share of the masses in its stiffness: 13 % too soft a strip was reported."""
    results, warnings = strip_run(tmp_path, summary, "--buckling", 1, cells=40, rows=4)
    assert results["load_factors"][0] == pytest.approx(0.1 * np.pi**2 * RIGIDITY / 4, rel=0.02)
    assert not warnings


def test_the_frequency_of_a_fine_strip_has_no_warning_and_of_two_rows_has_one(tmp_path, summary):
    """1.8751^2 sqrt(D / density) / 2 pi; triangles half as wide as long are softer hinges."""
    truth = 1.87510407**2 / (2 * np.pi) * np.sqrt(RIGIDITY)
    results, warnings = strip_run(tmp_path, summary, "--modes", 1, cells=60, rows=6)
    assert results["frequencies"][0] == pytest.approx(truth, rel=0.02) and not warnings
    results, (warning,) = strip_run(tmp_path, summary, "--modes", 1, cells=40, rows=2)
    factor = float(warning.split("about ")[1].split(" times too low")[0])
    assert factor * results["frequencies"][0] == pytest.approx(truth, rel=0.03)


def test_a_strip_that_couples_bend_to_a_half_circle_has_no_warning(tmp_path, summary):
    """Couples have no work along the chord of a large rotation: a small angle was 2.1 of it."""
    thin = RIGIDITY / 125
    _, warnings = strip_run(
        tmp_path, summary, cells=40, rows=4, load=f"moment = {np.pi * thin}", thickness=1, time=STEPS
    )
    assert not warnings
