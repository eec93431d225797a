"""Buoyancy and flows with a name: work against gravity, conduction, steady harmonics."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid
from tests.physics.test_fluid_forces import last_frame
from tests.physics.test_fluid_volumes import run, series


def test_temperature_that_depends_on_height_alone_moves_nothing():
    _, observed, _ = run('buoyancy = { temperature = "10*z" }', 3)
    assert series(observed, "kinetic_energy").max() < 1e-4 * 10  # a linear temperature: cells hold its mean
    assert np.abs(observed[-1].vertex["temperature"] - observed[0].vertex["temperature"]).max() < 0.1


def test_warm_fluid_rises_and_its_heat_is_kept():
    hot = 'buoyancy = { temperature = "100*exp(-((x-1.5)^2+(y-1.5)^2+(z-0.8)^2)/0.2)" }'
    model, observed, _ = run(hot, 6, 1.0, 0.1, "circulation")
    total = series(observed, "total_temperature")
    assert np.ptp(total) < 1e-12 * total[0]
    z, mass = model.context.points[:, 2], model.space.mass

    def height(o):
        return (mass * o.vertex["temperature"]) @ z / (mass @ o.vertex["temperature"])

    assert height(observed[-1]) > height(observed[0]) + 0.1


def test_the_first_acceleration_is_expansion_times_temperature_times_gravity():
    """T = sin(pi x) along x: the push has no gradient part but for the walls."""
    _, one, _ = run('buoyancy = { temperature = "cos(x)" }', 4, 0.01, 0.01)
    _, two, _ = run('buoyancy = { temperature = "cos(x)", expansion = 6.8e-3 }', 4, 0.01, 0.01)
    speed = [np.sqrt(2 * series(o, "kinetic_energy")[-1]) for o in (one, two)]
    assert speed[1] == pytest.approx(2 * speed[0], rel=1e-6) and speed[0] > 0


def test_sources_heat_at_their_rate_and_diffusion_keeps_the_heat():
    _, observed, _ = run('buoyancy = { source = "1+x", diffusivity = 1, expansion = 0 }', 3, 0.2, 0.1)
    whole = np.pi**3 * (1 + np.pi / 2)
    assert series(observed, "total_temperature")[-1] == pytest.approx(0.2 * whole, rel=1e-9)
    warm = observed[-1].vertex["temperature"]
    assert np.ptp(warm) < 0.2 * np.pi * 0.99


def test_the_haurwitz_wave_has_its_speed_and_stays():
    points, mass, first, last = last_frame(
        "sphere = { subdivisions = 4 }", 'initial = { flow = "rossby-haurwitz", strength = 0.5 }'
    )
    assert np.linalg.norm(first.vertex["velocity"], axis=1).max() == pytest.approx(0.5, rel=0.02)
    change = last.vertex["vorticity"] - first.vertex["vorticity"]
    assert np.sqrt(mass @ change**2 / (mass @ first.vertex["vorticity"] ** 2)) < 0.01


@pytest.mark.parametrize(
    "flow, shape",
    [
        ("jet", "sphere = { subdivisions = 4 }"),
        ("shear-layer", 'grid = { size = [1, 1], cells = [60, 60], periodic = "xy" }'),
    ],
)
def test_flows_with_a_name_have_their_strength(flow, shape):
    *_, first, _ = last_frame(shape, f'initial = {{ flow = "{flow}", strength = 2 }}', 0.01, 0.01)
    assert np.linalg.norm(first.vertex["velocity"], axis=1).max() == pytest.approx(2.0, rel=0.12)


@pytest.mark.parametrize("wave, cells", [("cos(x)*cos(2*y)", [32, 32]), ("cos(x)*cos(y)*cos(z)", [6, 6, 6])])
def test_heat_conduction_is_of_second_order_in_time(wave, cells):
    """Decay of a wave between insulated walls, in steps of 0.2 s; what the mesh errs by is that of 0.05 s."""
    shape = "grid" if len(cells) == 2 else "box"
    shape = f"{shape} = {{ size = {[np.pi] * len(cells)}, cells = {cells} }}"
    heat = f'buoyancy = {{ temperature = "{wave}", gravity = [0, 0, 0], diffusivity = 0.2 }}'
    rates = []
    for step in (0.2, 0.05):
        time = f'integrator = "energy"\nduration = 1.0\nstep = {step}'
        observed = run_fluid(heat, time, shape).observations
        start, end = (observed[k].vertex["temperature"] for k in (0, -1))
        rates.append(-np.log((end @ start) / (start @ start)))
    assert rates[0] == pytest.approx(rates[1], rel=2e-3)


def test_heating_in_balance_with_conduction_does_not_depend_on_the_step():
    """Heat flows from one wall to the other: the profile is linear, whatever the step."""
    heat = 'source = "16 * (where(x < 1e-6, 1, 0) - where(x > 1 - 1e-6, 1, 0))"'
    effects = f'buoyancy = {{ temperature = "0.5-x", gravity = [0, 0, 0], diffusivity = 1, {heat} }}'
    grid = 'grid = { size = [1, 1], cells = [8, 8], pattern = "right", periodic = "y" }'
    ended = run_fluid(effects, "duration = 0.4\nstep = 0.2", grid)
    start, end = (ended.observations[k].vertex["temperature"] for k in (0, -1))
    assert np.abs(end - start).max() < 1e-12


def test_a_layer_heated_from_below_turns_over_above_the_critical_rayleigh_number():
    """Walls of constant temperature without slip, waves of number 3.117: 1707.76 (Chandrasekhar 1961)."""
    wave, rates = 3.117, []
    for rayleigh in (1500.0, 1900.0):
        temperature = f'temperature = "0.5 - y + 1e-4*cos({wave}*x)*sin(pi*y)"'
        drive = (
            f"fixed = 'abs(y - 0.5) > 0.499', expansion = {rayleigh}, gravity = [0, -1, 0], diffusivity = 1"
        )
        effects = 'viscosity = { nu = 1 }\nharmonic = {}\nboundary = { kind = "no-slip" }\n'
        effects += f"buoyancy = {{ {temperature}, {drive} }}"
        grid = f'size = [{2 * np.pi / wave}, 1], cells = [24, 12], pattern = "right", periodic = "x"'
        ended = run_fluid(effects, "duration = 0.4\nstep = 0.02\nframe_every = 0.1", f"grid = {{ {grid} }}")
        energy = ended.series("kinetic_energy")
        rates.append(np.log(energy[-1] / energy[-2]) / 0.2)
    critical = 1500.0 - rates[0] * 400.0 / (rates[1] - rates[0])
    assert rates[0] < 0 < rates[1]
    assert critical == pytest.approx(1707.76, rel=0.02)


def test_a_fixed_temperature_nowhere_is_an_error():
    with pytest.raises(ValueError, match="no vertex lies where 'y > 2' holds; check `fixed`"):
        run_fluid('buoyancy = { fixed = "y > 2" }', "step = 0.1", "grid = { size = [1, 1], cells = [4, 4] }")
