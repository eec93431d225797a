"""Velocities and fluxes of the boundary that depend on time: exact flows, orders in time, refusals."""

import numpy as np
import pytest
from scipy.special import iv, kv

from ddgcli import TriangleMesh, write_mesh
from ddgcli.errors import SceneError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.fluid.model import build, contexts, with_default_integrator
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.state import TIME
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import RunFailed, evolve

GRID = "grid = { size = [2, 1], cells = [12, 6] }"
BOX = "box = { corner = [0, 0, 0], size = [2, 1, 0.5], cells = [6, 3, 2] }"
STILL = '[[effects.boundary]]\nkind = "no-slip"\n'
FREE = '[[effects.boundary]]\nkind = "free-slip"\n'
SWING = 'velocity = ["sin(3*t) + 0.2", 0, 0]\n'
OSCILLATION = 3.0  # rad/s


def fluid(shape, effects, time="duration = 1\nstep = 0.1", integrator="", nu=0.05):
    """Fluid model and its schedule."""
    named = f'integrator = "{integrator}"\n' if integrator else ""
    text = f'[time]\n{time}\n{named}[[object]]\nname = "f"\nrole = "fluid"\n{shape}\n'
    text += f"[effects]\nviscosity = {{ nu = {nu} }}\n{effects}"
    scene = resolve(parse_scene(text), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, read_mesh, None).items()}
    scene = with_default_integrator(scene, fluids.values())
    return build(scene, fluids, Account())["f"], scene.schedule()


def run(*arguments, **keys):
    """Fluid model and the observations of its run."""
    model, schedule = fluid(*arguments, **keys)
    snapshots = evolve({"f": model.model()}, schedule, Account())
    return model, [snapshot.observations["f"] for snapshot in snapshots]


def side(kind, where, rest=""):
    return f'[[effects.boundary]]\nkind = "{kind}"\nwhere = "{where}"\n{rest}'


def along(profile):
    return f'velocity = ["{profile}", 0, 0]\n'


@pytest.mark.parametrize("out", ["", SWING, 'flux = "(sin(3*t) + 0.2)*AREA"\n'])
@pytest.mark.parametrize(
    "shape, integrator, area", [(GRID, "conservative", 1), (GRID, "energy", 1), (BOX, "energy", 0.5)]
)
def test_a_stream_between_walls_of_free_slip_swings_as_its_inflow(shape, integrator, area, out):
    """u = u(t) everywhere, pressure - u'(t) x; it enters and leaves in turn."""
    out = out.replace("AREA", str(area))
    sides = side("inflow", "x < 1e-9", SWING) + side("outflow", "x > 2 - 1e-9", out) + FREE
    model, observed = run(shape, "pressure = {}\n" + sides, integrator=integrator)
    x = model.context.points[:, 0]
    for number, seen in enumerate(observed):
        time = 0.1 * number
        velocity = [np.sin(3 * time) + 0.2, 0, 0]
        assert np.abs(seen.vertex["velocity"] - velocity).max() < 1e-12
        slope, _ = np.polyfit(x, seen.vertex["pressure"], 1)
        # the rate of change is a difference over 1e-4 of the run, one-sided at its ends
        assert slope == pytest.approx(-3 * np.cos(3 * time), abs=5e-4)


def oscillating_layer(nu):
    """Flow above a wall that swings as cos(3 t), below one at rest (Stokes): text at time 0, function."""
    k = np.sqrt(1j * OSCILLATION / nu)
    a, factor = k.real, 1 / np.sinh(k)
    text = f"({factor.real})*sinh({a}*(1-y))*cos({a}*(1-y)) - ({factor.imag})*cosh({a}*(1-y))*sin({a}*(1-y))"
    return text, lambda y, t: np.real(np.exp(1j * OSCILLATION * t) * np.sinh(k * (1 - y)) * factor)


def swung(cells, step, integrator):
    """(y, velocity along x) of the cells between two walls after 0.4 s."""
    start, _ = oscillating_layer(0.1)
    grid = f'grid = {{ size = [1, 1], cells = [3, {cells}], periodic = "x", pattern = "right" }}'
    effects = f'harmonic = {{}}\ninitial = {{ velocity = ["{start}", 0, 0] }}\n'
    effects += side("wall", "y < 1e-9", along("cos(3*t)")) + STILL
    time = f"duration = 0.4\nstep = {step}\nframe_every = 0.4"
    model, observed = run(grid, effects, time, integrator, nu=0.1)
    space = model.space
    flux = space.side_flux(
        space.stream_function(observed[-1].vertex["vorticity"] * space.mass),
        np.atleast_1d(observed[-1].scalar["harmonic_coefficients_f"]),
    )
    velocity = model.context.to_space(space.face_velocity(flux))[:, 0]
    return (np.floor(model.context.face_points()[:, 1] * cells) + 0.5) / cells, velocity


@pytest.mark.parametrize("integrator", ["conservative", "energy", "circulation", "covector"])
def test_a_wall_that_swings_drags_the_fluid_of_second_order_in_time_and_space(integrator):
    """Stokes' second problem with a gap; both triangles of a square have the velocity of its middle."""
    _, exact = oscillating_layer(0.1)
    errors = []
    for cells in (8, 16):
        y, velocity = swung(cells, 0.02, integrator)
        errors.append(np.sqrt(np.mean((velocity - exact(y, 0.4)) ** 2)))
    assert errors[0] / errors[1] > 3.4 and errors[1] < 0.005
    steps = [swung(8, step, integrator)[1] for step in (0.1, 0.05, 0.025)]
    change = [np.abs(a - b).max() for a, b in zip(steps, steps[1:])]
    assert change[0] / change[1] > 3.4


@pytest.mark.parametrize("integrator", ["conservative", "energy"])
def test_a_flow_that_a_wall_drives_against_little_friction_is_of_second_order_in_time(integrator):
    """The vorticity at walls is that of the flow at every stage of the transport."""
    square = "grid = { size = [1, 1], cells = [8, 8] }"
    lid = side("wall", "y > 1 - 1e-9", along("1 - cos(2*t)")) + STILL
    flows = []
    for step in (0.1, 0.05, 0.025):
        model, schedule = fluid(square, lid, f"duration = 1\nstep = {step}", integrator, nu=0.01)
        *_, last = evolve({"f": model.model()}, schedule, Account())
        assert last.steps == round(1 / step)
        flows.append(last.observations["f"].vertex["stream_function"])
    first, second = (np.linalg.norm(a - b) for a, b in zip(flows, flows[1:]))
    assert first > 3.7 * second


def test_a_pulsating_channel_carries_the_flux_of_its_inflow():
    """Womersley: u = Re(-i (1 - cosh(k (y - 1/2)) / cosh(k / 2)) exp(i w t)), of second order."""
    nu, rate = 0.05, 4.0
    k = np.sqrt(1j * rate / nu)
    f, s = 1 / np.cosh(k / 2), f"({k.real}*(y-0.5))"
    even = f"cosh{s}*cos{s}", f"sinh{s}*sin{s}"
    real, imaginary = (
        f"(({p})*{even[0]} + ({q})*{even[1]})" for p, q in ((f.real, -f.imag), (f.imag, f.real))
    )
    profile = f"sin({rate}*t)*(1 - {real}) - cos({rate}*t)*{imaginary}"

    def exact(y, t):
        return np.real(-1j * (1 - np.cosh(k * (y - 0.5)) * f) * np.exp(1j * rate * t))

    fine = (np.arange(4000) + 0.5) / 4000
    errors = []
    for cells in (6, 12):
        sides = side("inflow", "x < 1e-9", along(profile)) + side("outflow", "x > 1 - 1e-9")
        grid = f'grid = {{ size = [1, 1], cells = [{cells}, {cells}], pattern = "right" }}'
        model, observed = run(grid, sides, "duration = 1\nstep = 0.05\nframe_every = 0.2", nu=nu)
        x, y, _ = model.context.points.T
        inner = (y > 0) & (y < 1) & (x > 0) & (x < 1)
        for number, seen in enumerate(observed):
            phi = seen.vertex["stream_function"]
            flux = phi[y == 1].mean() - phi[y == 0].mean()  # Gauss points of the sides: exact to 1e-6
            assert flux == pytest.approx(exact(fine, 0.2 * number).mean(), abs=2e-6)
        velocity = observed[-1].vertex["velocity"][:, 0]
        errors.append(np.sqrt(np.mean((velocity - exact(y, 1.0))[inner] ** 2)))
    assert errors[0] / errors[1] > 3 and errors[1] < 0.03


def ring(path, layers):
    """Mesh file of a ring of radii 1 and 2."""
    count = 8 * layers
    radius, angle = np.meshgrid(
        np.linspace(1, 2, layers + 1), np.arange(count) * 2 * np.pi / count, indexing="ij"
    )
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], -1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(layers), np.arange(count), indexing="ij"))
    p, q = i * count + j, i * count + (j + 1) % count
    faces = np.concatenate([np.stack([p, p + count, q + count], 1), np.stack([p, q + count, q], 1)])
    write_mesh(path, TriangleMesh.from_arrays(points, faces))
    return f'mesh = "{path}"'


def test_a_ring_whose_inner_wall_turns_to_and_fro_has_bessel_functions(tmp_path):
    """v = Re(exp(i w t) (A I_1(k r) + B K_1(k r))) after a start at rest that has decayed."""
    nu, rate = 0.4, 2.0
    k = np.sqrt(1j * rate / nu)
    at_walls = np.array([[iv(1, k * r), kv(1, k * r)] for r in (1, 2)])
    factors = np.linalg.solve(at_walls, [1, 0])
    wall = f'velocity = ["-y*cos({rate}*t)", "x*cos({rate}*t)", 0]\n'
    effects = "harmonic = {}\n" + side("wall", "hypot(x, y) < 1.2", wall) + STILL
    errors = []
    for layers in (4, 8):
        shape = ring(tmp_path / "ring.ply", layers)
        model, observed = run(shape, effects, "duration = 3\nstep = 0.05\nframe_every = 3", nu=nu)
        x, y, _ = model.context.points.T
        r, velocity = np.hypot(x, y), observed[-1].vertex["velocity"]
        exact = np.real(np.exp(1j * rate * 3.0) * (factors[0] * iv(1, k * r) + factors[1] * kv(1, k * r)))
        inner = (r > 1.01) & (r < 1.99)
        errors.append(np.abs((x * velocity[:, 1] - y * velocity[:, 0]) / r - exact)[inner].max())
    assert errors[0] / errors[1] > 2 and errors[1] < 0.02


@pytest.mark.parametrize("kind", ["evolved", "frozen"])
def test_a_stream_that_speeds_up_pushes_a_cylinder_by_its_added_mass(kind):
    """Force (2 + 2/3 (pi a / H)^2) pi a^2 U' of an ideal fluid between walls a distance H apart."""
    radius = 0.1
    post = f"cylinder = {{ start = [1, 0.5, -1], end = [1, 0.5, 1], radius = {radius} }}"
    shape = "grid = { size = [2, 1], cells = [32, 16] }"
    shape += f'\n[[object]]\nname = "post"\nrole = "obstacle"\nrefine = 2\n{post}'
    sides = side("inflow", "x < 1e-9", along("t")) + side("outflow", "x > 2 - 1e-9")
    sides += side("free-slip", "abs(y - 0.5) > 0.499") + STILL
    time = "duration = 0.004\nstep = 0.002"
    _, observed = run(shape, f'harmonic = {{ kind = "{kind}" }}\n' + sides, time, nu=1e-6)
    exact = (2 + 2 / 3 * (np.pi * radius) ** 2) * np.pi * radius**2
    for seen in observed:
        assert seen.scalar["force_post"][0] == pytest.approx(exact, rel=0.02)
        assert abs(seen.scalar["force_post"][1]) < 1e-3 * exact


CONSTANT = (
    [(GRID, name, "wall") for name in ("conservative", "energy", "circulation", "covector")]
    + [(BOX, name, "wall") for name in ("energy", "circulation", "covector")]
    + [(GRID, "conservative", "stream"), (GRID, "energy", "stream"), (BOX, "energy", "stream")]
)


@pytest.mark.parametrize("shape, integrator, kind", CONSTANT)
def test_a_boundary_constant_in_time_is_that_of_an_expression_in_t(shape, integrator, kind):
    """To rounding; without t a state holds no time and no values in time."""
    seen = []
    for factor in ("", "*(1 + 0*t)"):
        sides = side("wall", "y > 1 - 1e-9", along(f"(1 + x){factor}"))
        if kind == "stream":
            sides = side("inflow", "x < 1e-9", along(f"(y*(1 - y)){factor}")) + side(
                "outflow", "x > 2 - 1e-9"
            )
        time = "duration = 0.2\nstep = 0.05"
        model, observed = run(shape, "dye = { amount = 'x' }\n" + sides, time, integrator)
        assert (TIME in model.start.arrays) == bool(factor)
        seen.append(observed[-1].vertex)
    for name, values in seen[0].items():
        scale = max(np.abs(values).max(), 1.0)
        assert np.allclose(seen[1][name], values, rtol=0, atol=1e-10 * scale), name


@pytest.mark.parametrize("shape, integrator", [(GRID, "conservative"), (GRID, "energy"), (BOX, "energy")])
def test_a_run_continues_from_its_checkpoint_to_the_last_bit(shape, integrator):
    sides = side("inflow", "x < 1e-9", along("y*(1 - y)*sin(3*t)")) + side("outflow", "x > 2 - 1e-9")
    sides += side("wall", "y > 1 - 1e-9", along("cos(5*t)"))
    model, schedule = fluid(shape, sides, "duration = 0.3\nstep = 0.05", integrator)
    whole = list(evolve({"f": model.model()}, schedule, Account()))
    again, _ = fluid(shape, sides, "duration = 0.3\nstep = 0.05", integrator)
    rest = list(evolve({"f": again.model()}, schedule, Account(), (3, whole[3].checkpoint)))
    for name, values in whole[-1].checkpoint.items():
        assert np.array_equal(rest[-1].checkpoint[name], values), name


def test_dye_that_left_comes_back_where_the_stream_turns():
    """It moves by (1 - cos 3 t) / 3 to and fro; through the outflow comes back what left last."""
    period, reach = 2 * np.pi / 3, 2 / 3
    sides = side("inflow", "x < 1e-9", along("sin(3*t)")) + side("outflow", "x > 2 - 1e-9", along("sin(3*t)"))
    time = f"duration = {period}\nstep = {period / 20}\nframe_every = {period / 2}"
    for shape, area, spacing in ((GRID, 1.0, 1 / 6), (BOX, 0.5, 1 / 3)):
        model, observed = run(shape, "dye = { amount = 'x' }\n" + sides + FREE, time)
        x = model.context.points[:, 0]
        for seen, exact in zip(observed[1:], (np.maximum(x - reach, 0), np.minimum(x, 2 - reach))):
            assert np.abs(seen.vertex["dye"] - exact).max() < 0.5 * spacing  # a kink over a cell
        amount = area * ((2 - reach) ** 2 / 2 + reach * (2 - reach))
        assert observed[-1].scalar["total_dye"] == pytest.approx(amount, rel=0.01)


LATE = "y*(1-y)*(1 + max(t - 0.87, 0)*max(0.93 - t, 0))"  # at no time that is checked before the run


@pytest.mark.parametrize("shape", [GRID, BOX])
def test_what_the_boundary_cannot_have_later_is_refused_with_its_time(shape):
    def refusal(effects, match):
        with pytest.raises(SceneError, match=match):
            fluid(shape, effects)

    outflow = side("outflow", "x > 2 - 1e-9")
    refusal(side("wall", "y > 0.999", along("sqrt(0.55 - t)")), r"boundary: t = 0\.618034 s: the expression")
    refusal(
        side("inflow", "x < 1e-9", along("t")) + side("outflow", "x > 2 - 1e-9", along("t*t")),
        r"boundary: t = [\d.]+ s: [\d.e-]+ m.[23]/s more flow in than out",
    )
    refusal(side("inflow", "x < 1e-9", along("-t")) + outflow, "brings no fluid in")
    refusal(side("inflow", "x < 1e-9", along("t")), "inflow without outflow")
    refusal(side("wall", "y > t", along("1")), "put t of .where. into .velocity")
    with pytest.raises(SceneError, match="enters and leaves in turn at vertex"):
        fluid(shape, "buoyancy = {}\n" + side("inflow", "x < 1e-9", along("sin(9*t)")) + outflow)


@pytest.mark.parametrize("shape", [GRID, BOX])
def test_what_fails_between_the_times_that_are_checked_ends_the_run_with_its_time(shape):
    stream = side("inflow", "x < 1e-9", along(LATE)) + side("outflow", "x > 2 - 1e-9", along("y*(1-y)"))
    for sides, match in (
        (side("wall", "y > 0.999", along("1/(t - 0.25)")), r"t = 0\.25 s, effect boundary: the expression"),
        (stream, r"t = 0\.[89]\d* s, effect boundary: .*more flow in than out"),
    ):
        with pytest.raises(RunFailed, match=match):
            run(shape, sides, "duration = 1\nstep = " + ("0.02" if sides is stream else "0.5"))


def test_a_pulsating_stream_past_a_cylinder_is_of_second_order_in_time():
    """Its harmonic flow follows the stream in the viscous steps, too: else of first order."""
    post = "cylinder = { start = [1, 0.4, -1], end = [1, 0.4, 1], radius = 0.2 }"
    shape = f'grid = {{ size = [2, 1], cells = [16, 8] }}\n[[object]]\nname = "p"\nrole = "obstacle"\n{post}'
    sides = side("inflow", "x < 1e-9", along("4*y*(1-y)*(1 + 0.8*sin(6*t))"))
    effects = "harmonic = {}\n" + sides + side("outflow", "x > 2 - 1e-9") + STILL
    flows = []
    for step in (0.02, 0.01, 0.005):
        time = f"duration = 0.4\nstep = {step}\nframe_every = 0.4"
        flows.append(run(shape, effects, time, nu=0.02)[1][-1].vertex["velocity"])
    change = [np.abs(a - b).max() for a, b in zip(flows, flows[1:])]
    assert change[0] / change[1] > 3.4


POST = "cylinder = { start = [1, 0.4, -1], end = [1, 0.4, 1], radius = 0.2 }"
AROUND = f'grid = {{ size = [2, 1], cells = [16, 8] }}\n[[object]]\nname = "p"\nrole = "obstacle"\n{POST}'


@pytest.mark.parametrize("shape, integrator", [(AROUND, "conservative"), (AROUND, "energy"), (BOX, "energy")])
def test_a_stream_that_starts_between_two_steps_is_that_which_starts_in_the_second(shape, integrator):
    """Times are k dt: 0.05 + 0.01, where a step ends, is larger than 6 * 0.01, where the next one starts."""
    effects = "" if shape is BOX else "harmonic = {}\n"
    flows = []
    for start in (0.06, 0.061):
        jump = along(f"(t > {start})*0.1")
        sides = side("inflow", "x < 1e-9", jump) + side("outflow", "x > 2 - 1e-9", jump) + FREE
        time = "duration = 0.1\nstep = 0.01\nframe_every = 0.1"
        flows.append(run(shape, effects + sides, time, integrator)[1][-1].vertex["velocity"])
    # once as large as the stream; the last stage of `rk4`, at the end of a step, sees the stream that starts
    assert np.abs(flows[0] - flows[1]).max() < (1e-5 if integrator == "conservative" else 1e-10)
