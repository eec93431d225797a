"""Balls around all vertices, in blocks: what each block may hold, and what is connected in a ball.

Vertices that lie near each other are handled together: a KD-tree divides the surface into blocks, each with
the vertices that any of its balls may hold. Bits of whole words, one bit for each ball, mark what lies within
the radius and what is connected: one operation grows 64 balls by one ring.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import list_starts, ranges

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

BALLS_PER_BLOCK = 256
MAX_BLOCK_CELLS = 4_000_000  # pairs of a ball and a vertex that may lie in it, handled at once
BITS_PER_WORD = 64


def point_tree(points: NDArray) -> cKDTree:
    """K-d tree whose leaves are the blocks of balls around all points.

    Parameters
    ----------
    points : (n, 3) ndarray of float64

    Returns
    -------
    cKDTree
    """
    from scipy.spatial import cKDTree  # a sixth of a small run's time, needed by wide radii only

    return cKDTree(points, leafsize=BALLS_PER_BLOCK)


def leaves(tree: cKDTree) -> Iterator[NDArray[np.int64]]:
    """Points of each leaf of a k-d tree.

    Parameters
    ----------
    tree : cKDTree

    Yields
    ------
    (b,) ndarray of int64
        Ascending.
    """
    nodes = [tree.tree]
    while nodes:
        node = nodes.pop()
        if node.split_dim >= 0:
            nodes += [node.lesser, node.greater]
        else:
            yield np.sort(node.indices)


def blocks_of_leaf(
    tree: cKDTree, radii: NDArray, leaf: NDArray
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Divide the balls around the points of a leaf into blocks.

    Parameters
    ----------
    tree : cKDTree
        k-d tree of n points.
    radii : (n,) ndarray of float64
        Radius of the ball around each point.
    leaf : (b,) ndarray of int64
        Points near each other, ascending.

    Yields
    ------
    owner : (c,) ndarray of int64
        Centres of the balls of a block, ascending.
    near : (k,) ndarray of int64
        All points that these balls may hold, ascending.
    """
    points = tree.data[leaf]
    low, high = points.min(axis=0), points.max(axis=0)
    middle = low / 2 + high / 2
    # longer by a few roundings, so that no member of a ball is lost
    reach = (radii[leaf].max() + np.linalg.norm(high - middle)) * (1 + 1e-9)
    near = np.array(tree.query_ball_point(middle, reach, return_sorted=True), dtype=np.int64)
    n_balls = max(1, min(BALLS_PER_BLOCK, MAX_BLOCK_CELLS // len(near)))
    for first in range(0, len(leaf), n_balls):
        yield leaf[first : first + n_balls], near


def ball_blocks(
    tree: cKDTree, radius: float, most: int | None = None
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Divide the balls of one radius around all points, or those of some leaves, into blocks.

    Parameters
    ----------
    tree : cKDTree
        As returned by `point_tree`.
    radius : float
    most : int, optional
        Number of leaves, evenly chosen, whose blocks are given; default all.

    Yields
    ------
    owner, near : ndarray of int64
        As those of `blocks_of_leaf`.
    """
    of_tree, radii = list(leaves(tree)), np.broadcast_to(radius, tree.n)
    for leaf in of_tree[:: max(1, len(of_tree) // most) if most else 1]:
        yield from blocks_of_leaf(tree, radii, leaf)


def within(columns: NDArray, near: NDArray, centres: NDArray, radius: float | NDArray) -> NDArray[np.bool_]:
    """Whether points lie in balls.

    Parameters
    ----------
    columns : (3, n) ndarray of float64
        Positions.
    near : (k,) ndarray of int64
        Points that are tested.
    centres : (3, b) ndarray of float64
    radius : float or (b,) ndarray

    Returns
    -------
    (k, b) ndarray of bool
    """
    squared = np.zeros((len(near), centres.shape[1]))
    for column, centre in zip(columns, centres):
        offset = column[near, None] - centre
        offset *= offset
        squared += offset
    return squared <= radius * radius


def neighbours_among(
    near: NDArray, start: NDArray, neighbour: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Neighbours of some elements among these, by their places.

    Parameters
    ----------
    near : (k,) ndarray of int64
        Elements, ascending.
    start, neighbour : ndarray of int64
        Ragged lists of the neighbours of all elements.

    Returns
    -------
    start, neighbour : ndarray of int64
        Ragged lists of the k elements.
    """
    count = start[near + 1] - start[near]
    neighbour = neighbour[ranges(start[near], count)[0]]
    place = np.minimum(np.searchsorted(near, neighbour), max(len(near) - 1, 0))
    among = near[place] == neighbour
    row = np.repeat(np.arange(len(near)), count)[among]
    return list_starts(np.bincount(row, minlength=len(near))), place[among]


def connected(seed: NDArray, inside: NDArray, start: NDArray, neighbour: NDArray) -> NDArray[np.uint64]:
    """Elements of balls that neighbours inside connect to their seeds.

    Parameters
    ----------
    seed, inside : (k, w) ndarray of uint64
        Bits of each element, as `packed` makes them: one for each ball.
    start, neighbour : ndarray of int64
        Ragged lists of the neighbours of the k elements, each among its own.

    Returns
    -------
    (k, w) ndarray of uint64
    """
    reached = seed & inside
    while len(reached):
        # every element is its own neighbour: no list is empty, and what is reached stays reached
        grown = np.bitwise_or.reduceat(np.take(reached, neighbour, axis=0), start[:-1], axis=0) & inside
        if np.array_equal(grown, reached):
            break
        reached = grown
    return reached


def packed(flags: NDArray) -> NDArray[np.uint64]:
    """Pack flags into bits of words.

    Parameters
    ----------
    flags : (k, b) ndarray of bool

    Returns
    -------
    (k, w) ndarray of uint64
        With w = ceil(b / 64).
    """
    n_words = -(-flags.shape[1] // BITS_PER_WORD)
    words = np.zeros((len(flags), 8 * n_words), dtype=np.uint8)
    eighths = np.packbits(flags, axis=1)
    words[:, : eighths.shape[1]] = eighths
    return words.view(np.uint64)


def unpacked(words: NDArray, count: int) -> NDArray[np.bool_]:
    """Flags of each ball from bits of words: `packed` undone and transposed.

    Parameters
    ----------
    words : (k, w) ndarray of uint64
    count : int
        Number of balls.

    Returns
    -------
    (count, k) ndarray of bool
    """
    bits = np.unpackbits(words.view(np.uint8), axis=1, count=count)
    return np.ascontiguousarray(bits.T).view(np.bool_)


def lists_of(flags: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the flags that are set, row by row.

    Parameters
    ----------
    flags : (b, k) ndarray of bool

    Returns
    -------
    start, member : ndarray of int64
        Ragged lists of the b rows.
    """
    count = np.count_nonzero(flags, axis=1)
    # a flat search takes a third of the time of np.nonzero
    row_start = flags.shape[1] * np.arange(len(flags))
    return list_starts(count), np.flatnonzero(flags) - np.repeat(row_start, count)
