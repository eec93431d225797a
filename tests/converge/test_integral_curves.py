"""Geodesic Runge-Kutta methods: orders on flat and developable meshes, and error control."""

import re

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.paths import path_lengths
from ddgcli.algorithms.tangent_fields.curve_starts import random_starts
from ddgcli.algorithms.tangent_fields.field_curves import field_curves
from ddgcli.algorithms.tangent_fields.integral_curves import check_field_step, integral_curves
from ddgcli.algorithms.tangent_fields.tangent_field import field_of_array
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import surface_position, to_face_frame
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import beside_a_sphere


def ends(mesh, curves):
    last = curves.paths.start[1:] - 1
    return surface_position(mesh, curves.paths.face[last], curves.paths.barycentric[last])


def plane():
    mesh = shapes.grid(13, 11, 2.0, 2.0)
    mesh = mesh.moved(mesh.points - [1, 1, 0])

    def field(face, b):
        x, y, _ = surface_position(mesh, face, b).T
        return to_face_frame(mesh, face, np.stack([-y, x, 0 * x], axis=1))

    starts = SurfacePoints([30, 100, 77], [[0.2, 0.3, 0.5], [0.3, 0.3, 0.4], [0.0, 0.4, 0.6]])
    turn = np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]])
    return mesh, field, starts, starts.positions(mesh) @ turn.T


def prism():
    """A vertical prism: the field (1, sin s) in arc length s and height, integrated exactly."""
    n = 24
    mesh = shapes.cylinder(n, 9, 1.0, 4.0)
    width = 2 * np.sin(np.pi / n)

    def unrolled(p):
        angle = np.arctan2(p[:, 1], p[:, 0]) % (2 * np.pi)
        piece = np.floor(angle / (2 * np.pi / n) + 1e-9)
        left = np.stack([np.cos(2 * np.pi * piece / n), np.sin(2 * np.pi * piece / n)], axis=1)
        return width * piece + np.linalg.norm(p[:, :2] - left, axis=1)

    total = n * width

    def field(face, b):
        p = surface_position(mesh, face, b)
        s = unrolled(p) * 2 * np.pi / total
        corners = mesh.points[mesh.faces[face]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        along = np.cross([0.0, 0.0, 1.0], normal)
        return to_face_frame(mesh, face, along + np.sin(s)[:, None] * np.array([0.0, 0.0, 1.0]))

    starts = SurfacePoints([100, 201], [[0.2, 0.3, 0.5], [0.3, 0.3, 0.4]])
    p = starts.positions(mesh)
    c = 2 * np.pi / total
    s0, s1 = unrolled(p) * c, (unrolled(p) + 1.0) * c
    z = p[:, 2] + (np.cos(s0) - np.cos(s1)) / c
    s = (unrolled(p) + 1.0) % total
    piece, rest = np.divmod(s, width)
    a, b = 2 * np.pi * piece / n, 2 * np.pi * (piece + 1) / n
    share = rest / width
    truth = np.stack(
        [(1 - share) * np.cos(a) + share * np.cos(b), (1 - share) * np.sin(a) + share * np.sin(b), z], axis=1
    )
    return mesh, field, starts, truth


@pytest.mark.parametrize("case", [plane, prism])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_runge_kutta_orders_are_1_2_and_4(case, order):
    mesh, field, starts, truth = case()
    errors = []
    for n in (10, 20, 40):
        curves = integral_curves(mesh, field, starts, 1.0, order=order, step=1 / n)
        assert set(curves.stopped_because) == {"time"}
        errors.append(np.abs(ends(mesh, curves) - truth).max())
        assert 0.9 < curves.error_estimate.max() / errors[-1] < 1.2 * 2**order  # against steps twice as long
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(rates - order).max() < 0.1, (
        errors,
        rates,
    )  # nor a higher order


@pytest.mark.parametrize("mesh", [shapes.random_sphere(300), shapes.torus(24, 12)])
def test_on_other_polyhedra_every_order_falls_with_the_step(mesh):
    """There a field is only piecewise smooth: all methods have first order, with much smaller constants."""
    field = field_of_array(mesh, np.cross([0.2, -0.1, 1.0], mesh.points))
    starts = random_starts(mesh, 12, seed=1)

    def end_points(order, n):
        return ends(mesh, integral_curves(mesh, field, starts, 1.0, order=order, step=1 / n))

    truth = end_points(4, 400)
    steps = np.array([8, 16, 32])
    error = {
        order: np.array([np.sqrt(np.mean((end_points(order, n) - truth) ** 2)) for n in steps])
        for order in (1, 2, 4)
    }
    for order in error:
        slope = np.polyfit(np.log2(steps), np.log2(error[order]), 1)[0]
        assert -1.7 < slope < -0.75, (order, slope)
    assert (error[2] < 0.15 * error[1]).all() and (error[4] < error[2]).all()


def test_adaptive_steps_satisfy_the_tolerance():
    mesh, field, starts, truth = plane()
    for tolerance in (1e-4, 1e-6, 1e-8):
        curves = integral_curves(mesh, field, starts, 1.0, tolerance=tolerance)
        assert np.abs(ends(mesh, curves) - truth).max() < 20 * tolerance
    coarse = integral_curves(mesh, field, starts, 1.0, tolerance=1e-3)
    assert coarse.steps.max() < curves.steps.max()


@pytest.mark.parametrize("mesh", [shapes.random_sphere(300), shapes.torus(24, 12), shapes.icosphere(3)])
def test_on_curved_meshes_the_stated_error_is_no_less_than_half_the_error(mesh):
    """A division by 2^4 - 1, which holds where the field is smooth, states a tenth to two fifths of it."""
    field = field_of_array(mesh, np.cross([0.2, -0.1, 1.0], mesh.points))
    starts = random_starts(mesh, 12, seed=1)
    truth = ends(mesh, integral_curves(mesh, field, starts, 1.0, step=1 / 400))
    curves = integral_curves(mesh, field, starts, 1.0)
    ratio = curves.error_estimate.max() / np.linalg.norm(ends(mesh, curves) - truth, axis=1).max()
    assert 0.5 < ratio < 8


def test_a_vertex_array_of_a_linear_field_is_that_field():
    mesh, _, starts, truth = plane()
    values = np.stack([-mesh.points[:, 1], mesh.points[:, 0], 0 * mesh.points[:, 0]], axis=1)
    curves = integral_curves(mesh, field_of_array(mesh, values), starts, 1.0, step=0.02)
    np.testing.assert_allclose(ends(mesh, curves), truth, atol=1e-7)
    start = starts.positions(mesh)
    np.testing.assert_allclose(path_lengths(mesh, curves.paths), np.linalg.norm(start, axis=1), rtol=1e-4)


def test_rotation_field_on_spheres_gives_parallels():
    errors = []
    for level in (3, 4):
        mesh = shapes.icosphere(level)
        values = np.cross([0, 0, 1.0], mesh.points)
        starts = random_starts(mesh, 10, seed=1)
        p = starts.positions(mesh)
        curves = integral_curves(mesh, field_of_array(mesh, values), starts, 1.0, tolerance=1e-4)
        turn = np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]])
        errors.append(np.linalg.norm(ends(mesh, curves) - p @ turn.T, axis=1).max())
    assert errors[0] < 0.02 and errors[1] < 0.5 * errors[0]


def test_curves_on_a_component_do_not_depend_on_the_size_of_another():
    mesh, scale, first = shapes.random_sphere(400), 2.0**-10, np.eye(3)[0]
    both, n_vertices, n_faces = beside_a_sphere(mesh, scale)
    rotation = np.cross([0.0, 0.0, 1.0], both.points)

    def curves(mesh, velocity, faces):
        starts = SurfacePoints(np.array(faces), np.tile(first, (len(faces), 1)))
        return integral_curves(mesh, field_of_array(mesh, velocity), starts, 5.0)

    alone = curves(mesh, rotation[n_vertices:] / scale, [3])
    beside = curves(both, rotation, [0, n_faces + 3])
    assert beside.steps[1] == alone.steps[0]
    assert np.isclose(beside.error_estimate[1], scale * alone.error_estimate[0], rtol=1e-6)
    assert np.allclose(ends(both, beside)[1] / scale, ends(mesh, alone)[0], rtol=0, atol=1e-9)


def test_curves_stop_at_the_boundary_and_at_rest():
    mesh = shapes.grid(8, 8)
    values = np.tile([1.0, 0.0, 0.0], (mesh.n_vertices, 1))
    curves = field_curves(mesh, values, SurfacePoints([20, 60], [[0.3, 0.3, 0.4]] * 2), 5.0)
    assert {e["stopped_because"] for e in curves.entries} == {"boundary"}
    assert all(e["end"]["point"][0] == pytest.approx(1.0) for e in curves.entries)
    values[:] = 0
    values[0] = [1, 0, 0]
    rest = field_curves(mesh, values, SurfacePoints([100], [[0.3, 0.3, 0.4]]), 5.0)
    assert rest.entries[0]["stopped_because"] == "critical point" and rest.entries[0]["length"] == 0


@pytest.mark.parametrize(
    "change, word",
    [
        ({"order": 3}, "order"),
        ({"duration": -1.0}, "duration"),
        ({"step": 0.0}, "step"),
        ({"tolerance": -1.0}, "tol"),
    ],
)
def test_bad_options_are_refused(change, word):
    mesh = shapes.grid(2, 2)
    values = np.ones((mesh.n_faces, 3))
    with pytest.raises(ParameterError, match=word):
        field_curves(mesh, values, SurfacePoints([0], [[1, 0, 0]]), **({"duration": 1.0} | change))


def test_bad_fields_are_refused():
    mesh = shapes.grid(2, 2)
    with pytest.raises(ParameterError, match="shape"):
        field_of_array(mesh, np.ones((5, 3)))
    with pytest.raises(ParameterError, match="finite"):
        field_of_array(mesh, np.full((mesh.n_faces, 3), np.nan))
    with pytest.raises(ParameterError, match="zero everywhere"):
        field_curves(mesh, np.zeros((mesh.n_faces, 3)), SurfacePoints([0], [[1, 0, 0]]))
    assert isinstance(mesh, TriangleMesh)


def test_a_step_too_short_for_the_time_is_refused_with_one_that_works():
    mesh = shapes.grid(4, 4)
    field = field_of_array(mesh, np.tile([1.0, 0, 0], (mesh.n_faces, 1)))
    starts = SurfacePoints(np.array([0]), np.array([[0.3, 0.3, 0.4]]))
    with pytest.raises(
        ParameterError, match=r"takes 5e\+04 steps .* step of at least \S+, or a time"
    ) as refusal:
        integral_curves(mesh, field, starts, 0.5, step=1e-5)
    step, duration = map(float, re.findall(r"at (?:least|most) ([\d.e-]+\d)", str(refusal.value)))
    check_field_step(step, 0.5)
    check_field_step(1e-5, duration)
