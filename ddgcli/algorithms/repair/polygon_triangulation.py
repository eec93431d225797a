"""Constrained Delaunay triangulation of a polygon and points inside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.ragged import repeat_with_place
from ddgcli.mesh.topology import Topology

QHULL_OPTIONS = "Qbb Qc Qz Qt"
AREA_TOLERANCE = 1e-14  # doubled areas of triangles within the unit disc that are rounding


class NotAPolygonError(Exception):
    """Edges of a closed line cross or touch each other, or have no length."""


def polygon_triangles(rim: NDArray, inner: NDArray) -> NDArray[np.int64]:
    """Delaunay triangles of a polygon's corners and of points inside it; the polygon's edges are kept.

    Edges that the Delaunay triangulation lacks are inserted by flips of those that they cross (Sloan 1993).

    Parameters
    ----------
    rim : (n, 2) ndarray of float64
        Corners of a polygon in the unit disc, counter-clockwise.
    inner : (k, 2) ndarray of float64

    Returns
    -------
    (m, 3) ndarray of int64
        Counter-clockwise triangles within the polygon; points of `rim` first.

    Raises
    ------
    NotAPolygonError
    """
    flat = np.concatenate([rim, inner])
    try:
        simplices = Delaunay(flat, qhull_options=QHULL_OPTIONS).simplices.astype(np.int64)
    except QhullError:
        raise NotAPolygonError from None
    area = _doubled_area(*(flat[simplices[:, k]] for k in range(3)))
    triangles = np.where((area < 0)[:, None], simplices[:, ::-1], simplices)[np.abs(area) > AREA_TOLERANCE]
    topology = _with_edges(Topology(triangles, len(flat)), flat, _edges(len(rim)))
    return topology.faces[_is_enclosed(topology, len(rim))]


def points_inside(rim: NDArray, points: NDArray) -> NDArray[np.bool_]:
    """Whether points lie inside a polygon.

    Parameters
    ----------
    rim : (n, 2) ndarray of float64
        Corners.
    points : (k, 2) ndarray of float64

    Returns
    -------
    (k,) ndarray of bool
    """
    order = np.argsort(points[:, 1])
    end = np.roll(rim, -1, axis=0)
    low, high = np.searchsorted(points[order, 1], np.sort(np.stack([rim[:, 1], end[:, 1]]), axis=0))
    edge, place = repeat_with_place(np.arange(len(rim)), high - low)  # edges that a point's row meets
    point = order[low[edge] + place]
    is_left = _doubled_area(rim[edge], end[edge], points[point]) > 0.0
    is_before = is_left == (end[edge, 1] > rim[edge, 1])
    return np.bincount(point[is_before], minlength=len(points)) % 2 == 1


def _edges(count: int) -> NDArray[np.int64]:
    """(n, 2) edges of a polygon."""
    corner = np.arange(count)
    return np.stack([corner, np.roll(corner, -1)], axis=1)


def _doubled_area(a: NDArray, b: NDArray, c: NDArray) -> NDArray[np.float64]:
    first, second = b - a, c - a
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _cross(a: NDArray, b: NDArray, c: NDArray, d: NDArray) -> NDArray[np.bool_]:
    """Whether segments ab and cd cross at an inner point of both."""
    apart = _doubled_area(a, b, c) * _doubled_area(a, b, d) < -(AREA_TOLERANCE**2)
    return apart & (_doubled_area(c, d, a) * _doubled_area(c, d, b) < -(AREA_TOLERANCE**2))


def _with_edges(topology: Topology, flat: NDArray, edges: NDArray) -> Topology:
    """Flip edges until all of `edges` are there."""
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    while len(missing := edges[edge_indices(topology.edges, edges) < 0]):
        quad, faces = _convex_quads(topology, flat)
        may_flip = edge_indices(edges, quad[:, :2]) < 0  # so that the loop ends, also where `edges` cross
        quad, faces = quad[may_flip], faces[may_flip]
        inserts = np.flatnonzero(edge_indices(missing, quad[:, 2:]) >= 0)
        if len(inserts):
            claim = np.full(topology.n_faces, len(inserts))
            rank = np.arange(len(inserts))[:, None]
            np.minimum.at(claim, faces[inserts], rank)
            flips = inserts[(claim[faces[inserts]] == rank).all(axis=1)]
        else:  # one edge less crosses the first
            start, end = flat[missing[0]]
            i, j, k, other = np.moveaxis(flat[quad], 1, 0)
            flips = np.flatnonzero(_cross(start, end, i, j) & ~_cross(start, end, k, other))[:1]
            if not len(flips):
                raise NotAPolygonError
        i, j, k, other = quad[flips].T
        corners = np.array(topology.faces)
        corners[faces[flips, 0]] = np.stack([i, other, k], axis=1)
        corners[faces[flips, 1]] = np.stack([j, k, other], axis=1)
        topology = Topology(corners, topology.n_vertices)
    return topology


def _convex_quads(topology: Topology, flat: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(k, 4) vertices i, j, k, l of edges ij between triangles ijk and jil that cross kl; their triangles."""
    side = topology.interior_sides
    twin = topology.side_twin.ravel()[side]
    corner = topology.faces.ravel()
    apex = (s - s % 3 + (s + 2) % 3 for s in (side, twin))
    quad = np.stack([topology.side_tail[side], topology.side_head[side], *(corner[a] for a in apex)], axis=1)
    i, j, k, other = np.moveaxis(flat[quad], 1, 0)
    is_convex = _cross(i, j, k, other)
    return quad[is_convex], np.stack([side, twin], axis=1)[is_convex] // 3


def _is_enclosed(topology: Topology, count: int) -> NDArray[np.bool_]:
    """(m,) whether triangles lie within the polygon of the first `count` points."""
    rim = edge_indices(topology.edges, _edges(count))
    side = topology.interior_sides
    side = side[~np.isin(topology.side_edge.ravel()[side], rim)]
    _, piece = connected_labels(side // 3, topology.side_twin.ravel()[side] // 3, topology.n_faces)
    is_ahead = (topology.side_tail < count) & (topology.side_head == (topology.side_tail + 1) % count)
    return np.isin(piece, piece[np.flatnonzero(is_ahead) // 3])
