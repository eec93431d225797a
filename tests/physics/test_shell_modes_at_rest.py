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


SQUARE = """format = "ddgcli-scene/1"
[[object]]
name = "square"
role = "shell"
grid = {{ size = ["30 cm", "30 cm"], cells = [{cells}, {cells}] }}
material = "rubber"
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
{effects}
"""
GRAVITY = "gravity = { acceleration = [0, 0, -9.81] }\n"


def frequencies(tmp_path, summary, scene, *options, count=7):
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    out = summary("shell-sim", path, "--modes", count, *options)
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
    assert estimates[0].displacement == pytest.approx(1000 * 9.81 * 0.3**2 / (2 * 3e6) / 0.3, rel=0.1)
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
def test_a_clamped_plate_that_sags_by_its_thickness_warns_with_a_remedy_for_its_effects(
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


@pytest.mark.parametrize("cells", [1, 4])  # of one, linear theory has a rigid motion and no more
@pytest.mark.parametrize("count", [1, 3, 6])
def test_a_square_that_its_weight_turns_about_a_pin_warns_for_every_number_of_modes(
    tmp_path, summary, cells, count
):
    scene = SQUARE.format(cells=cells, effects=GRAVITY + "pin = { vertices = [0] }")
    start, (warning,) = frequencies(tmp_path, summary, scene, count=count)
    assert (start[:3] == 0).all() and "not in equilibrium" in warning
    rest, warnings = frequencies(
        tmp_path, summary, scene, *warning.split("use ")[1].split(), count=max(count, 2)
    )
    assert abs(rest[0]) < 1e-3 < rest[1] and not warnings  # it turns about the vertical, and swings


@pytest.mark.parametrize("count", [1, 6, 8])
@pytest.mark.parametrize("effects", [
    "pin = { vertices = [0] }",  # no load
    GRAVITY,  # in free fall it is without stress
    GRAVITY + 'pin = { vertices = [0, 1, 2, 3, 4], axes = "xy" }',  # it falls along rails
    "load = { traction = [1, 0, 0] }",
])  # fmt: skip
def test_rigid_motions_that_no_load_turns_are_without_a_warning(tmp_path, summary, effects, count):
    start, warnings = frequencies(tmp_path, summary, SQUARE.format(cells=2, effects=effects), count=count)
    assert start[0] == 0 and not warnings


def test_a_strip_upright_on_a_hinge_is_reported_as_unstable_at_rest(tmp_path, summary):
    """An inverted pendulum, in equilibrium; its weight compresses it."""
    scene = STRIP.format(cells=12, degrees=90, young=3e6).replace(", clamp = true", "")
    start, (warning,) = frequencies(tmp_path, summary, scene, count=1)
    assert start[0] == 0 and "one of 0 Hz is unstable at rest" in warning


@pytest.mark.parametrize("analysis", ["--modes", "--buckling"])
def test_options_of_time_steps_are_errors_beside_an_analysis_that_takes_none(
    tmp_path, run, summary, analysis
):
    path = tmp_path / "scene.toml"
    path.write_text(PLATE.format(gravity=-9.81, effects=""))
    for option in ("--steps 2", "--duration 1", "--dt 0.1", "--frame-every 0.1", "--tolerance 1e-3"):
        result = run("shell-sim", path, analysis, 2, *option.split())
        assert result.exit_code == 2, option
        assert f"{option.split()[0]}: {analysis} takes no time steps" in result.output + result.stderr
    assert summary("shell-sim", path, "--modes", 1, "--steps", 2, "--integrator", "static")


def test_a_free_triangle_that_falls_vibrates_as_without_gravity(tmp_path, summary, estimates):
    """All its modes span the space: what rounding left of further ones was reported as unstable."""
    (tmp_path / "triangle.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path = tmp_path / "scene.toml"
    path.write_text("""format = "ddgcli-scene/1"
[[object]]
name = "s"
role = "shell"
mesh = "triangle.obj"
material = "rubber"
[effects]
stretching = {}
gravity = {}
""")
    for count in (3, 9):
        out = summary("shell-sim", path, "--modes", count)
        assert not out["warnings"]
    frequencies = out["results"]["frequencies"]
    assert frequencies[:6] == [0] * 6 and frequencies[6] > 1
    np.testing.assert_allclose(estimates[-1].at_equilibrium, frequencies)
