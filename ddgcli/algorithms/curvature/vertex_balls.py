"""The vertices in the ball around every vertex, connected to it inside that ball.

Vertices that lie near each other are handled together: a KD-tree divides the surface into blocks, each with
the vertices that any of its balls may hold. Bits of whole words, one bit for each ball, mark those that lie
within the radius and those that are connected: one operation grows 64 balls by one ring.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.algorithms.curvature.rings import adjacency
from ddgcli.mesh.ragged import list_starts, ranges
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.workers import results_in_order

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

BALLS_PER_BLOCK = 256
MAX_BLOCK_CELLS = 4_000_000  # pairs of a ball and a vertex that may lie in it, handled at once
BITS_PER_WORD = 64


class _Vertices(NamedTuple):
    """What the balls of all blocks share."""

    points: NDArray
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
    from scipy.spatial import cKDTree  # a sixth of a small run's time, needed by wide radii only

    near = adjacency(mesh.topology)
    tree = cKDTree(mesh.points, leafsize=BALLS_PER_BLOCK)
    radii = np.broadcast_to(radius, mesh.n_vertices)
    arguments = mesh.points, radii, near.indptr.astype(np.int64), near.indices.astype(np.int64)
    blocks = list(
        results_in_order(
            _balls,
            _blocks(tree, mesh.points, radii),
            jobs,
            prepare=_Vertices,
            arguments=arguments,
            modules=(__name__,),
        )
    )
    count = np.zeros(mesh.n_vertices, dtype=np.int64)
    for owner, sizes, _ in blocks:
        count[owner] = sizes
    start = list_starts(count)
    member = np.zeros(start[-1], dtype=np.int32)
    for owner, sizes, members in blocks:
        member[ranges(start[owner], sizes)[0]] = members
    return Regions(start, member)


def _blocks(tree: cKDTree, points: NDArray, radii: NDArray) -> Iterator[tuple[NDArray, NDArray]]:
    """Vertices of parts of each leaf, and all vertices that their balls may hold; both in order."""
    for leaf in _leaves(tree):
        owner = np.sort(leaf)
        corner = points[owner].min(axis=0), points[owner].max(axis=0)
        middle = corner[0] / 2 + corner[1] / 2
        # longer by a few roundings, so that no member of a ball is lost
        reach = (radii[owner].max() + np.linalg.norm(corner[1] - middle)) * (1 + 1e-9)
        candidate = np.array(tree.query_ball_point(middle, reach, return_sorted=True), dtype=np.int64)
        n_balls = max(1, min(BALLS_PER_BLOCK, MAX_BLOCK_CELLS // len(candidate)))
        for first in range(0, len(owner), n_balls):
            yield owner[first : first + n_balls], candidate


def _leaves(tree: cKDTree) -> Iterator[NDArray]:
    """Points of each leaf of a KD-tree."""
    nodes = [tree.tree]
    while nodes:
        node = nodes.pop()
        if node.split_dim >= 0:
            nodes += [node.lesser, node.greater]
        else:
            yield node.indices


def _balls(vertices: _Vertices, owner: NDArray, candidate: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The vertices, the sizes of their balls, and the members of these."""
    inside = _within(vertices.points, owner, candidate, vertices.radii[owner])
    start, neighbour = _neighbours_among(candidate, vertices.first_neighbour, vertices.neighbour)
    reached = _connected(inside, owner, candidate, start, neighbour)
    row, column = np.nonzero(reached)
    return owner, np.bincount(row, minlength=len(owner)), candidate[column].astype(np.int32)


def _within(points: NDArray, owner: NDArray, candidate: NDArray, radius: NDArray) -> NDArray[np.bool_]:
    """(m, b) whether each candidate lies in each ball, of radii (b,)."""
    squared = np.zeros((len(candidate), len(owner)))
    for column in points.T:
        offset = column[candidate, None] - column[owner]
        offset *= offset
        squared += offset
    return squared <= radius * radius


def _neighbours_among(candidate: NDArray, start: NDArray, neighbour: NDArray) -> tuple[NDArray, NDArray]:
    """Neighbours of the candidates among the candidates, by their places, as ragged lists."""
    count = start[candidate + 1] - start[candidate]
    neighbour = neighbour[ranges(start[candidate], count)[0]]
    place = np.minimum(np.searchsorted(candidate, neighbour), len(candidate) - 1)
    among = candidate[place] == neighbour
    row = np.repeat(np.arange(len(candidate)), count)[among]
    return list_starts(np.bincount(row, minlength=len(candidate))), place[among]


def _connected(
    inside: NDArray, owner: NDArray, candidate: NDArray, start: NDArray, neighbour: NDArray
) -> NDArray[np.bool_]:
    """(b, m) whether each candidate is connected to the centre of each ball by edges inside the ball."""
    seed = np.zeros_like(inside)
    seed[np.searchsorted(candidate, owner), np.arange(len(owner))] = True
    reached, allowed = _packed(seed), _packed(inside)
    while True:
        # every vertex is its own neighbour: no list is empty, and what is reached stays reached
        grown = np.bitwise_or.reduceat(np.take(reached, neighbour, axis=0), start[:-1], axis=0) & allowed
        if np.array_equal(grown, reached):
            break
        reached = grown
    bits = np.unpackbits(reached.view(np.uint8), axis=1, count=len(owner))
    return np.ascontiguousarray(bits.T).view(np.bool_)


def _packed(flags: NDArray) -> NDArray[np.uint64]:
    """Flags of a row as bits of words."""
    n_words = -(-flags.shape[1] // BITS_PER_WORD)
    packed = np.zeros((len(flags), 8 * n_words), dtype=np.uint8)
    eighths = np.packbits(flags, axis=1)
    packed[:, : eighths.shape[1]] = eighths
    return packed.view(np.uint64)
