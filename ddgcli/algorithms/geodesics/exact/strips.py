"""Propagate strips of parallel lines from source edges across a surface, in batches.

The points nearest to an inner point of an edge lie on the line perpendicular to the edge there. Unfolded,
these lines stay parallel: a strip on side h is the interval [b0, b1] of the side, the unit direction (ux,
uy), uy > 0, of its lines in the frame of the side, and the distance c of the side's first corner, if it
lay in the strip. The distance at x is c + ux x. Strips split at vertices as windows do, and the same
filter drops them.

What lies beside the strips is reached from the ends of the edges and from vertices around which paths
bend: by windows. A strip and a window never meet except through the distances of vertices, so that strips can
propagate after the windows of the ends, and before the windows of the vertices that the strips have reached.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.dominance import DOMINANCE_TOLERANCE
from ddgcli.algorithms.geodesics.exact.pool import WindowPool
from ddgcli.algorithms.geodesics.exact.tables import BOUNDARY, WindowTables
from ddgcli.algorithms.geodesics.exact.wavefront import Wavefront
from ddgcli.errors import SolveError
from ddgcli.mesh.remedies import remedy

MIN_DIRECTION_HEIGHT = 1e-15  # uy of a strip that rounding made parallel to its side


def propagate_strips(
    wavefront: Wavefront,
    side: NDArray,
    source: NDArray,
    *,
    max_crossings: int,
    limit: float = np.inf,
    most_windows: float = np.inf,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Lower the distances of a wavefront by the strips of source edges.

    Parameters
    ----------
    wavefront : Wavefront
        Its vertices next to `side` are sources at distance 0.
    side : (k,) ndarray of int64
        Sides on the source edges, in every face of each edge.
    source : (k,) ndarray of int64
        Index of the source of each.
    max_crossings : int
        Strips that have crossed more faces are dropped: on triangles without width the filter keeps some
        without end.
    limit : float
        Strips farther than this are not propagated.
    most_windows : float
        Number of windows and strips after which SolveError is raised.
    progress : callable, optional
        Called with the number of final vertices and of all vertices.
    """
    tables = wavefront.tables
    length = tables.shape[side, 0]
    valid = (length > 0) & np.isfinite(tables.shape[side, 2])
    side, source, length = side[valid], source[valid], length[valid]
    numbers, of = np.unique(source, return_inverse=True)
    none = np.full(len(numbers), -1)
    origin = wavefront.origins.add(none, numbers, np.zeros(len(numbers)))[of]
    pool = WindowPool(5, ints=3)
    zero = np.zeros(len(side))
    pool.push(
        np.stack([zero, length, zero, zero + 1.0, zero]), np.stack([side, origin, np.zeros_like(side)]), zero
    )
    while len(pool):
        least = pool.least()
        if not least < limit:
            return
        lines, where = pool.pop_below(max(least + wavefront.bucket, np.nextafter(least, np.inf)))
        wavefront.windows += where.shape[1]
        if wavefront.windows > most_windows:
            raise SolveError(
                f"exact distance stopped after {wavefront.windows} windows; the triangles are too "
                f"degenerate: use `method=fast-marching`, or {remedy('no area')}"
            )
        if wavefront.targets is not None:
            wavefront.targets.update_by_strips(lines, where)
        if progress is not None:
            progress(float(np.count_nonzero(wavefront.distance < least)), float(len(wavefront.distance)))
        _propagate(wavefront, pool, lines, where, max_crossings)


def _propagate(
    wavefront: Wavefront, pool: WindowPool, lines: NDArray, where: NDArray, max_crossings: int
) -> None:
    """Propagate strips across their faces: update the apex, then push the children that the filter keeps."""
    tables = wavefront.tables
    side, origin, crossings = where
    origin_and_crossings = np.stack([origin, crossings + 1])
    inside = crossings < max_crossings
    b0, b1, ux, uy, c = lines
    shape, ids = tables.shape.take(side, axis=0).T, tables.ids.take(side, axis=0).T
    length, ax, ay, left_edge, right_edge = shape
    at = ax - ay * ux / uy  # where the line to the apex crosses the side
    reached = ((at >= b0 - DOMINANCE_TOLERANCE) & (at <= b1 + DOMINANCE_TOLERANCE)).nonzero()[0]
    at_apex = c + ux * ax + uy * ay
    wavefront.improve(
        ids[2][reached], at_apex[reached], origin[reached], side[reached], np.clip(at, 0.0, length)[reached]
    )
    near, far, apex = wavefront.distance.take(ids[:3])

    left = (at > b0).nonzero()[0]
    x0, x1, cut = b0[left], np.minimum(b1, at)[left], at[left]
    edge, along, up = left_edge[left], ax[left] / left_edge[left], ay[left] / left_edge[left]
    t0, t1 = edge * (x0 / cut), np.minimum(edge * (x1 / cut), edge)
    child = [t0, t1, ux[left] * along + uy[left] * up, uy[left] * along - ux[left] * up, c[left]]
    r0, r1 = child[4] + child[2] * t0, child[4] + child[2] * t1
    detour = np.hypot(length[left] - t0 * along, t0 * up)
    keep = inside[left] & _keep(t0, t1, r0, r1, edge, near[left], apex[left], far[left] + detour)
    left_by = 3 * (side[left] // 3) + (side[left] + 2) % 3
    _push(
        tables, pool, np.stack(child), left_by, left, ids[3], origin_and_crossings, np.minimum(r0, r1), keep
    )

    right = (at < b1).nonzero()[0]
    x0, x1, rest = np.maximum(b0, at)[right], b1[right], length[right] - at[right]
    edge = right_edge[right]
    along, up = (length[right] - ax[right]) / edge, ay[right] / edge
    s0, s1 = edge * ((length[right] - x1) / rest), np.minimum(edge * ((length[right] - x0) / rest), edge)
    child = [edge - s1, edge - s0, ux[right] * along - uy[right] * up, uy[right] * along + ux[right] * up,
             at_apex[right]]  # fmt: skip
    r0, r1 = child[4] + child[2] * child[0], child[4] + child[2] * child[1]
    detour = np.hypot(length[right] - s0 * along, s0 * up)
    # seen from the other end of the side: s is measured from v1
    keep = inside[right] & _keep(s0, s1, r1, r0, edge, far[right], apex[right], near[right] + detour)
    left_by = 3 * (side[right] // 3) + (side[right] + 1) % 3
    _push(
        tables, pool, np.stack(child), left_by, right, ids[4], origin_and_crossings, np.minimum(r0, r1), keep
    )


def _keep(
    s0: NDArray, s1: NDArray, r0: NDArray, r1: NDArray, edge: NDArray,
    near: NDArray, apex: NDArray, around: NDArray,
) -> NDArray[np.bool_]:  # fmt: skip
    """Strips of positive width that no path by a vertex of the face replaces (the filter of `children`)."""
    return (
        (s1 - s0 > DOMINANCE_TOLERANCE)
        & (r1 <= near + s1 + DOMINANCE_TOLERANCE)
        & (r0 <= apex + (edge - s0) + DOMINANCE_TOLERANCE)
        & (r0 <= around + DOMINANCE_TOLERANCE)
    )


def _push(
    tables: WindowTables, pool: WindowPool, child: NDArray, left_by: NDArray, parent: NDArray,
    code: NDArray, origin_and_crossings: NDArray, key: NDArray, keep: NDArray,
) -> None:  # fmt: skip
    """Push children into the neighbouring faces; `child` is in the frame that runs against side `left_by`.

    Rows of `origin_and_crossings`: the source of each window, and the number of faces it crossed.
    """
    code, origin_and_crossings = code[parent], origin_and_crossings[:, parent]
    rows = (keep & (code != BOUNDARY)).nonzero()[0]
    child, code, origin_and_crossings, key = (
        child[:, rows],
        code[rows],
        origin_and_crossings[:, rows],
        key[rows],
    )
    left_by = left_by[rows]
    child[3] = np.maximum(child[3], MIN_DIRECTION_HEIGHT)
    flip = np.zeros(len(code), dtype=bool)
    if tables.mirrored is not None:
        flip = tables.mirrored[left_by]
    many = code < BOUNDARY
    if many.any():
        row, beyond, same_way = tables.across_many(left_by[many])
        source_rows = np.concatenate([np.flatnonzero(~many), np.flatnonzero(many)[row]])
        code, flip = np.concatenate([code[~many], beyond]), np.concatenate([flip[~many], same_way])
        child, origin_and_crossings, key = (
            child[:, source_rows],
            origin_and_crossings[:, source_rows],
            key[source_rows],
        )
    i = flip.nonzero()[0]
    if len(i):
        width = tables.shape[code[i], 0]
        b0, b1, ux, _, c = child[:, i]
        child[0, i], child[1, i], child[2, i], child[4, i] = width - b1, width - b0, -ux, c + width * ux
    pool.push(child, np.concatenate([code[None], origin_and_crossings]), key)
