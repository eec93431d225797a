"""Forces on a fluid: Coriolis waves, accelerations in space and time."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial import ConvexHull

import ddgcli as ddg
from benchmarks.fluids.runs import run_fluid
from ddgcli.cli.main import main
from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh.shapes import torus
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.conservative import rotational_rates
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.lost_forces import gain_shares
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.rotation import vertex_normals
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

BALL = "sphere = {{ subdivisions = {} }}"
TORUS = 'grid = { size = [2, 2], cells = [8, 8], periodic = "xy" }'


def last_frame(shape, effects, duration=0.4, step=0.02, integrator="conservative"):
    """(points, masses, first and last observation) of a run."""
    time = f'[time]\nduration = {duration}\nstep = {step}\nintegrator = "{integrator}"\n'
    text = f'{time}[[object]]\nname = "f"\nrole = "fluid"\n{shape}\n[effects]\n{effects}\n'
    scene, account = resolve(parse_scene(text), KIND, {}), Account()
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    built = build(scene, fluids, account)
    snapshots = list(evolve({n: m.model() for n, m in built.items()}, scene.schedule(), account))
    first, last = (snapshot.observations["f"] for snapshot in (snapshots[0], snapshots[-1]))
    return fluids["f"].points, built["f"].space.mass, first, last


def test_rossby_haurwitz_waves_in_a_turning_frame():
    """-w mu + P_l^m turns at w (1 - 2/(l(l+1))) - 2 Omega/(l(l+1)): 1/3 for l = 3, w = 1, Omega = 3."""
    error = []
    for level in (3, 4):
        effects = (
            'initial = { vorticity = "2*z + 2*(x^2 - y^2)*z" }\nrotation = { angular_velocity = [0, 0, 3] }'
        )
        points, mass, first, last = last_frame(BALL.format(level), effects)
        x, y, z = points.T
        omega = last.vertex["vorticity"] * mass
        angle = np.arctan2(omega @ (2 * x * y * z), omega @ ((x**2 - y**2) * z)) / 2
        error.append(abs(angle / 0.4 - 1 / 3))
        assert last.scalar["kinetic_energy"] == pytest.approx(first.scalar["kinetic_energy"], rel=1e-6)
        assert abs(last.scalar["total_vorticity"]) < 1e-12
    assert error[1] < 0.02 and error[0] / error[1] > 3


def test_a_frame_that_turns_too_fast_for_the_step_shortens_it():
    effects = 'initial = { vorticity = "z" }\nrotation = { angular_velocity = [0, 0, 300] }'
    *_, first, last = last_frame(BALL.format(1), effects, 0.02, 0.02)
    assert last.scalar["kinetic_energy"] == pytest.approx(first.scalar["kinetic_energy"], rel=1e-3)


@pytest.mark.parametrize("integrator", ["conservative", "circulation"])
def test_a_force_that_swings_turns_a_ball_of_fluid_as_it_must(integrator):
    """(-y, x, 0) cos t from rest: (-y, x, 0) sin t."""
    effects = 'force = { acceleration = ["-y*cos(t)", "x*cos(t)", 0] }'
    points, mass, _, last = last_frame(BALL.format(3), effects, 1.0, 0.05, integrator)
    exact = 2 * points[:, 2] * np.sin(1.0)
    assert np.sqrt(mass @ (last.vertex["vorticity"] - exact) ** 2 / (mass @ exact**2)) < 0.01
    assert last.scalar["kinetic_energy"] == pytest.approx(
        np.sin(1.0) ** 2 * 4 * np.pi / 3, rel=0.02
    )  # inscribed


def test_a_gradient_moves_nothing_and_a_mean_force_the_harmonic_flow():
    *_, last = last_frame(BALL.format(2), "force = { acceleration = [1, 2, 3] }")
    assert np.abs(last.vertex["vorticity"]).max() < 1e-12
    *_, last = last_frame(TORUS, "force = { acceleration = [0.5, 0, 0] }\nharmonic = {}")
    assert np.allclose(last.vertex["velocity"], [0.2, 0, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "effects, is_lost",
    [
        ('force = { acceleration = ["cos(t)", 0, 0] }', True),
        ('buoyancy = { temperature = "1", gravity = [1, 0, 0] }', True),
        ("force = { acceleration = [1, 0, 0] }\nharmonic = {}", False),
        ('force = { acceleration = [0, "y", 0] }', False),  # a gradient
        ('force = { acceleration = ["sin(6.2831853*y)", 0, 0] }', False),  # drives vorticity alone
    ],
)
def test_forces_that_drive_harmonic_flows_which_the_scene_leaves_out_warn(effects, is_lost, caplog):
    """Along a channel of free slip a force moved nothing, without a word."""
    grid = 'grid = { size = [1, 1], cells = [8, 8], periodic = "x" }'
    run_fluid(effects, "step = 0.1\nduration = 0.2", grid)
    assert ("harmonic flows of f" in caplog.text) == is_lost


@pytest.mark.parametrize(
    "effects, is_lost",
    [
        ('vorticity = "x*z + exp(x + y + z)"', True),
        ('vorticity = "x*z"', False),  # symmetric
        ('vorticity = "x*z + exp(x + y + z)" }\nharmonic = {', False),
    ],
)
def test_vorticity_that_drives_harmonic_flows_which_the_scene_leaves_out_warns(effects, is_lost, tmp_path):
    """A pair of vortices on a torus went astray by a quarter of its way, without a word."""
    ddg.write_mesh(tmp_path / "torus.ply", torus(24, 12))
    scene = tmp_path / "scene.toml"
    scene.write_text(
        f'[time]\nduration = 0.5\nstep = 0.05\n[[object]]\nname = "f"\nrole = "fluid"\nmesh = "torus.ply"\n'
        f"[effects]\ninitial = {{ {effects} }}\n"
    )
    end = CliRunner().invoke(main, ["fluid-sim", str(scene), "--json"])
    assert end.exit_code == 0
    assert any("drives harmonic flows" in text for text in json.loads(end.stdout)["warnings"]) == is_lost


def test_the_rate_at_which_vorticity_drives_harmonic_flows_is_that_of_the_integrator():
    flow = 'initial = { vorticity = "x*z + exp(x + y + z)" }\n'
    out = run_fluid(flow + "harmonic = {}", "duration = 1e-3\nstep = 1e-3", mesh=torus(24, 12))
    space, vorticity = out.fluid.space, out.fluid.start["vorticity"]
    change = np.linalg.norm(np.diff(out.series("harmonic_coefficients_f"), axis=0))
    speed = np.sqrt(2 * out.series("kinetic_energy")[0])
    assert gain_shares(space, [vorticity], 1e-3) == pytest.approx([change / speed], rel=1e-3)
    assert gain_shares(space, [vorticity], 1e-3, least=0.05) == []  # the whole force gives less: no solve


def test_a_force_with_an_unknown_name_is_refused():
    with pytest.raises(SceneError, match="force: unknown name 'q'"):
        last_frame(BALL.format(1), 'force = { acceleration = ["q", 0, 0] }')


@pytest.mark.parametrize("integrator, most", [("energy", 1e-12), ("circulation", 2e-4)])
def test_a_fast_frame_takes_no_energy(integrator, most):
    """Runge-Kutta steps of the Coriolis force took 0.06 % in 100 steps of one radian."""
    effects = 'initial = { vorticity = "x*y + 0.5*z" }\nrotation = { angular_velocity = [0, 0, 10] }'
    *_, first, last = last_frame(BALL.format(2), effects, 10.0, 0.1, integrator)
    assert last.scalar["kinetic_energy"] == pytest.approx(first.scalar["kinetic_energy"], rel=most)


def test_explicit_steps_in_a_turning_frame_are_of_fourth_order():
    effects = 'initial = { vorticity = "x*y + z^2*x" }\nrotation = { angular_velocity = [0, 0, 5] }'
    _, mass, _, exact = last_frame(BALL.format(2), effects, 0.4, 0.005)
    error = []
    for step in (0.1, 0.05):
        change = (
            last_frame(BALL.format(2), effects, 0.4, step)[-1].vertex["vorticity"] - exact.vertex["vorticity"]
        )
        error.append(np.sqrt(mass @ change**2))
    assert error[0] / error[1] > 12


def test_energy_that_steps_lose_is_a_warning_whose_step_keeps_it(tmp_path, summary):
    scene = tmp_path / "ball.toml"
    scene.write_text(
        "[time]\nduration = 100\nstep = 0.1\nframe_every = 100\n"
        '[[object]]\nname = "f"\nrole = "fluid"\nsphere = { subdivisions = 2 }\n'
        '[effects]\ninitial = { vorticity = "x*y + 0.5*z" }\nrotation = { angular_velocity = [0, 0, 10] }\n'
    )
    first = summary("fluid-sim", scene)
    assert first["accuracy"]["energy_drift"] > 0.05
    warning = next(text for text in first["warnings"] if "of the energy" in text)
    step = warning.split("take steps of ")[1].split(" s")[0]
    second = summary("fluid-sim", scene, "--dt", step)
    assert second["accuracy"]["energy_drift"] < 0.05
    assert not any(" lost " in text for text in second["warnings"])


def test_the_total_vorticity_of_a_start_at_rest_drifts_by_rounding_alone(tmp_path, summary):
    scene = tmp_path / "ball.toml"
    scene.write_text(
        "[time]\nduration = 0.1\nstep = 0.02\n"
        '[[object]]\nname = "f"\nrole = "fluid"\nsphere = { subdivisions = 1 }\n'
        '[effects]\nforce = { acceleration = ["sin(3*t)*y", "x*z", "-x"] }\n'
    )
    accuracy = summary("fluid-sim", scene)["accuracy"]
    assert accuracy["total_vorticity_drift"] < 1e-12 and accuracy["circulation_drift"] < 1e-12


def scattered_ball(n):
    """Unit sphere of n vertices: the Delaunay triangulation of a spiral with random shifts."""
    height = 1 - (2 * np.arange(n) + 1) / n
    angle = np.pi * (1 + np.sqrt(5)) * (np.arange(n) + 0.5)
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1) * np.sqrt(1 - height**2)[:, None]
    points[:, 2] = height
    points += np.random.default_rng(2).normal(size=(n, 3)) * 0.25 / np.sqrt(n)
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = ConvexHull(points).simplices
    inwards = np.linalg.det(points[faces]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return TriangleMesh.from_arrays(points, faces)


@pytest.mark.parametrize("closed", [True, False])
def test_the_slope_of_the_coriolis_parameter_converges_on_irregular_ellipsoids(closed):
    """2 Omega . n against the normals of the ellipsoid, in the rates of change of a given flow."""
    axes, turn, error = np.array([1.0, 1.3, 0.7]), np.array([1.0, 2.0, 5.0]), []
    for n in (750, 3000):
        ball = scattered_ball(n)
        faces = ball.faces if closed else ball.faces[ball.points[ball.faces].mean(axis=1)[:, 2] > 0.2]
        mesh = TriangleMesh.from_arrays(ball.points * axes, faces)
        space = SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)))
        x, y, z = mesh.points.T
        flux = space.side_flux((x * z + y**2) * (1.0 if closed else z - 0.14), np.zeros(0))
        context = FluidContext("f", mesh, {}, {}, np.zeros(3), np.load)
        exact = mesh.points / axes**2
        exact /= np.linalg.norm(exact, axis=1)[:, None]
        rates = [
            rotational_rates(space, 2.0 * normal @ turn, flux, False)[0] * space.inverse_mass
            for normal in (vertex_normals(context), exact)
        ]
        error.append(np.abs(rates[0] - rates[1])[space.inside].max() / np.abs(rates[1])[space.inside].max())
    assert error[1] < 0.005 and error[0] / error[1] > (3 if closed else 1.5), error
