"""Surfaces that intrinsic triangulations are tested on, and the rounding that their lengths bear."""

import numpy as np

from ddgcli.geometry.intrinsic import triangle_excess
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def stretched(n=600):
    mesh = shapes.random_sphere(n, seed=1)
    return mesh.moved(mesh.points * np.array([10.0, 1.0, 0.1]))


def needles():
    mesh = shapes.grid(12, 12)
    x, y, z = mesh.points.T
    return mesh.moved(np.stack([x + 0.37 * y, 1e-6 * y, z], axis=1))


def fan(valence=5000):
    """A cone over a wavy circle: one vertex of high valence."""
    angle = 2 * np.pi * np.arange(valence) / valence
    rim = np.stack([np.cos(angle), np.sin(angle), 0.2 * np.cos(7 * angle)], axis=1)
    k = np.arange(valence)
    faces = np.stack([k, (k + 1) % valence, np.full(valence, valence)], axis=1)
    return TriangleMesh.from_arrays(np.concatenate([rim, [[0.3, 0.1, 1.0]]]), faces)


def sheared_cylinder():
    mesh = shapes.cylinder(40, 10)
    x, y, z = mesh.points.T
    turn = 3.0 * z
    return mesh.moved(
        np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], 1)
    )


def planar(seed=0, n=300):
    """A poor triangulation of random points in a square: Delaunay of a squeezed copy."""
    from scipy.spatial import Delaunay

    points = np.random.default_rng(seed).random((n, 2))
    faces = Delaunay(points * np.array([1.0, 30.0])).simplices.astype(np.int64)
    p = points[faces]
    e, f = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    clockwise = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0] < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    return TriangleMesh.from_arrays(points, faces)


def pinched():
    """Two stretched spheres and a needle-shaped fan with a boundary that meet in one vertex."""
    body, grid = stretched(120), shapes.grid(4, 4)
    flat = grid.points * np.array([1.0, 0.05, 1.0])
    submeshes = [
        (body.points - body.points[0], body.faces),
        (body.points[0] - body.points, body.faces[:, ::-1]),
        (flat - flat[0], grid.faces),
    ]
    start = np.cumsum([0] + [len(points) - 1 for points, _ in submeshes])
    faces = np.concatenate([np.where(f == 0, 0, f + s) for (_, f), s in zip(submeshes, start)])
    return TriangleMesh.from_arrays(np.concatenate([np.zeros((1, 3)), *(p[1:] for p, _ in submeshes)]), faces)


def sharp_cone(rim=8, degrees=20):
    """A cone with one point of its rim near the apex: its Delaunay triangulation has a loop there."""
    r = np.where(np.arange(rim) == 0, 1.0, 3.0)
    turn, slope = 2 * np.pi * np.arange(rim) / rim, degrees / 360
    points = np.stack(
        [slope * r * np.cos(turn), slope * r * np.sin(turn), -r * np.sqrt(1 - slope**2)], axis=1
    )
    k = np.arange(rim)
    faces = np.stack([k, (k + 1) % rim, np.full(rim, rim)], axis=1)
    return TriangleMesh.from_arrays(np.concatenate([points, np.zeros((1, 3))]), faces)


def non_delaunay_sphere():
    """A sphere with a collinear cap and a zero-length edge."""
    mesh = shapes.icosphere(2)
    points = mesh.points.copy()
    a, b, c = mesh.faces[0]
    points[a] = 0.5 * (points[b] + points[c])
    d, e = mesh.faces[100, :2]
    points[d] = points[e]
    return mesh.moved(points)


CASES = {
    "stretched": stretched,
    "needles": needles,
    "fan": fan,
    "sheared cylinder": sheared_cylinder,
    "planar": planar,
    "tiny": lambda: (lambda m: m.moved(1e-8 * m.points))(stretched()),
    "huge": lambda: (lambda m: m.moved(1e8 * m.points))(stretched()),
    "far": lambda: (lambda m: m.moved(m.points + 1e6))(stretched()),
}


def rounding(mesh):
    """Relative change of a triangle's shape by one rounding of its lengths: the floor of intrinsic methods.

    A cap of aspect 1e6 has an excess of 1e-12 of its length, so float64 holds four digits of its height.
    """
    length = mesh.side_length
    excess = triangle_excess(length).min(axis=1)
    return 2.0**-53 * (length.max(axis=1) / excess).max()
