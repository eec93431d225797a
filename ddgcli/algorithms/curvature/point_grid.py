"""Points in cubes, for balls around a few of them.

A k-d tree finds the same balls, but the import of `scipy.spatial` alone takes a quarter of a command on
200,000 faces; to sort the points by their cubes takes a hundredth of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.regions import Regions
from ddgcli.mesh.ragged import list_starts, ranges, sorted_keys

MAX_CUBES = 1 << 13  # along an axis: keys and places fit in one integer
MAX_CANDIDATES = 1 << 21  # points of the cubes around centres, handled at once


def balls_by_cubes(points: NDArray, few: NDArray, radius: float) -> Regions:
    """Points in the balls around a few points, in ascending order.

    Parameters
    ----------
    points : (3, n) ndarray of float64
    few : (k,) ndarray of int
        Numbers of the centres.
    radius : float
        Distances up to it count, as those of `regions.balls_around`.
    """
    n = points.shape[1]
    low = points.min(axis=1, keepdims=True)
    # wider by rounding, so that all neighbours lie in the next cubes
    edge = max(radius * (1 + 1e-9), float((points.max(axis=1, keepdims=True) - low).max()) / MAX_CUBES)
    cube = ((points - low) / edge).astype(np.int64)
    cube += 1
    size_y, size_z = int(cube[1].max()) + 2, int(cube[2].max()) + 2
    key = (cube[0] * size_y + cube[1]) * size_z + cube[2]
    of_centre = key[few]
    key, member = sorted_keys(key, (int(cube[0].max()) + 2) * size_y * size_z, overwrite=True)
    # the cubes above one another have successive keys: nine columns of three
    column = ((np.arange(-1, 2)[:, None] * size_y + np.arange(-1, 2)) * size_z).ravel()
    middle = of_centre[:, None] + column
    first = np.searchsorted(key, middle - 1, side="left")
    count = np.searchsorted(key, middle + 1, side="right") - first
    pairs = [np.zeros(0, dtype=np.int64)]
    of_block = list_starts(count.sum(axis=1)) // MAX_CANDIDATES
    for block in np.unique(of_block[:-1]):
        rows = np.flatnonzero(of_block[:-1] == block)
        near = member[ranges(first[rows].ravel(), count[rows].ravel())[0]]
        centre = np.repeat(rows, count[rows].sum(axis=1))
        squared = np.zeros(len(near))
        for column_values in points:
            squared += (column_values.take(near) - column_values.take(few[centre])) ** 2
        inside = np.flatnonzero(squared <= radius * radius)
        pairs.append(centre[inside] * n + near[inside])
    order = np.sort(np.concatenate(pairs))
    centre, reached = np.divmod(order, n)
    return Regions(list_starts(np.bincount(centre, minlength=len(few))), reached)
