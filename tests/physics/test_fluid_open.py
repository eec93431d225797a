"""Open boundaries and obstacles of a surface flow: Poiseuille flow, balances, refusals, cut meshes."""

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

INFLOW = '[[effects.boundary]]\nkind = "inflow"\nvelocity = ["4*y*(1-y)", 0, 0]\nwhere = "x < 1e-9"\n'
OUTFLOW = '[[effects.boundary]]\nkind = "outflow"\nwhere = "x > 2 - 1e-9"\n'
CYLINDER = '[[object]]\nname = "post"\nrole = "obstacle"\ncylinder = { start = [1, 0.5, -1], '
CYLINDER += "end = [1, 0.5, 1], radius = 0.21 }\n"


def channel(effects, cells=8, duration=0.04, step=0.02, objects="", time="", friction="nu = 0.05"):
    """(fluid model, observations) of a run in the rectangle 2 x 1."""
    text = f"[time]\nduration = {duration}\nstep = {step}\n{time}\n"
    grid = f"grid = {{ size = [2, 1], cells = [{2 * cells}, {cells}] }}"
    text += f'[[object]]\nname = "f"\nrole = "fluid"\n{grid}\n'
    return run(f"{text}{objects}[effects]\nviscosity = {{ {friction} }}\n{effects}")


def run(text):
    """(fluid model, observations) of a scene."""
    scene = resolve(parse_scene(text), KIND, {})
    account = Account()
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    models = build(scene, fluids, account)
    snapshots = list(evolve({n: m.model() for n, m in models.items()}, scene.schedule(), account))
    return models["f"], [snapshot.observations["f"] for snapshot in snapshots]


def stream_function(model, observation):
    space = model.space
    return space.stream_function(observation.vertex["vorticity"] * space.mass)


def test_poiseuille_flow_leaves_through_a_natural_outflow_as_it_entered():
    """u = 4 y (1 - y), phi = 2 y^2 - 4 y^3 / 3: second order, no profile at the outflow."""
    error = []
    for cells in (6, 12):
        model, observed = channel(INFLOW + OUTFLOW, cells, 4.0, 0.04)
        y = model.context.points[:, 1]
        phi = stream_function(model, observed[-1])
        exact = 2 * y**2 - 4 * y**3 / 3
        offset = (phi - exact)[model.context.mesh.topology.boundary_vertex & (y == 0)].mean()
        error.append(np.abs(phi - exact - offset).max())
        assert observed[-1].scalar["divergence"] < 1e-13
    assert error[1] < 2.5e-3 and error[0] / error[1] > 3


@pytest.mark.parametrize("integrator", ["conservative", "energy"])
def test_a_steady_flow_through_open_boundaries_does_not_depend_on_the_step(integrator):
    """The flow behind a grid (L. I. G. Kovasznay, 1948) at Re 40, with its velocity along the boundary."""
    decay = 20 - np.hypot(20, 2 * np.pi)
    u = f"1 - exp(({decay})*x)*cos(2*pi*y)"
    velocity = f'["{u}", "({decay})/(2*pi)*exp(({decay})*x)*sin(2*pi*y)", 0]'
    sections = (f'kind = "outflow"\nwhere = "x > 0.999"\nvelocity = {velocity}',)
    sections += (f'kind = "inflow"\nvelocity = {velocity}',)
    flows, errors = [], []
    for step in (0.05, 0.025):
        text = f'[time]\nduration = 6\nstep = {step}\nframe_every = 6\nintegrator = "{integrator}"\n'
        text += '[[object]]\nname = "f"\nrole = "fluid"\nposition = [0, -0.5, 0]\n'
        text += "grid = { size = [1, 1], cells = [6, 6] }\n[effects]\nviscosity = { nu = 0.025 }\n"
        model, observed = run(text + "".join(f"[[effects.boundary]]\n{section}\n" for section in sections))
        x, y, _ = model.context.points.T
        phi = stream_function(model, observed[-1])
        apart = phi - y + np.exp(decay * x) * np.sin(2 * np.pi * y) / (2 * np.pi)
        flows.append(phi)
        errors.append(np.abs(apart - apart[model.context.mesh.topology.boundary_vertex].mean()).max())
    assert np.abs(flows[0] - flows[1]).max() < 1e-3 * errors[0]
    assert max(errors) < 0.015  # of a flux of 1


def test_a_uniform_stream_between_walls_of_free_slip_stays_uniform():
    """Corners of an inflow or an outflow and such a wall add no vorticity."""
    inflow = INFLOW.replace('["4*y*(1-y)", 0, 0]', "[1, 0, 0]")
    walls = '[[effects.boundary]]\nkind = "free-slip"\n'
    for outflow in (OUTFLOW, OUTFLOW.replace('"outflow"', '"outflow"\nvelocity = [1, 0, 0]')):
        _, observed = channel(inflow + outflow + walls, duration=0.2)
        assert observed[-1].vertex["velocity"][:, 0] == pytest.approx(1.0, abs=1e-12)
        assert np.abs(observed[-1].vertex["vorticity"]).max() < 1e-11


def test_a_prescribed_flux_leaves_where_it_is_prescribed():
    out = OUTFLOW.replace('kind = "outflow"', 'kind = "outflow"\nflux = 0.6666666666666666')
    model, observed = channel(INFLOW + out)
    x, y, _ = model.context.points.T
    phi = stream_function(model, observed[-1])
    right = np.argsort(y[x == 2])
    assert np.allclose(np.diff(phi[x == 2][right]), 2 / 3 / 8, rtol=0, atol=1e-12)  # spread evenly
    top, bottom = phi[(y == 1) & (x > 0.1)], phi[(y == 0) & (x > 0.1)]
    assert np.allclose(top - bottom, 2 / 3, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "effects, message",
    [
        (INFLOW, "boundary: inflow without outflow: add"),
        (
            INFLOW + OUTFLOW + "flux = 0.5\n",
            r"0.166667 m\^2/s more flow in than out through the boundary loop",
        ),
        (INFLOW.replace('"4*', '"-4*') + OUTFLOW, "brings no fluid in; reverse it"),
        (INFLOW.replace('"4*', '"0*') + OUTFLOW, "brings no fluid in; give it a speed towards the fluid"),
        (INFLOW + OUTFLOW.replace("2 -", "3 -"), "no boundary side lies where"),
        (INFLOW + OUTFLOW + OUTFLOW.replace("x > 2 - 1e-9", "y > 1 - 1e-9"), None),
        (
            INFLOW + OUTFLOW.replace('where = "x > 2 - 1e-9"', 'where = "x > 2 - 1e-9"\nobstacle = "q"'),
            "no obstacle 'q'",
        ),
    ],
)
def test_flux_that_does_not_balance_is_refused(effects, message):
    if message is None:
        channel(effects)  # both outflows meet at a corner: one natural outflow
        return
    with pytest.raises(SceneError, match=message):
        channel(effects)


def test_two_natural_outflows_apart_are_refused():
    other = (
        OUTFLOW.replace("x > 2 - 1e-9", "y > 1 - 1e-9 and x < 1".replace(" and ", ") * ("))
        .replace('where = "y', 'where = "(y')
        .replace('x < 1"', 'x < 1)"')
    )
    with pytest.raises(SceneError, match="2 natural outflows on one boundary loop"):
        channel(INFLOW + OUTFLOW + other)


def test_open_boundaries_need_friction_and_an_integrator_that_has_them():
    with pytest.raises(SceneError, match="need the effect viscosity"):
        channel(INFLOW + OUTFLOW, friction="nu = 0")
    with pytest.raises(SceneError, match="no inflow and outflow; take conservative or energy"):
        channel(INFLOW + OUTFLOW, time='integrator = "circulation"')


def test_a_moving_wall_among_walls_is_that_of_its_section():
    """Kind wall with velocity on the top: the same as no-slip with velocity there."""
    wall = '[[effects.boundary]]\nkind = "{}"\nvelocity = [1, 0, 0]\nwhere = "y > 0.99"\n'
    (first, a), (_, b) = channel(wall.format("wall")), channel(wall.format("no-slip"))
    assert np.array_equal(a[-1].vertex["vorticity"], b[-1].vertex["vorticity"])
    slip = '[[effects.boundary]]\nkind = "free-slip"\n'
    _, c = channel(wall.format("wall") + slip)
    y = first.context.points[:, 1]
    assert np.all(c[-1].vertex["vorticity"][y == 0] == 0) and np.any(a[-1].vertex["vorticity"][y == 0] != 0)


def test_a_cylinder_is_cut_out_with_its_boundary_on_the_circle():
    model, observed = channel(INFLOW + OUTFLOW + "[effects.harmonic]\n", 16, objects=CYLINDER)
    context, space = model.context, model.space
    rim = context.obstacles["post"]
    x, y, _ = context.points[rim].T
    assert np.abs(np.hypot(x - 1, y - 0.5) - 0.21).max() < 1e-12 and 15 < rim.sum() < 45
    assert context.mesh.topology.boundary_loops == 2
    assert space.area.sum() == pytest.approx(2 - np.pi * 0.21**2, abs=0.004)
    # no fluid crosses the cylinder
    phi = stream_function(model, observed[-1])
    assert np.ptp(phi[rim]) < 1e-13
    assert observed[-1].scalar["divergence"] < 1e-12


def test_a_start_without_an_initial_flow_has_the_least_energy_and_an_initial_one_its_own():
    """Inflow without circulation round the cylinder; face velocities of a discrete flow give that flow."""
    model, _ = channel(INFLOW + OUTFLOW + "[effects.harmonic]\n", 12, objects=CYLINDER)
    space, start = model.space, model.start
    least = space.energy(start)
    for change in (-0.1, 0.1):
        other = start.replaced(coefficients=start["coefficients"] + change)
        assert space.energy(other) == pytest.approx(least + 0.5 * 0.1**2, rel=1e-9)
        velocity = space.face_velocity(space.flow(other).side_flux)
        own = space.rest()["coefficients"] + space.of_face_velocity(velocity)[1]
        assert np.abs(own - other["coefficients"]).max() < 1e-10


@pytest.mark.parametrize(
    "shape",
    [
        "sphere = { center = [1, 0.5, 0], radius = 0.21 }",
        "box = { corner = [0.8, 0.3, -1], size = [0.4, 0.4, 2] }",
    ],
)
def test_other_obstacles_are_cut_too(shape):
    text = f'[[object]]\nname = "post"\nrole = "obstacle"\n{shape}\n'
    model, _ = channel(INFLOW + OUTFLOW + "[effects.harmonic]\n", 10, objects=text)
    expected = 0.16 if "box" in shape else np.pi * 0.21**2
    assert model.space.area.sum() == pytest.approx(2 - expected, abs=0.02)
    assert model.context.obstacles["post"].sum() > 8


def test_an_obstacle_beside_the_fluid_is_refused():
    with pytest.raises(SceneError, match="object 'f': obstacle 'post' cuts no cell of 'f'; move it"):
        channel(INFLOW + OUTFLOW, objects=CYLINDER.replace("[1, 0.5, ", "[7, 0.5, "))


@pytest.mark.parametrize("dimension", [2, 3])
def test_dye_leaves_through_an_outflow_and_enters_with_the_fluid(dimension):
    """Two blobs in a uniform stream: one fills the inflow and enters with the fluid, the other leaves."""
    size, cells = ([2, 1], [20, 10]) if dimension == 2 else ([2, 1, 1], [8, 4, 4])
    shape = f"grid = {{ size = {size}, cells = {cells} }}"
    if dimension == 3:
        shape = f"box = {{ size = {size}, cells = {cells} }}"
    stream = INFLOW.replace('"4*y*(1-y)"', "1") + OUTFLOW + '[[effects.boundary]]\nkind = "free-slip"\n'
    time = '[time]\nduration = 2.5\nstep = 0.05\nframe_every = 0.5\nintegrator = "energy"\n'
    start = f'{time}[[object]]\nname = "f"\nrole = "fluid"\n'
    dye = 'dye = { amount = "exp(-16*(x-1)^2)" }\n'
    warm = 'buoyancy = { temperature = "x < 0.01", gravity = [0, 0, 0], diffusivity = 1e-9 }\n'
    _, observed = run(f"{start}{shape}\n[effects]\nviscosity = {{ nu = 0.01 }}\n{dye}{warm}{stream}")
    total = [o.scalar["total_dye"] for o in observed]
    assert total[1] == pytest.approx(total[0], rel=0.02) and total[5] < 1e-3 * total[0]
    entered = np.array([o.scalar["total_temperature"] for o in observed])
    assert np.diff(entered[:3]) == pytest.approx(0.5, rel=0.02)
    assert observed[5].vertex["temperature"].min() > 0.9 and entered[5] == pytest.approx(2, rel=0.02)


def test_energy_takes_long_steps_of_a_stream_without_vorticity():
    """Its vorticity is rounding, to which changes are not relative: each step was divided into 64."""
    text = (
        '[time]\nduration = 0.5\nstep = 0.05\nintegrator = "energy"\n[[object]]\nname = "f"\nrole = "fluid"\n'
    )
    text += "grid = { size = [2, 1], cells = [40, 20] }\n[effects]\nviscosity = { nu = 0.01 }\n"
    stream = INFLOW.replace('"4*y*(1-y)"', "1") + OUTFLOW + '[[effects.boundary]]\nkind = "free-slip"\n'
    scene = resolve(parse_scene(text + stream), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    models = build(scene, fluids, Account())
    snapshots = list(evolve({n: m.model() for n, m in models.items()}, scene.schedule(), Account()))
    assert snapshots[-1].steps == 10
