"""Flat meshes of a rectangle of parameters: regular grids and irregular triangles, also graded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from ddgcli.mesh.shapes import grid
from ddgcli.mesh.triangle_mesh import TriangleMesh

Spacing = Callable[[NDArray], NDArray]


def flat_mesh(
    size: tuple[float, float], faces: int, pattern: str, spacing: Spacing = np.ones_like
) -> TriangleMesh:
    """A mesh of the rectangle [0, a] x [0, b] with about `faces` triangles.

    `pattern` is that of a grid ('alternating', 'right'); 'tapered': rows of triangles, each one cell shorter
    than that below, so that all inner vertices have six neighbours (`spacing` grows upwards); or 'irregular':
    random points with their Delaunay triangles. `spacing` is the distance of neighbours as a function of the
    second parameter, up to a factor.
    """
    a, b = size
    fine = np.linspace(0, b, 2001)
    density = spacing(fine).min() / spacing(fine)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) * (fine[1] - fine[0])

    def graded(share: NDArray) -> NDArray[np.float64]:
        return np.interp(share, sums / sums[-1], fine)

    if pattern == "tapered":
        most = round(np.sqrt(faces / (1 - density[-1] ** 2)))
        return tapered_triangles(a, most, most - round(most * density[-1]), graded)
    # every row of a grid has as many cells: they are squares where neighbours are nearest
    unit = np.sqrt(2 * a * sums[-1] / faces)
    nx, ny = even(a / unit), even(sums[-1] / unit)
    if pattern != "irregular":
        flat = grid(nx, ny, a, 1, pattern)
        q = np.asarray(flat.points)
        return flat.moved(np.column_stack([q[:, 0], graded(q[:, 1]), q[:, 2]]))
    if spacing is np.ones_like:
        return irregular_rectangle(a, b, nx, ny)
    unit = np.sqrt(2 * a * np.trapezoid(density**2, fine) / faces)
    sides = even(a / unit * density[0]), even(a / unit * density[-1])

    def distance(y: float) -> float:
        return unit / float(np.interp(y, fine, density))

    return irregular_triangles(a, b, sides, even(sums[-1] / unit), faces, distance, graded)


def tapered_triangles(a: float, most: int, rows: int, graded: Callable[[NDArray], NDArray]) -> TriangleMesh:
    """Rows of triangles over [0, a], the lowest with `most` cells, each with one less than that below."""
    heights = graded(np.arange(rows + 1) / rows)
    counts = most - np.arange(rows + 1)
    points = np.concatenate(
        [
            np.column_stack([np.linspace(0, a, n + 1), np.full(n + 1, y)])
            for n, y in zip(counts, heights, strict=True)
        ]
    )
    first = np.concatenate([[0], np.cumsum(counts + 1)])
    faces = []
    for row, n in enumerate(counts[:-1]):
        low, high = first[row] + np.arange(n), first[row + 1] + np.arange(n)
        faces.append(np.column_stack([low, low + 1, high]))
        faces.append(np.column_stack([low + 1, high + 1, high])[:-1])
    return TriangleMesh.from_arrays(np.column_stack([points, np.zeros(len(points))]), np.concatenate(faces))


def even(count: float) -> int:
    """Nearest even number of cells: the middle of the side is a vertex."""
    return max(2, 2 * round(count / 2))


def irregular_rectangle(a: float, b: float, nx: int, ny: int, seed: int = 1) -> TriangleMesh:
    """Delaunay triangles of boundary points at random distances and inner points at random places."""
    spacing = np.sqrt(a * b / (nx * ny))
    return irregular_triangles(a, b, (nx, nx), ny, 2 * nx * ny, lambda y: spacing, lambda s: b * s, seed)


def irregular_triangles(
    a: float, b: float, nx: tuple[int, int], ny: int, faces: int, distance: Callable[[float], float],
    graded: Callable[[NDArray], NDArray], seed: int = 1,
) -> TriangleMesh:  # fmt: skip
    """Irregular triangles of a rectangle with neighbours at a distance that depends on the height.

    `nx` counts the edges of the lower and the upper side, `ny` those of the left and the right one, at the
    heights `graded` of their shares; inner points are no closer than 0.72 of the distance.
    """
    rng = np.random.default_rng(seed)

    def side(count: int) -> NDArray:
        # an even count keeps the middle of the side
        inner = (np.arange(1, count) + 0.5 * (rng.random(count - 1) - 0.5)) / count
        inner[count // 2 - 1] = 0.5
        return inner

    low, high, left, right = side(nx[0]), side(nx[1]), graded(side(ny)), graded(side(ny))
    border = np.concatenate(
        [
            [[0, 0], [a, 0], [a, b], [0, b]],
            np.column_stack([a * low, 0 * low]), np.column_stack([a * high, 0 * high + b]),
            np.column_stack([0 * left, left]), np.column_stack([0 * right + a, right]),
        ]
    )  # fmt: skip
    inner = dart_points(rng, a, b, distance, (faces - len(border) + 2) // 2)
    points = np.concatenate([border, inner])
    triangles = Delaunay(points).simplices
    corner = points[triangles]
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    triangles = np.where((area < 0)[:, None], triangles[:, ::-1], triangles)[np.abs(area) > 1e-9 * a * b]
    return TriangleMesh.from_arrays(np.column_stack([points, np.zeros(len(points))]), triangles)


def dart_points(
    rng: np.random.Generator, a: float, b: float, distance: Callable[[float], float], count: int
) -> NDArray[np.float64]:
    """At most `count` random points of a rectangle, 0.72 of a distance apart and 0.45 from its sides."""
    points = np.zeros((0, 2))
    low, high = 0.45 * distance(0.0), 0.45 * distance(b)
    for _ in range(40 * count):
        share = rng.random(2)
        y = low + share[1] * (b - low - high)
        here = distance(y)
        p = np.array([0.45 * here + share[0] * (a - 0.9 * here), y])
        if not len(points) or np.sum((points - p) ** 2, axis=1).min() > (0.72 * here) ** 2:
            points = np.concatenate([points, [p]])
            if len(points) == count:
                break
    return points
