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
PLATE = """format = "ddgcli-scene/1"
[[object]]
name = "plate"
role = "shell"
grid = {{ size = [1, 1], cells = [8, 8] }}
young = 7e10
poisson = 0.3
thickness = "2 mm"
density = 5.4
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
gravity = {{ acceleration = [0, 0, {gravity}] }}
{effects}
[[effects.pin]]
box = [[0, 0, 0], [0, 1, 0]]
clamp = true
[[effects.pin]]
box = [[1, 0, 0], [1, 1, 0]]
clamp = true
"""
PENDULUM = jn_zeros(0, 1)[0] / (4 * np.pi) * np.sqrt(9.81 / 0.3)  # Hz, of a hanging chain of 0.3 m


def frequencies(tmp_path, summary, scene, *options):
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    out = summary("shell-sim", path, "--modes", 7, *options)
    return np.array(out["results"]["frequencies"]), [w for w in out["warnings"] if "hinges" not in w]


@pytest.fixture
def estimates(monkeypatch):
    """Results of `natural_modes`, by the runs of a test."""
    results, modes = [], analysis.natural_modes
    monkeypatch.setattr(
        analysis, "natural_modes", lambda *call, **key: results.append(modes(*call, **key)) or results[-1]
    )
    return results


def test_a_limp_strip_that_hangs_swings_as_a_chain_at_rest_and_warns_about_the_start(
    tmp_path, summary, estimates
):
    """Without its weight 0.05 Hz by bending; linear in the stress, so the estimate errs by the elongation."""
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


def test_a_clamped_plate_that_sags_is_stiffened_in_second_order_as_at_rest(tmp_path, summary, estimates):
    """Its weight bends it, and changes no frequency in first order; it sags by a tenth of its thickness."""
    scene = PLATE.format(gravity=-1, effects="")
    start, warnings = frequencies(tmp_path, summary, scene)
    rest, _ = frequencies(tmp_path, summary, scene, "--integrator", "static")
    assert not warnings and rest[0] > 1.002 * start[0]
    np.testing.assert_allclose(
        estimates[0].at_equilibrium - start, rest - start, rtol=0.1, atol=1e-4 * rest[0]
    )


@pytest.mark.parametrize("effect", ["wind = { velocity = [0, 0, 1] }", "fracture = { strain = 0.1 }"])
def test_a_clamped_plate_that_sags_by_its_thickness_warns_with_a_cure_for_its_effects(
    tmp_path, summary, effect
):
    """`static` refuses what has no energy, and what breaks: the warning names them."""
    scene = PLATE.format(gravity=-9.81, effects=effect)
    start, (warning,) = frequencies(tmp_path, summary, scene)
    name = warning.split("leave out ")[1].split()[0]
    cured = "\n".join(line for line in scene.splitlines() if not line.startswith(name))
    rest, warnings = frequencies(tmp_path, summary, cured, *warning.split("use ")[1].split())
    assert rest[0] > 1.1 * start[0] and not warnings


def test_a_free_ball_that_falls_under_a_pressure_is_to_be_held(tmp_path, summary):
    scene = BALL.format(value=30000, gas="false") + "gravity = { acceleration = [0, 0, -9.81] }\n"
    _, (warning,) = frequencies(tmp_path, summary, scene)
    assert "hold it by pins and use --integrator static" in warning
    scene += "pin = { vertices = [0, 1, 2] }\n"
    rest, warnings = frequencies(tmp_path, summary, scene, "--integrator", "static")
    assert (rest > 0).all() and not warnings
