"""Walls without slip: the lid-driven cavity against the spectral solution of Botella and Peyret (1998)."""

import numpy as np
import pytest

from benchmarks.fluids.cavity import SCENE, TRUTH, errors
from benchmarks.fluids.runs import run_fluid
from benchmarks.fluids.steady import SteadyFlow, model_of
from ddgcli.geometry.face_frames import face_axes
from ddgcli.mesh import shapes
from ddgcli.models.fluid.cells import cell_area
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.shapes import Grid, grid_mesh
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from tests.converge.test_hodge import annulus
from tests.geodesic_cases import jittered
from tests.physics.test_fluid_open_forces import ZONE, half_of_a_zone


def on_middle_lines(velocity, n):
    """u_min, v_max and v_min of the velocities at vertices, between them by parabolas."""
    velocity = velocity.reshape(n + 1, n + 1, -1)
    u, v = velocity[n // 2, 1:-1, 0], velocity[1:-1, n // 2, 1]
    return np.array([-peak(-u), peak(v), -peak(-v)])


def peak(values):
    k = int(np.argmax(values))
    before, at, after = values[k - 1 : k + 2]
    return at + (after - before) ** 2 / (8 * (2 * at - before - after))


@pytest.mark.parametrize("pattern", ["right", "alternating"])
def test_velocity_in_the_cavity_converges_at_second_order_on_every_pattern(pattern):
    apart = []
    for n in (16, 32, 64)[: 2 if pattern == "right" else 3]:
        flow = SteadyFlow(model_of(SCENE.format(n=n, pattern=pattern, grading=0, nu=0.01, step=0.05)))
        velocity = flow.model.observe(flow.state(flow.solve(0.01))).vertex["velocity"]
        apart.append(on_middle_lines(velocity, n) - TRUTH[100])
    order = np.log2(np.array(apart[:-1]) / apart[1:])
    assert (order > 1.75).all() and (order < 2.4).all()


def test_a_run_of_the_cavity_ends_in_the_steady_flow_but_for_the_split_steps():
    n, apart = 16, []
    for step in (0.1, 0.05):
        text = SCENE.format(n=n, pattern="right", grading=0, nu=0.01, step=step)
        model = model_of(text.replace("duration = 1", "duration = 12"))
        flow = SteadyFlow(model)
        steady = model.observe(flow.state(flow.solve(0.01))).vertex["velocity"]
        last = list(evolve({"cavity": model.model()}, model.scene.schedule(), Account()))[-1]
        velocity = last.observations["cavity"].vertex["velocity"]
        assert np.abs(on_middle_lines(velocity, n) - on_middle_lines(steady, n)).max() < 2e-3
        apart.append(np.abs(velocity - steady).max())
    assert apart[1] < 0.5 * apart[0] < 0.01


def test_cavity_on_a_graded_grid_is_closer_than_on_equal_cells():
    equal, graded = (np.abs(errors(16, 100, "right", grading)[0]) for grading in (0.0, 0.9))
    assert (graded < 0.6 * equal).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("reynolds", "pattern", "grading", "most"),
    [(100, "right", 0.9, 6e-4), (1000, "right", 0.9, 1.1e-3), (1000, "alternating", 0.85, 1e-3)],
)
def test_extrema_of_the_cavity_at_128_cells(reynolds, pattern, grading, most):
    assert np.abs(errors(128, reynolds, pattern, grading)[0]).max() < most


@pytest.mark.parametrize("pattern", ["right", "alternating"])
def test_shear_at_a_wall_that_starts_to_move_is_that_of_friction_alone(pattern):
    """Nothing carries a parallel flow: every integrator has that of `conservative`, few steps are divided."""
    walls = '[[effects.boundary]]\nkind = "wall"\nvelocity = [1, 0, 0]\nwhere = "y > 0.99"\n'
    walls += '[[effects.boundary]]\nkind = "no-slip"'
    grid = f'grid = {{ size = [1, 1], cells = [8, 8], periodic = "x", pattern = "{pattern}" }}'

    def run(integrator, step):
        time = f'integrator = "{integrator}"\nstep = {step}\nduration = 0.5\nframe_every = 0.5'
        return run_fluid(f"viscosity = {{ nu = 0.01 }}\nharmonic = {{}}\n{walls}", time, grid)

    exact = run("conservative", 0.0125).observations[-1].vertex["vorticity"]
    for integrator in ("circulation", "covector"):
        for step, most in ((0.1, 1e-3), (0.0125, 1e-4)):
            moved = run(integrator, step)
            apart = moved.observations[-1].vertex["vorticity"] - exact
            assert np.abs(apart).max() < most * np.abs(exact).max()
            assert moved.steps <= 1.2 * 0.5 / step


def test_cells_on_a_wall_are_halves_on_every_pattern_and_fill_the_surface():
    for pattern in ("right", "alternating"):
        mesh = grid_mesh(Grid(size=[1, 1], cells=[8, 8], pattern=pattern))
        area, points = cell_area(mesh), np.asarray(mesh.points)
        lower = (points[:, 1] == 0) & (points[:, 0] > 0.01) & (points[:, 0] < 0.99)
        assert np.ptp(area[lower]) < 1e-15 and area.sum() == pytest.approx(1.0, rel=1e-14)


def test_grading_moves_vertices_to_the_sides_and_none_across_a_periodic_one():
    plain, graded = (Grid(size=[2, 1], cells=[4, 4], grading=g) for g in (0, 1))
    points = np.asarray(grid_mesh(graded).points)
    assert np.allclose(points[:5, 1], 0.5 - 0.5 * np.cos(np.pi * np.arange(5) / 4))
    assert np.allclose(np.asarray(grid_mesh(plain).points)[:5, 1], np.arange(5) / 4)
    with pytest.raises(ValueError, match="grading"):
        Grid(size=[1, 1], cells=[4, 4], grading=1.5)
    with pytest.raises(ValueError, match="grading"):
        Grid(size=[1, 1], cells=[4, 4], grading=0.5, pattern="equilateral")


def test_vorticity_at_walls_of_an_initial_velocity_converges():
    """Steady cells, whose vorticity vanishes at the walls, from their velocity: at the start and after 1 s.

    The trace of the velocity closes the cells there to second order of a side, vorticity is of first order.
    """
    error = []
    for n in (12, 24):
        velocity = '["pi*sin(pi*x)*cos(pi*y)", "-pi*cos(pi*x)*sin(pi*y)", 0]'
        out = run_fluid(
            f"initial = {{ velocity = {velocity} }}", "duration = 1\nstep = 0.01\nframe_every = 1",
            f"grid = {{ size = [1, 1], cells = [{n}, {n}] }}",
        )  # fmt: skip
        x, y, _ = np.asarray(out.fluid.context.mesh.points).T
        exact = 2 * np.pi**2 * np.sin(np.pi * x) * np.sin(np.pi * y)
        wall = np.isclose(exact, 0.0, atol=1e-9)
        first, last = (out.observations[k].vertex["vorticity"] - exact for k in (0, -1))
        error.append([np.abs(first[wall]).max() / exact.max(), np.linalg.norm(last) / np.linalg.norm(exact)])
    assert np.all(np.divide(*error) > 1.7) and max(error[1]) < 0.08


@pytest.mark.parametrize("on, warnings", [("vertex", 0), ("face", 1)])
def test_an_initial_velocity_without_values_along_the_boundary_has_a_warning(on, warnings, tmp_path, caplog):
    mesh = shapes.grid(6, 6)
    place = mesh.points if on == "vertex" else mesh.points[mesh.faces].mean(axis=1)
    np.save(tmp_path / "u.npy", np.cross([0.0, 0.0, 1.0], place - place.mean(axis=0)))
    run_fluid(f"initial = {{ velocity = '{tmp_path}/u.npy' }}", "duration = 1e-6\nstep = 1e-6", mesh=mesh)
    assert caplog.text.count("has no values along the boundary") == warnings


def test_velocity_of_a_frame_is_of_second_order_on_irregular_triangles_and_at_walls():
    """Means of the faces are off by 3 % at 64 cells, inside and at walls, and fall by half with a cell."""
    inside, at_walls = [], []
    for n in (16, 32):
        mesh = jittered(grid_mesh(Grid(size=[1, 1], cells=[n, n])), 0.25 / n)
        x, y = (np.pi * mesh.points[:, :2]).T
        axes = face_axes(mesh, np.arange(mesh.n_faces))
        space = SurfaceSpace(
            mesh, np.zeros((0, mesh.topology.n_edges)),
            to_space=lambda v, axes=axes: v.real[:, None] * axes[0] + v.imag[:, None] * axes[1],
        )  # fmt: skip
        stream = np.sin(x) * np.sin(y) / np.pi
        state = FluidState({"vorticity": space.stiffness @ stream, "coefficients": np.zeros(0)})
        velocity = space.observed(state).vertex["velocity"]
        truth = np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), 0 * x], axis=1)
        error = np.linalg.norm(velocity - truth, axis=1)
        inside.append(error[space.inside].max())
        at_walls.append(error[mesh.topology.boundary_vertex].max())
    assert inside[1] < 0.4 * inside[0] < 0.02
    assert at_walls[1] < 0.4 * at_walls[0] < 0.02


SWIRL = """
pressure = {}
viscosity = { nu = 0.1 }
harmonic = {}
boundary = [{ kind = "wall", velocity = ["-y", "x", 0], where = "x^2 + y^2 < 2" }, { kind = "no-slip" }]
"""


def test_frames_have_the_velocity_of_walls_without_slip_and_pressures_its_square():
    """Between turning cylinders; recovered from inside the velocity errs by 4 % there, the pressure by 11."""
    mesh = annulus(8)
    out = run_fluid(SWIRL, "duration = 20\nstep = 0.1\nframe_every = 20", mesh=mesh)
    radius = np.hypot(*mesh.points[:, :2].T)
    exact = (4.0 / radius - radius) / 3.0
    turn = np.stack([-mesh.points[:, 1], mesh.points[:, 0], 0.0 * radius], axis=1) / radius[:, None]
    rim = mesh.topology.boundary_vertex
    last = out.observations[-1].vertex
    assert np.abs(last["velocity"] - exact[:, None] * turn)[rim].max() < 1e-14
    pressure = (radius**2 / 2.0 - 8.0 * np.log(radius) - 8.0 / radius**2) / 9.0
    apart = last["pressure"] - pressure
    apart -= np.average(apart, weights=out.fluid.space.mass)
    assert np.abs(apart[rim]).max() < 0.05 * np.ptp(pressure)


CORNERS = """
viscosity = { nu = 1 }
boundary = [
  { kind = "inflow", velocity = ["y*(1-y)", 0, 0], where = "x < 1e-6" },
  { kind = "outflow", where = "x > 2 - 1e-6" },
  { kind = "wall", velocity = ["t", 7, 0], where = "y < 1e-6" },
  { kind = "free-slip" },
]
"""


def test_vertices_between_two_parts_of_the_boundary_take_walls_before_streams():
    out = run_fluid(
        CORNERS, "duration = 0.5\nstep = 0.1\nframe_every = 0.5",
        'grid = { size = [2, 1], cells = [16, 8], pattern = "right" }',
    )  # fmt: skip
    x, y, _ = out.fluid.context.points.T
    for time, observation in zip((0.0, 0.5), (out.observations[0], out.observations[-1])):
        velocity = observation.vertex["velocity"]
        assert np.allclose(velocity[y == 0], [time, 0, 0], atol=1e-15)  # along the wall, at any time
        stream = (x == 0) & (y > 0) & (y < 1)
        assert np.allclose(velocity[stream, 0], (y * (1 - y))[stream], atol=1e-15)
    assert velocity[(x == 2) & (y > 0), 0].min() > 0.01  # natural: what the flow brings
    assert np.abs(velocity[(y == 1) & (x > 0), 0]).min() > 0.01  # free slip


def test_vertices_of_a_turning_wall_of_a_volume_have_its_velocity():
    mesh = shapes.box_tetrahedra()
    out = run_fluid(
        'viscosity = { nu = 1 }\nboundary = [{ kind = "wall", velocity = ["1+y", 2, 5], where = "z > 0.9" }]',
        'duration = 0.01\nstep = 0.01\nintegrator = "covector"', mesh=mesh,
    )  # fmt: skip
    x, y, z = mesh.points.T
    velocity = out.observations[-1].vertex["velocity"]
    lid = (z == 1) & (x > 0) & (x < 1) & (y > 0) & (y < 1)
    assert np.allclose(velocity[lid], np.stack([1 + y, 2 + 0 * y, 0 * y], axis=1)[lid], atol=1e-14)
    assert np.abs(velocity[z == 0]).max() == 0.0


def test_a_stream_onto_a_curved_surface_has_no_velocity_out_of_it():
    """The radial part of 1 that the section adds moves nothing; normals of faces are off by half a cell."""
    mesh = half_of_a_zone(16)
    radial = ZONE.replace('["-y", "x", 0]', '["x - y", "x + y", "z"]')
    out = run_fluid(f"viscosity = {{ nu = 0.05 }}\n{radial}", "duration = 1e-3\nstep = 1e-3", mesh=mesh)
    velocity, rim = out.observations[0].vertex["velocity"], mesh.topology.boundary_vertex
    outside = np.abs(np.einsum("ia,ia->i", velocity, mesh.points))[rim]
    assert outside.max() < 0.15
