"""Points in cubes, for balls around a few of them.

A k-d tree finds the same balls, but the import of `scipy.spatial` alone takes a quarter of a command on
200,000 faces; to sort the points by their cubes takes a hundredth of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.mesh.ragged import list_starts, ranges, sorted_keys
from ddgcli.mesh.vectors import dot

MAX_CUBES = 1 << 13  # along an axis: keys and places fit in one integer
MAX_REACH = 4  # cubes in a radius, above which wider cubes take less time
MAX_CANDIDATES = 1 << 21  # points of the cubes around centres, handled at once


class PointGrid:
    """Points sorted by cubes, which serve for balls of several radii.

    Parameters
    ----------
    points : (3, n) ndarray of float64
    """

    def __init__(self, points: NDArray) -> None:
        self._points = points
        self._edge = 0.0

    def balls(self, few: NDArray, radius: float) -> Regions:
        """Points in the balls around a few points, in ascending order.

        Parameters
        ----------
        few : (k,) ndarray of int
            Indices of the centres.
        radius : float
            Distances up to it count, as those of `regions.balls_around`.
        """
        # wider by rounding, so that all neighbours lie in the cubes of the reach
        wide = radius * (1 + 1e-9)
        if wide > MAX_REACH * self._edge:
            self._sort(wide)
        n, reach = self._points.shape[1], math.ceil(wide / self._edge)
        # the cubes above one another have successive keys: columns of them
        steps = np.arange(-reach, reach + 1)
        column = ((steps[:, None] * self._size_y + steps) * self._size_z).ravel()
        middle = self._keys_of(few)[:, None] + column
        first = np.searchsorted(self._key, middle - reach, side="left")
        count = np.searchsorted(self._key, middle + reach, side="right") - first
        pairs = [np.zeros(0, dtype=np.int64)]
        of_block = list_starts(count.sum(axis=1)) // MAX_CANDIDATES
        for block in np.unique(of_block[:-1]):
            rows = np.flatnonzero(of_block[:-1] == block)
            near = self._member[ranges(first[rows].ravel(), count[rows].ravel())[0]]
            n_near = count[rows].sum(axis=1)
            centre = np.repeat(rows, n_near)
            vector = self._points.take(near, axis=1)
            vector -= np.repeat(self._points.take(few[rows], axis=1), n_near, axis=1)
            squared = dot(vector, vector)
            inside = np.flatnonzero(squared <= radius * radius)
            pairs.append(centre[inside] * n + near[inside])
        order = np.sort(np.concatenate(pairs))
        centre, reached = np.divmod(order, n)
        return Regions(list_starts(np.bincount(centre, minlength=len(few))), reached)

    def _sort(self, edge: float) -> None:
        """Sort the points by cubes of this edge, or wider ones where these are too many."""
        low, high = self._points.min(axis=1), self._points.max(axis=1)
        self._low, self._edge = low, max(edge, float((high - low).max()) / MAX_CUBES)
        # empty cubes around all points separate the columns
        sizes = [int((top - bottom) / self._edge) + 2 * MAX_REACH + 1 for bottom, top in zip(low, high)]
        _, self._size_y, self._size_z = sizes
        key = self._keys_of(slice(None))
        self._key, self._member = sorted_keys(key, math.prod(sizes), overwrite=True)

    def _keys_of(self, which: NDArray | slice) -> NDArray[np.int64]:
        """Keys of the cubes of some points."""
        key = np.zeros(1, dtype=np.int64)
        for values, low, size in zip(self._points, self._low, (1, self._size_y, self._size_z)):
            cube = ((values[which] - low) / self._edge).astype(np.int64)
            cube += key * size
            cube += MAX_REACH
            key = cube
        return key
