"""Meshes and runs that the tests of the Willmore flow share."""

import numpy as np

from ddgcli.mesh import shapes
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import DEFAULT_STOP
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve


def run_flow(mesh, options=None, region=None, **time_options):
    """(all snapshots' observations, last surface)."""
    timed = any(k in time_options for k in ("step", "duration"))
    options = options or FlowOptions(timed=timed, stop=FlowOptions().stop if timed else DEFAULT_STOP)
    built, model = setup.build(mesh, options, region)
    shots = list(evolve({"s": model}, setup.schedule(built, time_options), Account()))
    observations = [shot.observations["s"] for shot in shots]
    faces = mesh.faces if observations[-1].faces is None else observations[-1].faces
    return observations, TriangleMesh(observations[-1].points, Topology(faces, mesh.n_vertices)), shots


def energies(observations):
    return np.array([o.scalar["energy"] for o in observations])


def assert_falls(observations):
    assert (np.diff(energies(observations)) <= 0).all()
    assert observations[-1].scalar["energy_increases"] == 0


def ellipsoid(level=3):
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 2.0])


def two_components(first, second):
    """One surface of two, the second at x = 3."""
    faces = np.concatenate([first.faces, second.faces + first.n_vertices])
    return TriangleMesh.from_arrays(np.concatenate([first.points, second.points + [3.0, 0.0, 0.0]]), faces)


def saddle(n):
    """z = (x^2 - y^2) / 2 over [-1, 1]^2: W = 0.0414968."""
    grid = shapes.grid(n, n, pattern="alternating")
    x, y = (2 * grid.points[:, :2] - 1).T
    return grid.moved(np.stack([x, y, (x**2 - y**2) / 2], axis=1))


def prolate(level):
    """A vesicle of reduced volume 0.65: an ellipsoid of half axes 1, 1, c."""
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 3.3])


def bowl():
    """A quarter of a sphere's height, with its rim."""
    grid = shapes.grid(16, 16, 2.0, 2.0)
    x, y = (grid.points[:, :2] - 1).T
    bump = 0.3 * (1 - x**2) ** 2 * (1 - y**2) ** 2
    return grid.moved(np.stack([x, y, bump * (1 + 0.5 * np.sin(5 * x))], axis=1))
