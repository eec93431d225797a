"""Faces of a surface that pass through each other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mesh.vectors import cross, dot

FACES_PER_LEAF = 4  # of the tree of boxes
MAX_PAIRS = 1 << 14  # pairs of boxes handled at once
PAIRS_PER_FACE = 1000.0  # limit; 0.2 milliseconds per face; scans and CAD parts need 20 to 50
RUN_PAIRS_PER_FACE = 200.0  # limit for checks within a run, which would otherwise cost more than the run
LEAST_FACES = 5000  # meshes of fewer faces have the limit of this many faces
# Shewchuk's bound of the rounding of a determinant of three differences, over that of their absolute values
ORIENTATION_ERROR = (7.0 + 56.0 * 2.0**-53) * 2.0**-53


def intersecting_faces(
    points: NDArray, faces: NDArray, *, pairs_per_face: float = PAIRS_PER_FACE, depth: float = 0.0
) -> NDArray[np.int64]:
    """Pairs of triangles that cross in a segment, beyond rounding.

    Triangles that only touch, lie in one plane, or share an edge do not cross; those that share a vertex do
    where they meet elsewhere too.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    faces : (m, 3) ndarray of int64
    pairs_per_face : float
        Pairs of boxes that are compared at most, over the faces.
    depth : float
        Length that corners on both sides of the other triangle's plane must be away from it.

    Returns
    -------
    (k, 2) ndarray of int64
        Ascending; each pair once, the lower index first.

    Raises
    ------
    SolveError
        If more boxes overlap, as for needles oblique to the axes and fans of many faces.

    Notes
    -----
    Boxes in a balanced tree of median splits, then the test of Devillers and Guigue (2002) with the filter
    of Shewchuk (1997): a determinant within its rounding counts as 0.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.5, 1], [3, 3, 0]], float)
    >>> intersecting_faces(points, np.array([[0, 1, 2], [3, 4, 5]])).tolist()
    [[0, 1]]
    """
    if len(faces) < 2:
        return np.empty((0, 2), np.int64)
    index = np.ascontiguousarray(faces.T)
    unit = 2.0 ** np.frexp(np.abs(points).max())[1]  # a division by it is exact, and no product overflows
    columns = np.ascontiguousarray((points / unit).T)
    corners = columns[:, index].transpose(1, 0, 2)  # (corner, coordinate, face)
    first, second, third = corners
    across, up = second - first, third - first
    normals = cross(across, up)
    planes = np.stack([normals, _absolute_cross(across, up)])
    least = depth / unit * np.sqrt(dot(normals, normals)) if depth else np.zeros(len(faces))
    blocks = []
    n_compared, most = 0, pairs_per_face * max(len(faces), LEAST_FACES)
    low, high = corners.min(axis=0), corners.max(axis=0)
    for i, j in _paired_boxes(low, high):
        n_compared += len(i)
        if n_compared > most:
            raise SolveError(
                f"more than {most:.3g} pairs of faces lie near each other: their crossings are not counted"
            )
        meet = _meet(low, high, i, j)
        i, j = i[meet], j[meet]
        apart = _common_corners(index, i, j) < 2
        i, j = i[apart], j[apart]
        sides_of_j = _sides(corners, planes, least, i, j)
        cut = (sides_of_j.max(axis=0) > 0) & (sides_of_j.min(axis=0) < 0)
        i, j, sides_of_j = i[cut], j[cut], sides_of_j[:, cut]
        sides_of_i = _sides(corners, planes, least, j, i)
        cut = (sides_of_i.max(axis=0) > 0) & (sides_of_i.min(axis=0) < 0)
        i, j = i[cut], j[cut]
        crossed = _intervals_overlap(corners[..., i], corners[..., j], sides_of_i[:, cut], sides_of_j[:, cut])
        blocks.append(np.column_stack([i[crossed], j[crossed]]))
    pairs = np.sort(np.concatenate(blocks), axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def bounded_intersections(points: NDArray, faces: NDArray, *, depth: float = 0.0) -> NDArray[np.int64] | None:
    """Pairs of triangles that cross, for a check within a run; None if it would cost more than the run.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    faces : (m, 3) ndarray of int64
    depth : float
        As for `intersecting_faces`.

    Returns
    -------
    (k, 2) ndarray of int64, or None
        As `intersecting_faces`; None where too many faces lie side by side.
    """
    try:
        return intersecting_faces(points, faces, pairs_per_face=RUN_PAIRS_PER_FACE, depth=depth)
    except SolveError:
        return None


def _common_corners(index: NDArray, i: NDArray, j: NDArray) -> NDArray[np.int8]:
    common = np.zeros(len(i), np.int8)
    others = [corner[j] for corner in index]
    for corner in index:
        own = corner[i]
        for other in others:
            common += own == other
    return common


def _absolute_cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Cross product of the absolute values with sums instead of differences, for the rounding bound."""
    a, b = np.abs(a), np.abs(b)
    return np.stack([a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2], a[0] * b[1] + a[1] * b[0]])


def _sign(determinant: NDArray, permanent: NDArray, least: NDArray | float = 0.0) -> NDArray[np.float64]:
    """Sign of a determinant; 0 where it is within its rounding, or at most `least`."""
    sign: NDArray[np.float64] = np.sign(determinant)
    sign[np.abs(determinant) <= np.maximum(ORIENTATION_ERROR * permanent, least)] = 0.0
    return sign


def _sides(
    corners: NDArray, planes: NDArray, least: NDArray, plane: NDArray, face: NDArray
) -> NDArray[np.float64]:
    """Sides of the planes of some faces on which the corners of others lie: (3, k) of 1, 0, -1."""
    (normal, absolute), origin = planes[..., plane], corners[0][:, plane]
    offset = corners[..., face].transpose(1, 0, 2) - origin[:, None]
    return _sign(dot(normal[:, None], offset), dot(absolute[:, None], np.abs(offset)), least[plane])


def _intervals_overlap(
    first: NDArray, second: NDArray, sides_of_first: NDArray, sides_of_second: NDArray
) -> NDArray[np.bool_]:
    """Whether triangles that cut each other's planes have a segment of the line of both planes in common.

    The sides are those of the corners of each triangle, of the plane of the other.
    """
    (p, q, r), p_side = _lone_corner_first(first, sides_of_first)
    (s, t, u), s_side = _lone_corner_first(second, sides_of_second)
    q, r = np.where(s_side > 0, q, r), np.where(s_side > 0, r, q)
    t, u = np.where(p_side > 0, t, u), np.where(p_side > 0, u, t)
    return (_orientation(q, s, p, t) < 0) & (_orientation(p, s, r, u) < 0)


def _lone_corner_first(triangle: NDArray, sides: NDArray) -> tuple[list[NDArray], NDArray]:
    """Corners in order, first the one that is alone on its side of the plane; and its side."""
    side = np.where((sides > 0).sum(axis=0) == 1, 1.0, -1.0)
    lone, k = (sides == side).argmax(axis=0), np.arange(sides.shape[1])
    return [triangle[(lone + step) % 3, :, k].T for step in range(3)], side


def _orientation(a: NDArray, b: NDArray, c: NDArray, d: NDArray) -> NDArray[np.float64]:
    """Sign of (d - a) . (b - a) x (c - a)."""
    b, c, d = b - a, c - a, d - a
    return _sign(dot(cross(b, c), d), dot(_absolute_cross(b, c), np.abs(d)))


def _paired_boxes(low: NDArray, high: NDArray) -> Iterator[tuple[NDArray, NDArray]]:
    """Pairs of boxes in leaves that meet, in blocks; `low` and `high` are their corners, (3, m)."""
    n = low.shape[1]
    depth = max(0, int(np.ceil(np.log2(n / FACES_PER_LEAF))))
    size = -(-n >> depth)  # of a leaf, rounded up
    order = _median_order(low + high, depth, size)
    # places that are left over hold an empty box
    places = np.ascontiguousarray(order.reshape(-1, size).T)
    lows = [np.column_stack([low, np.full(3, np.inf)])[:, places].min(axis=1)]
    highs = [np.column_stack([high, np.full(3, -np.inf)])[:, places].max(axis=1)]
    for _ in range(depth):
        lows.append(np.minimum(lows[-1][:, ::2], lows[-1][:, 1::2]))
        highs.append(np.maximum(highs[-1][:, ::2], highs[-1][:, 1::2]))
    members = order.reshape(-1, size)
    for a, b in _leaf_pairs(lows, highs, depth, np.zeros(1, np.int64), np.zeros(1, np.int64)):
        shape = (len(a), size, size)
        i = np.broadcast_to(members[a][:, :, None], shape).ravel()
        j = np.broadcast_to(members[b][:, None, :], shape).ravel()
        once = ((a != b)[:, None, None] | ~np.tri(size, dtype=bool)).ravel() & (i < n) & (j < n)
        yield i[once], j[once]


def _median_order(centre: NDArray, depth: int, size: int) -> NDArray[np.int64]:
    """Boxes in the order of the leaves; the number of boxes at places that are left over."""
    n = centre.shape[1]
    order = np.minimum(np.arange(size << depth), n)
    centre = np.column_stack([centre, centre[:, -1]])
    for level in range(depth):
        groups = order.reshape(1 << level, -1)
        at = centre[:, groups]
        axis = (at.max(axis=2) - at.min(axis=2)).argmax(axis=0)
        key = at[axis, np.arange(1 << level)]
        middle = groups.shape[1] // 2
        order = np.take_along_axis(groups, np.argpartition(key, middle, axis=1), axis=1).ravel()
    return order


def _leaf_pairs(
    lows: list[NDArray], highs: list[NDArray], level: int, a: NDArray, b: NDArray
) -> Iterator[tuple[NDArray, NDArray]]:
    """Pairs of leaves whose boxes meet, under these pairs of nodes of a level (leaves are level 0)."""
    if len(a) > MAX_PAIRS:
        for block in np.array_split(np.arange(len(a)), -(-len(a) // MAX_PAIRS)):
            yield from _leaf_pairs(lows, highs, level, a[block], b[block])
        return
    if level == 0:
        yield a, b
        return
    a = (2 * a[:, None] + np.array([0, 0, 1, 1])).ravel()
    b = (2 * b[:, None] + np.array([0, 1, 0, 1])).ravel()
    meet = (a <= b) & _meet(lows[level - 1], highs[level - 1], a, b)
    yield from _leaf_pairs(lows, highs, level - 1, a[meet], b[meet])


def _meet(low: NDArray, high: NDArray, a: NDArray, b: NDArray) -> NDArray[np.bool_]:
    meet = np.ones(len(a), dtype=bool)
    for least, greatest in zip(low, high, strict=True):
        meet &= (least[a] <= greatest[b]) & (least[b] <= greatest[a])
    return meet
