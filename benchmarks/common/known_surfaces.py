"""Bodies with known curvature, and their surfaces from segmented or sampled volumes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.level_sets import (
    Body,
    principal_curvatures,
    projected,
    samples,
    surface_nets,
    within,
)
from benchmarks.common.mesh_sequences import marching_cubes, voxel_boundary
from ddgcli.mesh.triangle_mesh import TriangleMesh

MAX_DISTANCE = 4.0  # of a vertex from the surface, in voxels: farther ones lie on a box that cuts the body
TURN = np.linalg.qr(np.array([[0.6, 0.3, -0.5], [0.2, 0.9, 0.4], [0.7, -0.2, 0.6]]))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))


@dataclass(frozen=True, eq=False)
class KnownSurface:
    """A mesh and the principal curvatures (n, 2) of the surface that it samples where they count (n,)."""

    mesh: TriangleMesh
    curvature: NDArray
    counted: NDArray


def _ellipsoid(a: float, b: float, c: float) -> Body:
    size = (a * b * c) ** (1 / 3)
    return Body(
        lambda x, y, z: size * (np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 + 1e-30) - 1), (a, b, c)
    )


def _wave(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return z - 3 * np.sin(x / 8) * np.cos(y / 9)


def _saddle(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return z - (x * x - y * y) / 60


def _capsule(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return np.sqrt(x * x + y * y + (z - np.clip(z, -12, 12)) ** 2) - 8


def _rounded_box(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    beyond = [np.maximum(np.abs(c) - half, 0) for c, half in zip((x, y, z), (9, 7, 5))]
    return np.sqrt(sum(c * c for c in beyond)) - 6


BODIES = {
    "sphere": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 12, (12, 12, 12)),
    "large sphere": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 20, (20, 20, 20)),
    "cylinder": Body(lambda x, y, z: np.hypot(x, y) - 8, (8, 8, 20), within(99, 99, 11)),
    "torus": Body(lambda x, y, z: np.hypot(np.hypot(x, y) - 16, z) - 7, (23, 23, 7)),
    "ellipsoid": _ellipsoid(20, 13, 9),
    "egg": Body(
        lambda x, y, z: np.sqrt((x / 1.4) ** 2 + (y * y + z * z) * (1 + 0.02 * x)) - 11, (16, 15, 15)
    ),
    "gyroid": Body(
        lambda x, y, z: (
            np.sin(x / 5) * np.cos(y / 5) + np.sin(y / 5) * np.cos(z / 5) + np.sin(z / 5) * np.cos(x / 5)
        ),
        (20, 20, 20),
        within(13, 13, 13),
    ),
    "catenoid": Body(lambda x, y, z: np.hypot(x, y) - 9 * np.cosh(z / 9), (15, 15, 9), within(99, 99, 5)),
    "saddle": Body(_saddle, (22, 22, 12), within(15, 15, 99)),
    "capsule": Body(_capsule, (8, 8, 20)),
    "rounded box": Body(_rounded_box, (15, 13, 11)),
    "wave": Body(_wave, (30, 30, 7), within(23, 23, 99)),
}  # fmt: skip


def known(body: Body, mesh: TriangleMesh) -> KnownSurface:
    """The mesh with the curvature of the body at the nearest points, near the boundary left out."""
    at = projected(body, mesh.points)
    counted = np.linalg.norm(at - mesh.points, axis=1) < MAX_DISTANCE
    if body.counted is not None:
        counted &= body.counted(*at.T)
    return KnownSurface(mesh, principal_curvatures(body, at), counted)


def voxels(
    body: Body,
    surface_of: Callable[[NDArray], TriangleMesh],
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
    turn: NDArray | None = None,
    change: Callable[[TriangleMesh], TriangleMesh] = lambda mesh: mesh,
) -> KnownSurface:
    """Surface of a sampled volume of a body, by `surface_of` from its values on a grid."""
    values, place = samples(body, spacing, turn)
    mesh = surface_of(values)
    return known(body, change(mesh.moved(place(mesh.points))))


def cubes(values: NDArray) -> TriangleMesh:
    """Boundary of the voxels inside."""
    return voxel_boundary(values < 0)


def binary(values: NDArray) -> TriangleMesh:
    """Marching cubes of the segmented image."""
    return marching_cubes(values < 0)


def nets(values: NDArray) -> TriangleMesh:
    """Surface nets of the segmented image."""
    return surface_nets(values < 0)


def grey(values: NDArray) -> TriangleMesh:
    """Marching cubes of the function itself: with slivers, on the surface up to interpolation."""
    return marching_cubes(0.5 - values)


def grey_of_bits(bits: int, values: NDArray) -> TriangleMesh:
    """Marching cubes of the share of each voxel inside, in whole steps of grey."""
    steps = 2**bits - 1
    return marching_cubes(np.rint(np.clip(0.5 - values, 0, 1) * steps) / steps)


def mean_error(surface: KnownSurface, mean: NDArray) -> float:
    """Mean error of the mean curvature (n,), over its mean size."""
    truth, counted = surface.curvature.mean(axis=1), surface.counted
    return float(np.abs(mean - truth)[counted].mean() / np.abs(truth[counted]).mean())


def error_as_stated(surface: KnownSurface, mean: NDArray) -> float:
    """Mean error of the mean curvature (n,), as warnings state it: over its mean size, on minimal surfaces a
    quarter of the larger principal curvature, and inside the boundary.
    """
    counted = surface.counted & ~surface.mesh.topology.boundary_vertex
    curvature = surface.curvature[counted]
    truth = curvature.mean(axis=1)
    size = max(np.abs(truth).mean(), 0.25 * np.median(np.abs(curvature).max(axis=1)))
    return float(np.abs(mean[counted] - truth).mean() / size)
