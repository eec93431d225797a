"""Surfaces whose curvature is known everywhere, from implicit equations, and meshes inscribed in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class Truth:
    """Principal curvatures and directions at points; positive where convex."""

    k_min: np.ndarray
    k_max: np.ndarray
    d_min: np.ndarray
    d_max: np.ndarray

    @property
    def mean(self):
        return (self.k_min + self.k_max) / 2

    @property
    def gauss(self):
        return self.k_min * self.k_max


def truth_of(gradient, hessian) -> Truth:
    """Curvature of level sets of F, outward along its gradient: Hessian in the tangent plane / |grad F|."""
    size = np.linalg.norm(gradient, axis=1)
    normal = gradient / size[:, None]
    project = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    form = project @ hessian @ project / size[:, None, None]
    reach = 10 * np.abs(form).max()
    values, vectors = np.linalg.eigh(form + reach * normal[:, :, None] * normal[:, None, :])
    return Truth(values[:, 0], values[:, 1], vectors[:, :, 0], vectors[:, :, 1])


def ellipsoid_truth(points, axes=(1.0, 1.0, 1.0)) -> Truth:
    a = np.asarray(axes) ** -2.0
    return truth_of(points * a, np.broadcast_to(np.diag(a), (len(points), 3, 3)))


def torus_truth(points, major=1.0, minor=0.4) -> Truth:
    """F = ((rho - R)^2 + z^2) / 2 with rho the distance from the axis."""
    x, y, z = points.T
    rho = np.hypot(x, y)
    radial = np.stack([x / rho, y / rho, 0 * x], axis=1)
    around = np.stack([-y / rho, x / rho, 0 * x], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    gradient = (rho - major)[:, None] * radial + z[:, None] * up
    hessian = (
        radial[:, :, None] * radial[:, None, :]
        + ((rho - major) / rho)[:, None, None] * around[:, :, None] * around[:, None, :]
        + up[:, None] * up[None, :]
    )
    return truth_of(gradient, hessian)


def irregular_ellipsoid(n, axes=(1.5, 1.0, 0.6), seed=0) -> TriangleMesh:
    """Random points on the sphere, triangulated there, then stretched: irregular and not Delaunay."""
    mesh = shapes.random_sphere(n, seed)
    return mesh.moved(mesh.points * np.array(axes))


def irregular_torus(nu, nv, major=1.0, minor=0.4, seed=0, jitter=0.3) -> TriangleMesh:
    """Torus grid with random diagonals, its parameters jittered by a share of a cell."""
    rng = np.random.default_rng(seed)
    u, v, faces = shapes.wrapped_grid(nu, nv, wrap_u=True, wrap_v=True)
    pairs = faces.reshape(-1, 2, 3)
    a, b, c, d = pairs[:, 0, 0], pairs[:, 0, 1], pairs[:, 0, 2], pairs[:, 1, 2]
    turned = rng.random(len(pairs)) < 0.5
    first = np.where(turned, [a, b, d], [a, b, c]).T
    second = np.where(turned, [b, c, d], [a, c, d]).T
    u = 2 * np.pi * (u + jitter * rng.uniform(-0.5, 0.5, len(u)) / nu)
    v = 2 * np.pi * (v + jitter * rng.uniform(-0.5, 0.5, len(v)) / nv)
    r = major + minor * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), minor * np.sin(v)], axis=1)
    return TriangleMesh.from_arrays(points, np.concatenate([first, second]))
