"""Fluid that crosses the boundary of a curved surface."""

import numpy as np

from benchmarks.fluids.runs import run_fluid
from ddgcli.mesh.triangle_mesh import TriangleMesh

TURN = 'velocity = ["-y", "x", 0]'
SIDES = f'[[effects.boundary]]\nkind = "outflow"\nwhere = "(y < 1e-6)*(x < 0)"\n{TURN}\n'
SIDES += f'[[effects.boundary]]\nkind = "inflow"\nwhere = "y < 1e-6"\n{TURN}\n'
SIDES += f'[[effects.boundary]]\nkind = "wall"\n{TURN}\n'


def half_of_a_long_ellipsoid(rows):
    """Faces between two latitudes, on one side of a plane through the axis of length 4."""
    latitude, longitude = np.linspace(-1, 1, rows + 1), np.linspace(0, np.pi, 2 * rows + 1)
    a, o = np.meshgrid(latitude, longitude, indexing="ij")
    points = np.stack([np.cos(a) * np.cos(o), np.cos(a) * np.sin(o), 2 * np.sin(a)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(range(rows), range(2 * rows), indexing="ij"))
    width = 2 * rows + 1
    p = i * width + j
    faces = [np.stack([p, p + 1, p + width + 1], axis=1), np.stack([p, p + width + 1, p + width], axis=1)]
    return TriangleMesh.from_arrays(points, np.concatenate(faces))


def test_a_turn_about_the_axis_of_a_spheroid_that_enters_and_leaves_is_not_slowed_by_its_deformation():
    """It is an isometry: steady with this Laplacian, whose curvature acts on the stream that enters, too."""
    errors = []
    for rows in (8, 16):
        mesh = half_of_a_long_ellipsoid(rows)
        effects = f'viscosity = {{ nu = 0.3, kind = "deformation" }}\ninitial = {{ {TURN} }}\n{SIDES}'
        out = run_fluid(effects, "duration = 1\nstep = 0.1\nframe_every = 1", 'mesh = "given"', mesh)
        x, y, _ = mesh.points.T
        velocity = out.observations[-1].vertex["velocity"]
        apart = np.linalg.norm(velocity - np.stack([-y, x, 0 * x], axis=1), axis=1)
        errors.append(apart[~mesh.topology.boundary_vertex].max())
    assert errors[0] / errors[1] > 3 and errors[1] < 0.012
