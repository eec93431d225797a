"""Families of triangulations of shapes with known truths: each a ladder of meshes of falling size.

Truths that tuned a default: the torus (the curvature fit); the sphere and the ellipsoid did not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

Ladder = Callable[[int], TriangleMesh]


def good(level: int) -> TriangleMesh:
    """Geodesic sphere: regular, Delaunay."""
    return shapes.icosphere(level + 2)


def irregular(level: int) -> TriangleMesh:
    """Hull of random points: irregular, Delaunay."""
    return shapes.random_sphere(10 * 4 ** (level + 2) + 2, seed=level)


def stretched(level: int) -> TriangleMesh:
    """The irregular sphere pulled along z by four and pushed back: anisotropic triangles, not Delaunay."""
    return shapes.mesh_on_sphere(_scaled(irregular(level), (1.0, 1.0, 4.0)))


def noisy(level: int) -> TriangleMesh:
    """Geodesic sphere whose vertices are moved along it by up to a third of an edge."""
    mesh = good(level)
    move = np.random.default_rng(level).uniform(-1, 1, mesh.points.shape) * mesh.side_length.mean() / 3
    return shapes.mesh_on_sphere(mesh.moved(mesh.points + move))


def _scaled(mesh: TriangleMesh, axes: tuple[float, float, float]) -> TriangleMesh:
    return mesh.moved(mesh.points * np.array(axes))


SPHERES: dict[str, Ladder] = {
    "good": good,
    "irregular": irregular,
    "stretched": stretched,
    "noisy": noisy,
}


def ellipsoids() -> dict[str, Ladder]:
    """The same families on the ellipsoid 1, 1.5, 2."""
    return {name: lambda level, m=make: _scaled(m(level), (1.0, 1.5, 2.0)) for name, make in SPHERES.items()}


def tori() -> dict[str, Ladder]:
    """Torus R = 1, r = 0.4: a regular grid, and needles of aspect ten."""
    return {
        "good": lambda level: shapes.torus(20 * 2**level, 8 * 2**level, pattern="alternating"),
        "stretched": lambda level: shapes.torus(60 * 2**level, 4 * 2**level, pattern="alternating"),
    }


# command -> (truth, ladders); the first is shown in the picture
STUDIES: dict[str, list[tuple[str, dict[str, Ladder]]]] = {
    "curvature": [("ellipsoid:1,1.5,2", ellipsoids()), ("sphere:1", SPHERES), ("torus:1,0.4", tori())],
    "geodesic": [("sphere:1", SPHERES)],
    "laplacian": [("sphere:1", SPHERES)],
    "delaunay": [("sphere:1", SPHERES)],
}
