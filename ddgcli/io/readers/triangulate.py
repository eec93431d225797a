"""Polygons into triangles, without new vertices: fans where convex, ears where not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.mesh.vectors import row_cross

MAX_TESTED_CORNERS = 3e7  # in all ears of a file: some seconds
MAX_CONCAVE_CORNERS = 20_000  # of one polygon

TOO_MANY_CORNERS = "polygons of very many corners that are not convex; write the file with triangles"


@dataclass
class _Budget:
    """Corners that may still be tested against ears."""

    remaining: float

    def spend(self, count: int) -> None:
        self.remaining -= count
        if self.remaining < 0:
            raise MeshFileError(TOO_MANY_CORNERS)


def triangulated(points: NDArray, corners: NDArray, sizes: NDArray) -> tuple[NDArray, NDArray]:
    """Triangles of polygons, in the polygons' order.

    Parameters
    ----------
    points : (n, 3) ndarray
    corners : (c,) ndarray of int64
        Vertices of the polygons, one polygon after the other, in range.
    sizes : (p,) ndarray of int64

    Returns
    -------
    faces : (m, 3) ndarray of int64
        Oriented as their polygons; a polygon of k corners gives k - 2 triangles (none for k < 3).
    polygon : (m,) ndarray of int64
        Polygon that each triangle is part of.

    Raises
    ------
    MeshFileError
        Polygons whose ears take too long: the time of ear clipping grows with the square of the corners.
    """
    budget = _Budget(MAX_TESTED_CORNERS)
    start = np.cumsum(sizes) - sizes
    triangle_lists, owners = [], []
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        loops = corners[start[which, None] + np.arange(size)]
        triangle_lists.append(_cut(points, loops, budget).reshape(-1, 3))
        owners.append(np.repeat(which, size - 2))
    if not triangle_lists:
        return np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    faces, polygon = np.concatenate(triangle_lists), np.concatenate(owners)
    order = np.argsort(polygon, kind="stable")
    return faces[order], polygon[order]


def _cut(points: NDArray, loops: NDArray, budget: _Budget) -> NDArray:
    """(p, k) loops of equal size -> (p, k-2, 3) triangles."""
    size = loops.shape[1]
    if size == 3:
        return loops[:, None, :]
    fan = np.stack([np.zeros(size - 2, dtype=np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    triangles = loops[:, fan]
    reflex = _reflex(points, loops)
    if size == 4:  # a reflex corner must lie on the diagonal
        other = reflex[:, 1] | reflex[:, 3]
        triangles[other] = loops[other][:, [[0, 1, 3], [1, 2, 3]]]
        return triangles
    concave = np.flatnonzero(reflex.any(axis=1))
    if len(concave) and size > MAX_CONCAVE_CORNERS:
        raise MeshFileError(TOO_MANY_CORNERS)
    for row in concave:
        triangles[row] = loops[row][_ears(_flattened(points[loops[row]]), budget)]
    return triangles


def _normals(loop_points: NDArray) -> NDArray:
    """(p, 3) Newell normals of (p, k, 3) loops, length twice the area."""
    ahead = np.roll(loop_points, -1, axis=1)
    middle = loop_points.mean(axis=1, keepdims=True)
    return row_cross(loop_points - middle, ahead - middle).sum(axis=1)


def _reflex(points: NDArray, loops: NDArray) -> NDArray:
    """(p, k) True at corners that turn against the polygon's own orientation."""
    with np.errstate(all="ignore"):
        p = points[loops]
        turn = row_cross(p - np.roll(p, 1, axis=1), np.roll(p, -1, axis=1) - p)
        return np.einsum("pki,pi->pk", turn, _normals(p)) < 0


def _flattened(loop: NDArray) -> NDArray:
    """(k, 2) positions in the polygon's mean plane, counter-clockwise, scaled to size one."""
    with np.errstate(all="ignore"):
        loop = loop - loop.mean(axis=0)
        loop = loop / (np.abs(loop).max() or 1.0)
        normal = _normals(loop[None])[0]
    drop = int(np.argmax(np.abs(normal)))
    u, v = (drop + 1) % 3, (drop + 2) % 3
    return loop[:, [u, v]] if normal[drop] >= 0 else loop[:, [v, u]]


def _ears(p: NDArray, budget: _Budget) -> NDArray:
    """(k-2, 3) corners of the triangles of a simple counter-clockwise polygon; ear clipping.

    A cut changes the tests of its two neighbours alone. Where no ear is left (the polygon crosses or touches
    itself), some corner is cut, so that the result always has k - 2 triangles over all corners, after at most
    3 k tests.
    """
    before, after = np.roll(np.arange(len(p)), 1), np.roll(np.arange(len(p)), -1)
    remaining = np.ones(len(p), dtype=bool)
    blocks = _turn(p[before], p, p[after]) <= 0  # a convex corner is never alone in an ear, and stays convex
    order = np.flatnonzero(blocks)
    order = order[np.argsort(p[order, 0], kind="stable")]
    place = p[order, 0]
    triangles, waiting, n_corners, next_forced = [], list(range(len(p)))[::-1], len(p), 0
    while n_corners > 3:
        if waiting:
            here = waiting.pop()
            a, c = before[here], after[here]
            if not remaining[here] or _turn(p[a], p[here], p[c]) <= 0:
                continue
            low, high = np.sort(p[[a, here, c], 0])[[0, 2]]
            near = order[np.searchsorted(place, low) : np.searchsorted(place, high, "right")]
            budget.spend(len(near))
            if not _is_ear(p, a, here, c, near[blocks[near]]):
                continue
        else:
            while not remaining[next_forced]:
                next_forced += 1
            here = next_forced
            a, c = before[here], after[here]
        triangles.append((a, here, c))
        remaining[here] = blocks[here] = False
        n_corners -= 1
        after[a], before[c] = c, a
        for corner in (a, c):
            blocks[corner] &= _turn(p[before[corner]], p[corner], p[after[corner]]) <= 0
        waiting += [c, a]
    a = int(np.flatnonzero(remaining)[0])
    triangles.append((a, after[a], after[after[a]]))
    return np.array(triangles, dtype=np.int64)


def _turn(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Twice the signed area of triangles abc."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )


def _is_ear(p: NDArray, a: int, b: int, c: int, blocking: NDArray) -> bool:
    """Whether no blocking corner lies in the triangle abc."""
    q = p[blocking[(blocking != a) & (blocking != b) & (blocking != c)]]
    inside = (_turn(p[a], p[b], q) >= 0) & (_turn(p[b], p[c], q) >= 0) & (_turn(p[c], p[a], q) >= 0)
    # a corner at the same place as one of the ear's own does not block it
    same = (q == p[a]).all(axis=1) | (q == p[b]).all(axis=1) | (q == p[c]).all(axis=1)
    return not bool((inside & ~same).any())
