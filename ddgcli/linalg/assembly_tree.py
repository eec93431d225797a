"""Symbolic analysis for a multifrontal factorisation: the assembly tree of frontal matrices, in stacks.

The rows of a frontal matrix are the unknowns that one part eliminates (pivots) and the unknowns of larger
parts that are coupled to them (update rows). The frontal matrices of one level of the assembly tree are
independent; those of similar size form a group, one dense stack in which the smaller matrices are padded.

I. Duff, J. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", 1983.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.linalg.dissection import Dissection

# heights of the dissection tree in one level, for parts of up to MAX_MERGED_SIZE unknowns: larger frontal
# matrices need more arithmetic, which is cheap while they are small, and fewer passes over memory
MERGED_HEIGHTS, MAX_MERGED_SIZE = 2, 500
# cost in moved entries: of one more group, and of one operation
GROUP_COST, OPERATION_COST = 50_000.0, 0.03


@dataclass(frozen=True, eq=False)
class FrontalGroup:
    """Stack of g frontal matrices of one level, with s pivots and u update rows each.

    Parameters
    ----------
    pivot : (g, s) ndarray of int64
        Unknown eliminated by each column; n for padding.
    update : (g, u) ndarray of int64
        Unknown of each further row; n for padding.
    start : int
        First entry of the (g, s + u, s + u) stack in the memory of its level.
    row, column : (g, u) ndarrays of int64
        Position of each update unknown in the parent matrix: first entry of its row in the memory of the next
        level, and column within the row.
    """

    pivot: NDArray[np.int64]
    update: NDArray[np.int64]
    start: int
    row: NDArray[np.int64]
    column: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class AssemblyLevel:
    """Independent frontal matrices, which are eliminated together.

    Parameters
    ----------
    groups : list of FrontalGroup
    size : int
        Number of entries of all frontal matrices.
    entry, place : (k,) ndarrays of int64
        Numbers of entries of the matrix and their positions in the memory of the level; lower triangles only.
    padding : (p,) ndarray of int64
        Diagonal positions of padded pivots.
    """

    groups: list[FrontalGroup]
    size: int
    entry: NDArray[np.int64]
    place: NDArray[np.int64]
    padding: NDArray[np.int64]


def assembly_levels(matrix: csc_array, dissection: Dissection) -> list[AssemblyLevel]:
    """Levels of frontal matrices of a symmetric pattern, leaves first.

    Parameters
    ----------
    matrix : (n, n) csc_array
        Both triangles stored; only the pattern is read.
    dissection : Dissection

    Returns
    -------
    list of AssemblyLevel
    """
    n = matrix.shape[0]
    tops = _tops(dissection)
    level = np.searchsorted(tops, dissection.height)
    node = dissection.leaf >> tops[level]
    order = np.lexsort((node, level))
    node, bounds = node[order], np.searchsorted(level[order], np.arange(len(tops) + 1))
    entry, row, column, entry_bounds = _lower_entries(matrix, order, bounds)
    levels: list[AssemblyLevel] = []
    below = _Layout.empty(n)
    for k, top in enumerate(tops):
        at = slice(entry_bounds[k], entry_bounds[k + 1])
        here = slice(bounds[k], bounds[k + 1])
        shift = top - tops[k - 1] if k else 0
        layout = _Layout(here, node[here], row[at], column[at], below.node >> shift, below.unknown, n)
        if k:
            levels.append(below.level(order, *layout.of_children))
        layout.entry = entry[at]
        below = layout
    nothing = np.zeros(0, dtype=np.int64)
    levels.append(below.level(order, nothing, nothing))
    return levels


def _tops(dissection: Dissection) -> NDArray[np.int64]:
    """Largest dissection height of each level, ascending."""
    highest = int(dissection.height.max(initial=0))
    leaf_size = len(dissection.leaf) / (int(dissection.leaf.max(initial=0)) + 1)
    tops = [0]
    while tops[-1] < highest:
        step = MERGED_HEIGHTS if leaf_size * 2.0 ** tops[-1] < MAX_MERGED_SIZE else 1
        tops.append(min(highest, tops[-1] + step))
    return np.array(tops)


def _lower_entries(
    matrix: csc_array, order: NDArray, bounds: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Entries of the ordered lower triangle: number, row, column, and the first entry of each level."""
    n = len(order)
    rank = np.empty(n, dtype=np.int64)
    rank[order] = np.arange(n)
    column = np.repeat(rank, np.diff(matrix.indptr))
    row = rank[matrix.indices]
    entry = np.flatnonzero(row >= column)
    level = np.searchsorted(bounds[1:-1], column[entry], side="right").astype(np.int16)
    entry = entry[np.argsort(level, kind="stable")]
    row, column = row[entry], column[entry]
    count = np.bincount(level, minlength=len(bounds) - 1)
    return entry, row, column, np.append(0, np.cumsum(count))


class _Layout:
    """Layout of one level: the unknowns of each frontal matrix and their positions.

    Unknowns are numbered in elimination order; those of the level are `here`, sorted by frontal matrix.
    """

    entry: NDArray[np.int64]

    def __init__(
        self,
        here: slice,
        owner: NDArray,
        row: NDArray,
        column: NDArray,
        child_node: NDArray,
        child_unknown: NDArray,
        n: int,
    ) -> None:
        self.here, self.n = here, n
        front_of_entry = owner[column - here.start]
        above, child_above = row >= here.stop, child_unknown >= here.stop
        key = np.append(front_of_entry[above], child_node[child_above]) * n
        key += np.append(row[above], child_unknown[child_above])
        pairs, number = np.unique(key, return_inverse=True)
        self.node, self.unknown = np.divmod(pairs, max(n, 1))
        count = int(max(owner.max(initial=-1), self.node.max(initial=-1))) + 1
        self.n_pivots, self.n_updates = (np.bincount(x, minlength=count) for x in (owner, self.node))
        self._first_pivot = here.start + np.cumsum(self.n_pivots) - self.n_pivots
        self._first_pair = np.cumsum(self.n_updates) - self.n_updates
        self._place_fronts()
        n_entries = int(above.sum())
        self.place = self._base[front_of_entry] + column - self._first_pivot[front_of_entry]
        self.place += self._width[front_of_entry] * self._local(
            front_of_entry, row, above, number[:n_entries]
        )
        local = self._local(child_node, child_unknown, child_above, number[n_entries:])
        self.of_children = self._base[child_node] + self._width[child_node] * local, local

    @staticmethod
    def empty(n: int) -> _Layout:
        nothing = np.zeros(0, dtype=np.int64)
        return _Layout(slice(0, 0), nothing, nothing, nothing, nothing, nothing, n)

    def _local(self, frontal: NDArray, unknown: NDArray, above: NDArray, pair: NDArray) -> NDArray:
        """Row of each unknown in its frontal matrix; `pair` for unknowns that are not pivots of the level."""
        local = unknown - self._first_pivot[frontal]
        up = frontal[above]
        local[above] = self._padded_pivots[up] + pair - self._first_pair[up]
        return local

    def _place_fronts(self) -> None:
        """Group the frontal matrices; set base, width and number of pivots of each, with padding."""
        count = len(self.n_pivots)
        self._base, self._width, self._padded_pivots = (np.zeros(count, dtype=np.int64) for _ in range(3))
        self.groups: list[tuple[NDArray, int]] = []
        self.size = 0
        for members in _similar_sizes(self.n_pivots, self.n_updates):
            s = self.n_pivots[members].max()
            f = s + self.n_updates[members].max()
            self._padded_pivots[members], self._width[members] = s, f
            self._base[members] = self.size + f * f * np.arange(len(members))
            self.groups.append((members, self.size))
            self.size += int(f * f * len(members))

    def level(self, order: NDArray, row: NDArray, column: NDArray) -> AssemblyLevel:
        """The level, from the positions of its update unknowns in the level above."""
        unknown = np.append(order, self.n)
        row, column = np.append(row, 0), np.append(column, 0)
        groups, padding = [], []
        for members, start in self.groups:
            pivot = _padded(self._first_pivot[members], self.n_pivots[members], self.n)
            pair = _padded(self._first_pair[members], self.n_updates[members], len(self.unknown))
            update = unknown[np.append(self.unknown, self.n)[pair]]
            groups.append(FrontalGroup(unknown[pivot], update, start, row[pair], column[pair]))
            frontal, pivot_place = np.nonzero(pivot == self.n)
            padding.append(self._base[members][frontal] + pivot_place * (self._width[members][frontal] + 1))
        padded_pivots = np.concatenate([*padding, np.zeros(0, int)])
        return AssemblyLevel(groups, self.size, self.entry, self.place, padded_pivots)


def _padded(first: NDArray, count: NDArray, padding: int) -> NDArray[np.int64]:
    """(g, largest count) rows first, first + 1, ... of `count` entries, then padding."""
    offset = np.arange(int(count.max(initial=0)))
    return np.where(offset < count[:, None], first[:, None] + offset, padding)


def _similar_sizes(s: NDArray, u: NDArray) -> list[NDArray]:
    """Groups of non-empty frontal matrices of similar size; a split must save more than a group costs."""
    frontals = np.flatnonzero(s + u > 0)
    frontals = frontals[np.argsort((s + u)[frontals], kind="stable")]
    groups, pending = [], [frontals] if len(frontals) else []
    while pending:
        members = pending.pop()
        cut = _best_cut(s[members], u[members])
        if cut:
            pending += [members[cut:], members[:cut]]
        else:
            groups.append(np.sort(members))
    return groups


def _best_cut(s: NDArray, u: NDArray) -> int:
    """Index where a group is split in two; 0 if a split saves nothing."""

    def cost(count: NDArray, s: NDArray, u: NDArray) -> NDArray:
        s, u = s.astype(float), u.astype(float)
        return count * ((s + u) ** 2 + OPERATION_COST * s * (s * s / 2 + 2 * s * u + 2 * u * u))

    g = len(s)
    count = np.arange(1, g)
    low = [np.maximum.accumulate(x) for x in (s, u)]
    high = [np.maximum.accumulate(x[::-1])[::-1] for x in (s, u)]
    whole = cost(np.array([g]), low[0][-1:], low[1][-1:])[0]
    cuts = cost(count, low[0][:-1], low[1][:-1]) + cost(g - count, high[0][1:], high[1][1:])
    best = int(np.argmin(cuts)) if g > 1 else 0
    return best + 1 if g > 1 and cuts[best] + GROUP_COST < whole else 0
