"""Flows on bad triangles: Delaunay flips by a rule that is reported, and what they gain."""

import numpy as np
import pytest

from benchmarks.fluids.integrators import WAVE, wave
from benchmarks.fluids.runs import run_fluid
from ddgcli.errors import SceneError
from ddgcli.mesh import shapes
from ddgcli.models.fluid.triangulation import bad_edges

CELLS = 'initial = { vorticity = "2*sin(x)*sin(y)" }'


def sheared(n):
    """The square [0, pi]^2, its rows shifted by up to 1.2 cells: a quarter of the edges is bad."""
    mesh = shapes.grid(n + 1, n + 1)
    unit = (mesh.points - mesh.points.min(axis=0)) / np.ptp(mesh.points[:, 0])
    x, y = np.pi * unit[:, 0], np.pi * unit[:, 1]
    inner = (unit[:, :2] > 1e-9).all(axis=1) & (unit[:, :2] < 1 - 1e-9).all(axis=1)
    room = np.minimum(1.0, np.minimum(x, np.pi - x) * n / np.pi / 2)
    x = x + inner * 1.2 * np.pi / n * np.sin(2.4 * np.rint(y * n / np.pi)) * room
    return mesh.moved(np.stack([x, y, 0 * x], axis=1))


def stretched():
    """An irregular sphere whose triangles are some three times as long as wide."""
    ball = shapes.random_sphere(1500)
    points = ball.points * [1.0, 1.0, 0.4]
    return ball.moved(points / np.linalg.norm(points, axis=1)[:, None])


def drift(mesh, triangulation):
    """Change of steady cells, and the run."""
    shape = f'mesh = "given"\ntriangulation = "{triangulation}"'
    out = run_fluid(CELLS, "duration = 0.5\nstep = 0.0125\nframe_every = 0.5", shape, mesh)
    first, last = (out.observations[k].vertex["vorticity"] for k in (0, -1))
    return np.linalg.norm(last - first) / np.linalg.norm(first), out


def test_cells_on_bad_triangles_stay_ten_times_better_on_their_delaunay_triangulation():
    mesh = sheared(24)
    input_drift, input_run = drift(mesh, "input")
    delaunay_drift, delaunay_run = drift(mesh, "auto")
    assert input_drift > 5 * delaunay_drift and delaunay_drift < 0.002
    facts = delaunay_run.fluid.context.triangulation
    assert facts["used"] == "delaunay" and facts["flips"] > 100
    assert facts["bad_edges"] == bad_edges(mesh) > 0.1 * facts["inner_edges"]
    assert np.array_equal(input_run.fluid.context.mesh.faces, mesh.faces)
    assert bad_edges(delaunay_run.fluid.context.mesh) == 0


def test_on_a_curved_surface_waves_and_velocities_are_better_for_it():
    """Vectors pass between the flipped faces and space: a rigid turn in, the Coriolis force, frames out."""
    mesh, error = stretched(), {}
    x, y, z = mesh.points.T
    turn = np.stack([-y, x, 0 * z], axis=1)
    for triangulation in ("input", "auto"):
        shape = f'mesh = "given"\ntriangulation = "{triangulation}"'
        time = 'integrator = "energy"\nduration = 0.3\nstep = 0.02\nframe_every = 0.3'
        out = run_fluid(f'initial = {{ vorticity = "{WAVE}" }}', time, shape, mesh)
        mass, exact = out.fluid.space.mass, wave(mesh.points, 0.3)
        effects = 'initial = { velocity = ["-y", "x", 0] }\nrotation = { angular_velocity = [0, 0, 1] }'
        shown = (
            run_fluid(effects, "duration = 0.02\nstep = 0.01", shape, mesh)
            .observations[-1]
            .vertex["velocity"]
        )
        error[triangulation] = [
            np.sqrt(mass @ (out.observations[-1].vertex["vorticity"] - exact) ** 2 / (mass @ exact**2)),
            np.sqrt(mass @ ((shown - turn) ** 2).sum(axis=1) / (mass @ (turn**2).sum(axis=1))),
        ]
    for before, after in zip(error["input"], error["auto"]):
        assert after < 0.96 * before and after < 0.12


def test_good_meshes_keep_their_triangles():
    for mesh in (shapes.icosphere(2), shapes.torus(24, 12), shapes.random_sphere(300), shapes.grid(6, 6)):
        out = run_fluid('initial = { vorticity = "x" }', "duration = 0.01\nstep = 0.01", mesh=mesh)
        assert np.array_equal(out.fluid.context.mesh.faces, mesh.faces)
        assert out.fluid.context.triangulation["used"] == "input"


def test_an_unknown_triangulation_is_refused():
    with pytest.raises(SceneError, match="delaunay"):
        run_fluid(
            CELLS, "duration = 1\nstep = 1", 'mesh = "given"\ntriangulation = "best"', shapes.grid(4, 4)
        )
