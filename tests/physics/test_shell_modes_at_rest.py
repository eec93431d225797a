"""Natural frequencies about a start that is not in equilibrium: estimate and warning."""

import numpy as np
import pytest
from scipy.special import jn_zeros

from ddgcli.models.shell import analysis

STRIP = """format = "ddgcli-scene/1"
[[object]]
name = "strip"
role = "shell"
grid = {{ size = ["5 cm", "30 cm"], cells = [2, {cells}] }}
rotation = {{ axis = [1, 0, 0], degrees = {degrees} }}
young = {young}
poisson = 0.3
thickness = "0.5 mm"
density = 0.5
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
gravity = {{ acceleration = [0, 0, -9.81] }}
pin = {{ box = [[0, 0, 0], [1, 0, 0]], clamp = true }}
"""
BALL = """format = "ddgcli-scene/1"
[[object]]
name = "ball"
role = "shell"
sphere = {{ subdivisions = 2 }}
young = 1e9
poisson = 0.3
thickness = 0.02
density = 20
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
pressure = {{ value = {value}, gas = {gas} }}
"""
PENDULUM = jn_zeros(0, 1)[0] / (4 * np.pi) * np.sqrt(9.81 / 0.3)  # Hz, of a hanging chain of 0.3 m


def frequencies(tmp_path, summary, scene, *options):
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    out = summary("shell-sim", path, "--modes", 7, *options)
    return np.array(out["results"]["frequencies"]), [w for w in out["warnings"] if "hinges" not in w]


def test_a_limp_strip_that_hangs_swings_as_a_chain_at_rest_and_warns_about_the_start(
    tmp_path, summary, monkeypatch
):
    """Without its weight 0.05 Hz by bending; linear in the stress, so the estimate errs by the elongation."""
    estimates = []
    modes = analysis.natural_modes
    monkeypatch.setattr(
        analysis, "natural_modes", lambda *call, **key: estimates.append(modes(*call, **key)) or estimates[-1]
    )
    scene = STRIP.format(cells=24, degrees=-90, young=3e6)
    start, (warning,) = frequencies(tmp_path, summary, scene)
    assert start[0] < 0.06 and f"one of {start[0]:.3g} Hz" in warning
    assert estimates[0].at_equilibrium[0] == pytest.approx(PENDULUM, rel=0.04)
    assert estimates[0].way == pytest.approx(1000 * 9.81 * 0.3**2 / (2 * 3e6) / 0.3, rel=0.1)
    rest, warnings = frequencies(tmp_path, summary, scene, *warning.split("use ")[1].split())
    assert rest[0] == pytest.approx(PENDULUM, rel=0.02) and not warnings


def test_a_strip_that_sags_far_is_reported_and_one_that_bears_its_weight_is_not(tmp_path, summary):
    for young, far in ((3e6, True), (3e11, False)):
        _, warnings = frequencies(tmp_path, summary, STRIP.format(cells=12, degrees=0, young=young))
        assert [("by linear theory it moves" in w) for w in warnings] == [True] * far


@pytest.mark.parametrize("gas", ["false", "true"])
@pytest.mark.parametrize("value", [-1000, 30000])
def test_a_free_ball_under_a_pressure_that_its_stress_does_not_bear_turns_freely_at_rest_only(
    tmp_path, summary, value, gas
):
    """Energies do not change in a rotation, so six frequencies are zero at every equilibrium."""
    scene = BALL.format(value=value, gas=gas)
    start, (warning,) = frequencies(tmp_path, summary, scene)
    assert np.count_nonzero(start[:6]) == 3 and "not in equilibrium" in warning
    rest, warnings = frequencies(tmp_path, summary, scene, *warning.split("use ")[1].split())
    assert (rest[:6] == 0).all() and rest[6] > 100 and not warnings
