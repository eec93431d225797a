"""Fluids on surfaces: what is conserved, what is steady, known speeds and rates of decay."""

from time import process_time

import numpy as np
import pytest

from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.io.scene_file import parse_scene
from ddgcli.linalg.factor import Factor
from ddgcli.mesh import shapes
from ddgcli.models.fluid.circulation import CirculationAdvection
from ddgcli.models.fluid.conservative import StageRates, midpoint, rate, runge_kutta
from ddgcli.models.fluid.covector import CovectorTransport
from ddgcli.models.fluid.diffusion import VelocityDiffusion, VorticityDiffusion
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.phases import FluidSetting, Step
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.shapes import Grid, periodic_grid
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

NONE = np.zeros(0)


def space_of(mesh, harmonic=True):
    flows = harmonic_basis(mesh, "normal").forms if harmonic else np.zeros((0, mesh.topology.n_edges))
    return SurfaceSpace(mesh, flows)


def some_flow(space, seed=0):
    """Vorticity without symmetry, and harmonic coefficients."""
    x, y, z = space.mesh.points.T
    omega = (np.sin(3 * x + 1) * np.cos(2 * z + 1) + y + x * z) * space.mass
    if space.mesh.topology.is_closed:
        omega -= space.mass * omega.sum() / space.mass.sum()
    return omega, np.random.default_rng(seed).normal(size=len(space.harmonic))


def flat_torus(n, size=2 * np.pi, pattern="alternating"):
    return periodic_grid(Grid(size=[size, size], cells=[n, n], periodic="xy", pattern=pattern))


def irregular_annulus():
    mesh = shapes.cylinder(20, 8)
    shift = 0.02 * np.random.default_rng(1).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points + shift)


SURFACES = {
    "sphere": shapes.icosphere(2),
    "irregular sphere": shapes.random_sphere(300),
    "torus": shapes.torus(24, 12),
    "annulus": irregular_annulus(),
    "flat torus": flat_torus(10),
    "disk": shapes.grid(9, 9),
}


@pytest.fixture(params=SURFACES, ids=SURFACES.keys())
def space(request):
    return space_of(SURFACES[request.param])


def test_velocity_and_vorticity_are_inverse(space):
    omega, c = some_flow(space)
    phi = space.stream_function(omega)
    side_flux = space.side_flux(phi, c)
    velocity = space.face_velocity(side_flux)
    back, c_back = space.of_face_velocity(velocity)
    scale = np.abs(omega).max()
    assert np.abs((back - omega)[space.inside]).max() < 1e-11 * scale
    assert np.allclose(c_back, c, rtol=0, atol=1e-11)
    assert np.abs(side_flux.sum(axis=1)).max() < 1e-13 * np.abs(side_flux).max()
    by_faces = 0.5 * np.sum(space.area * np.abs(velocity) ** 2)
    assert space.kinetic_energy(phi, c) == pytest.approx(by_faces, rel=1e-11)


def test_harmonic_coefficients_are_inner_products_with_the_velocities_of_the_flows(space):
    rng = np.random.default_rng(1)
    velocity = rng.normal(size=len(space.area)) + 1j * rng.normal(size=len(space.area))
    flows = [space.face_velocity(flow[space.side_edge] * space.side_sign) for flow in space.harmonic]
    products = [float(space.area @ (velocity * np.conj(flow)).real) for flow in flows]
    assert np.allclose(space.harmonic_part(velocity), products, rtol=0, atol=1e-13 * np.abs(velocity).sum())
    assert np.array_equal(space.vorticity_of_face_velocity(velocity), space.of_face_velocity(velocity)[0])


def test_transport_conserves_exactly(space):
    """Energy, enstrophy, total vorticity, circulation along every boundary: rates at round-off, any mesh."""
    omega, c = some_flow(space)
    d_omega, d_c, flux = rate(space, omega, c, True)
    phi = space.stream_function(omega)
    scale = np.abs(d_omega).sum() or 1.0
    assert abs(phi @ d_omega + c @ d_c) < 1e-13 * (np.abs(phi * d_omega).sum() + np.abs(c * d_c).sum())
    assert (
        abs((omega * space.inverse_mass) @ d_omega)
        < 1e-13 * np.abs(omega * space.inverse_mass * d_omega).sum()
    )
    assert abs(d_omega.sum()) < 1e-13 * scale
    d_flux = space.edge_flux(space.stream_function(d_omega), d_c)
    assert np.abs(space.boundary_circulation(d_omega, d_flux)).max(initial=0.0) < 1e-11 * scale


def test_midpoint_keeps_energy_and_enstrophy(space):
    omega, c = some_flow(space)
    energy = [space.kinetic_energy(space.stream_function(omega), c)]
    enstrophy = [space.enstrophy(omega)]
    for _ in range(5):
        omega, c, change = midpoint(StageRates(space, True), omega, c, 0.05)
        assert change < 1e-13
        energy.append(space.kinetic_energy(space.stream_function(omega), c))
        enstrophy.append(space.enstrophy(omega))
    assert np.ptp(energy) < 1e-12 * energy[0] and np.ptp(enstrophy) < 1e-12 * enstrophy[0]


def test_runge_kutta_is_fourth_order():
    space = space_of(shapes.torus(24, 12))
    start = some_flow(space)

    def end(n):
        omega, c = start
        for _ in range(n):
            omega, c, *_ = runge_kutta(StageRates(space, True), omega, c, 0.4 / n)
        return np.concatenate([omega, c])

    truth = end(64)
    error = [np.abs(end(n) - truth).max() for n in (4, 8, 16)]
    assert (np.log2(np.array(error[:-1]) / error[1:]) > 3.6).all()


def test_a_spherical_harmonic_is_steady_at_second_order():
    drift = []
    for level in (3, 4, 5):
        space = space_of(shapes.icosphere(level))
        x, y, z = space.mesh.points.T
        mode = z * (5 * z**2 - 3) / 2 + 0.5 * x * (5 * z**2 - 1) + x * y * z  # all of degree 3
        omega = start = 3 * mode * space.mass
        for _ in range(10):
            omega, *_ = runge_kutta(StageRates(space, False), omega, NONE, 0.02)
        drift.append(np.sqrt(space.enstrophy(omega - start) / space.enstrophy(start)))
    rates = np.log2(np.array(drift[:-1]) / drift[1:])
    assert drift[-1] < 1e-4 and rates[0] > 1.6 and rates[1] > 1.8


def rossby_haurwitz_speed(level, l=3, m=2, w=1.0):
    """Measured angular speed of the pattern -w mu + P_l^m cos(m lambda): w (1 - 2/(l (l+1)))."""
    space = space_of(shapes.icosphere(level))
    x, y, z = space.mesh.points.T
    pattern, quadrature = (x**2 - y**2) * z, 2 * x * y * z
    omega = (2 * w * z + 2.0 * pattern) * space.mass
    steps, dt = 20, 0.02
    for _ in range(steps):
        omega, *_ = runge_kutta(StageRates(space, False), omega, NONE, dt)
    return np.arctan2(omega @ quadrature, omega @ pattern) / m / (steps * dt)


def test_rossby_haurwitz_speed_at_second_order():
    error = [abs(rossby_haurwitz_speed(level) - 5 / 6) for level in (3, 4, 5)]
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert error[1] < 0.02 and (np.abs(rates - 2) < 0.2).all()


@pytest.mark.parametrize("nu", [0.0, 0.05])
def test_taylor_green_on_the_flat_torus(nu):
    error = []
    for n in (16, 32):
        space = space_of(flat_torus(n))
        x, y = space.mesh.points[:, :2].T
        omega = start = 2 * np.sin(x) * np.sin(y) * space.mass
        decay = VorticityDiffusion(space, nu) if nu else None
        for _ in range(20):
            if decay:
                omega, _ = decay.step(omega, NONE, 0.025)
            omega, *_ = runge_kutta(StageRates(space, True), omega, np.zeros(2), 0.05)
            if decay:
                omega, _ = decay.step(omega, NONE, 0.025)
        exact = np.exp(-2 * nu * 1.0) * start
        error.append(np.sqrt(space.enstrophy(omega - exact) / space.enstrophy(start)))
    assert error[1] < 5e-3
    assert nu == 0 or np.log2(error[0] / error[1]) > 1.8


@pytest.mark.parametrize("scheme", ["rk4", "circulation", "covector"])
@pytest.mark.parametrize("name", ["torus", "annulus", "flat torus"])
def test_harmonic_flow_stays(scheme, name):
    """A flow without vorticity is steady; a carried loop keeps its circulation."""
    space = space_of(SURFACES[name])
    c = start = np.arange(1.0, 1.0 + len(space.harmonic))
    omega = np.zeros(space.n)
    if scheme == "covector":
        phase = CovectorTransport(FluidSetting(None, space, frozenset(), evolve_harmonic=True))
        state = FluidState({"vorticity": omega, "coefficients": start, **phase.start()})
        for _ in range(3):
            state = phase.advance(Step(0.0, 0.02, state), state)
        omega, c = state["vorticity"], state["coefficients"]
    elif scheme == "circulation":
        carry = CirculationAdvection(space)
        for _ in range(3):
            omega, c, *_ = carry.step(omega, c, 0.02, True)
    else:
        for _ in range(20):
            omega, c, *_ = runge_kutta(StageRates(space, True), omega, c, 0.05)
    assert np.abs(omega).max() == 0 and np.array_equal(c, start)


@pytest.mark.parametrize(
    "kind, rates", [("hodge", (2, 6, 12)), ("bochner", (1, 5, 11)), ("deformation", (0, 4, 10))]
)
def test_viscosities_decay_at_their_own_rates(kind, rates):
    space = space_of(shapes.icosphere(4))
    z = space.mesh.points[:, 2]
    nu, dt, steps = 0.1, 0.02, 10
    for mode, expected in zip((z, (3 * z**2 - 1) / 2, (5 * z**3 - 3 * z) / 2), rates):
        omega = start = mode * space.mass
        for step in (VelocityDiffusion(space, nu, kind),):
            for _ in range(steps):
                omega, _ = step.step(omega, NONE, dt)
        measured = -np.log((omega @ mode) / (start @ mode)) / (nu * dt * steps)
        assert measured == pytest.approx(expected, abs=0.03 + 0.005 * expected)


@pytest.mark.parametrize("seed", [None, 0])
def test_a_rigid_turn_neither_grows_nor_decays_by_deformation(seed):
    """However viscous the fluid is: the errors of the mesh would make energy from nothing."""
    ball = shapes.icosphere(2) if seed is None else shapes.random_sphere(200, seed=seed)
    space = space_of(ball.moved(1e3 * ball.points))
    omega, diffusion = ball.points[:, 2] * space.mass, VelocityDiffusion(space, 1e6, "deformation")
    energy = []
    for dt in (0.1, 1.0, 10.0, 100.0):
        omega, _ = diffusion.step(space.mass * space.centred(omega * space.inverse_mass), NONE, dt)
        energy.append(space.kinetic_energy(space.stream_function(omega), NONE))
    assert np.all(np.diff(energy) <= 1e-12 * energy[0])
    assert energy[-1] == pytest.approx(energy[0], rel=0.01)


def test_both_hodge_diffusions_agree():
    space = space_of(shapes.torus(24, 12))
    omega, c = some_flow(space)
    one, _ = VorticityDiffusion(space, 0.1).step(omega, c, 0.05)
    other, c_after = VelocityDiffusion(space, 0.1, "hodge").step(omega, c, 0.05)
    assert np.allclose(one, other, atol=1e-12 * np.abs(omega).max()) and np.allclose(c, c_after, atol=1e-10)


def test_no_slip_channel_decays_at_the_stokes_rate():
    """Between walls at distance 1 the slowest velocity cos(pi y) decays at nu pi^2."""
    error = []
    for n in (8, 16):
        mesh = periodic_grid(Grid(size=[1.0, 1.0], cells=[n, n], periodic="x", pattern="right"))
        space = space_of(mesh)
        y = mesh.points[:, 1]
        corner_y = y[mesh.faces].mean(axis=1)
        first = mesh.points[mesh.faces[:, 1]] - mesh.points[mesh.faces[:, 0]]
        first[:, 0] -= np.round(first[:, 0])
        turn = np.exp(-1j * np.arctan2(first[:, 1], first[:, 0]))
        omega, c = space.of_face_velocity(np.sin(np.pi * corner_y) * turn)
        start = np.concatenate([space.stream_function(omega), c])
        decay = VelocityDiffusion(space, 0.1, "hodge")
        for _ in range(20):
            omega, c = decay.step(omega, c, 0.02)
        energy = [space.kinetic_energy(s[: space.n], s[space.n :]) for s in (
            start, np.concatenate([space.stream_function(omega), c]))]  # fmt: skip
        error.append(abs(-np.log(energy[1] / energy[0]) / (2 * 0.1 * 0.4) - np.pi**2))
    assert error[1] < 0.05 and np.log2(error[0] / error[1]) > 1.8


def moved_by_walls(shape, effects, time, nu, step):
    text = WALLS.format(shape=shape, effects=effects, time=time, nu=nu, step=step)
    scene = resolve(parse_scene(text), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    models = {name: fluid.model() for name, fluid in build(scene, fluids, Account()).items()}
    last = list(evolve(models, scene.schedule(), Account()))[-1]
    return fluids["f"].points, last.observations["f"].vertex


WALLS = """format = "ddgcli-scene/1"
[time]
duration = {time}
step = {step}
[[object]]
name = "f"
role = "fluid"
grid = {{ {shape}, pattern = "right" }}
[effects]
viscosity = {{ nu = {nu} }}
{effects}
"""


def test_moving_walls_drag_a_channel_to_couette_flow():
    """Walls at speeds 0 and 1: in the end u = y, of vorticity -1, to the last digits."""
    lid = 'harmonic = {}\nboundary = { kind = "no-slip", velocity = [1, 0.3, 0], where = "y > 0.99" }'
    points, vertex = moved_by_walls('size = [1, 1], cells = [8, 8], periodic = "x"', lid, 3, 1.0, 0.05)
    assert np.abs(vertex["vorticity"] + 1).max() < 1e-8
    inner = (points[:, 1] > 0.01) & (points[:, 1] < 0.99)
    assert np.abs(vertex["velocity"][inner] - np.outer(points[inner, 1], [1, 0, 0])).max() < 1e-8


def test_lid_driven_cavity_at_reynolds_100():
    """Against Ghia, Ghia and Shin (1982), whose figures are good to 0.005 at this Reynolds number."""
    lid = 'boundary = { kind = "no-slip", velocity = ["where(y > 0.999, 1, 0)", 0, 0] }'
    points, vertex = moved_by_walls("size = [1, 1], cells = [32, 32]", lid, 10, 0.01, 0.04)
    middle = np.abs(points[:, 0] - 0.5) < 1e-9
    order = np.argsort(points[middle, 1])
    ghia = {0.8516: 0.23151, 0.5: -0.20581, 0.4531: -0.2109, 0.2813: -0.15662, 0.1016: -0.06434}
    u = np.interp(list(ghia), points[middle, 1][order], vertex["velocity"][middle, 0][order])
    assert np.abs(u - list(ghia.values())).max() < 0.008
    assert np.abs(vertex["stream_function"]).max() == pytest.approx(0.103423, rel=0.03)


def test_a_fluid_that_is_not_coupled_changes_no_bit():
    """Not even one whose steps are halved."""

    def fluid_observations(*shapes_and_spins):
        objects = "".join(
            f'[[object]]\nname = "{name}"\nrole = "fluid"\n{shape}\n' for name, shape, _ in shapes_and_spins
        )
        effects = "".join(
            f'[[effects.initial]]\nobject = "{name}"\nvorticity = "{spin}"\n'
            for name, _, spin in shapes_and_spins
        )
        text = f"[time]\nduration = 0.1\nstep = 0.02\n{objects}{effects}[effects.harmonic]\n"
        scene = resolve(parse_scene(text), KIND, {})
        fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
        models = {name: fluid.model() for name, fluid in build(scene, fluids, Account()).items()}
        return list(evolve(models, scene.schedule(), Account()))

    ball = ("ball", "sphere = { subdivisions = 2 }", "z^3 + x")
    tube = ("tube", 'grid = { size = [2, 1], cells = [12, 6], periodic = "x" }', "900*y*(1-y)")
    alone, together = fluid_observations(ball), fluid_observations(ball, tube)
    assert any(snapshot.events for snapshot in together) and not any(snapshot.events for snapshot in alone)
    assert len(alone) == len(together) > 3
    for before, after in zip(alone, together):
        a, b = before.observations["ball"], after.observations["ball"]
        assert all(np.array_equal(a.vertex[name], b.vertex[name]) for name in a.vertex)
        assert all(np.array_equal(a.scalar[name], b.scalar[name]) for name in a.scalar)


@pytest.mark.parametrize(
    "integrator",
    ["conservative", 'conservative"\nscheme = "midpoint', "circulation", 'circulation"\ntolerance = 0.1 #'],
)
def test_every_second_is_booked_where_it_was_spent(monkeypatch, processor_clock, integrator):
    """Effects, solver, integrator and output add up to the clock's own time; solves are the solver's."""
    text = f"""format = "ddgcli-scene/1"
[time]
duration = 0.1
step = 0.02
integrator = "{integrator}"
[[object]]
name = "ball"
role = "fluid"
sphere = {{ subdivisions = 3 }}
[effects]
initial = {{ vorticity = "5*z^3+x" }}
viscosity = {{ nu = 1e-3 }}
dye = {{ amount = "z" }}
"""
    account, solving = Account(), {}
    solve = Factor.solve

    def timed(self, *args, **kwargs):
        began = process_time()
        solution = solve(self, *args, **kwargs)
        name = account._stack[-1] if account._stack else "set-up"
        solving[name] = solving.get(name, 0.0) + process_time() - began
        return solution

    monkeypatch.setattr(Factor, "solve", timed)
    scene = resolve(parse_scene(text), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    built = build(scene, fluids, account)
    account.restore({})
    solving.clear()
    began = process_time()
    list(evolve({name: fluid.model() for name, fluid in built.items()}, scene.schedule(), account))
    clock = process_time() - began
    booked = account.seconds
    assert set(booked) == {"integrator", "solver", "viscosity", "dye", "output"}
    assert 0.95 < sum(booked.values()) / clock <= 1
    assert set(solving) - {"set-up"} == {"solver", "viscosity"}
    assert solving["solver"] <= booked["solver"] and solving["viscosity"] <= booked["viscosity"]
