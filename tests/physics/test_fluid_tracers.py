"""Dye in a solid-body rotation: its amount, its bounds, its peak, its order."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial import Delaunay

from benchmarks.common.submesh import submesh
from ddgcli.mesh import shapes
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.tracer import SurfaceTracer
from ddgcli.models.fluid.transport import Transport
from ddgcli.scenes.shapes import Grid, grid_mesh

SHAPES = {
    "smooth": lambda x, y, z: 1 + 0.5 * x + 0.2 * x * y,
    "peak": lambda x, y, z: np.exp(-8 * ((x - 1) ** 2 + y**2 + z**2)),
    "step": lambda x, y, z: (x > 0.7) * 1.0,
    "no sum": lambda x, y, z: x * y,
}


def revolved(mesh, amount, steps, turns=1.0):
    """(space, start, end) of an amount that turns about the z axis at unit angular speed."""
    space = SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)))
    vorticity = 2 * mesh.points[:, 2] * space.mass
    vorticity -= space.mass * vorticity.sum() / space.mass.sum()
    flux = space.side_flux(space.stream_function(vorticity), np.zeros(0))
    tracer = SurfaceTracer(space, Transport(space))
    values = start = SHAPES[amount](*mesh.points.T)
    for _ in range(steps):
        values = tracer.advance(values, flux, 2 * np.pi * turns / steps)
    return space, start, values


def two_spheres():
    ball, other = shapes.icosphere(2), shapes.random_sphere(200)
    faces = np.concatenate([ball.faces, other.faces + ball.n_vertices])
    points = np.concatenate([ball.points, other.points])
    return TriangleMesh(points, Topology(faces, len(points)))


MESHES = {
    "regular": lambda: shapes.icosphere(3),
    "irregular": lambda: shapes.random_sphere(500),
    "two": two_spheres,
}


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("amount", SHAPES)
def test_amount_and_bounds_are_kept(mesh, amount):
    space, start, end = revolved(MESHES[mesh](), amount, 30)
    label = space.mesh.topology.vertex_component
    for component in range(space.mesh.topology.n_components):
        mass = np.where(label == component, space.mass, 0.0)
        assert abs(mass @ (end - start)) < 1e-13 * (mass @ np.abs(start))
    assert end.min() >= start.min() and end.max() <= start.max()
    assert np.abs(end - start).max() > 1e-3


def test_no_time_changes_no_dye_and_an_even_dye_stays():
    mesh = shapes.random_sphere(300)
    space, start, end = revolved(mesh, "step", 3, turns=0.0)
    assert np.abs(end - start).max() < 1e-12
    tracer = SurfaceTracer(space, Transport(space))
    flux = np.random.default_rng(0).normal(size=(mesh.n_faces, 3))
    flux -= flux.mean(axis=1, keepdims=True)
    assert np.array_equal(tracer.advance(np.full(space.n, 0.3), flux, 0.01), np.full(space.n, 0.3))


def test_smooth_dye_converges_at_second_order():
    error = []
    for level in (2, 3, 4):
        space, start, end = revolved(shapes.icosphere(level), "smooth", 25 * 2 ** (level - 2))
        error.append(np.sqrt(space.enstrophy((end - start) * space.mass)))
    assert (np.log2(np.array(error[:-1]) / error[1:]) > 1.8).all()


def test_a_peak_survives_a_revolution_of_5k_faces():
    """Linear interpolation leaves a half of it."""
    _, start, end = revolved(shapes.icosphere(4), "peak", 100)
    assert start.max() == 1 and end.max() > 0.85


def disk(rings):
    """Rings of 6 k vertices around the origin, to the unit circle."""
    angle = [2 * np.pi * np.arange(6 * k) / (6 * k) for k in range(1, rings + 1)]
    ring = [np.column_stack([np.cos(a), np.sin(a)]) * (k + 1) / rings for k, a in enumerate(angle)]
    points = np.concatenate([np.zeros((1, 2)), *ring])
    faces = Delaunay(points).simplices
    corner = points[faces]
    (ax, ay), (bx, by) = (corner[:, 1] - corner[:, 0]).T, (corner[:, 2] - corner[:, 0]).T
    turned = ax * by - ay * bx
    faces = np.where(turned[:, None] > 0, faces, faces[:, ::-1])[np.abs(turned) > 1e-9]
    return TriangleMesh(np.column_stack([points, np.zeros(len(points))]), Topology(faces, len(points)))


def test_velocities_at_vertices_are_those_of_quadratic_stream_functions_at_walls_too():
    mesh = grid_mesh(Grid(size=[2, 1], cells=[8, 6], pattern="alternating"))
    x, y, _ = mesh.points.T
    inside = ~mesh.topology.boundary_vertex
    moved = np.random.default_rng(1).uniform(-0.03, 0.03, (2, len(x))) * inside
    mesh = TriangleMesh.from_arrays(np.column_stack([x + moved[0], y + moved[1], 0 * x]), mesh.faces)
    space, (x, y, _) = SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges))), mesh.points.T
    flux = space.side_flux(x * x - x * y + 0.5 * y * y + x - y, np.zeros(0))
    first = mesh.points[mesh.faces[:, 1]] - mesh.points[mesh.faces[:, 0]]
    axis = (first[:, 0] + 1j * first[:, 1]) / np.linalg.norm(first, axis=1)
    error = Transport(space).corners(flux) * axis[:, None] - (y - x - 1 - 1j * (2 * x - y + 1))[mesh.faces]
    assert np.abs(error).max() < 1e-11  # shift 1e-12 over least eigenvalue 0.27, slopes of 3


def test_points_at_a_reentrant_corner_move_along_the_nearer_wall():
    square = grid_mesh(Grid(size=[2, 2], cells=[4, 4], pattern="left"))
    centre = square.points[square.faces].mean(axis=1)
    mesh = submesh(square, square.faces[(centre[:, 0] < 1) | (centre[:, 1] < 1)])
    transport = Transport(SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges))))
    at = np.flatnonzero((np.abs(mesh.points - [1, 1, 0]) < 1e-9).all(axis=1))
    face, corner = np.nonzero(mesh.faces == at)
    first = mesh.points[mesh.faces[:, 1]] - mesh.points[mesh.faces[:, 0]]
    axis = (first[:, 0] + 1j * first[:, 1]) / np.linalg.norm(first, axis=1)
    for angle, speed in product(np.radians([10, 40, 50, 80, 100, 170, 260, 350]), (0.3, 1e-5)):
        flow = speed * np.exp(1j * angle)
        velocity = np.repeat(flow / axis[:, None], 3, axis=1)
        moved = transport.backwards(velocity, face, np.eye(3)[corner], -1.0)
        place = np.einsum("ij,ija->ia", moved.barycentric, mesh.points[mesh.faces[moved.face]])
        along = flow
        if flow.real > 0 and flow.imag > 0:  # into the corner that is not there
            along = flow.real if flow.real > flow.imag else 1j * flow.imag
        assert np.abs(place[:, 0] + 1j * place[:, 1] - (1 + 1j) - along).max() < 1e-6 * speed
        assert np.abs(moved.shift * axis[face] - along).max() < 1e-6 * speed


def test_dye_and_points_at_a_round_wall_move_along_it():
    """Lines from vertices of a wall leave the polygon at once: they stayed where they were."""
    mesh = disk(10)
    space = SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)))
    flux = space.side_flux(space.stream_function(2 * space.mass), np.zeros(0))
    transport = Transport(space)
    tracer, (x, y, _) = SurfaceTracer(space, transport), mesh.points.T
    values = x
    for _ in range(10):
        values = tracer.advance(values, flux, 0.1)
    assert np.abs(values - (x * np.cos(1) + y * np.sin(1))).max() < 0.01
    rim = np.flatnonzero(mesh.topology.boundary_vertex)
    for slowness in (1.0, 1e-6):  # slow ones stayed: their lines started within a tolerance of the vertex
        corners = transport.corners(slowness * flux)
        moved = transport.vertices_backwards(corners, rim, -1.0)
        place = np.einsum("ij,ija->ia", moved.barycentric, mesh.points[mesh.faces[moved.face]])
        turn = (place[:, 0] + 1j * place[:, 1]) / (x[rim] + 1j * y[rim])
        assert np.abs(np.abs(turn) - 1).max() < 0.01
        # the sides of the polygon that one long step meets add up to more than the arc
        assert np.abs(np.angle(turn) / slowness - 1).max() < (0.2 if slowness == 1.0 else 0.005)
