"""Whether triangles of meshes intersect, by orientation determinants: independent of the contact library."""

import numpy as np


def intersecting(points, faces, other_points, other_faces):
    """First (edge ends, face) of one mesh's edges through another's faces, or None.

    Edges that share a vertex with a face are left out; the two meshes may be one and the same arrays.
    """
    same = points is other_points
    edges = np.unique(
        np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0
    )
    corners = other_points[other_faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    rounding = 1e-15 * max(np.abs(points).max(), np.abs(other_points).max()) ** 3  # coplanar edges
    for start in range(0, len(edges), 256):
        block = edges[start : start + 256]
        p, q = points[block[:, 0]], points[block[:, 1]]
        near = (np.minimum(p, q)[:, None] <= high).all(axis=2) & (np.maximum(p, q)[:, None] >= low).all(
            axis=2
        )
        if same:
            near &= ~(block[:, None, :, None] == other_faces[None, :, None, :]).any(axis=(2, 3))
        e, f = np.nonzero(near)
        a, b, c = (corners[f, k] for k in range(3))
        above, below = _volume(a, b, c, p[e]), _volume(a, b, c, q[e])
        sides = [_volume(p[e], q[e], u, v) for u, v in ((a, b), (b, c), (c, a))]
        through = (
            (above * below < 0)
            & (np.minimum(np.abs(above), np.abs(below)) > rounding)
            & (
                ((sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0))
                | ((sides[0] < 0) & (sides[1] < 0) & (sides[2] < 0))
            )
        )
        if through.any():
            k = int(np.flatnonzero(through)[0])
            return tuple(int(v) for v in block[e[k]]), int(f[k])
    return None


def meshes_intersect(points, faces, other_points, other_faces):
    """Whether two surfaces (or one with itself) intersect."""
    first = intersecting(points, faces, other_points, other_faces)
    return first is not None or intersecting(other_points, other_faces, points, faces) is not None


def _volume(a, b, c, d):
    return np.einsum("ni,ni->n", np.cross(b - a, c - a), d - a)
