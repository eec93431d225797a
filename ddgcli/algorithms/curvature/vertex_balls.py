"""The vertices in the ball around every vertex, connected to it inside that ball."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.ball_blocks import (
    ball_blocks,
    connected,
    lists_of,
    neighbours_among,
    packed,
    unpacked,
    within,
)
from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.algorithms.curvature.rings import adjacency
from ddgcli.mesh.ragged import list_starts, ranges
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.workers import results_in_order


class _Vertices(NamedTuple):
    """What the balls of all blocks share."""

    columns: NDArray  # (3, n)
    radii: NDArray
    first_neighbour: NDArray
    neighbour: NDArray


def vertex_balls(mesh: TriangleMesh, radius: float | NDArray, *, jobs: int = 1) -> Regions:
    """Vertices within a distance in space of each vertex, connected to it by edges inside that ball.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float or (n,) ndarray
        Of all balls, or of that around each vertex.
    jobs : int
        Processes that handle blocks; the result does not depend on it.

    Returns
    -------
    Regions
        The members of a ball in ascending order, the vertex itself among them.
    """
    near = adjacency(mesh.topology)
    columns, radii = np.ascontiguousarray(mesh.points.T), np.broadcast_to(radius, mesh.n_vertices)
    arguments = columns, radii, near.indptr.astype(np.int64), near.indices.astype(np.int64)
    tasks = ball_blocks(mesh.points, radius)
    blocks = list(results_in_order(_balls, tasks, jobs, prepare=_Vertices, arguments=arguments))
    count = np.zeros(mesh.n_vertices, dtype=np.int64)
    for owner, sizes, _ in blocks:
        count[owner] = sizes
    start = list_starts(count)
    member = np.zeros(start[-1], dtype=np.int32)
    for owner, sizes, members in blocks:
        member[ranges(start[owner], sizes)[0]] = members
    return Regions(start, member)


def _balls(vertices: _Vertices, owner: NDArray, near: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The vertices, the sizes of their balls, and the members of these."""
    columns, radii = vertices.columns, vertices.radii
    inside = within(columns, near, columns[:, owner], radii[owner])
    seed = np.zeros_like(inside)
    seed[np.searchsorted(near, owner), np.arange(len(owner))] = True
    lists = neighbours_among(near, vertices.first_neighbour, vertices.neighbour)
    start, place = lists_of(unpacked(connected(packed(seed), packed(inside), *lists), len(owner)))
    return owner, np.diff(start), near[place].astype(np.int32)
