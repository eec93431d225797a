"""Mesh classes: sequences of triangulations, ever finer, of shapes with known truths.

Shapes on which a default was tuned: the torus (the curvature fit); the sphere and the ellipsoid did not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

MeshSequence = Callable[[int], TriangleMesh]
Points = NDArray[np.float64]
REFINED_DEGREES = 25.0


def good(level: int) -> TriangleMesh:
    """Geodesic sphere: regular, Delaunay."""
    return shapes.icosphere(level + 2)


def irregular(level: int) -> TriangleMesh:
    """Hull of random points: irregular, Delaunay."""
    return shapes.random_sphere(10 * 4 ** (level + 2) + 2, seed=level)


def stretched(level: int) -> TriangleMesh:
    """The irregular sphere pulled along z by four and pushed back: anisotropic triangles, not Delaunay."""
    return _stretched(irregular(level))


def _stretched(mesh: TriangleMesh) -> TriangleMesh:
    return shapes.mesh_on_sphere(_scaled(mesh, (1.0, 1.0, 4.0)))


def noisy(level: int) -> TriangleMesh:
    """Geodesic sphere whose vertices are moved along it by up to a third of an edge."""
    mesh = good(level)
    move = np.random.default_rng(level).uniform(-1, 1, mesh.points.shape) * mesh.side_length.mean() / 3
    return shapes.mesh_on_sphere(mesh.moved(mesh.points + move))


def refined(level: int) -> TriangleMesh:
    """A stretched sphere of fewer points after `refine` to 25 degrees, its Steiner points on the sphere."""
    return delaunay_refined(_stretched(shapes.random_sphere(4 ** (level + 3), seed=level)), _unit)


def delaunay_refined(mesh: TriangleMesh, onto: Callable[[Points], Points]) -> TriangleMesh:
    """The refined intrinsic triangulation with flat faces, all its vertices on the smooth shape."""
    intrinsic = refine(mesh, REFINED_DEGREES).triangulation.mesh
    return TriangleMesh.from_arrays(onto(np.asarray(intrinsic.points)), np.asarray(intrinsic.faces))


def _unit(points: Points) -> Points:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _scaled(mesh: TriangleMesh, axes: tuple[float, float, float]) -> TriangleMesh:
    return mesh.moved(mesh.points * np.array(axes))


SPHERES: dict[str, MeshSequence] = {
    "good": good,
    "irregular": irregular,
    "stretched": stretched,
    "noisy": noisy,
    "refined": refined,
}


def ellipsoids(axes: tuple[float, float, float]) -> dict[str, MeshSequence]:
    """The same mesh classes on an ellipsoid; refined there, where its own edges are."""
    sequences = {name: lambda level, m=make: _scaled(m(level), axes) for name, make in SPHERES.items()}

    def refined_ellipsoid(level: int) -> TriangleMesh:
        coarse = _scaled(_stretched(shapes.random_sphere(4 ** (level + 3), seed=level)), axes)
        return delaunay_refined(coarse, lambda p: _unit(p / np.array(axes)) * np.array(axes))

    return sequences | {"refined": refined_ellipsoid}


def tori() -> dict[str, MeshSequence]:
    """Torus R = 1, r = 0.4: a regular grid, needles of aspect ten, and these after `refine`."""

    def needles(level: int, around: int = 60, across: int = 4) -> TriangleMesh:
        return shapes.torus(around * 2**level, across * 2**level, pattern="alternating")

    def onto(points: Points) -> Points:
        ring = np.hypot(points[:, 0], points[:, 1])
        core = points * (1.0 / ring)[:, None] * [1, 1, 0]
        return core + 0.4 * _unit(points - core)

    return {
        "good": lambda level: shapes.torus(20 * 2**level, 8 * 2**level, pattern="alternating"),
        "stretched": needles,
        "refined": lambda level: delaunay_refined(needles(level, 36, 3), onto),
    }


def strips() -> dict[str, MeshSequence]:
    """Strips 1 x 0.2 of 10 x 2 cells and finer: stretched four times, jittered by a quarter cell, refined."""

    def stretched_strip(level: int) -> TriangleMesh:
        return shapes.grid(10 * 2**level, 8 * 2**level, width=1.0, height=0.2, pattern="right")

    def noisy_strip(level: int) -> TriangleMesh:
        n = 10 * 2**level
        mesh = shapes.grid(n, n // 5, width=1.0, height=0.2, pattern="right")
        move = np.random.default_rng(level).uniform(-1, 1, (mesh.n_vertices, 3)) / (4 * n) * [1, 1, 0]
        fixed = mesh.topology.boundary_vertex | (mesh.points[:, 0] < 1.5 / n)
        return mesh.moved(mesh.points + np.where(fixed[:, None], 0.0, move))

    return {
        "stretched": stretched_strip,
        "noisy": noisy_strip,
        "refined": lambda level: delaunay_refined(noisy_strip(level), lambda points: points),
    }


# a second closed shape for curvature, which shows that no scheme is tuned to the first
FEW_SPHERES = {name: SPHERES[name] for name in ("good", "irregular", "refined")}

# command -> (truth, sequences); the first one is plotted
STUDIES: dict[str, list[tuple[str, dict[str, MeshSequence]]]] = {
    "curvature": [
        ("ellipsoid:1,1.5,2", ellipsoids((1.0, 1.5, 2.0))),
        ("torus:1,0.4", tori()),
        ("sphere:1", FEW_SPHERES),
    ],
    "geodesic": [("sphere:1", SPHERES)],
    "laplacian": [("sphere:1", SPHERES)],
    "delaunay": [("sphere:1", SPHERES)],
}
