"""Level lines of functions on vertices, as polylines on the surface."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SurfacePaths, path_lengths
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.topology import NEXT

log = logging.getLogger("ddgcli")


def isoline_curves(mesh: SurfaceMesh, values: NDArray, count: int) -> Curves:
    """Level lines at equidistant levels.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    values : (n,) ndarray of float64
    count : int
        Number of levels.

    Returns
    -------
    Curves
        With the array `level` on their points.
    """
    if len(values) and not np.isfinite(values).any():
        log.warning("no value is finite: there are no level lines; correct the array")
    paths, level = isolines(mesh, values, even_levels(values, count))
    entries = [
        {"kind": "isoline", "level": float(x), "length": float(length), "closed": bool(closed)}
        for x, length, closed in zip(level, path_lengths(mesh, paths), paths.closed)
    ]
    return Curves(paths, entries, arrays={"level": level[paths.of_point()]})


def even_levels(values: NDArray, count: int) -> NDArray[np.float64]:
    """Levels that divide the range of the finite values into count + 1 equal parts.

    Parameters
    ----------
    values : (n,) ndarray of float64
    count : int

    Returns
    -------
    (count,) ndarray of float64
        Ascending; none where all values are equal.
    """
    finite = values[np.isfinite(values)]
    low, high = finite.min(initial=np.inf), finite.max(initial=-np.inf)
    if not high > low:
        return np.zeros(0)
    return low + (high - low) * np.arange(1, count + 1) / (count + 1)


def isolines(mesh: SurfaceMesh, values: NDArray, levels: NDArray) -> tuple[SurfacePaths, NDArray[np.float64]]:
    """Level lines of the piecewise linear function, higher values on the left of each.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    values : (n,) ndarray
        Faces with a value that is not finite are ignored.
    levels : (k,) ndarray

    Returns
    -------
    paths : SurfacePaths
        Level by level. Lines end at the boundary, and at edges where more than two faces or faces of opposite
        orientation meet.
    level : (p,) ndarray of float64
        Level of each path.
    """
    level_paths, path_level = [], []
    for level in np.asarray(levels, dtype=np.float64):
        paths = _one_level(mesh, values, float(level))
        level_paths.append(paths)
        path_level += [float(level)] * len(paths)
    return SurfacePaths.concatenate(level_paths), np.array(path_level, dtype=np.float64)


def _one_level(mesh: SurfaceMesh, values: NDArray, level: float) -> SurfacePaths:
    corner = values[mesh.faces]
    above = corner >= level
    count = above.sum(axis=1)
    face = np.flatnonzero(np.isfinite(corner).all(axis=1) & (count > 0) & (count < 3))
    above = above[face]
    # enter by the side that descends through the level, leave by the one that ascends: higher values on the
    # left
    down = np.argmax(above & ~above[:, NEXT], axis=1)
    up = np.argmax(~above & above[:, NEXT], axis=1)
    edge = mesh.topology.side_edge
    order, start, closed = chain(edge[face, down], edge[face, up])
    enter, leave = down[order], up[order]
    piece = np.repeat(np.arange(len(closed)), np.diff(start))
    last = start[1:] - 1
    open_end = last[~closed]
    weights_in = _on_side(corner[face[order]], enter, level)
    weights_out = _on_side(corner[face[order[open_end]]], leave[open_end], level)
    slot = np.arange(len(order)) + np.concatenate([[0], np.cumsum(~closed)])[:-1][piece]
    size = len(order) + len(open_end)
    out_face, out_weights = np.empty(size, dtype=np.int64), np.empty((size, 3))
    out_face[slot], out_weights[slot] = face[order], weights_in
    ends = slot[open_end] + 1
    out_face[ends], out_weights[ends] = face[order[open_end]], weights_out
    lengths = np.diff(start) + ~closed
    return SurfacePaths(out_face, out_weights, list_starts(lengths), closed)


def _on_side(corner: NDArray, side: NDArray, level: float) -> NDArray[np.float64]:
    """(k, 3) barycentric coordinates of the point of `side` where the linear function takes the level."""
    row = np.arange(len(side))
    a, b = corner[row, side], corner[row, NEXT[side]]
    t = np.clip((level - a) / (b - a), 0.0, 1.0)
    weights = np.zeros((len(side), 3))
    weights[row, side], weights[row, NEXT[side]] = 1 - t, t
    return weights


def chain(tail: NDArray, head: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Sort directed segments along their chains.

    Parameters
    ----------
    tail, head : (k,) ndarrays of int64
        Nodes. Chains break at nodes that are not the head of one segment and the tail of one other.

    Returns
    -------
    order : (k,) ndarray of int64
        Segments, chain by chain.
    start : (c+1,) ndarray of int64
    closed : (c,) ndarray of bool

    Notes
    -----
    Pointer doubling: log2(k) passes.
    """
    k = len(tail)
    if k == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=bool)
    nodes = int(max(tail.max(), head.max())) + 1
    once = (np.bincount(tail, minlength=nodes) == 1) & (np.bincount(head, minlength=nodes) == 1)
    leaving = np.full(nodes, -1, dtype=np.int64)
    leaving[head] = np.arange(k)
    before = np.where(once[tail], leaving[tail], -1)  # the segment that ends where this one begins
    before, closed_segment = _open_loops(before)
    root, rank = np.where(before < 0, np.arange(k), before), (before >= 0).astype(np.int64)
    while True:
        further = root[root]
        if np.array_equal(further, root):
            break
        rank = rank + rank[root]
        root = further
    order = np.lexsort((rank, root))
    first = np.flatnonzero(rank[order] == 0)
    return order, np.concatenate([first, [k]]), closed_segment[order[first]]


def _open_loops(before: NDArray) -> tuple[NDArray, NDArray]:
    """Cut every loop of predecessors at its lowest segment; return predecessors and segments on loops."""
    k = len(before)
    lowest, jump = np.arange(k), np.where(before < 0, np.arange(k), before)
    for _ in range(int(np.ceil(np.log2(max(k, 2)))) + 1):
        lowest = np.minimum(lowest, lowest[jump])
        jump = jump[jump]
    on_loop = before[jump] >= 0
    cut = on_loop & (lowest == np.arange(k))
    return np.where(cut, -1, before), on_loop
