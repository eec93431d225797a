"""Forces on a stream that leaves through a natural outflow."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.mesh.triangle_mesh import TriangleMesh

STREAM = """
viscosity = { nu = 0.02 }
harmonic = {}
boundary = [
  { kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" },
  { kind = "outflow", where = "x > 2 - 1e-6" },
  { kind = "free-slip" },
]
"""
POST = """
[[object]]
name = "post"
role = "obstacle"
cylinder = { start = [1.5, 0.45, -1], end = [1.5, 0.45, 1], radius = 0.2 }
"""
TURN = 'velocity = ["-y", "x", 0]'
ZONE = f"""
[[effects.boundary]]
kind = "outflow"
where = "(y < 1e-6)*(x < 0)"
[[effects.boundary]]
kind = "inflow"
where = "y < 1e-6"
{TURN}
[[effects.boundary]]
kind = "wall"
{TURN}
"""
TIME = "duration = 0.5\nstep = 0.05\nframe_every = 0.5"


def velocity_of(effects, cells=8, objects="", time=TIME):
    """(n, 3) at the end of a stream through the rectangle 2 x 1."""
    shape = f'grid = {{ size = [2, 1], cells = [{2 * cells}, {cells}], pattern = "alternating" }}'
    return run_fluid(STREAM + effects, time, shape, objects=objects).observations[-1].vertex["velocity"]


def half_of_a_zone(rows):
    """Faces of the unit sphere from the latitudes -1 to 1, on one side of a plane through the axis."""
    latitude, longitude = np.linspace(-1, 1, rows + 1), np.linspace(0, np.pi, 2 * rows + 1)
    a, o = (angle.ravel() for angle in np.meshgrid(latitude, longitude, indexing="ij"))
    points = np.stack([np.cos(a) * np.cos(o), np.cos(a) * np.sin(o), np.sin(a)], axis=-1)
    p = (np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
    ahead, up = p + 1, p + 2 * rows + 1
    return TriangleMesh.from_arrays(
        points, np.concatenate([np.stack([p, ahead, up + 1], axis=1), np.stack([p, up + 1, up], axis=1)])
    )


@pytest.mark.parametrize("objects", ["", POST], ids=["channel", "post"])
def test_a_gradient_moves_nothing_before_a_natural_outflow(objects):
    """The gradient of y sin x + 3 x y - 2 y^2 errs by its quadrature; round a post it drove 1.4 m/s."""
    gradient = 'force = { acceleration = ["y*cos(x) + 3*y", "sin(x) + 3*x - 4*y", 0] }'
    error = [
        np.abs(velocity_of(gradient, cells, objects) - velocity_of("", cells, objects)).max()
        for cells in (8, 16)
    ]
    assert error[1] < 1e-4 and error[0] / error[1] > 2


def test_velocities_of_a_flow_through_a_natural_outflow_are_those_of_that_flow():
    """Their vorticity there had the tangential velocity of the last faces, of which there is none."""
    shape = 'grid = { size = [2, 1], cells = [16, 8], pattern = "alternating" }'
    fluid = run_fluid(STREAM, "duration = 0.2\nstep = 0.05", shape, objects=POST).fluid
    space, start = fluid.space, fluid.start
    state = start.replaced(vorticity=0.1 * np.cos(np.arange(space.n)), coefficients=np.array([0.3]))
    vorticity, coefficients = space.of_face_velocity(space.face_velocity(space.flow(state).side_flux))
    assert np.abs(vorticity - state["vorticity"])[space.free].max() < 1e-12
    assert coefficients + space.rest()["coefficients"] == pytest.approx(state["coefficients"], abs=1e-12)


@pytest.mark.parametrize("objects", ["", POST], ids=["channel", "post"])
@pytest.mark.parametrize("integrator", ["conservative", "energy"])
def test_a_turning_plane_leaves_a_stream_through_it_as_it_is(integrator, objects):
    """Its Coriolis force is a gradient for every flow: a stream turned by its own speed at the outflow."""
    time = f'{TIME}\nintegrator = "{integrator}"'
    turn = velocity_of("rotation = { angular_velocity = [0, 0, 2] }", objects=objects, time=time)
    assert np.abs(turn - velocity_of("", objects=objects, time=time)).max() < 1e-8


def test_pressure_balances_the_coriolis_force_of_a_stream_up_to_its_natural_outflow():
    """dp/dy = - f u, with mean 0 at the outflow."""
    shape = 'grid = { size = [2, 1], cells = [16, 8], pattern = "alternating" }'
    out = run_fluid(STREAM + "rotation = { angular_velocity = [0, 0, 2] }\npressure = {}", TIME, shape)
    balance = 4.0 * (0.5 - out.fluid.context.points[:, 1])
    assert np.abs(out.observations[-1].vertex["pressure"] - balance).max() < 1e-8


def test_rotation_of_a_curved_surface_acts_as_the_equal_force_before_a_natural_outflow():
    """Half of a zone of the sphere; f grows with z. They were further apart the finer the mesh.

    The mean square is compared: beside the corners of wall and outflow the difference falls more slowly.
    """
    apart = []
    for rows in (8, 16):
        mesh = half_of_a_zone(rows)
        effects = f"viscosity = {{ nu = 0.05 }}\ninitial = {{ {TURN} }}\n{ZONE}"
        turn, force = (
            run_fluid(f"{one}\n{effects}", "duration = 1e-3\nstep = 1e-3", mesh=mesh).observations[-1]
            for one in (
                "rotation = { angular_velocity = [0, 0, 4] }",
                'force = { acceleration = ["8*x*z^2", "8*y*z^2", "-8*z*(x^2 + y^2)"] }',
            )
        )
        apart.append(
            np.linalg.norm(turn.vertex["velocity"] - force.vertex["velocity"]) / np.sqrt(mesh.n_vertices)
        )
    assert apart[0] / apart[1] > 1.5
