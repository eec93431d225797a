"""Gradient and divergence: exact on linear functions, and together the stiffness."""

import numpy as np
import pytest

from ddgcli.geometry.extrinsic import face_normal
from ddgcli.mesh import shapes
from ddgcli.operators.gradient import divergence, gradient
from ddgcli.operators.laplacian import stiffness

MESHES = [shapes.random_sphere(200), shapes.torus(), shapes.grid(5, 4), shapes.catenoid(12, 8)]


@pytest.mark.parametrize("mesh", MESHES)
def test_gradient_of_a_linear_function_is_its_tangent_part(mesh):
    vector = np.array([1.0, -2.0, 0.5])
    computed = (gradient(mesh) @ (mesh.points @ vector)).reshape(-1, 3)
    normal = face_normal(mesh)
    assert np.abs(computed - (vector - (normal @ vector)[:, None] * normal)).max() < 1e-11


@pytest.mark.parametrize("mesh", MESHES)
def test_divergence_of_gradient_is_minus_stiffness(mesh):
    L = stiffness(mesh)
    assert abs(divergence(mesh) @ gradient(mesh) + L).max() < 1e-12 * abs(L).max()


def test_faces_without_area_have_no_gradient():
    mesh = shapes.grid(2, 2)
    points = mesh.points.copy()
    points[1] = 0.5 * (points[0] + points[2])
    points[4] = points[1] + [0.2, 0, 0]
    flat = mesh.moved(points * [1, 0, 0])
    assert np.abs(gradient(flat) @ flat.points[:, 0]).max() == 0
